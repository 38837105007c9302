//! Checks whether a calibration still holds, with new samples.
//!
//! ```text
//! holds       at least 3/4 of the samples within the limit
//! doubtful    at least 1/2
//! broken      fewer
//! ```
//! Shares are used instead of means: a single bad measurement of the tip must not stop the robot, but half of them must.

use derive_setters::Setters;
use nalgebra::{Isometry3, Vector3};

use super::fit::{max, median, rms};
use super::poses::between;
use super::{Calibration, Sighting, Touch, points, poses};
use crate::Error;

/// Criteria for a calibration that holds.
#[derive(Debug, Clone, Copy, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct CheckOptions {
    /// Largest distance between expected and measured position, metres. Default 0.005: the best accuracy of a registration of a dVRK
    /// to a camera.
    pub limit: f64,
    /// Largest angle between expected and measured orientation of a marker, radians. Default 0.087 (5°).
    pub angle_limit: f64,
    /// Least number of samples for a verdict. Default 4.
    pub min_samples: usize,
}

impl Default for CheckOptions {
    fn default() -> Self {
        Self {
            limit: 0.005,
            angle_limit: 0.087,
            min_samples: 4,
        }
    }
}

impl CheckOptions {
    fn check(&self, samples: usize) -> Result<(), Error> {
        for (what, value) in [("limit", self.limit), ("angle limit", self.angle_limit)] {
            if !(value > 0.0 && value.is_finite()) {
                return Err(Error::OutOfRange {
                    what,
                    value,
                    expected: "must be positive and finite",
                });
            }
        }
        let needed = self.min_samples.max(1);
        if samples < needed {
            return Err(Error::TooFewSamples {
                given: samples,
                needed,
            });
        }
        Ok(())
    }
}

/// The result of a check.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Verdict {
    /// At least three quarters of the samples are within the limit.
    Holds,
    /// Between half and three quarters are.
    Doubtful,
    /// Fewer than half are: camera or arm was moved, or the instrument was changed.
    Broken,
}

/// Differences of samples from what a calibration expects.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct Check {
    /// Whether it holds.
    pub verdict: Verdict,
    /// The limits of the verdict.
    pub options: CheckOptions,
    /// How many samples are within them.
    pub within: usize,
    /// Distance between the measured and the expected position, for every sample in order, metres.
    pub distances: Vec<f64>,
    /// Angle of the same, radians; empty for touches.
    pub angles: Vec<f64>,
    /// Median of the distances, metres.
    pub median: f64,
    /// Root mean square of the distances, metres.
    pub rms: f64,
    /// Largest distance, metres.
    pub max: f64,
    /// Mean displacement from expected to measured, camera axes, metres: the part common to all samples.
    pub bias: Vector3<f64>,
}

impl Check {
    fn new(shifts: &[Vector3<f64>], angles: Vec<f64>, options: CheckOptions) -> Self {
        let distances: Vec<f64> = shifts.iter().map(nalgebra::Matrix::norm).collect();
        let is_within = |index: &usize| {
            distances[*index] <= options.limit
                && angles
                    .get(*index)
                    .is_none_or(|&angle| angle <= options.angle_limit)
        };
        let count = shifts.len();
        let within = (0..count).filter(is_within).count();
        let verdict = if 4 * within >= 3 * count {
            Verdict::Holds
        } else if 2 * within >= count {
            Verdict::Doubtful
        } else {
            Verdict::Broken
        };
        Self {
            verdict,
            options,
            within,
            median: median(&distances),
            rms: rms(&distances),
            max: max(&distances),
            bias: shifts.iter().sum::<Vector3<f64>>() / count.max(1) as f64,
            distances,
            angles,
        }
    }
}

impl Calibration {
    /// Compares touched points with this calibration. They need not be spread out: four touches of
    /// one landmark suffice.
    ///
    /// # Errors
    /// Too few samples; a coordinate that is not finite; a limit that is not positive.
    pub fn check_touches(&self, touches: &[Touch], options: &CheckOptions) -> Result<Check, Error> {
        options.check(touches.len())?;
        points::check_samples(touches)?;
        let shift = |touch: &Touch| touch.camera - self.camera_from_rcm * touch.rcm;
        let shifts: Vec<Vector3<f64>> = touches.iter().map(shift).collect();
        Ok(Check::new(&shifts, Vec::new(), *options))
    }

    /// Compares poses of the marker with this calibration.
    ///
    /// # Errors
    /// [`Error::NoMarker`] if the calibration is from touches; too few samples; an invalid pose; a limit
    /// that is not positive.
    ///
    /// ```
    /// use dvrk_io::calibration::{Calibration, CheckOptions, FitOptions, Sighting, Verdict, fit_sightings};
    /// # use dvrk_io::kinematics::RcmFromWrist;
    /// # use dvrk_io::nalgebra::Isometry3;
    /// use dvrk_io::nalgebra::Vector3;
    ///
    /// # let planted = Isometry3::new(Vector3::new(0.1, 0.0, 0.4), Vector3::new(0.5, 0.2, 1.0));
    /// # let wrist_from_marker = Isometry3::new(Vector3::new(0.0, 0.01, 0.02), Vector3::new(0.1, 0.2, 0.3));
    /// # let wave = |t: f64| Vector3::new(t.sin(), (2.0 * t).cos(), (3.0 * t).sin());
    /// # let sighting = |t: f64| {
    /// #     let wrist = Isometry3::new(wave(1.3 * t) * 0.05, wave(t) * 0.6);
    /// #     let camera_from_marker = planted * wrist * wrist_from_marker;
    /// #     Sighting { camera_from_marker, rcm_from_wrist: RcmFromWrist(wrist) }
    /// # };
    /// let mut sightings: Vec<Sighting> = (0..8).map(|i| sighting(f64::from(i))).collect();
    /// let fit = fit_sightings(&sightings, &FitOptions::default())?;
    /// let calibration = Calibration::new("PSM1", "camera", "PSM1_base", &fit)?;
    /// // Later the camera has moved by 2 cm.
    /// for sighting in &mut sightings {
    ///     sighting.camera_from_marker.translation.vector.x += 0.02;
    /// }
    /// let check = calibration.check_sightings(&sightings, &CheckOptions::default())?;
    /// assert_eq!((check.verdict, check.within), (Verdict::Broken, 0));
    /// assert!((check.bias - Vector3::new(0.02, 0.0, 0.0)).norm() < 1e-9);
    /// # Ok::<(), dvrk_io::Error>(())
    /// ```
    pub fn check_sightings(
        &self,
        sightings: &[Sighting],
        options: &CheckOptions,
    ) -> Result<Check, Error> {
        let wrist_from_marker = self.wrist_from_marker.ok_or(Error::NoMarker)?;
        options.check(sightings.len())?;
        let samples = poses::check_samples(sightings)?;
        let compare = |(seen, wrist): &(Isometry3<f64>, Isometry3<f64>)| {
            let expected = self.camera_from_rcm * wrist * wrist_from_marker;
            let (shift, turn) = between(&expected, seen);
            (shift, turn.norm())
        };
        let (shifts, angles): (Vec<_>, Vec<_>) = samples.iter().map(compare).unzip();
        Ok(Check::new(&shifts, angles, *options))
    }
}
