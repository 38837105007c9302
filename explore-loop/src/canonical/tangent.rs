//! The plane orthogonal to a normal: offsets in it, and the angles between directions in it.
//!
//! ```text
//! n × e / |n × e| = u,   n × u = v        e the axis x, or y where the normal is nearly along x
//! aside(d) = |d − n (n · d)|              widest gap = the largest step of atan2(d · v, d · u) round the circle
//! ```

use nalgebra::{UnitVector3, Vector3};

/// Two unit vectors that span the plane orthogonal to `normal`.
pub fn tangents(normal: &UnitVector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let axis = if normal.x.abs() < 0.6 {
        Vector3::x()
    } else {
        Vector3::y()
    };
    let u = normal.cross(&axis).normalize();
    (u, normal.cross(&u))
}

/// Distance of `offset` from the line along `normal`, metres.
pub fn aside(normal: &UnitVector3<f64>, offset: &Vector3<f64>) -> f64 {
    (offset - normal.into_inner() * normal.dot(offset)).norm()
}

/// The widest angle between consecutive directions around `normal`, radians; a full turn for fewer than three.
pub fn widest_gap(
    normal: &UnitVector3<f64>,
    directions: impl Iterator<Item = Vector3<f64>>,
) -> f64 {
    let (u, v) = tangents(normal);
    let mut angles: Vec<f64> = directions.map(|d| d.dot(&v).atan2(d.dot(&u))).collect();
    if angles.len() < 3 {
        return std::f64::consts::TAU;
    }
    angles.sort_by(f64::total_cmp);
    let wrap = angles[0] + std::f64::consts::TAU - angles[angles.len() - 1];
    angles.windows(2).map(|w| w[1] - w[0]).fold(wrap, f64::max)
}
