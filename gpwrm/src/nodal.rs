//! The fit of one node: the gradient of the displacement around it.
//!
//! With the weighted mean over the neighbourhood of node `i` (itself included), `⟨·⟩`, and `x̄ = ⟨x⟩`, `ū = ⟨u⟩`:
//!
//! ```text
//! M = ⟨(x − x̄)(x − x̄)ᵀ⟩      C = ⟨(u − ū)(x − x̄)ᵀ⟩      τ = tr M
//! R = polar(M + C), least rotation where undetermined
//! G = R − I + (C − (R − I) M)(M + ε τ I)⁻¹
//! ```
//!
//! `M` of nodes on a surface has (almost) no spread along the normal, so the data do not say how displacement changes
//! along it. Any rule that then answers "not at all" (pseudo-inverse, truncation, Tikhonov on `G`) shears a patch that
//! has turned. Here the prior is the local rotation `R`, which the spread within the surface does determine.

use nalgebra::{Matrix3, Point3, Vector3};

use crate::options::Determinacy;
use crate::rotation::least_rotation;
use crate::weight::Weight;

/// Gradient of the displacement at a node and how much of it the neighbours determine.
#[derive(Debug, Clone, Copy)]
pub(crate) struct NodalFit {
    pub gradient: Matrix3<f64>,
    pub determinacy: Determinacy,
}

/// A neighbour of a node: weight, rest position, displacement.
pub(crate) struct Sample<'a> {
    pub weight: f64,
    pub position: &'a Point3<f64>,
    pub displacement: &'a Vector3<f64>,
}

impl NodalFit {
    /// Nothing known: no gradient.
    const UNKNOWN: Self = Self {
        gradient: Matrix3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        determinacy: Determinacy::Undetermined,
    };

    /// Fits `samples`, with the shrinkage `ε`.
    pub fn new(samples: &[Sample], shrinkage: f64) -> Self {
        let Some((scatter, cross)) = moments(samples) else {
            return Self::UNKNOWN;
        };
        let turn = least_rotation(&(scatter + cross)).matrix() - Matrix3::identity();
        let damped = scatter + Matrix3::from_diagonal_element(shrinkage);
        let Some(inverse) = damped.cholesky().map(|factor| factor.inverse()) else {
            return Self::UNKNOWN;
        };
        Self {
            gradient: turn + (cross - turn * scatter) * inverse,
            determinacy: determinacy(&scatter, shrinkage),
        }
    }
}

/// `M/τ` and `C/τ`; nothing if all samples coincide.
fn moments(samples: &[Sample]) -> Option<(Matrix3<f64>, Matrix3<f64>)> {
    let first = samples.first()?;
    let (origin, base) = (first.position, first.displacement);
    let total: f64 = samples.iter().map(|s| s.weight).sum();
    let mut mean_position = Vector3::zeros();
    let mut mean_displacement = Vector3::zeros();
    for s in samples {
        mean_position += (s.position - origin) * (s.weight / total);
        mean_displacement += (s.displacement - base) * (s.weight / total);
    }
    let mut scatter = Matrix3::zeros();
    let mut cross = Matrix3::zeros();
    for s in samples {
        let d = s.position - origin - mean_position;
        let e = s.displacement - base - mean_displacement;
        scatter += s.weight * d * d.transpose();
        cross += s.weight * e * d.transpose();
    }
    let trace = scatter.trace();
    // Below this the spread is rounding error of coincident nodes, not geometry.
    (trace > f64::MIN_POSITIVE * 1e20).then(|| (scatter / trace, cross / trace))
}

/// Lemma 2 by spread: a direction counts as observed when the data along it outweigh the prior.
fn determinacy(scatter: &Matrix3<f64>, shrinkage: f64) -> Determinacy {
    let threshold = shrinkage.max(1e-9);
    let spread = scatter.symmetric_eigenvalues();
    match spread.iter().filter(|&&lambda| lambda >= threshold).count() {
        3 => Determinacy::Determined,
        2 => Determinacy::Partly,
        _ => Determinacy::Undetermined,
    }
}

/// `W(distance / radius)`, where a radius of zero still weighs the node itself.
pub(crate) fn weight_at(weight: Weight, distance: f64, radius: f64) -> f64 {
    if distance <= 0.0 {
        1.0
    } else if radius > distance {
        weight.value(distance / radius)
    } else {
        0.0
    }
}
