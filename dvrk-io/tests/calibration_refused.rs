//! Calibration: what cannot be fitted is refused, with its reason.
#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::float_cmp,
    reason = "tests; copied values must be the same bits"
)]

mod planted;

use planted::*;

use dvrk_io::Error;
use dvrk_io::calibration::{
    Calibration, CheckOptions, FitOptions, Sighting, Touch, fit_sightings, fit_touches,
};
use dvrk_io::kinematics::RcmFromWrist;
use nalgebra::{Isometry3, Point3, Quaternion, Translation3, UnitQuaternion, Vector3};
use proptest::prelude::*;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

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

/// A number as it is, tiny, or of the size of a cell.
fn sized(number: f64, scale: i32) -> f64 {
    match scale {
        0 => number,
        1 => number * 1e-300,
        _ => number % 0.3,
    }
}

proptest! {
    /// Any sightings at all, some with proper rotations.
    #[test]
    fn any_sightings(
        numbers in prop::collection::vec(prop::array::uniform7(prop::num::f64::ANY), 0..16), unit: bool, scale in 0..3,
    ) {
        let pose = |[x, y, z, a, b, c, d]: [f64; 7]| {
            let turn = Quaternion::new(sized(a, scale), sized(b, scale), sized(c, scale), sized(d, scale));
            let turn = if unit { UnitQuaternion::new_normalize(turn) } else { UnitQuaternion::new_unchecked(turn) };
            Isometry3::from_parts(Translation3::new(sized(x, scale), sized(y, scale), sized(z, scale)), turn)
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
    fn any_touches(points in prop::collection::vec(prop::array::uniform6(prop::num::f64::ANY), 0..12), scale in 0..3) {
        let samples: Vec<Touch> = points
            .iter()
            .map(|p| p.map(|x| sized(x, scale)))
            .map(|[a, b, c, d, e, f]| Touch { camera: Point3::new(a, b, c), rcm: Point3::new(d, e, f) })
            .collect();
        if let Ok(fit) = fit_touches(&samples, &FitOptions::default()) {
            prop_assert!(fit.camera_from_rcm.to_homogeneous().iter().all(|x| x.is_finite()));
        }
    }
}
