//! What a fit is asked for and what it answers.

use nalgebra::{Isometry3, Point3, Vector3};

use super::Method;
use crate::Error;

/// What a fit demands of its samples.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct FitOptions {
    /// Least number of samples that must agree. Default 4; at least 3.
    pub min_samples: usize,
    /// Least spread of touched points (root mean square) along their best line and across it, metres. Default
    /// 0.02: a patch of about 7 cm. At a distance D from their middle, n touches with noise σ place the arm to
    /// about σ·D / (spread·√n).
    pub min_spread: f64,
    /// Least turning of the wrist among sightings, about axes other than the one it turns most about (root
    /// mean square), radians. Default 0.17 (10°).
    pub min_turning: f64,
    /// A sample is an outlier if its residual is this many times the median. Default 4: with normal noise one
    /// sample in a million.
    pub outlier_ratio: f64,
    /// No residual below this makes an outlier, metres. Default 0.0001, what neither arm nor camera resolves.
    pub outlier_floor: f64,
    /// Length at which an angle of a sighting counts as a distance, metres. Default 0.05: a marker whose angle
    /// is seen to 1° and whose place to 1 mm has both weighed alike.
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
    /// Sets [`FitOptions::min_samples`].
    #[must_use]
    pub fn with_min_samples(self, min_samples: usize) -> Self {
        Self {
            min_samples,
            ..self
        }
    }

    /// Sets [`FitOptions::min_spread`], metres.
    #[must_use]
    pub fn with_min_spread(self, min_spread: f64) -> Self {
        Self { min_spread, ..self }
    }

    /// Sets [`FitOptions::min_turning`], radians.
    #[must_use]
    pub fn with_min_turning(self, min_turning: f64) -> Self {
        Self {
            min_turning,
            ..self
        }
    }

    /// Sets [`FitOptions::outlier_ratio`].
    #[must_use]
    pub fn with_outlier_ratio(self, outlier_ratio: f64) -> Self {
        Self {
            outlier_ratio,
            ..self
        }
    }

    /// Sets [`FitOptions::outlier_floor`], metres.
    #[must_use]
    pub fn with_outlier_floor(self, outlier_floor: f64) -> Self {
        Self {
            outlier_floor,
            ..self
        }
    }

    /// Sets [`FitOptions::lever`], metres.
    #[must_use]
    pub fn with_lever(self, lever: f64) -> Self {
        Self { lever, ..self }
    }

    /// Each number in the range in which the fit is what its name says.
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

/// Fewer samples determine neither problem.
pub(super) const MINIMAL: usize = 3;

/// A rigid transform fitted to samples.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Fit {
    /// Pose of the arm's remote centre in the camera frame.
    pub camera_from_rcm: Isometry3<f64>,
    /// Pose of the marker on the instrument, in the wrist frame: for sightings.
    pub wrist_from_marker: Option<Isometry3<f64>>,
    /// What it leaves of the samples.
    pub residuals: Residuals,
}

impl Fit {
    /// What the samples were.
    pub fn method(&self) -> Method {
        match self.wrist_from_marker {
            Some(_) => Method::Sightings,
            None => Method::Touches,
        }
    }
}

/// How far samples are from a fit.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Residuals {
    /// Distance between the place seen and the place expected, for every sample in order, metres.
    pub distances: Vec<f64>,
    /// Angle between the orientation seen and the one expected, for every sighting, radians; empty for
    /// touches.
    pub angles: Vec<f64>,
    /// Which samples do not agree with the others, in order. They have no part in the fit. Of up to four touches
    /// or five sightings none is named: one too many can disagree, but not say with whom.
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

/// Root mean square; 0 of nothing.
pub(super) fn rms(values: &[f64]) -> f64 {
    // The sum of nothing is −0.
    let sum = values
        .iter()
        .map(|value| value * value)
        .fold(0.0, |sum, square| sum + square);
    (sum / values.len().max(1) as f64).sqrt()
}

pub(super) fn max(values: &[f64]) -> f64 {
    values.iter().copied().fold(0.0, f64::max)
}

/// The middle value; 0 of nothing.
pub(super) fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(0.0)
}

/// Distances in the camera over distances at the arm, the median over pairs of samples: 1 if both are in
/// metres. Pairs nearer than 5 mm say more of noise than of units. `None` without pairs.
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
