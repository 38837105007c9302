use derive_setters::Setters;
use nalgebra::{Matrix3, Vector3};

use crate::error::Error;
use crate::weight::Weight;

/// Support of a node.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Support {
    /// The same radius for every node, in m; about 2.3 spacings is best on surfaces.
    Radius(f64),
    /// Each node reaches to this number of nearest other nodes, which adapts to a varying spacing.
    Nearest(usize),
}

/// Options of a [`Field`](crate::Field).
///
/// ```
/// use gpwrm::{FieldOptions, Support};
/// let options = FieldOptions::default().with_support(Support::Radius(0.03));
/// assert_eq!(options.shrinkage, 0.003);
/// ```
#[derive(Debug, Clone, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct FieldOptions {
    /// Support of a node. Default: its 16 nearest, which on a surface is 2.3 spacings.
    pub support: Support,
    /// Radial weight. Default: [`Weight::WendlandC2`].
    pub weight: Weight,
    /// `ε`: how strongly a gradient is shrunk towards the local rotation, relative to the spread of the neighbours.
    /// Default .003, for exact displacements; .01 suits a node noise of 3 % of the spacing. Along an axis with the share `λ` of
    /// the spread (about ½ within a surface) it removes `ε/(λ + ε)` of a strain, and nothing of a rotation.
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
        // With zero, flat neighbourhoods would be singular.
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

/// How well the nodes around a point determine the gradient there (paper, Lemma 2).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Determinacy {
    /// Fewer than three nodes, or all collinear: their roll is assumed to be that of the nearest node with a determined one, or
    /// else zero.
    Undetermined,
    /// Three or more nodes that spread within a surface: the rotation is determined, the strain across the surface is not.
    Partly,
    /// Four or more nodes that spread in all directions: the whole gradient is determined by data.
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
    /// How well the gradient is determined by data.
    pub determinacy: Determinacy,
    /// Distance to the nearest node, in m; after [`Field::then`](crate::Field::then) at least the distance of the nodes around from
    /// those of the later field.
    pub extrapolation: f64,
    /// Whether the point lies outside the support of every node, so that the value is extrapolated from the nearest ones; or whether the nodes around
    /// were outside that of the later field.
    pub extrapolated: bool,
}
