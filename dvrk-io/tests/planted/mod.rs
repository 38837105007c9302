//! Samples of calibrations whose answer is known, for the tests of calibration.
#![allow(dead_code, reason = "each test uses a part")]

use std::f64::consts::TAU;

use dvrk_io::Psm;
use dvrk_io::calibration::{Fit, FitOptions, Sighting, Touch, fit_sightings, fit_touches};
use dvrk_io::kinematics::Kinematics;
use nalgebra::{Isometry3, Point3, Quaternion, UnitQuaternion, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Standard normal, Box–Muller.
pub fn normal(random: &mut ChaCha8Rng) -> f64 {
    let (u, v): (f64, f64) = (
        random.random_range(f64::MIN_POSITIVE..1.0),
        random.random_range(0.0..TAU),
    );
    (-2.0 * u.ln()).sqrt() * v.cos()
}

pub fn normals(random: &mut ChaCha8Rng) -> Vector3<f64> {
    Vector3::from_fn(|_, _| normal(random))
}

pub fn any_transform(random: &mut ChaCha8Rng) -> Isometry3<f64> {
    let turn = UnitQuaternion::new_normalize(Quaternion::from_vector(nalgebra::Vector4::from_fn(
        |_, _| normal(random),
    )));
    Isometry3::from_parts((0.3 * normals(random)).into(), turn)
}

/// Touches all over the workspace of a Classic.
pub fn touches(
    random: &mut ChaCha8Rng,
    planted: &Isometry3<f64>,
    count: usize,
    noise: f64,
) -> Vec<Touch> {
    (0..count)
        .map(|_| {
            let rcm = Point3::new(
                random.random_range(-0.08..0.08),
                random.random_range(-0.08..0.08),
                random.random_range(-0.2..-0.1),
            );
            Touch {
                camera: planted * rcm + noise * normals(random),
                rcm,
            }
        })
        .collect()
}

/// Joint values all over the workspace of a Classic; the last two within ±`wrist`.
pub fn any_joints(random: &mut ChaCha8Rng, wrist: f64) -> [f64; 6] {
    let mut share = |range: f64| random.random_range(-range..range);
    [
        share(0.5),
        share(0.5),
        0.14 + share(0.05),
        share(1.0),
        share(wrist),
        share(wrist),
    ]
}

/// Sightings from joint values all over the workspace, noise in place (m) and orientation (rad).
pub fn sightings(
    random: &mut ChaCha8Rng,
    planted: &[Isometry3<f64>; 2],
    count: usize,
    noise: [f64; 2],
) -> Vec<Sighting> {
    let arm = Kinematics::new(Psm::Classic);
    let [camera_from_rcm, wrist_from_marker] = planted;
    (0..count)
        .map(|_| {
            let rcm_from_wrist = arm.rcm_from_wrist(&any_joints(random, 0.8)).unwrap();
            let exact = camera_from_rcm * rcm_from_wrist.0 * wrist_from_marker;
            let turn =
                UnitQuaternion::from_scaled_axis(noise[1] * normals(random)) * exact.rotation;
            let shift = exact.translation.vector + noise[0] * normals(random);
            Sighting {
                camera_from_marker: Isometry3::from_parts(shift.into(), turn),
                rcm_from_wrist,
            }
        })
        .collect()
}

/// Distance of the places where two transforms put the middle of the workspace, and the angle between them.
pub fn gap(left: &Isometry3<f64>, right: &Isometry3<f64>) -> (f64, f64) {
    let middle = Point3::new(0.0, 0.0, -0.15);
    (
        (left * middle - right * middle).norm(),
        left.rotation.angle_to(&right.rotation),
    )
}

pub fn fit_of_touches() -> Fit {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let planted = any_transform(&mut random);
    let samples = touches(&mut random, &planted, 12, 5e-4);
    fit_touches(&samples, &FitOptions::default()).unwrap()
}

pub fn fit_of_sightings() -> Fit {
    let mut random = ChaCha8Rng::seed_from_u64(2);
    let planted = [any_transform(&mut random), any_transform(&mut random)];
    let samples = sightings(&mut random, &planted, 12, [5e-4, 5e-3]);
    fit_sightings(&samples, &FitOptions::default()).unwrap()
}
