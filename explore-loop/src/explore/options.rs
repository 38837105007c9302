//! Options of an exploration, with their defaults.

use super::{Bounds, Limits};
use crate::canonical::genus::Genus;
use derive_setters::Setters;

/// Options of an exploration.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct ExploreOptions {
    /// Spacing ε of the model, metres.
    pub spacing: f64,
    /// Number of handles of a closed surface. Default: any.
    pub genus: Genus,
    /// Criterion for a closed surface.
    pub closed_by: ClosedBy,
    /// Limits of the arms. Holding: the given speed, 0.05 m/s², 1 rad/s. Empty: 0.25 m/s, 0.4 m/s², 1.5 rad/s. Set-points are at most 30 mm
    /// apart.
    pub limits: Limits,
    /// Whether grips move at their largest speed from beginning to end, instead of starting slowly and slowing down where frames fit badly. Default
    /// false.
    pub steady_speed: bool,
    /// Largest number of manipulations. Default 8.
    pub max_manipulations: usize,
    /// Largest number of consecutive failed grasps or slips. Default 4.
    pub max_misses: usize,
    /// Number of recoveries after which the next trouble ends the exploration. Default 4.
    pub max_recoveries: usize,
    /// Number of frames of the resting object before each decision. Default 6.
    pub look_frames: usize,
    /// Most frames to wait until the object rests. Default 25.
    pub settle_frames: usize,
    /// Height above the table at which grips are released, metres. Default 0.013.
    pub set_down: f64,
    /// Number of consecutive frames that may fail to register before the arms stop; until then they move slowly. Default 2.
    pub doubt: usize,
    /// Number of further frames that may fail before the object is lowered. Default 6.
    pub patience: usize,
    /// Number of consecutive unusable frames after which the manipulation is given up. Default 15.
    pub blind_frames: usize,
    /// Largest distance of an arm from its set-point before the other arms wait for it, metres. Default 0.01.
    pub lag: f64,
    /// Longest time to wait for an arm, seconds. Default 5.
    pub arrival: f64,
}

/// Criterion for a closed surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
pub enum ClosedBy {
    /// All of [`Topology::is_closed`](crate::canonical::topology::Topology::is_closed): Betti numbers, handles, and a wholly seen surface.
    Surface,
    /// Only the Betti numbers at scale 1, as in the paper (section on the stop condition): those of a closed surface of the requested
    /// genus.
    BettiNumbers,
}

impl ExploreOptions {
    /// Defaults at a spacing, m, and a largest grip speed, m/s.
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
            steady_speed: false,
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
