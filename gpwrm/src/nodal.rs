//! The fit of one node: the gradient of the displacement around it.
//!
//! With the weighted mean over the neighbourhood of node `i` (itself included), `⟨·⟩`, and `x̄ = ⟨x⟩`, `ū = ⟨u⟩`:
//!
//! ```text
//! M = ⟨(x − x̄)(x − x̄)ᵀ⟩      C = ⟨(u − ū)(x − x̄)ᵀ⟩      τ = tr M
//! R = the rotation in M + C, least rotation where undetermined
//! G = R − I + (C − (R − I) M)(M + ε τ I)⁻¹
//! ```
//!
//! `M` of nodes on a surface has (almost) no spread along the normal, so the data do not determine the derivative of the displacement
//! along it. Any rule that sets this derivative to zero (pseudo-inverse, truncation, Tikhonov on `G`) shears a patch that
//! has rotated. Here the prior is the local rotation `R`, which the spread within the surface does determine.
//!
//! For a rigid motion `C = (R − I) M`, whatever `M` is, so `G = R − I` whatever `ε` is. For an affine motion `x ↦ F x + t`,
//! `C = (F − I) M`, and along an axis of `M` with share `λ` of the spread
//!
//! ```text
//! G v = (F − I) v − ε/(λ + ε) (F − R) v
//! ```
//!
//! so the shrinkage removes the share `ε/(λ + ε)` of the strain: nothing of a rotation, 0.6 % of an in-plane strain at the default
//! `ε` (`λ ≈ ½`), and everything along a direction without spread.

use nalgebra::{Matrix3, Rotation3, Vector3};

use crate::collinear;
use crate::moments::{Moments, Sample};
use crate::options::Determinacy;
use crate::rotation::least_rotation;
use crate::weight::Weight;

/// Share of the spread perpendicular to the longest direction below which a neighbourhood counts as thin: 1 : 30 in width.
const THIN: f64 = 1e-3;
/// Number of roundings that may accumulate in the strain of a rigid motion: 8 is the most observed in 20,000 random neighbourhoods.
const SLACK: f64 = 64.0;

/// Gradient of the displacement at a node, the rotation towards which it was shrunk, and how well the neighbours determine it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct NodalFit {
    pub gradient: Matrix3<f64>,
    pub rotation: Rotation3<f64>,
    pub determinacy: Determinacy,
}

impl NodalFit {
    /// Fits `samples` with the shrinkage `ε`; undetermined parts of the rotation are taken from `base`.
    pub fn new(samples: &[Sample], shrinkage: f64, base: &Rotation3<f64>) -> Self {
        let Some(moments) = Moments::new(samples) else {
            return Self::unknown(base);
        };
        let (scatter, cross) = (&moments.scatter, &moments.cross);
        let spread = scatter.symmetric_eigenvalues();
        let (rotation, known) = if sorted(&spread)[1] >= THIN {
            (least_rotation(&(scatter + cross)), true)
        } else {
            collinear::rotation(&moments, samples, base)
        };
        let Some(inverse) = moments.damped_inverse(shrinkage) else {
            return Self::unknown(base);
        };
        let turn = rotation.matrix() - Matrix3::identity();
        let mut strain = cross - turn * scatter;
        // Rounding of a rigid motion, which a tiny `ε` would amplify along directions without spread.
        if strain.amax() <= SLACK * moments.rounding {
            strain.fill(0.0);
        }
        Self {
            gradient: turn + strain * inverse,
            rotation,
            determinacy: determinacy(&spread, shrinkage, known),
        }
    }

    /// The fit without any data beyond `base`.
    fn unknown(base: &Rotation3<f64>) -> Self {
        Self {
            gradient: base.matrix() - Matrix3::identity(),
            rotation: *base,
            determinacy: Determinacy::Undetermined,
        }
    }
}

/// The paper's Lemma 2, in terms of spread: a direction counts as observed when the data along it outweigh the prior.
fn determinacy(spread: &Vector3<f64>, shrinkage: f64, rotation_known: bool) -> Determinacy {
    if sorted(spread)[2] >= shrinkage.max(1e-9) {
        Determinacy::Determined
    } else if rotation_known {
        Determinacy::Partly
    } else {
        Determinacy::Undetermined
    }
}

/// Largest first.
fn sorted(spread: &Vector3<f64>) -> [f64; 3] {
    let mut shares = [spread.x, spread.y, spread.z];
    shares.sort_by(|a, b| b.total_cmp(a));
    shares
}

/// `W(distance / radius)`; with a radius of zero the node itself still has a weight.
pub(crate) fn weight_at(weight: Weight, distance: f64, radius: f64) -> f64 {
    if distance <= 0.0 {
        1.0
    } else if radius > distance {
        weight.value(distance / radius)
    } else {
        0.0
    }
}
