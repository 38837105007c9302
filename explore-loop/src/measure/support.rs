//! The share of a mesh that was never observed.

use super::shape::to_points;
use super::{Sampling, Surface};
use nalgebra::Point3;

/// Share of the mesh's area farther than `distance` from every one of `points` (the fused observations), 0 to 1.
///
/// A mesh can be watertight only because it was closed artificially; this tells how much of it rests on observations.
pub fn unsupported(
    mesh: &Surface,
    points: &[Point3<f64>],
    distance: f64,
    sampling: Sampling,
) -> f64 {
    let distances = to_points(points, mesh, sampling);
    let far = distances.len() - distances.partition_point(|d| *d <= distance);
    far as f64 / distances.len().max(1) as f64
}
