//! Equations on embedded points with a variance, and inequalities that must hold.
//!
//! ```text
//! row            d · (x(e) − q) = 0,  variance 1/w       (all three coordinates where no direction d is given)
//! inequality     Σ_t a_t · x(e_t) ≥ b
//! ```

use nalgebra::{Point3, UnitVector3, Vector3};

use super::lattice::{Embedding, Lattice};
use crate::Error;
use crate::graph::usable_point;
use crate::observation::{check_inequality, largest};

/// Largest weight of a row, 1/m²: a standard deviation of a nanometre.
const HEAVIEST: f64 = 1e18;

/// A linear equation on an embedded point: `direction · (x(at) − target) = 0`, or all three coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Row {
    /// The point.
    pub at: Embedding,
    /// Its target position.
    pub target: Point3<f64>,
    /// The direction along which it holds; all directions if `None`.
    pub direction: Option<UnitVector3<f64>>,
    /// One over its variance, 1/m²; at most 1e18.
    pub weight: f64,
}

impl Row {
    /// The point is at `target`, with a weight of one over the variance of each coordinate, 1/m².
    pub fn point(at: Embedding, target: Point3<f64>, weight: f64) -> Self {
        Self {
            at,
            target,
            direction: None,
            weight,
        }
    }

    /// The point lies on the plane through `target` with normal `direction`, with a weight of one over the variance, 1/m².
    pub fn along(
        at: Embedding,
        target: Point3<f64>,
        direction: UnitVector3<f64>,
        weight: f64,
    ) -> Self {
        Self {
            at,
            target,
            direction: Some(direction),
            weight,
        }
    }

    /// Rejects a row that is invalid for this lattice.
    pub(crate) fn check(&self, index: usize, lattice: &Lattice) -> Result<(), Error> {
        lattice.check_embedding("row", index, &self.at)?;
        if !usable_point(&self.target) {
            return Err(Error::NonFinitePoint {
                what: "target of row",
                index,
                value: self.target.coords.into(),
            });
        }
        if let Some(direction) = &self.direction {
            check_unit("length of direction of row", index, direction)?;
        }
        if !(0.0..=HEAVIEST).contains(&self.weight) {
            return Err(Error::Value {
                what: "weight of row",
                index,
                value: self.weight,
                must: "between 0 and 1e18",
            });
        }
        Ok(())
    }
}

/// Rejects a direction whose length is not one.
pub(crate) fn check_unit(
    what: &'static str,
    index: usize,
    direction: &UnitVector3<f64>,
) -> Result<(), Error> {
    let value = direction.norm();
    // Written so that NaN is rejected too.
    if (value - 1.0).abs() < 1e-6 {
        return Ok(());
    }
    Err(Error::Value {
        what,
        index,
        value,
        must: "1",
    })
}

/// A linear inequality `Σ_t a_t · x(e_t) ≥ bound` over a few embedded points, which the estimate satisfies.
///
/// Satisfied to 1e-6 times the largest `‖a_t‖`: with unit vectors, to a micrometre. It moves the estimate and adds no information.
///
/// ```
/// use topo_ekf::body::{BodyInequality, Embedding};
/// use topo_ekf::nalgebra::{UnitVector3, Vector3};
/// // A vertex stays 2 mm above a triangle of the surface.
/// let vertex = Embedding::new(0, [0.5, 0.5, 1.0]);
/// let triangle = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]].map(|[u, v]| Embedding::new(7, [u, v, 0.0]));
/// let normal = UnitVector3::new_normalize(Vector3::z());
/// let row = BodyInequality::separation(vertex, triangle, [0.2, 0.5, 0.3], normal, 2e-3);
/// assert_eq!(row.terms.len(), 4);
/// ```
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct BodyInequality {
    /// Points with their coefficient vectors `a_t`; a point that occurs twice counts with the sum.
    pub terms: Vec<(Embedding, Vector3<f64>)>,
    /// Lower bound, metres times the unit of the coefficients.
    pub bound: f64,
}

impl BodyInequality {
    /// A vertex of the surface stays at least `separation` metres above a triangle of it, on the side of `normal`:
    /// `normal · (x(vertex) − Σ_k b_k x(corner_k)) ≥ separation`, with the barycentric weights `b` of the foot of the vertex in the
    /// triangle and the triangle's unit normal, both at present (a linearisation: renew it every frame).
    pub fn separation(
        vertex: Embedding,
        triangle: [Embedding; 3],
        barycentric: [f64; 3],
        normal: UnitVector3<f64>,
        separation: f64,
    ) -> Self {
        let normal = normal.into_inner();
        let corners = triangle.into_iter().zip(barycentric);
        let terms = std::iter::once((vertex, normal)).chain(corners.map(|(e, b)| (e, normal * -b)));
        Self {
            terms: terms.collect(),
            bound: separation,
        }
    }

    /// Rejects an inequality that is invalid for this lattice.
    pub(crate) fn check(&self, index: usize, lattice: &Lattice) -> Result<(), Error> {
        check_inequality(index, &self.terms, self.bound, |at| {
            lattice.check_embedding("inequality", index, at)
        })
    }

    /// `max ‖a_t‖`.
    pub(crate) fn largest(&self) -> f64 {
        largest(&self.terms)
    }
}
