//! Grips and motion together: the best set whose motion can be done.

use crate::grips::plan_grips;
use crate::{Error, GripSet, Model, Motion, Options, Refusal, Role, Scene, TurnOptions, turn_over};

/// Settings of [`plan`].
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PlanOptions {
    /// Which grips.
    pub grips: Options,
    /// How to turn.
    pub turn: TurnOptions,
}

/// A set of grips whose motion was refused.
#[derive(Debug, Clone)]
pub struct RefusedSet {
    /// The vertices of its grips.
    pub vertices: Vec<u32>,
    /// Their arms.
    pub arms: Vec<usize>,
    /// Its score.
    pub score: f64,
    /// Why.
    pub reason: Refusal,
}

impl RefusedSet {
    fn new(set: &GripSet, reason: Refusal) -> Self {
        Self {
            vertices: set.grips.iter().map(|g| g.vertex).collect(),
            arms: set.grips.iter().map(|g| g.arm).collect(),
            score: set.score,
            reason,
        }
    }
}

/// Grips, the motion that turns the body with them, and what was refused before.
#[derive(Debug, Clone)]
pub struct Plan {
    /// The grips.
    pub grips: GripSet,
    /// What the arms do once they hold.
    pub motion: Motion,
    /// Better sets whose motion was refused.
    pub refused: Vec<RefusedSet>,
}

/// The best set of grips whose motion passes all checks. A set whose supporting arm is in the way is tried without it.
///
/// # Errors
/// Input that is not usable, no grips at all, or every motion refused (with the reasons).
///
/// # Complexity
/// That of [`plan_grips`]; a motion and its checks cost some tens of microseconds.
pub fn plan(model: &Model, scene: &Scene, options: &PlanOptions) -> Result<Plan, Error> {
    let mut refused = Vec::new();
    for set in plan_grips(model, scene, &options.grips)? {
        let supported = set.grips.iter().any(|g| g.role == Role::Support);
        let alone = supported.then(|| set.without_support());
        for set in std::iter::once(set).chain(alone) {
            match turn_over(model, scene, &set, &options.turn) {
                Ok(motion) => {
                    return Ok(Plan {
                        grips: set,
                        motion,
                        refused,
                    });
                }
                Err(Refusal::Input(error)) => return Err(error),
                Err(reason) => refused.push(RefusedSet::new(&set, reason)),
            }
        }
    }
    Err(Error::AllRefused { refused })
}
