//! Settings of the baseline.

use crate::Error;

/// How a point of the warped surface finds what it meets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Association {
    /// Where its ray meets the surface that the camera saw, as in the paper.
    Projective,
    /// The point of the cloud nearest to it.
    Nearest,
}

/// Settings of [`DynamicFusion`](super::DynamicFusion). The defaults did best of those tried on recorded sessions; the README of the workspace shows
/// the others.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct DynamicFusionOptions {
    /// Spacing of the vertices of the model that is handed out, m: as that of the reconstruction it is compared with.
    pub spacing: f64,
    /// Edge of a voxel, m.
    pub voxel: f64,
    /// Truncation distance τ, m.
    pub truncation: f64,
    /// Distance of neighbouring nodes of the warp field, m.
    pub nodes: f64,
    /// Standard deviation of the weight of a node, in distances of nodes.
    pub influence: f64,
    /// How far from a node voxels are warped and fused, in distances of nodes.
    pub reach: f64,
    /// Levels of coarser nodes above those that blend.
    pub levels: usize,
    /// How much farther apart the nodes of each level are than those of the last.
    pub coarsening: f64,
    /// Weight λ of rigidity over data.
    pub rigidity: f64,
    /// Scale of Huber's penalty on rigidity, m.
    pub huber: f64,
    /// Scale of Tukey's penalty on the data in the first and the last iteration, m; points farther from what they meet are not matched.
    pub tukey: [f64; 2],
    /// How points find what they meet.
    pub association: Association,
    /// Iterations with one motion for all nodes.
    pub rigid_iterations: usize,
    /// Gauss–Newton iterations.
    pub iterations: usize,
    /// A voxel counts from the first weight on (a frame seen head on weighs 1); its mean forgets beyond the second.
    pub weight: [f64; 2],
    /// Points of the surface within this distance of a closing jaw go where the arm takes them, m. The paper knows no arms, and neither does the
    /// default: 0.
    pub grip_radius: f64,
}

impl DynamicFusionOptions {
    /// Defaults, with vertices at this spacing, m.
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

    /// The same options with voxels of this edge and this truncation distance, m; a voxel counts from the first weight on, and its mean forgets beyond
    /// the second.
    #[must_use]
    pub fn with_volume(self, voxel: f64, truncation: f64, weight: [f64; 2]) -> Self {
        Self {
            voxel,
            truncation,
            weight,
            ..self
        }
    }

    /// The same options with nodes this far apart, m; the standard deviation of their weights and how far they carry voxels in distances of nodes.
    #[must_use]
    pub fn with_nodes(self, nodes: f64, influence: f64, reach: f64) -> Self {
        Self {
            nodes,
            influence,
            reach,
            ..self
        }
    }

    /// The same options with so many coarser levels, each so many times as coarse as the one below.
    #[must_use]
    pub fn with_hierarchy(self, levels: usize, coarsening: f64) -> Self {
        Self {
            levels,
            coarsening,
            ..self
        }
    }

    /// The same options with this weight of rigidity, and this scale of its penalty, m.
    #[must_use]
    pub fn with_rigidity(self, rigidity: f64, huber: f64) -> Self {
        Self {
            rigidity,
            huber,
            ..self
        }
    }

    /// The same options with these scales of the penalty on the data, in the first iteration and in the last, m.
    #[must_use]
    pub fn with_tukey(self, tukey: [f64; 2]) -> Self {
        Self { tukey, ..self }
    }

    /// The same options with points that find what they meet like this.
    #[must_use]
    pub fn with_association(self, association: Association) -> Self {
        Self {
            association,
            ..self
        }
    }

    /// The same options with so many iterations: with one motion for all nodes, and with one for each.
    #[must_use]
    pub fn with_iterations(self, rigid_iterations: usize, iterations: usize) -> Self {
        Self {
            rigid_iterations,
            iterations,
            ..self
        }
    }

    /// The same options with what is this near to a closing jaw carried by it, m; 0: nothing.
    #[must_use]
    pub fn with_grip_radius(self, grip_radius: f64) -> Self {
        Self {
            grip_radius,
            ..self
        }
    }

    /// Refuses what is out of range.
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
