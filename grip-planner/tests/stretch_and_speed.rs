//! Opening of a hole, and its speed.
#![allow(missing_docs, clippy::unwrap_used, clippy::panic, reason = "tests")]

mod fixture;

use fixture::Body;
use grip_planner::nalgebra::{UnitVector3, Vector3};
use grip_planner::{
    Action, Coverage, CoverageOptions, Error, GovernorOptions, PlanOptions, Refusal, Role,
    SpeedGovernor, Stage, StretchOptions, plan, speed_limit,
};
use proptest::prelude::*;

/// The usual body with a slit on top, along `angle` from the camera's x axis: its boundary in order, and the body without the inside.
fn slit(angle: f64) -> (Body, Vec<u32>) {
    let body = fixture::usual(3000);
    let (sin, cos) = angle.sin_cos();
    let gauge = |v: usize| {
        let p = body.points[v];
        let (along, across) = (p.x * cos + p.y * sin, p.y * cos - p.x * sin);
        (along / 0.03).hypot(across / 0.012)
    };
    let on_rim = |v: &u32| {
        body.points[*v as usize].z < fixture::DEPTH - 0.03
            && (1.0..1.25).contains(&gauge(*v as usize))
    };
    let mut rim: Vec<u32> = (0..body.points.len() as u32).filter(on_rim).collect();
    rim.sort_by(|a, b| {
        let at = |v: &u32| body.points[*v as usize].y.atan2(body.points[*v as usize].x);
        at(a).total_cmp(&at(b))
    });
    let mut open = body.clone();
    open.edges.retain(|e| {
        e.iter()
            .all(|&v| gauge(v as usize) >= 1.0 || body.points[v as usize].z > fixture::DEPTH - 0.03)
    });
    for &v in &rim {
        open.boundary[v as usize] = true;
    }
    (open, rim)
}

proptest! {
    #![proptest_config(ProptestConfig { max_shrink_iters: 10, ..ProptestConfig::with_cases(16) })]

    #[test]
    fn a_slit_is_pulled_apart_across_its_long_axis(angle in 0.0..3.1, distance in 0.005..0.06, lift in 0.0..0.03) {
        let (body, rim) = slit(angle);
        let arms = fixture::arms(3);
        let scene = fixture::scene(&arms);
        let stretch = StretchOptions::default().with_distance(distance).with_lift(lift);
        let options = PlanOptions::default().with_stretch(stretch);
        let done = match plan(&body.model(), &scene, Action::Stretch { hole: &rim }, &options) {
            Ok(done) => done,
            // Two tools that cannot stand this close together is an honest answer, for every pair that was tried.
            Err(Refusal::AllRefused { refused }) => {
                let room = |r: &grip_planner::RefusedSet| matches!(r.reason, Refusal::ArmsCollide { .. } | Refusal::HitsBody { .. });
                prop_assert!(refused.iter().all(room));
                return Ok(());
            }
            Err(other) => return Err(TestCaseError::fail(other.to_string())),
        };
        let (across, motion) = (done.across.unwrap(), &done.motion);
        let long = Vector3::new(angle.cos(), angle.sin(), 0.0);
        prop_assert!(across.dot(&long).abs() < 0.15);
        let side = |k: usize| across.dot(&done.grips[k].tip().coords);
        prop_assert!(side(0) < side(1));
        let tip = |arm: usize, time: f64| motion.arms[arm].at(time).unwrap().translation.vector;
        let gap = |time: f64| across.dot(&(tip(1, time) - tip(0, time)));
        let height = |time: f64| fixture::DEPTH - tip(0, time).z;
        let widest = (0..200).map(|k| gap(motion.duration * f64::from(k) / 199.0)).fold(0.0, f64::max);
        prop_assert!((widest - gap(0.0) - distance).abs() < 1e-9);
        prop_assert!((gap(motion.duration) - gap(0.0) - 0.5 * distance).abs() < 1e-9);
        prop_assert!((height(motion.duration) - height(0.0)).abs() < 1e-9);
        prop_assert!(motion.peak_speed() <= stretch.speed * (1.0 + 1e-9));
        let stages: Vec<Stage> = motion.legs.iter().map(|l| l.stage).collect();
        prop_assert_eq!(stages, [Stage::Pull, Stage::Hold, Stage::Ease]);
        for (grip, path) in done.grips.iter().zip(&motion.arms) {
            // Whoever pins the body stays where it is.
            let moved = path.at(0.5 * motion.duration).unwrap().translation.vector - grip.tip().coords;
            prop_assert_eq!(grip.role == Role::Support, moved.norm() < 1e-12);
        }
    }

    #[test]
    fn a_hole_opens_while_the_body_is_turned(angle in 1.2..1.9, distance in 0.01..0.04) {
        // The slit lies across the longer side, which the body is turned about: the grips part on both sides of it.
        let (body, rim) = slit(angle);
        let arms = fixture::arms(3);
        let scene = fixture::scene(&arms);
        let stretch = StretchOptions::default().with_distance(distance);
        let options = PlanOptions::default().with_stretch(stretch);
        let done = plan(&body.model(), &scene, Action::TurnAndStretch { hole: &rim }, &options).unwrap();
        let (turn, across) = (done.turn.unwrap(), done.across.unwrap());
        prop_assert!(turn.axis.dot(&across).abs() > 0.9);
        let middle = rim.iter().map(|&v| body.points[v as usize].coords).sum::<Vector3<f64>>() / rim.len() as f64;
        let side = |k: usize| across.dot(&(done.grips[k].tip().coords - middle));
        prop_assert!(side(0) * side(1) < 0.0);
        let tip = |arm: usize, time: f64| done.motion.arms[arm].at(time).unwrap().translation.vector;
        let apart = |time: f64| turn.axis.dot(&(tip(0, time) - tip(1, time))).abs();
        prop_assert!((apart(done.motion.duration) - apart(0.0) - distance).abs() < 1e-9);
        // It still ends on the other side.
        let [start, end] = [0.0, done.motion.duration].map(|t| turn.local(&tip(0, t).into()).y / turn.span);
        prop_assert!(start > 0.5 && end < 0.5);
    }

    #[test]
    fn no_node_moves_more_than_allowed_between_frames(pull in prop::array::uniform6(-1.0..1.0), xi in 1e-4..1e-2, rate in 1.0..60.0) {
        let body = fixture::usual(400);
        let arms = fixture::arms(2);
        let coverage = Coverage::new(&body.model(), &fixture::scene(&arms).table, &[5, 150], &CoverageOptions::default()).unwrap();
        let unit = |v: &[f64]| Vector3::new(v[0], v[1], v[2]).normalize();
        let field = coverage.field(&[(5, unit(&pull[..3])), (150, unit(&pull[3..]))]).unwrap();
        let speed = speed_limit(&field, xi, rate).unwrap();
        let moved = field.iter().map(|v| v.norm() * speed / rate).fold(0.0, f64::max);
        prop_assert!((moved - xi).abs() < 1e-12);
    }

    #[test]
    fn the_governor_stays_between_its_bounds(residuals in prop::collection::vec(0.0..0.01, 1..60), dt in 0.01..0.5) {
        let options = GovernorOptions::default();
        let mut governor = SpeedGovernor::new(options).unwrap();
        let mut last = governor.speed();
        for r in residuals {
            let v = governor.next(dt, r);
            prop_assert!(v >= options.least * options.cruise - 1e-15 && v <= options.cruise);
            prop_assert!(v <= last + options.acceleration * dt + 1e-15);
            if r >= options.alarm {
                prop_assert!((v - options.least * options.cruise).abs() < 1e-15);
            }
            last = v;
        }
    }
}

#[test]
fn an_unknown_residual_is_an_alarm() {
    let mut governor = SpeedGovernor::new(GovernorOptions::default()).unwrap();
    (0..100).for_each(|_| {
        governor.next(0.1, 0.0);
    });
    assert!(governor.next(0.1, f64::NAN) < 0.005);
}

#[test]
fn a_third_arm_pins_the_body_beside_the_pull() {
    let (body, rim) = slit(1.57);
    let (two, three) = (fixture::arms(2), fixture::arms(3));
    let run = |arms| {
        plan(
            &body.model(),
            &fixture::scene(arms),
            Action::Stretch { hole: &rim },
            &PlanOptions::default(),
        )
        .unwrap()
    };
    assert_eq!(run(&two).grips.len(), 2);
    let pinned = run(&three);
    assert_eq!(pinned.grips[2].role, Role::Support);
    assert!(pinned.coverage > run(&two).coverage);
}

#[test]
fn the_next_best_pair_is_tried() {
    let (body, rim) = slit(1.57);
    let arms = fixture::arms(2);
    let free = plan(
        &body.model(),
        &fixture::scene(&arms),
        Action::Stretch { hole: &rim },
        &PlanOptions::default(),
    )
    .unwrap();
    assert!(free.refused.is_empty());
    // Where the best pair would pull to is out of bounds now, and nothing else is.
    let forbidden = free.motion.arms[0]
        .at(0.4 * free.motion.duration)
        .unwrap()
        .translation
        .vector;
    let mut fenced = arms.clone();
    for arm in &mut fenced {
        let base = arm.workspace.clone();
        arm.workspace = grip_planner::Workspace::Custom(std::sync::Arc::new(move |pose| {
            base.contains(pose) && (pose.translation.vector - forbidden).norm() > 0.008
        }));
    }
    let other = plan(
        &body.model(),
        &fixture::scene(&fenced),
        Action::Stretch { hole: &rim },
        &PlanOptions::default(),
    )
    .unwrap();
    assert!(matches!(
        other.refused[0].reason,
        Refusal::OutOfWorkspace { .. }
    ));
    let vertices = |p: &grip_planner::Plan| p.grips.iter().map(|g| g.vertex).collect::<Vec<_>>();
    assert_eq!(other.refused[0].vertices, vertices(&free));
    assert_ne!(vertices(&other), vertices(&free));
}

#[test]
fn no_hole_no_stretch() {
    let (body, rim) = slit(0.0);
    let arms = fixture::arms(2);
    let scene = fixture::scene(&arms);
    let run = |hole: &[u32]| {
        plan(
            &body.model(),
            &scene,
            Action::Stretch { hole },
            &PlanOptions::default(),
        )
    };
    assert!(matches!(
        run(&rim[..2]),
        Err(Refusal::NotAHole { vertices: 2 })
    ));
    assert!(matches!(run(&[rim[0]; 5]), Err(Refusal::NotAHole { .. })));
    assert!(matches!(
        run(&[0, 1, 99_999]),
        Err(Refusal::Input(Error::NoSuchVertex { vertex: 99_999, .. }))
    ));
    // A slit across the arms leaves room for both tools.
    assert_eq!(run(&rim).unwrap().grips.len(), 2);
}

/// Two fingers of 14 by 3 by 3 cm side by side, along the given angle from the x axis, and vertices of both around the neck where they touch, in order.
fn fingers(angle: f64) -> (Body, Vec<u32>) {
    let aside = Vector3::new(-angle.sin(), angle.cos(), 0.0);
    let one = Body::ellipsoid([0.07, 0.015, 0.015], 1200, 0.0, angle);
    let count = one.points.len() as u32;
    let (mut both, mut neck) = (one.clone(), vec![]);
    both.points.extend(&one.points);
    both.normals.extend(&one.normals);
    both.areas.extend(&one.areas);
    both.boundary.extend(&one.boundary);
    both.visible.extend(&one.visible);
    both.edges
        .extend(one.edges.iter().map(|e| e.map(|v| v + count)));
    for (v, p) in both.points.iter_mut().enumerate() {
        let side = if v < count as usize { -0.0148 } else { 0.0148 };
        *p += aside * side;
    }
    let middle = Vector3::new(0.0, 0.0, fixture::DEPTH - 0.012);
    for v in 0..both.points.len() as u32 {
        let p = both.points[v as usize].coords - middle;
        let (along, across) = ((p - aside * aside.dot(&p)).norm(), aside.dot(&p));
        if (0.006..0.02).contains(&along) && across.abs() < 0.006 {
            neck.push(v);
        }
    }
    let around = |v: &u32| {
        let p = both.points[*v as usize].coords - middle;
        (-p.z).atan2(p.x * angle.cos() + p.y * angle.sin())
    };
    neck.sort_by(|a, b| around(a).total_cmp(&around(b)));
    (both, neck)
}

proptest! {
    #![proptest_config(ProptestConfig { max_shrink_iters: 10, ..ProptestConfig::with_cases(16) })]

    #[test]
    fn fingers_that_touch_are_pulled_apart(angle in 0.0..3.1) {
        let (body, neck) = fingers(angle);
        let arms = fixture::arms(3);
        let scene = fixture::scene(&arms);
        let aside = Vector3::new(-angle.sin(), angle.cos(), 0.0);
        let axis = UnitVector3::new_normalize(aside + Vector3::z() * 0.3);
        let action = Action::Part { neck: &neck, axis };
        let done = match plan(&body.model(), &scene, action, &PlanOptions::default()) {
            Ok(done) => done,
            Err(Refusal::AllRefused { refused }) => {
                let room = |r: &grip_planner::RefusedSet| matches!(r.reason, Refusal::ArmsCollide { .. } | Refusal::HitsBody { .. });
                prop_assert!(refused.iter().all(room), "{refused:?}");
                return Ok(());
            }
            Err(other) => return Err(TestCaseError::fail(other.to_string())),
        };
        let across = done.across.unwrap();
        prop_assert!(across.dot(&aside).abs() > 1.0 - 1e-9, "{across:?}");
        let finger = |k: usize| (done.grips[k].vertex as usize) < body.points.len() / 2;
        prop_assert_ne!(finger(0), finger(1));
        let tip = |k: usize, time: f64| done.motion.arms[k].at(time).unwrap().translation.vector;
        let gap = |time: f64| across.dot(&(tip(1, time) - tip(0, time)));
        prop_assert!(gap(0.0) > 0.0);
        let distance = StretchOptions::default().distance;
        let widest = (0..200).map(|k| gap(done.motion.duration * f64::from(k) / 199.0)).fold(0.0, f64::max);
        prop_assert!((widest - gap(0.0) - distance).abs() < 1e-9);
    }
}

/// There is room for the tools at some angles, so that the test above says something.
#[test]
fn some_fingers_can_be_parted() {
    let arms = fixture::arms(3);
    let scene = fixture::scene(&arms);
    let parted = (0..12).filter(|k| {
        let angle = 0.25 * f64::from(*k);
        let (body, neck) = fingers(angle);
        let axis = UnitVector3::new_normalize(Vector3::new(angle.sin(), -angle.cos(), 0.0));
        let action = Action::Part { neck: &neck, axis };
        plan(&body.model(), &scene, action, &PlanOptions::default()).is_ok()
    });
    let parted = parted.count();
    assert!(parted >= 4, "{parted} of 12");
}

/// What lies on top of something cannot be pulled off it sideways.
#[test]
fn what_lies_on_top_is_not_parted() {
    let body = fixture::usual(1000);
    let arms = fixture::arms(2);
    let scene = fixture::scene(&arms);
    let refused = |neck: &[u32], axis: Vector3<f64>| {
        let axis = UnitVector3::new_normalize(axis);
        plan(
            &body.model(),
            &scene,
            Action::Part { neck, axis },
            &PlanOptions::default(),
        )
    };
    let (up, sideways) = (Vector3::new(0.3, 0.0, 1.0), Vector3::x());
    assert!(matches!(refused(&[1, 2, 3], up), Err(Refusal::NotBeside)));
    assert!(matches!(
        refused(&[1, 2], sideways),
        Err(Refusal::NotAHole { vertices: 2 })
    ));
    assert!(matches!(
        refused(&[0, 1, 99_999], sideways),
        Err(Refusal::Input(Error::NoSuchVertex { vertex: 99_999, .. }))
    ));
}
