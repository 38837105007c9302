//! The linear filter equals the textbook Kalman filter, and its covariances are consistent with noise drawn from its own model.
#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test may say what it measured"
)]

mod common;

use common::{Noise, dense_information, ellipsoid, sheet, turned};
use nalgebra::{DMatrix, DVector, Point3, Rotation3, UnitVector3, Vector3};
use proptest::prelude::*;
use topo_ekf::{Consistency, Filter, Frame, Motion, Observation, Options, Plane, Verdict};

/// A Kalman filter in covariance form, one coordinate at a time, as in any textbook.
struct Textbook {
    mean: [DVector<f64>; 3],
    covariance: DMatrix<f64>,
}

impl Textbook {
    fn new(rest: &[Point3<f64>], covariance: DMatrix<f64>) -> Self {
        let along = |axis: usize| DVector::from_iterator(rest.len(), rest.iter().map(|p| p[axis]));
        Self {
            mean: [along(0), along(1), along(2)],
            covariance,
        }
    }

    fn predict(&mut self, q: f64) {
        for i in 0..self.covariance.nrows() {
            self.covariance[(i, i)] += q;
        }
    }

    /// Returns the normalised innovation squared.
    fn update(&mut self, seen: &[Observation]) -> f64 {
        let (n, m) = (self.covariance.nrows(), seen.len());
        let h = DMatrix::from_fn(m, n, |r, c| f64::from(seen[r].vertex as usize == c));
        let r = DMatrix::from_diagonal(&DVector::from_fn(m, |k, _| seen[k].sigma.powi(2)));
        let s = (&h * &self.covariance * h.transpose() + r)
            .try_inverse()
            .unwrap();
        let gain = &self.covariance * h.transpose() * &s;
        let mut nis = 0.0;
        for axis in 0..3 {
            let z = DVector::from_fn(m, |k, _| seen[k].position[axis]);
            let innovation = z - &h * &self.mean[axis];
            nis += innovation.dot(&(&s * &innovation));
            self.mean[axis] += &gain * innovation;
        }
        self.covariance = (DMatrix::identity(n, n) - gain * h) * &self.covariance;
        nis
    }
}

fn still() -> Options {
    // The anchor is a numerical prop; a kilometre takes it out of the comparison.
    Options::default()
        .with_motion(Motion::Still)
        .with_anchor_sigma(1e3)
}

fn some(points: &[Point3<f64>], share: f64, noise: &mut Noise) -> Vec<Observation> {
    let mut seen = vec![];
    for (i, p) in points.iter().enumerate() {
        if noise.uniform() < share {
            // Every fifth is held by a grip.
            let sigma = if i % 5 == 0 { 1e-5 } else { 5e-4 };
            seen.push(Observation {
                vertex: i as u32,
                position: p + noise.vector(sigma),
                sigma,
            });
        }
    }
    seen
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn the_linear_filter_is_the_textbook_kalman_filter(
        seed in any::<u64>(),
        shares in prop::collection::vec(0.1..0.9f64, 1..6),
        edge_sigma in 1e-4..3e-3f64,
    ) {
        let (rest, edges, _) = sheet(5, 5e-3);
        let options = still().with_process_noise(0.0).with_edge_sigma(edge_sigma);
        let mut filter = Filter::new(&rest, &edges, &options).unwrap();
        let prior = dense_information(filter.information(), &edges, &options);
        let mut textbook = Textbook::new(&rest, prior.try_inverse().unwrap());
        let mut noise = Noise(seed);
        let truth: Vec<_> = rest.iter().map(|p| p + noise.vector(1e-3)).collect();
        for share in shares {
            let seen = some(&truth, share, &mut noise);
            filter.step(&Frame::new(&seen)).unwrap();
            let nis = textbook.update(&seen);
            let sigmas = filter.marginal_sigmas().unwrap();
            for i in 0..rest.len() {
                for axis in 0..3 {
                    prop_assert!((filter.live()[i][axis] - textbook.mean[axis][i]).abs() < 1e-9);
                }
                prop_assert!((sigmas[i] - textbook.covariance[(i, i)].sqrt()).abs() < 1e-9);
            }
            let found = filter.innovation_statistic().unwrap().unwrap();
            prop_assert_eq!(found.degrees, 3 * seen.len());
            prop_assert!((found.squared - nis).abs() < 1e-6 * (1.0 + nis), "{} {}", found.squared, nis);
            let nees: f64 = (0..3).map(|axis| {
                let e = DVector::from_fn(rest.len(), |i, _| textbook.mean[axis][i] - truth[i][axis]);
                e.dot(&textbook.covariance.clone().lu().solve(&e).unwrap())
            }).sum();
            let found = filter.error_statistic(&truth).unwrap();
            prop_assert!((found.squared - nees).abs() < 1e-6 * (1.0 + nees), "{} {}", found.squared, nees);
        }
    }

    #[test]
    fn free_vertices_walk_as_in_the_textbook(seed in any::<u64>(), dts in prop::collection::vec(0.0..3.0f64, 1..6)) {
        let (rest, _, _) = sheet(3, 5e-3);
        let options = still();
        let mut filter = Filter::new(&rest, &[], &options).unwrap();
        let prior = DMatrix::from_diagonal_element(9, 9, options.initial_sigma.powi(2));
        let mut textbook = Textbook::new(&rest, prior);
        let mut noise = Noise(seed);
        for dt in dts {
            let seen = some(&rest, 0.5, &mut noise);
            filter.step(&Frame::new(&seen).with_dt_frames(dt)).unwrap();
            textbook.predict(options.process_noise.powi(2) * dt);
            textbook.update(&seen);
            for i in 0..9 {
                for axis in 0..3 {
                    prop_assert!((filter.live()[i][axis] - textbook.mean[axis][i]).abs() < 1e-9);
                }
            }
        }
    }

    #[test]
    fn the_covariance_is_symmetric_and_positive(seed in any::<u64>(), stiffness in 0.0..100.0f64) {
        // Column by column: what one exact extra observation of vertex j moves is proportional to column j of the covariance.
        let (rest, edges, _) = sheet(4, 5e-3);
        let mut noise = Noise(seed);
        let seen = some(&rest, 0.4, &mut noise);
        let n = rest.len();
        let options = still().with_process_noise(0.0);
        let column = |j: usize| {
            let mut filter = Filter::new(&rest, &edges, &options).unwrap();
            filter.set_stiffness(&vec![stiffness; edges.len()]).unwrap();
            filter.step(&Frame::new(&seen)).unwrap();
            let sigma = filter.marginal_sigmas().unwrap()[j];
            let before = filter.live().to_vec();
            let pulled = before[j] + Vector3::x() * 1e-3;
            let observation = Observation { vertex: j as u32, position: pulled, sigma: 1e-3 };
            filter.step(&Frame::new(&[observation])).unwrap();
            // x moves by P e_j (P_jj + R)⁻¹ · 1 mm.
            let scale = (sigma.powi(2) + 1e-6) / 1e-3;
            (0..n).map(|i| (filter.live()[i].x - before[i].x) * scale).collect::<Vec<_>>()
        };
        let covariance = DMatrix::from_fn(n, n, |_, _| 0.0);
        let covariance = (0..n).fold(covariance, |mut c, j| { c.set_column(j, &DVector::from_vec(column(j))); c });
        let size = covariance.amax();
        prop_assert!((&covariance - covariance.transpose()).amax() < 1e-8 * size);
        let symmetric = (&covariance + covariance.transpose()) * 0.5;
        prop_assert!(symmetric.cholesky().is_some());
    }
}

/// A shape drawn from the filter's prior around the rest shape.
fn drawn(rest: &[Point3<f64>], information: &DMatrix<f64>, noise: &mut Noise) -> Vec<Point3<f64>> {
    let factor = information.clone().cholesky().unwrap();
    let mut points = rest.to_vec();
    for axis in 0..3 {
        let white = DVector::from_fn(rest.len(), |_, _| noise.normal());
        let shift = factor
            .l()
            .transpose()
            .solve_upper_triangular(&white)
            .unwrap();
        for (p, s) in points.iter_mut().zip(shift.iter()) {
            p[axis] += s;
        }
    }
    points
}

/// Statistics of forty runs of five frames on noise `lie` times as large as the filter is told.
fn simulated(lie: f64) -> (Consistency, Consistency) {
    let (rest, edges, _) = sheet(7, 5e-3);
    let options = still().with_process_noise(0.0);
    let prior = Filter::new(&rest, &edges, &options).unwrap();
    let prior = dense_information(prior.information(), &edges, &options);
    let mut total: Option<(Consistency, Consistency)> = None;
    for seed in 0..40 {
        let mut noise = Noise(1000 + seed);
        let truth = drawn(&rest, &prior, &mut noise);
        let mut filter = Filter::new(&rest, &edges, &options).unwrap();
        let mut innovations: Option<Consistency> = None;
        for _ in 0..5 {
            let seen: Vec<_> = (0..25)
                .map(|i| Observation {
                    vertex: i,
                    position: truth[i as usize] + noise.vector(5e-4 * lie),
                    sigma: 5e-4,
                })
                .collect();
            filter.step(&Frame::new(&seen)).unwrap();
            let one = filter.innovation_statistic().unwrap().unwrap();
            innovations = Some(innovations.map_or(one, |sum| sum.and(one)));
        }
        let errors = filter.error_statistic(&truth).unwrap();
        let pair = (innovations.unwrap(), errors);
        total = Some(total.map_or(pair, |(a, b)| (a.and(pair.0), b.and(pair.1))));
    }
    total.unwrap()
}

#[test]
fn normalised_errors_lie_in_their_band_on_simulated_noise() {
    let (innovation, error) = simulated(1.0);
    println!(
        "innovation {} {:?}, error {} {:?}",
        innovation.mean(),
        innovation.band(),
        error.mean(),
        error.band()
    );
    assert_eq!(innovation.verdict(), Verdict::Consistent);
    assert_eq!(error.verdict(), Verdict::Consistent);
}

#[test]
fn a_wrong_sigma_shows() {
    // Noise twice as large, half as large as the filter is told.
    let (large, _) = simulated(2.0);
    let (small, _) = simulated(0.5);
    assert_eq!(large.verdict(), Verdict::Overconfident);
    assert_eq!(small.verdict(), Verdict::Conservative);
}

#[test]
fn residuals_are_normal_and_an_outlier_stands_out() {
    let (rest, edges, _) = sheet(12, 5e-3);
    let mut filter = Filter::new(&rest, &edges, &still()).unwrap();
    let mut noise = Noise(8);
    let mut squares = 0.0;
    for frame in 0..20 {
        let mut seen: Vec<_> = (0..rest.len() as u32)
            .map(|vertex| Observation {
                vertex,
                position: rest[vertex as usize] + noise.vector(5e-4),
                sigma: 5e-4,
            })
            .collect();
        if frame == 19 {
            seen[40].position.z += 5e-3;
        }
        filter.step(&Frame::new(&seen)).unwrap();
        let residuals = filter.normalised_residuals(&seen).unwrap();
        if frame == 19 {
            assert!(residuals[40] > 4.0, "{}", residuals[40]);
            assert!(
                residuals
                    .iter()
                    .enumerate()
                    .all(|(i, r)| i == 40 || *r < 4.0)
            );
        } else {
            squares += residuals.iter().map(|r| r * r).sum::<f64>();
        }
    }
    // The shape at rest is exact here, so the prior's share is missing from the residuals: below 1, and not far below.
    let mean = squares / (19.0 * rest.len() as f64);
    println!("mean square residual {mean}");
    assert!((0.8..1.02).contains(&mean), "{mean}");
}

#[test]
fn projection_never_worsens_the_normalised_error() {
    // The truth keeps the constraint, and the projection onto a convex set comes nearer to each of its points.
    let (rest, edges, _) = sheet(6, 5e-3);
    let table = [Plane {
        normal: UnitVector3::new_unchecked(Vector3::z()),
        offset: 0.0,
    }];
    let mut bettered = 0;
    for seed in 0..20 {
        let mut noise = Noise(seed);
        let truth: Vec<_> = rest
            .iter()
            .map(|p| p + Vector3::z() * noise.uniform() * 5e-5)
            .collect();
        let seen = some(&truth, 0.5, &mut noise);
        let run = |planes: &[Plane]| {
            let mut filter = Filter::new(&rest, &edges, &still()).unwrap();
            filter.step(&Frame::new(&seen).with_planes(planes)).unwrap();
            filter.error_statistic(&truth).unwrap().squared
        };
        let (free, held) = (run(&[]), run(&table));
        assert!(held <= free, "{held} {free}");
        bettered += usize::from(held < free);
    }
    assert!(bettered > 10, "{bettered}");
}

#[test]
fn a_turning_body_with_a_drawn_shape() {
    // The nonlinear case: what the statistics are worth when the motion itself is estimated from the observations.
    let (rest, edges) = ellipsoid(200, [0.05, 0.04, 0.03], 6);
    let options = Options::default();
    let prior = Filter::new(&rest, &edges, &options).unwrap();
    let prior = dense_information(prior.information(), &edges, &options);
    let mut sums: Option<(Consistency, Consistency)> = None;
    for seed in 0..6 {
        let mut noise = Noise(77 + seed);
        let shape = drawn(&rest, &prior, &mut noise);
        let mut filter = Filter::new(&rest, &edges, &options).unwrap();
        for frame in 1..=20 {
            let turn = Rotation3::from_axis_angle(&Vector3::y_axis(), 0.03 * f64::from(frame));
            let truth = turned(&shape, &turn, &Vector3::zeros());
            let seen: Vec<_> = (0..rest.len())
                .filter(|&i| (turn * rest[i]).z > 0.0)
                .map(|i| Observation {
                    vertex: i as u32,
                    position: truth[i] + noise.vector(5e-4),
                    sigma: 5e-4,
                })
                .collect();
            filter.step(&Frame::new(&seen)).unwrap();
            let pair = (
                filter.innovation_statistic().unwrap().unwrap(),
                filter.error_statistic(&truth).unwrap(),
            );
            sums = Some(sums.map_or(pair, |(a, b)| (a.and(pair.0), b.and(pair.1))));
        }
    }
    let (innovation, error) = sums.unwrap();
    println!(
        "turning: innovation {:.3}, error {:.3} (1 is consistent)",
        innovation.mean(),
        error.mean()
    );
    assert!((0.3..1.2).contains(&innovation.mean()));
    assert!((0.3..1.5).contains(&error.mean()));
}
