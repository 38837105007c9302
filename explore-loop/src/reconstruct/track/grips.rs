//! What the jaws hold: points of the material that move with the tips.

use super::Track;
use crate::cell::ArmState;
use nalgebra::Point3;
use topo_ekf::body::Embedding;

/// Fewest vertices that a jaw holds.
const LEAST_HELD: usize = 4;

/// What a jaw holds: points of the material and their positions in the frame of the tip.
pub(super) type Grip = Vec<(Embedding, Point3<f64>)>;

impl Track {
    /// The held points and where the tips have moved them.
    pub fn grips_now(&self, arms: &[ArmState]) -> Vec<(Embedding, Point3<f64>)> {
        let mut held = Vec::new();
        for (arm, grip) in arms.iter().zip(&self.grips) {
            if let Some(grip) = grip.as_ref().filter(|_| arm.holding) {
                held.extend(
                    grip.iter()
                        .map(|(at, place)| (*at, arm.camera_from_tip * place)),
                );
            }
        }
        held
    }

    /// Records what each arm holds, for the next frame.
    pub fn take_grips(&mut self, arms: &[ArmState], radius: f64) {
        self.grips.resize_with(arms.len(), || None);
        for (k, arm) in arms.iter().enumerate() {
            let finite = arm
                .camera_from_tip
                .to_homogeneous()
                .iter()
                .all(|x| x.is_finite());
            if !arm.holding {
                self.grips[k] = None;
            } else if !finite {
                // Recorded as soon as the arm reports its pose.
            } else if self.grips[k].is_none() {
                let tip = Point3::from(arm.camera_from_tip.translation.vector);
                let mut near: Vec<(f64, usize)> = self
                    .model
                    .live()
                    .iter()
                    .enumerate()
                    .map(|(i, p)| ((p - tip).norm(), i))
                    .collect();
                near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
                let within = near.iter().filter(|n| n.0 < radius).count();
                let tip_from_camera = arm.camera_from_tip.inverse();
                let grip = near[..within.max(LEAST_HELD).min(near.len())]
                    .iter()
                    .map(|&(_, i)| (self.embeddings[i], tip_from_camera * self.model.live()[i]))
                    .collect();
                self.grips[k] = Some(grip);
            }
        }
    }

    /// Whether an arm has just closed, and its grip is not recorded yet.
    pub fn takes_hold(&self, arms: &[ArmState]) -> bool {
        let unknown = |k: usize| self.grips.get(k).is_none_or(Option::is_none);
        arms.iter()
            .enumerate()
            .any(|(k, a)| a.holding && unknown(k))
    }

    /// Whether an arm is known to hold the body.
    pub fn is_held(&self) -> bool {
        self.grips.iter().any(Option::is_some)
    }
}
