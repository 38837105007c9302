//! `metrics.json`: what a run measured, under the names of METHOD §10.

use serde::Serialize;

/// Median and 95th percentile of a time, ms.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Timing {
    /// Median.
    pub median: f64,
    /// 95th percentile.
    pub p95: f64,
}

impl Timing {
    /// Of a list of times; zeros of an empty one.
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
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
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

/// The file's content. Keys are stable; measures that need a ground truth are null where there is none.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Metrics {
    /// Name of the scene, mesh file or session.
    pub scene: String,
    /// Number of arms.
    pub arms: usize,
    /// `planned`, `random` or `recorded`.
    pub grips: String,
    /// Seed of everything random.
    pub seed: u64,
    /// Fastest grip speed, m/s.
    pub speed_m_s: Option<f64>,
    /// Spacing ε of the model, metres.
    pub spacing_m: f64,
    /// Manipulations made.
    pub manipulations: usize,
    /// Why the run ended: `closed`, or what stopped it.
    pub stop: String,
    /// Persistent Betti numbers of the canonical model.
    pub betti: [usize; 3],
    /// Explored share before the first manipulation and after each.
    pub explored: Option<Vec<f64>>,
    /// Mean distance canonical point to true surface, metres.
    pub shape_difference_m: Option<f64>,
    /// The same as a share of the object's size.
    pub shape_difference_rel: Option<f64>,
    /// Mean distance of unseen vertices to their material points over all frames, metres.
    pub prediction_error_m: Option<f64>,
    /// Cut as non-manifold.
    pub nm_cut: Cut,
    /// Non-manifold vertices left at the end.
    pub nm_remaining: usize,
    /// Frames processed.
    pub frames: usize,
    /// Registration, per frame.
    pub registration_ms: Timing,
    /// The whole frame.
    pub frame_ms: Timing,
    /// Vertices of the canonical model.
    pub vertices: usize,
    /// Time that passed in the cell, seconds.
    pub robot_time_s: f64,
    /// Time that passed here, seconds.
    pub wall_s: f64,
}
