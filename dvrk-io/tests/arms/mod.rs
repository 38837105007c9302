//! Arms and joint values for the tests of kinematics.
#![allow(dead_code, reason = "each test uses a part")]

use dvrk_io::kinematics::{Kinematics, Unreachable};
use dvrk_io::{Error, Psm};
use nalgebra::Isometry3;

/// Distance from the remote centre to the wrist pitch axis is the insertion less this, both generations.
pub const WRIST_BEFORE_INSERTION: f64 = 0.0156;
pub const GENERATIONS: [Psm; 2] = [Psm::Classic, Psm::Si];

/// Joint values from shares of the ranges, with the wrist beyond the least distance.
pub fn joints_at(arm: &Kinematics, shares: [f64; 6]) -> [f64; 6] {
    let mut joints: [f64; 6] = std::array::from_fn(|i| {
        let [lower, upper] = arm.limits()[i];
        (lower + shares[i] * (upper - lower)).clamp(lower, upper)
    });
    let least = arm.min_wrist_distance() + WRIST_BEFORE_INSERTION;
    let most = arm.limits()[2][1];
    joints[2] = (least + shares[2] * (most - least)).clamp(least, most);
    joints
}

pub fn gap(left: &Isometry3<f64>, right: &Isometry3<f64>) -> f64 {
    // Matrices, not angles: an angle near 0 has only half the digits.
    let turn =
        left.rotation.to_rotation_matrix().matrix() - right.rotation.to_rotation_matrix().matrix();
    (left.translation.vector - right.translation.vector)
        .norm()
        .max(turn.norm())
}

pub fn reason<T: std::fmt::Debug>(result: Result<T, Error>) -> Unreachable {
    match result {
        Err(Error::Unreachable(reason)) => reason,
        other => panic!("expected a reason, got {other:?}"),
    }
}
