//! A matching of nearly all simplices of the nerve at one or two scales, found from the triangles without listing the tetrahedra.
//!
//! Vertices are numbered along the longest axis of the cloud. The level of a simplex is 0 if it exists at the first scale, otherwise 1. Simplices of one
//! dimension are ordered by level, then lexicographically.
//!
//! ```text
//! σ ↔ {w} ∪ σ      w < min σ the least vertex for which {w} ∪ σ is a simplex of the level of σ
//! ```
//!
//! Then `{w} ∪ σ` is the first coface of `σ` in that order and `σ` its last facet, so each match is a pair of persistent cohomology with no
//! persistence (an *apparent pair*, Bauer 2021, §3.5; a discrete gradient, Forman 1998). What is left are the *critical* simplices, about
//! one in forty on a surface: where the sweep meets a vertex, the cylinders swept before mostly form a contractible set around it.
//!
//! A triangle that is matched with its last facet needs no tetrahedron. For any other it is enough to know *whether* some `w` exists:
//! usually a point that three cylinders share lies in the fourth. So no tetrahedron is stored, and most are never looked at.

use crate::decision::Decisions;
use crate::error::Error;
use crate::skeleton::{run, runs};
use nalgebra::Vector3;

/// No vertex.
pub(crate) const NONE: u32 = u32::MAX;

/// A simplex in its place of the order: its level, then its vertices, with [`NONE`] behind the last.
pub(crate) type Cell = (u8, [u32; 4]);

/// Edges and triangles of the nerve with their levels, and which of them are matched.
pub(crate) struct Sweep<'a> {
    decisions: Decisions<'a>,
    /// The scale of each level.
    scales: [f64; 2],
    /// Earlier neighbours of each vertex, ascending: the edges, ordered by their last vertex.
    earlier_runs: Vec<u32>,
    earlier: Vec<u32>,
    levels: Vec<u8>,
    /// Vertex with which each edge is matched, or [`NONE`].
    matched: Vec<u32>,
    /// Triangles by the edge between their last two vertices: the first vertex, ascending.
    apex_runs: Vec<u32>,
    apexes: Vec<u32>,
    apex_levels: Vec<u8>,
    /// Edges and triangles that are not matched with a simplex of a higher dimension, nor a triangle with an edge.
    pub(crate) critical_edges: Vec<Cell>,
    pub(crate) critical_triangles: Vec<Cell>,
}

impl<'a> Sweep<'a> {
    /// Sweeps over a cloud, given its pairs that can be edges. `count` is told of every simplex that is stored.
    pub(crate) fn new(
        decisions: Decisions<'a>,
        scales: [f64; 2],
        pairs: impl Fn(u32, &mut Vec<u32>),
        mut count: impl FnMut(usize) -> Result<(), Error>,
    ) -> Result<Self, Error> {
        let vertices = decisions.cloud.len();
        let mut sweep = Self {
            decisions,
            scales,
            earlier_runs: vec![0],
            earlier: Vec::new(),
            levels: Vec::new(),
            matched: Vec::new(),
            apex_runs: vec![0],
            apexes: Vec::new(),
            apex_levels: Vec::new(),
            critical_edges: Vec::new(),
            critical_triangles: Vec::new(),
        };
        let mut near = Vec::new();
        // Whether a vertex is joined to the current last vertex.
        let mut joined = vec![false; vertices];
        for c in 0..vertices as u32 {
            near.clear();
            pairs(c, &mut near);
            near.retain(|&b| b < c);
            near.sort_unstable();
            let first = sweep.earlier.len();
            for &b in &near {
                if let Some(level) = sweep.level(|scale| sweep.decisions.edge([b, c], scale)) {
                    sweep.earlier.push(b);
                    sweep.levels.push(level);
                    joined[b as usize] = true;
                }
            }
            sweep.earlier_runs.push(sweep.earlier.len() as u32);
            for edge in first..sweep.earlier.len() {
                sweep.triangles(edge, c, &joined);
            }
            for &b in &near {
                joined[b as usize] = false;
            }
            let edges = sweep.earlier.len() - first;
            let triangles = sweep.apexes.len() - sweep.apex_runs[first] as usize;
            count(1 + edges + triangles)?;
        }
        Ok(sweep)
    }

    /// The least level at which something holds.
    fn level(&self, holds: impl Fn(f64) -> bool) -> Option<u8> {
        let [from, to] = self.scales;
        if holds(from) {
            Some(0)
        } else if to > from && holds(to) {
            Some(1)
        } else {
            None
        }
    }

    /// Finds the triangles whose last two vertices are those of the edge, which ends at `c`, and matches them and the edge.
    fn triangles(&mut self, edge: usize, c: u32, joined: &[bool]) {
        let (b, edge_level) = (self.earlier[edge], self.levels[edge]);
        let mut matched = NONE;
        // A common point of `b`, `c` and the vertex that the edge is matched with.
        let mut shared: Option<Vector3<f64>> = None;
        for i in run(&self.earlier_runs, b) {
            let a = self.earlier[i];
            if !joined[a as usize] {
                continue;
            }
            let inside = |y: Vector3<f64>| self.decisions.proves(&[a], &y, self.scales[0]);
            if shared.is_some_and(inside) && self.decisions.joinable(matched, a) {
                self.apexes.push(a);
                self.apex_levels.push(0);
                continue;
            }
            let Some(level) = self.level(|scale| self.decisions.triangle([a, b, c], scale)) else {
                continue;
            };
            if matched == NONE && level == edge_level {
                matched = a;
                let centre = self.decisions.centre([a, b, c]);
                let proof = self.decisions.proves(&[a, b, c], &centre, self.scales[0]);
                shared = proof.then_some(centre);
            } else if !self.has_earlier_coface(edge, [a, b, c], level) {
                self.critical_triangles.push((level, [a, b, c, NONE]));
            }
            self.apexes.push(a);
            self.apex_levels.push(level);
        }
        self.apex_runs.push(self.apexes.len() as u32);
        self.matched.push(matched);
        if matched == NONE {
            self.critical_edges.push((edge_level, [b, c, NONE, NONE]));
        }
    }

    /// Whether a triangle has a coface of its own level with an earlier first vertex. Those of the triangles before it on the same edge
    /// are the candidates.
    fn has_earlier_coface(&self, edge: usize, [a, b, c]: [u32; 3], level: u8) -> bool {
        let before = self.apex_runs[edge] as usize..self.apexes.len();
        let scale = self.scales[level as usize];
        let centre = self.decisions.centre([a, b, c]);
        let candidates = || {
            let range = before.clone();
            let allowed = range.filter(|&i| self.apex_levels[i] <= level);
            allowed.map(|i| self.apexes[i])
        };
        if self.decisions.proves(&[a, b, c], &centre, scale)
            && candidates().any(|w| {
                self.decisions.proves(&[w], &centre, scale) && self.decisions.joinable(w, a)
            })
        {
            return true;
        }
        candidates().any(|w| {
            let others = [[w, a, b], [w, a, c]];
            others.iter().all(|&t| self.level_of_triangle(t).is_some_and(|l| l <= level))
                && self.decisions.tetrahedron([w, a, b, c], scale)
        })
    }

    /// The vertex with which an edge is matched.
    pub(crate) fn match_of_edge(&self, [b, c]: [u32; 2]) -> Option<u32> {
        let vertex = self.matched[self.edge([b, c])?];
        (vertex != NONE).then_some(vertex)
    }

    pub(crate) fn level_of_edge(&self, edge: [u32; 2]) -> Option<u8> {
        self.edge(edge).map(|edge| self.levels[edge])
    }

    pub(crate) fn level_of_triangle(&self, [a, b, c]: [u32; 3]) -> Option<u8> {
        let range = run(&self.apex_runs, self.edge([b, c])? as u32);
        let offset = self.apexes[range.clone()].binary_search(&a).ok()?;
        Some(self.apex_levels[range.start + offset])
    }

    /// The level of a tetrahedron, if all its triangles exist and it does.
    pub(crate) fn level_of_tetrahedron(&self, tetrahedron: [u32; 4]) -> Option<u8> {
        let [a, b, c, d] = tetrahedron;
        let mut least = 0;
        for triangle in [[b, c, d], [a, c, d], [a, b, d], [a, b, c]] {
            least = self.level_of_triangle(triangle)?.max(least);
        }
        let later = &self.scales[least as usize..];
        let holds = |&scale: &f64| self.decisions.tetrahedron(tetrahedron, scale);
        later.iter().position(holds).map(|more| least + more as u8)
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

    /// Later neighbours of every vertex, as offsets and a list.
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
