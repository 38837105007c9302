//! Errors of an exploration.

use crate::canonical::closed_surface::ClosedSurfaceError;
use crate::cell::CellError;
use crate::checkpoint::CheckpointError;
use crate::measure::MeasureError;
use std::path::PathBuf;

/// Why an exploration or a reconstruction cannot continue.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The spacing is not positive and finite.
    #[error("spacing is {spacing}, but must be positive and finite, metres")]
    BadSpacing {
        /// The value given, metres.
        spacing: f64,
    },
    /// A setting is out of its range.
    #[error("{name} is {value}, but must be {needed}")]
    BadSetting {
        /// Its name.
        name: &'static str,
        /// The condition on it.
        needed: &'static str,
        /// The value given.
        value: f64,
    },
    /// The camera moves, but the reconstruction requires a fixed one.
    #[error("{reconstruction} needs a camera that does not move")]
    CameraMoves {
        /// The reconstruction.
        reconstruction: &'static str,
    },
    /// The camera sees almost no points of the object.
    #[error("the camera sees {points} points of the object; at least {needed} are needed to begin")]
    NothingToSee {
        /// Points seen.
        points: usize,
        /// Points needed.
        needed: usize,
    },
    /// Registration rejected its input.
    #[error("registration: {0}")]
    Register(nonrigid_reg::Error),
    /// The filter rejected its input.
    #[error("filter: {0}")]
    Filter(topo_ekf::Error),
    /// The complex could not be built.
    #[error("topology: {0}")]
    Complex(cech_complex::Error),
    /// The planner rejected its input.
    #[error("planning: {0}")]
    Plan(grip_planner::Refusal),
    /// No closed surface could be computed.
    #[error("surface: {0}")]
    Surface(ClosedSurfaceError),
    /// The cell failed.
    #[error(transparent)]
    Cell(#[from] CellError),
    /// The ground truth cannot be used.
    #[error(transparent)]
    Measure(#[from] MeasureError),
    /// A session could not be read or written.
    #[error("session: {0}")]
    Session(dvrk_io::Error),
    /// The live view cannot be opened.
    #[cfg(feature = "rerun")]
    #[error("live view: {reason}")]
    LiveView {
        /// The reason.
        reason: String,
    },
    /// A run cannot be resumed.
    #[error("cannot resume: {reason}")]
    Resume {
        /// The reason.
        reason: String,
    },
    /// A checkpoint cannot be used.
    #[error("{}: {error}", path.display())]
    Checkpoint {
        /// The file.
        path: PathBuf,
        /// The reason.
        error: CheckpointError,
    },
    /// The program was asked to stop.
    #[error("interrupted")]
    Interrupted,
    /// A file could not be written.
    #[error("cannot write {}: {error}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The error of the operating system.
        error: std::io::Error,
    },
}

/// Not `#[from]`: the message contains the inner error already, so that `source` must not return it again.
macro_rules! from {
    ($($variant:ident($error:ty)),* $(,)?) => {$(
        impl From<$error> for Error {
            fn from(error: $error) -> Self {
                Self::$variant(error)
            }
        }
    )*};
}

from!(
    Register(nonrigid_reg::Error),
    Filter(topo_ekf::Error),
    Complex(cech_complex::Error),
    Plan(grip_planner::Refusal),
    Surface(ClosedSurfaceError),
    Session(dvrk_io::Error),
);

impl From<grip_planner::Error> for Error {
    fn from(error: grip_planner::Error) -> Self {
        Self::Plan(error.into())
    }
}
