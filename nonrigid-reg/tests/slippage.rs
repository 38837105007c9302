//! Surfaces that can slide on themselves are recognised at any noise, and only these.
#![allow(missing_docs, clippy::unwrap_used, reason = "a test may panic")]

use nalgebra::{Point3, UnitVector3, Vector3};
use nonrigid_reg::{Cloud, Landmark, Options, Registration, Status, estimate_normals, register};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;

/// 2,000 points drawn on a surface of some 0.15 m and seen by a camera 0.5 m above it.
#[derive(Debug, Clone, Copy)]
enum Surface {
    Plane,
    Hemisphere,
    /// Upper half of a cylinder.
    Pipe,
    /// Body of revolution that is no sphere.
    Egg,
    /// Ellipsoid with three different axes.
    Ellipsoid,
    /// A plane with waves of so many mm, 0.1 m long.
    Waves(f64),
}

impl Surface {
    fn points(self, noise: f64, seed: u64) -> Vec<Point3<f64>> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut dome = |axes: [f64; 3]| {
            let (z, angle) = (rng.random::<f64>(), rng.random_range(0.0..TAU));
            let s = (1.0 - z * z).sqrt();
            Point3::new(
                axes[0] * s * angle.cos(),
                axes[1] * s * angle.sin(),
                axes[2] * z,
            )
        };
        let exact: Vec<Point3<f64>> = match self {
            Self::Hemisphere => (0..2000).map(|_| dome([0.06; 3])).collect(),
            Self::Egg => (0..2000).map(|_| dome([0.09, 0.05, 0.05])).collect(),
            Self::Ellipsoid => (0..2000).map(|_| dome([0.09, 0.06, 0.04])).collect(),
            _ => (0..2000)
                .map(|_| {
                    let (x, t) = (rng.random_range(-0.075..0.075), rng.random::<f64>());
                    match self {
                        Self::Pipe => {
                            let (sin, cos) = (0.5 * TAU * t).sin_cos();
                            Point3::new(x, 0.04 * cos, 0.04 * sin)
                        }
                        Self::Waves(mm) => {
                            let y = 0.15 * t - 0.075;
                            let wave = (TAU * x / 0.1).sin() * (TAU * y / 0.1).cos();
                            Point3::new(x, y, 1e-3 * mm * wave)
                        }
                        _ => Point3::new(x, 0.15 * t - 0.075, 0.0),
                    }
                })
                .collect(),
        };
        let mut jitter = || Vector3::from_fn(|_, _| noise * gaussian(&mut rng));
        exact.into_iter().map(|p| p + jitter()).collect()
    }
}

fn gaussian(rng: &mut ChaCha8Rng) -> f64 {
    (-2.0 * (1.0 - rng.random::<f64>()).ln()).sqrt() * (TAU * rng.random::<f64>()).cos()
}

/// Two samples, the second one shifted.
fn slide(surface: Surface, shift: Vector3<f64>, noise: f64, seed: u64) -> Registration {
    let camera = Point3::new(0.0, 0.0, 0.5);
    let before = surface.points(noise, seed);
    let after: Vec<Point3<f64>> = surface
        .points(noise, seed + 1000)
        .iter()
        .map(|p| p + shift)
        .collect();
    let [normals, normals_after]: [Vec<UnitVector3<f64>>; 2] =
        [&before, &after].map(|points| estimate_normals(points, 16, &camera).unwrap());
    let source = Cloud {
        points: &before,
        normals: &normals,
    };
    let target = Cloud {
        points: &after,
        normals: &normals_after,
    };
    register(&source, &target, &[], &[], &Options::default()).unwrap()
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

#[test]
fn what_slides_is_undetermined_at_any_noise() {
    let shift = Vector3::new(0.005, 0.0, 0.0);
    for (surface, free_motions) in [
        (Surface::Plane, 3),
        (Surface::Hemisphere, 3),
        (Surface::Pipe, 2),
        (Surface::Egg, 1),
    ] {
        for (seed, noise) in [0.0, 2e-4, 5e-4].into_iter().enumerate() {
            let found = slide(surface, shift, noise, seed as u64);
            let status = found.status;
            assert_eq!(
                status,
                Status::Undetermined { free_motions },
                "{surface:?} {noise}"
            );
            // An egg that rolls about its axis keeps its place there.
            let most = if free_motions == 1 { 0.4 } else { 0.01 };
            assert!(mean(&found.confidence) < most, "{surface:?} {noise}");
        }
    }
}

#[test]
fn what_relief_holds_is_believed_as_far_as_it_stands_out_of_the_noise() {
    let shift = Vector3::new(0.005, 0.0, 0.0);
    let found = |surface, noise| {
        let found = slide(surface, shift, noise, 7);
        let undetermined = matches!(found.status, Status::Undetermined { .. });
        (undetermined, mean(&found.confidence))
    };
    for noise in [0.0, 2e-4, 5e-4] {
        for surface in [Surface::Ellipsoid, Surface::Waves(4.0)] {
            let (undetermined, confidence) = found(surface, noise);
            assert!(
                !undetermined && confidence > 0.2,
                "{surface:?} {noise} {confidence}"
            );
        }
        assert!(found(Surface::Waves(0.5), noise).0);
    }
    let [high, low] = [4.0, 2.0].map(|mm| found(Surface::Waves(mm), 2e-4).1);
    assert!(high > low + 0.05, "{high} {low}");
}

/// A plane held in one place has confidence there, and none far from it, where it is free to rotate.
#[test]
fn a_grip_is_believed_and_what_turns_about_it_is_not() {
    let points = Surface::Plane.points(2e-4, 1);
    let normals = estimate_normals(&points, 16, &Point3::new(0.0, 0.0, 0.5)).unwrap();
    let cloud = Cloud {
        points: &points,
        normals: &normals,
    };
    let corner = Point3::new(-0.075, -0.075, 0.0);
    let grip = Landmark {
        source: corner,
        target: corner,
        sigma: 0.0,
    };
    let found = register(&cloud, &cloud, &[grip], &[], &Options::default()).unwrap();
    assert_eq!(found.status, Status::Undetermined { free_motions: 1 });
    let at = |p: Point3<f64>| {
        let nearest = (0..points.len())
            .min_by(|&a, &b| (points[a] - p).norm().total_cmp(&(points[b] - p).norm()));
        found.confidence[nearest.unwrap()]
    };
    let [near, far] = [corner, -corner].map(at);
    assert!(near > 0.5 && far < 0.2, "{near} {far}");
}

#[test]
fn millimetres_are_suspected() {
    let points: Vec<_> = Surface::Ellipsoid
        .points(0.0, 1)
        .iter()
        .map(|p| p * 1000.0)
        .collect();
    let normals = estimate_normals(&points, 16, &Point3::new(0.0, 0.0, 500.0)).unwrap();
    let cloud = Cloud {
        points: &points,
        normals: &normals,
    };
    let error = register(&cloud, &cloud, &[], &[], &Options::default()).unwrap_err();
    assert!(error.to_string().contains("millimetres"), "{error}");
}
