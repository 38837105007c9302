//! Stretching: pull the two sides of a hole apart, across its long axis and slightly up.
//!
//! A loop that the camera sees inside the outline is the opening of a fold or a pocket (module `hole`). On either side of it the
//! grip is the candidate with the least distance to the loop along the surface, plus half its distance from the centre of the
//! slit along it:
//!
//! ```text
//! cost(a, b) = Σ d(loop, ·) + ½ |u·(· − c)|,        pull: p ± ½ (distance · open(t)) v + lift · open(t) n
//! ```
//!
//! A third arm holds the body outside of the pulled part, in line with the centre of the slit, so that it does not follow.

use derive_setters::Setters;
use nalgebra::{Isometry3, Translation3, UnitVector3};

use crate::assign::{assign, cross};
use crate::check::{Carried, Surroundings};
use crate::hole::Hole;
use crate::model::Adjacency;
use crate::motion::{Pace, assemble, times};
use crate::options::Support;
use crate::orientation::retreat;
use crate::scene::{not_negative, positive, within};
use crate::{
    Candidate, Candidates, Error, Grip, Leg, Model, Motion, Options, Refusal, Role, Scene, Stage,
    candidates_among,
};

/// Options of a stretch.
#[derive(Debug, Clone, Copy, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct StretchOptions {
    /// Additional distance between the grips, metres. Default 0.04.
    pub distance: f64,
    /// Rise of the grips meanwhile, metres. Default 0.015.
    pub lift: f64,
    /// Largest distance of grips from the loop along the surface, metres. Default 0.03.
    pub reach: f64,
    /// How long the hole is held open, seconds. Default 2.
    pub hold: f64,
    /// Remaining share of the stretch when the jaws open, 0 to 1. Default 0.5: cloth then stays open, and tissue is not harmed.
    pub keep: f64,
    /// Largest speed of a tip, m/s. Default 0.02.
    pub speed: f64,
    /// Acceleration and deceleration, m/s². Default 0.02.
    pub acceleration: f64,
    /// How far the tips retreat after the release, metres. Default 0.05.
    pub retreat_distance: f64,
}

impl Default for StretchOptions {
    fn default() -> Self {
        Self {
            distance: 0.04,
            lift: 0.015,
            reach: 0.03,
            hold: 2.0,
            keep: 0.5,
            speed: 0.02,
            acceleration: 0.02,
            retreat_distance: 0.05,
        }
    }
}

impl StretchOptions {
    pub(crate) fn check(&self) -> Result<(), Error> {
        positive("distance", self.distance)?;
        not_negative("lift", self.lift)?;
        positive("reach", self.reach)?;
        not_negative("hold", self.hold)?;
        within("keep", self.keep, 0.0, 1.0, "between 0 and 1")?;
        positive("speed", self.speed)?;
        positive("acceleration", self.acceleration)?;
        positive("retreat_distance", self.retreat_distance)
    }
}

/// The candidates beside a hole, and the pairs of them for which there are two arms, least cost first.
pub(crate) struct Beside {
    pub(crate) found: Candidates,
    pub(crate) pairs: Vec<PullPair>,
}

/// Two grips that pull a hole open.
pub(crate) struct PullPair {
    candidates: [usize; 2],
    arms: [usize; 2],
    /// Metres.
    cost: f64,
}

impl PullPair {
    /// 1 for grips at the centre of the loop itself, decreasing with their distance, relative to `reach`.
    pub(crate) fn score(&self, reach: f64) -> f64 {
        1.0 / (1.0 + self.cost / reach)
    }
}

/// Finds grips on both sides of the hole.
pub(crate) fn beside(
    model: &Model,
    scene: &Scene,
    boundary: &[u32],
    hole: &Hole,
    options: &Options,
    stretch: &StretchOptions,
) -> Result<Beside, Refusal> {
    let graph = Adjacency::new(model.points.len(), model.edges);
    let distance = graph.distances(model.points, boundary, 3.0 * stretch.reach);
    // Candidates beyond the reach are for the third arm.
    let near: Vec<u32> = (0..model.points.len() as u32)
        .filter(|&v| distance[v as usize].is_finite())
        .collect();
    let (inner, outer): (Vec<u32>, Vec<u32>) = near
        .into_iter()
        .partition(|&v| distance[v as usize] <= stretch.reach);
    let mut found = candidates_among(model, scene, options, &inner)?;
    let cost = |c: &Candidate| {
        distance[c.vertex as usize] + 0.5 * hole.long.dot(&(c.point - hole.center)).abs()
    };
    let mut pairs = pairs(&found.accepted, hole, scene, &cost)?;
    thin(&mut pairs, &found.accepted, scene, options.max_sets);
    if scene.arms.len() > 2 && options.support == Support::Hold && !outer.is_empty() {
        let pins = candidates_among(model, scene, options, &outer)?;
        found.accepted.extend(pins.accepted);
        found.rejected.extend(pins.rejected);
    }
    Ok(Beside { found, pairs })
}

/// All pairs on opposite sides, a jaw apart, for which there are two arms; least cost first.
fn pairs(
    found: &[Candidate],
    hole: &Hole,
    scene: &Scene,
    cost: &dyn Fn(&Candidate) -> f64,
) -> Result<Vec<PullPair>, Refusal> {
    let side = |sign: f64| -> Vec<usize> {
        let on = |k: &usize| sign * hole.side(&found[*k].point) > 0.0;
        (0..found.len()).filter(on).collect()
    };
    let sides = [side(-1.0), side(1.0)];
    if let Some(side) = (0..2).find(|&k| sides[k].is_empty()) {
        return Err(Refusal::NoGripBesideHole { side });
    }
    let mut pairs = Vec::new();
    for &a in &sides[0] {
        for &b in &sides[1] {
            let [p, q] = [&found[a], &found[b]];
            if (p.point - q.point).norm() < scene.jaw_separation {
                continue;
            }
            if let Some(arms) = assign(scene, [p, q], &[[p.tip, q.tip]]) {
                let cost = cost(p) + cost(q);
                pairs.push(PullPair {
                    candidates: [a, b],
                    arms,
                    cost,
                });
            }
        }
    }
    pairs.sort_by(|a, b| {
        a.cost
            .total_cmp(&b.cost)
            .then(a.candidates.cmp(&b.candidates))
    });
    if pairs.is_empty() {
        return Err(Refusal::NoGripBesideHole { side: 1 });
    }
    Ok(pairs)
}

/// Keeps the pair of least cost among those whose grips are within half a jaw separation of each other.
fn thin(pairs: &mut Vec<PullPair>, found: &[Candidate], scene: &Scene, most: usize) {
    let near =
        |a: usize, b: usize| (found[a].point - found[b].point).norm() < 0.5 * scene.jaw_separation;
    let mut kept: Vec<PullPair> = Vec::new();
    for pair in pairs.drain(..) {
        let copy = |k: &PullPair| (0..2).all(|s| near(k.candidates[s], pair.candidates[s]));
        if kept.len() < most && !kept.iter().any(copy) {
            kept.push(pair);
        }
    }
    *pairs = kept;
}

/// The grips of a pair, and of the arm that holds the body if there is one.
pub(crate) fn grips(
    pair: &PullPair,
    found: &[Candidate],
    hole: &Hole,
    scene: &Scene,
    options: &Options,
) -> Vec<Grip> {
    let at = |k: usize| &found[pair.candidates[k]];
    let mut grips: Vec<Grip> = (0..2)
        .map(|k| Grip::new(pair.arms[k], at(k), Role::Lift, scene, options))
        .collect();
    if options.support == Support::Hold
        && let Some((arm, candidate)) = pin(&grips, found, hole, scene)
    {
        grips.push(Grip::new(arm, candidate, Role::Support, scene, options));
    }
    grips
}

/// The candidate most in line with the centre of the slit among those that do not move much, and an arm that reaches it without crossing.
fn pin<'c>(
    grips: &[Grip],
    found: &'c [Candidate],
    hole: &Hole,
    scene: &Scene,
) -> Option<(usize, &'c Candidate)> {
    let apart = |c: &Candidate| {
        let far = |g: &Grip| {
            g.vertex != c.vertex && (g.tip() - c.tip).norm() >= 2.0 * scene.jaw_separation
        };
        grips.iter().all(far)
    };
    let free = |c: &Candidate| {
        let crosses = |arm: usize, g: &Grip| {
            let pull = [&scene.arms[g.arm].base, &g.tip()];
            cross(scene, [&scene.arms[arm].base, &c.tip], pull)
        };
        let fits = |arm: &usize| grips.iter().all(|g| g.arm != *arm && !crosses(*arm, g));
        c.arms.iter().copied().find(fits)
    };
    found
        .iter()
        .filter(|c| apart(c))
        .filter_map(|c| Some((free(c)?, c)))
        .min_by(|(_, a), (_, b)| {
            let off = |c: &Candidate| hole.side(&c.point).abs();
            off(a).total_cmp(&off(b)).then(a.vertex.cmp(&b.vertex))
        })
}

/// Way points of the pull and of the return.
const STEPS: usize = 12;

/// Pull, hold, partial return and setting down; checked.
pub(crate) fn pull(
    around: &Surroundings,
    grips: &[Grip],
    across: &UnitVector3<f64>,
    options: &StretchOptions,
) -> Result<Motion, Refusal> {
    let scene = around.scene;
    let pace = Pace {
        speed: grips
            .iter()
            .map(|g| scene.arms[g.arm].max_speed)
            .fold(options.speed, f64::min),
        acceleration: options.acceleration,
        turn_rate: 1.0,
    };
    let share = |i: usize| i as f64 / STEPS as f64;
    let pose = |k: usize, open: f64, raised: f64| {
        opened(k, &grips[k], across, scene, options, [open, raised])
    };
    let paths = |shares: &dyn Fn(usize) -> [f64; 2]| -> Vec<Vec<Isometry3<f64>>> {
        let path = |k: usize| {
            (0..=STEPS)
                .map(shares)
                .map(|[o, r]| pose(k, o, r))
                .collect()
        };
        (0..grips.len()).map(path).collect()
    };
    let mut whole = paths(&|i| [share(i), share(i)]);
    let back = paths(&|i| [1.0 - (1.0 - options.keep) * share(i), 1.0 - share(i)]);
    let mut clock = times(&whole, &pace);
    let pulled = clock.last().copied().unwrap_or(0.0);
    let held = pulled + options.hold;
    clock.extend(times(&back, &pace).iter().map(|t| held + t));
    whole
        .iter_mut()
        .zip(back)
        .for_each(|(out, back)| out.extend(back));
    let end = clock.last().copied().unwrap_or(0.0);
    let legs = [
        (Stage::Pull, pulled),
        (Stage::Hold, held),
        (Stage::Ease, end),
    ];
    let legs = legs.map(|(stage, until)| Leg { stage, until }).into();
    let mut motion = assemble(grips, &whole, &clock, legs);
    for (k, path) in motion.arms.iter_mut().enumerate() {
        path.camera_from_retreat =
            retreat(&pose(k, options.keep, 0.0), scene, options.retreat_distance);
    }
    let carried = Carried::Turned {
        turned: &[],
        leaving: options.retreat_distance,
    };
    around.check(&motion, &carried)?;
    Ok(motion)
}

/// Pose of grip `k` with given shares of the stretch and of the lift; a supporting grip stays.
fn opened(
    k: usize,
    grip: &Grip,
    across: &UnitVector3<f64>,
    scene: &Scene,
    options: &StretchOptions,
    [open, raised]: [f64; 2],
) -> Isometry3<f64> {
    if grip.role == Role::Support {
        return grip.camera_from_tip;
    }
    let sign = if k == 0 { -0.5 } else { 0.5 };
    let shift = across.as_ref() * (sign * options.distance * open)
        + scene.table.normal.as_ref() * (options.lift * raised);
    Translation3::from(shift) * grip.camera_from_tip
}
