//! Invalid input gives an error, undetermined input a status, and the registrar is unchanged.
#![allow(missing_docs, clippy::unwrap_used)]

mod shapes;

use nalgebra::{Point3, Rotation3, UnitVector3, Vector3};
use nonrigid_reg::{
    Cloud, Error, Feature, Landmark, Options, Registrar, Registration, Status, align_rigid,
    register,
};
use proptest::prelude::*;
use shapes::{Oriented, bend, bent, mean_error, potato, seen};

fn coarse() -> Options {
    Options::default().with_node_spacing(0.02)
}

fn pair(size: f64) -> (Oriented, Oriented) {
    (
        seen(&potato(1200, 0.0)),
        seen(&bent(&potato(1200, 1.7), size)),
    )
}

fn held(p: Point3<f64>, motion: Vector3<f64>) -> Landmark {
    Landmark {
        source: p,
        target: p + motion,
        sigma: 0.0,
    }
}

fn run(source: &Cloud, target: &Cloud, landmarks: &[Landmark]) -> Result<Registration, Error> {
    register(source, target, landmarks, &[], &coarse())
}

#[test]
fn every_number_that_is_none_is_named() {
    let (source, target) = pair(0.0);
    let mut registrar = Registrar::new(coarse());
    let before = registrar
        .register(&source.cloud(), &target.cloud(), &[], &[], None)
        .unwrap();
    let mut broken = source.clone();
    broken.points[7].y = f64::NAN;
    let mut odd = target.clone();
    odd.points[9].x = f64::INFINITY;
    let nan = Point3::new(0.0, f64::NAN, 0.0);
    let landmark = Landmark {
        source: source.points[0],
        target: nan,
        sigma: 0.0,
    };
    let feature = Feature {
        source: nan,
        target: source.points[0],
    };
    let mut predicted = vec![Vector3::zeros(); source.points.len()];
    predicted[3].z = f64::NAN;
    let results = [
        (
            "source",
            7,
            registrar.register(&broken.cloud(), &target.cloud(), &[], &[], None),
        ),
        (
            "target",
            9,
            registrar.register(&source.cloud(), &odd.cloud(), &[], &[], None),
        ),
        (
            "landmark",
            0,
            registrar.register(&source.cloud(), &target.cloud(), &[landmark], &[], None),
        ),
        (
            "feature",
            0,
            registrar.register(&source.cloud(), &target.cloud(), &[], &[feature], None),
        ),
        (
            "initial displacement",
            3,
            registrar.register(&source.cloud(), &target.cloud(), &[], &[], Some(&predicted)),
        ),
    ];
    for (name, at, result) in results {
        match result {
            Err(Error::BadCoordinate { what, index, .. }) => assert_eq!((what, index), (name, at)),
            other => panic!("{name}: {other:?}"),
        }
    }
    // Nothing of it stays behind.
    let after = registrar
        .register(&source.cloud(), &target.cloud(), &[], &[], None)
        .unwrap();
    assert_eq!(before, after);
}

/// Normals made by `new_unchecked` are checked; those of `f32` sources pass.
#[test]
fn normals_that_are_no_unit_vectors_are_named() {
    let (source, target) = pair(0.0);
    let with = |cloud: &Oriented, index: usize, factor: f64| {
        let mut cloud = cloud.clone();
        cloud.normals[index] = UnitVector3::new_unchecked(cloud.normals[index].scale(factor));
        cloud
    };
    for (factor, text) in [
        (0.0, "is 0, but must be 1 to within 0.001"),
        (f64::NAN, "is NaN, but must be 1 to within 0.001"),
        (2.0, "but must be 1 to within 0.001"),
    ] {
        let results = [
            (
                "the length of source normal 7",
                run(&with(&source, 7, factor).cloud(), &target.cloud(), &[]),
            ),
            (
                "the length of target normal 9",
                run(&source.cloud(), &with(&target, 9, factor).cloud(), &[]),
            ),
        ];
        for (name, result) in results {
            let error = result.unwrap_err();
            assert!(matches!(error, Error::BadNormal { .. }), "{error}");
            let said = error.to_string();
            assert!(said.starts_with(name) && said.ends_with(text), "{said}");
        }
    }
    let rounded = with(&source, 7, 1.0 + 1e-6);
    assert!(run(&rounded.cloud(), &target.cloud(), &[]).is_ok());
}

#[test]
fn fewer_than_four_points_are_refused() {
    let (source, target) = pair(0.0);
    for count in 0..4 {
        let few = source.filter(|p, _| source.points[..count].contains(p));
        assert_eq!(few.points.len(), count);
        for result in [
            run(&few.cloud(), &target.cloud(), &[]),
            run(&target.cloud(), &few.cloud(), &[]),
        ] {
            match result {
                Err(Error::EmptyCloud { .. }) => assert_eq!(count, 0),
                Err(Error::TooFewPoints {
                    found, needed: 4, ..
                }) => assert_eq!(found, count),
                other => panic!("{count}: {other:?}"),
            }
        }
        assert!(align_rigid(&few.cloud(), &target.cloud()).is_err());
    }
    let four = source.filter(|p, _| source.points[..4].contains(p));
    assert!(run(&four.cloud(), &target.cloud(), &[]).is_ok());
}

#[test]
fn wrong_input_is_named() {
    let (source, target) = pair(0.0);
    let with = |options: &Options| register(&source.cloud(), &target.cloud(), &[], &[], options);
    let short = Cloud {
        normals: &source.normals[1..],
        ..source.cloud()
    };
    let result = run(&short, &target.cloud(), &[]);
    assert!(matches!(
        result,
        Err(Error::LengthMismatch {
            what: "normals",
            ..
        })
    ));
    for options in [
        coarse().with_node_spacing(f64::NAN),
        coarse().with_gates(vec![]),
        coarse().with_gates(vec![0.01, -1.0]),
        coarse().with_iterations(0),
        coarse().with_strain(f64::INFINITY),
        coarse().with_align_below(1.5),
        coarse().with_denoise(1000),
    ] {
        assert!(
            matches!(with(&options), Err(Error::BadOption { .. })),
            "{options:?}"
        );
    }
    // Every source point a cell of its own, 1.2 mm apart at most.
    let dense = seen(&potato(20_000, 0.0));
    let fine = coarse().with_node_spacing(1e-4);
    let result = register(&dense.cloud(), &target.cloud(), &[], &[], &fine);
    assert!(matches!(result, Err(Error::TooManyNodes { .. })));
    let negative = Landmark {
        sigma: -1.0,
        ..held(Point3::origin(), Vector3::zeros())
    };
    let result = run(&source.cloud(), &target.cloud(), &[negative]);
    assert!(matches!(result, Err(Error::BadSigma { index: 0, .. })));
    let result = Registrar::new(coarse()).register(
        &source.cloud(),
        &target.cloud(),
        &[],
        &[],
        Some(&[Vector3::zeros()]),
    );
    assert!(matches!(
        result,
        Err(Error::LengthMismatch {
            what: "initial displacements",
            ..
        })
    ));
}

/// A target out of reach of what the landmarks say: no point is matched, and the result is the field of the landmarks with the status for that.
#[test]
fn a_target_far_away_is_low_overlap() {
    let (source, target) = pair(0.0);
    let far = target.moved(&Rotation3::identity(), &Vector3::new(3.0, -2.0, 1.0));
    let landmark = held(source.points[50], Vector3::new(0.001, 0.0, 0.0));
    let result = run(&source.cloud(), &far.cloud(), &[landmark]).unwrap();
    assert!(
        matches!(result.status, Status::LowOverlap { overlap: 0.0, .. }),
        "{:?}",
        result.status
    );
    assert!(result.displacements.iter().all(|u| u.norm() < 0.002));
    // Confidence is the landmark's own and no other.
    assert!(result.confidence.iter().filter(|&&c| c > 0.0).count() < source.points.len() / 4);
    assert!(result.matches.iter().all(Option::is_none));
}

/// On a plane, two shifts and the rotation are undetermined; landmarks or a relief determine them.
#[test]
fn flat_clouds_say_what_is_free() {
    let sheet = |shift: f64, relief: f64| {
        let points: Vec<Point3<f64>> = (0..900)
            .map(|k| {
                let (x, y) = (
                    f64::from(k % 30) * 0.005 + shift,
                    f64::from(k / 30) * 0.005 + shift,
                );
                Point3::new(x, y, relief * (60.0 * x).sin() * (50.0 * y).cos())
            })
            .collect();
        let normals =
            nonrigid_reg::estimate_normals(&points, 12, &Point3::new(0.0, 0.0, 1.0)).unwrap();
        Oriented { points, normals }
    };
    let (flat, other) = (sheet(0.0, 0.0), sheet(0.001, 0.0));
    let result = run(&flat.cloud(), &other.cloud(), &[]).unwrap();
    assert_eq!(result.status, Status::Undetermined { free_motions: 3 });
    assert!(result.displacements.iter().all(|u| u.norm() < 1e-6));
    let held = [0, 29, 870].map(|k| held(flat.points[k], Vector3::new(0.002, 0.0, 0.0)));
    let result = run(&flat.cloud(), &other.cloud(), &held).unwrap();
    assert_eq!(result.status, Status::Converged);
    let result = run(&flat.cloud(), &other.cloud(), &held[..1]).unwrap();
    assert_eq!(result.status, Status::Undetermined { free_motions: 1 });
    let result = run(
        &sheet(0.0, 0.006).cloud(),
        &sheet(0.001, 0.006).cloud(),
        &[],
    )
    .unwrap();
    assert_eq!(result.status, Status::Converged);
}

/// A repeated landmark counts once.
#[test]
fn duplicate_landmarks_are_one() {
    let (source, target) = pair(0.004);
    let landmarks: Vec<Landmark> = [10, 200, 400]
        .map(|i| held(source.points[i], bend(&source.points[i], 0.004)))
        .to_vec();
    let mut doubled = landmarks.clone();
    doubled.extend(&landmarks);
    let once = run(&source.cloud(), &target.cloud(), &landmarks).unwrap();
    let twice = run(&source.cloud(), &target.cloud(), &doubled).unwrap();
    assert_eq!(once.node_positions, twice.node_positions);
    let gap = mean_error(&once.displacements, |i| twice.displacements[i]);
    assert!(gap < 1e-7, "{gap}");
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    /// What a turn or a stretch to less than the double explains is no contradiction, wherever the landmarks are; what tears is.
    #[test]
    fn contradictions_are_found_and_motions_are_not(
        i in 0_usize..200, j in 200_usize..440, axis in prop::array::uniform3(-3.0..3.0), stretch in -0.5..0.9,
        tear in 0.02..0.1, shift in prop::array::uniform3(-0.1..0.1),
    ) {
        let (source, target) = pair(0.0);
        let turn = Rotation3::new(Vector3::from(axis));
        let move_ = |p: Point3<f64>| held(p, turn * p - p + Vector3::from(shift));
        let stretched = |p: Point3<f64>| held(p, p.coords * stretch);
        let (a, b) = (source.points[i], source.points[j]);
        let fine = |pair: [Landmark; 2]| {
            !matches!(run(&source.cloud(), &target.cloud(), &pair), Err(Error::ContradictoryLandmarks { .. }))
        };
        // Nothing is registered here but the door.
        prop_assert!(fine([move_(a), move_(b)]));
        prop_assert!(fine([stretched(a), stretched(b)]));
        let torn = held(a, Vector3::new(tear, 0.0, 0.0));
        let other = Landmark { source: a + Vector3::y() * 0.001, ..held(a, Vector3::zeros()) };
        match run(&source.cloud(), &target.cloud(), &[torn, other]) {
            Err(Error::ContradictoryLandmarks { first: 0, second: 1, gap }) => prop_assert!(gap > 0.9 * tear),
            other => prop_assert!(false, "{other:?}"),
        }
        // Landmarks that doubt themselves do not contradict.
        let doubtful = [Landmark { sigma: tear, ..torn }, Landmark { sigma: tear, ..other }];
        prop_assert!(fine(doubtful));
    }
}
