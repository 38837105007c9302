//! Two poses of an instrument that must not be confused.

use nalgebra::{Isometry3, UnitQuaternion};

use crate::Error;

/// Pose of the wrist frame in the frame of the remote centre: the control point that the robot reports and
/// follows as `local/measured_cp` and `local/setpoint_cp`.
///
/// Origin on the wrist yaw axis, +z along the approach. The simulators of the dVRK's maintainers report the tip
/// instead: with them, a `measured_cp` is a [`RcmFromTip`].
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct RcmFromWrist(pub Isometry3<f64>);

/// Pose of the tips of the closed jaws in the frame of the remote centre, for which grips are planned.
///
/// Same axes as [`RcmFromWrist`], origin one jaw length further along +z.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct RcmFromTip(pub Isometry3<f64>);

/// Larger than any robot: squares of larger coordinates are not computed. Metres.
const FARTHEST: f64 = 1e6;
/// Largest deviation of the norm of a quaternion from 1: accepts a message with 7 digits, rejects a forgotten
/// normalisation.
const QUATERNION_NORM: f64 = 1e-6;

/// `pose` with its quaternion normalised to the last bit.
///
/// # Errors
/// A number that is not finite, a position beyond 10⁶ m, a quaternion that is not a unit.
pub(crate) fn check_pose(pose: &Isometry3<f64>) -> Result<Isometry3<f64>, Error> {
    let position = pose.translation.vector.iter();
    // Ranges contain no NaN.
    if let Some(&value) = position
        .clone()
        .find(|x| !(-FARTHEST..=FARTHEST).contains(*x))
    {
        return Err(Error::OutOfRange {
            what: "position of a pose",
            value,
            expected: "must be finite, metres",
        });
    }
    let norm = pose.rotation.quaternion().norm();
    if !(-QUATERNION_NORM..=QUATERNION_NORM).contains(&(norm - 1.0)) {
        return Err(Error::OutOfRange {
            what: "norm of the quaternion of a pose",
            value: norm,
            expected: "must be 1",
        });
    }
    Ok(Isometry3::from_parts(
        pose.translation,
        UnitQuaternion::new_normalize(*pose.rotation.quaternion()),
    ))
}
