//! Settings of the baseline.

/// How a point of the warped surface finds what it meets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Association {
    /// Where its ray meets the surface that the camera saw, as in the paper.
    Projective,
    /// The point of the cloud nearest to it.
    Nearest,
}

/// Settings of [`DynamicFusion`](super::DynamicFusion). The defaults did best of those tried on recorded sessions; the crate's README shows the others.
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
}
