use nalgebra::{Matrix3, Vector3};

use crate::error::Error;
use crate::weight::Weight;

/// How far a node reaches.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Support {
    /// The same radius for every node, in m; about 2.3 spacings is best on surfaces.
    Radius(f64),
    /// Each node reaches to its nearest so many others; follows a varying spacing.
    Nearest(usize),
}

/// Settings of a [`Field`](crate::Field).
///
/// ```
/// use gpwrm::{FieldOptions, Support};
/// let options = FieldOptions::default().with_support(Support::Radius(0.03));
/// assert_eq!(options.shrinkage, 0.003);
/// ```
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct FieldOptions {
    /// Reach of a node. Default: its 16 nearest, which on a surface is 2.3 spacings.
    pub support: Support,
    /// Radial weight. Default: [`Weight::WendlandC2`].
    pub weight: Weight,
    /// `ε`: how strongly a gradient is drawn to the local rotation, relative to the spread of the neighbours.
    /// Default .003, for displacements that are exact; .01 suits a node noise of 3 % of the spacing. Along an axis with the share `λ` of
    /// the spread (about ½ within a surface) it takes `ε/(λ + ε)` of a strain, and nothing of a rotation.
    pub shrinkage: f64,
}

impl Default for FieldOptions {
    fn default() -> Self {
        Self {
            support: Support::Nearest(16),
            weight: Weight::default(),
            shrinkage: 0.003,
        }
    }
}

impl FieldOptions {
    /// Sets the reach of a node.
    #[must_use]
    pub fn with_support(self, support: Support) -> Self {
        Self { support, ..self }
    }

    /// Sets the radial weight.
    #[must_use]
    pub fn with_weight(self, weight: Weight) -> Self {
        Self { weight, ..self }
    }

    /// Sets how strongly a gradient is drawn to the local rotation.
    #[must_use]
    pub fn with_shrinkage(self, shrinkage: f64) -> Self {
        Self { shrinkage, ..self }
    }

    pub(crate) fn check(&self) -> Result<(), Error> {
        match self.support {
            Support::Radius(radius) if !(radius > 0.0 && radius <= 1e60) => {
                return Err(Error::BadOption {
                    option: "support radius",
                    value: radius,
                    bound: "positive and at most 1e60 m",
                });
            }
            Support::Nearest(0) => {
                return Err(Error::BadOption {
                    option: "support count",
                    value: 0.0,
                    bound: "at least 1",
                });
            }
            _ => {}
        }
        // Zero would make flat neighbourhoods singular, which is what the shrinkage is for.
        if !(self.shrinkage >= 1e-12 && self.shrinkage <= 1e6) {
            return Err(Error::BadOption {
                option: "shrinkage",
                value: self.shrinkage,
                bound: "between 1e-12 and 1e6",
            });
        }
        Ok(())
    }
}

/// What the nodes around a point say about the gradient there (Lemma 2 of the [paper](https://doi.org/10.1177/02783649251415415)).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Determinacy {
    /// Fewer than three nodes, or all on a line: their roll is a guess, that of the nearest node that knows its own or else
    /// none.
    Undetermined,
    /// Three nodes or more that spread within a surface: the rotation is known, the strain across the surface is not.
    Partly,
    /// Four nodes or more that spread in all directions: the whole gradient comes from data.
    Determined,
}

/// The field at one point.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Sample {
    /// Displacement, in m.
    pub displacement: Vector3<f64>,
    /// Gradient of the displacement, `∂u_a/∂x_b`; the deformation gradient is `F = I + gradient`.
    pub gradient: Matrix3<f64>,
    /// How much of the gradient comes from data.
    pub determinacy: Determinacy,
    /// Distance to the nearest node, in m: how far the value is extrapolated; after [`Field::then`](crate::Field::then) at least as far as the nodes around were
    /// from those of the later field.
    pub extrapolation: f64,
    /// Whether the point lies outside the support of every node: none of the given reach surrounds it, and the value is
    /// continued from the nearest ones; or that the nodes around did so of the later field.
    pub extrapolated: bool,
}
