//! The law of rigid motion: any rotation, on and off the surface, for every set of nodes with three that are not in line.
#![allow(missing_docs, clippy::unwrap_used)]

use gpwrm::{Determinacy, Field, FieldOptions, Support, Weight};
use nalgebra::{Point3, Rotation3, Vector3};
use proptest::prelude::*;

/// The promise. Coordinates of a metre round to 1e-16; what is left is a lever of 0.3 m at most over the width of the nodes.
const PROMISE: f64 = 1e-9;

fn vector(size: f64) -> impl Strategy<Value = Vector3<f64>> {
    let c = -size..size;
    (c.clone(), c.clone(), c).prop_map(|(x, y, z)| Vector3::new(x, y, z))
}

fn rotation() -> impl Strategy<Value = Rotation3<f64>> {
    let angle = prop_oneof![2 => 0.0..=std::f64::consts::PI, 1 => Just(std::f64::consts::PI)];
    let axis = prop_oneof![
        3 => vector(1.0),
        1 => Just(Vector3::x()), 1 => Just(Vector3::y()), 1 => Just(Vector3::z()),
    ];
    (axis, angle).prop_filter_map("axis", |(axis, angle)| {
        (axis.norm() > 0.1).then(|| Rotation3::new(axis.normalize() * angle))
    })
}

fn support() -> impl Strategy<Value = Support> {
    prop_oneof![
        (1_usize..20).prop_map(Support::Nearest),
        (0.0001..0.1).prop_map(Support::Radius),
    ]
}

fn weight() -> impl Strategy<Value = Weight> {
    prop_oneof![
        Just(Weight::WendlandC2),
        Just(Weight::WendlandC4),
        Just(Weight::Quartic),
    ]
}

/// How far the field over `nodes` is from the motion `x ↦ r x + t` at `probes`; forward and back, value and inverse.
fn error(
    nodes: &[Point3<f64>],
    (r, t): (&Rotation3<f64>, &Vector3<f64>),
    options: &FieldOptions,
    probes: &[Point3<f64>],
) -> f64 {
    let motion: Vec<_> = nodes.iter().map(|p| r * p + t - p).collect();
    let field = Field::new(nodes, &motion, options).unwrap();
    let back = field.inverse().unwrap();
    probes
        .iter()
        .map(|p| {
            let moved = r * p + t;
            let there = (p + field.displacement(p) - moved).norm();
            there.max((moved + back.displacement(&moved) - p).norm())
        })
        .fold(0.0, f64::max)
}

/// Probes on the nodes, beside them and up to 0.3 m away.
fn probes(nodes: &[Point3<f64>], aside: &[Vector3<f64>]) -> Vec<Point3<f64>> {
    let beside = aside.iter().zip(nodes.iter().cycle()).map(|(d, x)| x + d);
    nodes.iter().copied().chain(beside).collect()
}

proptest! {
    /// Any cloud of three nodes or more whose area is not nothing, with any support, even one that leaves nodes alone.
    #[test]
    fn scattered_nodes(
        cloud in proptest::collection::vec(vector(0.1), 3..40), r in rotation(), t in vector(0.3),
        (support, weight) in (support(), weight()), shrinkage in prop_oneof![Just(0.003), Just(0.01), Just(1e-9), Just(1e-12)],
        aside in proptest::collection::vec(vector(0.15), 12),
    ) {
        let nodes: Vec<_> = cloud.iter().map(|v| Point3::from(v + Vector3::new(0.0, 0.0, 0.5))).collect();
        let area = (nodes[1] - nodes[0]).cross(&(nodes[2] - nodes[0])).norm();
        prop_assume!(area > 1e-4);
        let options = FieldOptions::default().with_support(support).with_weight(weight).with_shrinkage(shrinkage);
        prop_assert!(error(&nodes, (&r, &t), &options, &probes(&nodes, &aside)) < PROMISE);
    }

    /// Nodes on a flat or bent sheet, which is what surfaces are.
    #[test]
    fn sheets(
        bend in prop_oneof![Just(0.0), 0.0..20.0_f64], r in rotation(), t in vector(0.3), (support, weight) in (support(), weight()),
        shrinkage in prop_oneof![Just(0.003), Just(1e-7), Just(1e-12)], aside in proptest::collection::vec(vector(0.1), 12),
    ) {
        let nodes: Vec<_> = (0..64)
            .map(|i| (f64::from(i % 8) * 0.01, f64::from(i / 8) * 0.01))
            .map(|(x, y)| Point3::new(x, y, bend * (x * x + y * y) / 2.0))
            .collect();
        let options = FieldOptions::default().with_support(support).with_weight(weight).with_shrinkage(shrinkage);
        prop_assert!(error(&nodes, (&r, &t), &options, &probes(&nodes, &aside)) < PROMISE);
    }

    /// Three nodes as near to a line as a thousandth to all of their length: the roll comes from the offset alone. The offset is
    /// 10 µm at least, and coordinates round to 1e-16: 1e-11 of a lever of 0.1 m.
    #[test]
    fn needles(
        offset in 1e-5..0.01_f64, r in rotation(), t in vector(0.3), tilt in rotation(), (support, weight) in (support(), weight()),
        aside in proptest::collection::vec(vector(0.05), 12),
    ) {
        let nodes: Vec<_> = [(0.0, 0.0), (0.01, 0.0), (0.017, offset)]
            .iter()
            .map(|&(x, y)| tilt * Point3::new(x, y, 0.0) + Vector3::new(0.0, 0.0, 0.3))
            .collect();
        let options = FieldOptions::default().with_support(support).with_weight(weight);
        prop_assert!(error(&nodes, (&r, &t), &options, &probes(&nodes, &aside)) < PROMISE);
    }

    /// Ropes that turn a corner: most nodes see a line, the corner tells them their roll. The far end of one arm, 0.2 m from the corner,
    /// has it from there.
    #[test]
    fn corners(
        r in rotation(), t in vector(0.3), arm in 2_u32..20, (support, weight) in (support(), weight()),
        aside in proptest::collection::vec(vector(0.05), 12),
    ) {
        let along = |axis: Vector3<f64>| (1..=arm).map(move |k| Point3::from(axis * 0.01 * f64::from(k)));
        let nodes: Vec<_> = std::iter::once(Point3::origin())
            .chain(along(Vector3::x()))
            .chain(along(Vector3::y()))
            .collect();
        let options = FieldOptions::default().with_support(support).with_weight(weight);
        prop_assert!(error(&nodes, (&r, &t), &options, &probes(&nodes, &aside)) < PROMISE);
    }
}

/// Half turns about every axis, at every height over one triangle.
#[test]
fn three_nodes_carry_a_half_turn() {
    let nodes = [
        Point3::new(0.0, 0.0, 0.4),
        Point3::new(0.01, 0.0, 0.4),
        Point3::new(0.0, 0.01, 0.4),
    ];
    for axis in [
        Vector3::x(),
        Vector3::y(),
        Vector3::z(),
        Vector3::new(0.6, 0.0, 0.8),
    ] {
        let half = Rotation3::new(axis * std::f64::consts::PI);
        let heights: Vec<_> = (-5..=5)
            .map(|k| Point3::new(0.003, 0.003, 0.4 + 0.02 * f64::from(k)))
            .collect();
        let off = error(
            &nodes,
            (&half, &Vector3::x()),
            &FieldOptions::default(),
            &heights,
        );
        assert!(off < PROMISE, "{axis}: {off}");
    }
}

/// A node out of reach of all others rotates with the rest, and is reported as undetermined.
#[test]
fn a_lonely_node_turns_with_its_neighbours() {
    let mut nodes: Vec<_> = (0..36)
        .map(|i| Point3::new(f64::from(i % 6), f64::from(i / 6), 0.0) * 0.01)
        .collect();
    nodes.push(Point3::new(0.2, 0.0, 0.0));
    let turn = Rotation3::new(Vector3::new(0.0, 1.3, 0.4));
    let motion: Vec<_> = nodes.iter().map(|p| turn * p - p).collect();
    let options = FieldOptions::default().with_support(Support::Radius(0.023));
    let field = Field::new(&nodes, &motion, &options).unwrap();
    let p = Point3::new(0.2, 0.01, 0.005);
    let sample = field.evaluate(&p);
    assert!((p + sample.displacement - turn * p).norm() < PROMISE);
    assert_eq!(sample.determinacy, Determinacy::Undetermined);
    assert_eq!(field.node_determinacy()[36], Determinacy::Undetermined);
}

/// Offsets from a line that are noise do not roll what lies beside it: a rod of nodes, 100 mm long and 0.1 mm thick by noise that is
/// drawn afresh in the moved nodes, stays near where the least rotation puts it.
#[test]
fn noise_is_not_taken_for_a_roll() {
    let mut state = 1_u64;
    let mut noise = || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        ((state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5) * 2e-4
    };
    let (mut mean, rods) = (0.0, 50);
    for _ in 0..rods {
        let nodes: Vec<_> = (0..20)
            .map(|k| Point3::new(0.005 * f64::from(k), noise(), noise()))
            .collect();
        let motion: Vec<_> = nodes
            .iter()
            .map(|p| Vector3::new(0.0, noise() - p.y, noise() - p.z))
            .collect();
        let field = Field::new(&nodes, &motion, &FieldOptions::default()).unwrap();
        mean += field.displacement(&Point3::new(0.05, 0.02, 0.0)).norm() / f64::from(rods);
    }
    // Rolls drawn blindly would move a point 20 mm aside by 4/π times as much on average.
    assert!(mean < 0.002, "{mean}");
}
