//! Simplices that glue what is near in space and far on the surface, and their removal.
//!
//! ```text
//! A1 = ‖u_a − u_b‖          A2 = u_a·u_b / (‖u_a‖‖u_b‖)          u: displacements of the ends of an edge
//! ```
//!
//! Such edges betray themselves when the object opens: their ends part (`A1` high) or move different ways (`A2` low).
//! Cutting an edge takes every simplex that contains it, and the points that are left without any edge.

use crate::complex::{Adjacency, Complex};
use crate::error::Error;
use nalgebra::Vector3;
use std::sync::OnceLock;

/// `A1 = ‖u_a − u_b‖`, m: how far the ends of an edge have parted.
pub fn displacement_difference(u_a: &Vector3<f64>, u_b: &Vector3<f64>) -> f64 {
    (u_a - u_b).norm()
}

/// `A2 = cos ∠(u_a, u_b)`, or `None` if one of them does not move.
pub fn displacement_cosine(u_a: &Vector3<f64>, u_b: &Vector3<f64>) -> Option<f64> {
    let norms = u_a.norm() * u_b.norm();
    (norms > 0.0).then(|| (u_a.dot(u_b) / norms).clamp(-1.0, 1.0))
}

/// When an edge counts as distorted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DistortionLimits {
    /// Largest `A1`, m.
    pub max_difference: f64,
    /// Least `A2`.
    pub min_cosine: f64,
    /// Displacements shorter than this have no direction: `A2` is not asked of them, m.
    pub min_displacement: f64,
}

/// What a cut has removed.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Removed {
    /// Vertices: those named and those left without an edge.
    pub vertices: Vec<u32>,
    /// Number of edges.
    pub edges: usize,
    /// Number of triangles.
    pub triangles: usize,
    /// Number of tetrahedra.
    pub tetrahedra: usize,
}

impl Complex {
    /// Edges whose ends have moved apart (`A1`) or different ways (`A2`), by the displacement (m) of every vertex.
    ///
    /// # Errors
    /// [`Error::LengthMismatch`].
    pub fn distorted_edges(
        &self,
        displacements: &[Vector3<f64>],
        limits: &DistortionLimits,
    ) -> Result<Vec<[u32; 2]>, Error> {
        if displacements.len() != self.points.len() {
            let others = displacements.len();
            return Err(Error::LengthMismatch {
                points: self.points.len(),
                what: "displacements",
                others,
            });
        }
        let distorted = |[a, b]: [u32; 2]| {
            let (u_a, u_b) = (&displacements[a as usize], &displacements[b as usize]);
            let moves = u_a.norm().min(u_b.norm()) >= limits.min_displacement;
            displacement_difference(u_a, u_b) > limits.max_difference
                || (moves && displacement_cosine(u_a, u_b).is_some_and(|c| c < limits.min_cosine))
        };
        Ok(self
            .edges()
            .iter()
            .copied()
            .filter(|edge| distorted(*edge))
            .collect())
    }

    /// Removes `edges` and `vertices` with every simplex that contains one of them, and the vertices that thereby lose their last
    /// edge. Vertex indices stay what they are; edges that do not exist are passed over.
    ///
    /// # Errors
    /// [`Error::NoSuchVertex`]; the complex is then unchanged.
    pub fn cut(&mut self, edges: &[[u32; 2]], vertices: &[u32]) -> Result<Removed, Error> {
        for &v in edges.iter().flatten().chain(vertices) {
            self.check_vertex(v)?;
        }
        let before = self.counts();
        let mut present = self.present.clone();
        for &v in vertices {
            present[v as usize] = false;
        }
        let gone = |[a, b]: &[u32; 2]| !(present[*a as usize] && present[*b as usize]);
        let mut cut: Vec<bool> = self.edges().iter().map(gone).collect();
        for &[a, b] in edges {
            if let Some(edge) = self.find_edge(a, b) {
                cut[edge] = true;
            }
        }
        self.skeleton = self.skeleton.without(&cut, self.points.len());
        let adjacency = Adjacency::new(&self.skeleton.edges, self.points.len());
        for v in 0..self.points.len() as u32 {
            let lost_all = adjacency.neighbours(v).is_empty() && !self.neighbours(v).is_empty();
            present[v as usize] &= !lost_all;
        }
        let removed = (0..present.len()).filter(|&v| self.present[v] && !present[v]);
        let vertices = removed.map(|v| v as u32).collect();
        (self.adjacency, self.present, self.barcode) = (adjacency, present, OnceLock::new());
        let after = self.counts();
        let [_, edges, triangles, tetrahedra] = std::array::from_fn(|d| before[d] - after[d]);
        Ok(Removed {
            vertices,
            edges,
            triangles,
            tetrahedra,
        })
    }
}
