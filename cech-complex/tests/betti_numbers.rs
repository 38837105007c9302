//! Betti numbers without the complex against those of the complex.
#![allow(missing_docs, clippy::unwrap_used, reason = "a test may panic")]

use cech_complex::manifolds::Manifold;
use cech_complex::nalgebra::{Point3, UnitVector3, Vector3};
use cech_complex::{Complex, Cylinder, Error, Options, Orientation, betti_numbers};
use proptest::prelude::*;

type Cloud = (Vec<Point3<f64>>, Vec<UnitVector3<f64>>);

fn both((points, normals): &Cloud, cylinder: Cylinder, options: &Options) -> [[usize; 3]; 2] {
    let complex = Complex::build(points, normals, cylinder, options).unwrap();
    let fast = betti_numbers(points, normals, cylinder, options).unwrap();
    // Before and after values are computed.
    let (scale, without) = (options.max_scale, complex.betti(options.max_scale));
    assert_eq!(without, complex.barcode().rank(scale, scale));
    [fast, without]
}

/// Unit normals of any direction; points free, or on a grid of the given spacing, so that duplicates, lines, planes and exact ties occur.
fn cloud(coordinates: &[[f64; 6]], grid: Option<f64>) -> Cloud {
    let split = |c: &[f64; 6]| {
        let on_grid = |x: f64| grid.map_or(x, |step| (x / step).round() * step);
        let normal = Vector3::new(c[3], c[4], c[5]);
        let normal = if grid.is_some() {
            normal.map(|x| (2.0 * x).round()) + Vector3::new(0.0, 0.0, 0.25)
        } else {
            normal
        };
        let point = Point3::new(c[0], c[1], c[2]).map(on_grid);
        (
            point,
            UnitVector3::try_new(normal, 1e-9).unwrap_or(Vector3::z_axis()),
        )
    };
    coordinates.iter().map(split).unzip()
}

fn orientation() -> impl Strategy<Value = Orientation> {
    prop_oneof![
        Just(Orientation::Free),
        Just(Orientation::default()),
        (-1.0..1.0f64).prop_map(|min_cosine| Orientation::Separate { min_cosine }),
    ]
}

proptest! {
    #[test]
    fn solid_clouds(
        coordinates in prop::collection::vec(prop::array::uniform6(-1.0..1.0f64), 0..70),
        radius in 0.1..0.7f64, flatness in 0.1..4.0f64, scale in 0.5..1.5f64, orientation in orientation(),
    ) {
        let cylinder = Cylinder::new(radius, flatness * radius).unwrap();
        let options = Options::default().with_max_scale(scale).with_orientation(orientation);
        let [fast, full] = both(&cloud(&coordinates, None), cylinder, &options);
        prop_assert_eq!(fast, full);
    }

    /// Radius, height and scale are such that many values are exactly, or to rounding, the scale.
    #[test]
    fn ties(
        coordinates in prop::collection::vec(prop::array::uniform6(-1.0..1.0f64), 1..60),
        step in prop::sample::select(vec![0.25, 0.5, 0.3]),
        [radius, height] in prop::array::uniform2(prop::sample::select(vec![0.5, 1.0, 1.5, 2.0, 2f64.sqrt()])),
        upright in any::<bool>(), orientation in orientation(),
    ) {
        let (points, mut normals) = cloud(&coordinates, Some(step));
        if upright {
            normals.fill(Vector3::z_axis());
        }
        let cylinder = Cylinder::new(0.5 * radius * step, height * step).unwrap();
        let options = Options::default().with_orientation(orientation);
        let [fast, full] = both(&(points, normals), cylinder, &options);
        prop_assert_eq!(fast, full);
    }

    /// Sheets with noise: loops and cavities come and go with the scale.
    #[test]
    fn noisy_surfaces(
        seed in 0u64..1000, count in 100usize..350, which in 0usize..4, noise in 0.0..0.4f64,
        radius in 0.7..1.3f64, flatness in 0.3..2.0f64, scale in 0.8..1.3f64,
    ) {
        let surface = [
            Manifold::Sphere { radius: 1.0 },
            Manifold::Torus { major: 1.0, minor: 0.4 },
            Manifold::Plate { radius: 1.0, thickness: 0.5 },
            Manifold::Annulus { inner: 0.5, outer: 1.0 },
        ][which];
        let cloud = surface.uniform(count, seed);
        let offset = noise * cloud.spacing;
        let cloud = cloud.with_noise(offset, noise, seed + 1);
        let cylinder = Cylinder::new(radius * cloud.spacing, radius * flatness * cloud.spacing).unwrap();
        let options = Options::default().with_max_scale(scale);
        let [fast, full] = both(&(cloud.points, cloud.normals), cylinder, &options);
        prop_assert_eq!(fast, full);
    }

    #[test]
    fn neither_order_nor_position_matter(
        coordinates in prop::collection::vec(prop::array::uniform6(-1.0..1.0f64), 2..50),
        turn in prop::array::uniform3(-3.0..3.0f64), shift in prop::array::uniform3(-1e3..1e3f64),
    ) {
        let (points, normals) = cloud(&coordinates, None);
        let cylinder = Cylinder::new(0.4, 0.5).unwrap();
        let options = Options::default();
        let turn = cech_complex::nalgebra::Rotation3::from_scaled_axis(turn.into());
        let moved: Vec<_> = points.iter().rev().map(|p| turn * p + Vector3::from(shift)).collect();
        let turned: Vec<_> = normals.iter().rev().map(|n| turn * n).collect();
        prop_assert_eq!(
            betti_numbers(&points, &normals, cylinder, &options),
            betti_numbers(&moved, &turned, cylinder, &options)
        );
    }
}

/// A square grid of upright discs whose radius is half the side, or half the diagonal: every edge of the grid, every square and every
/// diagonal is an exact tie.
#[test]
fn grids_whose_discs_just_touch() {
    let points: Vec<Point3<f64>> = (0..400)
        .map(|i| Point3::new(f64::from(i % 20), f64::from(i / 20), 0.0))
        .collect();
    let cloud = (points, vec![Vector3::z_axis(); 400]);
    for radius in [0.5, 0.5f64.sqrt(), 1.0, 1.25f64.sqrt()] {
        let [fast, full] = both(
            &cloud,
            Cylinder::new(radius, 0.5).unwrap(),
            &Options::default(),
        );
        assert_eq!(fast, full, "radius {radius}");
    }
}

#[test]
fn surfaces_of_known_topology() {
    let known = [
        (Manifold::Sphere { radius: 1.0 }, [1, 0, 1]),
        (
            Manifold::Torus {
                major: 1.0,
                minor: 0.4,
            },
            [1, 2, 1],
        ),
        (
            Manifold::Genus2 {
                hole: 1.0,
                web: 0.2,
                tube: 0.55,
            },
            [1, 4, 1],
        ),
        (
            Manifold::Annulus {
                inner: 0.5,
                outer: 1.0,
            },
            [1, 1, 0],
        ),
        (
            Manifold::TwoSpheres {
                radius: 1.0,
                gap: 0.6,
            },
            [2, 0, 2],
        ),
    ];
    for (surface, betti) in known {
        let cloud = surface.net(1500, 1);
        let radius = 1.25 * cloud.spacing;
        let cylinder = Cylinder::new(radius, 0.5 * radius).unwrap();
        let found = betti_numbers(&cloud.points, &cloud.normals, cylinder, &Options::default());
        assert_eq!(found, Ok(betti), "{surface:?}");
    }
}

#[test]
fn input_is_checked_as_for_a_complex() {
    let cylinder = Cylinder::new(1.0, 1.0).unwrap();
    let cloud = Manifold::Disc { radius: 1.0 }.net(50, 1);
    let count = |points, normals, options| betti_numbers(points, normals, cylinder, options);
    let options = Options::default();
    assert_eq!(count(&[], &[], &options), Ok([0; 3]));
    let mut broken = cloud.points.clone();
    broken[7].x = f64::NAN;
    assert!(matches!(
        count(&broken, &cloud.normals, &options),
        Err(Error::NonFinitePoint { index: 7, .. })
    ));
    assert!(matches!(
        count(&cloud.points, &cloud.normals[1..], &options),
        Err(Error::LengthMismatch { .. })
    ));
    let none = options.with_max_scale(0.0);
    assert!(matches!(
        count(&cloud.points, &cloud.normals, &none),
        Err(Error::NotPositive { .. })
    ));
    // 50 vertices that all meet: 1,225 edges and 19,600 triangles.
    let limit = options.with_max_simplices(20_000);
    assert!(matches!(
        count(&cloud.points, &cloud.normals, &limit),
        Err(Error::TooManySimplices { .. })
    ));
    assert_eq!(
        count(
            &cloud.points,
            &cloud.normals,
            &options.with_max_simplices(20_875)
        ),
        Ok([1, 0, 0])
    );
}
