//! How far a motion of a cloud is from moving it as a whole.
//!
//! ```text
//! off(u) = √( Σ_p ‖p + u_p − (R p + t)‖²  /  Σ_p ‖p − p̄‖² )        (R, t) the nearest rigid motion
//! R = V diag(1, 1, ± 1) Uᵀ,   U Σ Vᵀ = Σ_p (p − p̄)(q − q̄)ᵀ,   q = p + u_p
//! ```
//! (Kabsch, A solution for the best rotation to relate two sets of vectors, 1976.)

use nalgebra::{Matrix3, Point3, Vector3};

/// Root mean square distance from the nearest rigid motion, divided by the root mean square distance of the points from their centroid: 0 for a rigid
/// motion. Points in one place do not bend.
pub(crate) fn off_rigid(points: &[Point3<f64>], displacements: &[Vector3<f64>]) -> f64 {
    let count = points.len().max(1) as f64;
    let before = points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / count;
    let moved = || points.iter().zip(displacements).map(|(p, u)| p.coords + u);
    let after = moved().sum::<Vector3<f64>>() / count;
    let arms = || points.iter().map(|p| p.coords - before);
    let covariance: Matrix3<f64> = arms()
        .zip(moved())
        .map(|(arm, q)| arm * (q - after).transpose())
        .sum();
    let svd = covariance.svd(true, true);
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else {
        return 0.0;
    };
    let proper = (v_t.transpose() * u.transpose()).determinant().signum();
    let turn =
        v_t.transpose() * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, proper)) * u.transpose();
    let off: f64 = arms()
        .zip(moved())
        .map(|(arm, q)| (q - after - turn * arm).norm_squared())
        .sum();
    let size: f64 = arms().map(|arm| arm.norm_squared()).sum();
    if size > 0.0 { (off / size).sqrt() } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;

    fn grid() -> Vec<Point3<f64>> {
        let k = |k: i32| [k % 4, k / 4 % 3, k / 12].map(|x| 0.01 * f64::from(x));
        (0..24).map(|i| k(i).into()).collect()
    }

    #[test]
    fn a_rigid_motion_does_not_bend() {
        let points = grid();
        let turn = Rotation3::from_euler_angles(2.0, -1.0, 3.0);
        let shift = Vector3::new(0.3, -5.0, 1.0);
        let rigid: Vec<_> = points.iter().map(|p| (turn * p + shift) - p).collect();
        assert!(off_rigid(&points, &rigid) < 1e-12);
        assert!(off_rigid(&points[..1], &rigid[..1]) < 1e-12);
        // Mirrored, it does: reflections are no rigid motions.
        let mirrored: Vec<_> = points
            .iter()
            .map(|p| Vector3::new(0.0, 0.0, -2.0 * p.z))
            .collect();
        assert!(off_rigid(&points, &mirrored) > 0.3);
    }

    /// Of a shear x ← x + s z the half s/2 is a turn, to first order, and the other half bends.
    #[test]
    fn a_shear_bends_by_half() {
        let points = grid();
        let s = 1e-4;
        let shear: Vec<_> = points
            .iter()
            .map(|p| Vector3::new(s * p.z, 0.0, 0.0))
            .collect();
        let squares = |axis: usize| {
            let mean = points.iter().map(|p| p[axis]).sum::<f64>() / points.len() as f64;
            points.iter().map(|p| (p[axis] - mean).powi(2)).sum::<f64>()
        };
        let [x, y, z] = [0, 1, 2].map(squares);
        // The nearest turn w about y: minimal Σ (s z − w z)² + (w x)²  →  w = s z² / (x² + z²).
        let w = s * z / (x + z);
        let expected = (((s - w).powi(2) * z + w * w * x) / (x + y + z)).sqrt();
        assert!((off_rigid(&points, &shear) / expected - 1.0).abs() < 1e-3);
    }
}
