//! Slow, dense reference solutions: textbook least squares and dense inverses.
#![allow(missing_docs, clippy::unwrap_used, reason = "tests")]

mod common;

use common::{Noise, dense_information, ellipsoid, sheet};
use nalgebra::{DMatrix, DVector, Point3, Rotation3, Vector3};
use topo_ekf::{Filter, Frame, Motion, Observation, Options};

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

/// With turns that are not known, by dense algebra: `S⁻¹ + S⁻¹ B T⁻¹ Bᵀ S⁻¹`, `B` the force on every vertex for a turn of every vertex.
#[test]
fn marginals_hold_the_uncertainty_of_turns() {
    let (rest, edges) = ellipsoid(60, [0.05, 0.04, 0.03], 5);
    let options = Options::default();
    let mut filter = Filter::new(&rest, &edges, &options).unwrap();
    let seen = |i: usize| Observation {
        vertex: i as u32,
        position: rest[i],
        sigma: 3e-4,
    };
    let observations: Vec<_> = (0..20).map(seen).collect();
    filter.step(&Frame::new(&observations)).unwrap();
    let (n, d) = (rest.len(), filter.information());
    let s = dense_information(d, &edges, &options)
        .try_inverse()
        .unwrap();
    let unit = options.edge_sigma.powi(-2);
    let mut t = DMatrix::<f64>::identity(n, n);
    let mut b = DMatrix::<f64>::zeros(3 * n, 3 * n);
    for &[i, j] in &edges {
        let (i, j) = (i as usize, j as usize);
        let edge = rest[i] - rest[j];
        let stiff = 1.0 / (4.0 * options.bend_sigma.powi(2));
        let told = d[i] * d[j] / (d[i] + d[j]) * edge.norm_squared() * 2.0 / 3.0;
        for (k, l) in [(i, j), (j, i)] {
            t[(k, k)] += told + stiff;
            t[(k, l)] -= stiff;
        }
        // ½ (ω_i + ω_j) × E on i, the opposite on j.
        let force = -edge.cross_matrix() * (0.5 * unit);
        for of in [i, j] {
            for (on, sign) in [(i, 1.0), (j, -1.0)] {
                let mut block = b.view_mut((3 * on, 3 * of), (3, 3));
                block += force * sign;
            }
        }
    }
    let eye = DMatrix::<f64>::identity(3, 3);
    let (s3, t3) = (s.kronecker(&eye), t.try_inverse().unwrap().kronecker(&eye));
    let turned = &s3 * &b * t3 * b.transpose() * &s3;
    let sigmas = filter.marginal_sigmas().unwrap();
    let mut ratios = vec![];
    for i in 0..n {
        let exact = s[(i, i)] + turned.view((3 * i, 3 * i), (3, 3)).trace() / 3.0;
        ratios.push(sigmas[i].powi(2) / exact);
    }
    // A mean of 48 squares, of which the three of a draw have a common cause: a quarter off is common, twice is not.
    let mean = ratios.iter().sum::<f64>() / n as f64;
    assert!((mean - 1.0).abs() < 0.15, "{mean}");
    assert!(
        ratios.iter().all(|r| (0.4..2.0).contains(r)),
        "{ratios:.2?}"
    );
}

#[test]
fn marginals_are_the_diagonal_of_the_dense_inverse() {
    for count in [1, 2, 30, 150] {
        let (rest, edges) = ellipsoid(count, [0.05, 0.04, 0.03], 5);
        // Nothing turns: the rotations are known.
        let options = Options::default().with_motion(Motion::Still);
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
