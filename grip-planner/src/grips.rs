//! Algorithm 2: sets of grips, best first.
//!
//! ```text
//! score(g) = (NSC(g) / max NSC)^(1−ω) · (suitability(g) · gain)^ω
//! ```
//!
//! over all pairs of candidates and all four turns, `ω` = [`Options::turning_weight`]. Coverage alone (`ω = 0`) would like to hold a body by two
//! opposite corners, and nobody can turn it over like that; suitability alone forgets what the grips are to
//! move. A geometric mean lets neither be zero. Sets without any suitability are left out whatever `ω` is.
//!
//! A grip that is not on the boundary of the explored part counts less ([`Options::outline_weight`]). A third arm holds the body near the pivot, at the vertex with the best coverage of all three.

use nalgebra::{Isometry3, Point3, Translation3};

use crate::assign::{assign, cross};
use crate::candidates::backed_off;
use crate::options::Support;
use crate::turn::{Turn, turns};
use crate::{Candidate, Candidates, Coverage, Error, Model, Options, Scene, candidates};

/// What a grip is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// It lifts.
    Lift,
    /// It holds the body near the pivot for the first part of the lift.
    Support,
}

/// One arm at one vertex.
#[derive(Debug, Clone, PartialEq)]
pub struct Grip {
    /// The arm.
    pub arm: usize,
    /// The vertex.
    pub vertex: u32,
    /// What the grip is for.
    pub role: Role,
    /// Where the tip closes its jaws.
    pub camera_from_tip: Isometry3<f64>,
    /// Where the straight last part of the way begins: back along the tool.
    pub camera_from_approach: Isometry3<f64>,
    /// Where the tip goes when the grip is given up here: back along the tool and up.
    pub camera_from_retreat: Isometry3<f64>,
}

impl Grip {
    /// The way from a pose to the grip: turn in place, go to the approach pose, go straight in.
    pub fn reach(&self, camera_from_start: &Isometry3<f64>) -> [Isometry3<f64>; 3] {
        let turned =
            Isometry3::from_parts(camera_from_start.translation, self.camera_from_tip.rotation);
        [turned, self.camera_from_approach, self.camera_from_tip]
    }

    /// Where the tip is in the grasp pose.
    pub fn tip(&self) -> Point3<f64> {
        Point3::from(self.camera_from_tip.translation.vector)
    }
}

/// Grips that together turn the body.
#[derive(Debug, Clone, PartialEq)]
pub struct GripSet {
    /// The two lifting grips, then the supporting one if there is one.
    pub grips: Vec<Grip>,
    /// Null-space coverage of all of them, 0 to 1.
    pub coverage: f64,
    /// Null-space coverage of the lifting grips alone, 0 to 1.
    pub lifting_coverage: f64,
    /// How well the lifting grips turn, 0 to 1.
    pub suitability: f64,
    /// What the sets are ranked by, 0 to 1.
    pub score: f64,
    /// The turn they are meant for.
    pub turn: Turn,
}

impl GripSet {
    /// The same set without its supporting grip.
    #[must_use]
    pub fn without_support(&self) -> Self {
        let mut set = self.clone();
        set.grips.retain(|g| g.role == Role::Lift);
        set.coverage = set.lifting_coverage;
        set
    }
}

/// Sets of grips for turning the body over, best first, different from one another.
///
/// # Errors
/// A model, scene or setting that is not usable; fewer than two arms; no two candidates that can lift a side.
///
/// # Complexity
/// `m` candidates: one factorisation, `m` solves, `4·m²/2` pair scores.
pub fn plan_grips(model: &Model, scene: &Scene, options: &Options) -> Result<Vec<GripSet>, Error> {
    if scene.arms.len() < 2 {
        return Err(Error::TooFewArms {
            count: scene.arms.len(),
        });
    }
    let found = candidates(model, scene, options)?;
    rank(model, scene, options, &found)
}

/// The sets that can be made of given candidates.
pub(crate) fn rank(
    model: &Model,
    scene: &Scene,
    options: &Options,
    found: &Candidates,
) -> Result<Vec<GripSet>, Error> {
    let vertices: Vec<u32> = found.accepted.iter().map(|c| c.vertex).collect();
    let none = Error::NoGrips {
        accepted: vertices.len(),
    };
    if vertices.len() < 2 {
        return Err(none);
    }
    let coverage = Coverage::new(model, &scene.table, &vertices, &options.coverage)?;
    let turns = turns(model, scene)?;
    let ranking = Ranking {
        scene,
        options,
        found: &found.accepted,
        coverage: &coverage,
        turns: &turns,
    };
    let sets = ranking.choose(ranking.pairs());
    if sets.is_empty() { Err(none) } else { Ok(sets) }
}

struct Pair {
    grips: [usize; 2],
    turn: usize,
    suitability: f64,
    score: f64,
}

struct Ranking<'a> {
    scene: &'a Scene<'a>,
    options: &'a Options,
    found: &'a [Candidate],
    coverage: &'a Coverage,
    turns: &'a [Turn],
}

impl Ranking<'_> {
    /// All pairs with all turns they suit, best first.
    fn pairs(&self) -> Vec<Pair> {
        let mut pairs = Vec::new();
        let mut covered = Vec::new();
        for i in 0..self.found.len() {
            for j in i + 1..self.found.len() {
                let (a, b) = (&self.found[i].point, &self.found[j].point);
                if (a - b).norm() < self.scene.jaw_separation {
                    continue;
                }
                for turn in self.wanted_turns() {
                    let suitability = self.turns[turn].suitability([a, b], self.options.spread);
                    if suitability > 0.0 {
                        covered.push(self.coverage.score_pair(i, j));
                        pairs.push(Pair {
                            grips: [i, j],
                            turn,
                            suitability,
                            score: 0.0,
                        });
                    }
                }
            }
        }
        let most = covered.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
        let weight = self.options.turning_weight;
        for (pair, c) in pairs.iter_mut().zip(covered) {
            pair.score = (c / most).powf(1.0 - weight)
                * (pair.suitability * self.turns[pair.turn].gain).powf(weight)
                * self.source_weight(pair);
        }
        pairs.sort_by(|a, b| {
            b.score
                .total_cmp(&a.score)
                .then(a.turn.cmp(&b.turn))
                .then(a.grips.cmp(&b.grips))
        });
        pairs
    }

    /// What is left of the score for grips beside the boundary.
    fn source_weight(&self, pair: &Pair) -> f64 {
        let weight = |g: &usize| {
            if self.found[*g].boundary {
                1.0
            } else {
                self.options.outline_weight
            }
        };
        pair.grips.iter().map(weight).product()
    }

    /// The turns that lift the wanted side; all when none is wanted.
    fn wanted_turns(&self) -> impl Iterator<Item = usize> + '_ {
        let best = self.options.lift.map(|l| {
            self.turns
                .iter()
                .map(|t| t.lifted.dot(&l))
                .fold(f64::NEG_INFINITY, f64::max)
        });
        (0..self.turns.len()).filter(move |&t| match (self.options.lift, best) {
            (Some(l), Some(best)) => self.turns[t].lifted.dot(&l) >= best - 1e-9,
            _ => true,
        })
    }

    /// The best pairs that an arm pair can take and that are not near copies of better ones: a motion
    /// that is refused for one is refused for its neighbour too.
    fn choose(&self, pairs: Vec<Pair>) -> Vec<GripSet> {
        let mut chosen: Vec<Pair> = Vec::new();
        let mut sets = Vec::new();
        for pair in pairs {
            if sets.len() >= self.options.max_sets {
                break;
            }
            if chosen.iter().any(|c| self.near_copy(c, &pair)) {
                continue;
            }
            let grips = pair.grips.map(|g| &self.found[g]);
            let start = grips.map(|c| c.tip);
            let end = start.map(|p| self.turns[pair.turn].mirrored(&p));
            let Some(arms) = assign(self.scene, grips, &[start, end]) else {
                continue;
            };
            sets.push(self.set(&pair, arms));
            chosen.push(pair);
        }
        sets
    }

    fn near_copy(&self, a: &Pair, b: &Pair) -> bool {
        let near = |i: usize, j: usize| {
            (self.found[i].point - self.found[j].point).norm() < self.scene.jaw_separation
        };
        let [p, q] = a.grips;
        let [r, s] = b.grips;
        a.turn == b.turn && ((near(p, r) && near(q, s)) || (near(p, s) && near(q, r)))
    }

    fn set(&self, pair: &Pair, arms: [usize; 2]) -> GripSet {
        let turn = self.turns[pair.turn];
        let mut grips: Vec<Grip> = (0..2)
            .map(|k| self.grip(arms[k], pair.grips[k], Role::Lift))
            .collect();
        let lifting_coverage = self.coverage.score_pair(pair.grips[0], pair.grips[1]);
        let mut coverage = lifting_coverage;
        if self.options.support == Support::Hold
            && let Some(third) = self.support(pair, arms, &turn)
        {
            grips.push(third.grip);
            coverage = third.coverage;
        }
        GripSet {
            grips,
            coverage,
            lifting_coverage,
            suitability: pair.suitability,
            score: pair.score,
            turn,
        }
    }

    /// The candidate near the pivot with the best coverage together with the pair.
    fn support(&self, pair: &Pair, arms: [usize; 2], turn: &Turn) -> Option<Third> {
        let mut best: Option<(f64, usize, usize)> = None;
        for (k, c) in self.found.iter().enumerate() {
            let at = turn.local(&c.point);
            let far = pair
                .grips
                .iter()
                .all(|&g| (self.found[g].point - c.point).norm() >= self.scene.jaw_separation);
            if at.y > 0.25 * turn.span || at.x.abs() > 0.4 * turn.length || !far {
                continue;
            }
            let crosses = |arm: usize, g: usize| {
                let lifting = [
                    &self.scene.arms[arms[g]].base,
                    &self.found[pair.grips[g]].tip,
                ];
                cross(self.scene, [&self.scene.arms[arm].base, &c.tip], lifting)
            };
            // From the lifted side it would have to reach across the body, and back while that is in the air.
            let behind = |arm: usize| turn.local(&self.scene.arms[arm].base).y < 0.5 * turn.span;
            let free = |arm: &usize| {
                !arms.contains(arm) && behind(*arm) && (0..2).all(|g| !crosses(*arm, g))
            };
            let Some(&arm) = c.arms.iter().find(|arm| free(arm)) else {
                continue;
            };
            let vertices = [pair.grips[0], pair.grips[1], k].map(|g| self.found[g].vertex);
            let Ok(coverage) = self.coverage.score(&vertices) else {
                continue;
            };
            if best.is_none_or(|(most, ..)| coverage > most) {
                best = Some((coverage, arm, k));
            }
        }
        best.map(|(coverage, arm, k)| Third {
            grip: self.grip(arm, k, Role::Support),
            coverage,
        })
    }

    fn grip(&self, arm: usize, candidate: usize, role: Role) -> Grip {
        grip(arm, &self.found[candidate], role, self.scene, self.options)
    }
}

struct Third {
    grip: Grip,
    coverage: f64,
}

/// The grip of an arm at a candidate. Both signs of the roll are the same grip; the one nearer to the arm's home is taken.
pub(crate) fn grip(
    arm: usize,
    candidate: &Candidate,
    role: Role,
    scene: &Scene,
    options: &Options,
) -> Grip {
    let straight = candidate.camera_from_tip();
    let flipped = straight
        * nalgebra::UnitQuaternion::from_axis_angle(
            &nalgebra::Vector3::z_axis(),
            std::f64::consts::PI,
        );
    let home = &scene.arms[arm].home.rotation;
    let camera_from_tip = if home.angle_to(&flipped.rotation) < home.angle_to(&straight.rotation) {
        flipped
    } else {
        straight
    };
    let camera_from_approach = backed_off(&camera_from_tip, options.approach_distance);
    Grip {
        arm,
        vertex: candidate.vertex,
        role,
        camera_from_tip,
        camera_from_approach,
        camera_from_retreat: retreat(&camera_from_tip, scene, options.approach_distance),
    }
}

/// Back along the tool, and half as far up.
pub(crate) fn retreat(
    camera_from_tip: &Isometry3<f64>,
    scene: &Scene,
    distance: f64,
) -> Isometry3<f64> {
    let up = Translation3::from(scene.table.normal.as_ref() * (0.5 * distance));
    up * backed_off(camera_from_tip, distance)
}
