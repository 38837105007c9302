//! Why there is no plan.

use crate::plan::RefusedSet;
use crate::reason::tally;
use crate::{Error, Reason, Stage};

/// Why there are no grips, or a motion was not planned.
#[derive(Debug, Clone, thiserror::Error)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub enum Refusal {
    /// The input cannot be used.
    #[error(transparent)]
    Input(#[from] Error),
    /// A tip would have to leave its workspace.
    #[error("{stage}: arm {arm} cannot reach {position:.3?} at {time:.2} s")]
    OutOfWorkspace {
        /// What the arms are doing.
        stage: Stage,
        /// The arm.
        arm: usize,
        /// When, seconds into the motion.
        time: f64,
        /// Where, metres.
        position: [f64; 3],
    },
    /// A tip, jaw or wrist would hit the table.
    #[error(
        "{stage}: arm {arm} is {height:.4} m above the table at {time:.2} s, it must stay {clearance} m above"
    )]
    HitsTable {
        /// What the arms are doing.
        stage: Stage,
        /// The arm.
        arm: usize,
        /// When, seconds into the motion.
        time: f64,
        /// Height of its tip or wrist, or of its lower jaw plus the clearance, metres.
        height: f64,
        /// What must be kept, metres.
        clearance: f64,
    },
    /// Two tools would meet.
    #[error("{stage}: arms {arms:?} come within {distance:.4} m of each other at {time:.2} s")]
    ArmsCollide {
        /// What the arms are doing.
        stage: Stage,
        /// The arms.
        arms: [usize; 2],
        /// When, seconds into the motion.
        time: f64,
        /// Distance of their surfaces, metres.
        distance: f64,
    },
    /// A tool would go through the body.
    #[error("{stage}: the tool of arm {arm} meets the body at vertex {vertex} at {time:.2} s")]
    HitsBody {
        /// What the arms are doing.
        stage: Stage,
        /// The arm.
        arm: usize,
        /// When, seconds into the motion.
        time: f64,
        /// The vertex nearest to the middle of the tool.
        vertex: u32,
        /// How near it comes, metres.
        distance: f64,
    },
    /// The set does not have two lifting grips on the lifted side.
    #[error("{lifting} lifting grips on the lifted side: a turn takes 2")]
    CannotLift {
        /// How many there are.
        lifting: usize,
    },
    /// No two arms take the grips without crossing.
    #[error("no two arms reach vertices {vertices:?} without crossing")]
    ArmsCross {
        /// The vertices of the grips.
        vertices: [u32; 2],
    },
    /// A vertex is not where a third arm can hold the body.
    #[error("no free arm holds vertex {vertex} by the pivot")]
    CannotSupport {
        /// The vertex.
        vertex: u32,
    },
    /// A hole needs a grip on each of its sides.
    #[error("no candidate that an arm can take on side {side} of the hole")]
    NoGripBesideHole {
        /// Which side, 0 or 1.
        side: usize,
    },
    /// A hole this small or thin has no long axis.
    #[error("the loop of {vertices} vertices does not span a hole")]
    NotAHole {
        /// Vertices of the loop.
        vertices: usize,
    },
    /// No set of grips can turn the body.
    #[error(
        "no grips: {accepted} candidates were accepted, none of their sets can be used; rejected: {}",
        tally(rejected)
    )]
    NoGrips {
        /// Number of accepted candidates.
        accepted: usize,
        /// The other vertices that were looked at, with their reasons.
        rejected: Vec<(u32, Reason)>,
    },
    /// Every set of grips has a motion that was refused.
    #[error("all {} sets of grips were refused; the best: {}", refused.len(), first_reason(refused))]
    AllRefused {
        /// Each set with the reason.
        refused: Vec<RefusedSet>,
    },
}

fn first_reason(refused: &[RefusedSet]) -> String {
    refused
        .first()
        .map_or_else(String::new, |r| r.reason.to_string())
}
