//! The pose of an arm relative to a camera, from samples of the tip seen by both.
//!
//! ```text
//! touches      p_camera = camera_from_rcm · p_rcm                          points that the tip touched
//! sightings    camera_from_marker = camera_from_rcm · rcm_from_wrist · wrist_from_marker
//!                      A          =        X        ·       B        ·         Y
//! ```
//! A fixed camera and a marker fixed to the instrument, at an unknown pose on it, lead to the second
//! problem A = X·B·Y (*robot-world/hand-eye*), not A·X = X·B: both X and Y are determined.
//!
//! | step | item |
//! |---|---|
//! | fit to touched points | [`fit_touches`] |
//! | fit to poses of a marker | [`fit_sightings`] |
//! | save it | [`Calibration`], [`Calibration::save`], [`Calibration::load`] |
//! | check it later | [`Calibration::check_touches`], [`Calibration::check_sightings`] |
//!
//! ```
//! use dvrk_io::calibration::{Calibration, CheckOptions, FitOptions, Touch, Verdict, fit_touches};
//! use dvrk_io::nalgebra::{Isometry3, Point3, Vector3};
//!
//! # fn main() -> Result<(), dvrk_io::Error> {
//! // Twelve touches on a grid, as camera and arm saw them; the sixth slipped by 2 cm.
//! let planted = Isometry3::new(Vector3::new(0.1, 0.0, 0.4), Vector3::new(0.5, 0.2, 1.0));
//! let touches: Vec<Touch> = (0..12)
//!     .map(|i| {
//!         let (row, column) = (f64::from(i / 4), f64::from(i % 4));
//!         let rcm = Point3::new(0.04 * column, 0.04 * row, -0.15 + 0.005 * row * column);
//!         let slip = if i == 5 { 0.02 } else { 0.0 };
//!         Touch { camera: planted * rcm + Vector3::new(0.0, slip, 0.0), rcm }
//!     })
//!     .collect();
//! let fit = fit_touches(&touches, &FitOptions::default())?;
//! assert_eq!(fit.residuals.outliers, [5]);
//! assert!((fit.residuals.distances[5] - 0.02).abs() < 1e-12);
//! assert!((fit.camera_from_rcm.translation.vector - planted.translation.vector).norm() < 1e-12);
//!
//! // Kept as text, read back to the same bits, and checked against touches of another day.
//! let calibration = Calibration::new("PSM1", "camera_depth_optical_frame", "PSM1_base", &fit)?;
//! let again = Calibration::from_toml(calibration.to_toml()?.as_bytes())?;
//! assert_eq!(again, calibration);
//! let today = again.check_touches(&touches[..5], &CheckOptions::default())?;
//! assert_eq!(today.verdict, Verdict::Holds);
//! # Ok(())
//! # }
//! ```
//!
//! *Limits.* A rigid transform cannot model the effects of cables and setup joints while the arm moves: expect
//! residuals of millimetres on a real PSM. A tip that is touched is [`RcmFromTip`](crate::kinematics::RcmFromTip);
//! giving the pose of the wrist instead causes residuals of a centimetre. Up to nearly half of the samples may be
//! outliers; they are reported, and must not agree with each other.

mod check;
mod file;
mod fit;
mod points;
mod poses;
mod robust;

pub use check::{Check, CheckOptions, Verdict};
pub use file::{Calibration, Method};
pub use fit::{Fit, FitOptions, Residuals};
pub use points::{Touch, fit_touches};
pub use poses::{Sighting, fit_sightings};
