//! Constraints: Simon's gain formula, their effect on hidden vertices, contradictions, boxes, strong presses, rejected input.
#![allow(missing_docs, clippy::unwrap_used, reason = "tests")]

mod common;

use common::{Noise, dense_information, ellipsoid, fold, sheet};
use nalgebra::{DMatrix, DVector, Point3, UnitVector3, Vector3};
use topo_ekf::{
    Filter, Frame, Inequality, Motion, Observation, Options, Plane, Projection, Status,
};

const UP: UnitVector3<f64> = UnitVector3::new_unchecked(Vector3::new(0.0, 0.0, 1.0));

#[test]
fn gain_projection_is_simons_formula() {
    // K̃ = K − Dᵀ(DDᵀ)⁻¹(Dx⁺ − d)(rᵀS⁻¹r)⁻¹rᵀS⁻¹ for the constraints that bind, dense, one coordinate.
    let (rest, edges, _) = sheet(4, 5e-3);
    let options = Options::default()
        .with_motion(Motion::Still)
        .with_anchor_sigma(1e3)
        .with_process_noise(0.0)
        .with_projection(Projection::Gain);
    let mut noise = Noise(4);
    let seen: Vec<_> = (0..16)
        .step_by(2)
        .map(|i| Observation {
            vertex: i,
            position: rest[i as usize] + noise.vector(1e-3),
            sigma: 5e-4,
        })
        .collect();
    let mut filter = Filter::new(&rest, &edges, &options).unwrap();
    let prior = dense_information(filter.information(), &edges, &options);
    let table = [Plane {
        normal: UP,
        offset: 0.0,
    }];
    let report = filter.step(&Frame::new(&seen).with_planes(&table)).unwrap();
    assert_eq!(report.status, Status::Constrained);

    let p = prior.try_inverse().unwrap();
    let h = DMatrix::from_fn(8, 16, |r, c| f64::from(seen[r].vertex as usize == c));
    let z = DVector::from_fn(8, |k, _| seen[k].position.z);
    let s = (&h * &p * h.transpose() + DMatrix::from_diagonal_element(8, 8, 25e-8))
        .try_inverse()
        .unwrap();
    let gain = &p * h.transpose() * &s;
    let after = &gain * &z;
    // In this metric the rows of the table are orthogonal: those violated are those that bind.
    let below: Vec<usize> = (0..16).filter(|&i| after[i] < 0.0).collect();
    assert!(below.len() > 3);
    let d = DMatrix::from_fn(below.len(), 16, |k, i| f64::from(below[k] == i));
    let lack = &d * &after;
    let ddt = (&d * d.transpose()).try_inverse().unwrap();
    let weight = z.dot(&(&s * &z));
    let held_gain = &gain - d.transpose() * ddt * lack * (z.transpose() * &s) / weight;
    let expected = held_gain * &z;
    for i in 0..16 {
        assert!((filter.live()[i].z - expected[i]).abs() < 1e-9, "{i}");
        assert!((filter.live()[i].x - filter.unconstrained()[i].x).abs() < 1e-15);
    }
}

#[test]
fn a_binding_constraint_informs_the_hidden_vertices_around_it() {
    // A strip whose middle is hidden; one hidden vertex is known to be at least 4 mm up. In the metric of the information its
    // neighbours rise with it, in the Euclidean one they stay.
    let (rest, edges, _) = sheet(9, 5e-3);
    let seen: Vec<_> = (0..81)
        .filter(|i| i % 9 < 2 || i % 9 > 6)
        .map(|i| Observation {
            vertex: i,
            position: rest[i as usize],
            sigma: 5e-4,
        })
        .collect();
    let lift = [Inequality {
        terms: vec![(40, Vector3::z())],
        bound: 4e-3,
    }];
    let rise = |projection| {
        let options = Options::default().with_projection(projection);
        let mut filter = Filter::new(&rest, &edges, &options).unwrap();
        let report = filter
            .step(&Frame::new(&seen).with_inequalities(&lift))
            .unwrap();
        assert_eq!(report.status, Status::Constrained);
        assert!((filter.live()[40].z - 4e-3).abs() < 1e-6);
        [39, 41, 31, 49, 22].map(|i: usize| filter.live()[i].z)
    };
    assert!(rise(Projection::Estimate).iter().all(|z| *z > 1e-3));
    assert!(rise(Projection::Gain).iter().all(|z| z.abs() < 1e-9));
}

#[test]
fn a_contradiction_is_split_evenly_and_said_to_be_one() {
    let (rest, edges, _) = sheet(5, 5e-3);
    let seen: Vec<_> = (0..25)
        .step_by(3)
        .map(|i| Observation {
            vertex: i,
            position: rest[i as usize],
            sigma: 5e-4,
        })
        .collect();
    // Vertex 12 above 3 mm and below 1 mm.
    let own = [
        Inequality {
            terms: vec![(12, Vector3::z())],
            bound: 3e-3,
        },
        Inequality {
            terms: vec![(12, -Vector3::z())],
            bound: -1e-3,
        },
    ];
    let mut filter = Filter::new(&rest, &edges, &Options::default()).unwrap();
    let report = filter
        .step(&Frame::new(&seen).with_inequalities(&own))
        .unwrap();
    assert_eq!(report.status, Status::Infeasible);
    assert!(
        (filter.live()[12].z - 2e-3).abs() < 1e-6,
        "{}",
        filter.live()[12].z
    );
    assert!((report.inequality_depth[1] - 1e-3).abs() < 1e-6);
    // The next frame without the contradiction is an ordinary one.
    let report = filter
        .step(&Frame::new(&seen).with_inequalities(&own[..1]))
        .unwrap();
    assert_eq!(report.status, Status::Constrained);
    assert!(filter.live()[12].z > 3e-3 - 1e-6);
}

#[test]
fn many_planes_make_a_box() {
    let (rest, edges) = ellipsoid(200, [0.03, 0.03, 0.03], 6);
    let seen: Vec<_> = (0..200)
        .step_by(2)
        .map(|i| Observation {
            vertex: i,
            position: rest[i as usize],
            sigma: 5e-4,
        })
        .collect();
    let planes: Vec<_> = [Vector3::x(), Vector3::y(), Vector3::z()]
        .iter()
        .flat_map(|n| [*n, -n])
        .map(|n| Plane {
            normal: UnitVector3::new_unchecked(n),
            offset: 0.027,
        })
        .collect();
    let mut filter = Filter::new(&rest, &edges, &Options::default()).unwrap();
    for _ in 0..3 {
        let report = filter
            .step(&Frame::new(&seen).with_planes(&planes))
            .unwrap();
        assert_eq!(report.status, Status::Constrained);
        assert!(report.plane_depth[0] > 1e-3);
        for p in filter.live() {
            assert!(p.iter().all(|c| c.abs() <= 0.027 + 1e-6), "{p}");
        }
    }
}

#[test]
fn hard_presses_settle() {
    // Far deeper than any camera would report: the flap 8 mm down onto a sheet on the table, 200 contacts and more.
    let (_, edges, triangles) = sheet(30, 4e-3);
    let fold = fold(30, 4e-3, 9);
    let table = [Plane {
        normal: UP,
        offset: 0.0,
    }];
    let mut filter = Filter::new(&fold.live, &edges, &Options::default()).unwrap();
    let mut pushing = 0;
    for k in 0..8 {
        let seen = fold.pressed(1e-3 * f64::from(k + 1), k as u64);
        let frame = Frame::new(&seen)
            .with_planes(&table)
            .with_triangles(&triangles);
        let report = filter.step(&frame).unwrap();
        assert_eq!(report.status, Status::Constrained, "{report:?}");
        assert!(report.contact_depth[1] <= 1e-6 && report.plane_depth[1] <= 1e-6);
        pushing = pushing.max(report.pushing);
    }
    assert!(pushing >= 200, "{pushing}");
}

#[test]
fn refused_inequalities_leave_no_trace() {
    let (rest, edges, _) = sheet(4, 5e-3);
    let mut filter = Filter::new(&rest, &edges, &Options::default()).unwrap();
    let seen = [Observation {
        vertex: 3,
        position: rest[3] + Vector3::z() * 1e-3,
        sigma: 5e-4,
    }];
    filter.step(&Frame::new(&seen)).unwrap();
    let state = |f: &mut Filter| {
        let statistic = f.innovation_statistic().unwrap();
        (
            f.live().to_vec(),
            f.unconstrained().to_vec(),
            f.information().to_vec(),
            statistic,
        )
    };
    let before = state(&mut filter);
    let z = Vector3::z();
    for (terms, bound) in [
        (vec![(16, z)], 0.0),
        (vec![(0, z * f64::NAN)], 0.0),
        (vec![(0, z * f64::INFINITY)], 0.0),
        (vec![(0, z * 0.0)], 0.0),
        (vec![], 0.0),
        (vec![(0, z)], f64::NAN),
        (vec![(0, z)], f64::INFINITY),
    ] {
        let own = [Inequality { terms, bound }];
        assert!(
            filter
                .step(&Frame::new(&seen).with_inequalities(&own))
                .is_err(),
            "{own:?}"
        );
    }
    assert!(filter.error_statistic(&rest[1..]).is_err());
    assert!(
        filter
            .error_statistic(&[Point3::new(f64::NAN, 0.0, 0.0); 16])
            .is_err()
    );
    assert!(
        filter
            .normalised_residuals(&[Observation {
                vertex: 16,
                ..seen[0]
            }])
            .is_err()
    );
    assert_eq!(state(&mut filter), before);
}
