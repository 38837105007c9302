//! A frame that fails leaves the model as it was before it: the following results are bit for bit as if it had not arrived.
#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "tests"
)]

mod common;

use common::fake::FakeCell;
use explore_loop::canonical::CanonicalModel;
use explore_loop::cell::{Cell, Observation};
use explore_loop::reconstruct::{ReconstructOptions, Reconstructor};
use nalgebra::{Isometry3, Point3, Translation3, Vector3};

const SPACING: f64 = 0.008;
/// Frames before the one that fails, and after it.
const BEFORE: usize = 12;
const AFTER: usize = 8;

/// Looked at for four frames, held at both ends, lifted by 2 mm a frame.
fn film() -> (Vec<Observation>, FakeCell) {
    let mut cell = FakeCell::new(2);
    let mut frames: Vec<Observation> = (0..4).map(|_| cell.observe().unwrap()).collect();
    let middle = cell.middle();
    let grip = |side: f64, up: f64| {
        let at = middle.coords + Vector3::new(side * 0.055, 0.0, -up);
        Isometry3::from(Translation3::from(at))
    };
    for (arm, side) in [1.0, -1.0].into_iter().enumerate() {
        cell.move_arm(arm, grip(side, 0.0), 100.0).unwrap();
    }
    frames.push(cell.observe().unwrap());
    for arm in 0..2 {
        cell.close_jaw(arm).unwrap();
    }
    for k in 0..BEFORE + AFTER - 5 {
        for (arm, side) in [1.0, -1.0].into_iter().enumerate() {
            cell.move_arm(arm, grip(side, 0.002 * k as f64), 100.0)
                .unwrap();
        }
        frames.push(cell.observe().unwrap());
    }
    (frames, cell)
}

fn same(a: &CanonicalModel, b: &CanonicalModel) -> bool {
    a.ids() == b.ids()
        && a.rest() == b.rest()
        && a.rest_normals() == b.rest_normals()
        && a.live() == b.live()
        && a.rotations() == b.rotations()
        && a.edges() == b.edges()
        && a.born() == b.born()
        && a.last_seen() == b.last_seen()
        && a.times_seen() == b.times_seen()
}

/// Frames that no reconstruction can use, made of a good one.
fn bad(good: &Observation) -> Vec<(&'static str, Observation)> {
    let with_points = |points: Vec<Point3<f64>>| Observation {
        points,
        ..good.clone()
    };
    let with_pose = |x: f64| {
        let mut frame = good.clone();
        frame.arms[0].camera_from_tip.translation.x = x;
        frame
    };
    let all = |p: Point3<f64>| vec![p; good.points.len()];
    let mut some = good.points.clone();
    some.iter_mut().step_by(3).for_each(|p| p.z = f64::NAN);
    let mut huge = good.points.clone();
    huge.iter_mut().step_by(3).for_each(|p| p.x = 1e200);
    vec![
        ("no points", with_points(Vec::new())),
        (
            "NaN points",
            with_points(all(Point3::new(0.0, f64::NAN, 0.5))),
        ),
        ("some NaN points", with_points(some)),
        (
            "infinite points",
            with_points(all(Point3::new(0.0, 0.0, f64::INFINITY))),
        ),
        ("huge points", with_points(huge)),
        ("NaN pose", with_pose(f64::NAN)),
        ("infinite pose", with_pose(f64::INFINITY)),
        ("huge pose", with_pose(1e200)),
    ]
}

#[test]
fn a_frame_that_fails_changes_nothing() {
    let (frames, cell) = film();
    let table = cell.info().table;
    let reconstructor = || Reconstructor::new(ReconstructOptions::new(SPACING)).unwrap();
    let mut plain = reconstructor();
    for frame in &frames {
        plain.process(frame, &table).unwrap();
    }
    let mut failed = 0;
    for (name, frame) in bad(&frames[BEFORE]) {
        let mut disturbed = reconstructor();
        for frame in &frames[..BEFORE] {
            disturbed.process(frame, &table).unwrap();
        }
        let before = disturbed.model().clone();
        let result = disturbed.process(&frame, &table);
        let unused = match &result {
            Err(error) => format!("refused: {error}"),
            Ok(report) => report.failure.clone().unwrap_or_default(),
        };
        let kept = same(&before, disturbed.model());
        println!("{name}: {unused}; the model stays: {kept}");
        if result.is_err() || disturbed.model().live() == before.live() {
            failed += 1;
            assert!(kept, "{name}: {unused}");
            for frame in &frames[BEFORE..] {
                disturbed.process(frame, &table).unwrap();
            }
            let (a, b) = (disturbed.model(), plain.model());
            // Frame numbers go on; nothing else knows of it.
            assert!(
                a.rest() == b.rest() && a.live() == b.live() && a.ids() == b.ids(),
                "{name}: what comes after differs"
            );
        }
    }
    assert!(failed > 0, "some frame must fail");
}
