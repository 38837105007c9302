//! Betti numbers at one scale, or between two, without the complex.
//!
//! ```text
//! β_k^{a,b} = rank( H_k(K_a) → H_k(K_b) ) = number of classes of dimension k born by a and alive after b
//! ```
//!
//! All that counts is which simplices exist at the two scales (module `decision`), and most of them cancel in pairs before anything is
//! reduced (module `sweep`). What is left is reduced in cohomology as in module `cohomology`, except that coboundaries are listed when they
//! are needed, and a matched simplex needs no column in memory.

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
use nalgebra::{Point3, UnitVector3};
use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashMap};

/// Betti numbers `β₀, β₁, β₂` at scale `options.max_scale`: what [`Complex::betti`](crate::Complex::betti) of a complex gives, without building it.
///
/// # Errors
/// Those of [`Complex::build`](crate::Complex::build). Only vertices, edges and triangles count towards `options.max_simplices`.
///
/// # Complexity
/// A tenth of the time of the complex and its barcode, and a third of the memory: no values, no tetrahedra, and a reduction of one
/// simplex in forty.
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
    persistent_betti_numbers(points, normals, cylinder, options, options.max_scale)
}

/// Persistent Betti numbers between scale `from` and `options.max_scale`: what
/// [`Complex::persistent_betti`](crate::Complex::persistent_betti) of a complex gives, without building it.
///
/// # Errors
/// Those of [`betti_numbers`].
///
/// ```
/// use cech_complex::manifolds::Manifold;
/// use cech_complex::{Cylinder, Options, persistent_betti_numbers};
///
/// let sphere = Manifold::Sphere { radius: 1.0 }.net(600, 1);
/// let cylinder = Cylinder::new(1.25 * sphere.spacing, sphere.spacing)?;
/// let options = Options::default().with_max_scale(1.3);
/// assert_eq!(persistent_betti_numbers(&sphere.points, &sphere.normals, cylinder, &options, 1.0)?, [1, 0, 1]);
/// # Ok::<(), cech_complex::Error>(())
/// ```
pub fn persistent_betti_numbers(
    points: &[Point3<f64>],
    normals: &[UnitVector3<f64>],
    cylinder: Cylinder,
    options: &Options,
    from: f64,
) -> Result<[usize; 3], Error> {
    Vertices::of_cloud(points, normals, options, |vertices| {
        // Nothing is born before scale 0, nor by NaN.
        if from >= 0.0 {
            sweep(vertices, cylinder, options, from).map(|sweep| ranks(sweep, points.len()))
        } else {
            Ok([0; 3])
        }
    })?
}

/// Sweeps along the longest axis.
fn sweep<'a>(
    vertices: &Vertices<'a>,
    cylinder: Cylinder,
    options: &'a Options,
    from: f64,
) -> Result<Sweep<'a>, Error> {
    let extent = |axis: usize| {
        let along = || vertices.cloud.iter().map(|o| o.point[axis]);
        along().fold(f64::NEG_INFINITY, f64::max) - along().fold(f64::INFINITY, f64::min)
    };
    let axis = (1..3).fold(0, |longest, axis| {
        if extent(axis) > extent(longest) {
            axis
        } else {
            longest
        }
    });
    let mut names: Vec<u32> = (0..vertices.cloud.len() as u32).collect();
    let place = |v: &u32| vertices.cloud[*v as usize].point[axis];
    names.sort_by(|a, b| place(a).total_cmp(&place(b)));
    let cloud: Vec<_> = names.iter().map(|&v| vertices.cloud[v as usize]).collect();
    let coordinates: Vec<[f64; 3]> = cloud.iter().map(|o| o.point.into()).collect();
    let tree = ImmutableKdTree::<f64, 3>::new_from_slice(&coordinates).ok();
    let reach = 2.0 * cylinder.circumradius() * options.max_scale;
    let squared = reach * reach * (1.0 + 1e-9);
    let pairs = |c: u32, near: &mut Vec<u32>| {
        let Some(tree) = &tree else { return };
        let found = tree
            .query(&coordinates[c as usize])
            .within::<SquaredEuclidean<f64>>(squared)
            .unsorted()
            .execute();
        near.extend(found.iter().map(|hit| hit.item as u32));
    };
    let decisions = Decisions {
        cloud,
        names,
        valuation: Valuation {
            cloud: vertices.cloud,
            cylinder,
            options,
        },
    };
    let mut total = 0;
    let count = |more: usize| {
        total += more;
        if total > options.max_simplices {
            return Err(vertices.too_many(total, cylinder, options));
        }
        Ok(())
    };
    let scales = [from.min(options.max_scale), options.max_scale];
    Sweep::new(decisions, scales, pairs, count)
}

/// Persistent Betti numbers from a sweep.
fn ranks(mut sweep: Sweep, vertices: usize) -> [usize; 3] {
    let mut edges = std::mem::take(&mut sweep.critical_edges);
    let mut triangles = std::mem::take(&mut sweep.critical_triangles);
    edges.sort_unstable();
    let mut sets = UnionFind::new(vertices);
    let mut components = vertices;
    // A matched edge closes a triangle of earlier edges, so it joins nothing.
    edges.retain(|&(_, [a, b, ..])| {
        let joins = sets.union(a, b).is_some();
        components -= usize::from(joins);
        !joins
    });
    let later = sweep.later();
    let mut cofaces = Cofaces {
        sweep,
        later,
        tetrahedra: HashMap::new(),
        matches: HashMap::new(),
    };
    let (loops, ends) = reduce(edges, &mut cofaces, Cofaces::of_edge, Cofaces::edge_matched);
    triangles.retain(|triangle| !ends.contains_key(triangle));
    triangles.sort_unstable();
    let (cavities, _) = reduce(
        triangles,
        &mut cofaces,
        Cofaces::of_triangle,
        Cofaces::triangle_matched,
    );
    [components, loops, cavities]
}

/// Reduces the coboundaries of critical simplices, given ascending. Returns how many of level 0 are never ended, and the rows that end the others.
fn reduce<'a>(
    columns: Vec<Cell>,
    cofaces: &mut Cofaces<'a>,
    coboundary: impl Fn(&mut Cofaces<'a>, Cell, &mut Vec<Cell>),
    matched: impl Fn(&mut Cofaces<'a>, Cell) -> Option<Cell>,
) -> (usize, HashMap<Cell, Vec<Cell>>) {
    let mut essential = 0;
    let mut reduced: HashMap<Cell, Vec<Cell>> = HashMap::new();
    let (mut heap, mut rows) = (BinaryHeap::new(), Vec::new());
    for column in columns.into_iter().rev() {
        heap.clear();
        coboundary(cofaces, column, &mut rows);
        heap.extend(rows.drain(..).map(Reverse));
        loop {
            let Some(pivot) = pop_pivot(&mut heap) else {
                essential += usize::from(column.0 == 0);
                break;
            };
            // A column with this pivot: its first row has just left the heap; its others are added.
            if let Some(rows) = reduced.get(&pivot) {
                heap.extend(rows[1..].iter().copied().map(Reverse));
            } else if let Some(holder) = matched(cofaces, pivot) {
                coboundary(cofaces, holder, &mut rows);
                heap.extend(rows.drain(..).filter(|row| *row != pivot).map(Reverse));
            } else {
                reduced.insert(pivot, drain(pivot, &mut heap));
                break;
            }
        }
    }
    (essential, reduced)
}

/// Cofaces, listed when they are asked for. What was decided about a tetrahedron is kept.
struct Cofaces<'a> {
    sweep: Sweep<'a>,
    /// Later neighbours: offsets and list.
    later: (Vec<u32>, Vec<u32>),
    tetrahedra: HashMap<[u32; 4], Option<u8>>,
    matches: HashMap<[u32; 3], Option<u32>>,
}

impl Cofaces<'_> {
    fn of_edge(&mut self, (_, [b, c, ..]): Cell, rows: &mut Vec<Cell>) {
        let sweep = &self.sweep;
        let between = sweep.earlier(c).iter().filter(|&&w| w > b);
        let after = &self.later.1[run(&self.later.0, c)];
        let triangles = (sweep.apexes([b, c]).iter().map(|&w| [w, b, c]))
            .chain(between.map(|&w| [b, w, c]))
            .chain(after.iter().map(|&w| [b, c, w]));
        rows.extend(triangles.filter_map(|triangle| {
            let level = sweep.level_of_triangle(triangle)?;
            let [a, b, c] = triangle;
            Some((level, [a, b, c, NONE]))
        }));
    }

    fn edge_matched(&mut self, (level, [a, b, c, _]): Cell) -> Option<Cell> {
        let matched = self.sweep.match_of_edge([b, c]) == Some(a)
            && self.sweep.level_of_edge([b, c]) == Some(level);
        matched.then_some((level, [b, c, NONE, NONE]))
    }

    fn of_triangle(&mut self, (_, [a, b, c, _]): Cell, rows: &mut Vec<Cell>) {
        let before = self.sweep.apexes([b, c]).iter().filter(|&&w| w != a);
        let between = self.sweep.earlier(c).iter().filter(|&&w| w > b);
        let after = &self.later.1[run(&self.later.0, c)];
        let others = before.chain(between).chain(after);
        let tetrahedra: Vec<[u32; 4]> = others
            .map(|&w| {
                let mut tetrahedron = [a, b, c, w];
                tetrahedron.sort_unstable();
                tetrahedron
            })
            .collect();
        for tetrahedron in tetrahedra {
            if let Some(level) = self.level(tetrahedron) {
                rows.push((level, tetrahedron));
            }
        }
    }

    fn triangle_matched(&mut self, (level, [a, b, c, d]): Cell) -> Option<Cell> {
        let triangle = [b, c, d];
        if self.sweep.level_of_triangle(triangle) != Some(level) {
            return None;
        }
        let first = if let Some(first) = self.matches.get(&triangle) {
            *first
        } else {
            let before = self.sweep.apexes([c, d]).to_vec();
            let mut before = before.into_iter().take_while(|&w| w < b);
            let first = before.find(|&w| self.level([w, b, c, d]) == Some(level));
            self.matches.insert(triangle, first);
            first
        };
        (first == Some(a)).then_some((level, [b, c, d, NONE]))
    }

    fn level(&mut self, tetrahedron: [u32; 4]) -> Option<u8> {
        if let Some(level) = self.tetrahedra.get(&tetrahedron) {
            return *level;
        }
        let level = self.sweep.level_of_tetrahedron(tetrahedron);
        self.tetrahedra.insert(tetrahedron, level);
        level
    }
}
