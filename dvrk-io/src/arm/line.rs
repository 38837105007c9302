//! A straight line of the tips: translation and rotation end together.
//!
//! ```text
//! d, θ        distance and angle between start and goal
//! L           = max(d, 0.02 m · θ)         path length of the fastest point of the jaws, for fingers of 20 mm
//! pose(s)     = (p₀ + s/L · (p₁ − p₀),  slerp(R₀, R₁, s/L))           0 ≤ s ≤ L
//! ```

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

/// Metres that a point of the jaws moves for a radian: fingers of 20 mm.
pub(crate) const FINGER: f64 = 0.02;
/// Shorter lengths count as zero.
const NOTHING: f64 = 1e-12;

/// A segment between two poses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Line {
    start: Isometry3<f64>,
    shift: Vector3<f64>,
    turn: Vector3<f64>,
    length: f64,
}

impl Line {
    pub(crate) fn new(start: &Isometry3<f64>, goal: &Isometry3<f64>) -> Self {
        let shift = goal.translation.vector - start.translation.vector;
        let turn = (goal.rotation * start.rotation.inverse()).scaled_axis();
        Self {
            start: *start,
            shift,
            turn,
            length: shift.norm().max(FINGER * turn.norm()),
        }
    }

    pub(crate) fn length(&self) -> f64 {
        self.length
    }

    pub(crate) fn pose(&self, way: f64) -> Isometry3<f64> {
        let share = if self.length > NOTHING {
            (way / self.length).clamp(0.0, 1.0)
        } else {
            1.0
        };
        Isometry3::from_parts(
            Translation3::from(self.start.translation.vector + share * self.shift),
            UnitQuaternion::from_scaled_axis(share * self.turn) * self.start.rotation,
        )
    }

    /// Change of pose for a unit of path length: metres, and radians times the length of a finger.
    pub(crate) fn direction(&self) -> [Vector3<f64>; 2] {
        if self.length > NOTHING {
            [self.shift / self.length, FINGER * self.turn / self.length]
        } else {
            [Vector3::zeros(); 2]
        }
    }
}

/// Distance and angle between two poses.
pub(crate) fn apart(a: &Isometry3<f64>, b: &Isometry3<f64>) -> (f64, f64) {
    let distance = (a.translation.vector - b.translation.vector).norm();
    (distance, a.rotation.angle_to(&b.rotation))
}
