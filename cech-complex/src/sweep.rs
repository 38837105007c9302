//! A matching of nearly all simplices of the nerve at one scale, found from the triangles without listing the tetrahedra.
//!
//! Vertices are numbered along the longest axis of the cloud, and the simplices of one dimension ordered lexicographically.
//!
//! ```text
//! σ ↔ {w} ∪ σ      w < min σ the least vertex for which {w} ∪ σ is a simplex
//! ```
//!
//! Then `{w} ∪ σ` is the first coface of `σ` and `σ` the last facet of `{w} ∪ σ`, so the two cancel in cohomology (an *apparent pair*, Bauer
//! 2021, §3.5; a discrete gradient, Forman 1998). What is left are the *critical* simplices, one in forty on a surface: where the
//! sweep meets a vertex, the cylinders swept before mostly form a contractible set around it.
//!
//! A triangle that is matched with its last edge needs no tetrahedron. For any other it is enough to know *whether* some `w` exists:
//! usually a point that three cylinders share lies in a fourth. So no tetrahedron is stored, and most are never looked at.

use crate::decision::Decisions;
use crate::error::Error;
use crate::skeleton::{run, runs};
use nalgebra::Vector3;

/// No vertex.
pub(crate) const NONE: u32 = u32::MAX;

/// The vertices of a simplex, ascending, with [`NONE`] behind the last: simplices of one dimension compare lexicographically.
pub(crate) type Cell = [u32; 4];

/// Edges and triangles of the nerve, and which of them are matched.
pub(crate) struct Sweep<'a> {
    decisions: Decisions<'a>,
    /// Earlier neighbours of each vertex, ascending: the edges, ordered by their last vertex.
    earlier_runs: Vec<u32>,
    earlier: Vec<u32>,
    /// Vertex with which each edge is matched, or [`NONE`].
    matched: Vec<u32>,
    /// Triangles by the edge between their last two vertices: the first vertex, ascending.
    apex_runs: Vec<u32>,
    apexes: Vec<u32>,
    /// Edges that are not matched with a triangle.
    pub(crate) critical_edges: Vec<Cell>,
    /// Triangles that are matched neither with an edge nor with a tetrahedron.
    pub(crate) critical_triangles: Vec<Cell>,
}

impl<'a> Sweep<'a> {
    /// Sweeps over a cloud. `near` lists the vertices that may be joined to one, and `count` is told of every simplex that is stored.
    pub(crate) fn new(
        decisions: Decisions<'a>,
        near: impl Fn(u32, &mut Vec<u32>),
        mut count: impl FnMut(usize) -> Result<(), Error>,
    ) -> Result<Self, Error> {
        let vertices = decisions.cloud().len();
        let mut sweep = Self {
            decisions,
            earlier_runs: vec![0],
            earlier: Vec::new(),
            matched: Vec::new(),
            apex_runs: vec![0],
            apexes: Vec::new(),
            critical_edges: Vec::new(),
            critical_triangles: Vec::new(),
        };
        let mut found = Vec::new();
        // Whether a vertex is joined to the last one so far.
        let mut joined = vec![false; vertices];
        for c in 0..vertices as u32 {
            found.clear();
            near(c, &mut found);
            found.retain(|&b| b < c && sweep.decisions.edge([b, c]).is_some());
            found.sort_unstable();
            count(1 + found.len())?;
            sweep.earlier.extend_from_slice(&found);
            sweep.earlier_runs.push(sweep.earlier.len() as u32);
            for &b in &found {
                joined[b as usize] = true;
            }
            for &b in &found {
                let before = sweep.apexes.len();
                sweep.triangles([b, c], &joined);
                count(sweep.apexes.len() - before)?;
            }
            for &b in &found {
                joined[b as usize] = false;
            }
        }
        Ok(sweep)
    }

    /// Finds the triangles whose last two vertices are those of the edge, and matches them and the edge.
    fn triangles(&mut self, [b, c]: [u32; 2], joined: &[bool]) {
        let first = self.apexes.len();
        let mut matched = NONE;
        // A common point of the cylinders of `b`, `c` and `matched`.
        let mut shared: Option<Vector3<f64>> = None;
        for i in run(&self.earlier_runs, b) {
            let a = self.earlier[i];
            if !joined[a as usize] {
                continue;
            }
            let inside = |y: Vector3<f64>| self.decisions.contains(a, &y);
            if shared.is_some_and(inside) && self.decisions.joinable(matched, a) {
                self.apexes.push(a);
                continue;
            }
            let Some(meeting) = self.decisions.triangle([a, b, c]) else {
                continue;
            };
            if matched == NONE {
                (matched, shared) = (a, meeting.point());
            } else if !self.has_earlier_coface([a, b, c], first, meeting.point()) {
                self.critical_triangles.push([a, b, c, NONE]);
            }
            self.apexes.push(a);
        }
        self.apex_runs.push(self.apexes.len() as u32);
        self.matched.push(matched);
        if matched == NONE {
            self.critical_edges.push([b, c, NONE, NONE]);
        }
    }

    /// Whether a triangle has a coface with an earlier first vertex. Those of the triangles from `first` on, at the same edge, are the candidates.
    /// `point` is a point of all three cylinders.
    fn has_earlier_coface(
        &self,
        [a, b, c]: [u32; 3],
        first: usize,
        point: Option<Vector3<f64>>,
    ) -> bool {
        let candidates = &self.apexes[first..];
        let around = |y: Vector3<f64>| {
            let shares = |&w: &u32| self.decisions.contains(w, &y) && self.decisions.joinable(w, a);
            candidates.iter().any(shares)
        };
        point.is_some_and(around)
            || candidates.iter().any(|&w| {
                self.has_triangle([w, a, b])
                    && self.has_triangle([w, a, c])
                    && self.decisions.tetrahedron([w, a, b, c]).is_some()
            })
    }

    /// The vertex with which an edge is matched.
    pub(crate) fn match_of_edge(&self, edge: [u32; 2]) -> Option<u32> {
        let vertex = self.matched[self.edge(edge)?];
        (vertex != NONE).then_some(vertex)
    }

    /// The vertex with which a triangle is matched.
    pub(crate) fn match_of_triangle(&self, [a, b, c]: [u32; 3]) -> Option<u32> {
        let before = self.apexes([b, c]).iter().take_while(|&&w| w < a);
        let mut cofaces = before.filter(|&&w| self.has_tetrahedron([w, a, b, c]));
        cofaces.next().copied()
    }

    pub(crate) fn has_triangle(&self, [a, b, c]: [u32; 3]) -> bool {
        self.apexes([b, c]).binary_search(&a).is_ok()
    }

    pub(crate) fn has_tetrahedron(&self, [a, b, c, d]: [u32; 4]) -> bool {
        let mut triangles = [[b, c, d], [a, c, d], [a, b, d], [a, b, c]].into_iter();
        triangles.all(|triangle| self.has_triangle(triangle))
            && self.decisions.tetrahedron([a, b, c, d]).is_some()
    }

    /// Earlier neighbours of a vertex, ascending.
    pub(crate) fn earlier(&self, vertex: u32) -> &[u32] {
        &self.earlier[run(&self.earlier_runs, vertex)]
    }

    /// First vertices of the triangles whose last two vertices are those of an edge, ascending.
    pub(crate) fn apexes(&self, edge: [u32; 2]) -> &[u32] {
        let edge = self.edge(edge);
        edge.map_or(&[], |edge| &self.apexes[run(&self.apex_runs, edge as u32)])
    }

    /// Later neighbours of every vertex, ascending, as offsets and a list.
    pub(crate) fn later(&self) -> (Vec<u32>, Vec<u32>) {
        let vertices = self.earlier_runs.len() - 1;
        let offsets = runs(self.earlier.iter().copied(), vertices);
        let (mut next, mut later) = (offsets.clone(), vec![0; self.earlier.len()]);
        for c in 0..vertices as u32 {
            for &b in self.earlier(c) {
                let slot = &mut next[b as usize];
                later[*slot as usize] = c;
                *slot += 1;
            }
        }
        (offsets, later)
    }

    fn edge(&self, [b, c]: [u32; 2]) -> Option<usize> {
        let range = run(&self.earlier_runs, c);
        let offset = self.earlier[range.clone()].binary_search(&b).ok()?;
        Some(range.start + offset)
    }
}
