//! Distances between a mesh and the true surface, in both directions.
//!
//! ```text
//! accuracy      d(x, truth),  x sampled evenly on the mesh
//! completeness  d(x, mesh),   x sampled evenly on the truth
//! F(d)          2 p r / (p + r),  p = share of accuracy ≤ d,  r = share of completeness ≤ d
//! ```
//! Accuracy alone rewards a model that stops early, completeness alone one that fills space; the F-score is high only when both are
//! (Knapitsch et al. 2017, Tanks and Temples, section 5).

use super::{Sampling, Surface};
use crate::canonical::graph;
use nalgebra::Point3;
use serde::{Deserialize, Serialize};

/// Mean, 95th percentile and maximum of distances, metres.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Spread {
    /// Mean.
    pub mean: f64,
    /// 95th percentile.
    pub p95: f64,
    /// Maximum.
    pub max: f64,
}

/// F-scores at the two reported distances.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct FScore {
    /// At 2 mm.
    #[serde(rename = "2mm")]
    pub at_2mm: f64,
    /// At 5 mm.
    #[serde(rename = "5mm")]
    pub at_5mm: f64,
}

/// Distances between two surfaces, in both directions.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Comparison {
    /// Mesh to truth, ascending.
    to_truth: Vec<f64>,
    /// Truth to mesh, ascending.
    to_mesh: Vec<f64>,
}

/// Compares a mesh with the truth, with the same number of samples on each.
///
/// # Complexity
/// `O(s log n)` for `s` samples and `n` triangles; about 20 ms at 6,000 samples.
pub fn compare(mesh: &Surface, truth: &Surface, sampling: Sampling) -> Comparison {
    Comparison {
        to_truth: distances(mesh, truth, sampling),
        to_mesh: distances(truth, mesh, sampling),
    }
}

fn distances(from: &Surface, to: &Surface, sampling: Sampling) -> Vec<f64> {
    let mut distances: Vec<f64> = from
        .samples(sampling)
        .iter()
        .map(|sample| to.distance(&sample.point))
        .collect();
    distances.sort_by(f64::total_cmp);
    distances
}

impl Comparison {
    /// Distances mesh to truth.
    pub fn accuracy(&self) -> Spread {
        spread(&self.to_truth)
    }

    /// Distances truth to mesh.
    pub fn completeness(&self) -> Spread {
        spread(&self.to_mesh)
    }

    /// Harmonic mean of the shares of both within `distance`, 0 to 1.
    pub fn f_score(&self, distance: f64) -> f64 {
        let [p, r] = [&self.to_truth, &self.to_mesh].map(|d| share_within(d, distance));
        if p + r > 0.0 {
            2.0 * p * r / (p + r)
        } else {
            0.0
        }
    }

    /// The F-scores at 2 and 5 mm.
    pub fn f_scores(&self) -> FScore {
        FScore {
            at_2mm: self.f_score(0.002),
            at_5mm: self.f_score(0.005),
        }
    }
}

fn spread(ascending: &[f64]) -> Spread {
    let last = ascending.len().saturating_sub(1);
    let at = |index: usize| ascending.get(index).copied().unwrap_or(0.0);
    Spread {
        mean: ascending.iter().sum::<f64>() / ascending.len().max(1) as f64,
        p95: at((0.95 * last as f64).round() as usize),
        max: at(last),
    }
}

fn share_within(ascending: &[f64], distance: f64) -> f64 {
    ascending.partition_point(|d| *d <= distance) as f64 / ascending.len().max(1) as f64
}

/// Share of the true area within `distance` of a point of the model, 0 to 1.
///
/// Points are used instead of the mesh, because a mesh may close over unseen parts.
pub fn explored(points: &[Point3<f64>], truth: &Surface, distance: f64, sampling: Sampling) -> f64 {
    share_within(&to_points(points, truth, sampling), distance)
}

/// Distances of samples on `surface` to the nearest of `points`, ascending; infinite when there are none.
pub(super) fn to_points(points: &[Point3<f64>], surface: &Surface, sampling: Sampling) -> Vec<f64> {
    let tree = graph::tree(points);
    let mut distances: Vec<f64> = surface
        .samples(sampling)
        .iter()
        .map(|s| {
            tree.as_ref()
                .map_or(f64::INFINITY, |t| graph::nearest(t, &s.point).1)
        })
        .collect();
    distances.sort_by(f64::total_cmp);
    distances
}

/// Mean distance of the model's points to the true surface, metres; zero when there are none.
pub fn shape_difference(points: &[Point3<f64>], truth: &Surface) -> f64 {
    let sum: f64 = points.iter().map(|p| truth.distance(p)).sum();
    sum / points.len().max(1) as f64
}

/// Measures of the shape of the model's points.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct ShapeMeasures {
    /// Share of the true area within one spacing of the model's points, 0 to 1.
    pub explored: f64,
    /// Share of the true area within two spacings, as the paper counts it.
    pub explored_2eps: f64,
    /// Mean distance from a point of the model to the true surface, metres.
    pub difference: f64,
    /// That distance as a share of the object's size.
    pub relative: f64,
}

impl ShapeMeasures {
    /// For the points of a model at `spacing`; zeros when there are none.
    pub fn of(points: &[Point3<f64>], truth: &Surface, spacing: f64, sampling: Sampling) -> Self {
        if points.is_empty() {
            return Self::default();
        }
        let distances = to_points(points, truth, sampling);
        let difference = shape_difference(points, truth);
        Self {
            explored: share_within(&distances, spacing),
            explored_2eps: share_within(&distances, 2.0 * spacing),
            difference,
            relative: difference / truth.size(),
        }
    }
}
