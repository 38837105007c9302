//! Fields and surfaces with known results, and errors for invalid input.
#![allow(missing_docs, clippy::unwrap_used)]

use gpwrm::{Determinacy, Error, Field, FieldOptions, ShapeFunctions, Support, Tree};
use nalgebra::{Matrix3, Point3, Rotation3, UnitVector3, Vector3};

/// Nodes 10 mm apart on the saddle `z = 2(x² − y²)`.
fn saddle() -> Vec<Point3<f64>> {
    (0..144)
        .map(|k| {
            (
                f64::from(k % 12) * 0.01 - 0.055,
                f64::from(k / 12) * 0.01 - 0.055,
            )
        })
        .map(|(x, y)| Point3::new(x, y, 2.0 * (x * x - y * y)))
        .collect()
}

/// A bend of 20 mm over 110 mm, with its gradient: on the surface the field is right to some hundredths of a mm, a
/// spacing off it to half a mm (measured before: .023 and .48 to .52 mm at the same spacing and size of motion).
#[test]
fn a_bend_is_followed_on_and_off_the_surface() {
    let nodes = saddle();
    let turn = Rotation3::new(Vector3::new(0.3, 0.1, 0.2));
    let map = |p: &Point3<f64>| turn * (p + Vector3::new(-4.0 * p.x * p.z, 0.0, 2.0 * p.x * p.x));
    let jacobian = |p: &Point3<f64>| {
        turn.matrix()
            * Matrix3::new(
                1.0 - 4.0 * p.z,
                0.0,
                -4.0 * p.x, //
                0.0,
                1.0,
                0.0, //
                4.0 * p.x,
                0.0,
                1.0,
            )
    };
    let moved: Vec<_> = nodes.iter().map(|p| map(p) - p).collect();
    let field = Field::new(&nodes, &moved, &FieldOptions::default()).unwrap();
    let (mut on, mut off, mut slope) = (0.0_f64, 0.0_f64, 0.0_f64);
    for k in 0..49 {
        let (x, y) = (
            f64::from(k % 7) * 0.01 - 0.0312,
            f64::from(k / 7) * 0.01 - 0.0287,
        );
        let p = Point3::new(x, y, 2.0 * (x * x - y * y));
        let q = p + Vector3::z() * 0.01;
        let sample = field.evaluate(&p);
        on = on.max((p + sample.displacement - map(&p)).norm());
        off = off.max((q + field.displacement(&q) - map(&q)).norm());
        slope = slope.max((sample.gradient + Matrix3::identity() - jacobian(&p)).norm());
    }
    assert!(on < 0.000_06, "{on}");
    assert!(off < 0.000_6, "{off}");
    assert!(slope < 0.1, "{slope}");
    // And back, between the nodes.
    let back = field.inverse().unwrap();
    let p = Point3::new(0.012, 0.007, 2.0 * (0.012 * 0.012 - 0.007 * 0.007));
    let there = p + field.displacement(&p);
    assert!((there + back.displacement(&there) - p).norm() < 1e-4);
}

#[test]
fn normals_stay_normal_to_what_they_were_normal_to() {
    // A uniform strain: gradient exact, so tangents carried by F and normals carried by the field stay at right angles.
    let strain = Matrix3::new(1.3, 0.2, 0.0, -0.1, 0.8, 0.3, 0.1, 0.0, 1.1);
    let nodes: Vec<Point3<f64>> = (0..125)
        .map(|k| Point3::new(f64::from(k % 5), f64::from(k / 5 % 5), f64::from(k / 25)) * 0.01)
        .collect();
    let moved: Vec<_> = nodes.iter().map(|p| strain * p.coords - p.coords).collect();
    let options = FieldOptions::default().with_shrinkage(1e-9);
    let field = Field::new(&nodes, &moved, &options).unwrap();
    let normal = UnitVector3::new_normalize(Vector3::new(0.3, -0.5, 0.8));
    let p = Point3::new(0.018, 0.023, 0.021);
    let carried = field.warp_normals(&[p], &[normal]).unwrap()[0];
    let tangent = normal.cross(&Vector3::x());
    assert!(carried.dot(&(strain * tangent)).abs() < 1e-7);
    assert!(carried.dot(&(strain * normal.as_ref())) > 0.0);
    assert_eq!(field.evaluate(&p).determinacy, Determinacy::Determined);
}

/// Lemma 2: what the nodes around determine.
#[test]
fn determinacy_follows_the_spread_of_the_nodes() {
    let at = |nodes: &[Point3<f64>]| {
        let still = vec![Vector3::zeros(); nodes.len()];
        let field = Field::new(nodes, &still, &FieldOptions::default()).unwrap();
        field.evaluate(&Point3::new(0.001, 0.0, 0.002))
    };
    let line: Vec<_> = (0..9)
        .map(|k| Point3::new(f64::from(k - 4) * 0.01, 0.0, 0.0))
        .collect();
    let sheet: Vec<_> = (0..25)
        .map(|k| Point3::new(f64::from(k % 5 - 2), f64::from(k / 5 - 2), 0.0) * 0.01)
        .collect();
    let block: Vec<_> = (0..3)
        .flat_map(|z| {
            sheet
                .iter()
                .map(move |p| p + Vector3::z() * 0.01 * f64::from(z - 1))
        })
        .collect();
    assert_eq!(at(&line[..1]).determinacy, Determinacy::Undetermined);
    assert_eq!(at(&line).determinacy, Determinacy::Undetermined);
    assert_eq!(at(&sheet).determinacy, Determinacy::Partly);
    assert_eq!(at(&block).determinacy, Determinacy::Determined);
    let far = at(&sheet).extrapolation - 5_f64.sqrt() * 0.001;
    assert!(far.abs() < 1e-12);
    // Three nodes determine a rotation however near to a line they lie; four a strain, once its spread outweighs the shrinkage.
    let needle = [line[0], line[3], line[8] + Vector3::y() * 1e-5];
    assert_eq!(at(&needle).determinacy, Determinacy::Partly);
    let corner = [line[4], line[5], sheet[17], line[4] + Vector3::z() * 0.01];
    assert_eq!(at(&corner).determinacy, Determinacy::Determined);
    assert_eq!(at(&corner[..3]).determinacy, Determinacy::Partly);
    assert_eq!(at(&corner[..2]).determinacy, Determinacy::Undetermined);
}

/// Extrapolation: how far the nearest node is, and whether any node's own support holds the point.
#[test]
fn extrapolation_is_told_by_distance_and_support() {
    let nodes = saddle();
    let still = vec![Vector3::zeros(); nodes.len()];
    let options = FieldOptions::default().with_support(Support::Radius(0.02));
    let field = Field::new(&nodes, &still, &options).unwrap();
    for k in 0..200 {
        let p = Point3::new(0.0, 0.0, 0.0005 * f64::from(k)) + Vector3::new(0.013, 0.002, -0.03);
        let nearest = nodes
            .iter()
            .map(|x| (x - p).norm())
            .fold(f64::INFINITY, f64::min);
        let sample = field.evaluate(&p);
        assert!((sample.extrapolation - nearest).abs() < 1e-15);
        assert_eq!(sample.extrapolated, nearest > 0.02, "{k}");
        // The field goes on outside all the same.
        assert_eq!(sample.determinacy, Determinacy::Partly);
    }
    let nowhere = field.evaluate(&Point3::new(0.0, f64::NAN, 0.0));
    assert!(nowhere.extrapolated && nowhere.extrapolation.is_infinite());
}

/// Normals of a sheet that turns by any angle turn with it, on it and beside it.
#[test]
fn normals_turn_with_the_sheet() {
    let nodes = saddle();
    let half = Rotation3::new(Vector3::new(0.0, std::f64::consts::PI, 0.0));
    let moved: Vec<_> = nodes.iter().map(|p| half * p - p).collect();
    let field = Field::new(&nodes, &moved, &FieldOptions::default()).unwrap();
    let points: Vec<_> = nodes
        .iter()
        .map(|p| p + Vector3::new(0.002, 0.001, 0.015))
        .collect();
    let normals: Vec<_> = nodes
        .iter()
        .map(|p| UnitVector3::new_normalize(Vector3::new(-4.0 * p.x, 4.0 * p.y, 1.0)))
        .collect();
    let turned = field.warp_normals(&points, &normals).unwrap();
    for (before, after) in normals.iter().zip(&turned) {
        assert!((after.as_ref() - half * before.as_ref()).norm() < 1e-9);
    }
}

#[test]
fn one_two_and_collinear_nodes_take_the_least_rotation() {
    let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), 0.7);
    let nodes = [
        Point3::origin(),
        Point3::new(0.01, 0.0, 0.0),
        Point3::new(0.02, 0.0, 0.0),
    ];
    for count in 2..=3 {
        let moved: Vec<_> = nodes[..count].iter().map(|p| turn * p - p).collect();
        let field = Field::new(&nodes[..count], &moved, &FieldOptions::default()).unwrap();
        // The least rotation that takes the line where it went is the one about z.
        let p = Point3::new(0.005, 0.02, 0.01);
        assert!(
            (p + field.displacement(&p) - turn * p).norm() < 1e-6,
            "{count}"
        );
    }
}

#[test]
fn wrong_input_is_named() {
    let nodes = saddle();
    let still = vec![Vector3::zeros(); nodes.len()];
    let options = FieldOptions::default();
    let build =
        |n: &[Point3<f64>], u: &[Vector3<f64>], o: &FieldOptions| Field::new(n, u, o).map(|_| ());
    assert_eq!(build(&[], &[], &options), Err(Error::NoNodes));
    assert!(matches!(
        build(&nodes, &still[1..], &options),
        Err(Error::LengthMismatch {
            expected: 144,
            found: 143,
            ..
        })
    ));
    let mut broken = nodes.clone();
    broken[5].z = f64::INFINITY;
    assert!(matches!(
        build(&broken, &still, &options),
        Err(Error::BadCoordinate { index: 5, .. })
    ));
    for support in [
        Support::Radius(0.0),
        Support::Radius(f64::NAN),
        Support::Nearest(0),
    ] {
        let options = FieldOptions::default().with_support(support);
        assert!(matches!(
            build(&nodes, &still, &options),
            Err(Error::BadOption { .. })
        ));
    }
    let options = FieldOptions::default().with_shrinkage(-1.0);
    assert!(matches!(
        build(&nodes, &still, &options),
        Err(Error::BadOption {
            option: "shrinkage",
            ..
        })
    ));
    for (nodes, u) in [(0, 5), (3, 3), (143, 0)] {
        let mut moved = still.clone();
        moved[nodes][u % 3] = f64::NAN;
        assert!(matches!(
            build(&self::saddle(), &moved, &FieldOptions::default()),
            Err(Error::BadCoordinate { what: "displacement", index, .. }) if index == nodes
        ));
    }
    assert_eq!(Tree::new(&[]).map(|_| ()), Err(Error::NoNodes));
    assert!(matches!(
        Tree::new(&broken),
        Err(Error::BadCoordinate { index: 5, .. })
    ));
    assert_eq!(ShapeFunctions::new(&[], 8).map(|_| ()), Err(Error::NoNodes));
    assert!(matches!(
        ShapeFunctions::new(&nodes, 0),
        Err(Error::BadOption {
            option: "count",
            ..
        })
    ));
    let field = Field::new(&nodes, &still, &FieldOptions::default()).unwrap();
    let lost = field.evaluate(&Point3::new(f64::NAN, 0.0, 0.0));
    assert_eq!(lost.determinacy, Determinacy::Undetermined);
    assert!(lost.extrapolation.is_infinite());
    assert!(
        field
            .shape_functions(&Point3::new(f64::NAN, 0.0, 0.0))
            .is_empty()
    );
}

/// Two nodes in one place that disagree: the field takes their mean there, and stays finite.
#[test]
fn duplicate_nodes_are_averaged() {
    let mut nodes = saddle();
    let mut moved = vec![Vector3::zeros(); nodes.len()];
    nodes.push(nodes[60]);
    moved.push(Vector3::new(0.002, 0.0, 0.0));
    let options = FieldOptions::default().with_support(Support::Radius(0.005));
    let field = Field::new(&nodes, &moved, &options).unwrap();
    let there = field.displacement(&nodes[60]);
    assert!(
        (there - Vector3::new(0.001, 0.0, 0.0)).norm() < 1e-12,
        "{there}"
    );
}
