//! Laws of the field, for all inputs.
#![allow(missing_docs, clippy::unwrap_used)]

use gpwrm::{Field, FieldOptions, Support};
use nalgebra::{Matrix3, Point3, Rotation3, Vector3};
use proptest::prelude::*;

fn vector(size: f64) -> impl Strategy<Value = Vector3<f64>> {
    let c = -size..size;
    (c.clone(), c.clone(), c).prop_map(|(x, y, z)| Vector3::new(x, y, z))
}

fn rotation() -> impl Strategy<Value = Rotation3<f64>> {
    let angle = prop_oneof![3 => 0.0..=std::f64::consts::PI, 1 => Just(std::f64::consts::PI)];
    (vector(1.0), angle).prop_filter_map("axis", |(axis, angle)| {
        (axis.norm() > 0.1).then(|| Rotation3::new(axis.normalize() * angle))
    })
}

/// A bent sheet of nodes, 10 mm apart, bending `z = k(x² + y²)/2`; flat for `k = 0`.
fn sheet(k: f64) -> Vec<Point3<f64>> {
    (0..64)
        .map(|i| {
            let (x, y) = (f64::from(i % 8) * 0.01, f64::from(i / 8) * 0.01);
            Point3::new(x, y, k * (x * x + y * y) / 2.0)
        })
        .collect()
}

fn rigid(nodes: &[Point3<f64>], r: &Rotation3<f64>, t: &Vector3<f64>) -> Vec<Vector3<f64>> {
    nodes.iter().map(|p| r * p + t - p).collect()
}

/// `R − I + (C − (R − I) M)(M + ε τ I)⁻¹` by singular values; for well spread nodes, whose rotation is plain.
fn nodal_gradient(
    i: usize,
    nodes: &[Point3<f64>],
    motion: &[Vector3<f64>],
    radius: f64,
) -> Matrix3<f64> {
    let weight = |x: &Point3<f64>| gpwrm::Weight::WendlandC2.value((x - nodes[i]).norm() / radius);
    let total: f64 = nodes.iter().map(weight).sum();
    let mean = |value: &dyn Fn(usize) -> Vector3<f64>| -> Vector3<f64> {
        (0..nodes.len())
            .map(|j| value(j) * (weight(&nodes[j]) / total))
            .sum()
    };
    let (x, u) = (mean(&|j| nodes[j].coords), mean(&|j| motion[j]));
    let (mut m, mut c) = (Matrix3::zeros(), Matrix3::zeros());
    for j in 0..nodes.len() {
        let d = nodes[j].coords - x;
        m += weight(&nodes[j]) / total * d * d.transpose();
        c += weight(&nodes[j]) / total * (motion[j] - u) * d.transpose();
    }
    if m.trace() < 1e-12 {
        return Matrix3::zeros();
    }
    let turn = gpwrm::nearest_rotation(&(m + c)).matrix() - Matrix3::identity();
    let damped = m + Matrix3::identity() * (0.003 * m.trace());
    turn + (c - turn * m) * damped.try_inverse().unwrap()
}

proptest! {
    /// Rigid motions come out on and off the surface. Rounding is 1e-15 of a metre times the condition of a
    /// neighbourhood, at most 1e3; 1e-9 is the promise.
    #[test]
    fn rigid_motions_are_reproduced(
        k in 0.0..20.0, r in rotation(), t in vector(0.2), q in vector(0.1),
        radius in proptest::option::of(0.018..0.04),
    ) {
        let nodes = sheet(k);
        let support = radius.map_or(Support::Nearest(16), Support::Radius);
        let options = FieldOptions::default().with_support(support);
        let field = Field::new(&nodes, &rigid(&nodes, &r, &t), &options).unwrap();
        let p = Point3::new(0.035, 0.035, 0.0) + q;
        let sample = field.evaluate(&p);
        prop_assert!((p + sample.displacement - (r * p + t)).norm() < 1e-9);
        prop_assert!((sample.displacement - field.displacement(&p)).norm() < 1e-15);
        prop_assert!((sample.gradient + Matrix3::identity() - r.matrix()).norm() < 1e-7);
        prop_assert!((field.rotation(&p).matrix() - r.matrix()).norm() < 1e-7);
        let moved = r * p + t;
        let back = field.inverse().unwrap().displacement(&moved);
        prop_assert!((moved + back - p).norm() < 1e-9);
    }

    /// The gradient is the derivative of the displacement, `ψ` and the growing support included.
    #[test]
    fn gradient_matches_central_differences(
        k in 1.0..20.0, a in vector(3.0), q in vector(0.04),
    ) {
        let nodes = sheet(k);
        let wave = |p: &Point3<f64>| 0.003 * Vector3::new((40.0 * p.y).sin(), a.x * p.x, (30.0 * p.x + a.y).cos());
        let motion: Vec<_> = nodes.iter().map(wave).collect();
        let field = Field::new(&nodes, &motion, &FieldOptions::default()).unwrap();
        let p = Point3::new(0.035, 0.035, 0.01) + q;
        let h = 1e-7;
        let gradient = field.evaluate(&p).gradient;
        let mut kink = f64::INFINITY;
        let mut sorted: Vec<f64> = nodes.iter().map(|x| (p - x).norm()).collect();
        sorted.sort_by(f64::total_cmp);
        // The derivative jumps where two nodes are equally near, and at a node.
        kink = kink.min(sorted[1] - sorted[0]).min(sorted[0]);
        prop_assume!(kink > 1e-6);
        for axis in 0..3 {
            let mut e = Vector3::zeros();
            e[axis] = h;
            let slope = (field.displacement(&(p + e)) - field.displacement(&(p - e))) / (2.0 * h);
            // h² times third derivatives (1e5 at most), and 1e-17 / h of rounding.
            prop_assert!((slope - gradient.column(axis)).norm() < 1e-6);
        }
    }

    /// The frame in which the nodes are written does not matter.
    #[test]
    fn field_turns_with_the_frame(r in rotation(), t in vector(1.0), u in proptest::collection::vec(vector(0.01), 64), q in vector(0.03)) {
        let nodes = sheet(8.0);
        let p = Point3::new(0.035, 0.035, 0.01) + q;
        let options = FieldOptions::default();
        let here = Field::new(&nodes, &u, &options).unwrap().displacement(&p);
        let other_nodes: Vec<_> = nodes.iter().map(|x| r * x + t).collect();
        let other_u: Vec<_> = u.iter().map(|d| r * d).collect();
        let there = Field::new(&other_nodes, &other_u, &options).unwrap().displacement(&(r * p + t));
        prop_assert!((there - r * here).norm() < 1e-9);
    }

    /// The field as it is written down, over all nodes and without any search.
    #[test]
    fn field_equals_its_definition(
        jitter in proptest::collection::vec(vector(0.004), 48), q in vector(0.1), radius in 0.035..0.06,
    ) {
        // Spread in all directions, so that every neighbourhood has a plain rotation.
        let grid = |k: usize| Vector3::new((k % 4) as f64, (k / 4 % 4) as f64, (k / 16) as f64) * 0.015;
        let nodes: Vec<Point3<f64>> = jitter.iter().enumerate().map(|(k, d)| Point3::from(grid(k) + d)).collect();
        let motion: Vec<_> = nodes.iter().map(|p| 0.1 * Vector3::new(p.y, p.z * p.z, p.x)).collect();
        let options = FieldOptions::default().with_support(Support::Radius(radius));
        let field = Field::new(&nodes, &motion, &options).unwrap();
        let p = Point3::from(q);
        let reach = radius + nodes.iter().map(|x| (p - x).norm()).fold(f64::INFINITY, f64::min);
        let weights: Vec<f64> = nodes.iter().map(|x| options.weight.value((p - x).norm() / reach)).collect();
        let total: f64 = weights.iter().sum();
        let gradients: Vec<Matrix3<f64>> = (0..nodes.len()).map(|i| nodal_gradient(i, &nodes, &motion, radius)).collect();
        let mean: Matrix3<f64> = gradients.iter().zip(&weights).map(|(g, w)| g * (w / total)).sum();
        let expected: Vector3<f64> = (0..nodes.len())
            .map(|i| (motion[i] + (gradients[i] + mean) * (p - nodes[i]) / 2.0) * (weights[i] / total))
            .sum();
        prop_assert!((field.displacement(&p) - expected).norm() < 1e-9);
    }

    /// The order of the nodes does not matter, beyond the order of summation.
    #[test]
    fn field_forgets_the_order_of_nodes(u in proptest::collection::vec(vector(0.01), 64), q in vector(0.04)) {
        let nodes = sheet(8.0);
        let p = Point3::new(0.035, 0.035, 0.01) + q;
        let options = FieldOptions::default();
        let forward = Field::new(&nodes, &u, &options).unwrap().displacement(&p);
        let reversed = |s: &[Vector3<f64>]| s.iter().rev().copied().collect::<Vec<_>>();
        let nodes_back: Vec<_> = nodes.iter().rev().copied().collect();
        let backward = Field::new(&nodes_back, &reversed(&u), &options).unwrap().displacement(&p);
        prop_assert!((forward - backward).norm() < 1e-9);
    }

    /// Any finite input gives finite output.
    #[test]
    fn nothing_becomes_nan(
        nodes in proptest::collection::vec(vector(1.0), 1..12),
        copies in 1_usize..3, flat in 0.0..1.0_f64, scale in -30..30_i32, q in vector(3.0),
    ) {
        let size = 10_f64.powi(scale);
        let mut all: Vec<Point3<f64>> = Vec::new();
        for _ in 0..copies {
            all.extend(nodes.iter().map(|v| Point3::new(v.x, v.y * f64::round(flat), 0.0) * size));
        }
        let motion: Vec<_> = all.iter().map(|p| Vector3::new(p.y, -p.x, size)).collect();
        let field = Field::new(&all, &motion, &FieldOptions::default()).unwrap();
        for p in [Point3::from(q * size), all[0], Point3::from(q), Point3::from(q * 1e50)] {
            let sample = field.evaluate(&p);
            prop_assert!(sample.displacement.iter().all(|c| c.is_finite()));
            prop_assert!(sample.gradient.iter().all(|c| c.is_finite()), "{sample:?}");
            prop_assert!(field.shape_functions(&p).iter().all(|(_, phi)| phi.is_finite()));
        }
    }
}
