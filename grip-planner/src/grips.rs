//! Ranked sets of grips (paper, Algorithm 2).
//!
//! ```text
//! score(g) = (NSC(g) / max NSC)^(1−ω) · (suitability(g) · gain)^ω
//! ```
//!
//! over all pairs of candidates and all turns, `ω` = [`Options::turning_weight`]. Coverage alone (`ω = 0`) prefers to hold a body by two
//! opposite corners, by which it cannot be turned over; suitability alone ignores what the grips should
//! move. A geometric mean lets neither be zero. Sets with zero suitability are excluded for any `ω`.
//!
//! A grip that is not on the boundary of the explored part has a lower score ([`Options::outline_weight`]). A third arm holds the body near the pivot, at the vertex with the best coverage of all three.

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};

use crate::assign::{assign, cross};
use crate::hole::Hole;
use crate::options::Support;
use crate::orientation::{backed_off, retreat};
use crate::turn::{Turn, turns};
use crate::{Candidate, Candidates, Coverage, Error, Model, Options, Refusal, Scene, candidates};

/// The purpose of a grip.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Role {
    /// It lifts.
    Lift,
    /// It holds the body down: near the pivot for the first part of a lift, or outside of the pulled part during a whole stretch.
    Support,
}

impl std::fmt::Display for Role {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Lift => "lifting",
            Self::Support => "supporting",
        })
    }
}

/// One arm at one vertex.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Grip {
    /// The arm.
    pub arm: usize,
    /// The vertex.
    pub vertex: u32,
    /// The purpose of the grip.
    pub role: Role,
    /// Pose of the tip when the jaws close.
    pub camera_from_tip: Isometry3<f64>,
    /// Start of the straight last part of the approach, back along the tool.
    pub camera_from_approach: Isometry3<f64>,
    /// Pose to which the tip retreats if the grip is given up here: back along the tool and up.
    pub camera_from_retreat: Isometry3<f64>,
}

impl Grip {
    /// The path from a pose to the grip: rotate in place, move to the approach pose, then straight in.
    pub fn reach(&self, camera_from_start: &Isometry3<f64>) -> [Isometry3<f64>; 3] {
        let turned =
            Isometry3::from_parts(camera_from_start.translation, self.camera_from_tip.rotation);
        [turned, self.camera_from_approach, self.camera_from_tip]
    }

    /// Position of the tip in the grasp pose.
    pub fn tip(&self) -> Point3<f64> {
        Point3::from(self.camera_from_tip.translation.vector)
    }
}

/// Grips that together turn the body.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct GripSet {
    /// The two lifting grips, then the supporting one if there is one.
    pub grips: Vec<Grip>,
    /// Null-space coverage of all of them, 0 to 1.
    pub coverage: f64,
    /// Null-space coverage of the lifting grips only, 0 to 1.
    pub lifting_coverage: f64,
    /// Suitability of the lifting grips for turning, 0 to 1.
    pub suitability: f64,
    /// The score by which sets are ranked, 0 to 1.
    pub score: f64,
    /// The turn that they are planned for.
    pub turn: Turn,
}

impl GripSet {
    /// The set that lifts with two given candidates; the arms are assigned by the shortest lines that do not cross.
    ///
    /// # Errors
    /// [`Refusal::ArmsCross`] if no two arms reach them without crossing; a candidate that is not in `coverage`.
    pub fn lifting(
        scene: &Scene,
        options: &Options,
        coverage: &Coverage,
        candidates: [&Candidate; 2],
        turn: &Turn,
    ) -> Result<Self, Refusal> {
        let vertices = candidates.map(|c| c.vertex);
        let start = candidates.map(|c| c.tip);
        let end = start.map(|p| turn.mirrored(&p));
        let arms =
            assign(scene, candidates, &[start, end]).ok_or(Refusal::ArmsCross { vertices })?;
        let lifting_coverage = coverage.score(&vertices)?;
        let suitability = turn.suitability(candidates.map(|c| &c.point), options.spread);
        let grip = |k: usize| Grip::new(arms[k], candidates[k], Role::Lift, scene, options);
        Ok(Self {
            grips: vec![grip(0), grip(1)],
            coverage: lifting_coverage,
            lifting_coverage,
            suitability,
            score: suitability * turn.gain,
            turn: *turn,
        })
    }

    /// The same set with a third arm that holds the body at a candidate near the pivot.
    ///
    /// # Errors
    /// [`Refusal::CannotSupport`] if the candidate is not near the pivot, too near a lifting grip, or no free arm reaches it
    /// without crossing; a candidate that is not in `coverage`.
    pub fn supported(
        &self,
        scene: &Scene,
        options: &Options,
        coverage: &Coverage,
        candidate: &Candidate,
    ) -> Result<Self, Refusal> {
        let mut set = self.without_support();
        let arm = set
            .supporting_arm(scene, candidate)
            .ok_or(Refusal::CannotSupport {
                vertex: candidate.vertex,
            })?;
        let grip = Grip::new(arm, candidate, Role::Support, scene, options);
        set.grips.push(grip);
        set.coverage = coverage.score(&set.vertices())?;
        Ok(set)
    }

    /// The same set without its supporting grip.
    #[must_use]
    pub fn without_support(&self) -> Self {
        let mut set = self.clone();
        set.grips.retain(|g| g.role == Role::Lift);
        set.coverage = set.lifting_coverage;
        set
    }

    /// The vertices of the grips.
    pub fn vertices(&self) -> Vec<u32> {
        self.grips.iter().map(|g| g.vertex).collect()
    }

    /// The first arm that can hold the candidate near the pivot while the others lift.
    fn supporting_arm(&self, scene: &Scene, candidate: &Candidate) -> Option<usize> {
        let at = self.turn.local(&candidate.point);
        let apart = |g: &Grip| {
            g.vertex != candidate.vertex && (g.tip() - candidate.tip).norm() >= scene.jaw_separation
        };
        let near_pivot = at.y <= 0.25 * self.turn.span && at.x.abs() <= 0.4 * self.turn.length;
        if !near_pivot || !self.grips.iter().all(apart) {
            return None;
        }
        let crosses = |arm: usize, g: &Grip| {
            let lifting = [&scene.arms[g.arm].base, &g.tip()];
            cross(scene, [&scene.arms[arm].base, &candidate.tip], lifting)
        };
        // From the lifted side it would have to reach across the body, and retreat while the body is lifted.
        let behind = |arm: usize| self.turn.local(&scene.arms[arm].base).y < 0.5 * self.turn.span;
        let free =
            |arm: usize| self.grips.iter().all(|g| g.arm != arm && !crosses(arm, g)) && behind(arm);
        candidate.arms.iter().copied().find(|&arm| free(arm))
    }
}

/// Sets of grips, and the data from which they were chosen.
#[derive(Debug, Clone)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Ranked {
    /// Sets for turning the body over, best first, different from one another.
    pub sets: Vec<GripSet>,
    /// The candidates, and why other vertices are not.
    pub candidates: Candidates,
    /// The covariance of the candidates: scores, fields and maps of any set of them.
    pub coverage: Coverage,
}

/// Sets of grips for turning the body over, best first, different from one another.
///
/// # Errors
/// An invalid model, scene or setting; fewer than two arms; no two candidates that can lift a side.
///
/// # Complexity
/// `m` candidates: one factorisation, `m` solves, `4·m²/2` pair scores.
///
/// With the cushion and the two arms of the [crate's example](crate):
///
/// ```
/// use grip_planner::{Options, plan_grips};
/// # use grip_planner::nalgebra::{Isometry3, Point3, UnitVector3, Vector3};
/// # use grip_planner::{Arm, Model, Plane, Scene, Workspace};
/// # let up = -Vector3::z_axis();
/// # let (mut points, mut normals, mut boundary) = (vec![], vec![], vec![]);
/// # for (i, j) in (0..21).flat_map(|i| (0..13).map(move |j| (i, j))) {
/// #     let (x, y) = (0.01 * f64::from(i - 10), 0.01 * f64::from(j - 6));
/// #     let on_boundary = i == 0 || i == 20 || j == 0 || j == 12;
/// #     points.push(Point3::new(x, y, if on_boundary { 0.485 } else { 0.47 }));
/// #     let out = UnitVector3::new_normalize(Vector3::new(x / 0.1, y / 0.06, -0.3));
/// #     normals.push(if on_boundary { out } else { up });
/// #     boundary.push(on_boundary);
/// # }
/// # let near = |a: &Point3<f64>, b: &Point3<f64>| (a.xy() - b.xy()).norm() < 0.015;
/// # let edges: Vec<[u32; 2]> = (0..points.len())
/// #     .flat_map(|a| (0..a).map(move |b| [b, a]))
/// #     .filter(|&[a, b]| near(&points[a], &points[b]))
/// #     .map(|e| e.map(|v| v as u32))
/// #     .collect();
/// # let model = Model {
/// #     points: &points,
/// #     normals: &normals,
/// #     areas: &vec![1e-4; points.len()],
/// #     edges: &edges,
/// #     boundary: &boundary,
/// #     visible: &vec![true; points.len()],
/// #     hidden: &[],
/// # };
/// # let arms = [-0.3, 0.3].map(|x| {
/// #     let base = Point3::new(x, 0.0, 0.25);
/// #     Arm {
/// #         base,
/// #         workspace: Workspace::Ball { center: base, radius: 0.6 },
/// #         home: Isometry3::translation(x, 0.0, 0.3),
/// #         max_speed: 0.1,
/// #     }
/// # });
/// # let scene = Scene {
/// #     table: Plane { normal: up, offset: 0.5 },
/// #     arms: &arms,
/// #     camera: Point3::origin(),
/// #     jaw_radius: 0.005,
/// #     shaft_length: 0.05,
/// #     jaw_separation: 0.02,
/// #     clearance: 0.003,
/// # };
/// let ranked = plan_grips(&model, &scene, &Options::default())?;
/// assert!(ranked.sets.windows(2).all(|pair| pair[0].score >= pair[1].score));
/// // Two arms hold the half away from the pivot.
/// let best = &ranked.sets[0];
/// assert_ne!(best.grips[0].arm, best.grips[1].arm);
/// for vertex in best.vertices() {
///     let along = best.turn.local(&points[vertex as usize]).y;
///     assert!(along > 0.5 * best.turn.span);
/// }
/// # Ok::<(), grip_planner::Refusal>(())
/// ```
pub fn plan_grips(model: &Model, scene: &Scene, options: &Options) -> Result<Ranked, Refusal> {
    rank(model, scene, options, None)
}

/// The same, for opening a hole during the turn: only sets with grips on both sides of `hole`.
pub(crate) fn rank(
    model: &Model,
    scene: &Scene,
    options: &Options,
    hole: Option<&Hole>,
) -> Result<Ranked, Refusal> {
    if scene.arms.len() < 2 {
        let count = scene.arms.len();
        return Err(Error::TooFewArms { count }.into());
    }
    let candidates = candidates(model, scene, options)?;
    let none = |candidates: Candidates| Refusal::NoGrips {
        accepted: candidates.accepted.len(),
        rejected: candidates.rejected,
    };
    if candidates.accepted.len() < 2 {
        return Err(none(candidates));
    }
    let vertices: Vec<u32> = candidates.accepted.iter().map(|c| c.vertex).collect();
    let coverage = Coverage::new(model, &scene.table, &vertices, &options.coverage)?;
    let turns = turns(model, scene, options.tilt)?;
    let ranking = Ranking {
        scene,
        options,
        found: &candidates.accepted,
        coverage: &coverage,
        turns: &turns,
        hole,
    };
    let sets = ranking.choose(&ranking.pairs());
    if sets.is_empty() {
        return Err(none(candidates));
    }
    Ok(Ranked {
        sets,
        candidates,
        coverage,
    })
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
    hole: Option<&'a Hole>,
}

impl Ranking<'_> {
    /// All pairs with all turns for which they are suitable, best first.
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
                    let suitability = self.turns[turn].suitability([a, b], self.options.spread)
                        * self
                            .hole
                            .map_or(1.0, |m| m.opened_by([a, b], &self.turns[turn].axis));
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

    /// Factor on the score for grips that are not on the boundary.
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

    /// The turns that lift the requested side, or all if none is requested.
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

    /// The best pairs for which there are arms and that are not near-duplicates of better ones: a motion
    /// that is rejected for one would be rejected for its neighbour too.
    fn choose(&self, pairs: &[Pair]) -> Vec<GripSet> {
        let mut chosen: Vec<&Pair> = Vec::new();
        let mut sets = Vec::new();
        for pair in pairs {
            if sets.len() >= self.options.max_sets {
                break;
            }
            if chosen.iter().any(|c| self.near_copy(c, pair)) {
                continue;
            }
            let grips = pair.grips.map(|g| &self.found[g]);
            let turn = &self.turns[pair.turn];
            let set = GripSet::lifting(self.scene, self.options, self.coverage, grips, turn);
            let Ok(set) = set else {
                continue;
            };
            let (suitability, score) = (pair.suitability, pair.score);
            sets.push(GripSet {
                suitability,
                score,
                ..self.with_support(set)
            });
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

    /// Adds a third arm at the candidate that has the best coverage together with the pair, if there is one.
    fn with_support(&self, set: GripSet) -> GripSet {
        if self.options.support == Support::None {
            return set;
        }
        let supported = self.found.iter().filter_map(|c| {
            set.supported(self.scene, self.options, self.coverage, c)
                .ok()
        });
        // The first of equal ones.
        let best = supported.reduce(|a, b| if b.coverage > a.coverage { b } else { a });
        best.unwrap_or(set)
    }
}

impl Grip {
    /// The grip of an arm at a candidate. Both signs of the roll are the same grip; the one nearer to the arm's home is used.
    pub(crate) fn new(
        arm: usize,
        candidate: &Candidate,
        role: Role,
        scene: &Scene,
        options: &Options,
    ) -> Self {
        let straight = candidate.camera_from_tip();
        let half_turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI);
        let flipped = straight * half_turn;
        let home = &scene.arms[arm].home.rotation;
        let nearer = home.angle_to(&flipped.rotation) < home.angle_to(&straight.rotation);
        let camera_from_tip = if nearer { flipped } else { straight };
        Self {
            arm,
            vertex: candidate.vertex,
            role,
            camera_from_tip,
            camera_from_approach: backed_off(&camera_from_tip, options.approach_distance),
            camera_from_retreat: retreat(&camera_from_tip, scene, options.approach_distance),
        }
    }
}
