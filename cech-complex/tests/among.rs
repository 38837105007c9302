//! A complex restricted to given pairs against a whole one whose other edges are cut, bit for bit; and a sharp crease.
#![allow(missing_docs, clippy::unwrap_used, reason = "a test may panic")]

use cech_complex::nalgebra::{Point3, UnitVector3, Vector3};
use cech_complex::{Change, Complex, Cylinder, Error, Options, Orientation};
use proptest::prelude::*;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|value| value.to_bits()).collect()
}

fn assert_same(a: &Complex, b: &Complex) {
    assert_eq!(a.edges(), b.edges());
    assert_eq!(a.triangles(), b.triangles());
    assert_eq!(a.tetrahedra(), b.tetrahedra());
    assert_eq!(bits(a.edge_values()), bits(b.edge_values()));
    assert_eq!(bits(a.triangle_values()), bits(b.triangle_values()));
    assert_eq!(bits(a.tetrahedron_values()), bits(b.tetrahedron_values()));
}

fn random_point(rng: &mut ChaCha8Rng) -> (Point3<f64>, UnitVector3<f64>) {
    let point = Point3::from(Vector3::from_fn(|_, _| rng.random_range(0.0..1.0)));
    let normal = Vector3::from_fn(|_, _| rng.random_range(-1.0..1.0));
    (point, UnitVector3::new_normalize(normal + Vector3::z()))
}

proptest! {
    #[test]
    fn restricting_is_cutting_all_other_edges(count in 2..30usize, share in 0.0..1.0f64, seed: u64) {
        let rng = &mut ChaCha8Rng::seed_from_u64(seed);
        let (points, normals): (Vec<_>, Vec<_>) = (0..count).map(|_| random_point(rng)).unzip();
        let cylinder = Cylinder::new(0.3, 0.3).unwrap();
        let options = Options::default().with_orientation(Orientation::Free);
        let mut pairs = Vec::new();
        for a in 0..count as u32 {
            for b in 0..count as u32 {
                // Some in one order, some in the other, some in both.
                if a != b && rng.random_bool(share) {
                    pairs.push([a, b]);
                }
            }
        }
        let mut among = Complex::build_among(&points, &normals, cylinder, &options, &pairs).unwrap();
        let mut cut = Complex::build(&points, &normals, cylinder, &options).unwrap();
        let listed = |&[a, b]: &[u32; 2]| pairs.contains(&[a, b]) || pairs.contains(&[b, a]);
        let others: Vec<[u32; 2]> = cut.edges().iter().copied().filter(|e| !listed(e)).collect();
        cut.cut(&others).unwrap();
        assert_same(&among, &cut);
        prop_assert!((0..count as u32).all(|v| among.contains_vertex(v)));
        // A vertex that moves is joined by its position, in both.
        let (point, normal) = random_point(rng);
        let moved = (0..count as u32).find(|&v| cut.contains_vertex(v));
        if let Some(vertex) = moved.filter(|_| cut.counts()[0] == count) {
            let changes = [Change::Move { vertex, point, normal }];
            among.update(&changes).unwrap();
            cut.update(&changes).unwrap();
            assert_same(&among, &cut);
        }
    }
}

#[test]
fn a_pair_without_a_vertex_is_an_error() {
    let points = [Point3::origin(), Point3::new(0.1, 0.0, 0.0)];
    let normals = [Vector3::z_axis(); 2];
    let cylinder = Cylinder::new(0.1, 0.1).unwrap();
    let error = Complex::build_among(
        &points,
        &normals,
        cylinder,
        &Options::default(),
        &[[0, 1], [1, 2]],
    );
    assert_eq!(error.err(), Some(Error::NoSuchVertex { index: 2, len: 2 }));
}

/// A square sheet folded along its middle until its halves are `angle` apart is contractible. Pairs within two radii along the sheet give that at
/// any angle; limits on normals tear it along the fold, or join its halves.
#[test]
fn a_folded_sheet_is_contractible() {
    let (spacing, rows) = (1.0, 24);
    let cylinder = Cylinder::new(1.45 * spacing, 2.0 * spacing).unwrap();
    let mut torn = 0;
    for degrees in [150, 120, 90, 60, 45, 30, 20] {
        let half = f64::from(degrees).to_radians() / 2.0;
        let (mut flat, mut points, mut normals) = (Vec::new(), Vec::new(), Vec::new());
        let rng = &mut ChaCha8Rng::seed_from_u64(degrees as u64);
        for i in 0..rows {
            for j in 0..rows {
                let x = 0.8 * spacing * (f64::from(i) - 11.5 + rng.random_range(-0.2..0.2));
                let y = 0.8 * spacing * (f64::from(j) + rng.random_range(-0.2..0.2));
                let side = x.signum();
                flat.push([x, y]);
                points.push(Point3::new(x * half.sin(), y, x.abs() * half.cos()));
                let normal = Vector3::new(-side * half.cos(), 0.0, half.sin());
                normals.push(UnitVector3::new_normalize(normal));
            }
        }
        let mut pairs = Vec::new();
        for a in 0..flat.len() {
            for b in 0..a {
                if (flat[a][0] - flat[b][0]).hypot(flat[a][1] - flat[b][1]) < 2.9 * spacing {
                    pairs.push([a as u32, b as u32]);
                }
            }
        }
        let free = Options::default()
            .with_max_scale(1.25)
            .with_orientation(Orientation::Free);
        let along = Complex::build_among(&points, &normals, cylinder, &free, &pairs).unwrap();
        assert_eq!(
            (along.betti(1.0), along.persistent_betti(1.0, 1.25)),
            ([1, 0, 0], [1, 0, 0]),
            "{degrees}°"
        );
        let by_normal =
            Options::default().with_orientation(Orientation::Separate { min_cosine: -0.3 });
        let torn_here = Complex::build(&points, &normals, cylinder, &by_normal).unwrap();
        torn += usize::from(torn_here.betti(1.0) != [1, 0, 0]);
    }
    assert!(
        torn >= 3,
        "the limit on normals tears only {torn} of 7 folds"
    );
}
