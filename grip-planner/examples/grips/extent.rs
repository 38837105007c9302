//! Position and size of the mesh.

use grip_planner::Plane;
use grip_planner::nalgebra::{Point3, Vector3};

/// The table through the lowest vertex, z up.
pub fn floor(points: &[Point3<f64>]) -> Plane {
    let lowest = points.iter().map(|p| p.z).fold(f64::INFINITY, f64::min);
    Plane {
        normal: Vector3::z_axis(),
        offset: -lowest,
    }
}

/// Middle and diagonal of the bounding box.
pub fn extent(points: &[Point3<f64>]) -> (Point3<f64>, f64) {
    let low = points.iter().fold(points[0], |a, p| a.inf(p));
    let high = points.iter().fold(points[0], |a, p| a.sup(p));
    (
        grip_planner::nalgebra::center(&low, &high),
        (high - low).norm(),
    )
}
