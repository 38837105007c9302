//! Calibration: known transforms are found, noise averages out, outliers are named.
#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::float_cmp,
    reason = "tests; copied values must be the same bits"
)]

mod planted;

use planted::*;

use dvrk_io::calibration::{FitOptions, Sighting, Touch, fit_sightings, fit_touches};
use dvrk_io::kinematics::Kinematics;
use dvrk_io::{Error, Psm};
use nalgebra::{Isometry3, Point3, UnitQuaternion};
use proptest::prelude::*;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

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
fn the_wrist_given_for_the_tip_shows() {
    // The classic mistake: the robot's own pose, which is that of the wrist, for the touching tip.
    let mut random = ChaCha8Rng::seed_from_u64(13);
    let (arm, planted) = (Kinematics::new(Psm::Classic), any_transform(&mut random));
    let mut samples = |wrong: bool| -> Vec<Touch> {
        (0..12)
            .map(|_| {
                let joints = any_joints(&mut random, 1.2);
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

/// Exact samples have a median of nothing: what no one can measure is still no outlier.
#[test]
fn a_hair_is_no_outlier() {
    let mut random = ChaCha8Rng::seed_from_u64(20);
    let planted = any_transform(&mut random);
    for (slip, expected) in [(5e-5, vec![]), (1e-3, vec![4])] {
        let mut samples = touches(&mut random, &planted, 15, 0.0);
        samples[4].camera.y += slip;
        let fit = fit_touches(&samples, &FitOptions::default()).unwrap();
        assert_eq!(fit.residuals.outliers, expected);
    }
}

/// Points in a plane, such as those of a board, determine the third axis only by the handedness of the frames.
#[test]
fn points_in_a_plane() {
    let mut random = ChaCha8Rng::seed_from_u64(21);
    for noise in [0.0, 5e-4] {
        for _ in 0..200 {
            let (planted, plane) = (any_transform(&mut random), any_transform(&mut random));
            let mut samples = touches(&mut random, &planted, 12, 0.0);
            for sample in &mut samples {
                sample.rcm.z = 0.0;
                sample.rcm = plane * sample.rcm;
                sample.camera = planted * sample.rcm + noise * normals(&mut random);
            }
            let fit = fit_touches(&samples, &FitOptions::default().with_min_spread(0.01)).unwrap();
            let angle = fit.camera_from_rcm.rotation.angle_to(&planted.rotation);
            assert!(angle < 1e-7 + 150.0 * noise, "{angle}");
        }
    }
}

/// Gaussian noise alone gives no outliers.
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
}
