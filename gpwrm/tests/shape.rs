//! Shape functions: sparse, summing to one, and what they add up to.
#![allow(missing_docs, clippy::unwrap_used)]

use gpwrm::{Field, FieldOptions, ShapeFunctions, Support, Weight};
use nalgebra::{Matrix4, Point3, Rotation3, Vector3, Vector4};
use proptest::prelude::*;

fn vector(size: f64) -> impl Strategy<Value = Vector3<f64>> {
    let c = -size..size;
    (c.clone(), c.clone(), c).prop_map(|(x, y, z)| Vector3::new(x, y, z))
}

/// Nodes 10 mm apart on a bowl.
fn bowl() -> Vec<Point3<f64>> {
    (0..196)
        .map(|k| (f64::from(k % 14) * 0.01, f64::from(k / 14) * 0.01))
        .map(|(x, y)| Point3::new(x, y, 3.0 * (x * x + y * y)))
        .collect()
}

/// A bend, a turn, and a shake of every node.
fn motion(nodes: &[Point3<f64>], turn: &Vector3<f64>, shake: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    let r = Rotation3::new(*turn);
    let bent = |p: &Point3<f64>| r * (p + Vector3::new(-2.0 * p.x * p.z, 0.0, p.x * p.x)) - p;
    let shaken = |(p, d): (&Point3<f64>, &Vector3<f64>)| bent(p) + d;
    nodes.iter().zip(shake.iter().cycle()).map(shaken).collect()
}

proptest! {
    /// Many points at once as one by one, bit for bit: beside each other, far apart, far from the nodes, few nodes, one point without a place.
    #[test]
    fn each_of_many_points_as_alone(
        nodes in proptest::collection::vec(vector(0.1), 1..150), beside in proptest::collection::vec(vector(1.0), 0..20),
        at in vector(0.3), width in prop::sample::select(vec![0.0, 0.003, 0.03, 0.3]), count in 1_usize..12, lost in any::<bool>(),
    ) {
        let nodes: Vec<Point3<f64>> = nodes.into_iter().map(Point3::from).collect();
        let mut points: Vec<Point3<f64>> = beside.iter().map(|d| Point3::from(at + d * width)).collect();
        if lost {
            points.push(Point3::new(1e70, 0.0, f64::NAN));
        }
        let shapes = ShapeFunctions::new(&nodes, count).unwrap();
        let alone: Vec<_> = points.iter().map(|p| shapes.at(p)).collect();
        prop_assert_eq!(shapes.at_each(&points), alone);
    }

    /// `Σ φ u + turn = u(p)`, on and off the surface, at any rotation; few nodes; `Σ φ = 1`.
    #[test]
    fn shapes_add_up_to_the_field(
        turn in vector(1.8), shake in proptest::collection::vec(vector(0.001), 17), q in vector(0.05), count in 4_usize..20,
    ) {
        let nodes = bowl();
        let u = motion(&nodes, &turn, &shake);
        let options = FieldOptions::default().with_support(Support::Nearest(count));
        let field = Field::new(&nodes, &u, &options).unwrap();
        let p = Point3::new(0.065, 0.065, 0.025) + q;
        let shape = field.shape(&p);
        // Rounding of 1e-15 times the condition of a neighbourhood, 1/ε, times a lever of 0.1 m.
        prop_assert!((shape.displacement(&u) - field.displacement(&p)).norm() < 1e-11);
        prop_assert!((shape.functions.iter().map(|f| f.1).sum::<f64>() - 1.0).abs() < 1e-10);
        prop_assert!(shape.functions.windows(2).all(|w| w[0].0 < w[1].0));
        prop_assert!(shape.functions.len() < nodes.len());
        prop_assert_eq!(&shape.functions, &field.shape_functions(&p));
    }

    /// The derivative by node against central differences of the field itself, rotations and all.
    #[test]
    fn jacobian_matches_differences_by_node(
        turn in vector(1.5), shake in proptest::collection::vec(vector(0.001), 17), q in vector(0.03), which in 0_usize..1000, axis in 0_usize..3,
    ) {
        let nodes = bowl();
        let u = motion(&nodes, &turn, &shake);
        let options = FieldOptions::default();
        let field = Field::new(&nodes, &u, &options).unwrap();
        let p = Point3::new(0.065, 0.065, 0.025) + q;
        let jacobian = field.jacobian(&p);
        let (node, block) = jacobian[which % jacobian.len()];
        let h = 1e-6;
        let moved = |by: f64| {
            let mut other = u.clone();
            other[node][axis] += by;
            Field::new(&nodes, &other, &options).unwrap().displacement(&p)
        };
        let slope = (moved(h) - moved(-h)) / (2.0 * h);
        // h² times the third derivative of a rotation over a neighbourhood of 10 mm, 1e6 at most, and the 1e-11 to which rotations
        // settle times a lever of 0.05 m over h.
        prop_assert!((slope - block.column(axis)).norm() < 2e-6, "{slope} {block}");
    }

    /// The definition of the weighted residual solution, `pᵀ A⁻¹ B U` with basis (1, x, y, z), where `A` is regular.
    #[test]
    fn linear_shape_functions_are_the_weighted_residual_solution(
        cloud in proptest::collection::vec(vector(1.0), 12..30), u in proptest::collection::vec(vector(1.0), 30), q in vector(0.4),
    ) {
        let nodes: Vec<Point3<f64>> = cloud.iter().map(|v| Point3::from(*v)).collect();
        let p = Point3::from(q);
        let phi = ShapeFunctions::new(&nodes, 10).unwrap().at(&p);
        prop_assert_eq!(phi.len(), 10);
        let mut far: Vec<f64> = nodes.iter().map(|x| (x - p).norm()).collect();
        far.sort_by(f64::total_cmp);
        let basis = |x: &Point3<f64>| Vector4::new(1.0, x.x - q.x, x.y - q.y, x.z - q.z);
        let weight = |x: &Point3<f64>| Weight::WendlandC2.value((x - p).norm() / far[10]);
        // The damping of .01 tr M on the centred scatter M, which the documentation names.
        let total: f64 = nodes.iter().map(weight).sum();
        let mean: Vector3<f64> = nodes.iter().map(|x| weight(x) * (x - p)).sum::<Vector3<f64>>() / total;
        let trace: f64 = nodes.iter().map(|x| weight(x) * (x - p - mean).norm_squared()).sum();
        let mut a = Matrix4::zeros();
        let mut b_u = nalgebra::Matrix4x3::zeros();
        for (x, u) in nodes.iter().zip(&u) {
            a += weight(x) * basis(x) * basis(x).transpose();
            b_u += weight(x) * basis(x) * u.transpose();
        }
        for k in 1..4 {
            a[(k, k)] += 0.01 * trace;
        }
        let expected = a.try_inverse().unwrap().row(0) * b_u;
        let found: Vector3<f64> = phi.iter().map(|&(i, phi)| phi * u[i]).sum();
        prop_assert!((found - expected.transpose()).norm() < 1e-9);
    }
}

#[test]
fn linear_shape_functions_are_nearly_linear_on_a_surface() {
    let nodes = bowl();
    let shapes = ShapeFunctions::new(&nodes, 8).unwrap();
    for k in 0..100 {
        let (x, y) = (
            f64::from(k % 10) * 0.009 + 0.02,
            f64::from(k / 10) * 0.009 + 0.02,
        );
        let p = Point3::new(x, y, 3.0 * (x * x + y * y));
        let phi = shapes.at(&p);
        assert_eq!(phi.len(), 8);
        assert!((phi.iter().map(|s| s.1).sum::<f64>() - 1.0).abs() < 1e-12);
        let x: f64 = phi.iter().map(|s| s.1 * nodes[s.0].x).sum();
        // The damping takes κ τ / (λ + κ τ), 2 to 4 %, of the distance to the mean of the nodes, a spacing at most.
        assert!((x - p.x).abs() < 0.04 * 0.01, "{}", x - p.x);
    }
}

#[test]
fn points_that_are_nowhere_have_no_shape() {
    let nodes = bowl();
    let still = vec![Vector3::zeros(); nodes.len()];
    let field = Field::new(&nodes, &still, &FieldOptions::default()).unwrap();
    for p in [
        Point3::new(f64::NAN, 0.0, 0.0),
        Point3::new(0.0, f64::INFINITY, 0.0),
        Point3::new(0.0, 0.0, 1e70),
    ] {
        assert!(field.shape(&p).functions.is_empty());
        assert!(field.jacobian(&p).is_empty());
        assert!(ShapeFunctions::new(&nodes, 8).unwrap().at(&p).is_empty());
    }
}
