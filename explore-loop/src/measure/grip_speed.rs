//! How fast the grips that held the object really moved, which may be slower than what was asked for.
//!
//! ```text
//! v = ‖p(t) − p(t')‖ / (t − t')        p: a tip, t' the frame before, its jaw holding in both
//! ```

use crate::cell::{ArmState, Observation};
use nalgebra::Point3;
use serde::{Deserialize, Serialize};

/// The largest speed of a tip between two frames in both of which its jaw held the object.
///
/// ```
/// use explore_loop::cell::{ArmState, Observation};
/// use explore_loop::measure::GripSpeed;
/// use explore_loop::nalgebra::Isometry3;
///
/// let mut speed = GripSpeed::default();
/// for (stamp, x, holding) in [(0.0, 0.0, false), (0.1, 0.05, true), (0.2, 0.06, true), (0.3, 0.2, false)] {
///     let tip = Isometry3::translation(x, 0.0, 0.5);
///     let arms = vec![ArmState { camera_from_tip: tip, jaw: 0.0, holding, moving: true }];
///     speed.add(&Observation { stamp, arms, camera: None, points: vec![], colours: None, features: None });
/// }
/// // Only from 0.1 s to 0.2 s did the jaw hold at both ends.
/// assert!((speed.fastest().unwrap_or(0.0) - 0.1).abs() < 1e-12);
/// ```
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct GripSpeed {
    stamp: f64,
    held: Vec<Option<Point3<f64>>>,
    fastest: Option<f64>,
}

impl GripSpeed {
    /// Adds a frame. Frames must come in order of time; one that does not is only compared with the next.
    pub fn add(&mut self, observation: &Observation) {
        let tip = |arm: &ArmState| {
            let at = arm.camera_from_tip.translation.vector;
            arm.holding.then(|| Point3::from(at))
        };
        let held: Vec<Option<Point3<f64>>> = observation.arms.iter().map(tip).collect();
        let passed = observation.stamp - self.stamp;
        let speeds = held.iter().zip(&self.held).filter_map(|(now, before)| {
            let way = (now.as_ref()? - before.as_ref()?).norm();
            (passed > 0.0).then(|| way / passed)
        });
        self.fastest = speeds.chain(self.fastest).reduce(f64::max);
        (self.stamp, self.held) = (observation.stamp, held);
    }

    /// The largest speed so far, m/s; `None` if nothing was held in two frames in a row.
    pub fn fastest(&self) -> Option<f64> {
        self.fastest
    }
}
