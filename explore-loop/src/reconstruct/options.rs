//! Settings of the reconstruction.

use topo_ekf::body::{BodyOptions, Limits};

/// Settings of the reconstruction; the defaults follow from the spacing.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
#[derive(serde::Serialize, serde::Deserialize)]
pub struct ReconstructOptions {
    /// Spacing ε of the model, metres.
    pub spacing: f64,
    /// Edge of the cells that carry the body, metres; larger for a body of more than 300 cells.
    pub cell: f64,
    /// Vertices within this distance of a tip when its jaw closes move with it, metres.
    pub grip_radius: f64,
    /// Least cosine between normal and camera for a vertex to be matched.
    pub min_facing: f64,
    /// Mean motion a frame below which the object rests, metres.
    pub rest_motion: f64,
    /// Mean motion between keyframes, metres.
    pub keyframe_motion: f64,
    /// What is believed of a frame: how far the surface moves between two frames (ξ), how far it falls between two frames when it was
    /// let go, and how hard grips pull before one must be slipping.
    pub limits: Limits,
    /// The elastic body.
    pub body: BodyOptions,
    /// How near two parts of the surface may come to each other, metres; `None` lets them pass through each other.
    pub separation: Option<f64>,
    /// What of the material within a cell hangs together.
    pub material: Material,
    /// Share of the inside that a hollow body is filled with: that hypothesis is followed beside the solid one until one of them has predicted the
    /// frames better. `None` for a body that is known to be solid.
    pub hollow: Option<f64>,
    /// Rounds of the re-fusion at rest: one from the poses as they were tracked, each further one after the poses have been fitted anew. 0 leaves the
    /// rest shape as it grew.
    pub fusion_rounds: usize,
    /// What colour features are for, where a camera sends them.
    pub features: ColourFeatures,
}

/// What the colour features of an observation are for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
pub enum ColourFeatures {
    /// Nothing.
    Ignored,
    /// Landmarks that hold the body where its shape does not tell how it slides along itself.
    #[default]
    Landmarks,
}

/// What of the material within a cell of the body hangs together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
pub enum Material {
    /// What is connected there: fingers and folds nearer to each other than a cell are pieces of their own.
    Connected,
    /// All that is in a cell, and in cells that touch: as a plain grid has it.
    Whole,
}

impl ReconstructOptions {
    /// The same options with colour features used for this.
    #[must_use]
    pub fn with_features(self, features: ColourFeatures) -> Self {
        Self { features, ..self }
    }

    /// Defaults at a spacing.
    pub fn new(spacing: f64) -> Self {
        Self {
            spacing,
            cell: 0.013,
            grip_radius: 0.010,
            min_facing: 0.12,
            rest_motion: 0.0006,
            keyframe_motion: 0.012,
            limits: Limits::default()
                .with_motion(0.015)
                .with_fall(0.100)
                .with_pull(5.0),
            body: BodyOptions::default(),
            separation: Some(0.0005),
            material: Material::Connected,
            hollow: Some(0.02),
            fusion_rounds: 2,
            features: ColourFeatures::default(),
        }
    }
}
