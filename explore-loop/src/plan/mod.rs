//! Plans a manipulation: from the model and its topology to a [`Plan`] of `grip-planner`.
//!
//! ```text
//! model, topology ─► holes inside the outline? ─┬─ none ───► all seen, and parts touch? ─► pull them apart; else turn over
//!                                               ├─ nothing else missing ─► stretch
//!                                               └─ both ───► turn over and stretch; else stretch; else turn over
//! ```
//!
//! [`Planner`] is the trait; [`CoveragePlanner`] takes the set with the best null-space coverage whose motions are all feasible;
//! [`RandomPlanner`], the paper's baseline, draws feasible grips at random on the boundary and moves them in the same way.
//!
//! | file | question |
//! |---|---|
//! | `coverage` | which action with which grips is best? |
//! | `hole` | which loops are holes that the camera looks into? |
//! | `random` | the baseline without grip planning |

use crate::Error;
use crate::canonical::topology::Topology;
use crate::cell::{ArmInfo, CellInfo};
use crate::explore::Limits;
use grip_planner::{
    Arm, GripSet, Model, Plan, PlanOptions, ReachOptions, Reason, Refusal, RefusedSet, Scene,
    Workspace,
};
use nalgebra::{Isometry3, Point3, UnitVector3, Vector3};
use std::sync::Arc;

mod coverage;
mod hole;
mod random;

pub use coverage::CoveragePlanner;
pub use random::RandomPlanner;

/// The input of a planner.
#[derive(Debug, Clone, Copy)]
pub struct PlanInput<'a> {
    /// Live points of the model, camera frame.
    pub points: &'a [Point3<f64>],
    /// Their outward normals.
    pub normals: &'a [UnitVector3<f64>],
    /// Area of each vertex, m².
    pub areas: &'a [f64],
    /// The surface graph.
    pub edges: &'a [[u32; 2]],
    /// Boundary and loops.
    pub topology: &'a Topology,
    /// Which points the camera sees now.
    pub visible: &'a [bool],
    /// Vector areas of the surface that was never seen, in the present orientation, m².
    pub hidden: &'a [Vector3<f64>],
    /// Vector area of the loop [`Topology::neck`] in the present orientation, m²; 0 without one.
    pub neck_area: Vector3<f64>,
    /// Pose of the camera: the identity if it does not move.
    pub camera: Isometry3<f64>,
    /// The arms and the table.
    pub cell: &'a CellInfo,
    /// Speed limits of the arms.
    pub limits: Limits,
    /// Number of manipulations and missed grasps before.
    pub attempt: usize,
}

/// Why there is no plan.
#[derive(Debug, Clone, thiserror::Error)]
#[non_exhaustive]
pub enum NoPlan {
    /// No set of vertices can be gripped.
    #[error(
        "no grips: {accepted} vertices can be gripped and {} were rejected, but no set of grips is feasible",
        rejected.len()
    )]
    NoGrips {
        /// Vertices that can be gripped.
        accepted: usize,
        /// The other vertices that were tested, with the reasons.
        rejected: Vec<(u32, Reason)>,
    },
    /// The motion of every set was rejected.
    #[error("{}", all_refused(refused))]
    AllRefused {
        /// Each set with the reason, best first.
        refused: Vec<RefusedSet>,
    },
    /// A user's own planner has no plan, for this reason.
    #[error("{0}")]
    Other(String),
}

fn all_refused(refused: &[RefusedSet]) -> String {
    match refused.first() {
        Some(best) => format!(
            "all {} motions were rejected, the best one: {}",
            refused.len(),
            best.reason
        ),
        None => "no set of grips was found".into(),
    }
}

/// Chooses grips and motions.
pub trait Planner {
    /// A plan, or the reason why there is none (which ends the exploration).
    ///
    /// # Errors
    /// Invalid input.
    fn plan(&mut self, input: &PlanInput<'_>) -> Result<Result<Plan, NoPlan>, Error>;

    /// The state of the planner, for a checkpoint. Empty by default.
    fn save(&self) -> Vec<u8> {
        Vec::new()
    }

    /// Restores the state from [`Self::save`]. Ignores it by default.
    ///
    /// # Errors
    /// [`Error::Resume`]: the bytes are from another planner.
    fn restore(&mut self, saved: &[u8]) -> Result<(), Error> {
        if saved.is_empty() {
            return Ok(());
        }
        Err(Error::Resume {
            reason: "it was saved with another planner".into(),
        })
    }
}

/// The settings with the speeds of the loop and the frame rate of the cell.
fn paced(options: &PlanOptions, input: &PlanInput<'_>) -> PlanOptions {
    let mut options = options.clone();
    let (holding, empty) = (input.limits.holding, input.limits.empty);
    options.turn.speed = holding.speed;
    options.turn.acceleration = holding.acceleration;
    options.turn.turn_rate = holding.turn_rate;
    options.stretch.speed = options.stretch.speed.min(holding.speed);
    options.stretch.acceleration = options.stretch.acceleration.min(holding.acceleration);
    options.reach = ReachOptions::default()
        .with_speed(empty.speed)
        .with_acceleration(empty.acceleration)
        .with_turn_rate(empty.turn_rate);
    options.tracking.frame_rate = input.cell.camera_rate;
    options
}

fn refused_set(set: &GripSet, reason: Refusal) -> RefusedSet {
    RefusedSet {
        vertices: set.vertices(),
        arms: set.grips.iter().map(|g| g.arm).collect(),
        score: set.score,
        reason,
    }
}

fn model<'a>(input: &PlanInput<'a>) -> Model<'a> {
    Model {
        points: input.points,
        normals: input.normals,
        areas: input.areas,
        edges: input.edges,
        boundary: &input.topology.boundary,
        visible: input.visible,
        hidden: input.hidden,
    }
}

/// The arms of a cell in the form that the planner uses.
pub(crate) fn arms(cell: &CellInfo) -> Vec<Arm> {
    cell.arms
        .iter()
        .map(|arm| Arm {
            base: arm.base,
            workspace: workspace(arm),
            home: arm.camera_from_home,
            max_speed: arm.max_speed,
        })
        .collect()
}

fn workspace(arm: &ArmInfo) -> Workspace {
    let (center, radius) = (arm.base, arm.reach);
    let ball = Workspace::Ball { center, radius };
    match arm.poses.clone() {
        None => ball,
        Some(poses) => Workspace::Custom(Arc::new(move |camera_from_tip| {
            ball.contains(camera_from_tip) && poses.contains(camera_from_tip)
        })),
    }
}

/// Table, arms and camera in the form that the planner uses.
pub(crate) fn scene<'a>(cell: &CellInfo, arms: &'a [Arm], camera: &Isometry3<f64>) -> Scene<'a> {
    let jaw_radius = cell
        .arms
        .iter()
        .map(|a| a.jaw_radius)
        .fold(0.0, f64::max)
        .max(1e-3);
    Scene {
        table: cell.table,
        arms,
        camera: camera.translation.vector.into(),
        jaw_radius,
        shaft_length: 0.05,
        jaw_separation: 4.0 * jaw_radius,
        clearance: 2e-3,
    }
}
