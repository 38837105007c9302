//! Grips and motions together: the best set whose motions are all feasible.
//!
//! ```text
//! sets, best first:  motion ─► speed limit ─► reach ─► withdraw       the first that passes every check is the plan
//! ```
//!
//! A set that is rejected is recorded with its reason, and the next best is tried.

use derive_setters::Setters;
use nalgebra::{Isometry3, UnitVector3, Vector3};

use crate::body::Body;
use crate::check::{Surroundings, laid_down};
use crate::grips::rank;
use crate::hole::Hole;
use crate::reach::{reach, withdraw};
use crate::scene::positive;
use crate::stretch::{beside, grips, pull};
use crate::turn_over::turn_in;
use crate::{
    Coverage, Error, Grip, GripSet, Model, Motion, Options, ReachOptions, Reason, Refusal,
    RefusedSet, Role, Scene, StretchOptions, Turn, TurnOptions, speed_limit,
};

/// What to do with the body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Action<'a> {
    /// Turn its hidden side up.
    TurnOver,
    /// Open a hole: a loop of vertices around the opening of a fold or pocket.
    Stretch {
        /// The loop.
        hole: &'a [u32],
    },
    /// Pull apart two parts that touch, such as fingers.
    Part {
        /// Vertices around the neck that joins them in the model.
        neck: &'a [u32],
        /// The direction from one of them to the other, such as that of the vector area of a loop around the neck; its sign does not matter.
        axis: UnitVector3<f64>,
    },
    /// Turn it over with a grip on each side of a hole, which is opened meanwhile.
    TurnAndStretch {
        /// The loop.
        hole: &'a [u32],
    },
}

/// Limits on the motion of the body for tracking.
#[derive(Debug, Clone, Copy, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Tracking {
    /// Largest motion of a node between two frames, `ξ`, metres. Default 0.005.
    pub xi: f64,
    /// Frames each second, `F`. Default 10.
    pub frame_rate: f64,
}

impl Default for Tracking {
    fn default() -> Self {
        Self {
            xi: 0.005,
            frame_rate: 10.0,
        }
    }
}

/// Settings of [`plan`].
#[derive(Debug, Clone, PartialEq, Default, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct PlanOptions {
    /// Options of the grips.
    pub grips: Options,
    /// Options of a turn.
    pub turn: TurnOptions,
    /// Options of a stretch, alone or during a turn.
    pub stretch: StretchOptions,
    /// Options of motions of empty arms.
    pub reach: ReachOptions,
    /// Limits on the speed.
    pub tracking: Tracking,
}

/// Grips, the motions before, during and after the grasp, and the sets that were rejected before.
#[derive(Debug, Clone)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Plan {
    /// The grips; the lifting ones first.
    pub grips: Vec<Grip>,
    /// The score by which the set was ranked, 0 to 1.
    pub score: f64,
    /// Null-space coverage of all grips, 0 to 1.
    pub coverage: f64,
    /// The share of each vertex's motion that the grips command, 0 to 1.
    pub coverage_map: Vec<f64>,
    /// The turn, if the body is turned.
    pub turn: Option<Turn>,
    /// The direction of the pull from the first to the second grip, if a hole is stretched or parts are pulled apart.
    pub across: Option<UnitVector3<f64>>,
    /// `v_max = ξ F / max ‖J_i v̂‖` over the whole motion, m/s; no tip is faster while it holds.
    pub speed_limit: f64,
    /// From home to the grasp, jaws open.
    pub reach: Motion,
    /// The motion while the jaws hold.
    pub motion: Motion,
    /// From the end of the motion home, jaws open.
    pub withdraw: Motion,
    /// Better sets that were rejected.
    pub refused: Vec<RefusedSet>,
    /// Vertices that were tested and cannot be gripped, with the reasons; empty if the set was given by the caller.
    pub rejected: Vec<(u32, Reason)>,
}

/// The best set of grips whose motions pass all checks. A set whose third arm is obstructed is also tried without it.
///
/// # Errors
/// Invalid input, no grips at all, a loop that is not a hole, or every set rejected (with the reasons).
///
/// # Complexity
/// That of [`crate::plan_grips`]; a set costs about a millisecond.
pub fn plan(
    model: &Model,
    scene: &Scene,
    action: Action,
    options: &PlanOptions,
) -> Result<Plan, Refusal> {
    let body = checked(model, scene, options)?;
    if scene.arms.len() < 2 {
        let count = scene.arms.len();
        return Err(Error::TooFewArms { count }.into());
    }
    let planner = Planner::new(model, scene, options, &body);
    match action {
        Action::TurnOver => planner.turn(None),
        Action::Stretch { hole } => planner.stretch(hole, &Hole::new(model, scene, hole)?),
        Action::Part { neck, axis } => {
            planner.stretch(neck, &Hole::neck(model, scene, neck, &axis)?)
        }
        Action::TurnAndStretch { hole } => planner.turn(Some(&Hole::new(model, scene, hole)?)),
    }
}

/// The plan for a given set of grips, for instance from [`GripSet::lifting`].
///
/// # Errors
/// Why it is not feasible.
pub fn plan_set(
    model: &Model,
    scene: &Scene,
    set: &GripSet,
    coverage: &Coverage,
    options: &PlanOptions,
) -> Result<Plan, Refusal> {
    let body = checked(model, scene, options)?;
    Planner::new(model, scene, options, &body).turn_with(set, coverage, None)
}

/// The body as an obstacle, once all of the input is known to be usable.
fn checked(model: &Model, scene: &Scene, options: &PlanOptions) -> Result<Body, Error> {
    model.check()?;
    scene.check()?;
    options.check()?;
    Ok(Body::new(model.points, scene.tool_radius()))
}

impl PlanOptions {
    fn check(&self) -> Result<(), Error> {
        self.grips.check()?;
        self.turn.check()?;
        self.stretch.check()?;
        self.reach.check()?;
        positive("xi", self.tracking.xi)?;
        positive("frame_rate", self.tracking.frame_rate)
    }
}

struct Planner<'a> {
    model: &'a Model<'a>,
    scene: &'a Scene<'a>,
    options: &'a PlanOptions,
    around: Surroundings<'a>,
}

/// A set that is tried.
struct Trial<'a> {
    grips: &'a [Grip],
    score: f64,
    coverage: &'a Coverage,
    turn: Option<Turn>,
    across: Option<UnitVector3<f64>>,
}

impl<'a> Planner<'a> {
    fn new(
        model: &'a Model<'a>,
        scene: &'a Scene<'a>,
        options: &'a PlanOptions,
        body: &'a Body,
    ) -> Self {
        Self {
            model,
            scene,
            options,
            around: Surroundings::new(scene, body),
        }
    }
}

impl Planner<'_> {
    fn turn(&self, hole: Option<&Hole>) -> Result<Plan, Refusal> {
        let ranked = rank(self.model, self.scene, &self.options.grips, hole)?;
        let rejected = ranked.candidates.rejected;
        let mut refused = Vec::new();
        for set in &ranked.sets {
            let supported = set.grips.iter().any(|g| g.role == Role::Support);
            let alone = supported.then(|| set.without_support());
            for set in std::iter::once(set).chain(&alone) {
                match self.turn_with(set, &ranked.coverage, hole) {
                    Ok(plan) => {
                        return Ok(Plan {
                            refused,
                            rejected,
                            ..plan
                        });
                    }
                    Err(reason) => refused.push(refusal(&set.grips, set.score, reason)?),
                }
            }
        }
        Err(Refusal::AllRefused { refused })
    }

    fn turn_with(
        &self,
        set: &GripSet,
        coverage: &Coverage,
        hole: Option<&Hole>,
    ) -> Result<Plan, Refusal> {
        let mut options = self.options.turn;
        if hole.is_some() {
            options.stretch = self.options.stretch.distance;
        }
        let trial = Trial {
            grips: &set.grips,
            score: set.score,
            coverage,
            turn: Some(set.turn),
            across: hole.map(|m| m.across),
        };
        let angle = options.end(&set.turn);
        let lies = |motion: &Motion| laid_down(motion, &set.turn.axis, angle);
        let go = |speed: f64| turn_in(&self.around, set, &TurnOptions { speed, ..options });
        self.complete(&trial, options.speed, &go, &lies)
    }

    fn stretch(&self, boundary: &[u32], hole: &Hole) -> Result<Plan, Refusal> {
        let (scene, options) = (self.scene, self.options);
        let beside = beside(
            self.model,
            scene,
            boundary,
            hole,
            &options.grips,
            &options.stretch,
        )?;
        let found = &beside.found.accepted;
        let vertices: Vec<u32> = found.iter().map(|c| c.vertex).collect();
        let coverage = Coverage::new(self.model, &scene.table, &vertices, &options.grips.coverage)?;
        let mut refused = Vec::new();
        for pair in &beside.pairs {
            let all = grips(pair, found, hole, scene, &options.grips);
            let score = pair.score(options.stretch.reach);
            let pinned = all.len() > 2;
            for count in std::iter::once(all.len()).chain(pinned.then_some(2)) {
                let trial = Trial {
                    grips: &all[..count],
                    score,
                    coverage: &coverage,
                    turn: None,
                    across: Some(hole.across),
                };
                match self.stretch_with(&trial, hole) {
                    Ok(plan) => {
                        let rejected = beside.found.rejected;
                        return Ok(Plan {
                            refused,
                            rejected,
                            ..plan
                        });
                    }
                    Err(reason) => refused.push(refusal(trial.grips, score, reason)?),
                }
            }
        }
        Err(Refusal::AllRefused { refused })
    }

    fn stretch_with(&self, trial: &Trial, hole: &Hole) -> Result<Plan, Refusal> {
        let options = self.options.stretch;
        let lies = |motion: &Motion| laid_down(motion, &self.scene.table.normal, 0.0);
        let go = |speed: f64| {
            let options = StretchOptions { speed, ..options };
            pull(&self.around, trial.grips, &hole.across, &options)
        };
        self.complete(trial, options.speed, &go, &lies)
    }

    /// Slows the motion down to what can be tracked, and adds the paths there and back.
    fn complete(
        &self,
        trial: &Trial,
        speed: f64,
        go: &dyn Fn(f64) -> Result<Motion, Refusal>,
        lies: &dyn Fn(&Motion) -> Isometry3<f64>,
    ) -> Result<Plan, Refusal> {
        let mut motion = go(speed)?;
        let limit = self.limit(trial, &motion)?;
        if motion.peak_speed() > limit {
            motion = go(limit)?;
        }
        let reach = reach(&self.around, trial.grips, &self.options.reach)?;
        let withdraw = withdraw(
            &self.around,
            trial.grips,
            &motion,
            &lies(&motion),
            &self.options.reach,
        )?;
        let vertices: Vec<u32> = trial.grips.iter().map(|g| g.vertex).collect();
        Ok(Plan {
            grips: trial.grips.to_vec(),
            score: trial.score,
            coverage: trial.coverage.score(&vertices)?,
            coverage_map: trial.coverage.map(&vertices)?,
            turn: trial.turn,
            across: trial.across,
            speed_limit: limit,
            reach,
            motion,
            withdraw,
            refused: Vec::new(),
            rejected: Vec::new(),
        })
    }

    /// The least speed limit of all steps of a motion; the directions do not depend on its speed.
    fn limit(&self, trial: &Trial, motion: &Motion) -> Result<f64, Error> {
        let Tracking { xi, frame_rate } = self.options.tracking;
        let frames = motion.arms.first().map_or(0, |p| p.keyframes.len());
        let mut least = f64::INFINITY;
        for k in 1..frames {
            let step = |(grip, path): (&Grip, &crate::ArmPath)| {
                let [from, to] = [k - 1, k].map(|k| &path.keyframes[k]);
                let moved =
                    to.camera_from_tip.translation.vector - from.camera_from_tip.translation.vector;
                // An arm that has released moves nothing.
                (to.time <= path.release).then_some((grip.vertex, moved))
            };
            let steps: Vec<(u32, Vector3<f64>)> = trial
                .grips
                .iter()
                .zip(&motion.arms)
                .filter_map(step)
                .collect();
            let longest = steps.iter().map(|s| s.1.norm()).fold(0.0, f64::max);
            if longest <= 0.0 {
                continue;
            }
            let unit: Vec<_> = steps.iter().map(|(v, d)| (*v, d / longest)).collect();
            let field = trial.coverage.field(&unit)?;
            least = least.min(speed_limit(&field, xi, frame_rate)?);
        }
        Ok(least)
    }
}

/// A rejection to record; invalid input ends the planning instead.
fn refusal(grips: &[Grip], score: f64, reason: Refusal) -> Result<RefusedSet, Error> {
    match reason {
        Refusal::Input(error) => Err(error),
        reason => Ok(RefusedSet {
            vertices: grips.iter().map(|g| g.vertex).collect(),
            arms: grips.iter().map(|g| g.arm).collect(),
            score,
            reason,
        }),
    }
}
