//! Options of a complex: largest scale, treatment of normals, largest size.

use crate::error::{Error, positive};
use derive_setters::Setters;
use nalgebra::Vector3;

/// Whether the orientation of normals matters.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Orientation {
    /// Normals are axes without a sign: the plain nerve.
    Free,
    /// Cylinders whose normals have a dot product below `min_cosine` are never joined, so the two faces of a thin sheet stay
    /// separate even where the cylinders overlap. Triangles and tetrahedra follow from the edges.
    Separate {
        /// Smallest dot product of two normals that may be joined.
        min_cosine: f64,
    },
}

/// `Separate { min_cosine: −0.5 }`, see [`Options::orientation`].
impl Default for Orientation {
    fn default() -> Self {
        Self::Separate { min_cosine: -0.5 }
    }
}

impl Orientation {
    /// Whether cylinders with these normals are never joined.
    pub(crate) fn separates(self, a: &Vector3<f64>, b: &Vector3<f64>) -> bool {
        match self {
            Self::Separate { min_cosine } => a.dot(b) < min_cosine,
            Self::Free => false,
        }
    }
}

/// Options for building a complex.
#[derive(Debug, Clone, Copy, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Options {
    /// Largest filtration value kept (closed). Default 1: the complex at the cylinder's own size.
    pub max_scale: f64,
    /// Default `Separate { min_cosine: −0.5 }`: faces in opposite directions to within 60° stay separate, and a crease of up
    /// to 120° (a box has 90°) stays closed in spite of noisy normals.
    pub orientation: Orientation,
    /// Largest number of simplices of all dimensions, default ten million (about 0.7 GB); a larger complex is an error.
    pub max_simplices: usize,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            max_scale: 1.0,
            orientation: Orientation::default(),
            max_simplices: 10_000_000,
        }
    }
}

impl Options {
    /// Rejects invalid settings.
    pub(crate) fn check(&self) -> Result<(), Error> {
        positive("max_scale", self.max_scale)?;
        match self.orientation {
            Orientation::Separate { min_cosine } if !(-1.0..=1.0).contains(&min_cosine) => {
                Err(Error::OutOfRange {
                    what: "min_cosine",
                    value: min_cosine,
                    bound: "in [-1, 1]",
                })
            }
            _ => Ok(()),
        }
    }
}
