//! What is simulated: an arm that follows set-points.

use std::time::Duration;

use nalgebra::Isometry3;

use crate::kinematics::RcmFromWrist;

/// An arm that is simulated, as a server sees it.
pub trait ServedArm: Send {
    /// Follows the set-points for `time`: the control point on the wrist, and the angle of the jaw in radians.
    fn follow(&mut self, wrist: &RcmFromWrist, jaw: f64, time: Duration);

    /// Where the control point on the wrist is.
    fn rcm_from_wrist(&self) -> RcmFromWrist;

    /// Angle of the jaw, radians.
    fn jaw(&self) -> f64;

    /// Torque of the jaw, N·m.
    fn jaw_effort(&self) -> f64 {
        0.0
    }

    /// The instrument, as a dVRK names it; nothing when there is none.
    fn tool(&self) -> Option<String> {
        Some("LARGE_NEEDLE_DRIVER:400006".to_owned())
    }

    /// Why the arm cannot go on, once.
    fn fault(&mut self) -> Option<String> {
        None
    }
}

/// An arm that is where it is sent, at once.
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
