//! Which points are near each other along the surface.
//!
//! ```text
//! { (p, q) :  d(v(p), v(q)) ≤ limit }        v: nearest vertex that faces the same way,   d: length of the shortest way along the edges
//! ```
//! Two sheets of a thin body, two fingers that touch, or the walls of a deep crease are near each other in space, but not along the surface; the
//! two sides of a sharp edge are near along it, however much their normals differ. In a mesh of equilateral triangles ways along edges
//! are at most 2/√3 times as long as straight ones.

use super::ClosedSurface;
use super::support::nearest_facing;
use nalgebra::{Point3, UnitVector3};
use std::cmp::Reverse;
use std::collections::BinaryHeap;

impl ClosedSurface {
    /// The pairs of points of the surface, by index, whose distance along it is at most `limit`, m.
    pub(crate) fn pairs_along(
        &self,
        points: &[Point3<f64>],
        normals: &[UnitVector3<f64>],
        limit: f64,
    ) -> Vec<[u32; 2]> {
        let (vertices, facing) = (&self.vertices, &self.normals);
        let nearest = nearest_facing(points, normals, vertices, facing, self.spacing);
        let mut at: Vec<Vec<u32>> = vec![Vec::new(); vertices.len()];
        for (point, (vertex, _)) in nearest.iter().enumerate() {
            // A point whose way no vertex faces stays alone.
            if let Some(here) = at.get_mut(*vertex as usize) {
                here.push(point as u32);
            }
        }
        let mut ways = Ways::new(self);
        let mut pairs = Vec::new();
        for from in (0..vertices.len() as u32).filter(|&v| !at[v as usize].is_empty()) {
            for &to in ways.within(from, limit) {
                for &p in &at[from as usize] {
                    let later = at[to as usize].iter().filter(|&&q| q > p);
                    pairs.extend(later.map(|&q| [p, q]));
                }
            }
        }
        pairs
    }
}

/// Shortest ways along the edges (Dijkstra).
struct Ways<'a> {
    surface: &'a ClosedSurface,
    neighbours: Vec<Vec<u32>>,
    /// Length of the best way known to each vertex, m; infinite between searches.
    lengths: Vec<f64>,
    reached: Vec<u32>,
}

impl<'a> Ways<'a> {
    fn new(surface: &'a ClosedSurface) -> Self {
        let count = surface.vertices.len();
        let mut neighbours = vec![Vec::new(); count];
        for [a, b, c] in &surface.triangles {
            // Each edge runs the other way in the next triangle.
            for (from, to) in [(a, b), (b, c), (c, a)] {
                neighbours[*from as usize].push(*to);
            }
        }
        Self {
            surface,
            neighbours,
            lengths: vec![f64::INFINITY; count],
            reached: Vec::new(),
        }
    }

    /// The vertices at most `limit` from a vertex, which is one of them.
    fn within(&mut self, from: u32, limit: f64) -> &[u32] {
        for v in self.reached.drain(..) {
            self.lengths[v as usize] = f64::INFINITY;
        }
        self.lengths[from as usize] = 0.0;
        self.reached.push(from);
        // Lengths are not negative: their bits are in order.
        let mut front = BinaryHeap::from([Reverse((0u64, from))]);
        while let Some(Reverse((bits, v))) = front.pop() {
            let length = f64::from_bits(bits);
            if length > self.lengths[v as usize] {
                continue;
            }
            for &w in &self.neighbours[v as usize] {
                let vertices = &self.surface.vertices;
                let edge = (vertices[w as usize] - vertices[v as usize]).norm();
                let best = &mut self.lengths[w as usize];
                if length + edge <= limit && length + edge < *best {
                    if best.is_infinite() {
                        self.reached.push(w);
                    }
                    *best = length + edge;
                    front.push(Reverse((best.to_bits(), w)));
                }
            }
        }
        &self.reached
    }
}
