//! Counts that describe a mesh, as mesh tools report them.
//!
//! ```text
//! open edge           one triangle          non-manifold edge    more than two
//! watertight          every edge has exactly two triangles
//! Euler number        V − E + F over the vertices that triangles use:  2 for a sphere, 0 for a torus
//! components          triangles joined over edges
//! ```
//! Vertices that coincide in the file (0.1 µm) are merged, as mesh tools do; triangles that become degenerate are dropped.

use nalgebra::Point3;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Vertices nearer than this, metres, coincide: the precision of the files.
const SAME: f64 = 1e-7;

/// Counts that tell whether a mesh is closed, manifold and in one piece.
///
/// ```
/// use explore_loop::measure::MeshReport;
/// use explore_loop::nalgebra::Point3;
///
/// let corners = [[0.0; 3], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]].map(Point3::from);
/// let triangles = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
/// let closed = MeshReport::of(&corners, &triangles);
/// assert!(closed.watertight && closed.euler == 2 && closed.components == 1);
/// // Without one of its four triangles it has a hole with three edges.
/// let open = MeshReport::of(&corners, &triangles[..3]);
/// assert!(!open.watertight && open.open_edges == 3 && open.euler == 1);
/// ```
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct MeshReport {
    /// Whether every edge has exactly two triangles; an empty mesh is not watertight.
    pub watertight: bool,
    /// Vertices less edges plus triangles.
    pub euler: i64,
    /// Edges with one triangle.
    pub open_edges: usize,
    /// Edges with more than two triangles.
    pub non_manifold_edges: usize,
    /// Edges with two triangles of opposite orientations.
    pub misoriented_edges: usize,
    /// Number of components of triangles joined over edges.
    pub components: usize,
}

impl MeshReport {
    /// Counts; triangles with an index out of range are ignored.
    ///
    /// # Complexity
    /// `O(n log n)`.
    pub fn of(vertices: &[Point3<f64>], triangles: &[[u32; 3]]) -> Self {
        let triangles = welded(vertices, triangles);
        let mut used: Vec<u32> = triangles.as_flattened().to_vec();
        used.sort_unstable();
        used.dedup();
        // The triangles at each edge, and whether each traverses it upward.
        let mut edges: BTreeMap<[u32; 2], Vec<(usize, bool)>> = BTreeMap::new();
        for (index, t) in triangles.iter().enumerate() {
            for k in 0..3 {
                let (a, b) = (t[k], t[(k + 1) % 3]);
                edges
                    .entry([a.min(b), a.max(b)])
                    .or_default()
                    .push((index, a < b));
            }
        }
        let open_edges = edges.values().filter(|sides| sides.len() == 1).count();
        let non_manifold_edges = edges.values().filter(|sides| sides.len() > 2).count();
        let misoriented = |sides: &Vec<(usize, bool)>| sides.len() == 2 && sides[0].1 == sides[1].1;
        Self {
            watertight: !triangles.is_empty() && open_edges == 0 && non_manifold_edges == 0,
            euler: signed(used.len()) - signed(edges.len()) + signed(triangles.len()),
            open_edges,
            non_manifold_edges,
            misoriented_edges: edges.values().filter(|sides| misoriented(sides)).count(),
            components: components(triangles.len(), edges.values()),
        }
    }
}

/// A count as a signed number; indices have 32 bits, so it always fits.
fn signed(count: usize) -> i64 {
    i64::try_from(count).unwrap_or(i64::MAX)
}

/// The triangles after coincident vertices are merged.
fn welded(vertices: &[Point3<f64>], triangles: &[[u32; 3]]) -> Vec<[u32; 3]> {
    let mut first: BTreeMap<[i64; 3], u32> = BTreeMap::new();
    let same: Vec<u32> = vertices
        .iter()
        .enumerate()
        .map(|(i, p)| {
            let key = [p.x, p.y, p.z].map(|c| (c / SAME).round() as i64);
            *first.entry(key).or_insert(i as u32)
        })
        .collect();
    triangles
        .iter()
        .filter(|t| t.iter().all(|i| (*i as usize) < same.len()))
        .map(|t| t.map(|i| same[i as usize]))
        .filter(|[a, b, c]| a != b && b != c && c != a)
        .collect()
}

fn components<'a>(triangles: usize, edges: impl Iterator<Item = &'a Vec<(usize, bool)>>) -> usize {
    let mut parent: Vec<usize> = (0..triangles).collect();
    let mut pieces = triangles;
    for sides in edges {
        for pair in sides.windows(2) {
            let (a, b) = (root(&mut parent, pair[0].0), root(&mut parent, pair[1].0));
            if a != b {
                parent[a] = b;
                pieces -= 1;
            }
        }
    }
    pieces
}

fn root(parent: &mut [usize], mut i: usize) -> usize {
    while parent[i] != i {
        parent[i] = parent[parent[i]];
        i = parent[i];
    }
    i
}
