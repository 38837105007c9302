//! A camera that swings about the centre of the table.
//!
//! ```text
//! turn(t) = a (sin ωt · x + ½ sin 2ωt · y),  ω = 2π / T          a rotation vector about the point of the table below the rest pose
//! ```
//! It always looks at that point, from up to `a` to either side.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use std::f64::consts::TAU;

/// How a camera swings.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Sway {
    /// Largest rotation about the first axis, rad; about the second it is half of this.
    pub angle: f64,
    /// Period, seconds.
    pub period: f64,
}

impl Sway {
    /// Pose of the camera at a time, seconds, relative to its rest pose; `height` is that of the rest pose above the table, metres.
    pub fn pose(&self, time: f64, height: f64) -> Isometry3<f64> {
        let phase = TAU * time / self.period;
        let turn = Vector3::new(phase.sin(), 0.5 * (2.0 * phase).sin(), 0.0) * self.angle;
        let about = Point3::new(0.0, 0.0, height);
        Translation3::from(about.coords)
            * UnitQuaternion::from_scaled_axis(turn)
            * Translation3::from(-about.coords)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_looks_at_the_middle_of_the_table_from_where_it_should() {
        let sway = Sway {
            angle: 0.5,
            period: 8.0,
        };
        let about = Point3::new(0.0, 0.0, 0.6);
        let mut farthest = 0.0_f64;
        for k in 0..80 {
            let pose = sway.pose(0.1 * f64::from(k), 0.6);
            let own = pose.inverse() * about;
            assert!((own - about).norm() < 1e-12, "{own}");
            farthest = farthest.max(pose.rotation.angle());
        }
        assert!((0.5..0.6).contains(&farthest), "{farthest}");
        assert!(sway.pose(0.0, 0.6).rotation.angle() < 1e-12);
    }
}
