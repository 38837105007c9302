//! Motions from the present poses of the tips: straight, checked, timed, and an error if there is none.
#![allow(missing_docs, clippy::unwrap_used, clippy::panic, reason = "tests")]

mod fixture;

use std::sync::Arc;

use grip_planner::nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use grip_planner::{
    CarryOptions, Error, Motion, ReachOptions, Refusal, Role, Scene, Stage, Tip, Workspace, carry,
    go_home, lower, put_down,
};
use proptest::prelude::*;

/// Two tips, apart, somewhere above the table, that point down and come from their own sides.
fn tips(place: [f64; 3], apart: f64) -> [Tip; 2] {
    [0usize, 1].map(|arm| {
        let side = if arm == 0 { 0.5 } else { -0.5 };
        let at = Vector3::new(place[0] + side * apart, place[1], fixture::DEPTH - place[2]);
        Tip {
            arm,
            role: Role::Lift,
            camera_from_tip: Isometry3::from(Translation3::from(at)),
        }
    })
}

fn height(scene: &Scene, pose: &Isometry3<f64>) -> f64 {
    scene.table.height(&Point3::from(pose.translation.vector))
}

/// Speed and growth of the velocity of every tip, seen at a camera's frames.
fn keeps_its_pace(motion: &Motion, speed: f64) -> Result<(), TestCaseError> {
    for path in &motion.arms {
        prop_assert!(path.peak_speed() <= speed * (1.0 + 1e-9));
    }
    Ok(())
}

proptest! {
    #[test]
    fn what_is_held_is_lowered_along_the_normal(x in -0.05..0.05, y in -0.05..0.05, h in 0.005..0.15, apart in 0.06..0.12, speed in 0.005..0.05) {
        let arms = fixture::arms(2);
        let scene = fixture::scene(&arms);
        let options = CarryOptions::default().with_speed(speed);
        let held = tips([x, y, h], apart);
        let motion = lower(&scene, &held, &options).unwrap();
        keeps_its_pace(&motion, speed)?;
        for (tip, path) in held.iter().zip(&motion.arms) {
            prop_assert_eq!(path.at(0.0).unwrap(), tip.camera_from_tip);
            let end = path.at(motion.duration).unwrap();
            // A tip that is lower already stays.
            prop_assert!((height(&scene, &end) - options.release_height.min(h)).abs() < 1e-9);
            prop_assert!((end.translation.vector - tip.camera_from_tip.translation.vector).xy().norm() < 1e-9);
            prop_assert!(path.keyframes.windows(2).all(|w| height(&scene, &w[1].camera_from_tip) <= height(&scene, &w[0].camera_from_tip) + 1e-12));
        }
    }

    #[test]
    fn empty_tips_go_home_from_anywhere(x in -0.05..0.05, y in -0.05..0.05, h in 0.01..0.15, apart in 0.06..0.12) {
        let arms = fixture::arms(2);
        let scene = fixture::scene(&arms);
        let options = ReachOptions::default();
        let motion = go_home(&[], &scene, &tips([x, y, h], apart), 0.05, &options).unwrap();
        keeps_its_pace(&motion, options.speed)?;
        for path in &motion.arms {
            let end = path.at(motion.duration).unwrap();
            prop_assert!((end.translation.vector - arms[path.arm].home.translation.vector).norm() < 1e-9);
            prop_assert!(path.release.abs() < 1e-12);
        }
        prop_assert_eq!(motion.stage_at(0.0), Stage::Withdraw);
    }

    /// No tip turns a corner faster than it creeps: sampled finely, velocities change by no more than two creeps beyond the acceleration.
    #[test]
    fn corners_are_passed_slowly(x in -0.05..0.05, y in -0.05..0.05, h in 0.01..0.15, apart in 0.06..0.12) {
        let arms = fixture::arms(2);
        let scene = fixture::scene(&arms);
        let options = ReachOptions::default();
        let motion = go_home(&[], &scene, &tips([x, y, h], apart), 0.05, &options).unwrap();
        let period = 0.02;
        for path in &motion.arms {
            let at = |k: f64| path.at(k * period).unwrap().translation.vector;
            for k in 1..(motion.duration / period) as usize {
                let k = k as f64;
                let [before, after] = [(at(k) - at(k - 1.0)) / period, (at(k + 1.0) - at(k)) / period];
                // Way points are 10 mm apart; within one the speed is constant: √(v² + 2 a·10 mm) − v ≤ √(2 a·10 mm) from rest.
                let step = (2.0 * options.acceleration * 0.01).sqrt();
                prop_assert!((after - before).norm() <= step + 0.2 * options.speed + 1e-9, "{} at {}", (after - before).norm(), k * period);
            }
        }
    }
}

/// A tool that lies level and whose joints end where it would back off goes up instead; where they do not allow that either, it rotates where it
/// is; where nothing is allowed, the reason is that of backing off.
#[test]
fn a_tool_that_cannot_back_off_goes_up() {
    let here = Isometry3::from_parts(
        Translation3::new(0.03, 0.0, fixture::DEPTH - 0.06),
        UnitQuaternion::from_axis_angle(&Vector3::y_axis(), -std::f64::consts::FRAC_PI_2),
    );
    let tip = Tip {
        arm: 0,
        role: Role::Lift,
        camera_from_tip: here,
    };
    let options = ReachOptions::default();
    let going = |level: fn(Vector3<f64>) -> bool, upright: fn(Vector3<f64>) -> bool| {
        let mut arms = fixture::arms(1);
        arms[0].workspace = Workspace::Custom(Arc::new(move |pose: &Isometry3<f64>| {
            let at = pose.translation.vector;
            if (pose.rotation * Vector3::z()).z < 0.7 {
                level(at)
            } else {
                upright(at)
            }
        }));
        go_home(&[], &fixture::scene(&arms), &[tip], 0.05, &options)
    };
    let early = |motion: &Motion| motion.arms[0].at(0.25 * motion.duration).unwrap();
    let up = going(|at| at.x < 0.035, |_| true).unwrap();
    assert!(early(&up).translation.z < here.translation.z - 0.02);
    let there = |at: Vector3<f64>| at.x < 0.035 && at.z > fixture::DEPTH - 0.065;
    assert!(going(there, |_| true).is_ok());
    let stuck = going(there, |at| at.x > 0.1);
    let position = match stuck {
        Err(Refusal::OutOfWorkspace { position, .. }) => position,
        other => panic!("{other:?}"),
    };
    assert!(position[0] > 0.035 || position[2] < fixture::DEPTH - 0.065);
}

#[test]
fn ways_that_cannot_be_gone_are_refused_with_the_reason() {
    let arms = fixture::arms(2);
    let scene = fixture::scene(&arms);
    let held = tips([0.0, 0.0, 0.1], 0.1);
    let goals = |shift: [Vector3<f64>; 2]| -> Vec<Isometry3<f64>> {
        held.iter()
            .zip(shift)
            .map(|(t, s)| Translation3::from(s) * t.camera_from_tip)
            .collect()
    };
    let options = CarryOptions::default();
    let go = |shift, body: &[Point3<f64>]| carry(body, &scene, &held, &goals(shift), &options);
    let down = Vector3::z() * 0.2;
    assert!(matches!(
        go([down, down], &[]),
        Err(Refusal::HitsTable { .. })
    ));
    let far = Vector3::y() * 0.7;
    assert!(matches!(
        go([far, far], &[]),
        Err(Refusal::OutOfWorkspace { .. })
    ));
    let meet = Vector3::x() * 0.05;
    assert!(matches!(
        go([-meet, meet], &[]),
        Err(Refusal::ArmsCollide { .. })
    ));
    // What stands in the way of the shaft, and does not go along with the other tip either.
    let wall: Vec<Point3<f64>> = (0..40)
        .map(|k| Point3::new(0.05, 0.0, 0.36 - 0.001 * f64::from(k)))
        .collect();
    let side = Vector3::y() * 0.02;
    assert!(matches!(
        go([side, side], &wall),
        Err(Refusal::HitsBody { .. })
    ));
}

#[test]
fn input_that_cannot_be_used_is_named() {
    let arms = fixture::arms(2);
    let scene = fixture::scene(&arms);
    let options = CarryOptions::default();
    let held = tips([0.0, 0.0, 0.1], 0.1);
    let goals = held.map(|t| t.camera_from_tip);
    let input = |result: Result<Motion, Refusal>| match result {
        Err(Refusal::Input(error)) => error,
        other => panic!("{other:?}"),
    };
    assert!(matches!(
        input(carry(&[], &scene, &held, &goals[..1], &options)),
        Error::LengthMismatch { count: 1, .. }
    ));
    let nan = [Point3::new(0.0, f64::NAN, 0.0)];
    assert!(matches!(
        input(carry(&nan, &scene, &held, &goals, &options)),
        Error::NonFinitePoint { index: 0, .. }
    ));
    let twice = [held[0], held[0]];
    assert!(matches!(
        input(lower(&scene, &twice, &options)),
        Error::BadArm { arm: 0, .. }
    ));
    let mut none = held;
    none[1].arm = 7;
    assert!(matches!(
        input(lower(&scene, &none, &options)),
        Error::BadArm { arm: 7, .. }
    ));
    let mut nowhere = held;
    nowhere[1].camera_from_tip.translation.x = f64::INFINITY;
    assert!(matches!(
        input(lower(&scene, &nowhere, &options)),
        Error::BadArm { arm: 1, .. }
    ));
    for speed in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let options = options.with_speed(speed);
        assert!(matches!(
            input(lower(&scene, &held, &options)),
            Error::BadSetting { .. }
        ));
    }
    assert!(matches!(
        input(go_home(
            &[],
            &scene,
            &held,
            f64::NAN,
            &ReachOptions::default()
        )),
        Error::BadSetting { .. }
    ));
    // Nothing to move is no motion.
    assert!(lower(&scene, &[], &options).unwrap().arms.is_empty());
}

/// An interrupted motion goes back while it lifts and forward while it lowers; the two halves are the motion.
#[test]
fn a_motion_that_is_given_up_is_put_down_along_itself() {
    let body = fixture::usual(1500);
    let arms = fixture::arms(3);
    let scene = fixture::scene(&arms);
    let options = grip_planner::PlanOptions::default();
    let action = grip_planner::Action::TurnOver;
    let plan = grip_planner::plan(&body.model(), &scene, action, &options).unwrap();
    let motion = &plan.motion;
    let quarter = motion.legs[0].until;
    for share in [0.0, 0.1, 0.35, 0.5, 0.8, 1.0] {
        let time = share * motion.duration;
        let down = put_down(&scene, motion, time).unwrap();
        let lifts = time <= quarter;
        let end = if lifts { 0.0 } else { motion.duration };
        for path in &down.arms {
            let whole = motion.arms.iter().find(|p| p.arm == path.arm).unwrap();
            let same = |a: Isometry3<f64>, b: Isometry3<f64>| {
                (a.translation.vector - b.translation.vector).norm() < 1e-9
                    && a.rotation.angle_to(&b.rotation) < 1e-6
            };
            assert!(same(path.at(0.0).unwrap(), whole.at(time).unwrap()));
            assert!(same(
                path.at(down.duration).unwrap(),
                whole.at(end).unwrap()
            ));
            for k in 0..=20 {
                let t = down.duration * f64::from(k) / 20.0;
                let on = if lifts { time - t } else { time + t };
                assert!(
                    same(path.at(t).unwrap(), whole.at(on).unwrap()),
                    "{share} {k}"
                );
            }
        }
        // An arm that has let go is left where it is.
        let gone = motion
            .arms
            .iter()
            .filter(|p| p.role == Role::Support && p.release <= time);
        assert_eq!(down.arms.len(), motion.arms.len() - gone.count());
    }
    assert!(matches!(
        put_down(&scene, motion, f64::NAN),
        Err(Refusal::Input(_))
    ));
}
