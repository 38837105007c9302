//! The best grips for what is to be done.
//!
//! Holes that the camera looks into come first: they are opened, during a turn when more than they is missing. Then the sets for turning over,
//! best first, with one exception: turned about its shorter side a long soft body stands upright on its end and buckles, so sets that
//! do that come after those that do not, unless the latter are worth less than nine tenths of them.

use super::hole::{self, Hole};
use super::{NoPlan, PlanInput, Planner, arms, model, paced, refused_set, scene};
use crate::Error;
use grip_planner::{Action, GripSet, Model, Plan, PlanOptions, Ranked, Refusal, RefusedSet, Scene};

/// Best null-space coverage whose motion can be done.
#[derive(Debug, Clone)]
pub struct CoveragePlanner {
    /// Settings of `grip-planner`; speeds and frame rate are those of the loop and the cell.
    pub options: PlanOptions,
    /// Sets that would lift the body over more than this times its length along the axis come last.
    pub upright: f64,
    /// Holes inside the outline that are tried for stretching, largest first; with 0 the body is only turned over. Default 3.
    pub holes: usize,
}

/// Sets that keep a body flat come first unless they are worth less than this share of the best one that does not.
const POOR: f64 = 0.9;

impl Default for CoveragePlanner {
    fn default() -> Self {
        Self {
            options: PlanOptions::default(),
            upright: 1.1,
            holes: 3,
        }
    }
}

impl Planner for CoveragePlanner {
    fn plan(&mut self, input: &PlanInput<'_>) -> Result<Result<Plan, NoPlan>, Error> {
        let arms = arms(input.cell);
        let (model, scene) = (model(input), scene(input.cell, &arms, &input.camera));
        let options = paced(&self.options, input);
        let mut refused = Vec::new();
        for hole in hole::seen_inside(input).iter().take(self.holes) {
            for action in actions(hole) {
                match grip_planner::plan(&model, &scene, action, &options) {
                    Ok(plan) => return Ok(Ok(Plan { refused, ..plan })),
                    Err(Refusal::AllRefused { refused: more }) => refused.extend(more),
                    // This hole cannot be opened; the body may be turned over all the same.
                    Err(
                        Refusal::NoGrips { .. }
                        | Refusal::NotAHole { .. }
                        | Refusal::NoGripBesideHole { .. },
                    ) => {}
                    Err(refusal) => return Err(refusal.into()),
                }
            }
        }
        self.turn_over(&model, &scene, &options, refused)
    }
}

/// What can be done about a hole, best first.
fn actions(hole: &Hole) -> Vec<Action<'_>> {
    let stretch = Action::Stretch { hole: &hole.rim };
    if hole.alone {
        vec![stretch]
    } else {
        vec![Action::TurnAndStretch { hole: &hole.rim }, stretch]
    }
}

impl CoveragePlanner {
    fn turn_over(
        &self,
        model: &Model<'_>,
        scene: &Scene<'_>,
        options: &PlanOptions,
        mut refused: Vec<RefusedSet>,
    ) -> Result<Result<Plan, NoPlan>, Error> {
        let Ranked {
            sets,
            candidates,
            coverage,
        } = match grip_planner::plan_grips(model, scene, &options.grips) {
            Ok(ranked) => ranked,
            Err(Refusal::NoGrips { accepted, rejected }) => {
                return Ok(Err(NoPlan::NoGrips { accepted, rejected }));
            }
            Err(refusal) => return Err(refusal.into()),
        };
        for set in self.in_order(&sets) {
            for set in [set.clone(), set.without_support()] {
                match grip_planner::plan_set(model, scene, &set, &coverage, options) {
                    Ok(plan) => {
                        let rejected = candidates.rejected;
                        return Ok(Ok(Plan {
                            refused,
                            rejected,
                            ..plan
                        }));
                    }
                    Err(Refusal::Input(error)) => return Err(error.into()),
                    Err(reason) => refused.push(refused_set(&set, reason)),
                }
            }
        }
        Ok(Err(NoPlan::AllRefused { refused }))
    }

    fn in_order<'s>(&self, sets: &'s [GripSet]) -> impl Iterator<Item = &'s GripSet> {
        let flat = |set: &&GripSet| set.turn.span <= self.upright * set.turn.length;
        let (flat, upright): (Vec<&GripSet>, Vec<&GripSet>) = sets.iter().partition(flat);
        // What only standing it up can show must be shown at last.
        let most = upright.iter().map(|s| s.score).fold(0.0, f64::max);
        let (flat, poor): (Vec<&GripSet>, Vec<&GripSet>) =
            flat.into_iter().partition(|s| s.score >= POOR * most);
        flat.into_iter().chain(upright).chain(poor)
    }
}
