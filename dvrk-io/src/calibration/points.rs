//! The rigid transform between two sets of corresponding points.
//!
//! ```text
//! minimise Σ |c_i − (R·a_i + t)|²      c camera, a arm
//! H = Σ (c_i − c̄)(a_i − ā)ᵀ = U·S·Vᵀ      R = U · diag(1, 1, det(U·Vᵀ)) · Vᵀ      t = c̄ − R·ā
//! ```
//! W. Kabsch, "A solution for the best rotation to relate two sets of vectors", Acta Cryst. A32 (1976). It is
//! the maximum likelihood estimate for isotropic noise.

use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::fit::{Fit, FitOptions, MINIMAL, Residuals, rms, scale, spreads};
use super::robust::{Threshold, consensus};
use crate::Error;
use crate::kinematics::{RcmFromTip, check_pose};

/// A point that the tip touched, as measured by the camera and by the arm.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Touch {
    /// In the camera frame, metres.
    pub camera: Point3<f64>,
    /// In the frame of the remote centre, metres: the position of the tip, not of the wrist.
    pub rcm: Point3<f64>,
}

impl Touch {
    /// A touch of the point `camera` with the tips of the closed jaws at `tip`.
    pub fn new(camera: Point3<f64>, tip: &RcmFromTip) -> Self {
        Self {
            camera,
            rcm: tip.0.translation.vector.into(),
        }
    }
}

/// Factor between distances from which on the units count as different: inches, the plausible unit closest to metres,
/// differ by 39, outliers by less.
pub(super) const UNITS: f64 = 10.0;
/// Points are mirrored if a reflection leaves less than this share of the residuals of the best rotation.
const MIRRORED: f64 = 0.1;

/// Fits `camera_from_rcm` to touched points.
///
/// *Guarantees.* Without outliers the result is the least squares fit. The same samples give the same bits.
///
/// # Errors
/// - [`Error::BadSample`]: a coordinate that is not finite.
/// - [`Error::TooFewSamples`], [`Error::Degenerate`]: too few points, too near to each other, or on a line.
/// - [`Error::ScaleMismatch`], [`Error::Mirrored`]: the two sides are in different units, or of different handedness.
/// - [`Error::TooManyOutliers`]: fewer than half of the samples agree.
/// - [`Error::OutOfRange`]: an option.
///
/// # Complexity
/// O(n log n) for n samples, 300 times.
pub fn fit_touches(touches: &[Touch], options: &FitOptions) -> Result<Fit, Error> {
    options.check(touches.len())?;
    check_samples(touches)?;
    let camera: Vec<Point3<f64>> = touches.iter().map(|touch| touch.camera).collect();
    let rcm: Vec<Point3<f64>> = touches.iter().map(|touch| touch.rcm).collect();
    check_spread(&rcm, options)?;
    if let Some(ratio) = scale(&camera, &rcm)
        && !(1.0 / UNITS..=UNITS).contains(&ratio)
    {
        return Err(Error::ScaleMismatch { ratio });
    }
    check_hand(touches)?;

    let threshold = Threshold {
        ratio: options.outlier_ratio,
        floor: options.outlier_floor,
    };
    let kabsch_of = |chosen: &[usize]| {
        let chosen: Vec<Touch> = chosen.iter().map(|&index| touches[index]).collect();
        kabsch(&chosen)
    };
    let distance = |camera_from_rcm: &Isometry3<f64>, index: usize| {
        let Touch { camera, rcm } = touches[index];
        (camera - camera_from_rcm * rcm).norm()
    };
    let found = consensus(
        touches.len(),
        MINIMAL,
        &threshold,
        kabsch_of,
        kabsch_of,
        distance,
    );
    let (camera_from_rcm, outliers) = found.ok_or(Error::Degenerate {
        what: "spread of the points",
        value: 0.0,
        needed: options.min_spread,
        unit: "m",
    })?;
    let kept = touches.len() - outliers.len();
    if kept < options.min_samples.max(touches.len().div_ceil(2)) {
        return Err(Error::TooManyOutliers {
            outliers: outliers.len(),
            samples: touches.len(),
        });
    }
    let is_kept = |index: &usize| outliers.binary_search(index).is_err();
    let inliers: Vec<Point3<f64>> = (0..touches.len())
        .filter(is_kept)
        .map(|index| rcm[index])
        .collect();
    check_spread(&inliers, options)?;
    let distances = (0..touches.len())
        .map(|index| distance(&camera_from_rcm, index))
        .collect();
    Ok(Fit {
        camera_from_rcm,
        wrist_from_marker: None,
        residuals: Residuals::new(distances, Vec::new(), outliers),
    })
}

/// # Errors
/// The first coordinate that is not finite, with its sample.
pub(super) fn check_samples(touches: &[Touch]) -> Result<(), Error> {
    for (index, touch) in touches.iter().enumerate() {
        for point in [touch.camera, touch.rcm] {
            check_pose(&Translation3::from(point.coords).into()).map_err(|error| {
                Error::BadSample {
                    index,
                    error: Box::new(error),
                }
            })?;
        }
    }
    Ok(())
}

fn check_spread(points: &[Point3<f64>], options: &FitOptions) -> Result<(), Error> {
    let [along, across, _] = spreads(points);
    let parts = [
        ("spread of the touched points", along),
        (
            "spread of the touched points across their best line",
            across,
        ),
    ];
    for (what, value) in parts {
        if value < options.min_spread {
            return Err(Error::Degenerate {
                what,
                value,
                needed: options.min_spread,
                unit: "m",
            });
        }
    }
    Ok(())
}

/// Centroids of both sides, and the sum H of products of the centred points.
fn moments(touches: &[Touch]) -> (Vector3<f64>, Vector3<f64>, Matrix3<f64>) {
    let count = touches.len().max(1) as f64;
    let camera = touches
        .iter()
        .map(|touch| touch.camera.coords)
        .sum::<Vector3<f64>>()
        / count;
    let rcm = touches
        .iter()
        .map(|touch| touch.rcm.coords)
        .sum::<Vector3<f64>>()
        / count;
    let products = touches
        .iter()
        .map(|touch| (touch.camera.coords - camera) * (touch.rcm.coords - rcm).transpose())
        .sum();
    (camera, rcm, products)
}

/// The best rigid transform. `None` if the decomposition fails, which does not happen for finite points.
fn kabsch(touches: &[Touch]) -> Option<Isometry3<f64>> {
    let (camera, rcm, products) = moments(touches);
    let rotation = nearest_rotation(&products)?;
    let translation = Translation3::from(camera - rotation * rcm);
    Some(Isometry3::from_parts(translation, rotation))
}

/// The rotation R that maximises tr(Rᵀ·M).
pub(super) fn nearest_rotation(matrix: &Matrix3<f64>) -> Option<UnitQuaternion<f64>> {
    let svd = matrix.try_svd(true, true, f64::EPSILON, 1_000)?;
    let (u, v_t) = (svd.u?, svd.v_t?);
    let mut hand = Matrix3::identity();
    // nalgebra sorts singular values, so the last direction is the least determined one.
    hand[(2, 2)] = (u * v_t).determinant().signum();
    let rotation = Rotation3::from_matrix_unchecked(u * hand * v_t);
    let rotation = UnitQuaternion::from_rotation_matrix(&rotation);
    Some(UnitQuaternion::new_normalize(rotation.into_inner()))
}

/// # Errors
/// A reflection fits the points, but no rotation does.
fn check_hand(touches: &[Touch]) -> Result<(), Error> {
    let Some(best) = kabsch(touches) else {
        return Ok(());
    };
    // In the frame of one side, the points of the other reflected in their own centroid.
    let (_, rcm, _) = moments(touches);
    let reflected: Vec<Touch> = touches
        .iter()
        .map(|touch| Touch {
            camera: touch.camera,
            rcm: (2.0 * rcm - touch.rcm.coords).into(),
        })
        .collect();
    let Some(mirrored) = kabsch(&reflected) else {
        return Ok(());
    };
    let left = |transform: &Isometry3<f64>, touches: &[Touch]| {
        let distances = touches
            .iter()
            .map(|touch| (touch.camera - transform * touch.rcm).norm());
        rms(&distances.collect::<Vec<f64>>())
    };
    let (turned, flipped) = (left(&best, touches), left(&mirrored, &reflected));
    // A planar set is its own mirror image: then both residuals are only noise.
    let plain = spreads(&touches.iter().map(|touch| touch.rcm).collect::<Vec<_>>())[0];
    if turned > 0.05 * plain && flipped < MIRRORED * turned {
        return Err(Error::Mirrored);
    }
    Ok(())
}
