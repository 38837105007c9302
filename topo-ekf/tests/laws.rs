//! Laws: symmetry, rejection without side effects, contradiction, permitted changes of the graph between frames.
#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::cast_sign_loss,
    clippy::too_many_lines,
    reason = "tests"
)]

mod common;

use common::{Noise, ellipsoid, sheet, turned};
use nalgebra::{Point3, Rotation3, UnitVector3, Vector3};
use proptest::prelude::*;
use topo_ekf::{Error, Filter, Frame, Observation, Options, Plane, Status};

fn observe(
    points: &[Point3<f64>],
    of: impl Fn(usize) -> bool,
    seed: u64,
    sigma: f64,
) -> Vec<Observation> {
    let mut noise = Noise(seed);
    (0..points.len())
        .filter(|&i| of(i))
        .map(|i| Observation {
            vertex: i as u32,
            position: points[i] + noise.vector(sigma),
            sigma,
        })
        .collect()
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_rigid_motion_of_everything_moves_the_answer(
        axis in prop::array::uniform3(-3.0..3.0f64),
        shift in prop::array::uniform3(-0.2..0.2f64),
        seed in any::<u64>(),
    ) {
        let (g, t) = (Rotation3::new(Vector3::from(axis)), Vector3::from(shift));
        let (rest, edges) = ellipsoid(80, [0.05, 0.04, 0.03], 5);
        let plane = Plane { normal: UnitVector3::new_normalize(Vector3::new(0.1, 0.0, 1.0)), offset: 0.02 };
        let moved_plane = Plane { normal: g * plane.normal, offset: plane.offset - (g * plane.normal).dot(&t) };
        let run = |moved: bool| {
            let place = |p: &[Point3<f64>]| if moved { turned(p, &g, &t) } else { p.to_vec() };
            let rest_here = place(&rest);
            let mut filter = Filter::new(&rest_here, &edges, &Options::default()).unwrap();
            for frame in 1..=3 {
                let turn = Rotation3::from_axis_angle(&Vector3::x_axis(), 0.1 * f64::from(frame));
                let truth = turned(&rest, &turn, &Vector3::new(0.0, 0.002, 0.001));
                let mut observations = observe(&truth, |i| truth[i].z > 0.0, seed ^ frame as u64, 5e-4);
                if moved {
                    for o in &mut observations {
                        o.position = g * o.position + t;
                    }
                }
                let planes = [if moved { moved_plane } else { plane }];
                filter.step(&Frame::new(&observations).with_planes(&planes)).unwrap();
            }
            (filter.live().to_vec(), filter.rotations().to_vec())
        };
        let ((here, turns_here), (there, turns_there)) = (run(false), run(true));
        for (a, b) in here.iter().zip(&there) {
            // Rounding of 0.3 m, and of the stopping test of the alternations, which may fall on either side of it.
            prop_assert!((g * a + t - b).norm() < 1e-8);
        }
        for (a, b) in turns_here.iter().zip(&turns_there) {
            // Rotations are rest → live; both frames were moved: g R gᵀ.
            prop_assert!(((g * a * g.inverse()).matrix() - b.matrix()).norm() < 1e-6);
        }
    }
}

#[test]
fn contradicting_planes_keep_the_first_and_violate_the_rest_least() {
    let (rest, edges, _) = sheet(6, 5e-3);
    let up = UnitVector3::new_unchecked(Vector3::z());
    // Above 2 mm and below 1 mm at once.
    let planes = [
        Plane {
            normal: up,
            offset: -2e-3,
        },
        Plane {
            normal: -up,
            offset: 1e-3,
        },
    ];
    let mut filter = Filter::new(&rest, &edges, &Options::default()).unwrap();
    let observations = observe(&rest, |i| i % 2 == 0, 1, 1e-3);
    let report = filter
        .step(&Frame::new(&observations).with_planes(&planes))
        .unwrap();
    assert_eq!(report.status, Status::Infeasible);
    for p in filter.live() {
        assert!(planes[0].height(p) >= -1e-9);
        assert!((planes[1].height(p) + 1e-3).abs() < 1e-6, "{p}");
    }
    assert!(
        filter
            .rotations()
            .iter()
            .all(|r| r.matrix().iter().all(|v| v.is_finite()))
    );
}

#[test]
fn refused_input_leaves_no_trace() {
    let (rest, edges) = ellipsoid(40, [0.05, 0.04, 0.03], 5);
    let mut filter = Filter::new(&rest, &edges, &Options::default()).unwrap();
    filter
        .step(&Frame::new(&observe(&rest, |i| i < 20, 4, 1e-3)))
        .unwrap();
    let state = |f: &Filter| {
        (
            f.live().to_vec(),
            f.rotations().to_vec(),
            f.information().to_vec(),
            f.rest().to_vec(),
        )
    };
    let before = state(&filter);
    let good = Observation {
        vertex: 0,
        position: rest[0],
        sigma: 1e-3,
    };
    let nan = Point3::new(0.0, f64::NAN, 0.0);
    let up = UnitVector3::new_unchecked(Vector3::z());
    for bad in [
        Observation { vertex: 40, ..good },
        Observation {
            position: nan,
            ..good
        },
        Observation {
            position: Point3::new(f64::INFINITY, 0.0, 0.0),
            ..good
        },
        Observation { sigma: 0.0, ..good },
        Observation {
            sigma: -1.0,
            ..good
        },
        Observation {
            sigma: f64::NAN,
            ..good
        },
    ] {
        assert!(filter.step(&Frame::new(&[good, bad])).is_err());
    }
    for bad in [
        Plane {
            normal: UnitVector3::new_unchecked(Vector3::new(0.0, 0.0, 2.0)),
            offset: 0.0,
        },
        Plane {
            normal: UnitVector3::new_unchecked(Vector3::new(f64::NAN, 0.0, 1.0)),
            offset: 0.0,
        },
        Plane {
            normal: up,
            offset: f64::INFINITY,
        },
    ] {
        assert!(matches!(
            filter.step(&Frame::new(&[good]).with_planes(&[bad])),
            Err(Error::Plane { index: 0, .. })
        ));
    }
    assert!(
        filter
            .step(&Frame::new(&[good]).with_triangles(&[[0, 1, 99]]))
            .is_err()
    );
    assert!(
        filter
            .step(&Frame {
                dt_frames: f64::NAN,
                ..Frame::new(&[good])
            })
            .is_err()
    );
    let none: Vec<Option<u32>> = vec![None; 40];
    assert!(
        filter
            .set_graph(&rest, &rest, None, &[[0, 0]], &none)
            .is_err()
    );
    assert!(
        filter
            .set_graph(&rest, &rest, None, &[[0, 40]], &none)
            .is_err()
    );
    assert!(
        filter
            .set_graph(&rest, &rest[1..], None, &edges, &none)
            .is_err()
    );
    assert!(
        filter
            .set_graph(&rest, &[nan; 40], None, &edges, &none)
            .is_err()
    );
    assert!(
        filter
            .set_graph(&[nan; 40], &rest, None, &edges, &none)
            .is_err()
    );
    assert!(
        filter
            .set_graph(&rest, &rest, None, &edges, &[Some(40); 40])
            .is_err()
    );
    let skew = [Rotation3::from_matrix_unchecked(nalgebra::Matrix3::identity() * 2.0); 40];
    assert!(
        filter
            .set_graph(&rest, &rest, Some(&skew), &edges, &none)
            .is_err()
    );
    assert!(filter.set_graph(&[], &[], None, &[], &[]).is_err());
    assert!(filter.set_stiffness(&[1.0]).is_err());
    assert_eq!(state(&filter), before);
}

#[test]
fn refused_options_are_named() {
    for (options, field) in [
        (Options::default().with_edge_sigma(0.0), "edge_sigma"),
        (
            Options::default().with_process_noise(f64::NAN),
            "process_noise",
        ),
        (Options::default().with_bend_sigma(-1.0), "bend_sigma"),
        (
            Options::default().with_rotation_iterations(0),
            "rotation_iterations",
        ),
    ] {
        let found = Filter::new(&[Point3::origin()], &[], &options)
            .err()
            .unwrap();
        assert!(matches!(found, Error::Option { name, .. } if name == field));
    }
}

#[test]
fn poor_observations_are_no_trouble() {
    // None, one, two, all in one place, all on a line, isolated vertices, parallel edges, coincident rest positions.
    let (mut rest, mut edges) = ellipsoid(30, [0.05, 0.04, 0.03], 4);
    rest.push(rest[3]);
    edges.push([3, 30]);
    edges.push([30, 3]);
    rest.push(Point3::new(1.0, 1.0, 1.0));
    for count in [0, 1, 2, 3] {
        let mut filter = Filter::new(&rest, &edges, &Options::default()).unwrap();
        for _ in 0..3 {
            let observations: Vec<_> = (0..count)
                .map(|i| Observation {
                    vertex: i as u32,
                    position: Point3::new(0.0, 0.0, 0.1),
                    sigma: 1e-3,
                })
                .collect();
            filter.step(&Frame::new(&observations)).unwrap();
        }
        assert!(
            filter
                .live()
                .iter()
                .all(|p| p.iter().all(|c| c.is_finite()))
        );
        assert_eq!(filter.live()[31], rest[31]);
        if count == 0 {
            for (a, b) in filter.live().iter().zip(&rest) {
                assert!((a - b).norm() < 1e-12);
            }
        }
        let seen = filter.observability();
        assert_eq!(
            (seen.components, seen.blind_components),
            (2, if count == 0 { 2 } else { 1 })
        );
        assert_eq!(seen.rank, 32 - seen.blind_components);
        assert!(!seen.determined[31]);
    }
}

#[test]
fn one_grip_carries_the_body_without_turning_it() {
    let (rest, edges) = ellipsoid(60, [0.05, 0.04, 0.03], 5);
    let mut filter = Filter::new(&rest, &edges, &Options::default()).unwrap();
    let shift = Vector3::new(0.0, 0.003, 0.004);
    filter
        .step(&Frame::new(&[Observation {
            vertex: 7,
            position: rest[7] + shift,
            sigma: 2e-4,
        }]))
        .unwrap();
    for (a, b) in filter.live().iter().zip(&rest) {
        assert!((a - (b + shift)).norm() < 1e-4);
    }
}

#[test]
fn a_new_graph_continues_the_old_one() {
    let (rest, edges) = ellipsoid(120, [0.05, 0.04, 0.03], 6);
    let mut filter = Filter::new(&rest, &edges, &Options::default()).unwrap();
    let turn = Rotation3::from_axis_angle(&Vector3::y_axis(), 1.2);
    for k in 1..=12 {
        let part = Rotation3::from_axis_angle(&Vector3::y_axis(), 0.1 * f64::from(k));
        let truth = turned(&rest, &part, &Vector3::zeros());
        filter
            .step(&Frame::new(&observe(&truth, |_| true, k as u64, 3e-4)))
            .unwrap();
    }
    // The same graph in another order, one vertex gone, one new at its place.
    let count = rest.len();
    let order: Vec<usize> = (0..count).rev().collect();
    let new_rest: Vec<_> = order.iter().map(|&i| rest[i]).collect();
    let new_live: Vec<_> = order.iter().map(|&i| turn * rest[i]).collect();
    let new_edges: Vec<_> = edges
        .iter()
        .map(|e| e.map(|v| (count - 1) as u32 - v))
        .collect();
    let keep: Vec<_> = order
        .iter()
        .map(|&i| (i != 5).then_some(i as u32))
        .collect();
    let old = (filter.information().to_vec(), filter.rotations().to_vec());
    filter
        .set_graph(&new_rest, &new_live, None, &new_edges, &keep)
        .unwrap();
    for (new, &i) in order.iter().enumerate() {
        if i == 5 {
            assert!((filter.information()[new] - 1.0 / 25e-6).abs() < 1e-6);
            // Fitted from noiseless live edges; its prior came from noisy neighbours at a hundredth of the weight.
            assert!((filter.rotations()[new].matrix() - turn.matrix()).norm() < 0.01);
        } else {
            assert_eq!(filter.information()[new].to_bits(), old.0[i].to_bits());
            assert_eq!(filter.rotations()[new], old.1[i]);
        }
    }
    let truth = turned(&new_rest, &turn, &Vector3::zeros());
    filter
        .step(&Frame::new(&observe(&truth, |i| i % 2 == 0, 99, 3e-4)))
        .unwrap();
    assert!(common::mean_error(filter.live(), &truth, |_| true) < 3e-4);
}

#[test]
fn resting_is_not_measured() {
    // A hundred frames on the table, hidden below: the information of hidden vertices decays, whatever the table does.
    let (rest, edges, _) = sheet(8, 5e-3);
    let mut filter = Filter::new(&rest, &edges, &Options::default()).unwrap();
    let plane = [Plane {
        normal: UnitVector3::new_unchecked(Vector3::z()),
        offset: 0.0,
    }];
    let mut last = vec![f64::INFINITY; rest.len()];
    for k in 0..100 {
        let observations = observe(&rest, |i| i % 8 < 4, k, 5e-4);
        filter
            .step(&Frame::new(&observations).with_planes(&plane))
            .unwrap();
        for i in (0..rest.len()).filter(|i| i % 8 >= 4) {
            assert!(filter.information()[i] < last[i]);
        }
        last = filter.information().to_vec();
    }
    // An unbiased resting surface: half of the noise is cut off, the rest averages out well under a noise sigma.
    let height = filter.live().iter().map(|p| p.z).sum::<f64>() / rest.len() as f64;
    assert!((0.0..2.5e-4).contains(&height), "{height}");
}

#[test]
fn the_same_input_gives_the_same_bits() {
    let run = || {
        let (rest, edges) = ellipsoid(250, [0.05, 0.04, 0.03], 6);
        let mut filter = Filter::new(&rest, &edges, &Options::default()).unwrap();
        let plane = [Plane {
            normal: UnitVector3::new_unchecked(Vector3::z()),
            offset: 0.02,
        }];
        for k in 0..3 {
            let observations = observe(&rest, |i| rest[i].z > 0.0, k, 1e-3);
            filter
                .step(&Frame::new(&observations).with_planes(&plane))
                .unwrap();
        }
        filter
            .live()
            .iter()
            .flat_map(|p| p.iter().map(|c| c.to_bits()).collect::<Vec<_>>())
            .collect::<Vec<_>>()
    };
    assert_eq!(run(), run());
}
