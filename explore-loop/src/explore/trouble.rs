//! What makes the loop give up what is under way, and how an exploration ends.
//!
//! ```text
//! trouble ─► stop ─► lower from here ─► open ─► home ─► look ─┬─► go on
//!              └ an arm that does not obey or does not say    └─► end: the body is not found again, or the same happened too often
//!                where it is: jaws stay as they are ─► end
//! ```

use super::{FrameFault, Held};
use crate::plan::NoPlan;
use grip_planner::Refusal;

/// Why what was under way was given up.
#[derive(Debug, Clone, thiserror::Error)]
#[non_exhaustive]
pub enum Trouble {
    /// Frames in a row could not be used.
    #[error("{frames} frames in a row could not be used: {fault}")]
    Blind {
        /// How many.
        frames: usize,
        /// What was wrong with the last.
        fault: FrameFault,
    },
    /// The body was not where it was followed to, frame after frame.
    #[error("the body is lost: {frames} frames in a row did not fit")]
    Lost {
        /// How many.
        frames: usize,
    },
    /// A jaw that lifts holds nothing any more.
    #[error("the grip of arm {arm} has slipped")]
    Slipped {
        /// The arm.
        arm: usize,
    },
    /// An arm does not get where it was sent.
    #[error("arm {arm} is still {distance:.3} m from where it was sent {seconds:.1} s ago")]
    NotArriving {
        /// The arm.
        arm: usize,
        /// How far it is, metres.
        distance: f64,
        /// For how long it has lagged behind, seconds.
        seconds: f64,
    },
    /// An arm refuses commands.
    #[error("arm {arm} does not obey: {reason}")]
    ArmFault {
        /// The arm.
        arm: usize,
        /// What it said.
        reason: String,
    },
    /// No checked way leads on from where the arms are.
    #[error("no way from here: {reason}")]
    NoWay {
        /// Why the best one was refused.
        reason: Refusal,
    },
    /// The world behind the cell failed.
    #[error("{reason}")]
    CellFailed {
        /// What it said.
        reason: String,
    },
    /// Somebody asked for the end.
    #[error("interrupted")]
    Interrupted,
    /// It was given up before the exploration was [resumed](super::Explorer::resume).
    #[error("{what}")]
    Earlier {
        /// What it was.
        what: String,
    },
}

impl Trouble {
    /// One word for tables.
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

    /// Whether all arms do as they are told, and it is known where they are.
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
    /// The surface is closed: all of it has been seen.
    Closed,
    /// All of it has been seen but a part that is held to the table.
    ClosedButAttached(Held),
    /// The manipulations allowed were used up.
    TooManyManipulations,
    /// No grip was possible.
    NothingToGrip(NoPlan),
    /// No jaw held anything in several attempts.
    GraspFailed,
    /// Something happened that could not be recovered from.
    Trouble(Trouble),
}

impl Stop {
    /// The word in `metrics.json`.
    pub fn word(&self) -> &'static str {
        match self {
            Self::Closed => "closed",
            Self::ClosedButAttached(_) => "closed_but_attached",
            Self::TooManyManipulations => "too_many_manipulations",
            Self::NothingToGrip(_) => "nothing_to_grip",
            Self::GraspFailed => "grasp_failed",
            Self::Trouble(trouble) => trouble.word(),
        }
    }

    /// The reason in `metrics.json`: a sentence where the word alone does not say it.
    pub fn reason(&self) -> Option<String> {
        match self {
            Self::Closed | Self::TooManyManipulations | Self::GraspFailed => None,
            Self::ClosedButAttached(held) => Some(held.to_string()),
            Self::NothingToGrip(none) => Some(none.to_string()),
            Self::Trouble(trouble) => Some(trouble.to_string()),
        }
    }
}
