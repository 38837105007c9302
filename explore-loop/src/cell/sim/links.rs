//! The links of an arm behind its fingers: one straight shaft, or a wrist and a shaft through the remote centre.
//!
//! ```text
//! free   fingers ─── shaft, straight behind the tip
//! PSM    fingers ─ wrist ┐
//!                         ╲ shaft, through the remote centre and 10 cm beyond
//! ```

use nalgebra::{Isometry3, Point3};

use super::arms::kinematics;

/// Where the fingers end and the shaft begins, metres behind the tip.
const FINGERS: f64 = 0.012;
/// Length of a straight shaft, from the tip, metres.
const LENGTH: f64 = 0.25;
/// How far a shaft extends behind its remote centre, metres.
const BEHIND: f64 = 0.1;

/// A chain of points, camera frame, ending at the fingers.
#[derive(Debug, Clone)]
pub(super) struct Links {
    pub points: Vec<Point3<f64>>,
    /// Whether the chain is one shaft straight behind the tip.
    pub straight: bool,
}

impl Links {
    /// A straight shaft behind the tip.
    pub fn straight(camera_from_tip: &Isometry3<f64>) -> Self {
        let at = |z: f64| camera_from_tip * Point3::new(0.0, 0.0, -z);
        Self {
            points: vec![at(LENGTH), at(FINGERS)],
            straight: true,
        }
    }

    /// A wrist, and a shaft through a remote centre.
    pub fn through(camera_from_tip: &Isometry3<f64>, centre: &Point3<f64>) -> Self {
        let at = |z: f64| camera_from_tip * Point3::new(0.0, 0.0, -z);
        let instrument = kinematics().instrument();
        let wrist = at(instrument.jaw + instrument.wrist);
        let way = centre - wrist;
        let end = centre + way.try_normalize(0.0).unwrap_or_default() * BEHIND;
        Self {
            points: vec![end, wrist, at(FINGERS)],
            straight: false,
        }
    }
}
