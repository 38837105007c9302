//! Slow, dense answers to compare with: textbook least squares and clarabel on the full constrained problem.
#![allow(missing_docs, clippy::unwrap_used, reason = "tests")]

mod common;

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettingsBuilder, DefaultSolver, IPSolver, SupportedConeT};
use common::{Noise, ellipsoid, sheet};
use nalgebra::{DMatrix, DVector, Point3, Rotation3, UnitVector3, Vector3};
use proptest::prelude::*;
use topo_ekf::{Filter, Frame, Observation, Options, Plane, Status};

/// `diag(d + anchor) + Σ w (e_i − e_j)(e_i − e_j)ᵀ`, dense.
fn dense_information(information: &[f64], edges: &[[u32; 2]], options: &Options) -> DMatrix<f64> {
    let n = information.len();
    let mut s = DMatrix::from_diagonal(&DVector::from_column_slice(information));
    for i in 0..n {
        s[(i, i)] += options.anchor_sigma.powi(-2);
    }
    let w = options.edge_sigma.powi(-2);
    for e in edges {
        let (i, j) = (e[0] as usize, e[1] as usize);
        s[(i, i)] += w;
        s[(j, j)] += w;
        s[(i, j)] -= w;
        s[(j, i)] -= w;
    }
    s
}

/// Kalman update in covariance form for one coordinate: no line shared with the information form under test.
fn kalman(
    mean: &DVector<f64>,
    covariance: &DMatrix<f64>,
    seen: &[(usize, f64, f64)],
) -> DVector<f64> {
    let h = DMatrix::from_fn(seen.len(), mean.len(), |r, c| {
        if seen[r].0 == c { 1.0 } else { 0.0 }
    });
    let r = DMatrix::from_diagonal(&DVector::from_iterator(
        seen.len(),
        seen.iter().map(|s| s.2 * s.2),
    ));
    let z = DVector::from_iterator(seen.len(), seen.iter().map(|s| s.1));
    let innovation = &h * covariance * h.transpose() + r;
    let gain = covariance * h.transpose() * innovation.try_inverse().unwrap();
    mean + gain * (z - &h * mean)
}

#[test]
fn a_single_global_step_is_the_kalman_update() {
    // With rotations fixed at the prediction (one iteration, no edge seen at both ends) and a process noise that forgets what was known
    // before, the step is linear and its prior is the turned rest shape: a covariance-form Kalman filter must agree.
    let (rest, edges, _) = sheet(5, 5e-3);
    let options = Options::default()
        .with_rotation_iterations(1)
        .with_process_noise(1e3);
    let mut filter = Filter::new(&rest, &edges, &options).unwrap();
    let mut noise = Noise(3);
    let observations: Vec<_> = (0..rest.len())
        .filter(|i| i % 5 % 2 == 0 && i / 5 % 2 == 0)
        .map(|i| Observation {
            vertex: i as u32,
            position: rest[i] + noise.vector(5e-4),
            sigma: 5e-4,
        })
        .collect();
    filter.step(&Frame::new(&observations)).unwrap();
    let rotation = nearest_common_rotation(&rest, &observations);
    let prior = dense_information(
        &vec![0.0; rest.len()],
        &edges,
        &options.with_anchor_sigma(1.0),
    );
    let covariance = prior.try_inverse().unwrap();
    for axis in 0..3 {
        // Prior mean: the rest shape turned as the prediction turned it (its place is free under the prior).
        let mean = DVector::from_iterator(rest.len(), rest.iter().map(|p| (rotation * p)[axis]));
        let seen: Vec<_> = observations
            .iter()
            .map(|o| (o.vertex as usize, o.position[axis], o.sigma))
            .collect();
        let expected = kalman(&mean, &covariance, &seen);
        for i in 0..rest.len() {
            // The two differ by the anchor: 25/0.1² against 9/0.0005² moves the common shift of 0.1 mm by 5e-9 m.
            assert!(
                (filter.live()[i][axis] - expected[i]).abs() < 1e-8,
                "{axis} {i}"
            );
        }
    }
}

/// Kabsch by singular value decomposition, with the documented prior on the turn.
fn nearest_common_rotation(rest: &[Point3<f64>], observations: &[Observation]) -> Rotation3<f64> {
    let n = observations.len() as f64;
    let from = observations
        .iter()
        .map(|o| rest[o.vertex as usize].coords)
        .sum::<Vector3<f64>>()
        / n;
    let to = observations
        .iter()
        .map(|o| o.position.coords)
        .sum::<Vector3<f64>>()
        / n;
    let mut moment = nalgebra::Matrix3::identity() * 25.0;
    for o in observations {
        let a = rest[o.vertex as usize].coords - from;
        moment += (o.position.coords - to) * a.transpose() / (o.sigma * o.sigma);
    }
    let svd = moment.svd(true, true);
    Rotation3::from_matrix_unchecked(svd.u.unwrap() * svd.v_t.unwrap())
}

#[test]
fn marginals_are_the_diagonal_of_the_dense_inverse() {
    for count in [1, 2, 30, 150] {
        let (rest, edges) = ellipsoid(count, [0.05, 0.04, 0.03], 5);
        let options = Options::default();
        let mut filter = Filter::new(&rest, &edges, &options).unwrap();
        let observations: Vec<_> = (0..count / 2)
            .map(|i| Observation {
                vertex: i as u32,
                position: rest[i],
                sigma: 3e-4 + 1e-5 * i as f64,
            })
            .collect();
        filter.step(&Frame::new(&observations)).unwrap();
        let inverse = dense_information(filter.information(), &edges, &options)
            .try_inverse()
            .unwrap();
        for (i, sigma) in filter.marginal_sigmas().unwrap().iter().enumerate() {
            assert!(
                (sigma - inverse[(i, i)].sqrt()).abs() < 1e-9 * sigma,
                "{count} {i}"
            );
        }
    }
}

/// `min ½ (x − x̂)ᵀ (S ⊗ I) (x − x̂)` over the half-spaces, all 3Q unknowns at once, in displacements.
fn clarabel_projection(
    s: &DMatrix<f64>,
    estimate: &[Point3<f64>],
    planes: &[Plane],
) -> Vec<Point3<f64>> {
    let n = estimate.len();
    let scale = s.max();
    let (mut starts, mut rows, mut values) = (vec![0], vec![], vec![]);
    for axis in 0..3 {
        for j in 0..n {
            for i in 0..=j {
                if s[(i, j)] != 0.0 {
                    rows.push(axis * n + i);
                    values.push(s[(i, j)] / scale);
                }
            }
            starts.push(rows.len());
        }
    }
    let p = CscMatrix::new(3 * n, 3 * n, starts, rows, values);
    // −n·d ≤ height, plane by plane; column-major with one entry per plane in each column.
    let (mut starts, mut rows, mut values) = (vec![0], vec![], vec![]);
    for axis in 0..3 {
        for i in 0..n {
            for (k, plane) in planes.iter().enumerate() {
                rows.push(k * n + i);
                values.push(-plane.normal[axis]);
            }
            starts.push(rows.len());
        }
    }
    let a = CscMatrix::new(planes.len() * n, 3 * n, starts, rows, values);
    // In millimetres, so that the solver's absolute tolerances are small against the data.
    let b: Vec<f64> = planes
        .iter()
        .flat_map(|p| estimate.iter().map(|x| 1e3 * p.height(x)))
        .collect();
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

proptest! {
    #[test]
    fn planes_are_kept_at_least_cost(
        seed in any::<u64>(),
        tilt in prop::array::uniform2(-0.6..0.6f64),
        depth in -0.004..0.012f64,
        second in prop::option::of((-0.8..0.8f64, 0.0..0.012f64)),
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
        let mut held = Filter::new(&rest, &edges, &options).unwrap();
        let report = held.step(&Frame::new(&observations).with_planes(&planes)).unwrap();

        for plane in &planes {
            for p in held.live() {
                prop_assert!(plane.height(p) >= -1e-6);
            }
        }
        if report.plane_depth[0] == 0.0 {
            prop_assert_eq!(report.status, Status::Free);
            prop_assert_eq!(held.live(), free.live());
        } else {
            prop_assert_eq!(report.status, Status::Constrained);
        }
        let s = dense_information(held.information(), &edges, &options);
        let expected = clarabel_projection(&s, free.live(), &planes);
        // Both answers are feasible, so their costs (in squared standard deviations) compare them: ours may not be dearer, and
        // clarabel's, which stops a few micrometres away where a plane is barely touched, must be near enough to mean something.
        let cost = |x: &[Point3<f64>]| {
            (0..3)
                .map(|axis| {
                    let d = DVector::from_iterator(x.len(), x.iter().zip(free.live()).map(|(a, b)| (a - b)[axis]));
                    d.dot(&(&s * &d))
                })
                .sum::<f64>()
        };
        let (ours, theirs) = (cost(held.live()), cost(&expected));
        prop_assert!(ours <= theirs * (1.0 + 1e-6) + 1e-6, "{} {}", ours, theirs);
        prop_assert!(theirs <= ours * 1.001 + 0.1, "{} {}", ours, theirs);
        if let [plane] = planes[..] {
            // Optimality: the forces S (x − x̂) push along the normal, never pull, and only where the body touches.
            let shift = |axis: usize| {
                DVector::from_iterator(rest.len(), held.live().iter().zip(free.live()).map(|(a, b)| (a - b)[axis]))
            };
            let force = [&s * shift(0), &s * shift(1), &s * shift(2)];
            for i in 0..rest.len() {
                let f = Vector3::new(force[0][i], force[1][i], force[2][i]);
                let push = f.dot(&plane.normal);
                // 1e-6 of the force that moves one vertex by a millimetre against six edges.
                let small = 1e-6 * 1e-3 * 6.0 * options.edge_sigma.powi(-2);
                prop_assert!((f - plane.normal.into_inner() * push).norm() < small);
                prop_assert!(push > -small);
                prop_assert!(push.abs() < small || plane.height(&held.live()[i]) < 1e-9);
            }
        }
    }
}
