//! Slow, dense answers to compare with: textbook least squares and dense inverses.
#![allow(missing_docs, clippy::unwrap_used, reason = "tests")]

mod common;

use common::{Noise, dense_information, ellipsoid, sheet};
use nalgebra::{DMatrix, DVector, Point3, Rotation3, Vector3};
use topo_ekf::{Filter, Frame, Observation, Options};

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
