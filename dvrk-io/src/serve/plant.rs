//! The simulated part: an arm that follows set-points.

use std::time::Duration;

use nalgebra::Isometry3;

use crate::kinematics::RcmFromWrist;

/// A simulated arm, as the server sees it.
pub trait ServedArm: Send {
    /// Follows the set-points for `time`: the control point on the wrist, and the angle of the jaw in radians.
    fn follow(&mut self, wrist: &RcmFromWrist, jaw: f64, time: Duration);

    /// Pose of the control point on the wrist.
    fn rcm_from_wrist(&self) -> RcmFromWrist;

    /// Angle of the jaw, radians.
    fn jaw(&self) -> f64;

    /// Torque of the jaw, N·m.
    fn jaw_effort(&self) -> f64 {
        0.0
    }

    /// The instrument, by its dVRK name; `None` when there is none.
    fn tool(&self) -> Option<String> {
        Some("LARGE_NEEDLE_DRIVER:400006".to_owned())
    }

    /// A fault that stops the arm, reported once.
    fn fault(&mut self) -> Option<String> {
        None
    }
}

/// An arm that reaches its set-point at once.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KinematicArm {
    wrist: RcmFromWrist,
    jaw: f64,
}

impl Default for KinematicArm {
    fn default() -> Self {
        Self {
            wrist: RcmFromWrist(Isometry3::identity()),
            jaw: 0.0,
        }
    }
}

impl ServedArm for KinematicArm {
    fn follow(&mut self, wrist: &RcmFromWrist, jaw: f64, _: Duration) {
        (self.wrist, self.jaw) = (*wrist, jaw);
    }

    fn rcm_from_wrist(&self) -> RcmFromWrist {
        self.wrist
    }

    fn jaw(&self) -> f64 {
        self.jaw
    }
}
