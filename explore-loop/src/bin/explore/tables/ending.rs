//! How a run ended, and whose fault it was.
//!
//! A comparison of grips that counted faults of the reconstruction or of the control as failures of the grips would flatter whichever grips move less.

use super::result::Ran;

/// How a run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Ending {
    Closed,
    Attached,
    Grips,
    Ours,
    Open,
}

impl Ending {
    /// All, in the order of the tables.
    pub const ALL: [Self; 5] = [
        Self::Closed,
        Self::Attached,
        Self::Grips,
        Self::Ours,
        Self::Open,
    ];

    /// Of a run, by the word that its metrics have for it.
    pub fn of(ran: &Ran) -> Self {
        match ran.metrics.as_ref().map(|m| m.stop.as_str()) {
            Some("closed") => Self::Closed,
            Some("closed_but_attached") => Self::Attached,
            Some("nothing_to_grip" | "grasp_failed" | "slipped" | "too_many_manipulations") => {
                Self::Grips
            }
            Some("ended") => Self::Open,
            // blind, lost, not_arriving, arm_fault, no_way, cell_failed, error; or no metrics at all.
            _ => Self::Ours,
        }
    }

    /// The word in the CSV.
    pub fn word(self) -> &'static str {
        match self {
            Self::Closed => "closed",
            Self::Attached => "attached",
            Self::Grips => "grips",
            Self::Ours => "ours",
            Self::Open => "open",
        }
    }

    /// What it stands for, as the table explains it.
    pub fn meaning(self) -> &'static str {
        match self {
            Self::Closed => "the surface closed",
            Self::Attached => "it closed but for a part that is held to the table",
            Self::Grips => {
                "the grips did not get farther: nothing to grip, jaws that missed or slipped, or as many manipulations as are allowed"
            }
            Self::Ours => {
                "the body was lost, the arms were led where they could not go, the cell or the program failed"
            }
            Self::Open => "the recording came to its end before the surface closed",
        }
    }

    /// The heading in the table.
    pub fn heading(self) -> &'static str {
        match self {
            Self::Closed => "closed",
            Self::Attached => "closed but attached",
            Self::Grips => "ended by the grips",
            Self::Ours => "ended by a fault of ours",
            Self::Open => "not closed",
        }
    }
}
