//! Calibration: planted transforms are found, noise averages out, what cannot be fitted is refused, files come
//! back to the bit.
#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::float_cmp,
    reason = "tests; copied values must be the same bits"
)]

use std::f64::consts::TAU;

use dvrk_io::calibration::{
    Calibration, CheckOptions, Fit, FitOptions, Method, Sighting, Touch, Verdict, fit_sightings,
    fit_touches,
};
use dvrk_io::kinematics::{Kinematics, RcmFromWrist};
use dvrk_io::{Error, Psm};
use nalgebra::{Isometry3, Point3, Quaternion, Translation3, UnitQuaternion, Vector3};
use proptest::prelude::*;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Standard normal, Box–Muller.
fn normal(random: &mut ChaCha8Rng) -> f64 {
    let (u, v): (f64, f64) = (
        random.random_range(f64::MIN_POSITIVE..1.0),
        random.random_range(0.0..TAU),
    );
    (-2.0 * u.ln()).sqrt() * v.cos()
}

fn normals(random: &mut ChaCha8Rng) -> Vector3<f64> {
    Vector3::from_fn(|_, _| normal(random))
}

fn any_transform(random: &mut ChaCha8Rng) -> Isometry3<f64> {
    let turn = UnitQuaternion::new_normalize(Quaternion::from_vector(nalgebra::Vector4::from_fn(
        |_, _| normal(random),
    )));
    Isometry3::from_parts((0.3 * normals(random)).into(), turn)
}

/// Touches all over the workspace of a Classic.
fn touches(
    random: &mut ChaCha8Rng,
    planted: &Isometry3<f64>,
    count: usize,
    noise: f64,
) -> Vec<Touch> {
    (0..count)
        .map(|_| {
            let rcm = Point3::new(
                random.random_range(-0.08..0.08),
                random.random_range(-0.08..0.08),
                random.random_range(-0.2..-0.1),
            );
            Touch {
                camera: planted * rcm + noise * normals(random),
                rcm,
            }
        })
        .collect()
}

/// Sightings from joint values all over the workspace, noise in place (m) and orientation (rad).
fn sightings(
    random: &mut ChaCha8Rng,
    planted: &[Isometry3<f64>; 2],
    count: usize,
    noise: [f64; 2],
) -> Vec<Sighting> {
    let arm = Kinematics::new(Psm::Classic);
    let [camera_from_rcm, wrist_from_marker] = planted;
    (0..count)
        .map(|_| {
            let mut share = |range: f64| random.random_range(-range..range);
            let joints = [
                share(0.5),
                share(0.5),
                0.14 + share(0.05),
                share(1.0),
                share(0.8),
                share(0.8),
            ];
            let rcm_from_wrist = arm.rcm_from_wrist(&joints).unwrap();
            let exact = camera_from_rcm * rcm_from_wrist.0 * wrist_from_marker;
            let turn =
                UnitQuaternion::from_scaled_axis(noise[1] * normals(random)) * exact.rotation;
            let shift = exact.translation.vector + noise[0] * normals(random);
            Sighting {
                camera_from_marker: Isometry3::from_parts(shift.into(), turn),
                rcm_from_wrist,
            }
        })
        .collect()
}

/// Distance of the places where two transforms put the middle of the workspace, and the angle between them.
fn gap(left: &Isometry3<f64>, right: &Isometry3<f64>) -> (f64, f64) {
    let middle = Point3::new(0.0, 0.0, -0.15);
    (
        (left * middle - right * middle).norm(),
        left.rotation.angle_to(&right.rotation),
    )
}

fn fit_of_touches() -> Fit {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let planted = any_transform(&mut random);
    let samples = touches(&mut random, &planted, 12, 5e-4);
    fit_touches(&samples, &FitOptions::default()).unwrap()
}

fn fit_of_sightings() -> Fit {
    let mut random = ChaCha8Rng::seed_from_u64(2);
    let planted = [any_transform(&mut random), any_transform(&mut random)];
    let samples = sightings(&mut random, &planted, 12, [5e-4, 5e-3]);
    fit_sightings(&samples, &FitOptions::default()).unwrap()
}

#[test]
fn error_of_touches_falls_with_the_root_of_their_number() {
    let mut random = ChaCha8Rng::seed_from_u64(3);
    let noise = 1e-3;
    // The place of the middle is found to σ·√(3/n); the mean of a normal vector's length is 0.92 of its root
    // mean square, and turns about the middle add a little.
    let mut mean = |count: usize| {
        let errors = (0..100).map(|_| {
            let planted = any_transform(&mut random);
            let samples = touches(&mut random, &planted, count, noise);
            let fit = fit_touches(&samples, &FitOptions::default()).unwrap();
            gap(&fit.camera_from_rcm, &planted).0
        });
        errors.sum::<f64>() / 100.0
    };
    let (few, many) = (mean(8), mean(128));
    for (error, count) in [(few, 8.0_f64), (many, 128.0)] {
        let expected = noise * (3.0 / count).sqrt() * 0.92;
        assert!(
            (0.8..1.3).contains(&(error / expected)),
            "{error} {expected}"
        );
    }
    // √16 = 4.
    assert!((3.2..5.0).contains(&(few / many)), "{few} {many}");
}

#[test]
fn error_of_sightings_falls_with_the_root_of_their_number() {
    let mut random = ChaCha8Rng::seed_from_u64(4);
    let mut mean = |count: usize| {
        let errors = (0..20).map(|_| {
            let planted = [any_transform(&mut random), any_transform(&mut random)];
            let samples = sightings(&mut random, &planted, count, [1e-3, 1e-2]);
            let fit = fit_sightings(&samples, &FitOptions::default()).unwrap();
            gap(&fit.camera_from_rcm, &planted[0])
        });
        let (places, angles): (Vec<f64>, Vec<f64>) = errors.unzip();
        (
            places.iter().sum::<f64>() / 20.0,
            angles.iter().sum::<f64>() / 20.0,
        )
    };
    let (few, many) = (mean(8), mean(128));
    assert!((2.5..6.5).contains(&(few.0 / many.0)), "{few:?} {many:?}");
    assert!((2.5..6.5).contains(&(few.1 / many.1)), "{few:?} {many:?}");
    assert!(many.0 < 1e-3 && many.1 < 5e-3, "{many:?}");
}

/// Least squares is stationary: no small change of the answer fits the samples better.
#[test]
fn nothing_nearby_fits_better() {
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let options = FitOptions::default().with_outlier_ratio(1e6);
    let planted = [any_transform(&mut random), any_transform(&mut random)];
    let (touched, seen) = (
        touches(&mut random, &planted[0], 10, 1e-3),
        sightings(&mut random, &planted, 10, [2e-3, 2e-2]),
    );
    let of_touches = |x: &Isometry3<f64>| -> f64 {
        touched
            .iter()
            .map(|touch| (touch.camera - x * touch.rcm).norm_squared())
            .sum()
    };
    let of_sightings = |x: &Isometry3<f64>, y: &Isometry3<f64>| -> f64 {
        let misfit = |sample: &Sighting| {
            let expected = x * sample.rcm_from_wrist.0 * y;
            let seen = &sample.camera_from_marker;
            let angle = expected.rotation.angle_to(&seen.rotation);
            (expected.translation.vector - seen.translation.vector).norm_squared()
                + (options.lever * angle).powi(2)
        };
        seen.iter().map(misfit).sum()
    };
    let x = fit_touches(&touched, &options).unwrap().camera_from_rcm;
    let both = fit_sightings(&seen, &options).unwrap();
    let (bx, by) = (both.camera_from_rcm, both.wrist_from_marker.unwrap());
    let (least, least_both) = (of_touches(&x), of_sightings(&bx, &by));
    for _ in 0..500 {
        let mut nudge = || {
            let turn = UnitQuaternion::from_scaled_axis(1e-4 * normals(&mut random));
            Isometry3::from_parts((1e-5 * normals(&mut random)).into(), turn)
        };
        assert!(of_touches(&(nudge() * x)) >= least);
        assert!(of_sightings(&(nudge() * bx), &(by * nudge())) >= least_both);
    }
}

#[test]
fn residuals_are_those_of_the_answer() {
    let mut random = ChaCha8Rng::seed_from_u64(6);
    let planted = any_transform(&mut random);
    let samples = touches(&mut random, &planted, 9, 1e-3);
    let fit = fit_touches(&samples, &FitOptions::default()).unwrap();
    let residuals = &fit.residuals;
    for (sample, &distance) in samples.iter().zip(&residuals.distances) {
        assert!(
            ((sample.camera - fit.camera_from_rcm * sample.rcm).norm() - distance).abs() < 1e-15
        );
    }
    assert!(residuals.outliers.is_empty() && residuals.angles.is_empty());
    let mean = residuals.distances.iter().map(|x| x * x).sum::<f64>() / 9.0;
    assert!((residuals.rms - mean.sqrt()).abs() < 1e-15);
    assert_eq!(
        residuals.max,
        residuals.distances.iter().copied().fold(0.0, f64::max)
    );
    // 3n − 6 degrees of freedom: the noise is found again.
    assert!(
        (0.5..1.6).contains(&((mean * 9.0 / 21.0).sqrt() / 1e-3)),
        "{mean}"
    );
}

#[test]
fn too_few_too_close_on_a_line() {
    let options = FitOptions::default();
    let mut random = ChaCha8Rng::seed_from_u64(7);
    let planted = any_transform(&mut random);
    let good = touches(&mut random, &planted, 20, 1e-4);
    assert!(matches!(
        fit_touches(&[], &options),
        Err(Error::TooFewSamples {
            given: 0,
            needed: 4
        })
    ));
    assert!(matches!(
        fit_touches(&good[..3], &options),
        Err(Error::TooFewSamples {
            given: 3,
            needed: 4
        })
    ));
    // Never fewer than three, whatever is asked for.
    let greedy = options.with_min_samples(0);
    assert!(matches!(
        fit_touches(&good[..2], &greedy),
        Err(Error::TooFewSamples { needed: 3, .. })
    ));
    let corner = |x, y| Point3::new(x, y, -0.15);
    let triangle = [corner(0.0, 0.0), corner(0.1, 0.0), corner(0.0, 0.1)];
    let fit = fit_touches(
        &triangle.map(|rcm| Touch {
            camera: planted * rcm,
            rcm,
        }),
        &greedy,
    )
    .unwrap();
    assert!(gap(&fit.camera_from_rcm, &planted).0 < 1e-12);

    let shaped = |shape: &dyn Fn(usize) -> Vector3<f64>| -> Vec<Touch> {
        let point = |i| Point3::from(Vector3::new(0.01, 0.02, -0.15) + shape(i));
        (0..20)
            .map(|i| Touch {
                camera: planted * point(i),
                rcm: point(i),
            })
            .collect()
    };
    let at = |i: usize| i as f64 / 20.0;
    let same = shaped(&|_| Vector3::zeros());
    let close = shaped(&|i| Vector3::new(at(i), at(i * 7 % 20), 0.0) * 0.01);
    let line = shaped(&|i| Vector3::new(0.1, 0.05, -0.02) * at(i));
    let plane = shaped(&|i| Vector3::new(at(i), at(i * 7 % 20), 0.0) * 0.1);
    let is_degenerate = |samples: &[Touch], of: &str| match fit_touches(samples, &options) {
        Err(Error::Degenerate {
            what,
            value,
            needed,
            ..
        }) => what.ends_with(of) && value < needed,
        _ => false,
    };
    assert!(is_degenerate(&same, "touched points") && is_degenerate(&close, "touched points"));
    assert!(is_degenerate(&line, "best line"));
    let fit = fit_touches(&plane, &options).unwrap();
    assert!(gap(&fit.camera_from_rcm, &planted).0 < 1e-12);

    // A line that only an outlier makes look wide.
    let mut bent = line.clone();
    bent[3].rcm += Vector3::new(0.0, 0.3, 0.2);
    assert!(fit_touches(&bent, &options).is_err());
    let message = fit_touches(&line, &options).unwrap_err().to_string();
    assert_eq!(
        message,
        "spread of the touched points across their best line is 0.0000 m, at least 0.0200 m is needed: \
         vary the poses more"
    );
}

#[test]
fn turning_about_one_axis_is_not_enough() {
    let options = FitOptions::default();
    let mut random = ChaCha8Rng::seed_from_u64(8);
    let planted = [any_transform(&mut random), any_transform(&mut random)];
    let mut seen = |turn: &dyn Fn(usize) -> Vector3<f64>| -> Vec<Sighting> {
        (0..12)
            .map(|i| {
                let place = 0.05 * normals(&mut random);
                let wrist =
                    Isometry3::from_parts(place.into(), UnitQuaternion::from_scaled_axis(turn(i)));
                Sighting {
                    camera_from_marker: planted[0] * wrist * planted[1],
                    rcm_from_wrist: RcmFromWrist(wrist),
                }
            })
            .collect()
    };
    let at = |i: usize| i as f64 / 6.0 - 1.0;
    let still = seen(&|_| Vector3::zeros());
    let one_axis = seen(&|i| Vector3::new(0.5, 0.2, -0.3) * at(i) * 3.0);
    let little = seen(&|i| Vector3::new(at(i), at(i * 5 % 12), 0.0) * 0.1);
    let two_axes = seen(&|i| Vector3::new(at(i), at(i * 5 % 12), 0.0) * 0.5);
    for samples in [still, one_axis, little] {
        let result = fit_sightings(&samples, &options);
        assert!(
            matches!(&result, Err(Error::Degenerate { what, value, .. })
                if *what == "turning of the wrist about a second axis" && *value < 0.17),
            "{result:?}"
        );
    }
    let fit = fit_sightings(&two_axes, &options).unwrap();
    assert!(gap(&fit.camera_from_rcm, &planted[0]).0 < 1e-10);
    assert!(fit_sightings(&two_axes[..2], &options).is_err());
}

#[test]
fn other_units_and_mirror_images() {
    let options = FitOptions::default();
    let mut random = ChaCha8Rng::seed_from_u64(9);
    let planted = [any_transform(&mut random), any_transform(&mut random)];
    let good = touches(&mut random, &planted[0], 12, 5e-4);
    let millimetres: Vec<Touch> = good
        .iter()
        .map(|t| Touch {
            camera: t.camera * 1e3,
            rcm: t.rcm,
        })
        .collect();
    let result = fit_touches(&millimetres, &options);
    assert!(
        matches!(result, Err(Error::ScaleMismatch { ratio }) if (900.0..1100.0).contains(&ratio))
    );
    let mirrored: Vec<Touch> = good
        .iter()
        .map(|t| Touch {
            camera: Point3::new(-t.camera.x, t.camera.y, t.camera.z),
            rcm: t.rcm,
        })
        .collect();
    assert!(matches!(
        fit_touches(&mirrored, &options),
        Err(Error::Mirrored)
    ));
    let seen = sightings(&mut random, &planted, 12, [5e-4, 5e-3]);
    let millimetres: Vec<Sighting> = seen
        .iter()
        .map(|s| {
            let mut far = *s;
            far.camera_from_marker.translation.vector *= 1e3;
            far
        })
        .collect();
    let result = fit_sightings(&millimetres, &options);
    assert!(
        matches!(result, Err(Error::ScaleMismatch { ratio }) if (900.0..1100.0).contains(&ratio)),
        "{result:?}"
    );
}

/// The marker moves twenty times as far as the wrist: this is no matter of units.
#[test]
fn a_marker_on_a_long_stick() {
    let mut random = ChaCha8Rng::seed_from_u64(18);
    let planted = [
        any_transform(&mut random),
        Isometry3::translation(0.0, 2.0, 1.0),
    ];
    let seen = sightings(&mut random, &planted, 12, [0.0; 2]);
    let fit = fit_sightings(&seen, &FitOptions::default()).unwrap();
    assert!(gap(&fit.camera_from_rcm, &planted[0]).0 < 1e-10);
    // A wrist that turns on the spot tells nothing of units.
    let spot: Vec<Sighting> = seen
        .iter()
        .map(|s| {
            let turn = Isometry3::from_parts(
                Translation3::new(0.0, 0.0, -0.1),
                s.rcm_from_wrist.0.rotation,
            );
            Sighting {
                camera_from_marker: planted[0] * turn * planted[1],
                rcm_from_wrist: RcmFromWrist(turn),
            }
        })
        .collect();
    assert!(fit_sightings(&spot, &FitOptions::default()).is_ok());
}

#[test]
fn numbers_that_are_none() {
    let options = FitOptions::default();
    let mut random = ChaCha8Rng::seed_from_u64(10);
    let planted = [any_transform(&mut random), any_transform(&mut random)];
    let calibration = Calibration::new("PSM1", "camera", "PSM1_base", &fit_of_sightings()).unwrap();
    for value in [f64::NAN, f64::INFINITY, -1e300] {
        let mut touched = touches(&mut random, &planted[0], 8, 0.0);
        touched[5].camera.y = value;
        assert!(matches!(
            fit_touches(&touched, &options),
            Err(Error::BadSample { index: 5, .. })
        ));
        let check = calibration.check_touches(&touched, &CheckOptions::default());
        assert!(matches!(check, Err(Error::BadSample { index: 5, .. })));
        let mut seen = sightings(&mut random, &planted, 8, [0.0; 2]);
        seen[3].rcm_from_wrist.0.translation.vector.z = value;
        assert!(matches!(
            fit_sightings(&seen, &options),
            Err(Error::BadSample { index: 3, .. })
        ));
        let check = calibration.check_sightings(&seen, &CheckOptions::default());
        assert!(matches!(check, Err(Error::BadSample { index: 3, .. })));
        let mut seen = sightings(&mut random, &planted, 8, [0.0; 2]);
        let quaternion = Quaternion::new(value, 0.0, 0.0, 0.0);
        seen[2].camera_from_marker.rotation = UnitQuaternion::new_unchecked(quaternion);
        assert!(matches!(
            fit_sightings(&seen, &options),
            Err(Error::BadSample { index: 2, .. })
        ));

        let good = touches(&mut random, &planted[0], 8, 0.0);
        for bad in [
            options.with_lever(value),
            options.with_min_spread(value),
            options.with_min_turning(value),
            options.with_outlier_floor(value),
            options.with_outlier_ratio(value),
        ] {
            assert!(matches!(
                fit_touches(&good, &bad),
                Err(Error::OutOfRange { .. })
            ));
        }
        for bad in [
            CheckOptions::default().with_limit(value),
            CheckOptions::default().with_angle_limit(value),
        ] {
            assert!(matches!(
                calibration.check_touches(&good, &bad),
                Err(Error::OutOfRange { .. })
            ));
        }
    }
}

#[test]
fn too_many_disagree() {
    let mut random = ChaCha8Rng::seed_from_u64(11);
    let planted = any_transform(&mut random);
    let mut samples = touches(&mut random, &planted, 20, 1e-4);
    for sample in &mut samples[..13] {
        sample.camera += 0.1 * normals(&mut random);
    }
    // Thirteen of twenty that point anywhere: no confident answer, whichever way it is refused.
    match fit_touches(&samples, &FitOptions::default()) {
        Err(Error::TooManyOutliers { .. } | Error::Degenerate { .. }) => {}
        Ok(fit) => assert!(fit.residuals.rms > 0.01, "{:?}", fit.residuals),
        Err(other) => panic!("{other}"),
    }
}

#[test]
fn the_verdict_is_a_share() {
    let mut random = ChaCha8Rng::seed_from_u64(12);
    let planted = [any_transform(&mut random), any_transform(&mut random)];
    let options = FitOptions::default();
    let fit = fit_sightings(
        &sightings(&mut random, &planted, 16, [2e-4, 2e-3]),
        &options,
    )
    .unwrap();
    let calibration = Calibration::new("PSM1", "camera", "PSM1_base", &fit).unwrap();
    let limits = CheckOptions::default();
    let fresh = touches(&mut random, &planted[0], 16, 5e-4);
    let verdict = |broken: usize| {
        let mut samples = fresh.clone();
        samples
            .iter_mut()
            .take(broken)
            .for_each(|sample| sample.camera.x += 0.02);
        let check = calibration.check_touches(&samples, &limits).unwrap();
        assert_eq!((check.within, check.options.limit), (16 - broken, 0.005));
        check.verdict
    };
    assert_eq!([0, 4].map(verdict), [Verdict::Holds; 2]);
    assert_eq!([5, 8].map(verdict), [Verdict::Doubtful; 2]);
    assert_eq!([9, 16].map(verdict), [Verdict::Broken; 2]);

    // A camera that was knocked: the bias says by how much.
    let knock = Vector3::new(0.0, 0.011, -0.004);
    let seen = sightings(&mut random, &planted, 9, [2e-4, 2e-3]);
    assert_eq!(
        calibration.check_sightings(&seen, &limits).unwrap().verdict,
        Verdict::Holds
    );
    let knocked: Vec<Sighting> = seen
        .iter()
        .map(|s| Sighting {
            camera_from_marker: Translation3::from(knock) * s.camera_from_marker,
            ..*s
        })
        .collect();
    let check = calibration.check_sightings(&knocked, &limits).unwrap();
    assert_eq!((check.verdict, check.within), (Verdict::Broken, 0));
    assert!((check.bias - knock).norm() < 1e-3 && check.max >= check.rms && check.rms > 0.01);
    // One that was only turned shows in the angles.
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.2);
    let turned: Vec<Sighting> = seen
        .iter()
        .map(|s| {
            let mut pose = s.camera_from_marker;
            pose.rotation = turn * pose.rotation;
            Sighting {
                camera_from_marker: pose,
                ..*s
            }
        })
        .collect();
    assert_eq!(
        calibration
            .check_sightings(&turned, &limits)
            .unwrap()
            .verdict,
        Verdict::Broken
    );
    assert!(matches!(
        calibration.check_touches(&fresh[..3], &limits),
        Err(Error::TooFewSamples {
            given: 3,
            needed: 4
        })
    ));
    let touched = Calibration::new("PSM1", "camera", "PSM1_base", &fit_of_touches()).unwrap();
    assert!(matches!(
        touched.check_sightings(&seen, &limits),
        Err(Error::NoMarker)
    ));
}

#[test]
fn the_wrist_given_for_the_tip_shows() {
    // The classic mistake: the robot's own pose, which is that of the wrist, for the touching tip.
    let mut random = ChaCha8Rng::seed_from_u64(13);
    let (arm, planted) = (Kinematics::new(Psm::Classic), any_transform(&mut random));
    let mut samples = |wrong: bool| -> Vec<Touch> {
        (0..12)
            .map(|_| {
                let mut share = |range: f64| random.random_range(-range..range);
                let joints = [
                    share(0.5),
                    share(0.5),
                    0.14 + share(0.05),
                    share(1.0),
                    share(1.2),
                    share(1.2),
                ];
                let tip = arm.rcm_from_tip(&joints).unwrap();
                let camera = planted * Point3::from(tip.0.translation.vector);
                let wrist = arm
                    .rcm_from_wrist(&joints)
                    .unwrap()
                    .0
                    .translation
                    .vector
                    .into();
                if wrong {
                    Touch { camera, rcm: wrist }
                } else {
                    Touch::new(camera, &tip)
                }
            })
            .collect()
    };
    let options = FitOptions::default();
    assert!(
        fit_touches(&samples(false), &options)
            .unwrap()
            .residuals
            .rms
            < 1e-12
    );
    assert!(fit_touches(&samples(true), &options).unwrap().residuals.rms > 2e-3);
}

#[test]
fn files_come_back_to_the_bit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("psm1.toml");
    for fit in [fit_of_touches(), fit_of_sightings()] {
        let calibration =
            Calibration::new("PSM1", "camera_depth_optical_frame", "PSM1_base", &fit).unwrap();
        calibration.save(&path).unwrap();
        let again = Calibration::load(&path).unwrap();
        let bits = |c: &Calibration| {
            let poses = [Some(c.camera_from_rcm), c.wrist_from_marker];
            let numbers = poses.into_iter().flatten().flat_map(|pose| {
                let turn: [f64; 4] = pose.rotation.coords.into();
                let shift: [f64; 3] = pose.translation.vector.into();
                turn.into_iter().chain(shift)
            });
            let all = numbers.chain([c.rms, c.max, c.rms_angle, c.max_angle]);
            all.map(f64::to_bits).collect::<Vec<u64>>()
        };
        assert_eq!(bits(&again), bits(&calibration));
        assert_eq!(again, calibration);
        // Text and all.
        assert_eq!(again.to_toml().unwrap(), calibration.to_toml().unwrap());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }
    assert!(matches!(
        Calibration::load(folder.path().join("none.toml")),
        Err(Error::Io { .. })
    ));
    assert!(matches!(
        Calibration::new("", "camera", "PSM1_base", &fit_of_touches()),
        Err(Error::BadCalibration { key, .. }) if key == "arm"
    ));
}

/// A file as a person would write it, and what happens to it.
const FILE: &str = r#"# Our cell.
format = "dvrk-io calibration"
version = 1
arm = "PSM1"
method = "touches"

[units]
length = "m"
angle = "rad"

[camera_from_rcm]
target = "camera"
source = "PSM1_base"
translation = [0.1, 0, 0.4]
quaternion_xyzw = [0.0, 0.7071, 0.0, 0.7071]

[residuals]
samples = 12
outliers = [5]
rms = 4e-4
max = 7e-4
rms_angle = 0
max_angle = 0
"#;

#[test]
fn a_file_by_hand() {
    let read = Calibration::from_toml(FILE.as_bytes()).unwrap();
    assert_eq!(
        (read.arm.as_str(), read.method, read.samples),
        ("PSM1", Method::Touches, 12)
    );
    assert_eq!(
        read.camera_from_rcm.translation.vector,
        Vector3::new(0.1, 0.0, 0.4)
    );
    assert!((read.camera_from_rcm.rotation.quaternion().norm() - 1.0).abs() < 1e-15);
    // The dVRK has x to the left and y up.
    let seen = read.dvrk_camera_from_rcm().translation.vector;
    assert!((seen - Vector3::new(-0.1, 0.0, 0.4)).norm() < 1e-15);
}

#[test]
fn bad_files_name_line_and_key() {
    let cases = [
        ("version = 1", "version = 2", 3, "version"),
        ("version = 1", "version = \"1\"", 3, "version"),
        ("version = 1", "verson = 1", 1, "file"),
        ("calibration\"", "session\"", 2, "format"),
        ("\"PSM1\"", "\"\"", 4, "arm"),
        ("\"touches\"", "\"guesses\"", 5, "method"),
        ("\"touches\"", "\"sightings\"", 5, "method"),
        ("\"m\"", "\"mm\"", 8, "length"),
        ("\"rad\"", "\"deg\"", 9, "angle"),
        ("target = \"camera\"", "target = 3", 12, "target"),
        ("[0.1, 0, 0.4]", "[0.1, nan, 0.4]", 14, "translation"),
        ("[0.1, 0, 0.4]", "[0.1, inf, 0.4]", 14, "translation"),
        ("[0.1, 0, 0.4]", "[0.1, 0.4]", 14, "translation"),
        (
            "[0.1, 0, 0.4]",
            "[\n  0.1,\n  \"a\",\n  0.4]",
            16,
            "translation",
        ),
        ("0.7071]", "0.9]", 15, "quaternion_xyzw"),
        ("0.7071]", "nan]", 15, "quaternion_xyzw"),
        ("[5]", "[12]", 19, "outliers"),
        ("[5]", "[5, 5]", 19, "outliers"),
        ("[5]", "[-5]", 19, "outliers"),
        ("rms = 4e-4", "rms = -1.0", 20, "rms"),
        ("max = 7e-4", "max = nan", 21, "max"),
        ("max_angle = 0", "max_angel = 0", 23, "max_angel"),
        ("arm = \"PSM1\"", "arm = \"PSM1", 4, "arm"),
        ("[residuals]", "[residuals", 17, "quaternion_xyzw"),
    ];
    for (old, new, line, key) in cases {
        assert!(FILE.contains(old), "{old}");
        let text = FILE.replacen(old, new, 1);
        match Calibration::from_toml(text.as_bytes()) {
            Err(Error::BadCalibration {
                line: at,
                key: named,
                reason,
            }) => {
                assert_eq!((at, named.as_str()), (line, key), "{new}: {reason}");
                assert!(!reason.is_empty());
            }
            other => panic!("{new}: {other:?}"),
        }
    }
    let message = Calibration::from_toml(
        FILE.replace("\"mm\"", "\"m\"")
            .replace("\"m\"", "\"mm\"")
            .as_bytes(),
    );
    assert_eq!(
        message.unwrap_err().to_string(),
        "calibration, line 8, `length`: must be \"m\""
    );
    let missing = FILE.replace("rms = 4e-4\n", "");
    let message = Calibration::from_toml(missing.as_bytes())
        .unwrap_err()
        .to_string();
    assert!(
        message.contains("residuals") && message.contains("rms"),
        "{message}"
    );
    let mut latin = FILE.as_bytes().to_vec();
    latin[40] = 0xe9;
    assert!(matches!(
        Calibration::from_toml(&latin),
        Err(Error::BadCalibration { line: 2, .. })
    ));
    let deep = format!("format = {}", "[".repeat(100_000));
    assert!(Calibration::from_toml(deep.as_bytes()).is_err());
}

proptest! {
    #[test]
    fn planted_touches(seed: u64, count in 4_usize..40, noise in 0.0..2e-3) {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let planted = any_transform(&mut random);
        let samples = touches(&mut random, &planted, count, noise);
        let fit = match fit_touches(&samples, &FitOptions::default()) {
            // Four at random may lie on a line.
            Err(Error::Degenerate { .. }) => return Ok(()),
            other => other?,
        };
        // Six standard deviations of a place, with the lever of few points: spread ≥ 2 cm, reach ≤ 12 cm.
        let bound = 6.0 * noise * (3.0 / count as f64).sqrt() * (1.0 + 0.12 / 0.02) + 1e-12;
        let (place, _) = gap(&fit.camera_from_rcm, &planted);
        prop_assert!(place <= bound, "{place} {bound}");
        prop_assert!(fit.residuals.rms <= 6.0 * noise + 1e-12);
        prop_assert_eq!(fit_touches(&samples, &FitOptions::default())?, fit);
    }

    /// Symmetry: moving the camera moves the answer, the order of the samples does not matter.
    #[test]
    fn camera_moved_and_samples_reversed(seed: u64, count in 6_usize..20) {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let (planted, moved) = (any_transform(&mut random), any_transform(&mut random));
        let samples = touches(&mut random, &planted, count, 1e-3);
        let other: Vec<Touch> = samples.iter().rev().map(|t| Touch { camera: moved * t.camera, rcm: t.rcm }).collect();
        // Few samples: all of them are tried alike, so that no outlier depends on their order.
        let options = FitOptions::default().with_outlier_ratio(1e3);
        let (Ok(one), Ok(two)) = (fit_touches(&samples, &options), fit_touches(&other, &options)) else { return Ok(()) };
        let (place, angle) = gap(&(moved * one.camera_from_rcm), &two.camera_from_rcm);
        prop_assert!(place < 1e-12 && angle < 1e-7, "{place} {angle}");
    }

    #[test]
    fn outliers_are_named(seed: u64, count in 12_usize..30, bad in 1_usize..4) {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let planted = any_transform(&mut random);
        let mut samples = touches(&mut random, &planted, count, 5e-4);
        let mut wrong: Vec<usize> = Vec::new();
        while wrong.len() < bad {
            let index = random.random_range(0..count);
            if !wrong.contains(&index) {
                wrong.push(index);
                let slip = normals(&mut random).normalize() * random.random_range(0.02..0.3);
                samples[index].camera += slip;
            }
        }
        wrong.sort_unstable();
        // Nine at random may lie nearly on a line (seed 17103614847905811906).
        let options = FitOptions::default().with_min_spread(0.005);
        let fit = fit_touches(&samples, &options)?;
        prop_assert_eq!(&fit.residuals.outliers, &wrong);
        // As if they had not been there.
        let without: Vec<Touch> = (0..count).filter(|i| !wrong.contains(i)).map(|i| samples[i]).collect();
        let clean = fit_touches(&without, &options)?;
        let (place, _) = gap(&fit.camera_from_rcm, &clean.camera_from_rcm);
        prop_assert!(place < 1e-12);
    }

    #[test]
    fn planted_sightings(seed: u64, count in 6_usize..20) {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let planted = [any_transform(&mut random), any_transform(&mut random)];
        let samples = sightings(&mut random, &planted, count, [0.0; 2]);
        // Six poses at random may turn by 0.16 rad only (seed 1016413523640332883).
        let fit = fit_sightings(&samples, &FitOptions::default().with_min_turning(0.05))?;
        let found = [fit.camera_from_rcm, fit.wrist_from_marker.unwrap()];
        for (found, planted) in found.iter().zip(&planted) {
            let (place, angle) = gap(found, planted);
            prop_assert!(place < 1e-9 && angle < 1e-7, "{place} {angle}");
        }
        prop_assert!(fit.residuals.outliers.is_empty() && fit.residuals.max < 1e-9);
    }

    #[test]
    fn outliers_among_sightings_are_named(seed: u64, count in 12_usize..24, bad in 1_usize..4, turned: bool) {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let planted = [any_transform(&mut random), any_transform(&mut random)];
        let mut samples = sightings(&mut random, &planted, count, [5e-4, 5e-3]);
        let wrong: Vec<usize> = (0..bad).map(|k| k * 4 + 1).collect();
        for &index in &wrong {
            let pose = &mut samples[index].camera_from_marker;
            if turned {
                // A marker whose pose flipped, as planar markers' do.
                pose.rotation *= UnitQuaternion::from_scaled_axis(normals(&mut random).normalize());
            } else {
                pose.translation.vector += normals(&mut random).normalize() * random.random_range(0.03..0.3);
            }
        }
        let fit = fit_sightings(&samples, &FitOptions::default())?;
        prop_assert_eq!(&fit.residuals.outliers, &wrong);
        let (place, angle) = gap(&fit.camera_from_rcm, &planted[0]);
        prop_assert!(place < 6e-3 && angle < 5e-2, "{place} {angle}");
    }

    #[test]
    fn any_numbers_come_back(
        shift in prop::array::uniform3(-1e5..1e5), turn in prop::array::uniform4(-1.0..1.0),
        small in -1e-300..1e-300, name in "[ -~]{1,20}", rms in 0.0..1e300,
    ) {
        let turn = Quaternion::new(turn[0], turn[1], turn[2], turn[3]);
        prop_assume!(turn.norm() > 0.01 && !name.trim().is_empty());
        let mut calibration = Calibration::new("PSM1", "camera", "PSM1_base", &fit_of_touches())?;
        let [x, y, _] = shift;
        let rotation = UnitQuaternion::new_normalize(turn);
        calibration.camera_from_rcm = Isometry3::from_parts(Translation3::new(x, y, small), rotation);
        (calibration.camera_frame, calibration.rms) = (name, rms);
        let again = Calibration::from_toml(calibration.to_toml()?.as_bytes())?;
        prop_assert_eq!(&again, &calibration);
        let [one, two] = [&again, &calibration].map(|c| c.camera_from_rcm.translation.z.to_bits());
        prop_assert_eq!(one, two);
    }

    #[test]
    fn any_bytes(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        let _ = Calibration::from_toml(&bytes);
    }

    /// A good file with bytes changed, cut or doubled.
    #[test]
    fn damaged_files(at in 0..FILE.len(), byte: u8, cut in 0..FILE.len(), doubled: bool) {
        let mut bytes = FILE.as_bytes().to_vec();
        bytes[at] = byte;
        if let Ok(read) = Calibration::from_toml(&bytes) {
            prop_assert!(read.camera_from_rcm.to_homogeneous().iter().all(|x| x.is_finite()));
        }
        prop_assert!(cut + 2 > FILE.len() || Calibration::from_toml(&FILE.as_bytes()[..cut]).is_err());
        if doubled {
            bytes.extend_from_slice(FILE.as_bytes());
            prop_assert!(Calibration::from_toml(&bytes).is_err());
        }
    }

    /// Any sightings at all, some with proper rotations.
    #[test]
    fn any_sightings(
        numbers in prop::collection::vec(prop::array::uniform7(any::<f64>()), 0..16), unit: bool, scale: bool,
    ) {
        let factor = if scale { 1.0 } else { 1e-300 };
        let pose = |[x, y, z, a, b, c, d]: [f64; 7]| {
            let turn = Quaternion::new(a, b, c, d);
            let turn = if unit { UnitQuaternion::new_normalize(turn) } else { UnitQuaternion::new_unchecked(turn) };
            Isometry3::from_parts(Translation3::new(x * factor, y * factor, z * factor), turn)
        };
        let samples: Vec<Sighting> = numbers
            .chunks_exact(2)
            .map(|pair| Sighting { camera_from_marker: pose(pair[0]), rcm_from_wrist: RcmFromWrist(pose(pair[1])) })
            .collect();
        if let Ok(fit) = fit_sightings(&samples, &FitOptions::default()) {
            prop_assert!(fit.camera_from_rcm.to_homogeneous().iter().all(|x| x.is_finite()));
        }
    }

    /// Any touches at all: an answer that is a rigid transform, or an error.
    #[test]
    fn any_touches(points in prop::collection::vec(prop::array::uniform6(any::<f64>()), 0..12), scale: bool) {
        let factor = if scale { 1.0 } else { 1e-300 };
        let samples: Vec<Touch> = points
            .iter()
            .map(|p| p.map(|x| x * factor))
            .map(|[a, b, c, d, e, f]| Touch { camera: Point3::new(a, b, c), rcm: Point3::new(d, e, f) })
            .collect();
        if let Ok(fit) = fit_touches(&samples, &FitOptions::default()) {
            prop_assert!(fit.camera_from_rcm.to_homogeneous().iter().all(|x| x.is_finite()));
        }
    }
}

/// Normal noise alone names nobody.
#[test]
fn clean_samples_have_no_outliers() {
    let mut random = ChaCha8Rng::seed_from_u64(19);
    let options = FitOptions::default()
        .with_min_spread(0.001)
        .with_min_turning(0.01);
    for count in [4, 5, 6, 8, 14, 40] {
        for _ in 0..50 {
            let planted = [any_transform(&mut random), any_transform(&mut random)];
            let touched = touches(&mut random, &planted[0], count, 1e-3);
            assert!(
                fit_touches(&touched, &options)
                    .unwrap()
                    .residuals
                    .outliers
                    .is_empty()
            );
            let seen = sightings(&mut random, &planted, count.min(8), [1e-3, 1e-2]);
            assert!(
                fit_sightings(&seen, &options)
                    .unwrap()
                    .residuals
                    .outliers
                    .is_empty()
            );
        }
    }
}
