//! Vector area, agent box and turns.
#![allow(missing_docs, clippy::unwrap_used, reason = "tests")]

mod fixture;

use std::f64::consts::PI;

use fixture::Body;
use grip_planner::nalgebra::{
    Isometry3, Point3, Translation3, UnitQuaternion, UnitVector3, Vector3,
};
use grip_planner::{Model, Plane, Scene, Turn, agent_box, missing_vector_area, turns};
use proptest::prelude::*;

fn plane() -> impl Strategy<Value = Plane> {
    (prop::array::uniform3(-1.0..1.0), -1.0..1.0).prop_filter_map("a direction", |(n, offset)| {
        Some(Plane {
            normal: UnitVector3::try_new(Vector3::from(n), 0.1)?,
            offset,
        })
    })
}

fn cloud() -> impl Strategy<Value = Vec<Point3<f64>>> {
    prop::collection::vec(
        prop::array::uniform3(-1.0..1.0).prop_map(Point3::from),
        1..40,
    )
}

/// Least footprint by trying every pair of points as a side: needs no hull.
fn least_footprint(points: &[Point3<f64>], table: &Plane) -> f64 {
    let mut least = f64::INFINITY;
    for a in points {
        for b in points {
            let Some(u) = UnitVector3::try_new(table.along(&(b - a)), 1e-9) else {
                continue;
            };
            let v = table.normal.cross(&u);
            let width = |d: &Vector3<f64>| {
                let at = points.iter().map(|p| d.dot(&p.coords));
                at.clone().fold(f64::NEG_INFINITY, f64::max) - at.fold(f64::INFINITY, f64::min)
            };
            least = least.min(width(&u) * width(&v));
        }
    }
    least
}

proptest! {
    #[test]
    fn box_holds_every_point_and_is_the_least(points in cloud(), table in plane()) {
        let b = agent_box(&points, &table).unwrap();
        for p in &points {
            let q = b.local(p).abs();
            prop_assert!((0..3).all(|k| q[k] <= b.half_extents[k] + 1e-12));
        }
        prop_assert!(b.half_extents.x >= b.half_extents.y);
        prop_assert!((b.axes[0].cross(&b.axes[1]) - b.axes[2].into_inner()).norm() < 1e-12);
        prop_assert!((b.axes[2].into_inner() - table.normal.into_inner()).norm() < 1e-12);
        let least = least_footprint(&points, &table);
        if least.is_finite() {
            prop_assert!((4.0 * b.half_extents.x * b.half_extents.y - least).abs() < 1e-9);
        }
    }

    #[test]
    fn box_turns_with_the_points(points in cloud(), table in plane(), angle in -3.0..3.0) {
        let spin = UnitQuaternion::from_axis_angle(&table.normal, angle);
        let spun: Vec<_> = points.iter().map(|p| spin * p).collect();
        let (a, b) = (agent_box(&points, &table).unwrap(), agent_box(&spun, &table).unwrap());
        let area = |e: &Vector3<f64>| e.x * e.y;
        // The least area is unique even where the rectangle is not.
        prop_assert!((area(&a.half_extents) - area(&b.half_extents)).abs() < 1e-9);
        prop_assert!((a.half_extents.z - b.half_extents.z).abs() < 1e-12);
    }

    #[test]
    fn nothing_is_missing_from_a_closed_surface(a in 0.05..0.2, b in 0.05..0.2, c in 0.02..0.2, yaw in 0.0..6.0) {
        let body = Body::ellipsoid([a, b, c], 1500, -1.0, yaw);
        let known: f64 = body.areas.iter().sum();
        // The quadrature of 1,500 even samples is good to about 1/n of the area.
        prop_assert!(missing_vector_area(&body.model()).norm() < 2e-3 * known);
    }

    #[test]
    fn what_is_missing_below_a_cut_is_the_cut(lowest in -0.8..0.8, yaw in 0.0..6.0, tilt in prop::array::uniform3(-2.0..2.0)) {
        let mut body = Body::ellipsoid([0.1, 0.1, 0.1], 2000, lowest, yaw);
        let turn = UnitQuaternion::new(Vector3::from(tilt));
        body.normals.iter_mut().for_each(|n| *n = turn * *n);
        // The cap and its disc close a surface; the camera's down is +z.
        let disc = PI * 0.01 * (1.0 - lowest * lowest);
        let expected = turn * Vector3::new(0.0, 0.0, disc);
        // One row of samples more or less at the cut: 4π r²/√n · a share.
        prop_assert!((missing_vector_area(&body.model()) - expected).norm() < 0.04 * disc + 2e-4);
    }

    #[test]
    fn turns_take_the_missing_side_up(yaw in -3.0..3.0, lean in -0.9..0.9) {
        // What is missing faces down and leans toward the long side of the body; so few samples leave the box a few degrees off.
        let mut body = Body::ellipsoid([0.1, 0.06, 0.05], 600, 0.0, yaw);
        let sideways = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw) * Vector3::y();
        body.points.push(body.points[0]);
        body.normals.push(UnitVector3::new_normalize(-sideways));
        body.areas.push(0.02 * f64::abs(lean));
        body.boundary.push(false);
        body.visible.push(false);
        let lean_to = sideways * lean.signum();
        if lean < 0.0 {
            let last = body.normals.len() - 1;
            body.normals[last] = -body.normals[last];
        }
        let arms = fixture::arms(2);
        let best = turns(&body.model(), &fixture::scene(&arms), 0.0).unwrap()[0];
        prop_assert!(best.axis.dot(&sideways).abs() < 0.2);
        if lean.abs() > 0.1 {
            prop_assert!(best.lifted.dot(&lean_to) > 0.9, "{} {:?}", lean, best);
        }
        let up = UnitQuaternion::from_axis_angle(&best.axis, PI / 2.0) * best.lifted;
        prop_assert!((up.into_inner() - best.up.into_inner()).norm() < 1e-9);
    }
}

#[test]
fn a_flat_body_seen_from_above_is_turned_about_its_longer_side() {
    let arms = fixture::arms(2);
    let body = fixture::usual(2000);
    let all = turns(&body.model(), &fixture::scene(&arms), 0.0).unwrap();
    assert!(all[0].axis.x.abs() > 0.999);
    assert!((all[0].angle - PI).abs() < 1e-12);
    assert!((all[0].span - 0.12).abs() < 2e-3 && (all[0].length - 0.2).abs() < 2e-3);
    assert!(all[0].pivot.z > fixture::DEPTH - 1e-12);
    assert!(all[2].gain < 0.7 * all[0].gain);
}

#[test]
fn a_square_sheet_gets_a_box_along_its_sides() {
    // Principal axes are undefined here: the box must still have the area of the square.
    let table = Plane {
        normal: Vector3::z_axis(),
        offset: 0.0,
    };
    let place = Isometry3::from_parts(
        Translation3::new(3.0, -1.0, 0.2),
        UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.6),
    );
    let points: Vec<_> = (0..441)
        .map(|k| place * Point3::new(f64::from(k % 21) / 20.0, f64::from(k / 21) / 20.0, 0.0))
        .collect();
    let b = agent_box(&points, &table).unwrap();
    assert!((b.half_extents - Vector3::new(0.5, 0.5, 0.0)).norm() < 1e-9);
}

#[test]
fn what_is_left_at_the_ends_is_shown_by_a_turn_about_the_shorter_side() {
    // The tips of both ends are hidden, where the normals are level: their vector areas cancel, only the boundary tells.
    let arms = fixture::arms(2);
    let mut body = Body::ellipsoid([0.1, 0.06, 0.025], 4000, -1.0, 0.0);
    for v in 0..body.points.len() {
        let (end, level) = (body.points[v].x.abs(), body.normals[v].z.abs());
        body.boundary[v] = end >= 0.095 && (0.2..0.5).contains(&level);
        if end >= 0.095 && level < 0.2 {
            body.areas[v] = 0.0;
        }
    }
    assert!(missing_vector_area(&body.model()).norm() < 1e-4);
    let best = turns(&body.model(), &fixture::scene(&arms), 0.0).unwrap()[0];
    assert!(best.lifted.x.abs() > 0.999, "{best:?}");
    // With the boundary along the long sides it is the longer side again.
    for v in 0..body.points.len() {
        body.boundary[v] = body.points[v].y.abs() >= 0.05;
    }
    let best = turns(&body.model(), &fixture::scene(&arms), 0.0).unwrap()[0];
    assert!(best.lifted.y.abs() > 0.999, "{best:?}");
}

/// The most of a direction that faces the camera straight above on a way of turns and tilts, by trying a thousand of each.
fn shown(turn: &Turn, d: &Vector3<f64>, tilt: f64) -> [f64; 2] {
    let facing = |d: Vector3<f64>| d.dot(&turn.up);
    let share = |k: i32| f64::from(k) / 1000.0;
    let turned = |angle: f64| UnitQuaternion::from_axis_angle(&turn.axis, angle) * d;
    let tilted = |by: f64| UnitQuaternion::from_axis_angle(&turn.lifted, by) * turned(PI / 2.0);
    let by_turn = (0..=1000).map(|k| facing(turned(share(k) * turn.angle)));
    let by_tilt = (-1000..=1000).map(|k| facing(tilted(share(k) * tilt)));
    [by_turn.fold(-1.0, f64::max), by_tilt.fold(-1.0, f64::max)]
}

proptest! {
    #[test]
    fn a_tilt_is_offered_where_a_turn_leaves_something_edge_on(towards in prop::array::uniform3(-1.0..1.0), tilt in 0.1..1.0) {
        let Some(d) = UnitVector3::try_new(Vector3::from(towards), 0.1) else { return Ok(()) };
        let arms = fixture::arms(2);
        // So far away that it looks straight down.
        let scene = Scene { camera: Point3::new(0.0, 0.0, -1e6), ..fixture::scene(&arms) };
        let body = Body::ellipsoid([0.1, 0.06, 0.025], 2000, -1.0, 0.0);
        let hidden = [1e-3 * d.into_inner()];
        let model = Model { hidden: &hidden, ..body.model() };
        let all = turns(&model, &scene, tilt).unwrap();
        let straight: Vec<_> = all.iter().filter(|t| t.tilt == 0.0).collect();
        prop_assert_eq!(straight.len(), 4);
        for turn in straight {
            let offered = all.iter().find(|t| t.tilt > 0.0 && t.lifted == turn.lifted);
            let [by_turn, by_tilt] = shown(turn, &d, tilt);
            let edge_on = (80f64).to_radians().cos();
            if (by_turn - edge_on).abs() > 0.01 && (by_tilt - edge_on).abs() > 0.01 {
                let wanted = turn.length > turn.span && by_turn < edge_on && by_tilt > edge_on;
                prop_assert_eq!(offered.is_some(), wanted, "{} {}", by_turn, by_tilt);
            }
            if let Some(offered) = offered {
                prop_assert!(offered.gain >= turn.gain && offered.tilt > 0.0);
            }
        }
    }
}

#[test]
fn both_ends_are_shown_by_one_turn_with_a_tilt() {
    let arms = fixture::arms(2);
    let body = Body::ellipsoid([0.1, 0.06, 0.025], 4000, -1.0, 0.0);
    let scene = fixture::scene(&arms);
    let hidden = [1.0, -1.0].map(|x| Vector3::new(2e-4 * x, 0.0, 0.0));
    let model = Model {
        hidden: &hidden,
        ..body.model()
    };
    let tilt = 30f64.to_radians();
    let best = turns(&model, &scene, tilt).unwrap()[0];
    assert!(best.tilt > 0.0 && best.lifted.y.abs() > 0.999, "{best:?}");
    // Without a tilt it has to stand on one end and then on the other.
    let best = turns(&model, &scene, 0.0).unwrap()[0];
    assert!(best.tilt == 0.0 && best.lifted.x.abs() > 0.999, "{best:?}");
    // Where only the underside is missing nothing is tilted.
    let usual = fixture::usual(2000);
    let all = turns(&usual.model(), &scene, tilt).unwrap();
    assert!(all.iter().all(|t| t.tilt == 0.0) && all.len() == 4);
    for bad in [-0.1, f64::NAN, 1.1] {
        let refused = turns(&model, &scene, bad).unwrap_err();
        assert!(refused.to_string().contains("tilt"), "{refused}");
    }
}

#[test]
fn the_pieces_known_to_be_hidden_decide_and_their_end_is_lifted() {
    // A small hole at one end; its boundary, on the flank all round it, faces any way but along the body.
    let arms = fixture::arms(2);
    let mut body = Body::ellipsoid([0.1, 0.06, 0.025], 4000, -1.0, 0.0);
    for v in 0..body.points.len() {
        body.boundary[v] = (0.07..0.08).contains(&body.points[v].x);
    }
    let scene = fixture::scene(&arms);
    for end in [Vector3::x(), -Vector3::x()] {
        let hidden = [0.3, -0.3, 0.0].map(|z| 1e-5 * Vector3::new(end.x, 0.0, z));
        let model = Model {
            hidden: &hidden,
            ..body.model()
        };
        let best = turns(&model, &scene, 0.0).unwrap()[0];
        assert!(best.lifted.dot(&end) > 0.999, "{best:?}");
    }
    let guessed = turns(&body.model(), &scene, 0.0).unwrap()[0];
    assert!(guessed.lifted.y.abs() > 0.999, "without them: {guessed:?}");
    let hidden = [Vector3::new(0.0, f64::NAN, 0.0)];
    let model = Model {
        hidden: &hidden,
        ..body.model()
    };
    let refused = turns(&model, &scene, 0.0).unwrap_err();
    assert!(refused.to_string().contains("hidden piece 0"), "{refused}");
}
