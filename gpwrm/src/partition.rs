//! The partition of unity: the weight of every node at a point.
//!
//! ```text
//! ψ_i(p) = W(‖p − x_i‖ / ρ_i(p)) / Σ_j W(‖p − x_j‖ / ρ_j(p)),      ρ_i(p) = ρ_i + min_j ‖p − x_j‖
//! ```
//!
//! The support grows with the distance to the nearest node, so that a point off the surface uses a wider patch of it
//! and every point of space has nodes in reach.

use nalgebra::{Point3, Vector3};

use crate::reach::Reach;
use crate::tree::Tree;
use crate::weight::Weight;

/// The weights of a set of nodes at every point of space.
#[derive(Debug, Clone)]
pub(crate) struct Partition {
    pub nodes: Vec<Point3<f64>>,
    pub radii: Vec<f64>,
    pub tree: Tree,
    reach: Reach,
    weight: Weight,
}

/// The part of one node in an evaluation: `ψ_i` and `∇ψ_i`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Part {
    pub node: usize,
    pub weight: f64,
    pub slope: Vector3<f64>,
}

/// The position of a point relative to the nodes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Place {
    /// Distance to the nearest node.
    pub distance: f64,
    /// Whether the point lies within `ρ_i` of some node `i`, before any growth.
    pub reached: bool,
}

impl Partition {
    pub fn new(nodes: &[Point3<f64>], radii: Vec<f64>, tree: Tree, weight: Weight) -> Self {
        let reach = Reach::new(nodes, &tree, &radii);
        Self {
            nodes: nodes.to_vec(),
            radii,
            tree,
            reach,
            weight,
        }
    }

    /// Fills `parts` with the nodes in reach of `p`; returns `None` if `p` is not finite.
    pub fn at(&self, p: &Point3<f64>, parts: &mut Vec<Part>) -> Option<Place> {
        parts.clear();
        let nearest = self.tree.nearest(p)?.index;
        let distance = (p - self.nodes[nearest]).norm();
        if !distance.is_finite() {
            return None;
        }
        let outward = if distance > 0.0 {
            (p - self.nodes[nearest]) / distance
        } else {
            Vector3::zeros()
        };
        let mut reached = distance <= self.radii[nearest];
        self.reach
            .visit(nearest, self.radii[nearest], distance, p, &self.tree, |i| {
                let d = p - self.nodes[i];
                reached = reached || d.norm_squared() <= self.radii[i] * self.radii[i];
                parts.extend(self.raw(i, &d, distance, &outward));
            });
        normalise(parts, nearest);
        Some(Place { distance, reached })
    }

    /// `W` and `∇W` of node `i`, at the offset `d` from it, before normalisation.
    fn raw(
        &self,
        i: usize,
        d: &Vector3<f64>,
        distance: f64,
        outward: &Vector3<f64>,
    ) -> Option<Part> {
        let radius = self.radii[i] + distance;
        if radius <= 0.0 {
            // All nodes coincide with the point.
            return Some(Part {
                node: i,
                weight: 1.0,
                slope: Vector3::zeros(),
            });
        }
        let t2 = d.norm_squared() / (radius * radius);
        if t2 >= 1.0 {
            return None;
        }
        let t = t2.sqrt();
        let slope = self.weight.slope_over_t(t) * (d / (radius * radius) - outward * (t2 / radius));
        Some(Part {
            node: i,
            weight: self.weight.value(t),
            slope,
        })
    }
}

/// Weights that sum to one, and their gradients.
fn normalise(parts: &mut Vec<Part>, nearest: usize) {
    let total: f64 = parts.iter().map(|part| part.weight).sum();
    if total < 1e-200 {
        // So far away that all weights underflow: only the nearest node is used.
        parts.clear();
        parts.push(Part {
            node: nearest,
            weight: 1.0,
            slope: Vector3::zeros(),
        });
        return;
    }
    let drift: Vector3<f64> = parts.iter().map(|part| part.slope).sum::<Vector3<f64>>() / total;
    for part in parts {
        part.weight /= total;
        part.slope = part.slope / total - part.weight * drift;
    }
}
