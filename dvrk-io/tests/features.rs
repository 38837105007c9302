//! Features of painted bodies under known motions: how many matches are right, and how exact; and pictures in which there is little or nothing.
#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::float_cmp,
    clippy::print_stdout,
    reason = "tests; repeated work must give the same bits, and scores are printed"
)]

mod painted;

use dvrk_io::depth::{Capsule, Scan};
use dvrk_io::features::{
    Descriptor, Feature, FeatureOptions, GreyImage, Surface, detect, landmark_pairs, lift,
    match_features,
};
use dvrk_io::session::{SessionReader, SessionWriter};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use painted::{Body, Paint, Picture, picture};
use proptest::prelude::*;

fn before() -> Isometry3<f64> {
    let turn = UnitQuaternion::from_euler_angles(0.1, -0.15, 0.3);
    Isometry3::from_parts(Translation3::new(0.01, -0.01, 0.5), turn)
}

/// Turned about the middle of the body and shifted.
fn moved(turn: Vector3<f64>, shift: Vector3<f64>) -> Isometry3<f64> {
    let start = before();
    let turn = UnitQuaternion::from_scaled_axis(turn) * start.rotation;
    Isometry3::from_parts(Translation3::from(start.translation.vector + shift), turn)
}

fn features(seen: &Picture, arms: &[Capsule], options: &FeatureOptions) -> Vec<Feature> {
    let found = detect(&seen.image, options);
    let surface = Surface {
        scan: &seen.scan,
        object: Some(&seen.object),
        arms,
    };
    lift(&found, &seen.image, &surface, options).unwrap()
}

struct Score {
    pairs: usize,
    /// Share of the pairs that are within 3 mm of the truth.
    right: f64,
    /// Median error of those, metres.
    median: f64,
}

fn score(body: Body, to: &Isometry3<f64>, paint: &Paint, options: &FeatureOptions) -> Score {
    let [a, b] = [(before(), 1), (*to, 2)]
        .map(|(pose, frame)| features(&picture(body, &pose, paint, frame), &[], options));
    let pairs = landmark_pairs(&a, &b, options);
    let motion = to * before().inverse();
    let mut errors: Vec<f64> = pairs
        .iter()
        .map(|pair| (motion * pair.a - pair.b).norm())
        .filter(|error| *error < 0.003)
        .collect();
    errors.sort_by(f64::total_cmp);
    let count = pairs.len();
    let score = Score {
        pairs: count,
        right: errors.len() as f64 / count.max(1) as f64,
        median: errors.get(errors.len() / 2).copied().unwrap_or(0.0),
    };
    println!(
        "{} features, {count} pairs, {:.1} % right, median {:.2} mm",
        a.len(),
        100.0 * score.right,
        1e3 * score.median
    );
    score
}

#[test]
fn known_motions_are_found() {
    let motions = [
        (Vector3::zeros(), Vector3::new(0.004, 0.002, 0.0)),
        (Vector3::new(0.0, 0.0, 0.25), Vector3::new(0.0, 0.003, 0.0)),
        (
            Vector3::new(0.12, 0.08, 0.0),
            Vector3::new(-0.002, 0.0, -0.01),
        ),
        (
            Vector3::new(0.0, 0.0, std::f64::consts::PI),
            Vector3::zeros(),
        ),
    ];
    for body in [Body::Board, Body::Ball] {
        for (k, (turn, shift)) in motions.into_iter().enumerate() {
            // A half turn moves the corners of the board by 360 mm.
            let motion = if k == 3 { 0.4 } else { 0.03 };
            let options = FeatureOptions::default().with_motion(motion);
            let score = score(body, &moved(turn, shift), &Paint::default(), &options);
            assert!(score.pairs >= 30, "{} pairs", score.pairs);
            assert!(score.right > 0.95, "{}", score.right);
            // A pixel of the colour image is 0.8 mm, and a corner is found to the pixel.
            assert!(score.median < 0.0008, "{} m", score.median);
        }
    }
}

#[test]
fn noise_costs_matches_and_little_else() {
    let to = moved(Vector3::new(0.05, 0.0, 0.1), Vector3::new(0.004, 0.0, 0.0));
    let paint = Paint {
        noise: 4.0,
        depth_noise: 0.0005,
        ..Paint::default()
    };
    let score = score(Body::Ball, &to, &paint, &FeatureOptions::default());
    assert!(score.pairs >= 25, "{} pairs", score.pairs);
    assert!(score.right > 0.9, "{}", score.right);
    assert!(score.median < 0.0012, "{} m", score.median);
}

#[test]
fn a_dark_image_has_fewer_and_a_black_one_none() {
    let to = moved(Vector3::new(0.0, 0.0, 0.1), Vector3::new(0.004, 0.0, 0.0));
    let at = |light| Paint {
        light,
        ..Paint::default()
    };
    let bright = score(Body::Board, &to, &at(1.0), &FeatureOptions::default());
    let dark = score(Body::Board, &to, &at(0.25), &FeatureOptions::default());
    assert!(dark.pairs < bright.pairs && dark.pairs > 10);
    assert!(dark.right > 0.9, "{}", dark.right);
    assert_eq!(
        score(Body::Board, &to, &at(0.0), &FeatureOptions::default()).pairs,
        0
    );
}

#[test]
fn a_plain_body_has_none() {
    let plain = Paint {
        contrast: 0.0,
        noise: 1.0,
        ..Paint::default()
    };
    for body in [Body::Board, Body::Ball] {
        let seen = picture(body, &before(), &plain, 1);
        let found = features(&seen, &[], &FeatureOptions::default());
        assert!(found.len() <= 2, "{} features", found.len());
    }
}

#[test]
fn nothing_is_taken_from_edges_and_arms() {
    let pose = before();
    let seen = picture(Body::Ball, &pose, &Paint::default(), 1);
    let middle = Point3::from(pose.translation.vector);
    let arm = Capsule {
        start: middle + Vector3::new(0.0, -0.1, -0.06),
        end: middle + Vector3::new(0.0, 0.0, -0.06),
        radius: 0.005,
    };
    let options = FeatureOptions::default();
    let all = features(&seen, &[], &options);
    let free = features(&seen, &[arm], &options);
    assert!(free.len() < all.len() && free.len() > 20);
    for feature in &free {
        assert!(arm.distance(&feature.point) >= options.clearance);
    }
    // Without a mask the wall behind is plain, and the outline of the ball an edge: every feature is on the ball, to the noise of
    // interpolating a curved surface over 3 mm.
    let found = detect(&seen.image, &options);
    let surface = Surface {
        scan: &seen.scan,
        object: None,
        arms: &[],
    };
    let unmasked = lift(&found, &seen.image, &surface, &options).unwrap();
    assert!(unmasked.len() >= all.len());
    for feature in &unmasked {
        let off = (feature.point - middle).norm() - 0.06;
        assert!(off.abs() < 1e-4, "{off} m off the ball");
    }
}

#[test]
fn sizes_that_disagree_are_refused() {
    let seen = picture(Body::Board, &before(), &Paint::default(), 1);
    let options = FeatureOptions::default();
    let image = |width: usize, height: usize| {
        GreyImage::new(width, height, vec![0; width * height]).unwrap()
    };
    let surface = Surface {
        scan: &seen.scan,
        object: None,
        arms: &[],
    };
    for (width, height) in [
        (640, 240),
        (320, 480),
        (641, 480),
        (319, 240),
        (0, 0),
        (640, 484),
    ] {
        let error = lift(&[], &image(width, height), &surface, &options).unwrap_err();
        assert!(error.to_string().contains("320 × 240"), "{error}");
    }
    assert!(lift(&[], &image(960, 720), &surface, &options).is_ok());
    let marks = [true; 7];
    let marked = Surface {
        object: Some(&marks),
        ..surface
    };
    assert!(lift(&[], &image(640, 480), &marked, &options).is_err());
    assert!(GreyImage::new(3, 2, vec![0; 5]).is_err());
    assert!(GreyImage::from_rgb(usize::MAX, 2, &[[0; 3]; 5]).is_err());
    let capsule = Capsule {
        start: Point3::new(f64::NAN, 0.0, 0.0),
        end: Point3::origin(),
        radius: 0.01,
    };
    let reached = Surface {
        arms: &[capsule],
        ..surface
    };
    assert!(lift(&[], &image(640, 480), &reached, &options).is_err());
    // A cloud without rows is no image.
    let cloud = dvrk_io::cdr::PointCloud2::from_points(
        dvrk_io::cdr::Header::default(),
        &[Point3::new(0.0, 0.0, 0.5)],
    );
    let scan = Scan::from_cloud(&cloud.unwrap(), None).unwrap();
    let rowless = Surface {
        scan: &scan,
        ..surface
    };
    assert!(lift(&[], &image(1, 1), &rowless, &options).is_err());
}

#[test]
fn images_smaller_than_a_patch_have_no_features() {
    for (width, height) in [(0, 0), (1, 1), (4, 100), (32, 32), (100, 31)] {
        let pixels = (0..width * height).map(|k| (k * 97 % 256) as u8).collect();
        let image = GreyImage::new(width, height, pixels).unwrap();
        assert!(detect(&image, &FeatureOptions::default()).is_empty());
    }
}

/// Settings and corners that nothing sensible would give.
#[test]
fn numbers_out_of_range_do_no_harm() {
    let seen = picture(Body::Board, &before(), &Paint::default(), 1);
    let options = FeatureOptions::default();
    let alone = detect(
        &seen.image,
        &options
            .with_apart(usize::MAX)
            .with_square(usize::MAX)
            .with_per_square(9),
    );
    assert!(alone.len() <= 1, "{} corners", alone.len());
    let surface = Surface {
        scan: &seen.scan,
        object: None,
        arms: &[],
    };
    let mut corner = detect(&seen.image, &options)[0];
    (corner.column, corner.row) = (usize::MAX, usize::MAX);
    let lifted = lift(&[corner], &seen.image, &surface, &options).unwrap();
    assert!(lifted.is_empty());
    let some = features(&seen, &[], &options);
    let loose = options
        .with_most_different(u32::MAX)
        .with_ratio(f64::INFINITY);
    assert!(match_features(&some, &[], &loose).is_empty());
    let confident = |m: &dvrk_io::features::FeatureMatch| m.confidence > 0.0 && m.confidence <= 1.0;
    let all = match_features(&some, &some, &loose);
    assert!(!all.is_empty() && all.iter().all(confident));
}

#[test]
fn features_survive_a_recording() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("session.mcap");
    let seen = picture(Body::Ball, &before(), &Paint::default(), 1);
    let found = features(&seen, &[], &FeatureOptions::default());
    let mut writer = SessionWriter::create(&path).unwrap();
    let points = [Point3::new(0.0, 0.1, 0.5), Point3::new(0.1, 0.0, 0.5)];
    writer
        .coloured_points(0.5, &points, &[[1, 2, 3], [200, 100, 50]])
        .unwrap();
    writer.features(0.5, &found).unwrap();
    writer.points(0.6, &points).unwrap();
    writer.finish().unwrap();
    let session = SessionReader::open(&path).unwrap();
    assert_eq!(
        session.frames[0].colours,
        Some(vec![[1, 2, 3], [200, 100, 50]])
    );
    let read = session.frames[0].features.as_ref().unwrap();
    assert_eq!(read.len(), found.len());
    for (read, found) in read.iter().zip(&found) {
        assert_eq!(read.descriptor, found.descriptor);
        // 32-bit floats of half a metre are exact to 30 nm.
        assert!((read.point - found.point).norm() < 1e-7);
    }
    assert_eq!(
        (&session.frames[1].colours, &session.frames[1].features),
        (&None, &None)
    );
    // A cloud without descriptors where features are looked for is passed over and reported; the frame stays.
    let mut writer = SessionWriter::create(&path).unwrap();
    writer.points(0.5, &points).unwrap();
    writer.truth(0.5, &points).unwrap();
    writer.finish().unwrap();
    let reader = SessionReader::default();
    let misled = reader.with_topic("features".parse().unwrap(), "/truth/points");
    let session = misled.read(&path).unwrap();
    assert_eq!((session.frames.len(), session.skipped.messages), (1, 1));
    assert_eq!(session.frames[0].features, None);
    let skipped = session.skipped.first[0].to_string();
    assert!(skipped.contains("descriptor"), "{skipped}");
}

fn some_features() -> impl Strategy<Value = Vec<Feature>> {
    let feature = (
        prop::array::uniform3(-0.02..0.02_f64),
        prop::array::uniform8(0..4_u32),
    );
    let feature = feature.prop_map(|(place, words)| Feature {
        point: Point3::from(place),
        descriptor: Descriptor(words),
    });
    prop::collection::vec(feature, 0..40)
}

proptest! {
    #[test]
    fn matches_do_not_depend_on_the_order(a in some_features(), b in some_features(), turn in 0..40_usize) {
        let options = FeatureOptions::default();
        let matches = match_features(&a, &b, &options);
        prop_assert_eq!(&matches, &match_features(&a, &b, &options));
        let (mut turned, mut back) = (a.clone(), b.clone());
        turned.rotate_left(turn.min(a.len()));
        back.reverse();
        // What was there before the lists were changed.
        let mut again: Vec<_> = match_features(&turned, &back, &options)
            .iter()
            .map(|m| ((m.a + turn.min(a.len())) % a.len(), b.len() - 1 - m.b, m.confidence.to_bits()))
            .collect();
        again.sort_unstable();
        let mut once: Vec<_> = matches.iter().map(|m| (m.a, m.b, m.confidence.to_bits())).collect();
        once.sort_unstable();
        prop_assert_eq!(once, again);
        // Frames exchanged: the same pairs the other way round.
        let mut other: Vec<_> = match_features(&b, &a, &options)
            .iter()
            .map(|m| (m.b, m.a, m.confidence.to_bits()))
            .collect();
        other.sort_unstable();
        let mut once: Vec<_> = matches.iter().map(|m| (m.a, m.b, m.confidence.to_bits())).collect();
        once.sort_unstable();
        prop_assert_eq!(once, other);
    }

    #[test]
    fn matches_are_one_to_one_near_and_alike(a in some_features(), b in some_features()) {
        let options = FeatureOptions::default().with_motion(0.015);
        let matches = match_features(&a, &b, &options);
        let mut taken = std::collections::BTreeSet::new();
        for m in &matches {
            prop_assert!(taken.insert((0, m.a)) && taken.insert((1, m.b)));
            prop_assert!(m.confidence > 0.0 && m.confidence <= 1.0);
            prop_assert!((a[m.a].point - b[m.b].point).norm() <= options.motion);
            prop_assert!(a[m.a].descriptor.distance(&b[m.b].descriptor) <= options.most_different);
        }
    }

    #[test]
    fn any_image_is_taken(width in 0..80_usize, height in 0..80_usize, seed in any::<u64>(), options in (any::<u8>(), 0..5_usize, 0..50_usize, 0..9_usize)) {
        let byte = |k: usize| (seed.rotate_left((k % 64) as u32).wrapping_mul(k as u64 | 1) >> 56) as u8;
        let image = GreyImage::new(width, height, (0..width * height).map(byte).collect()).unwrap();
        let (threshold, apart, square, most) = options;
        let options = FeatureOptions::default().with_threshold(threshold).with_apart(apart).with_square(square).with_per_square(most);
        let found = detect(&image, &options);
        prop_assert_eq!(&found, &detect(&image, &options));
        for pair in found.windows(2) {
            prop_assert!((pair[0].row, pair[0].column) < (pair[1].row, pair[1].column));
        }
        for (k, one) in found.iter().enumerate() {
            for other in &found[..k] {
                let away = one.column.abs_diff(other.column).max(one.row.abs_diff(other.row));
                prop_assert!(away > apart);
            }
        }
    }
}
