//! An updated complex against a new one of the same points, bit for bit.
#![allow(missing_docs, clippy::unwrap_used, reason = "a test may panic")]

use cech_complex::manifolds::Manifold;
use cech_complex::nalgebra::{Point3, UnitVector3, Vector3};
use cech_complex::{Change, Complex, Cylinder, Error, Options, Orientation};
use proptest::prelude::*;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// All simplices with the bits of their values, under the given names of the vertices.
fn content(complex: &Complex, name: impl Fn(u32) -> u32) -> Vec<(Vec<u32>, u64)> {
    fn layer<'a, const N: usize>(
        simplices: &'a [[u32; N]],
        values: &'a [f64],
        name: &'a impl Fn(u32) -> u32,
    ) -> impl Iterator<Item = (Vec<u32>, u64)> + 'a {
        let named = |simplex: &[u32; N]| simplex.iter().map(|&v| name(v)).collect();
        simplices
            .iter()
            .zip(values)
            .map(move |(simplex, value)| (named(simplex), value.to_bits()))
    }
    layer(complex.edges(), complex.edge_values(), &name)
        .chain(layer(complex.triangles(), complex.triangle_values(), &name))
        .chain(layer(
            complex.tetrahedra(),
            complex.tetrahedron_values(),
            &name,
        ))
        .collect()
}

/// Compares the updated complex with a new build of the present points. What it has not computed yet it will still not have computed.
fn assert_fresh(updated: &Complex, options: &Options) {
    let updated = &updated.clone();
    let there: Vec<u32> = (0..updated.points().len() as u32)
        .filter(|&v| updated.contains_vertex(v))
        .collect();
    let points: Vec<_> = there
        .iter()
        .map(|&v| updated.points()[v as usize])
        .collect();
    let normals: Vec<_> = there
        .iter()
        .map(|&v| updated.normals()[v as usize])
        .collect();
    let fresh = Complex::build(&points, &normals, updated.cylinder(), options).unwrap();
    assert_eq!(
        content(updated, |v| v),
        content(&fresh, |v| there[v as usize])
    );
    assert_eq!(updated.counts(), fresh.counts());
    for scale in [1.0, 0.3, 0.6] {
        assert_eq!(updated.betti(scale), fresh.betti(scale));
    }
    for (compact, &v) in there.iter().enumerate() {
        let names: Vec<u32> = fresh
            .neighbours(compact as u32)
            .iter()
            .map(|&w| there[w as usize])
            .collect();
        assert_eq!(updated.neighbours(v), names);
    }
}

fn random_point(rng: &mut ChaCha8Rng) -> (Point3<f64>, UnitVector3<f64>) {
    // On a coarse grid now and then, so that ties and coincident points occur.
    let coordinate = |rng: &mut ChaCha8Rng| {
        let x: f64 = rng.random_range(0.0..1.0);
        if rng.random_bool(0.3) {
            (4.0 * x).round() / 4.0
        } else {
            x
        }
    };
    let point = Point3::from(Vector3::from_fn(|_, _| coordinate(rng)));
    let normal = if rng.random_bool(0.5) {
        Vector3::z_axis()
    } else {
        UnitVector3::new_normalize(Vector3::from_fn(|_, _| rng.random_range(0.1..1.0)))
    };
    (point, normal)
}

fn random_change(rng: &mut ChaCha8Rng, there: &[u32]) -> Change {
    let (point, normal) = random_point(rng);
    let vertex = there.get(rng.random_range(0..there.len().max(1))).copied();
    match (rng.random_range(0..3), vertex) {
        (1, Some(vertex)) => Change::Move {
            vertex,
            point,
            normal,
        },
        (2, Some(vertex)) => Change::Remove { vertex },
        _ => Change::Add { point, normal },
    }
}

proptest! {
    #[test]
    fn any_updates_give_the_fresh_complex(
        seed in any::<u64>(), count in 0usize..40, rounds in 1usize..5, radius in 0.1..0.25f64, oriented in any::<bool>(),
    ) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let (points, normals): (Vec<_>, Vec<_>) = (0..count).map(|_| random_point(&mut rng)).unzip();
        let mut options = Options::default();
        if !oriented {
            options = options.with_orientation(Orientation::Free);
        }
        let cylinder = Cylinder::new(radius, 0.7 * radius).unwrap();
        let mut complex = Complex::build(&points, &normals, cylinder, &options).unwrap();
        for _ in 0..rounds {
            let there: Vec<u32> =
                (0..complex.points().len() as u32).filter(|&v| complex.contains_vertex(v)).collect();
            let mut changes: Vec<Change> =
                (0..rng.random_range(0..8)).map(|_| random_change(&mut rng, &there)).collect();
            // A vertex is removed at most once and not touched afterwards.
            let mut gone = Vec::new();
            changes.retain(|change| match change {
                Change::Add { .. } => true,
                Change::Move { vertex, .. } => !gone.contains(vertex),
                Change::Remove { vertex } => {
                    let first = !gone.contains(vertex);
                    gone.push(*vertex);
                    first
                }
            });
            // What has been asked in between must not matter.
            match rng.random_range(0..4) {
                0 => drop(complex.edge_values().to_vec()),
                1 => drop(complex.triangle_values().to_vec()),
                2 => drop(complex.barcode().clone()),
                _ => drop(complex.betti(1.0)),
            }
            complex.update(&changes).unwrap();
            assert_fresh(&complex, &options);
        }
    }
}

#[test]
fn growing_a_torus_patch_by_patch_ends_with_the_torus() {
    let torus = Manifold::Torus {
        major: 1.0,
        minor: 0.4,
    };
    let cloud = torus.net(600, 3);
    let radius = 1.25 * cloud.spacing;
    let cylinder = Cylinder::new(radius, radius).unwrap();
    let options = Options::default();
    // Sweep by angle, as a camera would uncover it.
    let mut order: Vec<usize> = (0..600).collect();
    let angle = |i: usize| cloud.points[i].y.atan2(cloud.points[i].x);
    order.sort_by(|&a, &b| angle(a).total_cmp(&angle(b)));
    let mut complex = Complex::build(&[], &[], cylinder, &options).unwrap();
    for patch in order.chunks(60) {
        let add = |&i: &usize| Change::Add {
            point: cloud.points[i],
            normal: cloud.normals[i],
        };
        let changes: Vec<Change> = patch.iter().map(add).collect();
        let before = complex.points().len() as u32;
        let updated = complex.update(&changes).unwrap();
        assert_eq!(updated.added, before..before + 60);
        assert_fresh(&complex, &options);
    }
    assert_eq!(complex.betti(1.0), [1, 2, 1]);
}

#[test]
fn only_what_contains_a_changed_vertex_is_renewed() {
    let cloud = Manifold::Sphere { radius: 1.0 }.net(800, 5);
    let radius = 1.25 * cloud.spacing;
    let cylinder = Cylinder::new(radius, radius).unwrap();
    let mut complex =
        Complex::build(&cloud.points, &cloud.normals, cylinder, &Options::default()).unwrap();
    let around_17 = |complex: &Complex| {
        [
            complex.edges().iter().filter(|s| s.contains(&17)).count(),
            complex
                .triangles()
                .iter()
                .filter(|s| s.contains(&17))
                .count(),
            complex
                .tetrahedra()
                .iter()
                .filter(|s| s.contains(&17))
                .count(),
        ]
    };
    let stay = Change::Move {
        vertex: 17,
        point: cloud.points[17],
        normal: cloud.normals[17],
    };
    let updated = complex.update(&[stay]).unwrap();
    assert_eq!(updated.renewed, around_17(&complex));
    let nothing = complex.update(&[]).unwrap();
    assert_eq!((nothing.renewed, nothing.added), ([0; 3], 800..800));
    let gone = complex.update(&[Change::Remove { vertex: 17 }]).unwrap();
    assert_eq!(gone.renewed, [0; 3]);
    assert_eq!(around_17(&complex), [0; 3]);
}

#[test]
fn a_cut_outlives_an_update_of_other_vertices() {
    let points: Vec<_> = (0..6)
        .map(|i| Point3::new(0.5 * f64::from(i), 0.0, 0.0))
        .collect();
    let normals = vec![Vector3::z_axis(); 6];
    let cylinder = Cylinder::new(0.3, 0.3).unwrap();
    let mut complex = Complex::build(&points, &normals, cylinder, &Options::default()).unwrap();
    assert_eq!(complex.betti(1.0), [1, 0, 0]);
    complex.cut(&[[2, 3]]).unwrap();
    let point = Point3::new(3.0, 0.0, 0.0);
    let add = Change::Add {
        point,
        normal: Vector3::z_axis(),
    };
    complex.update(&[add]).unwrap();
    assert_eq!((complex.betti(1.0), complex.counts()[1]), ([2, 0, 0], 5));
    let again = Change::Move {
        vertex: 3,
        point: points[3],
        normal: normals[3],
    };
    complex.update(&[again]).unwrap();
    assert_eq!((complex.betti(1.0), complex.counts()[1]), ([1, 0, 0], 6));
}

#[test]
fn a_refused_update_changes_nothing() {
    let points = vec![Point3::origin(); 5];
    let normals = vec![Vector3::z_axis(); 5];
    let cylinder = Cylinder::new(0.3, 0.3).unwrap();
    // Five coincident points have 5 + 10 + 10 + 5 simplices, six have 6 + 15 + 20 + 15.
    let options = Options::default().with_max_simplices(40);
    let mut complex = Complex::build(&points, &normals, cylinder, &options).unwrap();
    let before = content(&complex, |v| v);
    let add = |x: f64| Change::Add {
        point: Point3::new(x, 0.0, 0.0),
        normal: Vector3::z_axis(),
    };
    let remove = Change::Remove { vertex: 2 };
    let refused = [
        (vec![add(0.0)], "limit is 40"),
        (vec![remove, add(f64::NAN)], "point 5 is not finite"),
        (
            vec![add(9.0), Change::Remove { vertex: 7 }],
            "vertex 7 does not exist",
        ),
        (vec![remove, remove], "vertex 2 has been removed"),
    ];
    for (changes, message) in refused {
        let error: Error = complex.update(&changes).unwrap_err();
        assert!(error.to_string().contains(message), "{error}");
        assert_eq!(content(&complex, |v| v), before);
        assert_eq!(complex.counts(), [5, 10, 10, 5]);
    }
    assert_eq!(complex.update(&[add(9.0)]).unwrap().added, 5..6);
}
