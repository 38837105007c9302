//! From joint values to poses and velocities.
//!
//! ```text
//! rcm_from_i = Π_{k ≤ i} RotX(α_k) · TransX(a_k) · RotZ(θ_k) · TransZ(d_k)          modified Denavit–Hartenberg
//!
//! joint        α      a        θ            d
//! yaw          π/2    0        q1 + π/2     0
//! pitch       −π/2    0        q2 − π/2     0
//! insertion    π/2    0        0            q3 − carriage
//! roll         0      0        q4           shaft
//! wrist pitch −π/2    0        q5 − π/2     0
//! wrist yaw   −π/2    wrist    q6 − π/2     0
//!
//!                               ⎡ 0 −1  0⎤
//! rcm_from_wrist = rcm_from_6 · ⎢ 0  0  1⎥
//!                               ⎣−1  0  0⎦
//!
//! column j of the Jacobian    (z_j × (p − o_j), z_j)   turning joint about z_j through o_j
//!                             (z_j, 0)                 insertion
//! ```

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Isometry3, Matrix3, Matrix6, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::{Joint, Kinematics, RcmFromTip, RcmFromWrist};
use crate::Error;

impl Kinematics {
    /// Pose of the control point for joint values in the order of [`Joint::ALL`], radians (insertion in metres).
    /// Joint limits are not checked: see [`Kinematics::margins`].
    ///
    /// # Errors
    /// A joint value that is not finite.
    pub fn rcm_from_wrist(&self, joints: &[f64; 6]) -> Result<RcmFromWrist, Error> {
        check_joints(joints)?;
        let [.., rcm_from_last] = self.frames(joints);
        Ok(RcmFromWrist(rcm_from_last * last_from_wrist()))
    }

    /// Pose of the tips of the closed jaws.
    ///
    /// # Errors
    /// A joint value that is not finite.
    pub fn rcm_from_tip(&self, joints: &[f64; 6]) -> Result<RcmFromTip, Error> {
        Ok(self.tip_of(&self.rcm_from_wrist(joints)?))
    }

    /// The pose of the tips of the closed jaws for a pose of the control point.
    pub fn tip_of(&self, wrist: &RcmFromWrist) -> RcmFromTip {
        RcmFromTip(wrist.0 * Translation3::new(0.0, 0.0, self.instrument.jaw))
    }

    /// The pose of the control point for a pose of the tips of the closed jaws: the pose to command.
    pub fn wrist_of(&self, tip: &RcmFromTip) -> RcmFromWrist {
        RcmFromWrist(tip.0 * Translation3::new(0.0, 0.0, -self.instrument.jaw))
    }

    /// Velocity of the control point (rows 0–2, m/s) and angular velocity (rows 3–5, rad/s), axes of the
    /// remote centre, for unit speed of each joint.
    ///
    /// Its determinant is ± r · cos q2 · (r · cos q5 + wrist), r the distance of the wrist pitch axis from the
    /// remote centre: the singularities that [`Margins`](super::Margins) measures.
    ///
    /// # Errors
    /// A joint value that is not finite.
    ///
    /// ```
    /// use dvrk_io::Psm;
    /// use dvrk_io::kinematics::Kinematics;
    ///
    /// // The same as the difference quotient of the positions.
    /// let arm = Kinematics::new(Psm::Classic);
    /// let joints = [0.2, -0.3, 0.15, 0.4, -0.5, 0.6];
    /// let jacobian = arm.wrist_jacobian(&joints)?;
    /// for joint in 0..6 {
    ///     let (mut more, mut less) = (joints, joints);
    ///     more[joint] += 1e-5;
    ///     less[joint] -= 1e-5;
    ///     let (more, less) = (arm.rcm_from_wrist(&more)?.0, arm.rcm_from_wrist(&less)?.0);
    ///     let velocity = (more.translation.vector - less.translation.vector) / 2e-5;
    ///     assert!((velocity - jacobian.fixed_view::<3, 1>(0, joint)).norm() < 1e-8);
    /// }
    /// # Ok::<(), dvrk_io::Error>(())
    /// ```
    pub fn wrist_jacobian(&self, joints: &[f64; 6]) -> Result<Matrix6<f64>, Error> {
        self.jacobian_at(joints, 0.0)
    }

    /// As [`Kinematics::wrist_jacobian`], with the velocity of the tips of the closed jaws.
    ///
    /// # Errors
    /// A joint value that is not finite.
    pub fn tip_jacobian(&self, joints: &[f64; 6]) -> Result<Matrix6<f64>, Error> {
        self.jacobian_at(joints, self.instrument.jaw)
    }

    /// Jacobian of the point `ahead` of the control point along the approach.
    fn jacobian_at(&self, joints: &[f64; 6], ahead: f64) -> Result<Matrix6<f64>, Error> {
        check_joints(joints)?;
        let frames = self.frames(joints);
        let rcm_from_wrist = frames[5] * last_from_wrist();
        let point = (rcm_from_wrist * Translation3::new(0.0, 0.0, ahead))
            .translation
            .vector;
        let mut jacobian = Matrix6::zeros();
        for (index, frame) in frames.iter().enumerate() {
            let axis = frame.rotation * Vector3::z();
            let (linear, angular) = match Joint::ALL[index] {
                Joint::Insertion => (axis, Vector3::zeros()),
                _ => (axis.cross(&(point - frame.translation.vector)), axis),
            };
            jacobian.fixed_view_mut::<3, 1>(0, index).copy_from(&linear);
            jacobian
                .fixed_view_mut::<3, 1>(3, index)
                .copy_from(&angular);
        }
        Ok(jacobian)
    }

    /// Frames after each joint, in that of the remote centre.
    pub(crate) fn frames(&self, joints: &[f64; 6]) -> [Isometry3<f64>; 6] {
        let [yaw, pitch, insertion, roll, wrist_pitch, wrist_yaw] = *joints;
        let links = [
            (FRAC_PI_2, 0.0, yaw + FRAC_PI_2, 0.0),
            (-FRAC_PI_2, 0.0, pitch - FRAC_PI_2, 0.0),
            (FRAC_PI_2, 0.0, 0.0, insertion - self.carriage),
            (0.0, 0.0, roll, self.instrument.shaft),
            (-FRAC_PI_2, 0.0, wrist_pitch - FRAC_PI_2, 0.0),
            (
                -FRAC_PI_2,
                self.instrument.wrist,
                wrist_yaw - FRAC_PI_2,
                0.0,
            ),
        ];
        let mut rcm_from_link = Isometry3::identity();
        links.map(|link| {
            rcm_from_link *= modified_dh(link);
            rcm_from_link
        })
    }
}

fn modified_dh((alpha, a, theta, d): (f64, f64, f64, f64)) -> Isometry3<f64> {
    let about = |axis, angle| UnitQuaternion::from_axis_angle(&axis, angle);
    let turn_x = Isometry3::from_parts(Translation3::identity(), about(Vector3::x_axis(), alpha));
    let turn_z = Isometry3::from_parts(
        Translation3::new(a, 0.0, 0.0),
        about(Vector3::z_axis(), theta),
    );
    turn_x * turn_z * Translation3::new(0.0, 0.0, d)
}

/// From the frame of the last joint to the axes that the robot reports.
fn last_from_wrist() -> UnitQuaternion<f64> {
    let axes = Matrix3::new(0.0, -1.0, 0.0, 0.0, 0.0, 1.0, -1.0, 0.0, 0.0);
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes))
}

pub(crate) fn check_joints(joints: &[f64]) -> Result<(), Error> {
    match joints.iter().find(|value| !value.is_finite()) {
        Some(&value) => Err(Error::OutOfRange {
            what: "joint value",
            value,
            expected: "must be finite",
        }),
        None => Ok(()),
    }
}
