//! Nerve and persistence against brute force: every subset solved on its own, ranks by dense elimination over Z/2.
#![allow(missing_docs, clippy::unwrap_used, reason = "a test may panic")]

use cech_complex::nalgebra::{Point3, UnitVector3, Vector3};
use cech_complex::{Complex, Cylinder, Options, Orientation, filtration_value};
use proptest::prelude::*;
use std::collections::{BTreeMap, BTreeSet};

/// Vector over Z/2.
type Bits = Vec<u64>;

fn flip(bits: &mut Bits, i: usize) {
    bits[i / 64] ^= 1 << (i % 64);
}

/// Rank over Z/2 by elimination.
fn rank(mut rows: Vec<Bits>) -> usize {
    let mut rank = 0;
    let width = rows.first().map_or(0, |row| 64 * row.len());
    for bit in 0..width {
        let set = |row: &Bits| row[bit / 64] >> (bit % 64) & 1 == 1;
        let Some(found) = (rank..rows.len()).find(|&r| set(&rows[r])) else {
            continue;
        };
        rows.swap(rank, found);
        let pivot = rows[rank].clone();
        for row in rows.iter_mut().skip(rank + 1) {
            if set(row) {
                row.iter_mut().zip(&pivot).for_each(|(a, b)| *a ^= b);
            }
        }
        rank += 1;
    }
    rank
}

/// Simplices of one dimension with their values.
type Layer = Vec<(Vec<u32>, f64)>;

fn layers(complex: &Complex) -> [Layer; 4] {
    fn layer<const N: usize>(simplices: &[[u32; N]], values: &[f64]) -> Layer {
        simplices
            .iter()
            .zip(values)
            .map(|(s, v)| (s.to_vec(), *v))
            .collect()
    }
    let vertices = (0..complex.points().len() as u32).filter(|&v| complex.contains_vertex(v));
    [
        vertices.map(|v| (vec![v], 0.0)).collect(),
        layer(complex.edges(), complex.edge_values()),
        layer(complex.triangles(), complex.triangle_values()),
        layer(complex.tetrahedra(), complex.tetrahedron_values()),
    ]
}

/// Boundaries of the simplices up to `scale`, as vectors over all simplices one dimension below.
fn boundaries(layer: &Layer, below: &Layer, scale: f64) -> Vec<Bits> {
    let index: BTreeMap<&[u32], usize> = below
        .iter()
        .enumerate()
        .map(|(i, (s, _))| (s.as_slice(), i))
        .collect();
    let boundary = |simplex: &Vec<u32>| {
        let mut bits = vec![0; below.len().div_ceil(64).max(1)];
        for skip in 0..simplex.len() {
            let mut face = simplex.clone();
            face.remove(skip);
            flip(&mut bits, index[face.as_slice()]);
        }
        bits
    };
    layer
        .iter()
        .filter(|(_, value)| *value <= scale)
        .map(|(s, _)| boundary(s))
        .collect()
}

/// A basis of the cycles of one dimension up to `scale`, by elimination with the identity alongside.
fn cycles(layer: &Layer, below: Option<&Layer>, scale: f64) -> Vec<Bits> {
    let words = layer.len().div_ceil(64).max(1);
    let members: Vec<usize> = (0..layer.len()).filter(|&i| layer[i].1 <= scale).collect();
    let unit = |i: usize| {
        let mut bits = vec![0; words];
        flip(&mut bits, i);
        bits
    };
    let Some(below) = below else {
        return members.into_iter().map(unit).collect();
    };
    let images = boundaries(layer, below, scale);
    let mut rows: Vec<(Bits, Bits)> = images
        .into_iter()
        .zip(members.into_iter().map(unit))
        .collect();
    let mut done = 0;
    for bit in 0..64 * below.len().div_ceil(64).max(1) {
        let set = |row: &(Bits, Bits)| row.0[bit / 64] >> (bit % 64) & 1 == 1;
        let Some(found) = (done..rows.len()).find(|&r| set(&rows[r])) else {
            continue;
        };
        rows.swap(done, found);
        let pivot = rows[done].clone();
        for row in rows.iter_mut().skip(done + 1) {
            if set(row) {
                row.0.iter_mut().zip(&pivot.0).for_each(|(a, b)| *a ^= b);
                row.1.iter_mut().zip(&pivot.1).for_each(|(a, b)| *a ^= b);
            }
        }
        done += 1;
    }
    rows.drain(done..)
        .map(|(_, combination)| combination)
        .collect()
}

/// `rank(H_k(K_a) → H_k(K_b)) = dim(Z_a + B_b) − dim B_b`.
fn persistent_betti(complex: &Complex, from: f64, to: f64) -> [usize; 3] {
    let layers = layers(complex);
    std::array::from_fn(|k| {
        let below = (k > 0).then(|| &layers[k - 1]);
        let bounds = boundaries(&layers[k + 1], &layers[k], to);
        let mut both = bounds.clone();
        both.extend(cycles(&layers[k], below, from));
        rank(both) - rank(bounds)
    })
}

fn cloud(coordinates: &[[f64; 6]]) -> (Vec<Point3<f64>>, Vec<UnitVector3<f64>>) {
    let split = |c: &[f64; 6]| {
        // Grid coordinates, so that duplicates, lines, planes and exact ties occur.
        let point = Point3::new(c[0].round(), c[1].round(), c[2].round() * 0.5);
        let normal = Vector3::new(c[3].round(), c[4].round(), c[5].round() + 0.25);
        (point, UnitVector3::new_normalize(normal))
    };
    coordinates.iter().map(split).unzip()
}

fn options(scale: f64) -> Options {
    Options::default()
        .with_max_scale(scale)
        .with_orientation(Orientation::Free)
}

proptest! {
    /// Every pair, triple and quadruple has a simplex exactly if its own value is within the scale, and with that value.
    #[test]
    fn nerve_is_what_every_subset_says(
        coordinates in prop::collection::vec(prop::array::uniform6(-2.0..2.0f64), 1..8),
        radius in 0.5..1.5f64, height in 0.3..2.0f64,
    ) {
        let (points, normals) = cloud(&coordinates);
        let cylinder = Cylinder::new(radius, height).unwrap();
        let complex = Complex::build(&points, &normals, cylinder, &options(1.0)).unwrap();
        let mut built: BTreeMap<Vec<u32>, f64> = layers(&complex).into_iter().flatten().collect();
        for subset in 1u32..1 << points.len() {
            let members: Vec<u32> = (0..points.len() as u32).filter(|v| subset >> v & 1 == 1).collect();
            if members.len() > 4 {
                continue;
            }
            let pick = |v: &u32| (points[*v as usize], normals[*v as usize]);
            let (p, n): (Vec<_>, Vec<_>) = members.iter().map(pick).unzip();
            let f = filtration_value(&p, &n, cylinder).unwrap();
            match built.remove(&members) {
                Some(value) => prop_assert!((value - f.value).abs() <= 1e-11 * (1.0 + f.value), "{members:?} {value} {f:?}"),
                // Rounding may decide a value of exactly 1 either way.
                None => prop_assert!(f.value > 1.0 - 1e-11, "{members:?} {f:?}"),
            }
        }
        prop_assert!(built.is_empty());
    }

    #[test]
    fn values_are_monotone_to_the_last_bit(
        coordinates in prop::collection::vec(prop::array::uniform6(-2.0..2.0f64), 1..12),
    ) {
        let (points, normals) = cloud(&coordinates);
        let complex = Complex::build(&points, &normals, Cylinder::new(1.0, 0.7).unwrap(), &options(1.5)).unwrap();
        let all: BTreeMap<Vec<u32>, f64> = layers(&complex).into_iter().flatten().collect();
        for (simplex, value) in &all {
            for skip in 0..simplex.len() {
                let mut face = simplex.clone();
                face.remove(skip);
                prop_assert!(face.is_empty() || all[&face] <= *value);
            }
        }
    }

    #[test]
    fn ranks_equal_dense_elimination(
        coordinates in prop::collection::vec(prop::array::uniform6(-3.0..3.0f64), 1..16),
        scales in prop::array::uniform2(0.0..1.3f64),
    ) {
        let (points, normals) = cloud(&coordinates);
        let complex = Complex::build(&points, &normals, Cylinder::new(0.9, 0.8).unwrap(), &options(1.3)).unwrap();
        let (from, to) = (scales[0].min(scales[1]), scales[0].max(scales[1]));
        prop_assert_eq!(complex.persistent_betti(from, to), persistent_betti(&complex, from, to));
        prop_assert_eq!(complex.betti(to), persistent_betti(&complex, to, to));
        prop_assert_eq!(complex.representative_loops(to).len(), complex.betti(to)[1]);
    }

    /// What is left after a cut is a complex, without the cut, and its ranks are still those of dense elimination.
    #[test]
    fn a_cut_leaves_a_complex(
        coordinates in prop::collection::vec(prop::array::uniform6(-3.0..3.0f64), 4..14),
        cuts in prop::collection::vec(prop::collection::vec(0u32..4, 1..5), 0..5),
    ) {
        let (points, normals) = cloud(&coordinates);
        let mut complex = Complex::build(&points, &normals, Cylinder::new(1.2, 1.2).unwrap(), &options(1.0)).unwrap();
        let before = complex.counts();
        let removed = complex.cut(&cuts).unwrap();
        let after = complex.counts();
        prop_assert_eq!(before[0] - after[0], removed.vertices.len());
        prop_assert_eq!(before[3] - after[3], removed.tetrahedra);
        let left: BTreeSet<Vec<u32>> =
            layers(&complex).into_iter().flatten().map(|(simplex, _)| simplex).collect();
        for simplex in &left {
            let contains = |cut: &Vec<u32>| cut.iter().all(|v| simplex.contains(v));
            // Names that occur twice are no simplex and cut nothing.
            let proper = |cut: &&Vec<u32>| cut.iter().collect::<BTreeSet<_>>().len() == cut.len();
            prop_assert!(!cuts.iter().filter(proper).any(contains), "{simplex:?} {cuts:?}");
            for skip in 0..simplex.len() {
                let mut face = simplex.clone();
                face.remove(skip);
                prop_assert!(face.is_empty() || left.contains(&face));
            }
        }
        prop_assert_eq!(complex.betti(1.0), persistent_betti(&complex, 1.0, 1.0));
    }
}
