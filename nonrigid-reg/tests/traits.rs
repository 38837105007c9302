//! Each of the four parts of the iteration is replaced.
#![allow(missing_docs, clippy::unwrap_used)]

mod shapes;

use std::sync::atomic::{AtomicUsize, Ordering};

use nalgebra::{Matrix3, Point3, Vector3};
use nonrigid_reg::{
    AnnealedTukey, ClosestPoint, Correspondence, Linearised, Options, Pair, PointToPlane, Probe,
    Progress, Registrar, Registration, Rejection, Residual, Settled, Status, Target, Termination,
};
use proptest::prelude::*;
use shapes::{Oriented, bend, bent, mean_error, potato, seen};

const SIZE: f64 = 0.004;

fn pair() -> (Oriented, Oriented) {
    (
        seen(&potato(1500, 0.0)),
        seen(&bent(&potato(1500, 1.7), SIZE)),
    )
}

fn run<C: Correspondence, R: Residual, J: Rejection, T: Termination>(
    mut registrar: Registrar<C, R, J, T>,
    (source, target): &(Oriented, Oriented),
) -> Registration {
    registrar
        .register(&source.cloud(), &target.cloud(), &[], &[], None)
        .unwrap()
}

fn error(result: &Registration, source: &Oriented) -> f64 {
    mean_error(&result.displacements, |i| bend(&source.points[i], SIZE))
}

/// The default parts, passed explicitly, give the default result bit for bit.
#[test]
fn the_defaults_are_parts_like_any_other() {
    let pair = pair();
    let options = Options::default();
    let by_hand = Registrar::new(options.clone())
        .with_correspondence(ClosestPoint {
            normal_cosine: options.normal_cosine,
        })
        .with_residual(PointToPlane { drag: options.drag })
        .with_rejection(AnnealedTukey {
            gates: options.gates.clone(),
            boundary_weight: options.boundary_weight,
        })
        .with_termination(Settled {
            tolerance: options.tolerance,
            at_least: options.gates.len(),
        });
    assert_eq!(run(by_hand, &pair), run(Registrar::new(options), &pair));
}

/// Matches the nearest point with an even index among the five nearest.
struct EvenOnes;

impl Correspondence for EvenOnes {
    fn find(&self, probe: &Probe, target: &Target, reach: f64) -> Option<usize> {
        let near = target.nearest_n(&probe.position, 5);
        assert!(near.windows(2).all(|pair| pair[0].1 <= pair[1].1));
        assert_eq!(Some(near[0]), target.nearest(&probe.position));
        let close = near.iter().filter(|(_, squared)| *squared < reach * reach);
        let mut even = close.map(|hit| hit.0).filter(|q| q.is_multiple_of(2));
        even.find(|&q| probe.normal.dot(&target.normals()[q]) > 0.5)
    }
}

#[test]
fn another_correspondence() {
    let pair = pair();
    let result = run(
        Registrar::new(Options::default()).with_correspondence(EvenOnes),
        &pair,
    );
    assert!(result.matches.iter().flatten().all(|q| q.is_multiple_of(2)));
    assert!(result.matches.iter().flatten().count() > pair.0.points.len() / 2);
    let error = error(&result, &pair.0);
    // Of 1.3 mm of motion.
    assert!(error < 0.0007, "{error}");
}

/// Matches with points that do not exist are ignored.
#[test]
fn an_index_out_of_range_is_no_match() {
    struct Wrong;
    impl Correspondence for Wrong {
        fn find(&self, _: &Probe, target: &Target, _: f64) -> Option<usize> {
            Some(target.points().len())
        }
    }
    let result = run(Registrar::default().with_correspondence(Wrong), &pair());
    assert!(
        matches!(result.status, Status::LowOverlap { overlap: 0.0, .. }),
        "{:?}",
        result.status
    );
}

/// Distance to the point itself, all three components.
struct PointToPoint;

impl Residual for PointToPoint {
    fn linearise(&self, pair: &Pair) -> Linearised {
        Linearised {
            residual: pair.offset(),
            jacobian: Matrix3::identity(),
        }
    }
}

#[test]
fn another_residual() {
    let pair = pair();
    let result = run(Registrar::default().with_residual(PointToPoint), &pair);
    let plane = run(Registrar::default(), &pair);
    // Point to point clings to where it started, by as much as the nearest neighbour is off.
    assert!(error(&result, &pair.0) > error(&plane, &pair.0));
    // Half the point spacing of 5 mm remains between two samplings.
    assert!(result.residuals.rms > 2.0 * plane.residuals.rms);
}

/// All or nothing within 8 mm, and nothing at all left of a line.
struct HalfBlind(f64);

impl Rejection for HalfBlind {
    fn reach(&self, _: usize) -> f64 {
        0.008
    }

    fn weight(&self, pair: &Pair, _: usize) -> f64 {
        if pair.probe.position.x < self.0 {
            0.0
        } else {
            1.0
        }
    }
}

#[test]
fn another_rejection() {
    let pair = pair();
    let result = run(Registrar::default().with_rejection(HalfBlind(0.01)), &pair);
    for (p, (u, m)) in pair
        .0
        .points
        .iter()
        .zip(result.displacements.iter().zip(&result.matches))
    {
        assert!(m.is_none() || (p + u).x >= 0.01);
    }
    let right = result.matches.iter().flatten().count();
    assert!(
        right > 100 && (right as f64) < 0.6 * pair.0.points.len() as f64,
        "{right}"
    );
}

/// Stops after a given number of iterations, and counts how often it was asked.
struct After<'a>(usize, &'a AtomicUsize);

impl Termination for After<'_> {
    fn verdict(&self, progress: &Progress) -> Option<Status> {
        assert!(progress.step >= 0.0 && progress.residual >= 0.0 && progress.overlap > 0.5);
        assert_eq!(
            self.1.fetch_add(1, Ordering::Relaxed) + 1,
            progress.iteration
        );
        (progress.iteration >= self.0).then_some(Status::Converged)
    }
}

#[test]
fn another_termination() {
    let asked = AtomicUsize::new(0);
    let result = run(
        Registrar::default().with_termination(After(2, &asked)),
        &pair(),
    );
    assert_eq!((result.iterations, asked.into_inner()), (2, 2));
    // One that never says so does not loop for ever.
    let asked = AtomicUsize::new(0);
    let endless = run(
        Registrar::default().with_termination(After(usize::MAX, &asked)),
        &pair(),
    );
    assert_eq!(endless.iterations, Options::default().iterations);
    assert_eq!(endless.status, Status::MaxIterations);
}

/// The gate shrinks and stays, weights fall to zero at it, and boundary points have their reduced weight.
#[test]
fn the_default_weights_are_tukeys() {
    let part = AnnealedTukey {
        gates: vec![0.02, 0.01],
        boundary_weight: 0.05,
    };
    assert!((part.reach(0) - 0.02).abs() < 1e-15);
    assert!((part.reach(1) - 0.01).abs() < 1e-15 && (part.reach(usize::MAX) - 0.01).abs() < 1e-15);
    let pair = |x: f64, on_boundary: bool| Pair {
        probe: Probe {
            index: 0,
            position: Point3::new(x, 0.0, 0.0),
            normal: Vector3::z(),
        },
        target: 0,
        point: Point3::origin(),
        normal: Vector3::z(),
        on_boundary,
    };
    for (x, iteration, expected) in [
        (0.0, 0, 1.0),
        (0.01, 0, 0.5625),
        (0.005, 5, 0.5625),
        (0.01, 1, 0.0),
        (0.5, 0, 0.0),
    ] {
        assert!((part.weight(&pair(x, false), iteration) - expected).abs() < 1e-12);
        assert!((part.weight(&pair(x, true), iteration) - 0.05 * expected).abs() < 1e-12);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    /// The Jacobian of the default residual against differences: along the normal of the pair it is that of the distance; across, the drag,
    /// which is a resistance and not the slope of a residual.
    #[test]
    fn the_jacobian_is_the_slope(
        y in prop::array::uniform3(-1.0..1.0), q in prop::array::uniform3(-1.0..1.0), n in prop::array::uniform3(-1.0..1.0),
        m in prop::array::uniform3(-0.4..0.4), drag in 0.0..1.0,
    ) {
        let n = Vector3::from(n);
        prop_assume!(n.norm() > 0.1);
        let n = n.normalize();
        let turned = (n + Vector3::from(m)).normalize();
        let pair = |position: Point3<f64>| Pair {
            probe: Probe { index: 0, position, normal: turned },
            target: 0,
            point: Point3::from(Vector3::from(q)),
            normal: n,
            on_boundary: false,
        };
        let (part, at) = (PointToPlane { drag }, Point3::from(Vector3::from(y)));
        let here = part.linearise(&pair(at));
        let h = 1e-5;
        for a in 0..3 {
            let mut e = Vector3::zeros();
            e[a] = h;
            let slope = (part.linearise(&pair(at + e)).residual - part.linearise(&pair(at - e)).residual) / (2.0 * h);
            let direction = (n + turned).normalize();
            let across = Matrix3::identity() - direction * direction.transpose();
            let expected = slope + across.column(a) * drag.sqrt();
            prop_assert!((here.jacobian.column(a) - expected).norm() < 1e-9);
        }
    }
}
