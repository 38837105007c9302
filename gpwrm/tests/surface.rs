//! Surfaces by moving least squares: bias as derived, noise, layers, and errors for invalid input.
#![allow(missing_docs, clippy::unwrap_used)]

use gpwrm::Error;
use gpwrm::mls::{Surface, project, smooth, sphere_bias};
use nalgebra::{Point3, UnitVector3, Vector3};

/// Points on a sphere of radius `r` about the origin, and their normals.
fn sphere(count: usize, r: f64) -> (Vec<Point3<f64>>, Vec<UnitVector3<f64>>) {
    let golden = std::f64::consts::PI * (3.0 - 5_f64.sqrt());
    (0..count)
        .map(|k| {
            let z = 1.0 - (2.0 * k as f64 + 1.0) / count as f64;
            let (s, a) = ((1.0 - z * z).sqrt(), golden * k as f64);
            let n = Vector3::new(s * a.cos(), s * a.sin(), z);
            (Point3::from(n * r), UnitVector3::new_normalize(n))
        })
        .unzip()
}

/// Heights of the smoothed sphere over the true one: smallest, mean, largest.
fn heights(count: usize, r: f64, reach: f64) -> (f64, f64, f64) {
    let (points, normals) = sphere(count, r);
    let smoothed = smooth(&points, &normals, reach).unwrap();
    for (p, n) in smoothed.points.iter().zip(&smoothed.normals) {
        assert!(n.dot(&p.coords.normalize()) > 0.9999);
    }
    let all: Vec<f64> = smoothed
        .points
        .iter()
        .map(|p| p.coords.norm() - r)
        .collect();
    let mean = all.iter().sum::<f64>() / all.len() as f64;
    let fold = |f: fn(f64, f64) -> f64, from: f64| all.iter().copied().fold(from, f);
    (
        fold(f64::min, f64::INFINITY),
        mean,
        fold(f64::max, f64::NEG_INFINITY),
    )
}

/// The derivation of the module: a sphere grows by `917/261976 ρ⁴/r³`, and nowhere shrinks.
#[test]
fn a_sphere_keeps_its_size_to_the_analytic_bias() {
    let r = 0.05;
    for reach in [0.01, 0.014, 0.018] {
        // 12,000 points: 120 in the smallest reach, so that sums stand for the integrals to a few per cent.
        let (low, mean, high) = heights(12_000, r, reach);
        let bias = sphere_bias(reach, r);
        // The next order of the expansion is (ρ/r)² of the bias, with a factor of about one.
        let slack = 0.03 + (reach / r).powi(2);
        assert!((mean / bias - 1.0).abs() < slack, "{reach}: {mean} {bias}");
        assert!(
            low > 0.0 && high < (1.0 + 5.0 * slack) * bias,
            "{reach}: {low} {high}"
        );
    }
}

/// Smoothing again and again adds the bias again and again, outward: 12 µm after twenty passes over a sphere of 50 mm. A plane would
/// have taken 4 mm.
#[test]
fn smoothing_many_times_does_not_eat_a_sphere() {
    let (r, reach, passes) = (0.05, 0.012, 20);
    let (mut points, mut normals) = sphere(2000, r);
    for _ in 0..passes {
        let smoothed = smooth(&points, &normals, reach).unwrap();
        (points, normals) = (smoothed.points, smoothed.normals);
    }
    let expected = f64::from(passes) * sphere_bias(reach, r);
    for p in &points {
        // Sums over the 29 points in reach stand for the integrals to some per cent.
        let share = (p.coords.norm() - r) / expected;
        assert!((share - 1.0).abs() < 0.1, "{share}");
    }
}

#[test]
fn smoothing_removes_noise_and_merges_layers() {
    let r = 0.05;
    let (mut points, normals) = sphere(4000, r);
    for (k, p) in points.iter_mut().enumerate() {
        // Two layers, 1 mm apart, in an order that has nothing to do with position.
        *p *= 1.0 + if k % 2 == 0 { 0.01 } else { -0.01 };
    }
    let smoothed = smooth(&points, &normals, 0.01).unwrap();
    let off = |points: &[Point3<f64>]| {
        points
            .iter()
            .map(|p| (p.coords.norm() - r).abs())
            .sum::<f64>()
            / points.len() as f64
    };
    assert!(
        off(&smoothed.points) < 0.2 * off(&points),
        "{}",
        off(&smoothed.points)
    );
}

/// A quadratic is its own moving-least-squares surface, seen along its normal: a paraboloid at its apex, a plane everywhere.
#[test]
fn what_a_quadratic_can_be_is_kept() {
    let grid = |f: &dyn Fn(f64, f64) -> f64| -> Vec<Point3<f64>> {
        (0..441)
            .map(|k| {
                (
                    f64::from(k % 21) * 0.001 - 0.01,
                    f64::from(k / 21) * 0.001 - 0.01,
                )
            })
            .map(|(x, y)| Point3::new(x, y, f(x, y)))
            .collect()
    };
    let apex = grid(&|x, y| 20.0 * x * x - 8.0 * y * y);
    let up = vec![Vector3::z_axis(); apex.len()];
    let foot = project(&Point3::new(0.0, 0.0, 0.001), &apex, &up, 0.006).unwrap();
    // The damping of 1e-9 takes 1e-9 of a curvature that lifts the rim by 0.7 mm.
    assert!(foot.point.coords.norm() < 1e-11, "{}", foot.point);
    assert!((foot.normal.z - 1.0).abs() < 1e-9);
}

#[test]
fn projection_is_idempotent_and_says_when_it_has_no_support() {
    let (points, normals) = sphere(1500, 0.05);
    let q = Point3::new(0.03, 0.03, 0.03);
    let once = project(&q, &points, &normals, 0.012).unwrap();
    let twice = project(&once.point, &points, &normals, 0.012).unwrap();
    assert!((once.point - twice.point).norm() < 1e-9);
    let far = project(&Point3::origin(), &points, &normals, 0.012);
    assert_eq!(
        far,
        Err(Error::Unsupported {
            index: 0,
            radius: 0.012
        })
    );
}

#[test]
fn wrong_input_is_named() {
    let (mut points, normals) = sphere(100, 0.05);
    assert_eq!(smooth(&[], &[], 0.01), Err(Error::NoNodes));
    assert!(matches!(
        smooth(&points, &normals[1..], 0.01),
        Err(Error::LengthMismatch {
            expected: 100,
            found: 99,
            ..
        })
    ));
    for radius in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(matches!(
            smooth(&points, &normals, radius),
            Err(Error::BadOption {
                option: "radius",
                ..
            })
        ));
    }
    let surface = Surface::new(&points, &normals, 0.02).unwrap();
    assert!(matches!(
        surface.project(&Point3::new(0.0, f64::NAN, 0.0)),
        Err(Error::BadCoordinate {
            what: "query",
            index: 0,
            ..
        })
    ));
    points[3].x = f64::NEG_INFINITY;
    assert!(matches!(
        smooth(&points, &normals, 0.02),
        Err(Error::BadCoordinate {
            what: "point",
            index: 3,
            ..
        })
    ));
    // One point, points in a line, all on one spot: no quadratic, and an answer all the same.
    let up = vec![Vector3::z_axis(); 12];
    let line: Vec<_> = (0..12)
        .map(|k| Point3::new(0.001 * f64::from(k), 0.0, 0.0))
        .collect();
    for cloud in [&line[..1], &line[..], &vec![Point3::origin(); 12][..]] {
        let foot = project(
            &Point3::new(0.0, 0.0, 0.002),
            cloud,
            &up[..cloud.len()],
            0.01,
        )
        .unwrap();
        assert!(foot.point.z.abs() < 1e-9, "{}", foot.point);
    }
}
