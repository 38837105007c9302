//! Options of a served arm.

use derive_setters::Setters;
use std::time::Duration;

use nalgebra::Isometry3;

use crate::Psm;
use crate::arm::{Dialect, ReferenceFromRcm};
use crate::kinematics::Kinematics;

/// Options of a served arm.
#[derive(Debug, Clone, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct ServeOptions {
    /// Lengths and joint limits. Default: a Classic with a large needle driver.
    pub kinematics: Kinematics,
    /// Robot or simulator. Default robot.
    pub dialect: Dialect,
    /// Pose of the remote centre in the reference frame. Default: the frames coincide.
    pub reference_from_rcm: ReferenceFromRcm,
    /// The name of that frame; by default that of the arm's base.
    pub reference: Option<String>,
    /// Initial joint values. Default: inserted by 12 cm, all others 0.
    pub joints: [f64; 6],
    /// Initial angle of the jaw, radians. Default 0.
    pub jaw: f64,
    /// Range of the jaw. Default −0.349 to 1.396 rad.
    pub jaw_range: [f64; 2],
    /// Time to power up. Default 0.5 s; a real one takes up to 3 s.
    pub powering: Duration,
    /// Time to home. Default 1 s.
    pub homing: Duration,
    /// Time between two publications. Default 10 ms.
    pub period: Duration,
}

impl Default for ServeOptions {
    fn default() -> Self {
        Self {
            kinematics: Kinematics::new(Psm::Classic),
            dialect: Dialect::Robot,
            reference_from_rcm: ReferenceFromRcm(Isometry3::identity()),
            reference: None,
            joints: [0.0, 0.0, 0.12, 0.0, 0.0, 0.0],
            jaw: 0.0,
            jaw_range: [-0.349, 1.396],
            powering: Duration::from_millis(500),
            homing: Duration::from_secs(1),
            period: Duration::from_millis(10),
        }
    }
}
