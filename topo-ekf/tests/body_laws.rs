//! Laws of the body filter: rigid motions, gradients, patch test, symmetry, friction, repeatability.
#![allow(missing_docs, clippy::unwrap_used, reason = "tests")]

mod common;
#[path = "common/body.rs"]
mod dense;

use common::Noise;
use dense::{TABLE, UP, block, elastic, skin};
use nalgebra::{Matrix3, Point3, Rotation3, UnitVector3, Vector3};
use proptest::prelude::*;
use topo_ekf::body::{
    BodyFilter, BodyFrame, BodyOptions, BodyReport, Embedding, Lattice, Limits, Pose, Progress,
    Row, Table,
};
use topo_ekf::{Error, Plane, Status};

const H: f64 = 0.016;

/// A block with some cells half full or nearly empty.
fn mixed() -> Lattice {
    let mut lattice = block([3, 2, 2], H);
    for cell in 0..12 {
        let fill = [1.0, 0.5, 0.05][cell as usize % 3];
        lattice.set_fill(cell, fill, fill);
    }
    lattice
}

fn any_rotation() -> impl Strategy<Value = Rotation3<f64>> {
    prop::array::uniform3(-3.0..3.0f64).prop_map(|w| Rotation3::new(Vector3::from(w)))
}

fn any_vector(size: f64) -> impl Strategy<Value = Vector3<f64>> {
    prop::array::uniform3(-size..size).prop_map(Vector3::from)
}

fn moved(lattice: &Lattice, turn: &Rotation3<f64>, shift: &Vector3<f64>) -> Pose {
    let live = lattice.rest().iter().map(|p| turn * p + shift).collect();
    let mut pose = Pose {
        live,
        turns: vec![],
    };
    pose.fit_turns(lattice);
    pose
}

fn shaken(lattice: &Lattice, seed: u64, size: f64) -> Pose {
    let mut noise = Noise(seed);
    let mut pose = Pose::at_rest(lattice);
    for p in &mut pose.live {
        *p += noise.vector(size);
    }
    pose.fit_turns(lattice);
    pose
}

proptest! {
    /// Rounding of coordinates of 0.3 m is 1e-16 m; 200 cells' worth of stiffness 4.9e7 · 0.016 m make of it an energy of 1e-26.
    #[test]
    fn rigid_motions_cost_nothing(turn in any_rotation(), shift in any_vector(0.2)) {
        let lattice = mixed();
        let options = BodyOptions::default();
        let pose = moved(&lattice, &turn, &shift);
        prop_assert!(pose.energy(&lattice, &options) < 1e-12);
        for force in pose.forces(&lattice, &options) {
            // Stiffness times h, times rounding and the 1e-14 of the fitted rotation.
            prop_assert!(force.norm() < 1e-8, "{force:?}");
        }
    }

    /// With the rotations held the energy is quadratic: central differences are exact but for rounding, which is that of the energy (1e-16 of
    /// about 1e3) over the step (1e-5 m). With rotations that follow, the rest is of second order in the strain.
    #[test]
    fn forces_are_the_gradient(seed in 0u64..1000) {
        let lattice = mixed();
        let options = BodyOptions::default();
        let pose = shaken(&lattice, seed, 1e-3);
        let forces = pose.forces(&lattice, &options);
        let largest = forces.iter().map(Vector3::norm).fold(0.0, f64::max);
        let step = 1e-5;
        for node in [0, 7, 20] {
            for axis in 0..3 {
                let mut ahead = pose.clone();
                ahead.live[node][axis] += step;
                let mut behind = pose.clone();
                behind.live[node][axis] -= step;
                let rise = ahead.energy(&lattice, &options) - behind.energy(&lattice, &options);
                let error = forces[node][axis] + rise / (2.0 * step);
                prop_assert!(error.abs() < 1e-8 * largest + 1e-6, "{error} of {largest}");
            }
        }
        let mut errors = vec![];
        for halved in [1.0, 0.5] {
            let mut pose = Pose::at_rest(&lattice);
            let mut noise = Noise(seed);
            for p in &mut pose.live {
                *p += noise.vector(1e-3) * halved;
            }
            pose.fit_turns(&lattice);
            let forces = pose.forces(&lattice, &options);
            let mut error: f64 = 0.0;
            for node in 0..4 {
                for axis in 0..3 {
                    let slope = [step, -step].map(|s| {
                        let mut other = pose.clone();
                        other.live[node][axis] += s;
                        other.fit_turns(&lattice);
                        other.energy(&lattice, &options)
                    });
                    error = error.max((forces[node][axis] + (slope[0] - slope[1]) / (2.0 * step)).abs());
                }
            }
            errors.push(error);
        }
        // A quarter for half the strain, and a term of third order.
        prop_assert!(errors[1] < 0.35 * errors[0], "{errors:?}");
    }

    /// Everything given is moved rigidly; the answer moves along. Rounding of 1e-16 m passes through a matrix of condition 1e6.
    #[test]
    fn the_answer_moves_with_what_is_given(turn in any_rotation(), shift in any_vector(0.2), seed in 0u64..1000) {
        let here = run(&Rotation3::identity(), &Vector3::zeros(), seed);
        let there = run(&turn, &shift, seed);
        for (a, b) in here.iter().zip(&there) {
            prop_assert!((turn * a + shift - b).norm() < 1e-8, "{a} {b}");
        }
    }
}

/// A gripped and seen block over a few frames, everything moved by a rigid motion.
fn run(turn: &Rotation3<f64>, shift: &Vector3<f64>, seed: u64) -> Vec<Point3<f64>> {
    let place = |p: Point3<f64>| turn * p + shift;
    let mut lattice = Lattice::new(H, place(Point3::origin()), *turn);
    for k in 0..12 {
        lattice.ensure([k % 3, k / 3 % 2, k / 6]);
    }
    let normal = turn * UP;
    let table = Plane {
        normal,
        offset: -normal.dot(shift),
    };
    let mut body = BodyFilter::new(lattice, table, &BodyOptions::default()).unwrap();
    let skin = skin(body.lattice());
    let surface: Vec<Embedding> = skin.iter().map(|s| s.0).collect();
    let seen: Vec<Embedding> = skin.iter().filter(|s| s.1 == 5).map(|s| s.0).collect();
    for frame in 0..6 {
        let mut noise = Noise(seed + frame);
        let at = Embedding::new(6, [0.1, 0.5, 1.0]);
        let lift = Vector3::new(1e-3, 0.5e-3, 2e-3) * frame as f64;
        let grip = place(Point3::new(0.1 * H, 0.5 * H, 2.0 * H) + lift);
        let rows: Vec<Row> = seen
            .iter()
            .map(|at| {
                let rest =
                    turn.inverse() * (body.lattice().warp(body.lattice().rest(), at) - shift);
                let target = place(rest + lift * 0.5 + noise.vector(3e-4));
                Row::along(*at, target, normal, 1e6)
            })
            .collect();
        body.step(
            &BodyFrame::new(&[(at, grip)], &surface),
            &mut |_, _, _| rows.clone(),
            &mut |_, _| {},
        )
        .unwrap();
    }
    body.pose().live.clone()
}

#[test]
fn the_same_calls_give_the_same_bits() {
    let turn = Rotation3::new(Vector3::new(0.3, -0.2, 0.7));
    let shift = Vector3::new(0.1, 0.2, -0.1);
    assert_eq!(run(&turn, &shift, 7), run(&turn, &shift, 7));
}

#[test]
fn the_order_of_rows_changes_rounding_alone() {
    let lattice = block([3, 2, 2], H);
    let rows: Vec<Row> = skin(&lattice)
        .iter()
        .map(|(at, _)| {
            let target = lattice.warp(lattice.rest(), at) + Vector3::new(1e-3, 2e-3, 5e-3);
            Row::point(*at, target, 1e6)
        })
        .collect();
    let step = |rows: Vec<Row>| {
        let mut body = BodyFilter::new(lattice.clone(), TABLE, &BodyOptions::default()).unwrap();
        let frame = BodyFrame::new(&[], &[]);
        body.step(&frame, &mut |_, _, _| rows.clone(), &mut |_, _| {})
            .unwrap();
        body.pose().live.clone()
    };
    let backwards = step(rows.iter().rev().copied().collect());
    for (a, b) in step(rows).iter().zip(backwards) {
        assert!((a - b).norm() < 1e-11);
    }
}

/// Patch test: a uniform strain leaves no force on the inner nodes of a block of equal cells, and its energy is that of the continuum times the
/// fill, cell by cell, where cells are partly full.
#[test]
fn a_uniform_strain_passes() {
    let options = BodyOptions::default().with_poisson_ratio(0.3);
    let strain = Matrix3::new(0.02, 0.01, -0.03, 0.01, -0.01, 0.005, -0.03, 0.005, 0.04);
    let strained = |lattice: &Lattice| {
        let stretch = Matrix3::identity() + strain;
        let mut pose = Pose::at_rest(lattice);
        for p in &mut pose.live {
            *p = Point3::from(stretch * p.coords);
        }
        pose.fit_turns(lattice);
        pose
    };
    let (lambda, mu) = (0.3 / (1.3 * 0.4), 0.5 / 1.3);
    let density = 0.5 * lambda * strain.trace().powi(2) + mu * strain.norm_squared();
    let full = block([3, 3, 3], H);
    let forces = strained(&full).forces(&full, &options);
    let largest = forces.iter().map(Vector3::norm).fold(0.0, f64::max);
    let inner = |p: &Point3<f64>| p.iter().all(|c| *c > 0.5 * H && *c < 2.5 * H);
    for (p, f) in full.rest().iter().zip(&forces) {
        assert!(!inner(p) || f.norm() < 1e-10 * largest, "{f}");
    }
    let mixed = mixed();
    let filled: f64 = mixed.cells().iter().map(|c| c.stiffness).sum();
    let energy = strained(&mixed).energy(&mixed, &options);
    let exact = options.stiffness * H.powi(3) * filled * density;
    assert!((energy - exact).abs() < 1e-9 * exact, "{energy} {exact}");
}

/// The crate's energy and forces against the dense oracle's, far from rest.
#[test]
fn forces_are_those_of_the_oracle() {
    let lattice = mixed();
    let options = BodyOptions::default();
    let pose = shaken(&lattice, 3, 2e-3);
    let (_, dense) = elastic(
        &lattice,
        &pose.live,
        options.stiffness,
        options.poisson_ratio,
    );
    let largest = dense.amax();
    for (i, f) in pose.forces(&lattice, &options).iter().enumerate() {
        for a in 0..3 {
            assert!((f[a] - dense[3 * i + a]).abs() < 1e-9 * largest);
        }
    }
}

/// A weight on the table pushed sideways by a constant force: below Coulomb's bound it creeps, above it slides.
#[test]
fn a_pushed_block_sticks_and_slides() {
    let mu = 0.5;
    let push = |share: f64| {
        let options = BodyOptions::default()
            .with_friction(mu)
            .with_motion_sigma(1.0)
            .with_momentum(0.0)
            .with_initial_weight(0.2)
            .with_initial_weight_sigma(1e-6);
        let lattice = block([3, 3, 1], H);
        let mut body = BodyFilter::new(lattice, TABLE, &options).unwrap();
        let at = Embedding::new(4, [0.5, 0.5, 0.1]);
        let along = UnitVector3::new_normalize(Vector3::x());
        // A long soft spring is a constant force.
        let (spring, reach) = (1e3, share * mu * body.weight() / 1e3);
        let place = |body: &BodyFilter| body.pose().position(body.lattice(), &at).x;
        let mut start = 0.0;
        for k in 0..15 {
            // It settles first.
            let reach = if k < 5 { 0.0 } else { reach };
            if k == 5 {
                start = place(&body);
            }
            let frame = BodyFrame::new(&[], &[]);
            body.step(
                &frame,
                &mut |lattice, pose, _| {
                    let target = pose.position(lattice, &at) + along.into_inner() * reach;
                    vec![Row::along(at, target, along, spring)]
                },
                &mut |_, _| {},
            )
            .unwrap();
        }
        place(&body) - start
    };
    // The weights of friction are found anew in every step from the slip of the last, from 1e-5 m on, and an idle body makes one step a
    // frame: what is a little above the bound slides slowly.
    let (held, slid) = (push(0.5), push(40.0));
    assert!(held < 2e-4, "{held}");
    assert!(slid > 5e-3, "{held} {slid}");
}

/// Free is what a frame left unconstrained: something must have been measured or held in it. Rows without weight measure nothing.
#[test]
fn a_frame_without_observations_is_not_free() {
    let high = Plane {
        normal: UP,
        offset: 1.0,
    };
    let lattice = block([2, 2, 2], H);
    let at = Embedding::new(0, [0.5; 3]);
    let here = Pose::at_rest(&lattice).position(&lattice, &at);
    let status = |grips: &[(Embedding, Point3<f64>)], rows: &[Row]| {
        let mut body = BodyFilter::new(lattice.clone(), high, &BodyOptions::default()).unwrap();
        body.set_feet(vec![]);
        let frame = BodyFrame::new(grips, &[]);
        let report = body.step(&frame, &mut |_, _, _| rows.to_vec(), &mut |_, _| {});
        report.unwrap().status
    };
    assert_eq!(status(&[], &[]), Status::Unobserved);
    assert_eq!(
        status(&[], &[Row::point(at, here, 0.0)]),
        Status::Unobserved
    );
    assert_eq!(status(&[], &[Row::point(at, here, 1e6)]), Status::Free);
    assert_eq!(status(&[(at, here)], &[]), Status::Free);
}

#[test]
fn a_body_at_rest_stays() {
    let mut body = BodyFilter::new(block([4, 3, 2], H), TABLE, &BodyOptions::default()).unwrap();
    let surface: Vec<Embedding> = skin(body.lattice()).iter().map(|s| s.0).collect();
    for _ in 0..30 {
        let frame = BodyFrame::new(&[], &surface);
        let report = body
            .step(&frame, &mut |_, _, _| vec![], &mut |_, _| {})
            .unwrap();
        assert!(matches!(
            report.status,
            Status::Unobserved | Status::Constrained
        ));
        assert!(report.violation[1] < 1e-6);
        // The table bears all of it.
        let borne = report.table_force / body.weight();
        assert!((borne - 1.0).abs() < 0.02, "{borne}");
    }
    for (p, rest) in body.pose().live.iter().zip(body.lattice().rest()) {
        // Pressed in by weight over the contact stiffness, and taken out again.
        assert!((p - rest).norm() < 5e-4, "{p} {rest}");
    }
}

/// A block that is pushed into the table: to a micrometre above it, to within the springs of its contact, or as deep as it is pushed.
#[test]
fn the_table_is_a_constraint_or_a_contact_or_absent() {
    let depth = |table: Table| {
        let options = BodyOptions::default()
            .with_table(table)
            .with_motion_sigma(1.0);
        let mut body = BodyFilter::new(block([3, 2, 1], H), TABLE, &options).unwrap();
        let surface: Vec<Embedding> = skin(body.lattice()).iter().map(|s| s.0).collect();
        let top: Vec<Embedding> = (0..6).map(|c| Embedding::new(c, [0.5, 0.5, 1.0])).collect();
        let mut report = BodyReport::default();
        for _ in 0..10 {
            let frame = BodyFrame::new(&[], &surface);
            let observe = &mut |lattice: &Lattice, _: &Pose, _: Progress| {
                let row = |at: &Embedding| {
                    let target = lattice.warp(lattice.rest(), at) - 0.004 * UP.into_inner();
                    Row::point(*at, target, 1e6)
                };
                top.iter().map(row).collect()
            };
            report = body.step(&frame, observe, &mut |_, _| {}).unwrap();
        }
        let height = |at: &Embedding| TABLE.height(&body.pose().position(body.lattice(), at));
        let lowest = surface.iter().map(height).fold(f64::INFINITY, f64::min);
        (-lowest, report.table_force)
    };
    let (kept, _) = depth(Table::Constraint);
    let (pressed, force) = depth(Table::Contact);
    let (sunk, nothing) = depth(Table::Absent);
    assert!(kept < 1e-6, "{kept}");
    // The rows pull with 6e6 of weight against a contact of 4e6 for every point of the skin.
    assert!((1e-5..2e-3).contains(&pressed), "{pressed}");
    // Nothing holds it: it is where it was pushed.
    assert!(sunk > 0.0035, "{sunk}");
    assert!(force > 0.0 && nothing == 0.0, "{force} {nothing}");
}

/// A body that is seen 30 mm higher from one frame to the next: implausible, unless it is known that it may have moved far. Then it is followed, and
/// bears its weight.
#[test]
fn a_body_that_fell_is_followed_past_the_limit_of_motion() {
    let limits = Limits::default().with_motion(0.015).with_fall(0.1);
    for fell in [false, true] {
        let mut body =
            BodyFilter::new(block([5, 2, 2], H), TABLE, &BodyOptions::default()).unwrap();
        let surface: Vec<Embedding> = skin(body.lattice()).iter().map(|s| s.0).collect();
        let before = body.pose().clone();
        let jump = Vector3::z() * 0.03;
        let target = |at: &Embedding| before.position(body.lattice(), at) + jump;
        let rows: Vec<Row> = surface
            .iter()
            .map(|at| Row::point(*at, target(at), 1e8))
            .collect();
        let frame = BodyFrame::new(&[], &surface)
            .with_limits(limits)
            .with_fell(fell);
        let mut wide = Vec::new();
        let stepped = body.step(
            &frame,
            &mut |_, _, progress| {
                wide.push(progress.released);
                rows.clone()
            },
            &mut |_, _| {},
        );
        assert!(wide.iter().all(|w| *w == fell));
        if fell {
            stepped.unwrap();
            let off = |at: &Embedding| {
                let moved = body.pose().position(body.lattice(), at);
                (moved - before.position(body.lattice(), at) - jump).norm()
            };
            assert!(surface.iter().all(|at| off(at) < 1e-3));
            // Not as in a fall after a release, which has no weight.
            let loads: Vector3<f64> = body.loads().iter().sum();
            assert!(
                (loads.z + body.weight()).abs() < 0.02 * body.weight(),
                "{loads}"
            );
        } else {
            assert!(matches!(stepped, Err(Error::Beyond { .. })), "{stepped:?}");
            assert_eq!(body.pose().live, before.live);
        }
    }
}
