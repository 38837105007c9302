//! Settings of the baseline.

use crate::Error;
use derive_setters::Setters;

/// How a point of the warped surface is matched to the observed surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
pub enum Association {
    /// With the point where its ray meets the observed surface, as in DynamicFusion.
    Projective,
    /// With the nearest point of the cloud.
    Nearest,
}

/// Settings of [`DynamicFusion`](super::DynamicFusion). The defaults performed best of those tried on recorded sessions; the README of the workspace
/// lists the others.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct DynamicFusionOptions {
    /// Spacing of the vertices of the model, m; the same as in the reconstruction that it is compared with.
    pub spacing: f64,
    /// Edge of a voxel, m.
    pub voxel: f64,
    /// Truncation distance τ, m.
    pub truncation: f64,
    /// Distance between neighbouring nodes of the warp field, m.
    pub nodes: f64,
    /// Standard deviation of the Gaussian weight of a node, in node distances.
    pub influence: f64,
    /// Radius around a node within which voxels are warped and fused, in node distances.
    pub reach: f64,
    /// Number of coarser levels above the nodes that blend.
    pub levels: usize,
    /// Ratio of the node distances of consecutive levels.
    pub coarsening: f64,
    /// Weight λ of the rigidity term relative to the data term.
    pub rigidity: f64,
    /// Scale of Huber's penalty in the rigidity term, m.
    pub huber: f64,
    /// Scale of Tukey's penalty in the data term in the first and the last iteration, m; pairs farther apart are not matched.
    pub tukey: [f64; 2],
    /// How surface points are matched.
    pub association: Association,
    /// Rigid iterations, with one motion for all nodes, before the others.
    pub rigid_iterations: usize,
    /// Gauss–Newton iterations.
    pub iterations: usize,
    /// Least weight at which a voxel counts (a frame seen head-on weighs 1), and the cap on its weight, beyond which old frames are forgotten.
    pub weight: [f64; 2],
    /// Surface points within this distance of a closing jaw are moved with the arm, m. DynamicFusion has no arms; the default is 0,
    /// which does the same.
    pub grip_radius: f64,
}

impl DynamicFusionOptions {
    /// The defaults, for vertices at this spacing, m.
    pub fn new(spacing: f64) -> Self {
        Self {
            spacing,
            voxel: 0.004,
            truncation: 0.012,
            nodes: 0.030,
            influence: 1.0,
            reach: 1.25,
            levels: 3,
            coarsening: 2.0,
            rigidity: 0.5,
            huber: 0.002,
            tukey: [0.030, 0.003],
            association: Association::Projective,
            rigid_iterations: 5,
            iterations: 8,
            weight: [0.3, 60.0],
            grip_radius: 0.0,
        }
    }

    /// Rejects settings that are out of range.
    pub(super) fn check(&self) -> Result<(), Error> {
        let positive = |value: f64| value.is_finite() && value > 0.0;
        let not_negative = |value: f64| value.is_finite() && value >= 0.0;
        let settings = [
            ("spacing", self.spacing),
            ("voxel", self.voxel),
            ("truncation", self.truncation),
            ("nodes", self.nodes),
            ("influence", self.influence),
            ("reach", self.reach),
            ("huber", self.huber),
            ("first tukey", self.tukey[0]),
            ("last tukey", self.tukey[1]),
            ("least weight", self.weight[0]),
            ("most weight", self.weight[1]),
        ];
        let settings =
            settings.map(|(name, value)| (name, value, "positive and finite", positive(value)));
        let zeros = [
            ("rigidity", self.rigidity),
            ("grip_radius", self.grip_radius),
        ];
        let zeros = zeros
            .map(|(name, value)| (name, value, "finite and not negative", not_negative(value)));
        let coarsening = self.coarsening;
        let coarser = coarsening.is_finite() && coarsening > 1.0;
        let coarsening = [("coarsening", coarsening, "finite and more than 1", coarser)];
        let mut all = settings.into_iter().chain(zeros).chain(coarsening);
        match all.find(|(.., fits)| !fits) {
            Some((name, value, needed, _)) => Err(Error::BadSetting {
                name,
                needed,
                value,
            }),
            None => Ok(()),
        }
    }
}
