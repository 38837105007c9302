//! Settings of an exploration, each with its default.

use super::{Bounds, Limits};
use crate::canonical::genus::Genus;

/// Settings of an exploration.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct ExploreOptions {
    /// Spacing ε of the model, metres.
    pub spacing: f64,
    /// How many handles a surface may have that counts as closed. Default: as many as it has.
    pub genus: Genus,
    /// What makes a surface count as closed.
    pub closed_by: ClosedBy,
    /// What the arms may do. Holding: the speed given, 0.05 m/s², 1 rad/s. Empty: 0.25 m/s, 0.4 m/s², 1.5 rad/s. A set-point is at most 30 mm
    /// from the one before.
    pub limits: Limits,
    /// Manipulations after which the exploration gives up. Default 8.
    pub max_manipulations: usize,
    /// Attempts to grasp in a row, or grips that slip, after which it gives up. Default 4.
    pub max_misses: usize,
    /// Times that something was given up after which the next ends the exploration. Default 4.
    pub max_recoveries: usize,
    /// Frames to look at the object at rest before each decision. Default 6.
    pub look_frames: usize,
    /// Most frames to wait for the object to rest. Default 25.
    pub settle_frames: usize,
    /// Height above the table at which grips are let go, metres. Default 0.013.
    pub set_down: f64,
    /// Frames in a row that may fail to register before the arms are stopped. Default 2: until then they go slowly.
    pub doubt: usize,
    /// Frames in a row that may fail to register after that, before what is held is lowered. Default 6.
    pub patience: usize,
    /// Frames in a row that cannot be used before what is under way is given up. Default 15.
    pub blind_frames: usize,
    /// Farthest that an arm may be from where it was sent when a frame is taken before the others wait for it, metres. Default 0.01.
    pub lag: f64,
    /// How long they wait, seconds. Default 5.
    pub arrival: f64,
}

/// What makes a surface count as closed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum ClosedBy {
    /// All of [`Topology::is_closed`](crate::canonical::topology::Topology::is_closed): Betti numbers, handles, and a surface that was wholly seen.
    Surface,
    /// The Betti numbers at the scale of the complex alone, as in the paper (section on the stop condition): those of a closed surface of the genus
    /// asked for.
    BettiNumbers,
}

impl ExploreOptions {
    /// Defaults at a spacing and a fastest grip speed, m and m/s.
    pub fn new(spacing: f64, speed: f64) -> Self {
        let holding = Bounds {
            speed,
            acceleration: 0.05,
            turn_rate: 1.0,
        };
        let empty = Bounds {
            speed: 0.25,
            acceleration: 0.4,
            turn_rate: 1.5,
        };
        Self {
            spacing,
            genus: Genus::Any,
            closed_by: ClosedBy::Surface,
            limits: Limits {
                holding,
                empty,
                step: 0.03,
            },
            max_manipulations: 8,
            max_misses: 4,
            max_recoveries: 4,
            look_frames: 6,
            settle_frames: 25,
            set_down: 0.013,
            doubt: 2,
            patience: 6,
            blind_frames: 15,
            lag: 0.01,
            arrival: 5.0,
        }
    }
}
