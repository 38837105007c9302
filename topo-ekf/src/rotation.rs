//! The rotation nearest to a 3 × 3 matrix, from a good guess.
//!
//! ```text
//! R* = argmax_R tr(Rᵀ M),        A = Rᵀ M is symmetric at the optimum
//! Newton:  (tr(A) I − sym A) ω = vee(A − Aᵀ),   R ← R · cay(ω)
//! ```
//!
//! From the rotation of the last iteration two or three steps are enough, ten times faster than a singular value decomposition;
//! for a poor guess (the Hessian is not positive) the decomposition is used. If `M` does not determine an axis
//! (all edges collinear) the caller adds a multiple of the rotation to prefer.

use nalgebra::{Matrix3, Rotation3, Vector3};

/// Steps before the decomposition is used; a guess within 90° needs at most five.
const STEPS: usize = 8;

/// The rotation that maximises `tr(Rᵀ m)`; `guess` itself where `m` does not determine it.
pub(crate) fn nearest_rotation(m: &Matrix3<f64>, guess: &Rotation3<f64>) -> Rotation3<f64> {
    newton(m, guess).or_else(|| decompose(m)).unwrap_or(*guess)
}

fn newton(m: &Matrix3<f64>, guess: &Rotation3<f64>) -> Option<Rotation3<f64>> {
    let mut r = *guess.matrix();
    for _ in 0..STEPS {
        let a = r.tr_mul(m);
        let gradient = vee(&a);
        let step = solve_positive(&curvature(&a), &gradient)?;
        r *= cayley(&step);
        // Convergence is quadratic: a step of 1e-7 leaves an error of 1e-14.
        if step.norm_squared() < 1e-14 {
            return Some(Rotation3::from_matrix_unchecked(r));
        }
    }
    None
}

/// Singular value decomposition with the sign that makes a proper rotation.
fn decompose(m: &Matrix3<f64>) -> Option<Rotation3<f64>> {
    let svd = m.try_svd(true, true, f64::EPSILON, 100)?;
    let (mut u, v) = (svd.u?, svd.v_t?);
    // nalgebra sorts singular values downwards, so the last column is the cheapest to reflect.
    if svd.singular_values[0] <= 0.0 {
        return None;
    }
    if (u * v).determinant() < 0.0 {
        u.column_mut(2).neg_mut();
    }
    Some(Rotation3::from_matrix_unchecked(u * v))
}

/// `tr(A) I − sym A`, entry by entry: with matrices a third of a step would be products with zeros.
fn curvature(a: &Matrix3<f64>) -> Matrix3<f64> {
    let trace = a.trace();
    let off = |i, j| -0.5 * (a[(i, j)] + a[(j, i)]);
    let (xy, xz, yz) = (off(0, 1), off(0, 2), off(1, 2));
    let on = |i| trace - a[(i, i)];
    Matrix3::new(on(0), xy, xz, xy, on(1), yz, xz, yz, on(2))
}

/// Axial vector of the antisymmetric part (twice it).
fn vee(a: &Matrix3<f64>) -> Vector3<f64> {
    Vector3::new(
        a[(2, 1)] - a[(1, 2)],
        a[(0, 2)] - a[(2, 0)],
        a[(1, 0)] - a[(0, 1)],
    )
}

/// Solves with a symmetric matrix by cofactors; `None` unless it is positive definite.
pub(crate) fn solve_positive(h: &Matrix3<f64>, g: &Vector3<f64>) -> Option<Vector3<f64>> {
    let (a, b, c) = (h[(0, 0)], h[(0, 1)], h[(0, 2)]);
    let (d, e, f) = (h[(1, 1)], h[(1, 2)], h[(2, 2)]);
    let (c00, c01, c02) = (d * f - e * e, c * e - b * f, b * e - c * d);
    let determinant = a * c00 + b * c01 + c * c02;
    let minor = a * d - b * b;
    // Relative to the matrix's own size, or a small matrix would always appear singular.
    let size = a.abs().max(d.abs()).max(f.abs());
    let positive =
        a > 0.0 && minor > 1e-12 * size * size && determinant > 1e-12 * size * size * size;
    positive.then(|| {
        let (c11, c12) = (a * f - c * c, b * c - a * e);
        Vector3::new(
            c00 * g.x + c01 * g.y + c02 * g.z,
            c01 * g.x + c11 * g.y + c12 * g.z,
            c02 * g.x + c12 * g.y + minor * g.z,
        ) / determinant
    })
}

/// Rotation by about `ω`: exactly orthogonal, and equal to `exp[ω]` to second order.
fn cayley(w: &Vector3<f64>) -> Matrix3<f64> {
    let h = w * 0.5;
    // `I + f ([h] + [h]²)`, entry by entry like `curvature`.
    let f = 2.0 / (1.0 + h.norm_squared());
    let on = |a: f64, b: f64| 1.0 - (a * a + b * b) * f;
    let (xy, xz, yz) = (h.x * h.y, h.x * h.z, h.y * h.z);
    Matrix3::new(
        on(h.z, h.y),
        (xy - h.z) * f,
        (xz + h.y) * f,
        (xy + h.z) * f,
        on(h.z, h.x),
        (yz - h.x) * f,
        (xz - h.y) * f,
        (yz + h.x) * f,
        on(h.y, h.x),
    )
}

/// Removes the rounding errors of many products from a rotation.
pub(crate) fn clean(r: &Rotation3<f64>) -> Rotation3<f64> {
    nalgebra::UnitQuaternion::from_rotation_matrix(r).to_rotation_matrix()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn any_rotation() -> impl Strategy<Value = Rotation3<f64>> {
        prop::array::uniform3(-3.0..3.0f64).prop_map(|w| Rotation3::new(Vector3::from(w)))
    }

    proptest! {
        #[test]
        fn no_rotation_beats_the_nearest(
            entries in prop::array::uniform9(-1.0..1.0f64),
            guess in any_rotation(),
            other in any_rotation(),
        ) {
            let m = Matrix3::from_row_slice(&entries);
            let best = nearest_rotation(&m, &guess);
            let score = |r: &Rotation3<f64>| r.matrix().tr_mul(&m).trace();
            prop_assert!((best.matrix().tr_mul(best.matrix()) - Matrix3::identity()).norm() < 1e-9);
            prop_assert!(best.matrix().determinant() > 0.0);
            prop_assert!(score(&best) >= score(&other) - 1e-9);
        }

        #[test]
        fn polar_factor_of_a_stretched_rotation(r in any_rotation(), s in prop::array::uniform3(0.2..2.0f64)) {
            let m = r.matrix() * Matrix3::from_diagonal(&Vector3::from(s));
            let found = nearest_rotation(&m, &Rotation3::identity());
            prop_assert!((found.matrix() - r.matrix()).norm() < 1e-7);
        }
    }

    #[test]
    fn zero_keeps_the_guess() {
        let guess = Rotation3::new(Vector3::new(0.3, 0.1, -0.2));
        assert_eq!(nearest_rotation(&Matrix3::zeros(), &guess), guess);
    }
}
