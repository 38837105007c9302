//! The graph of the surface: edges with their rest vectors, neighbours, connected components.
//!
//! ```text
//! E_e = X_i − X_j  for edge e = (i, j)          rest vector
//! w_e = s_e / σ_e²                              weight, s_e the stiffness of the edge (1 unless set)
//! ```

use nalgebra::{Point3, Vector3};

use crate::Error;

/// Largest coordinate: squares of larger ones would lose precision elsewhere.
pub(crate) const FARTHEST: f64 = 1e9;

/// Undirected graph over the vertices. Parallel edges are allowed and add their stiffness.
#[derive(Clone, Debug)]
pub(crate) struct Graph {
    /// Ends of every edge.
    pub edges: Vec<[u32; 2]>,
    /// Rest vector of every edge, first end minus second.
    pub vectors: Vec<Vector3<f64>>,
    /// Stiffness of every edge.
    pub stiffness: Vec<f64>,
    /// Component of every vertex, numbered from 0 in the order of their first vertices.
    pub component: Vec<u32>,
    /// Number of components.
    pub components: usize,
}

impl Graph {
    /// Checks the input and builds the graph.
    pub fn new(rest: &[Point3<f64>], edges: &[[u32; 2]]) -> Result<Self, Error> {
        if rest.is_empty() {
            return Err(Error::NoVertices);
        }
        check_points("rest", rest)?;
        for (index, &[i, j]) in edges.iter().enumerate() {
            check_vertex("edge", index, i, rest.len())?;
            check_vertex("edge", index, j, rest.len())?;
            if i == j {
                return Err(Error::Loop { index, vertex: i });
            }
        }
        let vectors = edges
            .iter()
            .map(|&[i, j]| rest[i as usize] - rest[j as usize])
            .collect();
        let (component, components) = components(rest.len(), edges);
        Ok(Self {
            edges: edges.to_vec(),
            vectors,
            stiffness: vec![1.0; edges.len()],
            component,
            components,
        })
    }
}

/// Union-find with path halving; components are numbered by their first vertex.
fn components(vertices: usize, edges: &[[u32; 2]]) -> (Vec<u32>, usize) {
    let mut parent: Vec<usize> = (0..vertices).collect();
    let root = |parent: &mut Vec<usize>, mut i: usize| {
        while parent[i] != i {
            parent[i] = parent[parent[i]];
            i = parent[i];
        }
        i
    };
    for &[i, j] in edges {
        let (a, b) = (root(&mut parent, i as usize), root(&mut parent, j as usize));
        // The smaller index becomes the root, so the numbering does not depend on the order of the edges.
        parent[a.max(b)] = a.min(b);
    }
    let mut number = vec![u32::MAX; vertices];
    let mut count = 0;
    let component = (0..vertices)
        .map(|i| {
            let r = root(&mut parent, i);
            if number[r] == u32::MAX {
                number[r] = count;
                count += 1;
            }
            number[r]
        })
        .collect();
    (component, count as usize)
}

/// Rejects NaN, infinite and absurdly distant points.
pub(crate) fn check_points(what: &'static str, points: &[Point3<f64>]) -> Result<(), Error> {
    match points.iter().position(|p| !usable_point(p)) {
        Some(index) => Err(Error::NonFinitePoint {
            what,
            index,
            value: points[index].coords.into(),
        }),
        None => Ok(()),
    }
}

/// Whether every coordinate is finite and small enough to be squared.
pub(crate) fn usable_point(p: &Point3<f64>) -> bool {
    p.iter().all(|c| c.abs() <= FARTHEST)
}

/// Rejects an index out of range.
pub(crate) fn check_vertex(
    what: &'static str,
    index: usize,
    vertex: u32,
    vertices: usize,
) -> Result<(), Error> {
    if (vertex as usize) < vertices {
        Ok(())
    } else {
        Err(Error::VertexOutOfRange {
            what,
            index,
            vertex,
            vertices,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn components_are_numbered_by_their_first_vertex() {
        let (component, count) = components(6, &[[5, 1], [4, 2]]);
        assert_eq!(component, [0, 1, 2, 3, 2, 1]);
        assert_eq!(count, 4);
    }
}
