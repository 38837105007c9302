//! Grips: firm while they carry a body, soft when they pull harder than that.
#![allow(missing_docs, clippy::unwrap_used, reason = "tests")]

mod common;
#[path = "common/body.rs"]
mod dense;

use dense::{TABLE, block, skin};
use nalgebra::{Point3, Vector3};
use topo_ekf::body::{BodyFilter, BodyFrame, BodyOptions, BodyReport, Embedding, Row};

const H: f64 = 0.016;

/// A block, and the points of its top with their places at rest.
fn gripped(options: &BodyOptions) -> (BodyFilter, Vec<(Embedding, Point3<f64>)>) {
    let body = BodyFilter::new(block([5, 2, 2], H), TABLE, options).unwrap();
    let top = skin(body.lattice()).into_iter().filter(|s| s.1 == 5);
    let grips = top
        .map(|(at, _)| (at, body.lattice().warp(body.lattice().rest(), &at)))
        .collect();
    (body, grips)
}

/// Moves the grips 2 mm a frame, up to `most`, without data, or while the body is seen to stay where it is. Returns the body, the mean distance of the
/// gripped points from their places, and the last report.
fn pulled(
    options: &BodyOptions,
    most: Vector3<f64>,
    seen_at_rest: bool,
) -> (BodyFilter, f64, BodyReport) {
    let (mut body, grips) = gripped(options);
    let surface = skin(body.lattice());
    let embedded: Vec<Embedding> = surface.iter().map(|s| s.0).collect();
    let frames = (most.norm() / 2e-3).ceil() as u32;
    let (mut report, mut off) = (BodyReport::default(), 0.0);
    for k in 0..frames + 20 {
        let moved = most * f64::from(k.min(frames)) / f64::from(frames);
        let now: Vec<_> = grips.iter().map(|(at, p)| (*at, p + moved)).collect();
        let at_rest = |at: &Embedding| body.lattice().warp(body.lattice().rest(), at);
        let seen = embedded.iter().filter(|_| seen_at_rest);
        let seen: Vec<Row> = seen.map(|at| Row::point(*at, at_rest(at), 1e6)).collect();
        let frame = BodyFrame::new(&now, &embedded);
        report = body
            .step(&frame, &mut |_, _, _| seen.clone(), &mut |_, _| {})
            .unwrap();
        let distances = now
            .iter()
            .map(|(at, p)| (p - body.pose().position(body.lattice(), at)).norm());
        off = distances.sum::<f64>() / now.len() as f64;
    }
    (body, off, report)
}

/// Every grip of `n` that carry a body of weight `W` bears `W / n`, and gives by `σ² W / n`.
#[test]
fn grips_that_carry_a_body_do_not_give() {
    let options = BodyOptions::default()
        .with_initial_weight(0.7)
        .with_initial_weight_sigma(1e-6)
        .with_firm_pull(1.5);
    let (body, off, report) = pulled(&options, Vector3::z() * 0.05, false);
    let points = gripped(&options).1.len() as f64;
    let firm = options.grip_sigma.powi(2) * body.weight() / points;
    // A little more in the mean, because the stretched block also pulls them towards each other.
    assert!((1.0..1.25).contains(&(off / firm)), "{off} m, not {firm} m");
    // The reported force is that of the law: the weight, and no more.
    assert!((report.grip_force.z / body.weight() - 1.0).abs() < 0.02);
    // The planted fault: grips that are soft from the start give some 15 times as much.
    let (_, soft, _) = pulled(&options.with_firm_pull(0.0), Vector3::z() * 0.05, false);
    assert!((12.0..16.5).contains(&(soft / off)), "{soft} and {off} m");
}

/// Jaws that have slipped pull at material that has stayed where it was. The data then decide, unless grips can never slip.
#[test]
fn grips_that_slip_do_not_overrule_the_data() {
    let aside = Vector3::x() * 0.01;
    let moved = |options: &BodyOptions| {
        let (body, ..) = pulled(options, aside, true);
        let (lattice, live) = (body.lattice(), &body.pose().live);
        let moves = lattice.rest().iter().zip(live).map(|(r, x)| (x - r).x);
        moves.sum::<f64>() / live.len() as f64
    };
    let options = BodyOptions::default();
    let slipping = moved(&options);
    let soft = moved(&options.with_firm_pull(0.0));
    let never = moved(&options.with_firm_pull(f64::INFINITY));
    assert!(slipping < 0.5 * never, "{slipping} and {never} m");
    assert!(slipping < 1.5 * soft, "{slipping} and {soft} m");
}

/// A body without mass is held as by soft grips.
#[test]
fn a_body_without_mass_is_held() {
    let mut lattice = block([2, 1, 1], H);
    for cell in 0..2 {
        lattice.set_fill(cell, 0.5, 0.0);
    }
    let options = BodyOptions::default().with_firm_pull(f64::INFINITY);
    let mut body = BodyFilter::new(lattice, TABLE, &options).unwrap();
    let at = Embedding::new(0, [0.5; 3]);
    let place = body.pose().position(body.lattice(), &at) + Vector3::z() * 1e-3;
    let held = [(at, place)];
    let frame = BodyFrame::new(&held, &[]);
    let report = body
        .step(&frame, &mut |_, _, _| vec![], &mut |_, _| {})
        .unwrap();
    assert!(report.grip_force.iter().all(|f| f.is_finite()));
    assert!((body.pose().position(body.lattice(), &at) - place).norm() < 1e-4);
}
