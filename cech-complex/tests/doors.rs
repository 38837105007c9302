//! Input checks: invalid input gives an error with its place, degenerate input a result.
#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::float_cmp,
    reason = "a test may panic, and exact answers are exact"
)]

use cech_complex::nalgebra::{Point3, Unit, UnitVector3, Vector3};
use cech_complex::{
    Complex, Cylinder, DistortionLimits, Error, Options, Orientation, VertexKind,
    displacement_cosine, displacement_difference, filtration_value, missing_vector_area,
    vector_area_of_loop,
};

fn build(points: &[Point3<f64>]) -> Complex {
    let normals = vec![Vector3::z_axis(); points.len()];
    Complex::build(
        points,
        &normals,
        Cylinder::new(1.0, 1.0).unwrap(),
        &Options::default(),
    )
    .unwrap()
}

#[test]
fn bad_input_is_named() {
    let cylinder = Cylinder::new(1.0, 1.0).unwrap();
    let options = Options::default();
    let (p, n) = (Point3::origin(), Vector3::z_axis());
    let bad = Point3::new(0.0, f64::NAN, 0.0);
    let found = Complex::build(&[p, bad], &[n, n], cylinder, &options);
    assert!(matches!(found, Err(Error::NonFinitePoint { index: 1, .. })));
    let long: UnitVector3<f64> = Unit::new_unchecked(Vector3::new(0.0, 0.0, 2.0));
    let found = Complex::build(&[p, p], &[long, n], cylinder, &options);
    assert!(matches!(found, Err(Error::NonUnitNormal { index: 0, .. })));
    let nothing: UnitVector3<f64> = Unit::new_unchecked(Vector3::repeat(f64::NAN));
    assert!(Complex::build(&[p], &[nothing], cylinder, &options).is_err());
    let found = Complex::build(&[p], &[], cylinder, &options);
    assert!(matches!(
        found,
        Err(Error::LengthMismatch {
            points: 1,
            others: 0,
            ..
        })
    ));
    for scale in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let found = Complex::build(&[p], &[n], cylinder, &options.with_max_scale(scale));
        assert!(matches!(
            found,
            Err(Error::NotPositive {
                what: "max_scale",
                ..
            })
        ));
    }
    let orientation = Orientation::Separate { min_cosine: 2.0 };
    assert!(Complex::build(&[p], &[n], cylinder, &options.with_orientation(orientation)).is_err());
    for size in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(Cylinder::new(size, 1.0).is_err() && Cylinder::new(1.0, size).is_err());
        assert!(Cylinder::from_spacing_and_reach(size, 1.0).is_err());
    }
    assert!(Cylinder::from_spacing_reach_and_tilt(0.1, 1.0, 1.6).is_err());
    let text = |error: Error| error.to_string();
    assert_eq!(
        Cylinder::from_spacing_reach_and_tilt(0.1, 1.0, -1.0).map_err(text),
        Err("tilt is -1, but must be in [0, π/2)".into())
    );
    assert_eq!(
        Cylinder::new(-1.0, 1.0).map_err(text),
        Err("radius is -1, but must be positive and finite".into())
    );
    assert!(matches!(
        filtration_value(&[], &[], cylinder),
        Err(Error::SimplexSize { count: 0 })
    ));
    assert!(filtration_value(&[p; 5], &[n; 5], cylinder).is_err());
    assert!(missing_vector_area(&[1.0], &[]).is_err());
}

/// The simplices counted and the limit that they passed.
fn counted(found: Result<Complex, Error>) -> (usize, usize) {
    match found {
        Err(Error::TooManySimplices { count, limit, .. }) => (count, limit),
        other => panic!("{other:?}"),
    }
}

#[test]
fn the_limit_on_simplices_stops_before_memory_does() {
    let points = vec![Point3::origin(); 5000];
    let normals = vec![Vector3::z_axis(); 5000];
    let options = Options::default().with_max_simplices(100_000);
    let found = Complex::build(
        &points,
        &normals,
        Cylinder::new(1.0, 1.0).unwrap(),
        &options,
    );
    assert_eq!(counted(found), (100_001, 100_000));
}

#[test]
fn a_million_points_with_a_tiny_limit_end_at_once() {
    let cylinder = Cylinder::new(1.0, 1.0).unwrap();
    let normals = vec![Vector3::z_axis(); 1_000_000];
    // More points than simplices allowed: nothing is even looked at.
    let line: Vec<_> = (0..1_000_000)
        .map(|i| Point3::new(f64::from(i), 0.0, 0.0))
        .collect();
    let tiny = Options::default().with_max_simplices(1000);
    let found = Complex::build(&line, &normals, cylinder, &tiny);
    assert_eq!(counted(found), (1_000_000, 1000));
    // Room for the points and little more: it stops at the first edge too many, in a line as in a heap.
    let little = Options::default().with_max_simplices(1_000_100);
    for points in [line, vec![Point3::origin(); 1_000_000]] {
        let found = Complex::build(&points, &normals, cylinder, &little);
        assert_eq!(counted(found), (1_000_101, 1_000_100));
    }
}

#[test]
fn collinear_points_have_answers_along_and_across_their_normals() {
    for direction in [
        Vector3::x(),
        Vector3::z(),
        Vector3::new(0.3, 0.2, 0.1),
        Vector3::new(1e-9, 0.0, 1.0),
    ] {
        let points: Vec<_> = (0..60)
            .map(|i| Point3::from(direction * (0.2 * f64::from(i))))
            .collect();
        let complex = build(&points);
        assert_eq!(complex.betti(1.0), [1, 0, 0], "{direction}");
        let kinds = complex.classify(0.2 * direction.norm()).unwrap();
        assert!(!kinds.contains(&VertexKind::Interior));
        assert!(complex.representative_loops(1.0).is_empty());
    }
}

#[test]
fn extreme_coordinates_are_values_or_errors() {
    let cylinder = Cylinder::new(1.0, 1.0).unwrap();
    let normals = [Vector3::z_axis(); 3];
    for size in [1e-300, 1e-150, 1e150, 1e300, f64::MAX] {
        let points = [
            Point3::origin(),
            Point3::new(size, 0.0, 0.0),
            Point3::new(0.0, size, size),
        ];
        let complex = Complex::build(&points, &normals, cylinder, &Options::default()).unwrap();
        let together = size < 1.0;
        assert_eq!(
            complex.betti(1.0),
            [if together { 1 } else { 3 }, 0, 0],
            "{size}"
        );
        assert!(complex.edge_values().iter().all(|value| value.is_finite()));
    }
}

#[test]
fn small_and_degenerate_clouds_have_answers() {
    let empty = build(&[]);
    assert_eq!((empty.counts(), empty.betti(1.0)), ([0; 4], [0; 3]));
    assert!(empty.classify(1.0).unwrap().is_empty() && empty.representative_loops(1.0).is_empty());
    let one = build(&[Point3::origin()]);
    assert_eq!(
        (one.betti(0.0), one.euler_characteristic(1.0)),
        ([1, 0, 0], 1)
    );
    assert_eq!(one.classify(1.0).unwrap(), [VertexKind::Isolated]);
    assert!(
        one.boundary_loops(&[VertexKind::Isolated])
            .unwrap()
            .is_empty()
    );
    let far = build(&[Point3::origin(), Point3::new(1e6, 0.0, 0.0)]);
    assert_eq!((far.counts(), far.betti(1.0)), ([2, 0, 0, 0], [2, 0, 0]));
    let twins = build(&[Point3::origin(); 6]);
    assert_eq!(
        (twins.counts(), twins.betti(0.0)),
        ([6, 15, 20, 15], [1, 0, 0])
    );
    assert_eq!(twins.classify(1.0).unwrap().len(), 6);
    let line: Vec<_> = (0..50)
        .map(|i| Point3::new(f64::from(i), 0.0, 0.0))
        .collect();
    let line = build(&line);
    assert_eq!(line.betti(1.0), [1, 0, 0]);
    assert_eq!(line.geodesic_distances(&[0], None).unwrap()[49], 49.0);
    assert!(line.geodesic_distances(&[50], None).is_err());
    assert!(line.geodesic_distances(&[0], Some(f64::NAN)).is_err());
    assert!(line.classify(0.0).is_err() && line.boundary_loops(&[]).is_err());
    assert!(line.neighbours(1000).is_empty() && line.find_edge(0, 1000).is_none());
    assert_eq!(vector_area_of_loop(&[]), Vector3::zeros());
}

#[test]
fn normals_without_a_sign_join_what_orientation_separates() {
    let points = [Point3::origin(), Point3::new(0.0, 0.0, 0.5)];
    let normals = [Vector3::z_axis(), -Vector3::z_axis()];
    let edges = |orientation| {
        let options = Options::default().with_orientation(orientation);
        Complex::build(
            &points,
            &normals,
            Cylinder::new(1.0, 1.0).unwrap(),
            &options,
        )
        .unwrap()
        .edges()
        .len()
    };
    assert_eq!(edges(Orientation::Free), 1);
    assert_eq!(edges(Orientation::Separate { min_cosine: -0.5 }), 0);
    assert_eq!(edges(Orientation::Separate { min_cosine: -1.0 }), 1);
}

#[test]
fn distorted_edges_are_those_that_part_or_disagree() {
    let points: Vec<_> = (0..4)
        .map(|i| Point3::new(f64::from(i), 0.0, 0.0))
        .collect();
    let complex = build(&points);
    let displacements = [
        Vector3::x(),
        Vector3::x() * 1.1,
        Vector3::x() * 5.0,
        Vector3::y() * 5.0,
    ];
    let limits = DistortionLimits::default()
        .with_max_difference(2.0)
        .with_min_cosine(0.5)
        .with_min_displacement(0.1);
    let found = complex.distorted_edges(&displacements, &limits).unwrap();
    assert_eq!(found, [[0, 2], [1, 2], [1, 3], [2, 3]]);
    assert!(complex.distorted_edges(&[], &limits).is_err());
    assert!((displacement_difference(&displacements[0], &displacements[1]) - 0.1).abs() < 1e-15);
    assert_eq!(
        displacement_cosine(&displacements[2], &displacements[3]),
        Some(0.0)
    );
    assert_eq!(
        displacement_cosine(&displacements[2], &Vector3::zeros()),
        None
    );
}

#[test]
fn a_cut_takes_cofaces_and_lonely_points_along() {
    let mut points: Vec<_> = (0..4)
        .map(|i| Point3::new(0.1 * f64::from(i), 0.0, 0.0))
        .collect();
    points.push(Point3::new(2.2, 0.0, 0.0));
    let mut complex = build(&points);
    assert_eq!(complex.counts(), [5, 8, 5, 1]);
    // Vertex 4 hangs on 2 and 3 only.
    let removed = complex.cut(&[[4, 2], [3, 4]]).unwrap();
    assert_eq!(
        (
            removed.vertices.as_slice(),
            removed.edges,
            removed.triangles
        ),
        (&[4][..], 2, 1)
    );
    assert_eq!(
        (complex.counts(), complex.betti(1.0)),
        ([4, 6, 4, 1], [1, 0, 0])
    );
    assert!(complex.cut(&[[0, 9]]).is_err() && complex.cut(&[[0, 1, 2, 3, 4]]).is_err());
    assert!(complex.cut(&[[0; 0]]).is_err());
}
