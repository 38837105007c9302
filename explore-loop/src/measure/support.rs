//! The share of a mesh that was never observed.

use super::shape::to_points;
use super::{Sampling, Surface};
use nalgebra::Point3;

/// Share of the mesh's area farther than `distance` from every one of `points` (the fused observations), 0 to 1.
///
/// A mesh can be watertight only because it was closed artificially; this tells how much of it rests on observations.
///
/// ```
/// use explore_loop::measure::{Sampling, Surface, unsupported};
/// use explore_loop::nalgebra::Point3;
///
/// // A square of 10 cm, observed at its centre only: what lies outside of a circle around it is unsupported.
/// let corners = [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.1, 0.1, 0.0], [0.0, 0.1, 0.0]].map(Point3::from);
/// let square = Surface::new(&corners, &[[0, 1, 2], [0, 2, 3]])?;
/// let seen = [Point3::new(0.05, 0.05, 0.0)];
/// let share = unsupported(&square, &seen, 0.03, Sampling::default());
/// let circle = std::f64::consts::PI * 0.03 * 0.03;
/// assert!((share - (1.0 - circle / 0.01)).abs() < 0.01);
/// assert_eq!(unsupported(&square, &seen, 0.08, Sampling::default()), 0.0);
/// # Ok::<(), explore_loop::measure::MeasureError>(())
/// ```
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
