//! What happened in a frame.

/// What happened in a frame.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct FrameReport {
    /// Number of the frame, from 0.
    pub frame: u32,
    /// Vertices measured in it.
    pub measured: Vec<bool>,
    /// Vertices added.
    pub added: usize,
    /// Whether the rest shape was fused anew.
    pub fused: bool,
    /// Edges cut because they glued places that only touched.
    pub cut: usize,
    /// Mean distance of the measured vertices from the cloud along the normals, metres.
    pub residual: f64,
    /// Share of the vertices facing the camera that were measured.
    pub overlap: f64,
    /// Mean motion of the body since the last frame, metres.
    pub moved: f64,
    /// Prediction error of the hollow hypothesis over that of the solid one so far, while both are followed and the body was held.
    pub hollow_over_solid: Option<f64>,
    /// How the constraints on the body ended.
    pub constraints: Constraints,
    /// Why the frame was not used, if so.
    pub failure: Option<String>,
    /// Time to bring the body to the frame, ms.
    pub registration_ms: f64,
    /// Time of the whole frame, re-fusion left out, ms.
    pub frame_ms: f64,
    /// Time of the re-fusion, ms.
    pub fusion_ms: f64,
    /// Where the time of the frame went.
    pub parts: FrameParts,
}

/// Times of the parts of a frame, ms. Of two hypotheses that are followed side by side they are those of the one whose model is given. What is missing
/// to the time of the frame went into prediction and constraints, judging the fit, landmarks, colours and keyframes.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[non_exhaustive]
pub struct FrameParts {
    /// The cloud: filtered, thinned, oriented, its depth and its tree.
    pub prepare: f64,
    /// Finding what each vertex meets, in all steps.
    pub matching: f64,
    /// Putting the normal equations together, in all steps.
    pub assemble: f64,
    /// Factorising them, in all steps.
    pub factor: f64,
    /// Adding what is new to the model, and filling the body under it.
    pub grow: f64,
}

/// Table and self-contact in a frame.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Constraints {
    /// Constraints that push: points of the body on the table, and vertices kept on their side of other surface.
    pub active: usize,
    /// Vertices that were near another part of the surface and had to stay on their side of it.
    pub near_itself: usize,
    /// Whether they contradicted each other; they are then violated as little as possible.
    pub infeasible: bool,
    /// Largest violation left, metres.
    pub violation: f64,
    /// How far the deepest vertex of the model lies under the table after the frame, metres; 0 when none does.
    pub below_table: f64,
}

impl FrameReport {
    /// A frame that measured all of `vertices`.
    pub fn measured(vertices: usize) -> Self {
        Self {
            measured: vec![true; vertices],
            ..Self::default()
        }
    }
}
