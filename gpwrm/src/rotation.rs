//! The rotation in a matrix (Horn 1987).
//!
//! ```text
//! R = argmax_{R ∈ SO(3)} tr(Rᵀ A)
//! ```
//!
//! is the rotational polar factor of `A` when `det A > 0`, and the best proper rotation otherwise. As a unit quaternion it
//! is the eigenvector of the largest eigenvalue of a symmetric 4 × 4 matrix that is linear in `A`; unlike a singular value
//! decomposition it needs no case for reflections and keeps full accuracy when `A` has rank two, as in every flat
//! neighbourhood.

use nalgebra::{Matrix3, Matrix4, Quaternion, Rotation3, SymmetricEigen, UnitQuaternion, Vector3};

/// The proper rotation closest to `matrix`: maximises `tr(Rᵀ A)`.
///
/// Where the maximum is not unique (rank one or zero) one of the maximisers is returned; a matrix with entries that are
/// not finite gives the identity.
///
/// ```
/// use gpwrm::nalgebra::{Matrix3, Rotation3, Vector3};
/// use gpwrm::nearest_rotation;
/// let turn = Rotation3::new(Vector3::new(0.3, -1.2, 2.0));
/// let stretch = Matrix3::new(2.0, 0.3, 0.0, 0.3, 1.0, 0.1, 0.0, 0.1, 0.5);
/// let found = nearest_rotation(&(turn.matrix() * stretch));
/// assert!((found.matrix() - turn.matrix()).amax() < 1e-12);
/// // Never a reflection, whatever the matrix.
/// let mirror = Matrix3::from_diagonal(&Vector3::new(3.0, 2.0, -1.0));
/// assert!((nearest_rotation(&mirror).matrix() - Matrix3::identity()).amax() < 1e-12);
/// ```
pub fn nearest_rotation(matrix: &Matrix3<f64>) -> Rotation3<f64> {
    let largest = matrix.amax();
    if !largest.is_finite() || largest <= f64::MIN_POSITIVE {
        return Rotation3::identity();
    }
    let a = matrix / largest;
    let s = |i: usize, j: usize| a[(j, i)];
    #[rustfmt::skip]
    let horn = Matrix4::new(
        s(0,0)+s(1,1)+s(2,2), s(1,2)-s(2,1), s(2,0)-s(0,2), s(0,1)-s(1,0),
        s(1,2)-s(2,1), s(0,0)-s(1,1)-s(2,2), s(0,1)+s(1,0), s(2,0)+s(0,2),
        s(2,0)-s(0,2), s(0,1)+s(1,0), s(1,1)-s(0,0)-s(2,2), s(1,2)+s(2,1),
        s(0,1)-s(1,0), s(2,0)+s(0,2), s(1,2)+s(2,1), s(2,2)-s(0,0)-s(1,1),
    );
    let eigen = SymmetricEigen::new(horn);
    let q = eigen.eigenvectors.column(eigen.eigenvalues.imax());
    let quaternion = Quaternion::new(q[0], q[1], q[2], q[3]);
    UnitQuaternion::new_normalize(quaternion).to_rotation_matrix()
}

/// Weight of the rotation of the previous round, as a share of the spread of the nodes.
const PULL: f64 = 1e-4;
/// Each round reduces the error by `PULL / (width of the neighbourhood)`: 12 rounds converge for every neighbourhood
/// that is not narrower than 1 : 30; narrower ones are handled by `collinear`.
const ROUNDS: usize = 12;

/// The rotation of a neighbourhood with unit-trace scatter `M` and `A = M + C`: the polar factor where the nodes
/// determine it, the least rotation where they do not (as when the motion collapses a patch onto a line).
///
/// `R ← argmax tr(Rᵀ(A + δR))`, from the identity, is a proximal iteration: what `A` does not determine stays as it was, that
/// is, unrotated. One round with a fixed pull toward the identity would leave an error of order `δ` in every rigid
/// motion; the iteration leaves none.
pub(crate) fn least_rotation(a: &Matrix3<f64>) -> Rotation3<f64> {
    let mut rotation = Rotation3::identity();
    for _ in 0..ROUNDS {
        let next = nearest_rotation(&(a + PULL * rotation.matrix()));
        let change = (next.matrix() - rotation.matrix()).amax();
        rotation = next;
        // Where the rotation is determined, the remaining error is at most `PULL` times the change: below rounding.
        if change < 1e-11 {
            break;
        }
    }
    rotation
}

/// The smallest rotation that maps unit vector `from` to unit vector `to`: the half turn about `from`, then the half turn about
/// the vector half-way between the two.
///
/// For opposite vectors, whose axis is undetermined, one perpendicular to `from` is used.
pub(crate) fn shortest_turn(from: &Vector3<f64>, to: &Vector3<f64>) -> Rotation3<f64> {
    let between = |from: &Vector3<f64>| {
        let half = (from + to)
            .try_normalize(1e-6)
            .unwrap_or_else(|| from.cross(&axis_aside(from)).normalize());
        half_turn(&half) * half_turn(from)
    };
    // Near opposition the sum loses digits; a second rotation, from the result of the first, restores them.
    let first = between(from);
    between(&(first * from)) * first
}

/// The half turn about the unit vector `axis`: `2aaᵀ − I`.
fn half_turn(axis: &Vector3<f64>) -> Rotation3<f64> {
    Rotation3::from_matrix_unchecked(2.0 * axis * axis.transpose() - Matrix3::identity())
}

/// A coordinate axis well away from `v`.
pub(crate) fn axis_aside(v: &Vector3<f64>) -> Vector3<f64> {
    let mut axis = Vector3::zeros();
    axis[v.iamin()] = 1.0;
    axis
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recovers_rotations_from_rank_two() {
        for k in 0..50 {
            let axis = Vector3::new(1.0, f64::from(k) - 20.0, 0.3 * f64::from(k)).normalize();
            let truth = Rotation3::new(axis * (f64::from(k) / 49.0 * std::f64::consts::PI));
            let scatter = Matrix3::from_diagonal(&Vector3::new(0.7, 0.3, 0.0));
            let found = least_rotation(&(truth.matrix() * scatter));
            assert!((found.matrix() - truth.matrix()).amax() < 1e-12, "{k}");
        }
    }

    #[test]
    fn collinear_nodes_take_the_least_rotation() {
        // All spread along x, which the motion turns into y: the least rotation is a quarter turn about z.
        let quarter = Rotation3::new(Vector3::z() * std::f64::consts::FRAC_PI_2);
        let a = quarter.matrix() * Matrix3::from_diagonal(&Vector3::new(1.0, 0.0, 0.0));
        assert!((least_rotation(&a).matrix() - quarter.matrix()).amax() < 1e-9);
    }

    #[test]
    fn shortest_turns_arrive_by_the_shortest_way() {
        let from = Vector3::new(0.36, 0.48, 0.8);
        let aside = from.cross(&Vector3::x()).normalize();
        for angle in [
            0.0,
            1e-9,
            0.3,
            1.5,
            3.0,
            std::f64::consts::PI - 1e-9,
            std::f64::consts::PI,
        ] {
            let to = Rotation3::new(aside * angle) * from;
            let turn = shortest_turn(&from, &to);
            assert!((turn * from - to).norm() < 1e-14, "{angle}");
            let found = ((turn.matrix().trace() - 1.0) / 2.0)
                .clamp(-1.0, 1.0)
                .acos();
            // The inverse cosine loses half the digits near 0 and π.
            assert!((found - angle).abs() < 1e-7, "{angle}: {found}");
        }
    }

    #[test]
    fn degenerate_matrices_give_some_rotation() {
        assert_eq!(nearest_rotation(&Matrix3::zeros()), Rotation3::identity());
        assert_eq!(
            nearest_rotation(&Matrix3::repeat(f64::NAN)),
            Rotation3::identity()
        );
        let flip = nearest_rotation(&-Matrix3::identity());
        assert!((flip.matrix().determinant() - 1.0).abs() < 1e-12);
    }
}
