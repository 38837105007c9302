//! The poses of the arm and of the marker on the instrument, from poses of the marker.
//!
//! ```text
//! A_i = X · B_i · Y        A camera_from_marker, B rcm_from_wrist;  X camera_from_rcm, Y wrist_from_marker
//!
//! rotations      R_A · Z · R_Bᵀ = R_X,  Z = R_Yᵀ      ⇒      Σ (R_B ⊗ R_A) · vec Z = n · vec R_X
//!                vec R_X and vec Z are the first singular vectors of T = Σ R_B ⊗ R_A, projected to rotations
//! translations   t_X + R_X·R_B · t_Y = t_A − R_X · t_B      linear in t_X, t_Y
//! refinement     minimise Σ |t_i|² + lever² · |φ_i|²       t_i, φ_i: translation and rotation between X·B_i·Y and A_i
//! ```
//! Closed form: M. Shah, "Solving the robot-world/hand-eye calibration problem using the Kronecker product",
//! J. Mechanisms Robotics 5 (2013). If the wrist rotates only about one axis, the second singular value equals
//! the first. Small rotations of root mean square s_k about axis k give
//! 1 − σ₂/σ₁ = (s₂² + s₃²)/2, by which the rotation is measured here.

use nalgebra::{
    Isometry3, Matrix3, Point3, SMatrix, SVector, Translation3, UnitQuaternion, Vector3,
};

use super::fit::{Fit, FitOptions, MINIMAL, Residuals};
use super::points::{UNITS, nearest_rotation};
use super::robust::{Threshold, consensus};
use crate::Error;
use crate::kinematics::{RcmFromWrist, check_pose};

/// A sighting of the marker by the camera, with the pose of the arm at that moment.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Sighting {
    /// Pose of the marker in the camera frame.
    pub camera_from_marker: Isometry3<f64>,
    /// Pose of the wrist, as in `local/measured_cp`.
    pub rcm_from_wrist: RcmFromWrist,
}

/// X and Y.
#[derive(Debug, Clone, Copy)]
struct Model {
    camera_from_rcm: Isometry3<f64>,
    wrist_from_marker: Isometry3<f64>,
}

/// Least motion of the wrist (root mean square) that determines the units, metres.
const LEAST_MOTION: f64 = 0.005;
/// Size of the subsets in the search for outliers: three poses with noise often rotate too little.
const SUBSET: usize = 4;
/// Convergence is quadratic, and takes about five steps from the closed form.
const STEPS: usize = 30;

/// Fits `camera_from_rcm` and `wrist_from_marker` to sightings of a marker fixed to the instrument, beyond the
/// wrist yaw joint or anywhere that is rigid to the wrist frame.
///
/// Closed form first, then least squares with angles weighted by [`FitOptions::lever`].
///
/// *Guarantees.* Without noise the result is exact. The same samples give the same bits.
///
/// # Errors
/// - [`Error::BadSample`]: a pose that is not finite or whose quaternion is not a unit.
/// - [`Error::TooFewSamples`]; [`Error::Degenerate`]: the wrist rotates too little, or about one axis only.
/// - [`Error::ScaleMismatch`]: camera and arm are in different units.
/// - [`Error::TooManyOutliers`]: fewer than half of the samples agree.
/// - [`Error::OutOfRange`]: an option.
///
/// # Complexity
/// O(n log n) for n samples, 300 times.
///
/// ```
/// use dvrk_io::calibration::{FitOptions, Sighting, fit_sightings};
/// use dvrk_io::kinematics::RcmFromWrist;
/// use dvrk_io::nalgebra::{Isometry3, Vector3};
///
/// // Eight poses of the wrist, and the marker as a camera at a planted pose sees it.
/// let planted = Isometry3::new(Vector3::new(0.1, 0.0, 0.4), Vector3::new(0.5, 0.2, 1.0));
/// let wrist_from_marker = Isometry3::new(Vector3::new(0.0, 0.01, 0.02), Vector3::new(0.1, 0.2, 0.3));
/// # let wave = |t: f64| Vector3::new(t.sin(), (2.0 * t).cos(), (3.0 * t).sin());
/// let sighting = |t: f64| {
///     let wrist = Isometry3::new(wave(1.3 * t) * 0.05, wave(t) * 0.6);
///     let camera_from_marker = planted * wrist * wrist_from_marker;
///     Sighting { camera_from_marker, rcm_from_wrist: RcmFromWrist(wrist) }
/// };
/// let sightings: Vec<Sighting> = (0..8).map(|i| sighting(f64::from(i))).collect();
/// let fit = fit_sightings(&sightings, &FitOptions::default())?;
/// assert!((fit.camera_from_rcm.translation.vector - planted.translation.vector).norm() < 1e-9);
/// assert!(fit.camera_from_rcm.rotation.angle_to(&planted.rotation) < 1e-6);
/// # Ok::<(), dvrk_io::Error>(())
/// ```
pub fn fit_sightings(sightings: &[Sighting], options: &FitOptions) -> Result<Fit, Error> {
    options.check(sightings.len())?;
    let samples = check_samples(sightings)?;
    let everything: Vec<usize> = (0..samples.len()).collect();
    check_turning(&samples, &everything, options)?;
    let threshold = Threshold {
        ratio: options.outlier_ratio,
        floor: options.outlier_floor,
    };
    let pick =
        |chosen: &[usize]| -> Vec<Pair> { chosen.iter().map(|&index| samples[index]).collect() };
    let found = consensus(
        samples.len(),
        SUBSET,
        &threshold,
        |chosen| closed_form(&pick(chosen)),
        |chosen| {
            closed_form(&pick(chosen)).map(|start| refine(&pick(chosen), start, options.lever))
        },
        |model, index| {
            let (shift, turn) = misfit(model, &samples[index]);
            shift.norm().hypot(options.lever * turn.norm())
        },
    );
    let (model, outliers) = found.ok_or_else(|| turning_error(0.0, options))?;
    let kept: Vec<usize> = everything
        .into_iter()
        .filter(|index| outliers.binary_search(index).is_err())
        .collect();
    if let Some(ratio) = wrong_unit(&pick(&kept)) {
        return Err(Error::ScaleMismatch { ratio });
    }
    if kept.len()
        < options
            .min_samples
            .max(samples.len().div_ceil(2))
            .max(MINIMAL)
    {
        return Err(Error::TooManyOutliers {
            outliers: outliers.len(),
            samples: samples.len(),
        });
    }
    check_turning(&samples, &kept, options)?;
    let misfits = samples.iter().map(|sample| misfit(&model, sample));
    let (distances, angles) = misfits
        .map(|(shift, turn)| (shift.norm(), turn.norm()))
        .unzip();
    Ok(Fit {
        camera_from_rcm: model.camera_from_rcm,
        wrist_from_marker: Some(model.wrist_from_marker),
        residuals: Residuals::new(distances, angles, outliers),
    })
}

/// A and B of one sighting, checked.
type Pair = (Isometry3<f64>, Isometry3<f64>);

/// # Errors
/// The first invalid pose, with its sample.
pub(super) fn check_samples(sightings: &[Sighting]) -> Result<Vec<Pair>, Error> {
    let check = |(index, sighting): (usize, &Sighting)| {
        let pair = check_pose(&sighting.camera_from_marker)
            .and_then(|seen| Ok((seen, check_pose(&sighting.rcm_from_wrist.0)?)));
        pair.map_err(|error| Error::BadSample {
            index,
            error: Box::new(error),
        })
    };
    sightings.iter().enumerate().map(check).collect()
}

/// The factor s of t_X + R_X·R_B·t_Y + s·R_X·t_B = t_A, by least squares, if it shows that camera and arm are in
/// different units: far from 1, and with a far better fit than 1.
fn wrong_unit(samples: &[Pair]) -> Option<f64> {
    let rotation_x = closed_form(samples)?.camera_from_rcm.rotation;
    let mut normal = SMatrix::<f64, 6, 6>::zeros();
    let (mut cross, mut right) = (SVector::<f64, 6>::zeros(), SVector::<f64, 6>::zeros());
    let (mut own, mut product, mut seen) = (0.0, 0.0, 0.0);
    for (a, b) in samples {
        let rows = shift_rows(&rotation_x, b);
        let (place, moved) = (a.translation.vector, rotation_x * b.translation.vector);
        normal += rows.transpose() * rows;
        cross += rows.transpose() * moved;
        right += rows.transpose() * place;
        own += moved.norm_squared();
        product += moved.dot(&place);
        seen += place.norm_squared();
    }
    // The parts not explained by t_X and t_Y: of the motion of the wrist, of its product with the positions, of the positions.
    let factor = normal.cholesky()?;
    let own = own - cross.dot(&factor.solve(&cross));
    let product = product - cross.dot(&factor.solve(&right));
    let seen = seen - right.dot(&factor.solve(&right));
    if own < LEAST_MOTION * LEAST_MOTION * samples.len() as f64 {
        return None;
    }
    let ratio = product / own;
    let (left, gained) = (seen - ratio * product, own * (ratio - 1.0).powi(2));
    let is_other = !(1.0 / UNITS..=UNITS).contains(&ratio.abs()) && gained > 10.0 * left;
    is_other.then_some(ratio)
}

/// The matrix of t_X, t_Y in t_X + R_X·R_B·t_Y.
fn shift_rows(rotation_x: &UnitQuaternion<f64>, b: &Isometry3<f64>) -> SMatrix<f64, 3, 6> {
    let mut rows = SMatrix::<f64, 3, 6>::zeros();
    rows.fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
    let turn = *(rotation_x * b.rotation).to_rotation_matrix().matrix();
    rows.fixed_view_mut::<3, 3>(0, 3).copy_from(&turn);
    rows
}

/// Translation and rotation from the expected to the measured pose of the marker, camera axes.
pub(super) fn between(
    expected: &Isometry3<f64>,
    seen: &Isometry3<f64>,
) -> (Vector3<f64>, Vector3<f64>) {
    let turn = (seen.rotation * expected.rotation.inverse()).scaled_axis();
    (seen.translation.vector - expected.translation.vector, turn)
}

fn misfit(model: &Model, (seen, wrist): &Pair) -> (Vector3<f64>, Vector3<f64>) {
    between(
        &(model.camera_from_rcm * wrist * model.wrist_from_marker),
        seen,
    )
}

fn kronecker_sum(samples: &[Pair]) -> SMatrix<f64, 9, 9> {
    let matrix = |pose: &Isometry3<f64>| *pose.rotation.to_rotation_matrix().matrix();
    samples
        .iter()
        .map(|(a, b)| matrix(b).kronecker(&matrix(a)))
        .sum()
}

fn check_turning(samples: &[Pair], kept: &[usize], options: &FitOptions) -> Result<(), Error> {
    let kept: Vec<Pair> = kept.iter().map(|&index| samples[index]).collect();
    let values = kronecker_sum(&kept).singular_values();
    let turning = (2.0 * (1.0 - values[1] / values[0].max(f64::MIN_POSITIVE)))
        .max(0.0)
        .sqrt();
    if turning < options.min_turning {
        return Err(turning_error(turning, options));
    }
    Ok(())
}

fn turning_error(value: f64, options: &FitOptions) -> Error {
    Error::Degenerate {
        what: "turning of the wrist about a second axis",
        value,
        needed: options.min_turning,
        unit: "rad",
    }
}

/// `None` if the poses do not determine the transforms.
fn closed_form(samples: &[Pair]) -> Option<Model> {
    let svd = kronecker_sum(samples).try_svd(true, true, f64::EPSILON, 1_000)?;
    let (u, v_t) = (svd.u?, svd.v_t?);
    let x = Matrix3::from_iterator(u.column(0).iter().copied());
    let z = Matrix3::from_iterator(v_t.row(0).iter().copied());
    // Singular vectors have an arbitrary common sign; rotations do not.
    let hand = x.determinant().signum();
    let rotation_x = nearest_rotation(&(x * hand))?;
    let rotation_y = nearest_rotation(&(z * hand))?.inverse();

    let mut normal = SMatrix::<f64, 6, 6>::zeros();
    let mut right = SVector::<f64, 6>::zeros();
    for (a, b) in samples {
        let rest = a.translation.vector - rotation_x * b.translation.vector;
        let rows = shift_rows(&rotation_x, b);
        normal += rows.transpose() * rows;
        right += rows.transpose() * rest;
    }
    let shifts = normal.cholesky()?.solve(&right);
    let shift = |row: usize| Translation3::new(shifts[row], shifts[row + 1], shifts[row + 2]);
    let model = Model {
        camera_from_rcm: Isometry3::from_parts(shift(0), rotation_x),
        wrist_from_marker: Isometry3::from_parts(shift(3), rotation_y),
    };
    shifts
        .iter()
        .all(|value| value.is_finite())
        .then_some(model)
}

/// Levenberg–Marquardt from `start`; never worse than it.
///
/// With rotations applied on the left, R ← exp(δ)·R, the rotation from expected to measured changes by −J⁻¹(φ)·(δ_X + R_X·R_B·δ_Y),
/// J the Jacobian of the exponential map. Using the identity for J leaves the gradient exact, as J⁻ᵀ(φ)·φ = φ.
fn refine(samples: &[Pair], start: Model, lever: f64) -> Model {
    let cost = |model: &Model| -> f64 {
        let misfits = samples.iter().map(|sample| misfit(model, sample));
        misfits
            .map(|(shift, turn)| shift.norm_squared() + lever * lever * turn.norm_squared())
            .sum()
    };
    let (mut model, mut least) = (start, cost(&start));
    let mut damping = 1e-9;
    for _ in 0..STEPS {
        let (normal, right) = normal_equations(samples, &model, lever);
        let mut damped = normal;
        for k in 0..12 {
            damped[(k, k)] += damping * normal[(k, k)].max(f64::MIN_POSITIVE);
        }
        let Some(factor) = damped.cholesky() else {
            break;
        };
        let step: SVector<f64, 12> = factor.solve(&right);
        let next = moved(&model, &step);
        let now = cost(&next);
        // Written so that a NaN cost is no improvement.
        if now < least {
            let gain = (least - now) / least;
            (model, least) = (next, now);
            damping = (damping * 0.1_f64).max(1e-12);
            if gain < 1e-14 {
                break;
            }
        } else {
            damping *= 100.0;
            if damping > 1e6 {
                break;
            }
        }
    }
    model
}

/// Columns: rotation and translation of X, rotation and translation of Y.
fn normal_equations(
    samples: &[Pair],
    model: &Model,
    lever: f64,
) -> (SMatrix<f64, 12, 12>, SVector<f64, 12>) {
    let mut normal = SMatrix::<f64, 12, 12>::zeros();
    let mut right = SVector::<f64, 12>::zeros();
    let Model {
        camera_from_rcm: x,
        wrist_from_marker: y,
    } = model;
    for sample in samples {
        let (_, b) = sample;
        let (shift, turn) = misfit(model, sample);
        let carried = *(x.rotation * b.rotation).to_rotation_matrix().matrix();
        let arm = x.rotation * (b * Point3::from(y.translation.vector)).coords;
        let mut rows = SMatrix::<f64, 6, 12>::zeros();
        rows.fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&-arm.cross_matrix());
        rows.fixed_view_mut::<3, 3>(0, 3).fill_with_identity();
        rows.fixed_view_mut::<3, 3>(0, 9).copy_from(&carried);
        rows.fixed_view_mut::<3, 3>(3, 0).fill_diagonal(lever);
        rows.fixed_view_mut::<3, 3>(3, 6)
            .copy_from(&(lever * carried));
        let mut rest = SVector::<f64, 6>::zeros();
        rest.fixed_rows_mut::<3>(0).copy_from(&shift);
        rest.fixed_rows_mut::<3>(3).copy_from(&(lever * turn));
        normal += rows.transpose() * rows;
        right += rows.transpose() * rest;
    }
    (normal, right)
}

fn moved(model: &Model, step: &SVector<f64, 12>) -> Model {
    let part = |row: usize| Vector3::new(step[row], step[row + 1], step[row + 2]);
    let apply = |pose: &Isometry3<f64>, turn: Vector3<f64>, shift: Vector3<f64>| {
        let rotation = UnitQuaternion::from_scaled_axis(turn) * pose.rotation;
        let rotation = UnitQuaternion::new_normalize(rotation.into_inner());
        Isometry3::from_parts((pose.translation.vector + shift).into(), rotation)
    };
    Model {
        camera_from_rcm: apply(&model.camera_from_rcm, part(0), part(3)),
        wrist_from_marker: apply(&model.wrist_from_marker, part(6), part(9)),
    }
}
