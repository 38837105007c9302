//! Constraints against clarabel on the full problem, the optimality conditions, Simon's gain formula and contradictions.
#![allow(missing_docs, clippy::unwrap_used, reason = "tests")]

mod common;

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettingsBuilder, DefaultSolver, IPSolver, SupportedConeT};
use common::{Noise, dense_information, ellipsoid, fold, sheet};
use nalgebra::{DMatrix, DVector, Point3, UnitVector3, Vector3};
use proptest::prelude::*;
use topo_ekf::{
    Filter, Frame, Inequality, Motion, Observation, Options, Plane, Projection, Status,
};

const UP: UnitVector3<f64> = UnitVector3::new_unchecked(Vector3::new(0.0, 0.0, 1.0));

/// `Σ a_v · x_v ≥ b`.
type Row = (Vec<(u32, Vector3<f64>)>, f64);

fn rows_of(planes: &[Plane], own: &[Inequality], vertices: usize) -> Vec<Row> {
    let of_plane = |p: &Plane| {
        let (normal, bound) = (p.normal.into_inner(), -p.offset);
        (0..vertices as u32).map(move |v| (vec![(v, normal)], bound))
    };
    planes
        .iter()
        .flat_map(of_plane)
        .chain(own.iter().map(|r| (r.terms.clone(), r.bound)))
        .collect()
}

fn gap((terms, bound): &Row, x: &[Point3<f64>]) -> f64 {
    bound
        - terms
            .iter()
            .map(|(v, a)| a.dot(&x[*v as usize].coords))
            .sum::<f64>()
}

/// `min ½ (x − x̂)ᵀ (S ⊗ I) (x − x̂)` over the rows, all 3Q unknowns at once, in displacements and millimetres.
fn clarabel_projection(
    s: &DMatrix<f64>,
    estimate: &[Point3<f64>],
    rows: &[Row],
) -> Vec<Point3<f64>> {
    let n = estimate.len();
    let scale = s.max();
    let (mut starts, mut at, mut values) = (vec![0], vec![], vec![]);
    for axis in 0..3 {
        for j in 0..n {
            for i in 0..=j {
                if s[(i, j)] != 0.0 {
                    at.push(axis * n + i);
                    values.push(s[(i, j)] / scale);
                }
            }
            starts.push(at.len());
        }
    }
    let p = CscMatrix::new(3 * n, 3 * n, starts, at, values);
    let mut dense = DMatrix::zeros(rows.len(), 3 * n);
    for (k, (terms, _)) in rows.iter().enumerate() {
        for (v, a) in terms {
            for axis in 0..3 {
                dense[(k, axis * n + *v as usize)] -= a[axis];
            }
        }
    }
    let a = CscMatrix::from(
        dense
            .row_iter()
            .map(|r| r.iter().copied().collect::<Vec<_>>())
            .collect::<Vec<_>>()
            .as_slice(),
    );
    let b: Vec<f64> = rows.iter().map(|r| -1e3 * gap(r, estimate)).collect();
    let settings = DefaultSettingsBuilder::default()
        .verbose(false)
        .tol_gap_abs(1e-12)
        .tol_gap_rel(1e-12)
        .tol_feas(1e-12)
        .build()
        .unwrap();
    let cones = [SupportedConeT::NonnegativeConeT(b.len())];
    let mut solver = DefaultSolver::new(&p, &vec![0.0; 3 * n], &a, &b, &cones, settings).unwrap();
    solver.solve();
    let d = &solver.solution.x;
    (0..n)
        .map(|i| estimate[i] + Vector3::new(d[i], d[n + i], d[2 * n + i]) * 1e-3)
        .collect()
}

/// Squared distance in the metric of the information.
fn cost(s: &DMatrix<f64>, x: &[Point3<f64>], from: &[Point3<f64>]) -> f64 {
    (0..3)
        .map(|axis| {
            let d = DVector::from_iterator(x.len(), x.iter().zip(from).map(|(a, b)| (a - b)[axis]));
            d.dot(&(s * &d))
        })
        .sum()
}

/// Optimality: the forces `S (x − x̂)` are those of rows that touch, and none of them pulls. Least squares for the forces of the touching
/// rows, independent of how the crate finds them. Returns the residual relative to the force.
fn stationarity(s: &DMatrix<f64>, x: &[Point3<f64>], from: &[Point3<f64>], rows: &[Row]) -> f64 {
    let n = x.len();
    let mut force = DVector::zeros(3 * n);
    for axis in 0..3 {
        let d = DVector::from_iterator(n, x.iter().zip(from).map(|(a, b)| (a - b)[axis]));
        force.rows_mut(axis * n, n).copy_from(&(s * d));
    }
    let touching: Vec<&Row> = rows.iter().filter(|r| gap(r, x) > -1e-7).collect();
    let mut a = DMatrix::zeros(3 * n, touching.len());
    for (k, (terms, _)) in touching.iter().enumerate() {
        for (v, c) in terms {
            for axis in 0..3 {
                a[(axis * n + *v as usize, k)] += c[axis];
            }
        }
    }
    let forces = a.clone().svd(true, true).solve(&force, 1e-10).unwrap();
    let largest = forces.amax();
    assert!(
        forces.iter().all(|f| *f > -1e-4 * largest),
        "a row pulls: {}",
        forces.min()
    );
    (a * forces - &force).norm() / force.norm()
}

proptest! {
    #[test]
    fn planes_and_inequalities_are_kept_at_least_cost(
        seed in any::<u64>(),
        tilt in prop::array::uniform2(-0.6..0.6f64),
        depth in -0.004..0.012f64,
        second in prop::option::of((-0.8..0.8f64, 0.0..0.012f64)),
        pulls in prop::collection::vec((0u32..60, 0u32..60, prop::array::uniform3(-1.0..1.0f64), 0.0..4e-3f64), 0..4),
    ) {
        let (rest, edges) = ellipsoid(60, [0.03, 0.025, 0.02], 5);
        let mut noise = Noise(seed);
        let observations: Vec<_> = (0..rest.len())
            .filter(|i| rest[*i].z > -0.005)
            .map(|i| Observation { vertex: i as u32, position: rest[i] + noise.vector(1e-3), sigma: 1e-3 })
            .collect();
        let normal = UnitVector3::new_normalize(Vector3::new(tilt[0], tilt[1], 1.0));
        // The body reaches about 0.02 below its centre: the plane cuts `depth` off it.
        let mut planes = vec![Plane { normal, offset: 0.02 - depth }];
        if let Some((lean, cut)) = second {
            planes.push(Plane { normal: UnitVector3::new_normalize(Vector3::new(1.0, lean, 0.2)), offset: 0.03 - cut });
        }
        let options = Options::default();
        let mut free = Filter::new(&rest, &edges, &options).unwrap();
        free.step(&Frame::new(&observations)).unwrap();
        // Two vertices kept some millimetres farther from (or nearer to) each other along a direction than they would be.
        let own: Vec<_> = pulls.iter().filter(|p| p.0 != p.1).map(|&(v, w, a, more)| {
            let a = Vector3::from(a) + Vector3::z() * 1e-3;
            let now = a.dot(&(free.live()[v as usize] - free.live()[w as usize]));
            Inequality { terms: vec![(v, a), (w, -a)], bound: now + more - 1e-3 }
        }).collect();
        let rows = rows_of(&planes, &own, rest.len());
        let mut held = Filter::new(&rest, &edges, &options).unwrap();
        let frame = Frame::new(&observations).with_planes(&planes).with_inequalities(&own);
        let report = held.step(&frame).unwrap();
        prop_assert_eq!(held.unconstrained(), free.live());
        let violated = rows.iter().any(|r| gap(r, free.live()) > 0.0);
        if !violated {
            // Identical, to the bit.
            prop_assert_eq!(report.status, Status::Free);
            prop_assert_eq!(held.live(), free.live());
            return Ok(());
        }
        let s = dense_information(held.information(), &edges, &options);
        let expected = clarabel_projection(&s, free.live(), &rows);
        let solvable = rows.iter().all(|r| gap(r, &expected) < 1e-5);
        if report.status != Status::Constrained {
            // Coefficients and planes drawn at random may contradict each other; then clarabel finds nothing either.
            prop_assert!(report.status == Status::Infeasible && !solvable || report.status == Status::Free);
            return Ok(());
        }
        for row in &rows {
            let unit = row.0.iter().map(|(_, a)| a.norm()).fold(0.0, f64::max);
            prop_assert!(gap(row, held.live()) <= 1e-6 * unit.max(1.0), "{}", gap(row, held.live()));
        }
        // Both answers are feasible, so their costs (in squared standard deviations) compare them: ours may not be dearer, and
        // clarabel's, which stops a few micrometres away where a plane is barely touched, must be near enough to mean something.
        let (ours, theirs) = (cost(&s, held.live(), free.live()), cost(&s, &expected, free.live()));
        prop_assert!(ours <= theirs * (1.0 + 1e-5) + 1e-5, "{} {}", ours, theirs);
        prop_assert!(theirs <= ours * 1.01 + 0.5, "{} {}", ours, theirs);
        if ours > 1.0 {
            let residual = stationarity(&s, held.live(), free.live(), &rows);
            prop_assert!(residual < 1e-3, "{residual}");
        }
    }
}

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
