//! Persistent homology of the complex in dimensions 0, 1 and 2 over Z/2.

use crate::cohomology::{Coboundary, NONE, reduce};
use crate::complex::Complex;
use crate::union_find::UnionFind;

/// A homology class with its birth and death.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Bar {
    /// 0 component, 1 loop, 2 cavity.
    pub dimension: usize,
    /// Scale at which the class appears.
    pub birth: f64,
    /// Scale at which it becomes trivial or merges with an older one; infinite if it does not die within the complex (whose largest scale may be
    /// below the death).
    pub death: f64,
    /// Simplex that creates the class: index into the vertices, edges or triangles of the complex.
    pub birth_simplex: u32,
    /// Simplex that ends it: index into the edges, triangles or tetrahedra; `None` if it does not die.
    pub death_simplex: Option<u32>,
}

impl Bar {
    /// `death − birth`.
    pub fn persistence(&self) -> f64 {
        self.death - self.birth
    }
}

/// All bars of positive length, by dimension, then birth, then death.
///
/// ```text
/// β_k^{a,b} = rank( H_k(K_a) → H_k(K_b) ) = number of bars of dimension k with birth ≤ a and b < death
/// ```
///
/// Simplices are ordered by value, then lexicographically; faces precede cofaces because dimensions are ordered separately.
/// Dimension 0 is union-find over the edges. The edges that close a cycle are the columns of `H¹`, and the triangles that did not end a class of `H¹`
/// are those of `H²`. Homology and cohomology have the same bars (de Silva, Morozov and
/// Vejdemo-Johansson 2011).
#[derive(Debug, Clone, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Barcode {
    bars: Vec<Bar>,
}

impl Barcode {
    /// All bars.
    pub fn bars(&self) -> &[Bar] {
        &self.bars
    }

    /// Bars of one dimension.
    pub fn of_dimension(&self, dimension: usize) -> impl Iterator<Item = &Bar> {
        self.bars
            .iter()
            .filter(move |bar| bar.dimension == dimension)
    }

    /// Number of bars of dimension 0, 1, 2 born by `from` and alive after `to` (or after `from`, if that is later).
    pub fn rank(&self, from: f64, to: f64) -> [usize; 3] {
        let mut rank = [0; 3];
        for bar in self
            .bars
            .iter()
            .filter(|bar| bar.birth <= from && bar.death > to.max(from))
        {
            rank[bar.dimension] += 1;
        }
        rank
    }

    fn push(&mut self, bar: Bar) {
        if bar.death > bar.birth {
            self.bars.push(bar);
        }
    }
}

/// Simplices of one dimension in filtration order.
pub(crate) struct Order {
    /// Simplex at each rank.
    pub(crate) at: Vec<u32>,
}

impl Order {
    /// Bucket sort by value: values are spread over their range, so that a bucket holds few, and small sorts finish it. Ties, and
    /// all entries of a bucket with many, keep the order of the indices.
    pub(crate) fn new(values: &[f64]) -> Self {
        let largest = values.iter().copied().fold(0.0, f64::max);
        let buckets = values.len() / 2 + 1;
        // Monotone in the value in spite of rounding.
        let per_value = if largest > 0.0 {
            buckets as f64 / largest
        } else {
            0.0
        };
        let bucket = |value: f64| ((value * per_value) as usize).min(buckets - 1) as u32;
        let runs = crate::skeleton::runs(values.iter().map(|&value| bucket(value)), buckets);
        let mut next = runs.clone();
        // Non-negative floats compare like their bit patterns.
        let mut keyed = vec![(0u64, 0u32); values.len()];
        for (simplex, &value) in values.iter().enumerate() {
            let slot = &mut next[bucket(value) as usize];
            keyed[*slot as usize] = (value.to_bits(), simplex as u32);
            *slot += 1;
        }
        for range in runs.windows(2) {
            keyed[range[0] as usize..range[1] as usize].sort_unstable();
        }
        let at = keyed.into_iter().map(|(_, simplex)| simplex).collect();
        Self { at }
    }
}

/// The barcode of a complex.
pub(crate) fn barcode(complex: &Complex) -> Barcode {
    let skeleton = &complex.skeleton;
    let (edge_values, triangle_values) = (complex.edge_values(), complex.triangle_values());
    let tetrahedron_values = complex.tetrahedron_values();
    let edges = Order::new(edge_values);
    let triangles = Order::new(triangle_values);
    let mut barcode = Barcode::default();

    let joins = components(complex, &edges, &mut barcode);
    let d1 = Coboundary::ranked(&edges, &triangles, &skeleton.triangle_edges);
    let loops = reduce(&d1, |edge| joins[edge as usize]);
    drop(d1);
    let columns = (&edges, edge_values);
    record(
        1,
        &loops,
        columns,
        (&triangles, triangle_values),
        &mut barcode,
    );

    let tetrahedra = Order::new(tetrahedron_values);
    let d2 = Coboundary::ranked(&triangles, &tetrahedra, &skeleton.tetrahedron_triangles);
    let cavities = reduce(&d2, |triangle| {
        loops.column_of_row[triangle as usize] != NONE
    });
    let columns = (&triangles, triangle_values);
    record(
        2,
        &cavities,
        columns,
        (&tetrahedra, tetrahedron_values),
        &mut barcode,
    );

    let key = |bar: &Bar| {
        (
            bar.dimension,
            bar.birth.to_bits(),
            bar.death.to_bits(),
            bar.birth_simplex,
        )
    };
    barcode.bars.sort_unstable_by_key(key);
    barcode
}

/// Bars of dimension 0; returns, by rank, which edges join two components.
fn components(complex: &Complex, edges: &Order, barcode: &mut Barcode) -> Vec<bool> {
    let (present, values) = (&complex.present, complex.edge_values());
    let mut sets = UnionFind::new(present.len());
    let mut joins = vec![false; edges.at.len()];
    for (rank, &edge) in edges.at.iter().enumerate() {
        let [a, b] = complex.edges()[edge as usize];
        if let Some(vertex) = sets.union(a, b) {
            joins[rank] = true;
            let death = values[edge as usize];
            let death_simplex = Some(edge);
            barcode.push(Bar {
                dimension: 0,
                birth: 0.0,
                death,
                birth_simplex: vertex,
                death_simplex,
            });
        }
    }
    for vertex in (0..present.len() as u32).filter(|&v| present[v as usize]) {
        if sets.find(vertex) == vertex {
            let death = f64::INFINITY;
            barcode.push(Bar {
                dimension: 0,
                birth: 0.0,
                death,
                birth_simplex: vertex,
                death_simplex: None,
            });
        }
    }
    joins
}

/// Turns a pairing into bars.
fn record(
    dimension: usize,
    pairing: &crate::cohomology::Pairing,
    (columns, births): (&Order, &[f64]),
    (rows, deaths): (&Order, &[f64]),
    barcode: &mut Barcode,
) {
    let bar = |column: u32, row: Option<usize>| {
        let birth_simplex = columns.at[column as usize];
        let death_simplex = row.map(|row| rows.at[row]);
        let death = death_simplex.map_or(f64::INFINITY, |simplex| deaths[simplex as usize]);
        Bar {
            dimension,
            birth: births[birth_simplex as usize],
            death,
            birth_simplex,
            death_simplex,
        }
    };
    for (row, &column) in pairing.column_of_row.iter().enumerate() {
        if column != NONE {
            barcode.push(bar(column, Some(row)));
        }
    }
    for (column, _) in &pairing.essential {
        barcode.push(bar(*column, None));
    }
}
