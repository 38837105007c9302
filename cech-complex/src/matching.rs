//! Betti numbers of a whole complex, without its values: by the matching of module `sweep`, read from the tables of the complex.
//!
//! ```text
//! σ ↔ {w} ∪ σ      w < min σ the least vertex for which {w} ∪ σ is a simplex, vertices ordered along the longest axis
//! ```
//!
//! For every tetrahedron its first vertex is a candidate for the facet opposite, likewise for every triangle: one pass finds all matches.

use crate::betti::{Matching, longest_axis, ranks};
use crate::cohomology::Coboundary;
use crate::complex::Complex;
use crate::sweep::{Cell, NONE};

/// A simplex: the places of its vertices, ascending, and its index. Ordered by the places.
type Placed = (Cell, u32);

/// A complex with a matching of its simplices.
struct Matched<'a> {
    complex: &'a Complex,
    /// Place of every vertex along the axis.
    place: Vec<u32>,
    /// Place of the vertex with which each edge and triangle is matched, or [`NONE`].
    edges: Vec<u32>,
    triangles: Vec<u32>,
    of_edges: Coboundary,
    of_triangles: Coboundary,
}

/// Betti numbers `β₀, β₁, β₂` of all simplices of a complex.
pub(crate) fn betti(complex: &Complex) -> [usize; 3] {
    let matched = Matched::new(complex);
    let skeleton = &complex.skeleton;
    let edges = (0..skeleton.edges.len())
        .filter(|&edge| matched.edges[edge] == NONE)
        .map(|edge| matched.placed(&skeleton.edges, edge as u32))
        .collect();
    let triangles = (0..skeleton.triangles.len())
        .filter(|&triangle| matched.triangles[triangle] == NONE)
        .map(|triangle| matched.placed(&skeleton.triangles, triangle as u32))
        .filter(|&triangle| matched.matched_edge(triangle).is_none())
        .collect();
    ranks(&matched, edges, triangles, &complex.present)
}

impl<'a> Matched<'a> {
    fn new(complex: &'a Complex) -> Self {
        let points = &complex.points;
        let axis = longest_axis(|| points.iter().map(|point| &point.coords));
        let mut order: Vec<u32> = (0..points.len() as u32).collect();
        order.sort_by(|&a, &b| points[a as usize][axis].total_cmp(&points[b as usize][axis]));
        let mut place = vec![0; order.len()];
        for (at, &vertex) in order.iter().enumerate() {
            place[vertex as usize] = at as u32;
        }
        let s = &complex.skeleton;
        let matches = [s.edges.len(), s.triangles.len()].map(|count| vec![NONE; count]);
        let [mut edges, mut triangles] = matches;
        match_facets(&s.triangles, &s.triangle_edges, &place, &mut edges);
        match_facets(
            &s.tetrahedra,
            &s.tetrahedron_triangles,
            &place,
            &mut triangles,
        );
        Self {
            of_edges: Coboundary::new(edges.len(), &s.triangle_edges),
            of_triangles: Coboundary::new(triangles.len(), &s.tetrahedron_triangles),
            complex,
            place,
            edges,
            triangles,
        }
    }

    fn placed<const N: usize>(&self, simplices: &[[u32; N]], index: u32) -> Placed {
        let mut cell = [NONE; 4];
        for (slot, &v) in cell.iter_mut().zip(&simplices[index as usize]) {
            *slot = self.place[v as usize];
        }
        cell.sort_unstable();
        (cell, index)
    }

    /// Simplices of the given indices, in order.
    fn sorted<const N: usize>(
        &self,
        simplices: &[[u32; N]],
        indices: &[u32],
    ) -> impl Iterator<Item = Placed> + use<N> {
        let mut cells: Vec<Placed> = (indices.iter())
            .map(|&index| self.placed(simplices, index))
            .collect();
        cells.sort_unstable();
        cells.into_iter()
    }
}

/// The facet opposite the first vertex of a simplex, and the place of that vertex.
fn opposite<const N: usize>(simplex: &[u32; N], facets: &[u32; N], place: &[u32]) -> (u32, u32) {
    let places = simplex.map(|v| place[v as usize]);
    let first = (1..N).fold(
        0,
        |first, i| if places[i] < places[first] { i } else { first },
    );
    // Facet `f` leaves out the vertex `N − 1 − f`.
    (facets[N - 1 - first], places[first])
}

fn match_facets<const N: usize>(
    simplices: &[[u32; N]],
    facets: &[[u32; N]],
    place: &[u32],
    matched: &mut [u32],
) {
    for (simplex, facets) in simplices.iter().zip(facets) {
        let (facet, vertex) = opposite(simplex, facets, place);
        let known = &mut matched[facet as usize];
        *known = vertex.min(*known);
    }
}

impl Matching for Matched<'_> {
    type Cell = Placed;

    fn ends(&self, (_, edge): Placed) -> [u32; 2] {
        self.complex.skeleton.edges[edge as usize]
    }

    fn cofaces_of_edge(&self, (_, edge): Placed) -> impl Iterator<Item = Placed> {
        self.sorted(&self.complex.skeleton.triangles, self.of_edges.column(edge))
    }

    fn cofaces_of_triangle(&self, (_, triangle): Placed) -> impl Iterator<Item = Placed> {
        let indices = self.of_triangles.column(triangle);
        self.sorted(&self.complex.skeleton.tetrahedra, indices)
    }

    fn matched_edge(&self, (_, triangle): Placed) -> Option<Placed> {
        let (s, triangle) = (&self.complex.skeleton, triangle as usize);
        let (simplex, facets) = (&s.triangles[triangle], &s.triangle_edges[triangle]);
        let (edge, vertex) = opposite(simplex, facets, &self.place);
        (self.edges[edge as usize] == vertex).then(|| self.placed(&s.edges, edge))
    }

    fn matched_triangle(&self, (_, tetrahedron): Placed) -> Option<Placed> {
        let (s, tetrahedron) = (&self.complex.skeleton, tetrahedron as usize);
        let simplex = &s.tetrahedra[tetrahedron];
        let facets = &s.tetrahedron_triangles[tetrahedron];
        let (triangle, vertex) = opposite(simplex, facets, &self.place);
        (self.triangles[triangle as usize] == vertex).then(|| self.placed(&s.triangles, triangle))
    }
}
