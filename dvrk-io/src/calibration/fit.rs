//! Options and results of a fit.

use derive_setters::Setters;
use nalgebra::{Isometry3, Point3, Vector3};

use super::Method;
use crate::Error;

/// Requirements on the samples of a fit.
#[derive(Debug, Clone, Copy, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct FitOptions {
    /// Least number of inliers. Default 4; at least 3.
    pub min_samples: usize,
    /// Least spread of touched points (root mean square) along and across their best line, metres. Default
    /// 0.02: a patch of about 7 cm. At a distance D from their centre, n touches with noise σ determine positions to
    /// about σ·D / (spread·√n).
    pub min_spread: f64,
    /// Least rotation of the wrist among sightings about axes other than the main one (root
    /// mean square), radians. Default 0.17 (10°).
    pub min_turning: f64,
    /// A sample is an outlier if its residual is this many times the median. Default 4: with normal noise one
    /// sample in a million.
    pub outlier_ratio: f64,
    /// Smaller residuals are never outliers, metres. Default 0.0001, below the resolution of arm and camera.
    pub outlier_floor: f64,
    /// Length by which an angle of a sighting is converted to a distance, metres. Default 0.05, which weighs a marker's orientation
    /// known to 1° like a position known to 1 mm.
    pub lever: f64,
}

impl Default for FitOptions {
    fn default() -> Self {
        Self {
            min_samples: 4,
            min_spread: 0.02,
            min_turning: 0.17,
            outlier_ratio: 4.0,
            outlier_floor: 1e-4,
            lever: 0.05,
        }
    }
}

impl FitOptions {
    /// Checks that each number is in the range in which the fit is defined.
    pub(super) fn check(&self, samples: usize) -> Result<(), Error> {
        let ranges = [
            ("least spread", self.min_spread, 1e-6, 1e3),
            ("least turning", self.min_turning, 1e-4, 2.0),
            ("outlier ratio", self.outlier_ratio, 2.0, 1e9),
            ("outlier floor", self.outlier_floor, 1e-9, 1e3),
            ("lever", self.lever, 1e-4, 1e3),
        ];
        for (what, value, least, most) in ranges {
            if !(least..=most).contains(&value) {
                return Err(Error::OutOfRange {
                    what,
                    value,
                    expected: "must be finite and positive, see `FitOptions`",
                });
            }
        }
        let needed = self.min_samples.max(MINIMAL);
        if samples < needed {
            return Err(Error::TooFewSamples {
                given: samples,
                needed,
            });
        }
        Ok(())
    }
}

/// Fewer samples do not determine either problem.
pub(super) const MINIMAL: usize = 3;

/// A rigid transform fitted to samples.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct Fit {
    /// Pose of the arm's remote centre in the camera frame.
    pub camera_from_rcm: Isometry3<f64>,
    /// Pose of the marker on the instrument, in the wrist frame: for sightings.
    pub wrist_from_marker: Option<Isometry3<f64>>,
    /// The residuals of the samples.
    pub residuals: Residuals,
}

impl Fit {
    /// The kind of samples.
    pub fn method(&self) -> Method {
        match self.wrist_from_marker {
            Some(_) => Method::Sightings,
            None => Method::Touches,
        }
    }
}

/// Residuals of the samples.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct Residuals {
    /// Distance between the measured and the expected position, for every sample in order, metres.
    pub distances: Vec<f64>,
    /// Angle between the measured and the expected orientation, for every sighting, radians; empty for
    /// touches.
    pub angles: Vec<f64>,
    /// Indices of the outliers, in order. They are not used in the fit. With up to four touches
    /// or five sightings none is reported: with one sample too many, a disagreement cannot be attributed.
    pub outliers: Vec<usize>,
    /// Root mean square of the distances without outliers, metres.
    pub rms: f64,
    /// Largest distance without outliers, metres.
    pub max: f64,
    /// Root mean square of the angles without outliers, radians; 0 for touches.
    pub rms_angle: f64,
    /// Largest angle without outliers, radians; 0 for touches.
    pub max_angle: f64,
}

impl Residuals {
    pub(super) fn new(distances: Vec<f64>, angles: Vec<f64>, outliers: Vec<usize>) -> Self {
        let kept = |values: &[f64]| -> Vec<f64> {
            let of_sample = values.iter().enumerate();
            let inliers = of_sample.filter(|(index, _)| outliers.binary_search(index).is_err());
            inliers.map(|(_, &value)| value).collect()
        };
        let (near, small) = (kept(&distances), kept(&angles));
        Self {
            rms: rms(&near),
            max: max(&near),
            rms_angle: rms(&small),
            max_angle: max(&small),
            distances,
            angles,
            outliers,
        }
    }
}

/// Root mean square; 0 for no values.
pub(super) fn rms(values: &[f64]) -> f64 {
    // An empty sum is −0.
    let sum = values
        .iter()
        .map(|value| value * value)
        .fold(0.0, |sum, square| sum + square);
    (sum / values.len().max(1) as f64).sqrt()
}

pub(super) fn max(values: &[f64]) -> f64 {
    values.iter().copied().fold(0.0, f64::max)
}

/// The median; 0 for no values.
pub(super) fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(0.0)
}

/// Distances in the camera over distances at the arm, the median over pairs of samples: 1 if both are in
/// metres. Pairs closer than 5 mm are dominated by noise and ignored. `None` without pairs.
pub(super) fn scale(camera: &[Point3<f64>], rcm: &[Point3<f64>]) -> Option<f64> {
    let count = camera.len();
    let ratios: Vec<f64> = [count / 2, count / 3]
        .into_iter()
        .flat_map(|apart| (0..count).map(move |i| (i, (i + apart) % count)))
        .map(|(i, j)| ((camera[i] - camera[j]).norm(), (rcm[i] - rcm[j]).norm()))
        .filter(|pair| pair.0 > 0.005 || pair.1 > 0.005)
        .map(|(seen, moved)| seen / moved.max(1e-9))
        .collect();
    (!ratios.is_empty()).then(|| median(&ratios))
}

/// Lengths of the half axes of a set of points (root mean square along each), largest first.
pub(super) fn spreads(points: &[Point3<f64>]) -> [f64; 3] {
    let count = points.len().max(1) as f64;
    let middle = points
        .iter()
        .map(|point| point.coords)
        .sum::<Vector3<f64>>()
        / count;
    let covariance = points
        .iter()
        .map(|point| point.coords - middle)
        .map(|arm| arm * arm.transpose())
        .sum::<nalgebra::Matrix3<f64>>();
    let mut values = covariance
        .symmetric_eigenvalues()
        .map(|value| (value.max(0.0) / count).sqrt());
    values
        .as_mut_slice()
        .sort_by(|left, right| right.total_cmp(left));
    values.into()
}
