//! Why a vertex is not a grip candidate.

use std::fmt;

/// A pose on the path to a grip and back.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub enum Waypoint {
    /// Back along the tool: the straight last part of the approach begins here.
    Approach,
    /// The jaws close here.
    Grasp,
    /// Back along the tool and up: the tip retreats to here if the grip is given up.
    Retreat,
}

impl fmt::Display for Waypoint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Approach => "approach",
            Self::Grasp => "grasp",
            Self::Retreat => "retreat",
        })
    }
}

/// Why a vertex that was tested cannot be gripped, or is not needed.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub enum Reason {
    /// The camera does not see it.
    #[error("the camera does not see it")]
    Hidden,
    /// The surface faces the table.
    #[error("its normal points {dip:.2} rad below the horizontal")]
    FacesTable {
        /// Angle of the normal below the horizontal, radians.
        dip: f64,
    },
    /// The tip would be too near the table.
    #[error("the tip would be {height:.4} m above the table")]
    TooLow {
        /// Height of the tip above the table, metres.
        height: f64,
    },
    /// No arm reaches all of approach, grasp and retreat.
    #[error("no arm reaches it; the nearest, arm {arm}, does not reach its {at} pose")]
    OutOfReach {
        /// The arm whose base is nearest.
        arm: usize,
        /// The first pose that this arm does not reach.
        at: Waypoint,
    },
    /// The surface beside the vertex is in the way of the open jaws.
    #[error("vertex {by} is in the way of a jaw")]
    TooWide {
        /// The vertex nearest to a jaw.
        by: u32,
    },
    /// The body obstructs the tool.
    #[error("vertex {by} is in the way of the tool at its {at} pose")]
    Blocked {
        /// The vertex nearest to the middle of the tool.
        by: u32,
        /// The pose of the tool.
        at: Waypoint,
    },
    /// There are other candidates nearby, and enough of them.
    #[error("candidate {near} is only {distance:.4} m away, and there are enough candidates")]
    Thinned {
        /// The nearest candidate that was kept.
        near: u32,
        /// Its distance, metres.
        distance: f64,
    },
}

impl Reason {
    /// A keyword for tables.
    pub fn word(&self) -> &'static str {
        match self {
            Self::Hidden => "hidden",
            Self::FacesTable { .. } => "faces table",
            Self::TooLow { .. } => "too low",
            Self::OutOfReach { .. } => "out of reach",
            Self::TooWide { .. } => "too wide",
            Self::Blocked { .. } => "blocked",
            Self::Thinned { .. } => "thinned",
        }
    }
}

/// Counts by keyword, most frequent first: `31 hidden, 4 blocked`.
pub(crate) fn tally(rejected: &[(u32, Reason)]) -> String {
    let mut counts: Vec<(usize, &str)> = Vec::new();
    for (_, reason) in rejected {
        match counts.iter_mut().find(|(_, word)| *word == reason.word()) {
            Some((count, _)) => *count += 1,
            None => counts.push((1, reason.word())),
        }
    }
    counts.sort_by(|a, b| b.0.cmp(&a.0).then(a.1.cmp(b.1)));
    let parts: Vec<String> = counts
        .iter()
        .map(|(n, word)| format!("{n} {word}"))
        .collect();
    if parts.is_empty() {
        "none tested".into()
    } else {
        parts.join(", ")
    }
}
