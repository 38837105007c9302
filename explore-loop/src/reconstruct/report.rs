//! The result of a frame.

use nalgebra::Vector3;

/// The result of a frame.
#[derive(Debug, Clone, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct FrameReport {
    /// Number of the frame, from 0.
    pub frame: u32,
    /// Vertices measured in it.
    pub measured: Vec<bool>,
    /// Vertices added.
    pub added: usize,
    /// Whether the rest shape was fused anew.
    pub fused: bool,
    /// Number of cut edges, which joined parts that only touched.
    pub cut: usize,
    /// Mean distance of the measured vertices from the cloud along the normals, metres.
    pub residual: f64,
    /// Share of the vertices facing the camera that were measured.
    pub overlap: f64,
    /// Mean motion of the body since the last frame, metres.
    pub moved: f64,
    /// Ratio of the prediction error of the hollow hypothesis to that of the solid one so far, while both are tracked and the body was held.
    pub hollow_over_solid: Option<f64>,
    /// Force of the grips on the body, in weights of the body: one upwards while they carry it. `None` while nothing is held, or if it is not estimated
    /// ([`topo_ekf::body::Limits::pull`] is infinite).
    pub grip_force: Option<Vector3<f64>>,
    /// Outcome of the constraints on the body.
    pub constraints: Constraints,
    /// Why the frame was not used, if it was not.
    pub failure: Option<String>,
    /// Time to register the body to the frame, ms.
    pub registration_ms: f64,
    /// Time of the whole frame without re-fusion, ms.
    pub frame_ms: f64,
    /// Time of the re-fusion, ms.
    pub fusion_ms: f64,
    /// Times of the parts of the frame.
    pub parts: FrameParts,
}

/// Times of the parts of a frame, ms; with two hypotheses, those of the one whose model is returned. The rest of the frame time is prediction,
/// constraints, evaluation, landmarks, colours and keyframes.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
pub struct FrameParts {
    /// Preparing the cloud: filtering, thinning, normals, depth image and search tree.
    pub prepare: f64,
    /// Matching the vertices, in all steps.
    pub matching: f64,
    /// Assembling the normal equations, in all steps.
    pub assemble: f64,
    /// Factorising the normal equations, in all steps.
    pub factor: f64,
    /// Adding vertices to the model, and filling the body under them.
    pub grow: f64,
}

/// Table and self-contact in a frame.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Constraints {
    /// Active constraints: points of the body on the table, and vertices at other parts of the surface.
    pub active: usize,
    /// Vertices that were near another part of the surface and were constrained to stay on their side of it.
    pub near_itself: usize,
    /// Whether they were infeasible; they are then violated as little as possible.
    pub infeasible: bool,
    /// Largest remaining violation, metres.
    pub violation: f64,
    /// Largest depth of a vertex of the model below the table after the frame, metres; 0 if none is below.
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
