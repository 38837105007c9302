//! Linear shape functions: the displacement at a point as a weighted sum of node displacements.
//!
//! Moving least squares with the basis `(1, x, y, z)` over the nearest nodes, in centred form, `Σ w = 1`:
//!
//! ```text
//! φ_i(p) = w_i [ 1 + (p − x̄)ᵀ (M + κ τ I)⁻¹ (x_i − x̄) ],   x̄ = Σ w x,  M = Σ w (x − x̄)(x − x̄)ᵀ,  τ = tr M
//! ```
//!
//! `Σ φ = 1` always. `φ` is the same for every component and every displacement, as registration, filter and
//! planner require: `u(p) = Φ(p) U` is linear in `U`. On the other hand, the derivative across a flat neighbourhood is damped
//! by `κ`, so use these on the surface and [`Field::shape`](crate::Field::shape) off it.

use nalgebra::{Matrix3, Point3, Vector3};

use crate::error::{Error, check_coordinates};
use crate::nodal::weight_at;
use crate::tree::{Neighbour, Tree};
use crate::weight::Weight;

/// `κ`: keeps `M` invertible for coplanar or collinear nodes, and costs 2 % of the in-plane gradient.
const DAMPING: f64 = 0.01;

/// Linear shape functions over a set of nodes.
///
/// ```
/// use gpwrm::ShapeFunctions;
/// use nalgebra::Point3;
///
/// let nodes: Vec<_> = (0..25).map(|k| Point3::new(f64::from(k % 5), f64::from(k / 5), 0.0)).collect();
/// let shapes = ShapeFunctions::new(&nodes, 8)?;
/// let sum: f64 = shapes.at(&Point3::new(1.3, 2.2, 0.1)).iter().map(|(_, phi)| phi).sum();
/// assert!((sum - 1.0).abs() < 1e-12);
/// # Ok::<(), gpwrm::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct ShapeFunctions {
    nodes: Vec<Point3<f64>>,
    tree: Tree,
    count: usize,
}

impl ShapeFunctions {
    /// Shape functions over the `count` nearest of `nodes`.
    ///
    /// # Errors
    /// No nodes, a coordinate that is not finite, or `count` zero.
    pub fn new(nodes: &[Point3<f64>], count: usize) -> Result<Self, Error> {
        check_coordinates("node", nodes.iter().map(|p| &p.coords))?;
        if count == 0 {
            return Err(Error::BadOption {
                option: "count",
                value: 0.0,
                bound: "at least 1",
            });
        }
        Ok(Self {
            nodes: nodes.to_vec(),
            tree: Tree::over(nodes).ok_or(Error::NoNodes)?,
            count,
        })
    }

    /// Node indices and `φ` at `p`, nearest node first; empty if `p` is not finite.
    pub fn at(&self, p: &Point3<f64>) -> Vec<(usize, f64)> {
        linear(&self.nodes, &self.tree, p, self.count)
    }
}

/// `φ` over the `count` nearest nodes. The support ends at the next node, so that `φ` is continuous in `p`.
fn linear(nodes: &[Point3<f64>], tree: &Tree, p: &Point3<f64>, count: usize) -> Vec<(usize, f64)> {
    let mut near = tree.nearest_n(p, count.saturating_add(1).min(nodes.len()));
    let Some(last) = near.last().copied() else {
        return Vec::new();
    };
    let radius = if near.len() > count {
        near.pop();
        last.distance()
    } else {
        // All nodes are used: the support extends beyond the last, so that it counts too.
        1.5 * last.distance()
    };
    let weights = normalised_weights(&near, radius);
    let offset = |k: usize| nodes[near[k].index] - p;
    let mean: Vector3<f64> = (0..near.len()).map(|k| weights[k] * offset(k)).sum();
    let mut scatter = Matrix3::zeros();
    for k in 0..near.len() {
        let d = offset(k) - mean;
        scatter += weights[k] * d * d.transpose();
    }
    let damped = scatter + Matrix3::from_diagonal_element(DAMPING * scatter.trace());
    // If all nodes coincide only the weights remain.
    let slope = damped
        .cholesky()
        .map_or_else(Vector3::zeros, |factor| factor.solve(&-mean));
    (0..near.len())
        .map(|k| {
            let linear = 1.0 + slope.dot(&(offset(k) - mean));
            (near[k].index, weights[k] * linear)
        })
        .collect()
}

/// Weights with sum one; equal if all are zero (all nodes exactly at the support radius).
fn normalised_weights(near: &[Neighbour], radius: f64) -> Vec<f64> {
    let raw: Vec<f64> = near
        .iter()
        .map(|n| weight_at(Weight::WendlandC2, n.distance(), radius))
        .collect();
    let total: f64 = raw.iter().sum();
    if total > 1e-200 {
        raw.iter().map(|w| w / total).collect()
    } else {
        vec![1.0 / raw.len() as f64; raw.len()]
    }
}
