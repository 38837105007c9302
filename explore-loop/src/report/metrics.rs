//! `metrics.json`: the measures of a run, defined in [`crate::measure`].

use crate::canonical::closed_surface::Unseen;
use crate::measure::{
    FScore, MeshMeasures, MeshReport, ShapeMeasures, Spread, TrackErrors, TrackingMeasures,
    TruthMeasures,
};
use crate::reconstruct::Constraints;
use serde::{Deserialize, Serialize};

/// Median and 95th percentile of a time, ms.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Timing {
    /// Median.
    pub median: f64,
    /// 95th percentile.
    pub p95: f64,
}

impl Timing {
    /// From a list of times; zeros if it is empty.
    pub fn of(times: &[f64]) -> Self {
        let mut sorted = times.to_vec();
        sorted.sort_by(f64::total_cmp);
        let at = |share: f64| {
            sorted
                .get(((sorted.len().saturating_sub(1)) as f64 * share).round() as usize)
                .copied()
        };
        Self {
            median: at(0.5).unwrap_or(0.0),
            p95: at(0.95).unwrap_or(0.0),
        }
    }
}

/// Simplices cut as non-manifold.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Cut {
    /// Vertices.
    pub vertices: usize,
    /// Edges.
    pub edges: usize,
    /// Triangles.
    pub triangles: usize,
}

impl Cut {
    /// From counts of vertices, edges and triangles.
    pub fn of([vertices, edges, triangles]: [usize; 3]) -> Self {
        Self {
            vertices,
            edges,
            triangles,
        }
    }
}

/// Outcome of the constraints on the body, over all frames.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct ConstraintMeasures {
    /// Number of frames with an active constraint.
    pub active_frames: usize,
    /// Largest number of active constraints in a frame.
    pub active_max: usize,
    /// Largest number of vertices near another part of the surface in a frame.
    pub near_itself_max: usize,
    /// Number of frames with infeasible constraints.
    pub infeasible_frames: usize,
    /// Largest violation after a frame, metres.
    pub violation_m: f64,
    /// Largest depth of a vertex of the model below the table, metres.
    pub below_table_m: f64,
}

impl ConstraintMeasures {
    /// Adds a frame.
    pub fn add(&mut self, frame: &Constraints) {
        self.active_frames += usize::from(frame.active > 0);
        self.active_max = self.active_max.max(frame.active);
        self.near_itself_max = self.near_itself_max.max(frame.near_itself);
        self.infeasible_frames += usize::from(frame.infeasible);
        self.violation_m = self.violation_m.max(frame.violation);
        self.below_table_m = self.below_table_m.max(frame.below_table);
    }
}

/// A patch of the surface that was never seen.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct UnseenPlace {
    /// Its centroid at rest, in the frame of `canonical.ply`, metres.
    pub middle_m: [f64; 3],
    /// The direction it faces, a unit vector.
    pub facing: [f64; 3],
    /// Its area, m².
    pub area_m2: f64,
    /// Its share of the surface.
    pub share: f64,
    /// Largest distance of one of its points from the seen surface, metres; null when no seen surface faces the same way.
    pub farthest_m: Option<f64>,
}

impl From<&Unseen> for UnseenPlace {
    fn from(unseen: &Unseen) -> Self {
        Self {
            middle_m: unseen.middle.into(),
            facing: unseen.facing.into_inner().into(),
            area_m2: unseen.area,
            share: unseen.share,
            farthest_m: Some(unseen.farthest).filter(|f| f.is_finite()),
        }
    }
}

/// The content of the file. Keys are stable; measures that need a ground truth are null where there is none.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Metrics {
    /// Name of the scene, mesh file or session.
    pub scene: String,
    /// Number of arms.
    pub arms: usize,
    /// `planned`, `random` or `recorded`.
    pub grips: String,
    /// Seed of the random numbers.
    pub seed: u64,
    /// Largest grip speed that was allowed, m/s.
    pub speed_m_s: Option<f64>,
    /// Largest speed of a tip while it held the object, m/s; null if none did.
    #[serde(default)]
    pub fastest_grip_m_s: Option<f64>,
    /// Spacing ε of the model, metres.
    pub spacing_m: f64,
    /// Parts that were left out (`--without`).
    #[serde(default)]
    pub without: Vec<String>,
    /// Number of manipulations.
    pub manipulations: usize,
    /// Why the run ended: `closed`, or another keyword.
    pub stop: String,
    /// The reason as a sentence, where the keyword is not enough.
    #[serde(default)]
    pub reason: Option<String>,
    /// Manipulations that were given up, in order.
    #[serde(default)]
    pub troubles: Vec<String>,
    /// The patches that were never seen, the largest first; empty when all was seen.
    #[serde(default)]
    pub unseen: Vec<UnseenPlace>,
    /// Number of contacts at which parts that touch were separated in the closed surface.
    #[serde(default)]
    pub contacts: usize,
    /// Persistent Betti numbers of the canonical model.
    pub betti: [usize; 3],
    /// The Betti numbers before the first manipulation and after each.
    #[serde(default)]
    pub betti_before: Vec<[usize; 3]>,
    /// Share of the true area within one spacing of the model's points, before the first manipulation and after each.
    pub explored: Option<Vec<f64>>,
    /// The share within two spacings, as the paper counts it.
    pub explored_2eps: Option<Vec<f64>>,
    /// Distance from the written mesh to the true surface, metres.
    pub accuracy_m: Option<Spread>,
    /// Distance from the true surface to the written mesh, metres.
    pub completeness_m: Option<Spread>,
    /// Harmonic mean of the shares of both within 2 and 5 mm.
    pub f_score: Option<FScore>,
    /// Share of the true area over which the mesh has an additional sheet.
    pub doubled: Option<f64>,
    /// Share of the mesh's area farther than one spacing from every fused point; null for an empty mesh.
    pub unsupported: Option<f64>,
    /// Counts of edges, components and so on of the written mesh.
    pub mesh: MeshReport,
    /// Mean distance of the points of the model from the true surface, metres.
    pub shape_difference_m: Option<f64>,
    /// That distance as a share of the object's size.
    pub shape_difference_rel: Option<f64>,
    /// Mean distance of unseen vertices from their material points over all frames, metres.
    pub prediction_error_m: Option<f64>,
    /// The same over the frames in which an arm held the object, metres.
    pub prediction_error_held_m: Option<f64>,
    /// Mean tangential distance of seen vertices from their material points over all frames, metres.
    pub slide_m: Option<f64>,
    /// Disagreement of the model and a pixel tracker, if tracks were given.
    #[serde(default)]
    pub tracks: Option<TrackErrors>,
    /// Estimated stiffness over weight `E / (ρ g)` of the object, m; null if it was not estimated.
    pub stiffness_over_weight: Option<f64>,
    /// Number of manipulations after which the model was as it is returned; null if it is always the last one.
    #[serde(default)]
    pub model_of: Option<usize>,
    /// Number of simplices cut as non-manifold.
    pub nm_cut: Cut,
    /// Non-manifold vertices left at the end.
    pub nm_remaining: usize,
    /// Number of points dropped because the complex would have become too large.
    pub thinned: usize,
    /// Number of processed frames.
    pub frames: usize,
    /// Number of frames that were not registered or were implausible.
    pub failed_frames: usize,
    /// Table and self-contact.
    pub constraints: ConstraintMeasures,
    /// Registration time of each frame.
    pub registration_ms: Timing,
    /// Time of each frame.
    pub frame_ms: Timing,
    /// Number of vertices of the canonical model.
    pub vertices: usize,
    /// Time that passed in the cell, seconds.
    pub robot_time_s: f64,
    /// Wall-clock time, seconds.
    pub wall_s: f64,
}

impl Metrics {
    /// Sets the measures of the written mesh.
    #[must_use]
    pub fn with_mesh(self, measures: &MeshMeasures) -> Self {
        let truth = measures.truth.as_ref();
        let get = |field: fn(&TruthMeasures) -> Spread| truth.map(field);
        Self {
            mesh: measures.report,
            unsupported: measures.unsupported,
            accuracy_m: get(|t| t.accuracy),
            completeness_m: get(|t| t.completeness),
            f_score: truth.map(|t| t.f_score),
            doubled: truth.map(|t| t.doubled),
            ..self
        }
    }

    /// Sets the measures of the shape of the model's points: for each decision, and at the end.
    #[must_use]
    pub fn with_shape(self, times: &[ShapeMeasures], end: Option<&ShapeMeasures>) -> Self {
        let list = |field: fn(&ShapeMeasures) -> f64| {
            // Without a ground truth nothing was compared.
            let compared = !times.is_empty() && end.is_some();
            compared.then(|| times.iter().map(field).collect())
        };
        Self {
            explored: list(|s| s.explored),
            explored_2eps: list(|s| s.explored_2eps),
            shape_difference_m: end.map(|s| s.difference),
            shape_difference_rel: end.map(|s| s.relative),
            ..self
        }
    }

    /// Sets the errors of tracking.
    #[must_use]
    pub fn with_tracking(self, tracking: &TrackingMeasures) -> Self {
        Self {
            prediction_error_m: tracking.prediction_error,
            prediction_error_held_m: tracking.prediction_error_held,
            slide_m: tracking.slide,
            ..self
        }
    }
}
