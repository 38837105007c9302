//! Normals: the smallest principal axis of the points around a point, oriented to the camera.
//!
//! ```text
//! C = Σ (x − mean)(x − mean)ᵀ over the points within `radius`;  n = eigenvector of the smallest eigenvalue,  n · (camera − x) ≥ 0
//! ```

use nalgebra::{Matrix3, Point3, UnitVector3, Vector3};

use super::voxels::Neighbours;

/// Fewest points, including itself, to which a plane is fitted.
const LEAST: usize = 4;
/// Collinear points have no normal: the middle eigenvalue must be at least this share of the largest.
const WIDE: f64 = 1e-3;

/// The normal of each point, if it has one. `points` and `radius` have the same unit.
pub(super) fn normals(
    points: &[Point3<f64>],
    radius: f64,
    viewpoint: &Point3<f64>,
) -> Vec<Option<UnitVector3<f64>>> {
    let neighbours = Neighbours::new(points, radius);
    let normal = |point: &Point3<f64>| {
        let near = || neighbours.of(point).map(|index| points[index] - point);
        let count = near().count();
        if count < LEAST {
            return None;
        }
        let mean = near().sum::<Vector3<f64>>() / count as f64;
        let spread = |sum: Matrix3<f64>, offset: Vector3<f64>| {
            sum + (offset - mean) * (offset - mean).transpose()
        };
        let eigen = near().fold(Matrix3::zeros(), spread).symmetric_eigen();
        let smallest = eigen.eigenvalues.imin();
        let mut values = eigen.eigenvalues;
        values.as_mut_slice().sort_by(f64::total_cmp);
        if values[1] <= WIDE * values[2] {
            return None;
        }
        let axis: Vector3<f64> = eigen.eigenvectors.column(smallest).into();
        let unit = UnitVector3::try_new(axis, 0.5)?;
        // Oriented after normalisation: scaling may change the sign of a vector that is almost perpendicular.
        Some(if unit.dot(&(viewpoint - point)) < 0.0 {
            -unit
        } else {
            unit
        })
    };
    points.iter().map(normal).collect()
}
