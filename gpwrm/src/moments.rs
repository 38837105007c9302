//! First and second moments of a neighbourhood at rest and displaced.
//!
//! ```text
//! x̄ = ⟨x⟩,   ū = ⟨u⟩,   M = ⟨(x − x̄)(x − x̄)ᵀ⟩,   C = ⟨(u − ū)(x − x̄)ᵀ⟩,   τ = tr M          ⟨·⟩: weighted mean
//! ```

use nalgebra::{Matrix3, Point3, Vector3};

/// A neighbour of a node: weight, rest position, displacement.
pub(crate) struct Sample<'a> {
    pub weight: f64,
    pub position: &'a Point3<f64>,
    pub displacement: &'a Vector3<f64>,
}

/// `M` and `C` divided by `τ`, and their reference points.
pub(crate) struct Moments {
    /// `M/τ`, of unit trace.
    pub scatter: Matrix3<f64>,
    /// `C/τ`.
    pub cross: Matrix3<f64>,
    /// `x̄`.
    pub centre: Point3<f64>,
    /// `ū`.
    pub shift: Vector3<f64>,
    /// `τ` with the given weights, not normalised.
    pub trace: f64,
    /// Rounding of a coordinate over the length `Σ w ‖d‖³ / Σ w ‖d‖²` of the neighbourhood: the tolerance for equality in `scatter` and `cross`,
    /// and for directions within it.
    pub rounding: f64,
    /// Rounding of a coordinate, in m, with room for a dozen operations.
    pub grain: f64,
}

impl Moments {
    /// `None` if all samples coincide.
    pub fn new(samples: &[Sample]) -> Option<Self> {
        let first = samples.first()?;
        let (origin, base) = (first.position, first.displacement);
        let total: f64 = samples.iter().map(|s| s.weight).sum();
        let mut mean_position = Vector3::zeros();
        let mut mean_displacement = Vector3::zeros();
        let mut largest = 0.0_f64;
        for s in samples {
            mean_position += (s.position - origin) * (s.weight / total);
            mean_displacement += (s.displacement - base) * (s.weight / total);
            largest = largest
                .max(s.position.coords.amax())
                .max(s.displacement.amax());
        }
        let mut scatter = Matrix3::zeros();
        let mut cross = Matrix3::zeros();
        let mut cubes = 0.0;
        for s in samples {
            let d = s.position - origin - mean_position;
            let e = s.displacement - base - mean_displacement;
            scatter += s.weight * d * d.transpose();
            cross += s.weight * e * d.transpose();
            cubes += s.weight * d.norm() * d.norm_squared();
        }
        let trace = scatter.trace();
        let grain = 16.0 * f64::EPSILON * largest;
        // A smaller spread is rounding error of coincident nodes, not geometry.
        (trace > f64::MIN_POSITIVE * 1e20).then(|| Self {
            scatter: scatter / trace,
            cross: cross / trace,
            centre: origin + mean_position,
            shift: base + mean_displacement,
            trace,
            rounding: 16.0 * f64::EPSILON + grain * trace / cubes,
            grain,
        })
    }

    /// `(M/τ + ε I)⁻¹`.
    pub fn damped_inverse(&self, shrinkage: f64) -> Option<Matrix3<f64>> {
        let damped = self.scatter + Matrix3::from_diagonal_element(shrinkage);
        damped.cholesky().map(|factor| factor.inverse())
    }
}
