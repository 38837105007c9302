//! All measures of a finished mesh in one call.

use super::{
    DoubledOptions, FScore, MeasureError, MeshReport, Sampling, Spread, Surface, compare, doubled,
    unsupported,
};
use nalgebra::Point3;

/// Measures of a mesh.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct MeshMeasures {
    /// Counts of edges, components and so on.
    pub report: MeshReport,
    /// Share of its area that no observation supports; `None` for an empty mesh.
    pub unsupported: Option<f64>,
    /// Comparison with the truth; `None` without one, or for an empty mesh.
    pub truth: Option<TruthMeasures>,
}

/// Comparison of a mesh with the truth.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct TruthMeasures {
    /// Distance mesh to truth.
    pub accuracy: Spread,
    /// Distance truth to mesh.
    pub completeness: Spread,
    /// Shares within 2 and 5 mm.
    pub f_score: FScore,
    /// Share of the true area with an additional sheet.
    pub doubled: f64,
}

impl MeshMeasures {
    /// Measures a mesh at `spacing` that was fused from `points`, and compares it with the true surface where there is one.
    ///
    /// # Errors
    /// An index out of range, or a vertex that is not finite.
    pub fn of(
        vertices: &[Point3<f64>],
        triangles: &[[u32; 3]],
        points: &[Point3<f64>],
        spacing: f64,
        truth: Option<&Surface>,
        sampling: Sampling,
    ) -> Result<Self, MeasureError> {
        let report = MeshReport::of(vertices, triangles);
        let mesh = match Surface::new(vertices, triangles) {
            Ok(mesh) => mesh,
            Err(MeasureError::NoArea) => {
                return Ok(Self {
                    report,
                    ..Self::default()
                });
            }
            Err(error) => return Err(error),
        };
        Ok(Self {
            report,
            unsupported: Some(unsupported(&mesh, points, spacing, sampling)),
            truth: truth.map(|truth| TruthMeasures::of(&mesh, truth, sampling)),
        })
    }
}

impl TruthMeasures {
    /// Compares a mesh with the truth.
    pub fn of(mesh: &Surface, truth: &Surface, sampling: Sampling) -> Self {
        let comparison = compare(mesh, truth, sampling);
        Self {
            accuracy: comparison.accuracy(),
            completeness: comparison.completeness(),
            f_score: comparison.f_scores(),
            doubled: doubled(mesh, truth, &DoubledOptions::default(), sampling),
        }
    }
}
