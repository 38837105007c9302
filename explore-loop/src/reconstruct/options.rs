//! Options of the reconstruction.

use derive_setters::Setters;
use topo_ekf::body::{BodyOptions, Limits};

/// Options of the reconstruction; the defaults follow from the spacing.
#[derive(Debug, Clone, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
#[derive(serde::Serialize, serde::Deserialize)]
pub struct ReconstructOptions {
    /// Spacing ε of the model, metres.
    pub spacing: f64,
    /// Edge of the lattice cells that carry the body, metres; larger for a body of more than 300 cells.
    pub cell: f64,
    /// Vertices within this distance of a tip when its jaw closes move with it, metres.
    pub grip_radius: f64,
    /// Least cosine between normal and camera for a vertex to be matched.
    pub min_facing: f64,
    /// Mean motion between frames below which the object rests, metres.
    pub rest_motion: f64,
    /// Mean motion between keyframes, metres.
    pub keyframe_motion: f64,
    /// Limits of a plausible frame: how far the surface moves between two frames (ξ), how far it falls between two frames after it was
    /// released, and how hard grips pull before one of them must be slipping.
    pub limits: Limits,
    /// The elastic body.
    pub body: BodyOptions,
    /// Least distance between two parts of the surface, metres; `None` lets them pass through each other.
    pub separation: Option<f64>,
    /// Which material within a cell is connected.
    pub material: Material,
    /// Fill of the interior of a hollow body. That hypothesis is tracked beside the solid one until one of them has predicted the frames better.
    /// `None` for a body that is known to be solid.
    pub hollow: Option<f64>,
    /// Rounds of the re-fusion at rest: the first uses the tracked poses, each further one poses that were fitted anew. With 0 the rest shape
    /// stays as it grew.
    pub fusion_rounds: usize,
    /// Use of colour features, if the camera has them.
    pub features: ColourFeatures,
}

/// Use of the colour features of an observation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
pub enum ColourFeatures {
    /// Nothing.
    Ignored,
    /// They are landmarks that hold the body where its shape does not determine how it slides along itself.
    #[default]
    Landmarks,
}

/// Which material within a cell of the body is connected.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
pub enum Material {
    /// Only what touches: fingers and folds closer to each other than a cell are separate pieces.
    Connected,
    /// Everything in a cell and in adjacent cells, as in a plain grid.
    Whole,
}

impl ReconstructOptions {
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
