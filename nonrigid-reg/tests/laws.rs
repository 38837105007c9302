//! Symmetries, determinism, and results for absurd input.
#![allow(missing_docs, clippy::unwrap_used)]

mod shapes;

use nalgebra::{Point3, Rotation3, UnitVector3, Vector3};
use nonrigid_reg::{
    Cloud, Landmark, Options, Registrar, boundary_points, estimate_normals, register,
    voxel_downsample,
};
use proptest::prelude::*;
use shapes::{Oriented, bent, mean_error, potato, seen};

fn coarse() -> Options {
    Options::default().with_node_spacing(0.02)
}

fn pair(size: f64) -> (Oriented, Oriented) {
    (
        seen(&potato(1200, 0.0)),
        seen(&bent(&potato(1200, 1.7), size)),
    )
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    /// The frame in which the clouds are written hardly matters: nodes fall elsewhere (the grid does not turn along), and
    /// that moves the answer by less than the accuracy.
    #[test]
    fn registration_turns_with_the_frame(a in -3.0..3.0, b in -1.5..1.5, c in -3.0..3.0, x in -0.5..0.5) {
        let (source, target) = pair(0.004);
        let r = Rotation3::from_euler_angles(a, b, c);
        let t = Vector3::new(x, 0.2, -x);
        let here = register(&source.cloud(), &target.cloud(), &[], &[], &coarse()).unwrap();
        let (moved, aim) = (source.moved(&r, &t), target.moved(&r, &t));
        let there = register(&moved.cloud(), &aim.cloud(), &[], &[], &coarse()).unwrap();
        let difference = mean_error(&there.displacements, |i| r * here.displacements[i]);
        prop_assert!(difference < 0.0004, "{difference}");
    }

    /// The order of points does not matter, beyond the order of summation.
    #[test]
    fn registration_forgets_the_order(shift in 1_usize..200, other in 1_usize..200) {
        let (source, target) = pair(0.004);
        let turned = |o: &Oriented, by: usize| {
            let mut o = o.clone();
            let n = o.points.len();
            o.points.rotate_left(by % n);
            o.normals.rotate_left(by % n);
            o
        };
        let here = register(&source.cloud(), &target.cloud(), &[], &[], &coarse()).unwrap();
        let (s, t) = (turned(&source, shift), turned(&target, other));
        let there = register(&s.cloud(), &t.cloud(), &[], &[], &coarse()).unwrap();
        let n = source.points.len();
        for i in 0..n {
            let difference = there.displacements[i] - here.displacements[(i + shift) % n];
            prop_assert!(difference.norm() < 1e-8);
        }
    }

    /// There and back again.
    #[test]
    fn swapping_source_and_target_inverts_the_motion(size in -0.006..0.006) {
        let (source, target) = pair(size);
        let there = register(&source.cloud(), &target.cloud(), &[], &[], &coarse()).unwrap();
        let moved: Vec<Point3<f64>> = source.points.iter().zip(&there.displacements).map(|(p, u)| p + u).collect();
        let back = register(&target.cloud(), &source.cloud(), &[], &[], &coarse()).unwrap();
        let field = gpwrm::Field::new(&back.node_positions, &back.node_displacements, &gpwrm::FieldOptions::default()).unwrap();
        let home = field.warp(&moved);
        let gap = home.iter().zip(&source.points).map(|(a, b)| (a - b).norm()).sum::<f64>() / home.len() as f64;
        // Two registrations, each good to about half a millimetre.
        prop_assert!(gap < 0.001, "{gap}");
    }

    /// Twice the size, twice the motion: nothing in the method knows a length but the options.
    #[test]
    fn registration_scales(power in -6..7_i32, size in 0.0..0.006) {
        let (source, target) = pair(size);
        let factor = 2_f64.powi(power);
        let large = |o: &Oriented| Oriented { points: o.points.iter().map(|p| p * factor).collect(), normals: o.normals.clone() };
        let grip = |o: &Oriented| Landmark { source: o.points[40], target: o.points[40] + Vector3::z() * 0.001 * o.points[40].coords.norm(), sigma: 0.0 };
        let here = register(&source.cloud(), &target.cloud(), &[grip(&source)], &[], &coarse()).unwrap();
        let (s, t) = (large(&source), large(&target));
        let there = register(&s.cloud(), &t.cloud(), &[grip(&s)], &[], &coarse().scaled(factor)).unwrap();
        for (a, b) in here.displacements.iter().zip(&there.displacements) {
            // Powers of two leave mantissas alone; the anchor of idle nodes does not scale with anything.
            prop_assert!((a * factor - b).norm() < 1e-9 * factor);
        }
        prop_assert_eq!(here.iterations, there.iterations);
    }

    /// Without a target the landmarks alone make a field, and it passes through every one of them; any rigid motion of them is continued.
    #[test]
    fn landmark_fields_interpolate(picks in prop::collection::btree_set(0_usize..440, 1..8), push in prop::array::uniform3(-0.02..0.02), wild in 0.0..0.01, turn in prop::array::uniform3(-0.6..0.6)) {
        let source = seen(&potato(1200, 0.0));
        let push = Vector3::from(push);
        let land = |k: usize, wild: f64| {
            let p = source.points[k];
            let off = Vector3::new((k as f64).sin(), (2.0 * k as f64).sin(), (3.0 * k as f64).sin()) * wild;
            Landmark { source: p, target: p + push + off, sigma: 0.0 }
        };
        // Neighbours closer than 20 mm could be asked to tear.
        let mut chosen: Vec<usize> = Vec::new();
        for k in picks {
            if chosen.iter().all(|&c| (source.points[c] - source.points[k]).norm() > 0.02) { chosen.push(k); }
        }
        let landmarks: Vec<Landmark> = chosen.iter().map(|&k| land(k, wild)).collect();
        let mut registrar = Registrar::new(coarse());
        let field = registrar.landmark_field(&source.cloud(), &landmarks).unwrap();
        for (k, landmark) in landmarks.iter().enumerate() {
            prop_assert!((field.node_displacements[k] - landmark.motion()).norm() < 1e-6);
        }
        let r = Rotation3::new(Vector3::from(turn));
        let rigid: Vec<Landmark> = [3, 150, 290, 420].map(|k| Landmark { source: source.points[k], target: r * source.points[k] + push, sigma: 0.0 }).to_vec();
        let field = registrar.landmark_field(&source.cloud(), &rigid).unwrap();
        let error = mean_error(&field.displacements, |i| r * source.points[i] + push - source.points[i]);
        // Of up to 100 mm; the strain is measured against rotations that settle in a few iterations.
        prop_assert!(error < 0.002, "{error}");
    }

    /// A small rigid motion, held at three points, is found everywhere.
    #[test]
    fn rigid_motions_are_found(x in -0.004..0.004, y in -0.004..0.004, z in -0.004..0.004, turn in -0.05..0.05_f64) {
        let source = seen(&potato(1200, 0.0));
        let r = Rotation3::new(Vector3::new(turn, turn / 2.0, -turn));
        let t = Vector3::new(x, y, z);
        let target = seen(&potato(1200, 1.7)).moved(&r, &t);
        let grip = |k: usize| {
            let p = source.points[k];
            Landmark { source: p, target: r * p + t, sigma: 0.0 }
        };
        let n = source.points.len();
        let grips = [grip(n / 9), grip(n / 2), grip(n - 1)];
        let result = register(&source.cloud(), &target.cloud(), &grips, &[], &coarse()).unwrap();
        let error = mean_error(&result.displacements, |i| r * source.points[i] + t - source.points[i]);
        // Ten to twenty times less than the motion, at a point spacing of 5 mm.
        prop_assert!(error < 0.0006, "{error}");
    }

    /// A flat sheet at rest, pulled along itself at one corner: geometry lets it slide, so the smooth field carries the pull
    /// far. A prediction of rest holds all but the surroundings of the grip, and the grip still goes its way.
    #[test]
    fn a_prediction_holds_what_geometry_lets_slide(x in 0.001..0.006, y in -0.006..0.006, weight in 0.05..2.0) {
        let points: Vec<Point3<f64>> = (0..400)
            .map(|k| Point3::new(f64::from(k % 20), f64::from(k / 20), 0.0) * 0.0075)
            .collect();
        let normals = vec![Vector3::z_axis(); points.len()];
        let sheet = Cloud { points: &points, normals: &normals };
        let pull = Vector3::new(x, y, 0.0);
        let grip = Landmark { source: points[0], target: points[0] + pull, sigma: 0.0 };
        let rest = vec![Vector3::zeros(); points.len()];
        let run = |prediction: f64, initial: Option<&[Vector3<f64>]>| {
            let options = coarse().with_prediction(prediction);
            Registrar::new(options).register(&sheet, &sheet, &[grip], &[], initial).unwrap()
        };
        let far = |displacements: &[Vector3<f64>]| {
            let beyond = |&i: &usize| (points[i] - points[0]).norm() > 0.08;
            (0..points.len()).filter(beyond).map(|i| displacements[i].norm()).fold(0.0, f64::max)
        };
        let (free, held) = (run(0.0, Some(&rest)), run(weight, Some(&rest)));
        let (slid, stayed) = (far(&free.displacements), far(&held.displacements));
        prop_assert!(slid > 0.3 * pull.norm(), "{slid}");
        prop_assert!(stayed < 0.1 * slid, "{stayed} of {slid}");
        // The grip is a node; its point blends it with the nodes around, which rest.
        let missed = (held.displacements[0] - pull).norm();
        prop_assert!(missed < 0.25 * pull.norm(), "{missed}");
        // Without `initial` there is nothing to be drawn to.
        prop_assert_eq!(run(weight, None), run(0.0, None));
    }

    /// Small and degenerate clouds give finite answers: coincident points, lines, planes.
    #[test]
    fn degenerate_clouds_are_answered(
        points in proptest::collection::vec((-1.0..1.0, -1.0..1.0, -1.0..1.0), 4..30),
        flat in 0..5_usize, size in -4..1_i32, landmark in proptest::bool::ANY,
    ) {
        let size = 10_f64.powi(size);
        let point = |&(x, y, z): &(f64, f64, f64)| {
            let v = [x, if flat > 2 { 0.0 } else { y }, if flat > 1 { 0.0 } else { z }];
            Point3::from(Vector3::from(if flat > 3 { [0.0; 3] } else { v }) * size)
        };
        let points: Vec<_> = points.iter().map(point).collect();
        let normals = vec![Vector3::z_axis(); points.len()];
        let cloud = Cloud { points: &points, normals: &normals };
        let landmarks: Vec<_> = landmark.then_some(Landmark { source: points[0], target: points[0] + Vector3::x() * size, sigma: 0.0 }).into_iter().collect();
        let options = Options::default().with_node_spacing(0.3 * size);
        let result = register(&cloud, &cloud, &landmarks, &[], &options).unwrap();
        prop_assert!(result.displacements.iter().all(|u| u.iter().all(|c| c.is_finite())));
        prop_assert!(result.confidence.iter().all(|c| (0.0..=1.0).contains(c)));
        prop_assert!(result.residuals.rms.is_finite() && (0.0..=1.0).contains(&result.overlap));
    }
}

#[test]
fn the_same_input_gives_the_same_bits_and_buffers_leave_no_trace() {
    let (source, target) = pair(0.005);
    let mut registrar = Registrar::new(coarse());
    let first = registrar
        .register(&source.cloud(), &target.cloud(), &[], &[], None)
        .unwrap();
    registrar
        .register(&target.cloud(), &source.cloud(), &[], &[], None)
        .unwrap();
    let again = registrar
        .register(&source.cloud(), &target.cloud(), &[], &[], None)
        .unwrap();
    assert_eq!(first, again);
}

#[test]
fn normals_match_the_analytic_ones() {
    let whole = potato(6000, 0.0);
    let cap = whole.filter(|_, n| n.z > 0.3);
    let normals = estimate_normals(&cap.points, 12, &Point3::new(0.0, 0.0, 1.0)).unwrap();
    let inner = (0..cap.points.len()).filter(|&i| cap.normals[i].z > 0.5);
    let worst = inner
        .map(|i| normals[i].angle(&cap.normals[i]))
        .fold(0.0, f64::max);
    // Twelve points within 5 mm of a surface with curvature radii from 15 mm on.
    assert!(worst < 0.12, "{worst}");
}

#[test]
fn the_rim_of_a_sheet_is_its_boundary() {
    let points: Vec<Point3<f64>> = (0..400)
        .map(|k| Point3::new(f64::from(k % 20), f64::from(k / 20), 0.0))
        .collect();
    let normals: Vec<UnitVector3<f64>> = vec![Vector3::z_axis(); 400];
    let cloud = Cloud {
        points: &points,
        normals: &normals,
    };
    let rim = boundary_points(&cloud, 12, 130_f64.to_radians()).unwrap();
    for (p, &found) in points.iter().zip(&rim) {
        let edge = p.x < 0.5 || p.y < 0.5 || p.x > 18.5 || p.y > 18.5;
        let near = p.x < 1.5 || p.y < 1.5 || p.x > 17.5 || p.y > 17.5;
        assert!(found || !edge, "{p}");
        assert!(!found || near, "{p}");
    }
}

#[test]
fn downsampling_keeps_one_point_per_cell() {
    let whole = potato(5000, 0.0);
    let kept = voxel_downsample(&whole.points, &whole.normals, 0.01).unwrap();
    let mut cells: Vec<[i64; 3]> = kept
        .points
        .iter()
        .map(|p| p.coords.map(|c| (c / 0.01).floor() as i64).into())
        .collect();
    cells.sort_unstable();
    cells.dedup();
    assert_eq!(cells.len(), kept.points.len());
    for (p, &i) in kept.points.iter().zip(&kept.indices) {
        assert_eq!(*p, whole.points[i]);
    }
    // No point is farther from its representative than the diagonal of a cell.
    for p in &whole.points {
        let near = kept
            .points
            .iter()
            .map(|q| (p - q).norm())
            .fold(f64::MAX, f64::min);
        assert!(near < 0.01 * 3_f64.sqrt());
    }
}
