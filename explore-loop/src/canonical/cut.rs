//! Cutting distorted edges: those that glue places which only touched.
//!
//! Two places that touch look like one surface: an edge glues them. When the object opens, the ends of such an edge move
//! apart. With the turn of the surface taken out (a rigid turn moves the ends differently, too), the first
//! measure of the paper (section on homeomorphic reconstruction, eq. 19) is
//!
//! ```text
//! A1(i, j) = ‖ (x_j − x_i) − R_i (X_j − X_i) ‖ ,        cut where A1 > 3 ε and both ends are measured
//! ```
//! A cut edge stays cut: it enters neither the surface graph, nor the mesh, nor the complex again, and takes its cofaces
//! along. Vertices that lose their last edge go too; new observations fill the place.

use super::CanonicalModel;

/// Separation of the ends beyond which an edge is distorted, in spacings: far more than strain and
/// the sliding of registration make of one edge.
const APART: f64 = 3.0;

/// Edges of the surface graph that have opened; `measured[i]` marks vertices whose live position was seen in this frame.
pub fn distorted(model: &CanonicalModel, measured: &[bool], spacing: f64) -> Vec<[u32; 2]> {
    let opened = |i: usize, j: usize| {
        let turned = model.rotations[i] * (model.rest[j] - model.rest[i]);
        ((model.live[j] - model.live[i]) - turned).norm() > APART * spacing
    };
    model
        .edges
        .iter()
        .filter(|[a, b]| measured[*a as usize] && measured[*b as usize])
        // Seen from either end: one wrong rotation alone does not cut.
        .filter(|[a, b]| opened(*a as usize, *b as usize) && opened(*b as usize, *a as usize))
        .copied()
        .collect()
}

impl CanonicalModel {
    /// Cuts edges for good; returns how many were not cut before.
    pub fn cut(&mut self, edges: &[[u32; 2]]) -> usize {
        let before = self.cuts.len();
        for edge in edges {
            self.cuts.insert(self.identities(*edge));
        }
        self.cuts.len() - before
    }

    /// Whether the edge between two vertices is cut.
    pub fn is_cut(&self, edge: [u32; 2]) -> bool {
        !self.cuts.is_empty() && self.cuts.contains(&self.identities(edge))
    }

    /// The cut edges both of whose ends are still in the model, as indices.
    pub fn cut_edges(&self) -> Vec<[u32; 2]> {
        let index = |id: u64| self.ids.binary_search(&id).ok().map(|i| i as u32);
        self.cuts
            .iter()
            .filter_map(|[a, b]| Some([index(*a)?, index(*b)?]))
            .collect()
    }

    fn identities(&self, [a, b]: [u32; 2]) -> [u64; 2] {
        let (a, b) = (self.ids[a as usize], self.ids[b as usize]);
        [a.min(b), a.max(b)]
    }
}
