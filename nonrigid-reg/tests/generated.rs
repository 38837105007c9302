//! Bars on generated pairs with noise, hidden surface, shadow and strays. Figures of all of them: `cargo bench --bench bars`.
#![allow(missing_docs, clippy::unwrap_used)]

#[path = "../benches/generator/mod.rs"]
mod generator;

use generator::track::Track;
use generator::{Case, Motion, Pair, Shape, error_mm, moved};
use nonrigid_reg::{Options, Registrar, Registration, register};

fn run(pair: &Pair, landmarks: bool, features: bool) -> Registration {
    let landmarks: &[_] = if landmarks { &pair.landmarks } else { &[] };
    let features: &[_] = if features { &pair.features } else { &[] };
    let (source, target) = (pair.source.cloud(), pair.target.cloud());
    register(&source, &target, landmarks, features, &Options::default()).unwrap()
}

fn errors(pair: &Pair, result: &Registration) -> (f64, f64) {
    error_mm(
        &moved(&pair.source.points, &result.displacements),
        &pair.truth,
    )
}

/// The twelve, by the bars set for them: 0.5 mm of noise, 5 mm of motion. Landmarks help, features help more.
#[test]
fn the_core_is_within_the_bars() {
    let (mut held, mut tail, mut free, mut featured) = (0.0, 0.0, 0.0, 0.0);
    for case in Case::core(0.005) {
        let pair = case.make();
        let (mean, p95) = errors(&pair, &run(&pair, true, false));
        held += mean / 12.0;
        tail += p95 / 12.0;
        free += errors(&pair, &run(&pair, false, false)).0 / 12.0;
        featured += errors(&pair, &run(&pair, true, true)).0 / 12.0;
    }
    assert!(held < 0.5 && tail < 1.0, "{held} {tail}");
    assert!(free < 0.8, "{free}");
    assert!(featured < 0.35, "{featured}");
}

/// A scene at rest stays at rest, to a fifth of the noise.
#[test]
fn rest_is_rest() {
    let pair = Case::new(Shape::Liver, Motion::Rest, 0.0).make();
    let (mean, _) = errors(&pair, &run(&pair, true, false));
    assert!(mean < 0.1, "{mean}");
}

/// A fifth in shadow and 3 % of strays cost little; points in the shadow have low confidence.
#[test]
fn shadow_and_strays_are_borne() {
    for case in Case::sweep(0.005) {
        let (open, shaded) = (
            case.make(),
            Case {
                occluded: true,
                ..case
            }
            .make(),
        );
        let clear = errors(&open, &run(&open, true, false)).0;
        let result = run(&shaded, true, false);
        let (mean, _) = errors(&shaded, &result);
        assert!(
            mean < 1.3 * clear + 0.1,
            "{}: {mean} against {clear}",
            case.name()
        );
        let grip = shaded.landmarks[0].source;
        let share = |near: bool| {
            let inside = |i: &usize| ((shaded.source.points[*i] - grip).norm() < 0.02) == near;
            let all: Vec<f64> = (0..shaded.source.points.len())
                .filter(inside)
                .map(|i| result.confidence[i])
                .collect();
            all.iter().sum::<f64>() / all.len().max(1) as f64
        };
        assert!(share(true) < share(false), "{}", case.name());
    }
}

/// Wrong features are told from right ones.
#[test]
fn feature_confidence_tells_outliers() {
    let pair = Case::new(Shape::Liver, Motion::Bend, 0.005).make();
    let result = run(&pair, true, true);
    let (mut right, mut wrong) = (0, 0);
    for (k, &c) in result.feature_confidence.iter().enumerate() {
        // Every fifth is 15 mm off.
        if k.is_multiple_of(5) {
            wrong += u32::from(c > 0.1);
        } else {
            right += u32::from(c > 0.3);
        }
    }
    assert!(wrong == 0 && right >= 44, "{wrong} {right}");
}

/// The same seed makes the same pair, another one another.
#[test]
fn pairs_come_from_their_seed() {
    let case = Case::new(Shape::Torus, Motion::Twist, 0.005);
    let (once, again, other) = (case.make(), case.make(), Case { seed: 2, ..case }.make());
    assert_eq!(once.source.points, again.source.points);
    assert_eq!(once.target.points, again.target.points);
    assert_ne!(once.source.points, other.source.points);
    let largest = once
        .hidden
        .iter()
        .zip(&once.hidden_truth)
        .map(|(a, b)| (a - b).norm())
        .fold(0.0, f64::max);
    assert!(largest < 0.0051);
    assert!((2000..4000).contains(&once.source.points.len()));
}

/// A model of frame 0, carried through twenty frames out to 20 mm of motion.
#[test]
fn a_track_drifts_by_less_than_it_moves() {
    let mut track = Track::new(Shape::Liver, Motion::Bend, 0.02, 80, 7);
    let mut model = track.look(0);
    let (rest, grips) = (model.points.clone(), track.grips());
    let mut registrar = Registrar::new(Options::default());
    for k in 0..20 {
        let target = track.look(k + 1);
        let landmarks = track.landmarks(&grips, k);
        let result = registrar
            .register(&model.cloud(), &target.cloud(), &landmarks, &[], None)
            .unwrap();
        model = generator::View::new(moved(&model.points, &result.displacements));
    }
    let truth: Vec<_> = rest.iter().map(|p| track.place(p, 20)).collect();
    let (drift, still) = (error_mm(&model.points, &truth).0, error_mm(&rest, &truth).0);
    assert!(still > 5.0 && drift < 0.3 * still, "{drift} of {still}");
}
