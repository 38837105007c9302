//! Betti numbers at one scale without the complex.
//!
//! All that counts is which simplices exist (module `decision`), and nearly all of them cancel in pairs before anything is reduced
//! (module `sweep`). The rest is reduced in cohomology as in module `cohomology`, but cofaces are listed when they are needed, and a
//! column whose first coface is free, or that is matched, is only named, not stored.

use crate::cohomology::{drain, pop_pivot};
use crate::cylinder::Cylinder;
use crate::decision::Decisions;
use crate::error::Error;
use crate::nerve::Vertices;
use crate::options::Options;
use crate::skeleton::run;
use crate::sweep::{Cell, NONE, Sweep};
use crate::union_find::UnionFind;
use crate::valuation::Valuation;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use nalgebra::{Point3, UnitVector3, Vector3};
use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashMap, HashSet};
use std::hash::Hash;

/// Betti numbers `β₀, β₁, β₂` at scale `options.max_scale`: what [`Complex::betti`](crate::Complex::betti) gives there, without building the
/// complex.
///
/// # Errors
/// Those of [`Complex::build`](crate::Complex::build). Only vertices, edges and triangles count towards `options.max_simplices`.
///
/// # Complexity
/// A fifth of the time of a complex and its barcode, and a tenth of the memory: no values, no tetrahedra, and a reduction of one simplex in
/// forty.
///
/// ```
/// use cech_complex::manifolds::Manifold;
/// use cech_complex::{Cylinder, Options, betti_numbers};
///
/// let torus = Manifold::Torus { major: 1.0, minor: 0.4 }.net(900, 1);
/// let cylinder = Cylinder::new(1.25 * torus.spacing, torus.spacing)?;
/// assert_eq!(betti_numbers(&torus.points, &torus.normals, cylinder, &Options::default())?, [1, 2, 1]);
/// # Ok::<(), cech_complex::Error>(())
/// ```
pub fn betti_numbers(
    points: &[Point3<f64>],
    normals: &[UnitVector3<f64>],
    cylinder: Cylinder,
    options: &Options,
) -> Result<[usize; 3], Error> {
    Vertices::of_cloud(points, normals, options, |vertices| {
        sweep(vertices, cylinder, options).map(|mut sweep| {
            let edges = std::mem::take(&mut sweep.critical_edges);
            let triangles = std::mem::take(&mut sweep.critical_triangles);
            let later = sweep.later();
            ranks(
                &Cofaces { sweep, later },
                edges,
                triangles,
                vertices.present,
            )
        })
    })?
}

/// Sweeps along the longest axis.
fn sweep<'a>(
    vertices: &Vertices<'a>,
    cylinder: Cylinder,
    options: &'a Options,
) -> Result<Sweep<'a>, Error> {
    let axis = longest_axis(|| vertices.cloud.iter().map(|o| &o.point));
    let mut names: Vec<u32> = (0..vertices.cloud.len() as u32).collect();
    let place = |v: &u32| vertices.cloud[*v as usize].point[axis];
    names.sort_by(|a, b| place(a).total_cmp(&place(b)));
    let valuation = Valuation {
        cloud: vertices.cloud,
        cylinder,
        options,
    };
    let decisions = Decisions::new(names, valuation);
    let coordinates: Vec<[f64; 3]> = decisions.cloud().iter().map(|o| o.point.into()).collect();
    // The tree fails only on input that was rejected before.
    let tree = match &coordinates[..] {
        [] => None,
        some => Some(
            ImmutableKdTree::<f64, 3>::new_from_slice(some)
                .map_err(|_| vertices.too_many(some.len(), cylinder, options))?,
        ),
    };
    let reach = 2.0 * cylinder.circumradius() * options.max_scale;
    let squared = reach * reach * (1.0 + 1e-9);
    let near = |c: u32, found: &mut Vec<u32>| {
        let Some(tree) = &tree else { return };
        let hits = tree
            .query(&coordinates[c as usize])
            .within::<SquaredEuclidean<f64>>(squared)
            .unsorted()
            .execute();
        found.extend(hits.iter().map(|hit| hit.item));
    };
    let mut total = 0;
    let count = |more: usize| {
        total += more;
        if total > options.max_simplices {
            return Err(vertices.too_many(total, cylinder, options));
        }
        Ok(())
    };
    Sweep::new(decisions, near, count)
}

/// The axis along which points extend farthest.
pub(crate) fn longest_axis<'a, I>(points: impl Fn() -> I) -> usize
where
    I: Iterator<Item = &'a Vector3<f64>>,
{
    let extent = |axis: usize| {
        let along = || points().map(|point| point[axis]);
        along().fold(f64::NEG_INFINITY, f64::max) - along().fold(f64::INFINITY, f64::min)
    };
    let longer = |longest, axis| {
        if extent(axis) > extent(longest) {
            axis
        } else {
            longest
        }
    };
    (1..3).fold(0, longer)
}

/// A complex whose simplices are matched, each with its first coface if it is the last facet of that.
pub(crate) trait Matching {
    /// A simplex. Those of one dimension are ordered.
    type Cell: Copy + Ord + Hash;

    /// Both vertices of an edge.
    fn ends(&self, edge: Self::Cell) -> [u32; 2];

    /// Triangles that contain an edge, in order.
    fn cofaces_of_edge(&self, edge: Self::Cell) -> impl Iterator<Item = Self::Cell>;

    /// Tetrahedra that contain a triangle, in order.
    fn cofaces_of_triangle(&self, triangle: Self::Cell) -> impl Iterator<Item = Self::Cell>;

    /// The edge with which a triangle is matched.
    fn matched_edge(&self, triangle: Self::Cell) -> Option<Self::Cell>;

    /// The triangle with which a tetrahedron is matched.
    fn matched_triangle(&self, tetrahedron: Self::Cell) -> Option<Self::Cell>;
}

/// Betti numbers of the complex on the vertices that are `present`, from the edges that are not matched with a triangle and the triangles
/// that are matched neither with an edge nor with a tetrahedron.
pub(crate) fn ranks<M: Matching>(
    matching: &M,
    mut edges: Vec<M::Cell>,
    mut triangles: Vec<M::Cell>,
    present: &[bool],
) -> [usize; 3] {
    edges.sort_unstable();
    let mut sets = UnionFind::new(present.len());
    // A matched edge closes a triangle whose other edges are earlier, so it joins nothing.
    let before = edges.len();
    edges.retain(|&edge| {
        let [a, b] = matching.ends(edge);
        sets.union(a, b).is_none()
    });
    let vertices = present.iter().filter(|present| **present).count();
    let components = vertices - (before - edges.len());
    let (loops, ends) = reduce(
        edges,
        |edge| matching.cofaces_of_edge(edge),
        |triangle| matching.matched_edge(triangle),
    );
    let ends: HashSet<M::Cell> = ends.into_iter().collect();
    triangles.retain(|triangle| !ends.contains(triangle));
    triangles.sort_unstable();
    let (cavities, _) = reduce(
        triangles,
        |triangle| matching.cofaces_of_triangle(triangle),
        |tetrahedron| matching.matched_triangle(tetrahedron),
    );
    [components, loops, cavities]
}

/// Reduces the coboundaries of the columns, given in ascending order. Returns how many become zero, and the pivots of the others.
fn reduce<C: Copy + Ord + Hash, I: Iterator<Item = C>>(
    columns: Vec<C>,
    cofaces: impl Fn(C) -> I,
    matched: impl Fn(C) -> Option<C>,
) -> (usize, Vec<C>) {
    let mut zero = 0;
    // By pivot: columns as they are, and the later rows of columns that were changed.
    let mut holders: HashMap<C, C> = HashMap::new();
    let mut reduced: HashMap<C, Vec<C>> = HashMap::new();
    let holder = |holders: &HashMap<C, C>, pivot| {
        let known = holders.get(&pivot).copied();
        known.or_else(|| matched(pivot))
    };
    let mut heap = BinaryHeap::new();
    for column in columns.into_iter().rev() {
        let mut rows = cofaces(column);
        let Some(first) = rows.next() else {
            zero += 1;
            continue;
        };
        if !reduced.contains_key(&first) && holder(&holders, first).is_none() {
            holders.insert(first, column);
            continue;
        }
        heap.clear();
        heap.push(Reverse(first));
        heap.extend(rows.map(Reverse));
        loop {
            let Some(pivot) = pop_pivot(&mut heap) else {
                zero += 1;
                break;
            };
            // A column with this pivot: its first row has just left the heap; its others are added.
            if let Some(rows) = reduced.get(&pivot) {
                heap.extend(rows[1..].iter().copied().map(Reverse));
            } else if let Some(holder) = holder(&holders, pivot) {
                heap.extend(cofaces(holder).skip(1).map(Reverse));
            } else {
                reduced.insert(pivot, drain(pivot, &mut heap));
                break;
            }
        }
    }
    let pivots = holders.into_keys().chain(reduced.into_keys());
    (zero, pivots.collect())
}

/// Vertices of an ascending list after `b`.
fn after(list: &[u32], b: u32) -> &[u32] {
    &list[list.partition_point(|&w| w <= b)..]
}

/// Cofaces and matches, found when they are asked for.
struct Cofaces<'a> {
    sweep: Sweep<'a>,
    /// Later neighbours: offsets and list.
    later: (Vec<u32>, Vec<u32>),
}

impl Matching for Cofaces<'_> {
    type Cell = Cell;

    fn ends(&self, [a, b, ..]: Cell) -> [u32; 2] {
        [a, b]
    }

    fn cofaces_of_edge(&self, [b, c, ..]: Cell) -> impl Iterator<Item = Cell> {
        let between = after(self.sweep.earlier(c), b);
        let later = &self.later.1[run(&self.later.0, c)];
        (self.sweep.apexes([b, c]).iter().map(move |&w| [w, b, c]))
            .chain(between.iter().map(move |&w| [b, w, c]))
            .chain(later.iter().map(move |&w| [b, c, w]))
            .filter(|&triangle| self.sweep.has_triangle(triangle))
            .map(|[a, b, c]| [a, b, c, NONE])
    }

    fn cofaces_of_triangle(&self, [a, b, c, _]: Cell) -> impl Iterator<Item = Cell> {
        let between = after(self.sweep.earlier(c), b);
        let later = &self.later.1[run(&self.later.0, c)];
        let before = self.sweep.apexes([b, c]).iter().filter(move |&&w| w != a);
        before
            .map(move |&w| [w.min(a), w.max(a), b, c])
            .chain(between.iter().map(move |&w| [a, b, w, c]))
            .chain(later.iter().map(move |&w| [a, b, c, w]))
            .filter(|&tetrahedron| self.sweep.has_tetrahedron(tetrahedron))
    }

    fn matched_edge(&self, [a, b, c, _]: Cell) -> Option<Cell> {
        (self.sweep.match_of_edge([b, c]) == Some(a)).then_some([b, c, NONE, NONE])
    }

    fn matched_triangle(&self, [a, b, c, d]: Cell) -> Option<Cell> {
        (self.sweep.match_of_triangle([b, c, d]) == Some(a)).then_some([b, c, d, NONE])
    }
}
