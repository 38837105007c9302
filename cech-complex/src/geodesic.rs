//! Estimated geodesic distance: shortest paths over the edges of the complex (Dijkstra 1959).
//!
//! The length of an edge is the Euclidean distance of its ends, so the estimate is never below the Euclidean distance; on an even
//! sampling it exceeds the geodesic one by a few per cent.

use crate::cohomology::NONE;
use crate::complex::Complex;
use crate::error::{Error, positive};
use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// Shortest-path tree; its arrays are reused from run to run, and only the touched entries are reset.
pub(crate) struct ShortestPaths {
    pub(crate) distance: Vec<f64>,
    /// Edge to the parent in the tree, or [`NONE`] at a source.
    pub(crate) parent: Vec<u32>,
    /// Vertices in the order in which they were settled, that is by distance.
    pub(crate) settled: Vec<u32>,
    touched: Vec<u32>,
    heap: BinaryHeap<Entry>,
}

/// Heap entry, nearest first, ties by index so that the tree is the same on every machine.
#[derive(PartialEq)]
struct Entry {
    distance: f64,
    vertex: u32,
}

impl Eq for Entry {}

impl PartialOrd for Entry {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Entry {
    fn cmp(&self, other: &Self) -> Ordering {
        other
            .distance
            .total_cmp(&self.distance)
            .then(other.vertex.cmp(&self.vertex))
    }
}

impl ShortestPaths {
    pub(crate) fn new(vertices: usize) -> Self {
        Self {
            distance: vec![f64::INFINITY; vertices],
            parent: vec![NONE; vertices],
            settled: Vec::new(),
            touched: Vec::new(),
            heap: BinaryHeap::new(),
        }
    }

    /// Grows the tree from `sources` up to distance `limit` over the edges that have a length by `weight`.
    pub(crate) fn run(
        &mut self,
        complex: &Complex,
        sources: &[u32],
        limit: f64,
        weight: impl Fn(u32) -> Option<f64>,
    ) {
        self.reset();
        for &source in sources {
            self.relax(source, 0.0, NONE);
        }
        while let Some(Entry { distance, vertex }) = self.heap.pop() {
            if distance > self.distance[vertex as usize] {
                continue;
            }
            self.settled.push(vertex);
            let (neighbours, edges) = (
                complex.adjacency.neighbours(vertex),
                complex.adjacency.edges(vertex),
            );
            for (&neighbour, &edge) in neighbours.iter().zip(edges) {
                if let Some(length) = weight(edge)
                    && distance + length <= limit
                {
                    self.relax(neighbour, distance + length, edge);
                }
            }
        }
    }

    fn relax(&mut self, vertex: u32, distance: f64, parent: u32) {
        let known = &mut self.distance[vertex as usize];
        if distance < *known {
            if known.is_infinite() {
                self.touched.push(vertex);
            }
            *known = distance;
            self.parent[vertex as usize] = parent;
            self.heap.push(Entry { distance, vertex });
        }
    }

    fn reset(&mut self) {
        for vertex in self.touched.drain(..) {
            self.distance[vertex as usize] = f64::INFINITY;
            self.parent[vertex as usize] = NONE;
        }
        self.settled.clear();
    }
}

impl Complex {
    /// Estimated geodesic distance (m) from every vertex to the nearest of `sources`, over all edges; infinite where there is no path
    /// of at most `limit`.
    ///
    /// # Errors
    /// [`Error::NoSuchVertex`], or [`Error::NotPositive`] for the limit.
    ///
    /// # Complexity
    /// `O(m log n)` for the `m` edges within the limit.
    ///
    /// ```
    /// use cech_complex::manifolds::Manifold;
    /// use cech_complex::{Complex, Cylinder, Options};
    ///
    /// let tube = Manifold::Tube { radius: 0.5, length: 1.5 }.net(500, 1);
    /// let cylinder = Cylinder::new(1.25 * tube.spacing, tube.spacing)?;
    /// let complex = Complex::build(&tube.points, &tube.normals, cylinder, &Options::default())?;
    /// let distance = complex.geodesic_distances(&[0], None)?;
    /// let across = |v: usize| (tube.points[v] - tube.points[0]).norm();
    /// // Never below the straight line; opposite points are half a turn apart or more.
    /// assert!((0..500).all(|v| distance[v] >= across(v)));
    /// let opposite = (0..500).find(|&v| (tube.points[v].xy() - tube.points[0].xy()).norm() > 0.99).unwrap();
    /// assert!(distance[opposite] > 1.5);
    /// # Ok::<(), cech_complex::Error>(())
    /// ```
    pub fn geodesic_distances(
        &self,
        sources: &[u32],
        limit: Option<f64>,
    ) -> Result<Vec<f64>, Error> {
        for &source in sources {
            self.check_vertex(source)?;
        }
        let limit = limit.map_or(Ok(f64::INFINITY), |limit| positive("limit", limit))?;
        let mut paths = ShortestPaths::new(self.points.len());
        paths.run(self, sources, limit, |edge| Some(self.length(edge)));
        Ok(paths.distance)
    }
}
