//! Chooses the best grips and action.
//!
//! Holes that the camera looks into come first: they are stretched open, during a turn if more than the holes is missing. Once everything is seen, parts that
//! touch are pulled apart. Then come the sets for turning over, best first. Exception: a long soft body turned about its shorter side stands upright on its end and buckles, so sets that do this come
//! after the others, unless the others score less than nine tenths of them.

use super::hole::{self, Hole};
use super::{NoPlan, PlanInput, Planner, arms, model, paced, refused_set, scene};
use crate::Error;
use grip_planner::{Action, GripSet, Model, Plan, PlanOptions, Ranked, Refusal, RefusedSet, Scene};
use nalgebra::UnitVector3;

/// Chooses the grips of best null-space coverage whose motion is feasible.
#[derive(Debug, Clone)]
pub struct CoveragePlanner {
    /// Settings of `grip-planner`; speeds and frame rate are taken from the loop and the cell.
    pub options: PlanOptions,
    /// Sets that would lift the body higher than this multiple of its length along the axis come last.
    pub upright: f64,
    /// Number of holes inside the outline that are tried for stretching, largest first; with 0 the body is only turned over. Default 3.
    pub holes: usize,
}

/// Sets that keep a body flat come first unless they score less than this share of the best one that does not.
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
        let holes = hole::seen_inside(input);
        let opened = holes.iter().take(self.holes).flat_map(actions);
        // Parts that touch are pulled apart once nothing else was left unseen: a turn may part them, too.
        let neck = input.topology.neck.as_slice();
        let touch = UnitVector3::try_new(input.neck_area, f64::MIN_POSITIVE)
            .filter(|_| input.topology.wholly_seen);
        let parted = touch.map(|axis| Action::Part { neck, axis });
        for action in opened.chain(parted) {
            match grip_planner::plan(&model, &scene, action, &options) {
                Ok(plan) => return Ok(Ok(Plan { refused, ..plan })),
                Err(Refusal::AllRefused { refused: more }) => refused.extend(more),
                // This hole cannot be opened; turning the body over may still be possible.
                Err(
                    Refusal::NoGrips { .. }
                    | Refusal::NotAHole { .. }
                    | Refusal::NotBeside
                    | Refusal::NoGripBesideHole { .. },
                ) => {}
                Err(refusal) => return Err(refusal.into()),
            }
        }
        self.turn_over(&model, &scene, &options, refused)
    }
}

/// Actions for a hole, best first.
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
        // Parts that only standing the body up can reveal must be shown in the end.
        let most = upright.iter().map(|s| s.score).fold(0.0, f64::max);
        let (flat, poor): (Vec<&GripSet>, Vec<&GripSet>) =
            flat.into_iter().partition(|s| s.score >= POOR * most);
        flat.into_iter().chain(upright).chain(poor)
    }
}
