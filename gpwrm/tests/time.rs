//! Composition over time, and batches.
#![allow(missing_docs, clippy::unwrap_used)]

use gpwrm::{Error, Field, FieldOptions};
use nalgebra::{Isometry3, Point3, Rotation3, Translation3, UnitQuaternion, UnitVector3, Vector3};
use proptest::prelude::*;

fn vector(size: f64) -> impl Strategy<Value = Vector3<f64>> {
    let c = -size..size;
    (c.clone(), c.clone(), c).prop_map(|(x, y, z)| Vector3::new(x, y, z))
}

/// Nodes 10 mm apart on a saddle.
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

fn field(motion: impl Fn(&Point3<f64>) -> Point3<f64>) -> Field {
    let nodes = saddle();
    let moved: Vec<_> = nodes.iter().map(|p| motion(p) - p).collect();
    Field::new(&nodes, &moved, &FieldOptions::default()).unwrap()
}

/// A sheet that curls up and turns, at time `t`.
fn curl(t: f64) -> impl Fn(&Point3<f64>) -> Point3<f64> {
    let turn = Rotation3::new(Vector3::new(0.8, 0.3, -0.5) * t);
    move |p| turn * (p + Vector3::new(-4.0 * p.x * p.z * t, 0.0, 2.0 * p.x * p.x * t))
}

proptest! {
    /// Rigid motion after rigid motion is their product, exactly, whatever the frames.
    #[test]
    fn rigid_motions_compose(steps in proptest::collection::vec((vector(2.0), vector(0.1)), 1..4), q in vector(0.08)) {
        let mut total = Isometry3::identity();
        let mut track = field(|p| *p);
        for (turn, shift) in steps {
            let step = Isometry3::from_parts(Translation3::from(shift), UnitQuaternion::from_scaled_axis(turn));
            // A field of the frame has nodes of its own, where the sheet stands now.
            let live = track.live_nodes();
            let motion: Vec<_> = live.iter().map(|y| step * y - y).collect();
            let frame = Field::new(&live, &motion, &FieldOptions::default()).unwrap();
            track = track.then(&frame).unwrap();
            total = step * total;
        }
        let p = Point3::from(q);
        prop_assert!((p + track.displacement(&p) - total * p).norm() < 1e-9);
        let back = track.inverse().unwrap();
        let moved = total * p;
        prop_assert!((moved + back.displacement(&moved) - p).norm() < 1e-9);
    }

    /// At every node, `then` is one field after the other; so is `advance`.
    #[test]
    fn nodes_go_one_field_after_the_other(a in vector(1.0), b in vector(1.0)) {
        let first = field(|p| Rotation3::new(a) * p);
        let second = field(|p| p + Vector3::new(p.z, b.x * p.x * p.x, b.y * p.y));
        let both = first.then(&second).unwrap();
        let motion = second.displacements(&first.live_nodes());
        let advanced = first.advance(&motion).unwrap();
        prop_assert_eq!(both.node_displacements(), advanced.node_displacements());
        for (k, x) in both.nodes().iter().enumerate() {
            let y = x + first.node_displacements()[k];
            prop_assert!((both.live_nodes()[k] - (y + second.displacement(&y))).norm() < 1e-12);
        }
        prop_assert_eq!(first.nodes(), both.nodes());
    }

    /// Threads and batches change no bit: every batch against one point at a time.
    #[test]
    fn batches_are_the_single_answers(turn in vector(1.5), cloud in proptest::collection::vec(vector(0.1), 1..600)) {
        let field = field(|p| Rotation3::new(turn) * (p + Vector3::new(0.0, 0.0, 4.0 * p.x * p.y)));
        let points: Vec<Point3<f64>> = cloud.iter().map(|v| Point3::from(*v)).collect();
        let normals: Vec<_> = cloud.iter().map(|v| UnitVector3::new_normalize(v + Vector3::z())).collect();
        let bits = |v: &Vector3<f64>| v.map(f64::to_bits);
        let (samples, moves, warped) = (field.evaluate_all(&points), field.displacements(&points), field.warp(&points));
        let turned = field.warp_normals(&points, &normals).unwrap();
        for (k, p) in points.iter().enumerate() {
            let one = field.evaluate(p);
            prop_assert_eq!(bits(&one.displacement), bits(&samples[k].displacement));
            prop_assert_eq!(one.gradient.map(f64::to_bits), samples[k].gradient.map(f64::to_bits));
            prop_assert_eq!((one.determinacy, one.extrapolated), (samples[k].determinacy, samples[k].extrapolated));
            prop_assert_eq!(bits(&field.displacement(p)), bits(&moves[k]));
            prop_assert_eq!(bits(&(p + moves[k]).coords), bits(&warped[k].coords));
            let alone = field.warp_normals(&[*p], &[normals[k]]).unwrap()[0];
            prop_assert_eq!(bits(&alone), bits(&turned[k]));
        }
    }
}

/// A hundred frames of a curl, there and back: what lies between the nodes is where one step from rest would put it, and comes home
/// with the nodes. Fields chained point by point keep what each of them was off.
#[test]
fn the_way_does_not_matter() {
    let nodes = saddle();
    let rest: Vec<Point3<f64>> = (0..49)
        .map(|k| {
            (
                f64::from(k % 7) * 0.01 - 0.0312,
                f64::from(k / 7) * 0.01 - 0.0287,
            )
        })
        .map(|(x, y)| Point3::new(x, y, 2.0 * (x * x - y * y)))
        .collect();
    let worst = |found: &[Point3<f64>], truth: &[Point3<f64>]| {
        let off = found.iter().zip(truth).map(|(q, p)| (q - p).norm());
        off.fold(0.0, f64::max)
    };
    let mut track = field(|p| *p);
    let mut chained = rest.clone();
    for k in 1..=100 {
        let now = curl(1.0 - (f64::from(k) / 50.0 - 1.0).abs());
        let live = track.live_nodes();
        let motion: Vec<_> = nodes.iter().zip(&live).map(|(x, y)| now(x) - y).collect();
        let frame = Field::new(&live, &motion, &FieldOptions::default()).unwrap();
        chained = frame.warp(&chained);
        track = track.advance(&motion).unwrap();
        // The nodes gather a hundred roundings of 1e-17 m.
        let direct = field(&now).warp(&rest);
        assert!(worst(&track.warp(&rest), &direct) < 1e-12, "{k}");
    }
    assert!(worst(&track.warp(&rest), &rest) < 1e-12);
    let left = worst(&chained, &rest);
    assert!(left > 1e-9, "{left}");
}

#[test]
fn wrong_motions_are_named() {
    let track = field(|p| *p);
    assert!(matches!(
        track.advance(&[Vector3::zeros(); 3]),
        Err(Error::LengthMismatch {
            expected: 144,
            found: 3,
            ..
        })
    ));
    let mut motion = vec![Vector3::zeros(); 144];
    motion[7].y = f64::NAN;
    assert!(matches!(
        track.advance(&motion),
        Err(Error::BadCoordinate { index: 7, .. })
    ));
    assert!(matches!(
        track.warp_normals(&[Point3::origin()], &[]),
        Err(Error::LengthMismatch { .. })
    ));
}

/// Almost half of the nodes leaves the view before the second frame: what is known of them only from nodes elsewhere is said to be so, however the fields
/// are composed further.
#[test]
fn what_one_field_extrapolates_stays_extrapolated() {
    let nodes = saddle();
    let seen: Vec<Point3<f64>> = nodes.iter().copied().filter(|p| p.x < 0.0075).collect();
    let shift = |points: &[Point3<f64>], by: f64| {
        let moved = vec![Vector3::x() * by; points.len()];
        Field::new(points, &moved, &FieldOptions::default()).unwrap()
    };
    let (first, second) = (shift(&nodes, 0.0), shift(&seen, 0.001));
    let moved: Vec<Point3<f64>> = second.live_nodes();
    let third = shift(&moved, 0.001);
    let both = first.then(&second).unwrap();
    let all = both.then(&third).unwrap();
    let advanced = both.advance(&vec![Vector3::zeros(); nodes.len()]).unwrap();
    for composed in [&both, &all, &advanced] {
        for p in &nodes {
            let sample = composed.evaluate(p);
            if p.x > 0.04 {
                // A node at a corner reaches far.
                assert!(sample.extrapolated || p.x < 0.05, "{p}");
                assert!(sample.extrapolation > 0.03, "{p}");
            } else if p.x < 0.0 {
                assert!(!sample.extrapolated, "{p}");
            }
        }
    }
    let back = both.inverse().unwrap();
    assert!(back.evaluate(&Point3::new(0.056, 0.0, 0.006)).extrapolated);
    // Nothing is said against a field that was given.
    assert!(nodes.iter().all(|p| !first.evaluate(p).extrapolated));
}
