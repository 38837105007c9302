//! What can go wrong in an exploration.

use crate::canonical::closed_surface::ClosedSurfaceError;
use crate::cell::CellError;
use crate::checkpoint::CheckpointError;
use crate::measure::MeasureError;
use std::path::PathBuf;

/// Why an exploration or a reconstruction could not go on.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The spacing is not a length.
    #[error("the spacing must be a positive length, not {spacing} m")]
    BadSpacing {
        /// The value given, metres.
        spacing: f64,
    },
    /// A setting is out of its range.
    #[error("the setting {name} must be {needed}, not {value}")]
    BadSetting {
        /// Which.
        name: &'static str,
        /// What it may be.
        needed: &'static str,
        /// The value given.
        value: f64,
    },
    /// A camera that moves, and a reconstruction that needs one that stands still.
    #[error("{reconstruction} needs a camera that stands still")]
    CameraMoves {
        /// Which reconstruction.
        reconstruction: &'static str,
    },
    /// The camera saw (almost) nothing where the object should be.
    #[error("the camera sees {points} points of the object; at least {needed} are needed to begin")]
    NothingToSee {
        /// Points seen.
        points: usize,
        /// Points needed.
        needed: usize,
    },
    /// Registration refused its input.
    #[error("registration: {0}")]
    Register(#[from] nonrigid_reg::Error),
    /// The filter refused its input.
    #[error("filter: {0}")]
    Filter(#[from] topo_ekf::Error),
    /// The complex could not be built.
    #[error("topology: {0}")]
    Complex(#[from] cech_complex::Error),
    /// The planner refused its input.
    #[error("planning: {0}")]
    Plan(#[from] grip_planner::Refusal),
    /// No closed surface could be drawn.
    #[error("surface: {0}")]
    Surface(#[from] ClosedSurfaceError),
    /// The world failed.
    #[error(transparent)]
    Cell(#[from] CellError),
    /// The ground truth is unusable.
    #[error(transparent)]
    Measure(#[from] MeasureError),
    /// A session could not be read or written.
    #[error("session: {0}")]
    Session(#[from] dvrk_io::Error),
    /// The live view cannot be opened.
    #[cfg(feature = "rerun")]
    #[error("live view: {reason}")]
    LiveView {
        /// Why not.
        reason: String,
    },
    /// A run cannot go on from what was saved of it.
    #[error("cannot resume: {reason}")]
    Resume {
        /// Why not.
        reason: String,
    },
    /// A checkpoint cannot be used.
    #[error("{}: {source}", path.display())]
    Checkpoint {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: CheckpointError,
    },
    /// Somebody asked the program to stop.
    #[error("interrupted")]
    Interrupted,
    /// A file could not be written.
    #[error("cannot write {}: {source}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
}
impl From<grip_planner::Error> for Error {
    fn from(error: grip_planner::Error) -> Self {
        Self::Plan(error.into())
    }
}
