//! Troubles that end a manipulation, and the ends of an exploration.
//!
//! ```text
//! trouble ─► stop ─► lower from here ─► open ─► home ─► look ─┬─► continue
//!              └ an arm that does not obey or does not      └─► end: the body is not found again, or there were too many troubles
//!                report its pose: jaws are not moved ─► end
//! ```

use super::{FrameFault, Held};
use crate::canonical::topology::Touching;
use crate::plan::NoPlan;
use grip_planner::Refusal;

/// Why a manipulation was given up.
#[derive(Debug, Clone, thiserror::Error)]
#[non_exhaustive]
pub enum Trouble {
    /// Consecutive frames could not be used.
    #[error("{frames} frames in a row could not be used: {fault}")]
    Blind {
        /// How many.
        frames: usize,
        /// What was wrong with the last one.
        fault: FrameFault,
    },
    /// The body did not fit in consecutive frames.
    #[error("the body is lost: {frames} frames in a row did not fit")]
    Lost {
        /// How many.
        frames: usize,
    },
    /// A lifting jaw no longer holds anything.
    #[error("the grip of arm {arm} has slipped")]
    Slipped {
        /// The arm.
        arm: usize,
    },
    /// An arm does not reach its set-point.
    #[error("arm {arm} is still {distance:.3} m from where it was to be {seconds:.1} s ago")]
    NotArriving {
        /// The arm.
        arm: usize,
        /// Its distance from the set-point, metres.
        distance: f64,
        /// How long it has lagged behind, seconds.
        seconds: f64,
    },
    /// An arm refuses commands.
    #[error("arm {arm} refuses commands: {reason}")]
    ArmFault {
        /// The arm.
        arm: usize,
        /// The reason it gave.
        reason: String,
    },
    /// There is no free path from the present poses.
    #[error("there is no free path from the present poses: {reason}")]
    NoWay {
        /// Why the best path was rejected.
        reason: Refusal,
    },
    /// The cell failed.
    #[error("{reason}")]
    CellFailed {
        /// The reason it gave.
        reason: String,
    },
    /// The end was requested.
    #[error("interrupted")]
    Interrupted,
    /// It happened before the exploration was [resumed](super::Explorer::resume).
    #[error("{what}")]
    Earlier {
        /// Its description.
        what: String,
    },
}

impl Trouble {
    /// A keyword for tables.
    pub fn word(&self) -> &'static str {
        match self {
            Self::Blind { .. } => "blind",
            Self::Lost { .. } => "lost",
            Self::Slipped { .. } => "slipped",
            Self::NotArriving { .. } => "not_arriving",
            Self::ArmFault { .. } => "arm_fault",
            Self::NoWay { .. } => "no_way",
            Self::CellFailed { .. } => "cell_failed",
            Self::Interrupted => "interrupted",
            Self::Earlier { .. } => "earlier",
        }
    }

    /// Whether all arms execute commands and report their poses.
    pub(super) fn arms_obey(&self) -> bool {
        match self {
            Self::NotArriving { .. } | Self::ArmFault { .. } => false,
            Self::Blind { fault, .. } => !fault.is_of_arms(),
            _ => true,
        }
    }
}

/// Why an exploration ended.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub enum Stop {
    /// The surface is closed: all of it was seen.
    Closed,
    /// All was seen except a part that is attached to the table.
    ClosedButAttached(Held),
    /// All was seen, but parts that touch could not be shown apart.
    ClosedButTouching(Touching),
    /// The largest number of manipulations was reached.
    TooManyManipulations,
    /// No grip was possible.
    NothingToGrip(NoPlan),
    /// In several attempts no jaw held anything.
    GraspFailed,
    /// A trouble that could not be recovered from.
    Trouble(Trouble),
}

impl Stop {
    /// The keyword in `metrics.json`.
    pub fn word(&self) -> &'static str {
        match self {
            Self::Closed => "closed",
            Self::ClosedButAttached(_) => "closed_but_attached",
            Self::ClosedButTouching(_) => "closed_but_touching",
            Self::TooManyManipulations => "too_many_manipulations",
            Self::NothingToGrip(_) => "nothing_to_grip",
            Self::GraspFailed => "grasp_failed",
            Self::Trouble(trouble) => trouble.word(),
        }
    }

    /// The reason in `metrics.json`: a sentence where the keyword alone does not say it.
    pub fn reason(&self) -> Option<String> {
        match self {
            Self::Closed | Self::TooManyManipulations | Self::GraspFailed => None,
            Self::ClosedButAttached(held) => Some(held.to_string()),
            Self::ClosedButTouching(parts) => Some(parts.to_string()),
            Self::NothingToGrip(none) => Some(none.to_string()),
            Self::Trouble(trouble) => Some(trouble.to_string()),
        }
    }
}
