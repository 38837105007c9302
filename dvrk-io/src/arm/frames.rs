//! Poses with their frames in the types: products with mismatched frames do not compile.
//!
//! ```text
//! camera_from_rcm · rcm_from_tip         = camera_from_tip          (calibration)
//! reference_from_rcm · rcm_from_wrist    = reference_from_wrist     measured_cp, setpoint_cp and servo_cp of a robot
//! reference_from_rcm · rcm_from_tip      = reference_from_tip       those of a simulator
//! ```
//! The *reference* frame is set on the robot with `set_base_frame`: with an endoscope often the camera in the axes of
//! the dVRK (x left, y up), otherwise the remote centre itself. It may move while the robot runs.

use std::ops::Mul;

use nalgebra::Isometry3;

use crate::kinematics::{RcmFromTip, RcmFromWrist};

macro_rules! frames {
    ($($(#[$doc:meta])* $name:ident;)*) => {$(
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq)]
        #[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
        pub struct $name(pub Isometry3<f64>);
    )*};
}

frames! {
    /// Pose of the remote centre in the camera frame: a calibration.
    CameraFromRcm;
    /// Pose of the tips of the closed jaws in the camera frame.
    CameraFromTip;
    /// Pose of the control point in the camera frame.
    CameraFromWrist;
    /// Pose of the remote centre in the reference frame of the robot.
    ReferenceFromRcm;
}

impl CameraFromRcm {
    /// The pose in the frame of the remote centre, from one in that of the camera.
    pub fn rcm_from_tip(&self, camera_from_tip: &CameraFromTip) -> RcmFromTip {
        RcmFromTip(self.0.inverse() * camera_from_tip.0)
    }

    /// As [`CameraFromRcm::rcm_from_tip`], of the control point.
    pub fn rcm_from_wrist(&self, camera_from_wrist: &CameraFromWrist) -> RcmFromWrist {
        RcmFromWrist(self.0.inverse() * camera_from_wrist.0)
    }
}

impl Mul<RcmFromTip> for CameraFromRcm {
    type Output = CameraFromTip;

    fn mul(self, tip: RcmFromTip) -> CameraFromTip {
        CameraFromTip(self.0 * tip.0)
    }
}

impl Mul<RcmFromWrist> for CameraFromRcm {
    type Output = CameraFromWrist;

    fn mul(self, wrist: RcmFromWrist) -> CameraFromWrist {
        CameraFromWrist(self.0 * wrist.0)
    }
}
