//! Tables of the 3-skeleton: simplices in lexicographic order and their facets.
//!
//! Vertices of a simplex ascend, and so do the simplices of a dimension, so the edges that start at a vertex are contiguous, as
//! are the triangles that start with an edge and the tetrahedra that start with a triangle. Three offset tables turn this
//! into constant-time look-up downward; facets are stored by index.

use crate::values::{Attained, Deferred, Values};
use nalgebra::Vector3;

/// Offsets of runs: `runs[i]..runs[i + 1]` are the items whose (ascending) key is `i`.
pub(crate) fn runs(keys: impl Iterator<Item = u32>, count: usize) -> Vec<u32> {
    let mut offsets = vec![0u32; count + 1];
    for key in keys {
        offsets[key as usize + 1] += 1;
    }
    for i in 0..count {
        offsets[i + 1] += offsets[i];
    }
    offsets
}

/// The run of `i` as a range of indices.
pub(crate) fn run(offsets: &[u32], i: u32) -> std::ops::Range<usize> {
    offsets[i as usize] as usize..offsets[i as usize + 1] as usize
}

/// No index.
const NONE: u32 = u32::MAX;

/// Simplices to be removed.
pub(crate) struct Marks {
    pub(crate) vertices: Vec<bool>,
    pub(crate) edges: Vec<bool>,
    pub(crate) triangles: Vec<bool>,
    pub(crate) tetrahedra: Vec<bool>,
}

/// Simplices of dimension 1 to 3 with facets and offsets.
#[derive(Debug, Clone, Default)]
pub(crate) struct Skeleton {
    pub(crate) edges: Vec<[u32; 2]>,
    pub(crate) edge_runs: Vec<u32>,
    pub(crate) triangles: Vec<[u32; 3]>,
    /// Edges `01`, `02`, `12` of a triangle.
    pub(crate) triangle_edges: Vec<[u32; 3]>,
    pub(crate) triangle_runs: Vec<u32>,
    pub(crate) tetrahedra: Vec<[u32; 4]>,
    /// Triangles `012`, `013`, `023`, `123` of a tetrahedron.
    pub(crate) tetrahedron_triangles: Vec<[u32; 4]>,
    pub(crate) tetrahedron_runs: Vec<u32>,
}

impl Skeleton {
    /// Each of these three sets the simplices of one dimension and returns their values.
    pub(crate) fn set_edges(&mut self, mut edges: Layer<2>, vertices: usize) -> Attained {
        edges.shrink();
        self.edge_runs = runs(edges.simplices.iter().map(|e| e[0]), vertices);
        self.edges = edges.simplices;
        edges.attained
    }

    pub(crate) fn set_triangles(&mut self, mut triangles: Layer<3>) -> Attained {
        triangles.shrink();
        self.triangle_runs = runs(triangles.facets.iter().map(|t| t[0]), self.edges.len());
        (self.triangles, self.triangle_edges) = (triangles.simplices, triangles.facets);
        triangles.attained
    }

    pub(crate) fn set_tetrahedra(&mut self, mut tetrahedra: Layer<4>) -> Attained {
        tetrahedra.shrink();
        let first_facets = tetrahedra.facets.iter().map(|t| t[0]);
        self.tetrahedron_runs = runs(first_facets, self.triangles.len());
        (self.tetrahedra, self.tetrahedron_triangles) = (tetrahedra.simplices, tetrahedra.facets);
        tetrahedra.attained
    }

    pub(crate) fn edge_layer<'a>(&'a self, attained: &'a Attained) -> LayerRef<'a, 2> {
        LayerRef {
            simplices: &self.edges,
            facets: &self.edges,
            attained,
        }
    }

    pub(crate) fn triangle_layer<'a>(&'a self, attained: &'a Attained) -> LayerRef<'a, 3> {
        LayerRef {
            simplices: &self.triangles,
            facets: &self.triangle_edges,
            attained,
        }
    }

    pub(crate) fn tetrahedron_layer<'a>(&'a self, attained: &'a Attained) -> LayerRef<'a, 4> {
        LayerRef {
            simplices: &self.tetrahedra,
            facets: &self.tetrahedron_triangles,
            attained,
        }
    }

    /// Index of the edge `[a, b]`, in either order.
    pub(crate) fn find_edge(&self, a: u32, b: u32) -> Option<u32> {
        let (a, b) = (a.min(b), a.max(b));
        let range = run(&self.edge_runs, a);
        let offset = self.edges[range.clone()].binary_search(&[a, b]).ok()?;
        Some((range.start + offset) as u32)
    }

    /// The part that remains when the marked simplices are removed with all their cofaces, and its values; order is kept.
    pub(crate) fn without(
        &self,
        marks: &Marks,
        values: &mut Values,
        vertices: usize,
    ) -> (Self, Values) {
        let mut rest = Self::default();
        let keep = |edge: usize| !marks.edges[edge];
        let layer = self.edge_layer(values.edges.so_far());
        let (edges, origins) = layer.merge(Layer::default(), |v| v, keep);
        let names = origins.names();
        let edges = rest.set_edges(edges, vertices);
        let name = |edge: u32| names[edge as usize];
        let keep = |triangle: usize| !marks.triangles[triangle];
        let layer = self.triangle_layer(values.triangles.so_far());
        let (triangles, origins) = layer.merge(Layer::default(), name, keep);
        let names = origins.names();
        let triangles = rest.set_triangles(triangles);
        let name = |triangle: u32| names[triangle as usize];
        let keep = |tetrahedron: usize| !marks.tetrahedra[tetrahedron];
        let layer = self.tetrahedron_layer(values.tetrahedra.so_far());
        let (tetrahedra, _) = layer.merge(Layer::default(), name, keep);
        let tetrahedra = rest.set_tetrahedra(tetrahedra);
        let values = Values {
            edges: Deferred::new(edges),
            triangles: Deferred::new(triangles),
            tetrahedra: Deferred::new(tetrahedra),
        };
        (rest, values)
    }
}

/// Simplices of one dimension with `N` vertices each, under construction.
#[derive(Default)]
pub(crate) struct Layer<const N: usize> {
    simplices: Vec<[u32; N]>,
    /// Indices of the facets in the layer below (of an edge: its vertices).
    facets: Vec<[u32; N]>,
    attained: Attained,
}

impl<const N: usize> Layer<N> {
    pub(crate) fn len(&self) -> usize {
        self.simplices.len()
    }

    pub(crate) fn push(
        &mut self,
        simplex: [u32; N],
        facets: [u32; N],
        value: f64,
        point: Option<Vector3<f64>>,
    ) {
        self.simplices.push(simplex);
        self.facets.push(facets);
        self.attained.push(value, point);
    }

    fn push_from(&mut self, other: &LayerRef<N>, i: usize, facets: [u32; N]) {
        let (value, point) = (other.attained.values[i], other.attained.points.get(i));
        self.push(other.simplices[i], facets, value, point.copied());
    }

    /// Sorts the simplices lexicographically.
    pub(crate) fn sort(&mut self) {
        if self.simplices.is_sorted() {
            return;
        }
        let mut order: Vec<usize> = (0..self.len()).collect();
        order.sort_unstable_by_key(|&i| self.simplices[i]);
        let mut sorted = Self::with_capacity(self.len(), !self.attained.points.is_empty());
        for i in order {
            sorted.push_from(&self.view(), i, self.facets[i]);
        }
        *self = sorted;
    }

    /// Makes room for more simplices at once: memory that grows in many steps is mapped again for most of them.
    pub(crate) fn reserve(&mut self, more: usize) {
        self.simplices.reserve(more);
        self.facets.reserve(more);
        self.attained.values.reserve(more);
        // Nothing stands on a tetrahedron.
        self.attained.points.reserve(if N < 4 { more } else { 0 });
    }

    fn with_capacity(count: usize, points: bool) -> Self {
        Self {
            simplices: Vec::with_capacity(count),
            facets: Vec::with_capacity(count),
            attained: Attained {
                values: Vec::with_capacity(count),
                points: Vec::with_capacity(if points { count } else { 0 }),
            },
        }
    }

    /// Frees unused capacity.
    fn shrink(&mut self) {
        self.simplices.shrink_to_fit();
        self.facets.shrink_to_fit();
        self.attained.values.shrink_to_fit();
        self.attained.points.shrink_to_fit();
    }

    fn view(&self) -> LayerRef<'_, N> {
        LayerRef {
            simplices: &self.simplices,
            facets: &self.facets,
            attained: &self.attained,
        }
    }
}

/// Simplices of one dimension, in lexicographic order.
pub(crate) struct LayerRef<'a, const N: usize> {
    simplices: &'a [[u32; N]],
    facets: &'a [[u32; N]],
    attained: &'a Attained,
}

impl<const N: usize> LayerRef<'_, N> {
    /// The simplices that are kept and whose facets all remain, together with `fresh` ones, in order.
    /// Also returns where each of these comes from.
    pub(crate) fn merge(
        &self,
        fresh: Layer<N>,
        facet_name: impl Fn(u32) -> u32,
        keep: impl Fn(usize) -> bool,
    ) -> (Layer<N>, Origins) {
        let count = self.simplices.len();
        if count == 0 {
            return (fresh, Origins::default());
        }
        // The order is found before anything is copied: each array is then written at once.
        let most = count + fresh.len();
        let mut sources = Vec::with_capacity(most);
        let mut facets = Vec::with_capacity(most);
        let mut next = 0;
        for i in 0..count {
            let named = self.facets[i].map(&facet_name);
            if named.contains(&NONE) || !keep(i) {
                continue;
            }
            while next < fresh.len() && precedes(&fresh.simplices[next], &self.simplices[i]) {
                sources.push((count + next) as u32);
                facets.push(fresh.facets[next]);
                next += 1;
            }
            sources.push(i as u32);
            facets.push(named);
        }
        sources.extend((next..fresh.len()).map(|i| (count + i) as u32));
        facets.extend_from_slice(&fresh.facets[next..]);
        let known = self.attained;
        let merged = Layer {
            facets,
            simplices: gather(&sources, self.simplices, &fresh.simplices),
            attained: Attained {
                values: gather(&sources, &known.values, &fresh.attained.values),
                points: gather(&sources, &known.points, &fresh.attained.points),
            },
        };
        let origins = Origins {
            count,
            fresh: fresh.len(),
            sources,
        };
        (merged, origins)
    }
}

/// The lexicographic order without a branch for each vertex: which vertex decides cannot be predicted.
fn precedes<const N: usize>(a: &[u32; N], b: &[u32; N]) -> bool {
    let pairs = a.iter().zip(b).rev();
    pairs.fold(false, |rest, (a, b)| if a == b { rest } else { a < b })
}

/// Where the simplices of a merged layer come from.
#[derive(Default)]
pub(crate) struct Origins {
    /// Number of old simplices, and of fresh ones.
    count: usize,
    fresh: usize,
    /// Index of each among the old ones, or beyond them among the fresh ones.
    sources: Vec<u32>,
}

impl Origins {
    /// How many old simplices were kept.
    pub(crate) fn kept(&self) -> usize {
        self.sources.len() - self.fresh
    }

    /// The new index of every old simplex.
    pub(crate) fn names(&self) -> Vec<u32> {
        // First of the fresh ones too, which spares a comparison for each.
        let mut names = vec![NONE; self.count + self.fresh];
        for (name, &at) in self.sources.iter().enumerate() {
            names[at as usize] = name as u32;
        }
        names.truncate(self.count);
        names
    }
}

/// Items of a list and of another after it; none if there are none.
fn gather<T: Copy>(sources: &[u32], old: &[T], fresh: &[T]) -> Vec<T> {
    if old.is_empty() && fresh.is_empty() {
        return Vec::new();
    }
    let item = |&at: &u32| {
        let (list, at) = if (at as usize) < old.len() {
            (old, at as usize)
        } else {
            (fresh, at as usize - old.len())
        };
        list[at]
    };
    sources.iter().map(item).collect()
}
