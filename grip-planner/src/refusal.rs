//! Why there is no plan.

use crate::reason::tally;
use crate::{Error, Reason, Stage};

/// Why there are no grips, or a motion was rejected.
#[derive(Debug, Clone, thiserror::Error)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub enum Refusal {
    /// The input is invalid.
    #[error(transparent)]
    Input(#[from] Error),
    /// A tip would have to leave its workspace.
    #[error("{stage}: arm {arm} cannot reach {position:.3?} at {time:.2} s")]
    OutOfWorkspace {
        /// The stage of the motion.
        stage: Stage,
        /// The arm.
        arm: usize,
        /// Time, seconds into the motion.
        time: f64,
        /// Position of the tip, metres.
        position: [f64; 3],
    },
    /// A tip, jaw or wrist would collide with the table.
    #[error(
        "{stage}: arm {arm} is {height:.4} m above the table at {time:.2} s, but must stay {clearance} m above"
    )]
    HitsTable {
        /// The stage of the motion.
        stage: Stage,
        /// The arm.
        arm: usize,
        /// Time, seconds into the motion.
        time: f64,
        /// Height of its tip or wrist, or of its lower jaw plus the clearance, metres.
        height: f64,
        /// The required height, metres.
        clearance: f64,
    },
    /// Two tools would collide.
    #[error("{stage}: arms {arms:?} come within {distance:.4} m of each other at {time:.2} s")]
    ArmsCollide {
        /// The stage of the motion.
        stage: Stage,
        /// The arms.
        arms: [usize; 2],
        /// Time, seconds into the motion.
        time: f64,
        /// Distance between their surfaces, metres.
        distance: f64,
    },
    /// A tool would penetrate the body.
    #[error(
        "{stage}: the tool of arm {arm} collides with the body at vertex {vertex} at {time:.2} s"
    )]
    HitsBody {
        /// The stage of the motion.
        stage: Stage,
        /// The arm.
        arm: usize,
        /// Time, seconds into the motion.
        time: f64,
        /// The vertex nearest to the middle of the tool.
        vertex: u32,
        /// Its distance, metres.
        distance: f64,
    },
    /// The set does not have two lifting grips on the lifted side.
    #[error("a turn requires 2 lifting grips on the lifted side, but there are {lifting}")]
    CannotLift {
        /// Their number.
        lifting: usize,
    },
    /// No two arms reach the grips without crossing.
    #[error("no two arms reach vertices {vertices:?} without crossing")]
    ArmsCross {
        /// The vertices of the grips.
        vertices: [u32; 2],
    },
    /// A third arm cannot hold the body at this vertex.
    #[error("no free arm can hold vertex {vertex} near the pivot")]
    CannotSupport {
        /// The vertex.
        vertex: u32,
    },
    /// A hole needs a grip on each of its sides.
    #[error("there is no candidate in reach of an arm on side {side} of the hole")]
    NoGripBesideHole {
        /// The side, 0 or 1.
        side: usize,
    },
    /// The loop is too small or thin to have a long axis.
    #[error("the loop of {vertices} vertices is too small for a hole")]
    NotAHole {
        /// Vertices of the loop.
        vertices: usize,
    },
    /// Two parts that touch lie on each other, not beside each other.
    #[error("one part lies on the other: they cannot be pulled apart sideways")]
    NotBeside,
    /// No set of grips can turn the body.
    #[error(
        "no grips: {accepted} candidates were accepted, none of their sets can be used; rejected: {}",
        tally(rejected)
    )]
    NoGrips {
        /// Number of accepted candidates.
        accepted: usize,
        /// The other vertices that were tested, with the reasons.
        rejected: Vec<(u32, Reason)>,
    },
    /// The motions of every set of grips were rejected.
    #[error("all {} sets of grips were rejected; the best: {}", refused.len(), first_reason(refused))]
    AllRefused {
        /// Each set with the reason.
        refused: Vec<RefusedSet>,
    },
}

/// A set of grips whose motion was refused.
#[derive(Debug, Clone)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct RefusedSet {
    /// The vertices of its grips.
    pub vertices: Vec<u32>,
    /// Their arms.
    pub arms: Vec<usize>,
    /// Its score.
    pub score: f64,
    /// The reason.
    pub reason: Refusal,
}

fn first_reason(refused: &[RefusedSet]) -> String {
    refused
        .first()
        .map_or_else(String::new, |r| r.reason.to_string())
}
