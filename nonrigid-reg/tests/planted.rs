//! Known motions.
#![allow(missing_docs, clippy::unwrap_used)]

mod shapes;

use nalgebra::{Point3, Rotation3, Vector3};
use nonrigid_reg::{Feature, Landmark, Options, Registrar, Status, estimate_normals, register};
use shapes::{bend, bent, mean_error, potato, seen};

fn grips(points: &[nalgebra::Point3<f64>], size: f64) -> Vec<Landmark> {
    let pick = |key: fn(&nalgebra::Point3<f64>) -> f64| {
        *points
            .iter()
            .max_by(|a, b| key(a).total_cmp(&key(b)))
            .unwrap()
    };
    [pick(|p| p.x), pick(|p| -p.x), pick(|p| p.y)]
        .map(|source| Landmark {
            source,
            target: source + bend(&source, size),
            sigma: 0.0,
        })
        .to_vec()
}

#[test]
fn nothing_moves_when_nothing_moved() {
    let source = seen(&potato(2000, 0.0));
    let result = register(
        &source.cloud(),
        &source.cloud(),
        &[],
        &[],
        &Options::default(),
    )
    .unwrap();
    // Matches are the points themselves: u = 0 solves every iteration, up to rounding.
    assert!(result.displacements.iter().all(|u| u.norm() < 1e-9));
    assert_eq!(result.status, Status::Converged);
    assert!(result.residuals.rms < 1e-9);
}

#[test]
fn bending_is_found_from_another_sampling() {
    let source = seen(&potato(3000, 0.0));
    let target = seen(&bent(&potato(3000, 1.7), 0.006));
    let truth = |i: usize| bend(&source.points[i], 0.006);
    let still = mean_error(&vec![Vector3::zeros(); source.points.len()], truth);
    let free = register(
        &source.cloud(),
        &target.cloud(),
        &[],
        &[],
        &Options::default(),
    )
    .unwrap();
    let held = register(
        &source.cloud(),
        &target.cloud(),
        &grips(&source.points, 0.006),
        &[],
        &Options::default(),
    )
    .unwrap();
    let (free, held) = (
        mean_error(&free.displacements, truth),
        mean_error(&held.displacements, truth),
    );
    assert!(still > 0.001, "{still}");
    // Half of this motion slides along a smooth surface, which geometry does not see: that part needs the grips.
    assert!(free < 0.0009, "{free}");
    assert!(held < 0.0005, "{held}");
}

#[test]
fn exact_landmarks_are_met() {
    let source = seen(&potato(2000, 0.0));
    let target = seen(&bent(&potato(2000, 1.7), 0.006));
    let mut landmarks = grips(&source.points, 0.006);
    // One grip where the camera never looked.
    let below = nalgebra::Point3::new(0.0, 0.0, -0.06);
    landmarks.push(Landmark {
        source: below,
        target: below + bend(&below, 0.006),
        sigma: 0.0,
    });
    let result = register(
        &source.cloud(),
        &target.cloud(),
        &landmarks,
        &[],
        &Options::default(),
    )
    .unwrap();
    for (k, landmark) in landmarks.iter().enumerate() {
        let moved = result.node_positions[k] + result.node_displacements[k];
        // Weight 1e7 against some hundred points that pull by a few mm at most.
        assert!((moved - landmark.target).norm() < 1e-6, "{k}");
        assert!(result.node_confidence[k] > 0.999);
    }
}

#[test]
fn wrong_features_are_outvoted() {
    let source = seen(&potato(2000, 0.0));
    let target = seen(&bent(&potato(2000, 1.7), 0.006));
    let mut features: Vec<Feature> = source
        .points
        .iter()
        .step_by(20)
        .map(|p| Feature {
            source: *p,
            target: p + bend(p, 0.006),
        })
        .collect();
    for wrong in features.iter_mut().step_by(5) {
        wrong.target += Vector3::new(0.015, -0.01, 0.02);
    }
    let truth = |i: usize| bend(&source.points[i], 0.006);
    let result = register(
        &source.cloud(),
        &target.cloud(),
        &[],
        &features,
        &Options::default(),
    )
    .unwrap();
    let error = mean_error(&result.displacements, truth);
    assert!(error < 0.0003, "{error}");
}

/// A gripper hides a third of the target: the points behind it must neither be dragged to the boundary of the hole nor have a high confidence.
#[test]
fn hidden_points_are_not_dragged() {
    let source = seen(&potato(3000, 0.0));
    let target = seen(&bent(&potato(3000, 1.7), 0.004)).filter(|p, _| p.x < 0.02);
    let landmarks = grips(&source.points, 0.004);
    let result = register(
        &source.cloud(),
        &target.cloud(),
        &landmarks,
        &[],
        &Options::default(),
    )
    .unwrap();
    let hidden: Vec<usize> = (0..source.points.len())
        .filter(|&i| source.points[i].x > 0.03)
        .collect();
    let error = |i: usize| (result.displacements[i] - bend(&source.points[i], 0.004)).norm();
    let worst = hidden.iter().map(|&i| error(i)).fold(0.0, f64::max);
    let mean = hidden.iter().map(|&i| error(i)).sum::<f64>() / hidden.len() as f64;
    assert!(mean < 0.0015 && worst < 0.004, "mean {mean}, worst {worst}");
    let open_error = (0..source.points.len())
        .filter(|&i| source.points[i].x < 0.0)
        .map(error)
        .fold(0.0, f64::max);
    assert!(open_error < worst);
    let average = |pick: &dyn Fn(usize) -> bool| {
        let chosen: Vec<f64> = (0..source.points.len())
            .filter(|&i| pick(i))
            .map(|i| result.confidence[i])
            .collect();
        chosen.iter().sum::<f64>() / chosen.len() as f64
    };
    let behind = average(&|i| source.points[i].x > 0.035);
    let open = average(&|i| source.points[i].x < 0.0 && source.normals[i].z > 0.4);
    assert!(behind < 0.35 && open > 0.75, "behind {behind}, open {open}");
}

/// The target shows twice as much as the source: the new part attracts nothing.
#[test]
fn new_surface_does_not_attract() {
    let whole = seen(&potato(3000, 0.0));
    let source = whole.filter(|p, _| p.x < 0.0);
    let target = seen(&potato(3000, 1.7));
    let result = register(
        &source.cloud(),
        &target.cloud(),
        &[],
        &[],
        &Options::default(),
    )
    .unwrap();
    let error = mean_error(&result.displacements, |_| Vector3::zeros());
    assert!(error < 0.0002, "{error}");
}

/// A half turn in steps of three degrees, carried from frame to frame: the model's visible part is the source, all it knows is the last
/// result, and new clouds are sampled afresh.
#[test]
fn a_half_turn_over_many_frames_is_followed() {
    let options = Options::default().with_node_spacing(0.018);
    let mut registrar = Registrar::new(options);
    let model = potato(2000, 0.0);
    let step = Rotation3::from_axis_angle(&Vector3::x_axis(), 3_f64.to_radians());
    let mut live = model.clone();
    let (mut total, mut worst) = (Rotation3::identity(), 0.0_f64);
    for frame in 0..60 {
        total = step * total;
        let target = seen(&potato(2000, f64::from(frame)).moved(&total, &Vector3::zeros()));
        let visible: Vec<usize> = (0..live.points.len())
            .filter(|&i| live.normals[i].z > 0.2)
            .collect();
        let source = shapes::Oriented {
            points: visible.iter().map(|&i| live.points[i]).collect(),
            normals: visible.iter().map(|&i| live.normals[i]).collect(),
        };
        let result = registrar
            .register(&source.cloud(), &target.cloud(), &[], &[], None)
            .unwrap();
        let error = mean_error(&result.displacements, |k| {
            step * source.points[k] - source.points[k]
        });
        worst = worst.max(error);
        // Truth carries the model on, so that every frame is a fair test of its own.
        live = model.moved(&total, &Vector3::zeros());
    }
    // 3.6 mm of motion a frame.
    assert!(worst < 0.0007, "{worst}");
}

/// A prediction bridges a motion several gates wide.
#[test]
fn a_prediction_is_taken_as_the_start() {
    let source = seen(&potato(2000, 0.0));
    let far = Vector3::new(0.08, -0.05, 0.03);
    let target = seen(&potato(2000, 1.7)).moved(&Rotation3::identity(), &far);
    let predicted = vec![far + Vector3::new(0.002, 0.001, -0.002); source.points.len()];
    let mut registrar = Registrar::new(Options::default());
    let result = registrar
        .register(&source.cloud(), &target.cloud(), &[], &[], Some(&predicted))
        .unwrap();
    let error = mean_error(&result.displacements, |_| far);
    // The prediction itself is 3 mm off.
    assert!(error < 0.001, "{error}");
}

/// A dome on the grid of a camera without noise, its depth in steps as a camera stores it: many points are equally far, and a choice among them that
/// follows the rows of the image tilts the mean normal by 0.001. All distances are exact in binary, and the grid equals its reflections, so that
/// only rounding remains.
#[test]
fn normals_on_a_grid_of_pixels_lean_to_no_side() {
    let (half, pitch, radius) = (40, 1.0 / 1024.0, 0.08);
    let side = 2 * half + 1;
    let at = |k: i32| f64::from(k - half) * pitch;
    let dome: Vec<Point3<f64>> = (0..side * side)
        .map(|k| {
            let (x, y) = (at(k % side), at(k / side));
            let height = -(x * x + y * y) / (2.0 * radius);
            Point3::new(x, y, (height / pitch).round() * pitch)
        })
        .collect();
    let normals = estimate_normals(&dome, 16, &Point3::new(0.0, 0.0, 1.0)).unwrap();
    let mean: Vector3<f64> =
        normals.iter().map(|n| n.into_inner()).sum::<Vector3<f64>>() / normals.len() as f64;
    assert!(mean.x.abs() < 1e-6 && mean.y.abs() < 1e-6, "{mean}");
    assert!(mean.z > 0.9);
}
