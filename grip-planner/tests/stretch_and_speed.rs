//! Opening a hole, and how fast.
#![allow(missing_docs, clippy::unwrap_used, reason = "tests")]

mod fixture;

use fixture::Body;
use grip_planner::nalgebra::Vector3;
use grip_planner::{
    Coverage, CoverageOptions, GovernorOptions, Options, Refusal, SpeedGovernor, StretchOptions,
    speed_limit, stretch,
};
use proptest::prelude::*;

/// The usual body with a slit on top, along `angle` from the camera's x axis: its rim in order, and the body without the inside.
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
        let options = StretchOptions { distance, lift, ..Default::default() };
        let done = match stretch(&body.model(), &scene, &rim, &Options::default(), &options) {
            Ok(done) => done,
            // Two tools that cannot stand this close together is an honest answer.
            Err(Refusal::ArmsCollide { .. } | Refusal::NoGripBesideHole { .. }) => return Ok(()),
            Err(other) => return Err(TestCaseError::fail(other.to_string())),
        };
        let long = Vector3::new(angle.cos(), angle.sin(), 0.0);
        prop_assert!(done.across.dot(&long).abs() < 0.15);
        let side = |k: usize| done.across.dot(&done.grips[k].tip().coords);
        prop_assert!(side(0) < side(1));
        let gap = |time: f64| done.across.dot(&(done.motion.arms[1].at(time).unwrap().translation.vector - done.motion.arms[0].at(time).unwrap().translation.vector));
        let height = |time: f64| fixture::DEPTH - done.motion.arms[0].at(time).unwrap().translation.vector.z;
        let widest = (0..200).map(|k| gap(done.motion.duration * f64::from(k) / 199.0)).fold(0.0, f64::max);
        prop_assert!((widest - gap(0.0) - distance).abs() < 1e-9);
        prop_assert!((gap(done.motion.duration) - gap(0.0) - 0.5 * distance).abs() < 1e-9);
        prop_assert!((height(done.motion.duration) - height(0.0)).abs() < 1e-9);
        prop_assert!(done.motion.peak_speed() <= options.speed * (1.0 + 1e-9));
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
fn no_hole_no_stretch() {
    let (body, rim) = slit(0.0);
    let arms = fixture::arms(2);
    let scene = fixture::scene(&arms);
    let run = |hole: &[u32]| {
        stretch(
            &body.model(),
            &scene,
            hole,
            &Options::default(),
            &StretchOptions::default(),
        )
    };
    assert!(matches!(
        run(&rim[..2]),
        Err(Refusal::NotAHole { vertices: 2 })
    ));
    assert!(matches!(run(&[rim[0]; 5]), Err(Refusal::NotAHole { .. })));
    assert!(matches!(run(&[0, 1, 99_999]), Err(Refusal::Input(_))));
    // A slit across the arms leaves room for both tools.
    let opened = run(&rim).unwrap();
    assert_eq!(opened.grips.len(), 2);
}
