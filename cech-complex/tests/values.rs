//! Values are computed when they are first asked for: whoever asks first, and for what, must not matter.
#![allow(missing_docs, clippy::unwrap_used, reason = "a test may panic")]

use cech_complex::nalgebra::{Point3, UnitVector3, Vector3};
use cech_complex::{Change, Complex, Cylinder, Options, Orientation};
use proptest::prelude::*;
use std::collections::BTreeMap;

/// All simplices with their values.
fn content(complex: &Complex) -> BTreeMap<Vec<u32>, f64> {
    fn layer<'a, const N: usize>(
        simplices: &'a [[u32; N]],
        values: &'a [f64],
    ) -> impl Iterator<Item = (Vec<u32>, f64)> + 'a {
        assert_eq!(simplices.len(), values.len());
        simplices
            .iter()
            .map(|s| s.to_vec())
            .zip(values.iter().copied())
    }
    layer(complex.edges(), complex.edge_values())
        .chain(layer(complex.triangles(), complex.triangle_values()))
        .chain(layer(complex.tetrahedra(), complex.tetrahedron_values()))
        .collect()
}

/// Asks for one thing.
fn ask(complex: &Complex, what: u8) {
    match what % 7 {
        0 => drop(complex.edge_values().to_vec()),
        1 => drop(complex.triangle_values().to_vec()),
        2 => drop(complex.tetrahedron_values().to_vec()),
        3 => drop(complex.barcode().clone()),
        4 => drop(complex.classify(0.2).unwrap()),
        5 => assert!(complex.betti(1.0)[0] <= complex.points().len()),
        _ => assert!(complex.betti(0.7)[0] <= complex.points().len()),
    }
}

/// Points in a cube, or on a grid whose step is such that many values are exactly, or to rounding, 1.
fn cloud(coordinates: &[[f64; 6]], grid: bool) -> (Vec<Point3<f64>>, Vec<UnitVector3<f64>>) {
    let split = |c: &[f64; 6]| {
        let on_grid = |x: f64| if grid { (4.0 * x).round() / 4.0 } else { x };
        let normal = Vector3::new(c[3], c[4], c[5]);
        let normal = if grid { normal.map(f64::round) } else { normal };
        let normal = UnitVector3::try_new(normal, 1e-9).unwrap_or(Vector3::z_axis());
        (Point3::new(c[0], c[1], c[2]).map(on_grid), normal)
    };
    coordinates.iter().map(split).unzip()
}

fn coordinates(most: usize) -> impl Strategy<Value = Vec<[f64; 6]>> {
    prop::collection::vec(prop::array::uniform6(-1.0..1.0f64), 2..most)
}

proptest! {
    #[test]
    fn the_order_of_questions_does_not_matter(
        coordinates in coordinates(50), grid in any::<bool>(), asked in prop::collection::vec(any::<u8>(), 4),
        moved in prop::collection::vec(any::<prop::sample::Index>(), 3),
    ) {
        let (points, normals) = cloud(&coordinates, grid);
        let cylinder = Cylinder::new(0.25, 0.25).unwrap();
        let build = || Complex::build(&points, &normals, cylinder, &Options::default()).unwrap();
        let [mut early, mut late] = [build(), build()];
        for (index, &what) in moved.iter().zip(&asked) {
            ask(&early, what);
            ask(&early, what / 7);
            let vertex = index.index(points.len());
            let other = (vertex + 1) % points.len();
            let (point, normal) = (points[other] + 0.1 * *normals[vertex], normals[other]);
            let change = Change::Move { vertex: vertex as u32, point, normal };
            prop_assert_eq!(early.update(&[change]).unwrap(), late.update(&[change]).unwrap());
        }
        // The clone computes for itself what the original does not know yet.
        let clone = late.clone();
        ask(&early, asked[3]);
        prop_assert_eq!(content(&early), content(&clone));
        prop_assert_eq!(clone.barcode(), late.barcode());
        prop_assert_eq!(content(&late), content(&clone));
    }

    /// Which simplices there are is decided without their values: against the values of a complex of larger scale.
    #[test]
    fn the_values_decide_what_there_is(
        coordinates in coordinates(45), grid in any::<bool>(), scale in prop::sample::select(vec![0.5, 0.8, 1.0, 1.25]),
        radius in prop::sample::select(vec![0.25, 0.3, 0.125 * 2f64.sqrt()]), height in prop::sample::select(vec![0.25, 0.5, 0.6]),
        free in any::<bool>(),
    ) {
        let (points, normals) = cloud(&coordinates, grid);
        let cylinder = Cylinder::new(radius, height).unwrap();
        let mut options = Options::default();
        if free {
            options = options.with_orientation(Orientation::Free);
        }
        let build = |scale| Complex::build(&points, &normals, cylinder, &options.with_max_scale(scale)).unwrap();
        let (small, large) = (content(&build(scale)), content(&build(1.3 * scale)));
        prop_assert!(small.values().all(|value| *value <= scale));
        // The values of both agree to the width of a bracket: 1e-6 is more than that.
        for (simplex, value) in &large {
            let there = small.get(simplex);
            prop_assert!(there.is_some() || *value > scale * (1.0 - 1e-6), "{:?} of value {}", simplex, value);
            prop_assert!(there.is_none_or(|other| (other - value).abs() <= 1e-6 * value), "{:?} of value {}", simplex, value);
        }
        prop_assert!(small.keys().all(|simplex| large.contains_key(simplex)));
    }

    /// At the largest scale Betti numbers need no values: against the barcode, which does, also where the complex is no nerve any more.
    #[test]
    fn betti_numbers_of_all_simplices(
        coordinates in coordinates(60), grid in any::<bool>(), radius in 0.2..0.6f64, scale in 0.6..1.4f64,
        cuts in prop::collection::vec((any::<u8>(), any::<prop::sample::Index>()), 0..12),
    ) {
        let (points, normals) = cloud(&coordinates, grid);
        let options = Options::default().with_max_scale(scale);
        let mut complex = Complex::build(&points, &normals, Cylinder::new(radius, radius).unwrap(), &options).unwrap();
        for (dimension, index) in cuts {
            let [_, edges, triangles, tetrahedra] = complex.counts();
            let cut: Vec<u32> = match dimension % 4 {
                1 if edges > 0 => complex.edges()[index.index(edges)].to_vec(),
                2 if triangles > 0 => complex.triangles()[index.index(triangles)].to_vec(),
                3 if tetrahedra > 0 => complex.tetrahedra()[index.index(tetrahedra)].to_vec(),
                _ => vec![index.index(points.len()) as u32],
            };
            complex.cut(&[cut]).unwrap();
            let asked = complex.clone();
            let of_barcode = asked.barcode().rank(scale, scale);
            prop_assert_eq!(complex.betti(scale), of_barcode);
            prop_assert_eq!(complex.betti(2.0 * scale), of_barcode);
            let [_, e, t, q] = content(&asked).keys().fold([0i64; 4], |mut n, simplex| {
                n[simplex.len() - 1] += 1;
                n
            });
            let v = i64::try_from(complex.counts()[0]).unwrap();
            prop_assert_eq!(complex.euler_characteristic(scale), v - e + t - q);
        }
        let of_barcode = complex.clone().barcode().rank(scale, scale);
        prop_assert_eq!(complex.betti(scale), of_barcode);
    }
}

#[test]
fn threads_that_ask_at_once_get_the_same() {
    let cloud = cech_complex::manifolds::Manifold::Sphere { radius: 1.0 }.net(400, 1);
    let radius = 1.25 * cloud.spacing;
    let cylinder = Cylinder::new(radius, radius).unwrap();
    let build = || Complex::build(&cloud.points, &cloud.normals, cylinder, &Options::default());
    let alone = content(&build().unwrap());
    for _ in 0..10 {
        let complex = build().unwrap();
        std::thread::scope(|scope| {
            for what in 0..8 {
                let (complex, alone) = (&complex, &alone);
                scope.spawn(move || {
                    if what == 7 {
                        assert_eq!(&content(&complex.clone()), alone);
                    } else {
                        ask(complex, what);
                    }
                    assert_eq!(&content(complex), alone);
                });
            }
        });
    }
}
