//! Cuts distorted edges, which join parts that only touched.
//!
//! Two parts that touch look like one surface: an edge joins them. When the object opens, the ends of such an edge move
//! apart. With the local rotation removed (a rigid rotation also moves the ends differently), the first measure of the
//! paper (section on homeomorphic reconstruction, eq. 19) is
//!
//! ```text
//! A1(i, j) = ‖ (x_j − x_i) − R_i (X_j − X_i) ‖ ,        cut where A1 > 3 ε and both ends are measured
//! ```
//! A cut edge stays cut: it never returns to the surface graph, the mesh or the complex, and its cofaces are removed with
//! it. Vertices that lose their last edge are removed too; new observations fill the gap.
//!
//! [`distorted`] is for pipelines that track vertices; the elastic body of this crate's loop stretches by less than that. The loop cuts only what comes apart
//! where parts touched, while they are pulled apart, and then separates the closed surface there ([`CanonicalModel::parted`]).

use super::CanonicalModel;
use nalgebra::Point3;

/// Separation of the ends beyond which an edge is distorted, in spacings: far more than strain and
/// registration errors cause.
const APART: f64 = 3.0;

/// Edges of the surface graph that have opened; `measured[i]` marks vertices whose live position was observed in this frame.
///
/// ```
/// use explore_loop::canonical::cut::distorted;
/// use explore_loop::canonical::{CanonicalModel, NewVertex};
/// use explore_loop::nalgebra::{Point3, Vector3};
///
/// let spacing = 0.005;
/// let mut model = CanonicalModel::default();
/// for x in [0.0, 0.006] {
///     model.push(NewVertex::new(Point3::new(x, 0.0, 0.5), -Vector3::z_axis()), 0);
/// }
/// model.join(spacing);
/// assert!(distorted(&model, &[true, true], spacing).is_empty());
/// // The two parts open by 20 mm: the edge between them is cut, and stays so.
/// model.live_mut()[1].x += 0.02;
/// let opened = distorted(&model, &[true, true], spacing);
/// assert_eq!(opened, [[0, 1]]);
/// assert_eq!(model.cut(&opened), 1);
/// model.join(spacing);
/// assert!(model.edges().is_empty());
/// ```
pub fn distorted(model: &CanonicalModel, measured: &[bool], spacing: f64) -> Vec<[u32; 2]> {
    let opened = |i: usize, j: usize| {
        let turned = model.rotations[i] * (model.rest[j] - model.rest[i]);
        ((model.live[j] - model.live[i]) - turned).norm() > APART * spacing
    };
    model
        .edges
        .iter()
        .filter(|[a, b]| measured[*a as usize] && measured[*b as usize])
        // Tested from both ends, so that one wrong rotation does not cut an edge.
        .filter(|[a, b]| opened(*a as usize, *b as usize) && opened(*b as usize, *a as usize))
        .copied()
        .collect()
}

impl CanonicalModel {
    /// Cuts edges permanently; returns how many were not cut before.
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

    /// The rest positions of the pairs of vertices that were cut, m: what has been seen to come apart.
    pub fn parted(&self) -> Vec<[Point3<f64>; 2]> {
        let edges = self.cut_edges().into_iter();
        edges
            .map(|edge| edge.map(|v| self.rest[v as usize]))
            .collect()
    }

    fn identities(&self, [a, b]: [u32; 2]) -> [u64; 2] {
        let (a, b) = (self.ids[a as usize], self.ids[b as usize]);
        [a.min(b), a.max(b)]
    }
}
