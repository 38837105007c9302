//! How a run ended, and whether the grips or the system caused a failure.
//!
//! A comparison of grips must not count faults of the reconstruction or of the control against the grips: that would favour grips that move less.

use super::result::Ran;

/// How a run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Ending {
    Closed,
    Attached,
    Touching,
    Grips,
    Ours,
    Open,
}

impl Ending {
    /// All endings, in the order of the tables.
    pub const ALL: [Self; 6] = [
        Self::Closed,
        Self::Attached,
        Self::Touching,
        Self::Grips,
        Self::Ours,
        Self::Open,
    ];

    /// The ending of a run, from `stop` in its metrics.
    pub fn of(ran: &Ran) -> Self {
        match ran.metrics.as_ref().map(|m| m.stop.as_str()) {
            Some("closed") => Self::Closed,
            Some("closed_but_attached") => Self::Attached,
            Some("closed_but_touching") => Self::Touching,
            Some("nothing_to_grip" | "grasp_failed" | "slipped" | "too_many_manipulations") => {
                Self::Grips
            }
            Some("ended") => Self::Open,
            // blind, lost, not_arriving, arm_fault, no_way, cell_failed, error; or no metrics at all.
            _ => Self::Ours,
        }
    }

    /// The name in the CSV.
    pub fn word(self) -> &'static str {
        match self {
            Self::Closed => "closed",
            Self::Attached => "attached",
            Self::Touching => "touching",
            Self::Grips => "grips",
            Self::Ours => "ours",
            Self::Open => "open",
        }
    }

    /// The explanation below the table.
    pub fn meaning(self) -> &'static str {
        match self {
            Self::Closed => "the surface closed",
            Self::Attached => "the surface closed except for a part that is held to the table",
            Self::Touching => "the surface closed, but parts of it that touch were not seen apart",
            Self::Grips => {
                "the grips made no more progress: nothing to grip, jaws that missed or slipped, or the largest number of manipulations was reached"
            }
            Self::Ours => {
                "tracking lost the body, the arms were sent to poses that they cannot reach, or the cell or the program failed"
            }
            Self::Open => "the recording ended before the surface closed",
        }
    }

    /// The heading in the table.
    pub fn heading(self) -> &'static str {
        match self {
            Self::Closed => "closed",
            Self::Attached => "closed but attached",
            Self::Touching => "closed but touching",
            Self::Grips => "ended by the grips",
            Self::Ours => "ended by a system fault",
            Self::Open => "not closed",
        }
    }
}
