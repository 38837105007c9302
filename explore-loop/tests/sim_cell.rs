//! The simulated cell: the contract of `Cell`, physics, and camera.
#![allow(
    clippy::unwrap_used,
    clippy::format_push_string,
    clippy::cast_sign_loss,
    clippy::float_cmp,
    clippy::needless_for_each,
    reason = "a test stops where it fails, and its loops read as prose"
)]

use explore_loop::cell::sim::{
    CameraOptions, Scene, SimCell, SimError, SimOptions, Sway, TriangleMesh, Truth,
};
use explore_loop::cell::{Cell, CellError, Observation};
use explore_loop::mesh::{Format, parse};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use parry3d_f64::query::{Ray, RayCast};
use parry3d_f64::shape::TriMesh;

/// A coarse ellipsoid: cheap.
fn options() -> SimOptions {
    let mut options = SimOptions::new(Scene::ellipsoid([0.06, 0.045, 0.03]).unwrap());
    options.fidelity.tetrahedra = 500;
    options
}

fn cell(options: &SimOptions) -> (SimCell, Truth) {
    SimCell::new(options).unwrap()
}

/// Tip pose that points down at `tip` with the jaws opening along x.
fn downward(tip: Point3<f64>) -> Isometry3<f64> {
    Isometry3::from_parts(
        Translation3::from(tip.coords),
        UnitQuaternion::face_towards(&Vector3::z(), &Vector3::x()),
    )
}

fn top(truth: &Truth) -> Point3<f64> {
    truth
        .live()
        .into_iter()
        .min_by(|a, b| a.z.total_cmp(&b.z))
        .unwrap()
}

fn wait(cell: &mut SimCell) -> Observation {
    loop {
        let observation = cell.observe().unwrap();
        if observation.arms.iter().all(|a| !a.moving) {
            return observation;
        }
    }
}

/// Puts arm 0 on top of the object and closes its jaw.
fn grasp_top(cell: &mut SimCell, truth: &Truth) {
    let tip = top(truth) + Vector3::new(0.0, 0.0, 0.002);
    cell.move_arm(0, downward(tip), 0.25).unwrap();
    wait(cell);
    cell.close_jaw(0).unwrap();
}

#[test]
fn the_object_lies_on_the_table_and_stays_there() {
    let (mut cell, truth) = cell(&options());
    let table = cell.info().table;
    let before = truth.live();
    let lowest = before
        .iter()
        .map(|p| table.height(p))
        .fold(f64::INFINITY, f64::min);
    assert!(
        lowest.abs() < 0.0015,
        "the lowest vertex is {lowest} m above the table"
    );
    for _ in 0..10 {
        cell.observe().unwrap();
    }
    let drift = before
        .iter()
        .zip(truth.live())
        .map(|(a, b)| (a - b).norm())
        .fold(0.0, f64::max);
    assert!(drift < 0.001, "drifted by {drift} m in a second");
}

/// A cap and a sheet, whose walls are thinner than the tetrahedra: few enough to simulate, as high as they were made, and still.
#[test]
fn thin_walls_stand_and_lie_still() {
    for name in ["cap", "sheet"] {
        let (mut cell, truth) = cell(&SimOptions::new(Scene::named(name).unwrap()));
        assert!(cell.tetrahedra() < 8000, "{name}: {}", cell.tetrahedra());
        let table = cell.info().table;
        let heights = |points: &[Point3<f64>]| {
            let heights = points.iter().map(|p| table.height(p));
            heights.fold((f64::INFINITY, 0.0_f64), |(low, high), h| {
                (low.min(h), high.max(h))
            })
        };
        cell.observe().unwrap();
        let rest = truth.rest();
        let scene = Scene::named(name).unwrap();
        let (low, high) = scene.mesh().bounds();
        let (bottom, top) = heights(&rest.vertices);
        assert!(bottom.abs() < 0.001, "{name} is {bottom} m above the table");
        // The dome sags by its own weight.
        let kept = (top - bottom) / (high.z - low.z);
        assert!(
            (0.9..1.05).contains(&kept),
            "{name} keeps {kept} of its height"
        );
        // The tetrahedra reach beyond the surface, the surface itself keeps its volume.
        let volume = rest.volume() / scene.mesh().volume();
        assert!(
            (0.9..1.1).contains(&volume),
            "{name} keeps {volume} of its volume"
        );
        for _ in 0..10 {
            cell.observe().unwrap();
        }
        let drift = rest
            .vertices
            .iter()
            .zip(truth.live())
            .map(|(a, b)| (a - b).norm())
            .fold(0.0, f64::max);
        assert!(drift < 0.001, "{name} drifted by {drift} m in a second");
    }
}

#[test]
fn tetrahedra_fill_the_surface() {
    let mut options = options();
    options.fidelity.tetrahedra = 2000;
    let (cell, truth) = cell(&options);
    // They start with its volume; weight and table take a per cent.
    let share = cell.volume() / truth.rest().volume();
    assert!((0.97..1.01).contains(&share), "{share}");
    assert!(
        (1500..2600).contains(&cell.tetrahedra()),
        "{}",
        cell.tetrahedra()
    );
}

/// A column of height h under its own weight gets shorter by ρ g h²/(2 E): checks the units inside the engine.
#[test]
fn weight_compresses_a_block_as_it_should() {
    let height = 0.06;
    let corners = [(0., 0.), (1., 0.), (1., 1.), (0., 1.)].map(|(x, y)| {
        format!(
            "v {} {} 0\nv {} {} {height}\n",
            0.06 * x,
            0.06 * y,
            0.06 * x,
            0.06 * y
        )
    });
    let faces = "f 7 5 3 1\nf 2 4 6 8\nf 1 3 4 2\nf 3 5 6 4\nf 5 7 8 6\nf 7 1 2 8\n";
    let block = parse((corners.concat() + faces).as_bytes(), Format::Obj).unwrap();
    let block = TriangleMesh::from(block);
    let settled_height = |young: f64| {
        let mut options = SimOptions::new(Scene::from_mesh("block", block.clone()).unwrap());
        options.fidelity.tetrahedra = 1000;
        options.material.young = young;
        options.material.friction = 0.0;
        let (cell, truth) = SimCell::new(&options).unwrap();
        truth
            .live()
            .iter()
            .map(|p| cell.info().table.height(p))
            .fold(0.0, f64::max)
    };
    let measured = settled_height(300_000.0) - settled_height(10_000.0);
    let exact = 1000.0 * 9.81 * height * height / 2.0 * (1.0 / 10_000.0 - 1.0 / 300_000.0);
    // Half a millimetre of 1.7: a coarse mesh, contact at corners, and a solver that stops after a few sweeps.
    assert!(
        (measured - exact).abs() < 0.0005,
        "{measured} m instead of {exact} m"
    );
}

#[test]
fn the_same_options_give_the_same_bits() {
    let run = || {
        let mut options = options();
        options.camera.noise = 0.001;
        options.seed = 7;
        let (mut cell, truth) = cell(&options);
        let mut frames = vec![cell.observe().unwrap()];
        grasp_top(&mut cell, &truth);
        let tip = frames[0].arms[0].camera_from_tip;
        cell.move_arm(
            0,
            downward(top(&truth) - Vector3::new(0.02, 0.0, 0.05)),
            0.05,
        )
        .unwrap();
        assert!(tip.translation.vector.iter().all(|c| c.is_finite()));
        for _ in 0..20 {
            frames.push(cell.observe().unwrap());
        }
        (frames, truth.live())
    };
    assert!(run() == run());
}

#[test]
fn seeds_lay_it_down_differently() {
    let rest = |seed| {
        let mut options = options();
        options.seed = seed;
        let (mut cell, truth) = cell(&options);
        cell.observe().unwrap();
        truth.rest()
    };
    let distance = rest(1)
        .vertices
        .iter()
        .zip(&rest(2).vertices)
        .map(|(a, b)| (a - b).norm())
        .fold(0.0, f64::max);
    assert!(distance > 0.005);
}

/// Parry casts a ray through every pixel; the rasteriser must see the same points.
#[test]
fn the_camera_agrees_with_ray_casting() {
    let mut options = SimOptions::new(Scene::liver().unwrap());
    options.fidelity.tetrahedra = 500;
    let (mut cell, truth) = cell(&options);
    let points = cell.observe().unwrap().points;
    let camera = options.camera;
    let mut seen = vec![None; camera.width * camera.height];
    for p in &points {
        let u = (camera.focal * p.x / p.z + camera.width as f64 / 2.0).floor() as usize;
        let v = (camera.focal * p.y / p.z + camera.height as f64 / 2.0).floor() as usize;
        assert!(
            seen[v * camera.width + u].replace(p.z).is_none(),
            "two points in one pixel"
        );
    }
    let vertices = truth.live().iter().map(|p| p.coords.into()).collect();
    let mesh = TriMesh::new(
        vertices,
        truth
            .triangles()
            .iter()
            .map(|t| t.map(|v| v as u32))
            .collect(),
    )
    .unwrap();
    let mut different = 0;
    for v in 0..camera.height {
        for u in 0..camera.width {
            let x = (u as f64 + 0.5 - camera.width as f64 / 2.0) / camera.focal;
            let y = (v as f64 + 0.5 - camera.height as f64 / 2.0) / camera.focal;
            // The direction has depth 1, so that the time of impact is a depth.
            let ray = Ray::new(
                Point3::origin().coords.into(),
                Vector3::new(x, y, 1.0).into(),
            );
            match (
                mesh.cast_local_ray(&ray, 2.0, false),
                seen[v * camera.width + u],
            ) {
                (Some(cast), Some(depth)) => {
                    assert!((cast - depth).abs() < 1e-9, "pixel {u} {v}: {cast} {depth}");
                }
                (None, None) => {}
                _ => different += 1,
            }
        }
    }
    // Rays through an edge of the outline to within rounding may fall on either side.
    assert!(different <= 2, "{different} of {} pixels", points.len());
}

#[test]
fn noise_is_along_the_ray_with_the_deviation_asked_for() {
    let mut options = options();
    options.camera.noise = 0.002;
    let (mut noisy, _) = cell(&options);
    options.camera.noise = 0.0;
    let (mut clean, _) = cell(&options);
    let (noisy, clean) = (
        noisy.observe().unwrap().points,
        clean.observe().unwrap().points,
    );
    assert_eq!(noisy.len(), clean.len());
    let mut sum = 0.0;
    for (n, c) in noisy.iter().zip(&clean) {
        assert!(
            n.coords.cross(&c.coords).norm() < 1e-12 + 1e-9 * c.coords.norm(),
            "off the ray"
        );
        sum += (n - c).norm_squared();
    }
    let deviation = (sum / clean.len() as f64).sqrt();
    // Standard error of a standard deviation from n samples: 1/√(2n), 1.4 % here.
    assert!((deviation / 0.002 - 1.0).abs() < 0.06, "{deviation}");
}

#[test]
fn strides_thin_the_points_out() {
    let mut options = options();
    let all = cell(&options).0.observe().unwrap().points.len() as f64;
    options.camera.pixel_stride = 3;
    let some = cell(&options).0.observe().unwrap().points.len() as f64;
    assert!((all / some / 9.0 - 1.0).abs() < 0.1);
}

#[test]
fn homes_hide_nothing_and_an_arm_in_the_way_hides_what_is_behind_it() {
    let (mut cell, truth) = cell(&options());
    let free = cell.observe().unwrap().points;
    let above = top(&truth) - Vector3::new(0.0, 0.0, 0.04);
    let level = Isometry3::from_parts(
        Translation3::from(above.coords),
        UnitQuaternion::face_towards(&-Vector3::x(), &Vector3::z()),
    );
    cell.move_arm(0, level, 0.25).unwrap();
    let hidden = wait(&mut cell).points;
    // A shaft 8 mm wide over more than half of a body 120 mm long.
    assert!(
        hidden.len() < free.len() - 50,
        "{} {}",
        hidden.len(),
        free.len()
    );
    assert!(
        hidden
            .iter()
            .all(|p| free.iter().any(|q| (p - q).norm() < 0.002)),
        "an arm must never be taken for the object"
    );
    cell.home().unwrap();
    let info = cell.info().clone();
    let again = cell.observe().unwrap();
    assert!(
        again
            .arms
            .iter()
            .zip(&info.arms)
            .all(|(a, i)| a.camera_from_tip == i.camera_from_home && !a.moving)
    );
    assert!(again.points.len().abs_diff(free.len()) < 10);
    for arm in &again.arms {
        for k in 0..25 {
            let p = arm.camera_from_tip * Point3::new(0.0, 0.0, -0.01 * f64::from(k));
            let (u, v) = (320.0 * p.x / p.z, 320.0 * p.y / p.z);
            assert!(
                u.abs() > 165.0 || v.abs() > 125.0,
                "an arm at home is in view at {u} {v}"
            );
        }
    }
}

#[test]
fn a_jaw_carries_what_it_holds() {
    let (mut cell, truth) = cell(&options());
    cell.observe().unwrap();
    grasp_top(&mut cell, &truth);
    let start = cell.observe().unwrap();
    assert!(
        start.arms[0].holding
            && start.arms[0].jaw == 0.0
            && !start.arms[1].holding
            && start.arms[1].jaw > 0.0
    );
    let held = start.arms[0].camera_from_tip;
    let near: Vec<usize> = (0..truth.live().len())
        .filter(|&v| (truth.live()[v] - Point3::from(held.translation.vector)).norm() < 0.004)
        .collect();
    assert!(!near.is_empty());
    let before = truth.live();
    let mut target = held;
    target.translation.vector.z -= 0.05;
    target.rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.5) * target.rotation;
    cell.move_arm(0, target, 0.05).unwrap();
    let end = wait(&mut cell);
    let moved = end.arms[0].camera_from_tip * held.inverse();
    for &v in &near {
        let off = (truth.live()[v] - moved * before[v]).norm();
        assert!(
            off < 0.001,
            "vertex {v} is {off} m from where the jaw would have it"
        );
    }
    assert!(
        truth
            .live()
            .iter()
            .map(|p| cell.info().table.height(p))
            .fold(0.0, f64::max)
            > 0.09
    );
    cell.open_jaw(0).unwrap();
    for _ in 0..15 {
        cell.observe().unwrap();
    }
    // Let go, it falls back.
    assert!(
        truth
            .live()
            .iter()
            .map(|p| cell.info().table.height(p))
            .fold(0.0, f64::max)
            < 0.07
    );
    assert!(!cell.observe().unwrap().arms[0].holding);
}

#[test]
fn motions_take_the_time_they_should() {
    let (mut cell, _) = cell(&options());
    let start = cell.observe().unwrap().arms[1].camera_from_tip;
    let mut target = start;
    target.translation.vector.x += 0.05;
    cell.move_arm(1, target, 0.1).unwrap();
    for frame in 1..=5 {
        let arm = cell.observe().unwrap().arms[1].clone();
        let gone = arm.camera_from_tip.translation.vector.x - start.translation.vector.x;
        assert!(
            (gone - 0.01 * f64::from(frame)).abs() < 1e-9,
            "frame {frame}: {gone}"
        );
        assert_eq!(arm.moving, frame < 5);
    }
    cell.move_arm(1, start, 0.1).unwrap();
    cell.observe().unwrap();
    cell.stop().unwrap();
    let stopped = cell.observe().unwrap().arms[1].clone();
    assert_eq!(stopped, cell.observe().unwrap().arms[1]);
    assert!(!stopped.moving);
}

#[test]
fn commands_that_make_no_sense_are_refused() {
    let (mut cell, _) = cell(&options());
    let home = cell.info().arms[0].camera_from_home;
    assert!(matches!(
        cell.close_jaw(0),
        Err(CellError::NothingGrasped { arm: 0 })
    ));
    assert!(!cell.observe().unwrap().arms[0].holding);
    assert!(matches!(
        cell.close_jaw(3),
        Err(CellError::NoSuchArm { arm: 3, count: 3 })
    ));
    assert!(matches!(cell.open_jaw(9), Err(CellError::NoSuchArm { .. })));
    for speed in [0.0, -1.0, f64::NAN, f64::INFINITY, 3.0] {
        assert!(
            matches!(
                cell.move_arm(0, home, speed),
                Err(CellError::BadCommand { arm: 0, .. })
            ),
            "{speed}"
        );
    }
    let mut pose = home;
    pose.translation.vector.y = f64::NAN;
    assert!(matches!(
        cell.move_arm(0, pose, 0.1),
        Err(CellError::BadCommand { .. })
    ));
    pose.translation.vector = Vector3::new(-0.5, 0.0, 0.5);
    assert!(
        cell.move_arm(0, pose, 0.1)
            .unwrap_err()
            .to_string()
            .contains("reach")
    );
    pose.translation.vector = Vector3::new(0.0, 0.0, 0.56);
    assert!(
        cell.move_arm(0, pose, 0.1)
            .unwrap_err()
            .to_string()
            .contains("0.0100 m under the table")
    );
}

#[test]
fn options_out_of_range_are_named() {
    let mut bad = options();
    bad.arms = 4;
    assert!(matches!(
        SimCell::new(&bad),
        Err(SimError::BadOption { option: "arms", .. })
    ));
    let mut bad = options();
    bad.material.young = f64::NAN;
    assert!(
        SimCell::new(&bad)
            .err()
            .unwrap()
            .to_string()
            .contains("young")
    );
    let mut bad = options();
    bad.camera.rate = 0.0;
    assert!(SimCell::new(&bad).is_err());
}

/// Of two arms that pull a body apart one loses it, and the simulation stays stable.
#[test]
fn pulled_too_hard_it_slips_out_of_a_jaw() {
    let (mut cell, truth) = cell(&options());
    cell.observe().unwrap();
    let live = truth.live();
    let ends = [1.0, -1.0].map(|s: f64| {
        *live
            .iter()
            .max_by(|a, b| (s * a.x).total_cmp(&(s * b.x)))
            .unwrap()
    });
    for (arm, end) in ends.iter().enumerate() {
        cell.move_arm(arm, downward(*end), 0.25).unwrap();
    }
    wait(&mut cell);
    for arm in 0..2 {
        cell.close_jaw(arm).unwrap();
    }
    for (arm, side) in [1.0, -1.0].iter().enumerate() {
        cell.move_arm(arm, downward(Point3::new(side * 0.35, 0.0, 0.45)), 0.25)
            .unwrap();
    }
    let before = truth.live();
    let mut holding = vec![true; 2];
    for _ in 0..30 {
        let seen = cell.observe().unwrap();
        holding = (0..2).map(|arm| seen.arms[arm].holding).collect();
        assert!((0..2).all(|arm| seen.arms[arm].jaw == 0.0));
    }
    assert!(holding.contains(&false), "{holding:?}");
    let size = |points: &[Point3<f64>]| {
        let along = |f: fn(f64, f64) -> f64| points.iter().map(|p| p.x).reduce(f).unwrap();
        along(f64::max) - along(f64::min)
    };
    assert!(size(&truth.live()) < 1.5 * size(&before));
    for arm in 0..2 {
        // What has slipped out has to be gripped anew, with an open jaw.
        assert_eq!(cell.close_jaw(arm).is_ok(), holding[arm]);
    }
}

#[test]
fn the_truth_belongs_to_frames() {
    let (mut cell, truth) = cell(&options());
    cell.observe().unwrap();
    let first = truth.live();
    assert_eq!(truth.rest().vertices, first);
    grasp_top(&mut cell, &truth);
    cell.move_arm(0, downward(top(&truth) - Vector3::new(0.0, 0.0, 0.04)), 0.1)
        .unwrap();
    wait(&mut cell);
    assert_eq!(truth.rest().vertices, first);
    assert_ne!(truth.live(), first);
    let live = TriangleMesh {
        vertices: truth.live(),
        triangles: truth.triangles(),
    };
    live.check_closed().unwrap();
}

/// A bent tube: a mesh with a hole through it, from a file, whose inside is not star-shaped.
#[test]
fn a_torus_from_a_file_is_a_torus() {
    let (rings, sides) = (48, 20);
    let mut obj = String::new();
    for i in 0..rings {
        for j in 0..sides {
            let (a, b) = (
                std::f64::consts::TAU * f64::from(i) / f64::from(rings),
                std::f64::consts::TAU * f64::from(j) / f64::from(sides),
            );
            let r = 0.06 + 0.018 * b.cos();
            obj += &format!("v {} {} {}\n", r * a.cos(), r * a.sin(), 0.018 * b.sin());
        }
    }
    for i in 0..rings {
        for j in 0..sides {
            let at = |i: i32, j: i32| (i % rings) * sides + j % sides + 1;
            obj += &format!(
                "f {} {} {} {}\n",
                at(i, j),
                at(i + 1, j),
                at(i + 1, j + 1),
                at(i, j + 1)
            );
        }
    }
    let mesh = TriangleMesh::from(parse(obj.as_bytes(), Format::Obj).unwrap());
    let volume = mesh.volume();
    let mut options = SimOptions::new(Scene::from_mesh("torus", mesh).unwrap());
    options.fidelity.tetrahedra = 1500;
    let (mut cell, truth) = cell(&options);
    // Flat faces of e = 12 mm cut e²/(8R) = 1 mm off a tube of 18 mm radius, 7 % of its section; its weight takes some more.
    assert!(
        (0.88..1.0).contains(&(cell.volume() / volume)),
        "{} of {volume}",
        cell.volume()
    );
    // The camera sees through the hole.
    let middle =
        truth.live().iter().map(|p| p.coords).sum::<Vector3<f64>>() / truth.live().len() as f64;
    assert!(
        cell.observe()
            .unwrap()
            .points
            .iter()
            .all(|p| (p.coords - middle).xy().norm() > 0.03)
    );
}

/// Distance of each point from the true surface, and of each upward-facing part of it from the points, the 95 % of both.
fn off(points: &[Point3<f64>], truth: &Truth) -> f64 {
    let vertices: Vec<_> = truth.live().iter().map(|p| p.coords.into()).collect();
    let triangles = truth.triangles();
    let triangles = triangles.iter().map(|t| t.map(|v| v as u32));
    let mesh = TriMesh::new(vertices, triangles.collect()).unwrap();
    let distance = |p: &Point3<f64>| {
        use parry3d_f64::query::PointQuery;
        mesh.distance_to_local_point(p.coords.into(), false)
    };
    let mut all: Vec<f64> = points.iter().map(distance).collect();
    all.sort_by(f64::total_cmp);
    all[all.len() * 95 / 100]
}

/// An active stereo camera sees the object where it is, through the segmentation of a real one; its frames are of its own clock; the same seed gives
/// the same bits.
#[test]
fn a_realsense_sees_the_object_in_its_own_time() {
    let mut options = options();
    options.camera = CameraOptions::realsense();
    let frames = |options: &SimOptions| -> (Vec<Observation>, Truth) {
        let (mut cell, truth) = cell(options);
        ((0..4).map(|_| cell.observe().unwrap()).collect(), truth)
    };
    let (seen, truth) = frames(&options);
    for (number, frame) in (1_u32..).zip(&seen) {
        let (stamp, now) = (frame.stamp, 0.1 * f64::from(number));
        assert!(
            stamp <= now && now - stamp < 1.0 / 29.97,
            "{stamp} at {now}"
        );
        let ticks = (stamp - seen[0].stamp) * 29.97;
        assert!((ticks - ticks.round()).abs() < 1e-6, "{ticks}");
        // A body of 120 × 90 mm seen from above, a point for every voxel of 2.2 mm.
        assert!(
            (900..3000).contains(&frame.points.len()),
            "{}",
            frame.points.len()
        );
        // The noise at half a metre is 1 mm, and three pixels are joined.
        assert!(
            off(&frame.points, &truth) < 0.003,
            "{}",
            off(&frame.points, &truth)
        );
        assert_eq!(frame.colours().unwrap().len(), frame.points.len());
    }
    assert_eq!(frames(&options).0, seen);
    options.seed = 1;
    assert_ne!(frames(&options).0, seen);
}

/// Without noise its image gives the surface to a step of disparity.
#[test]
fn cameras_agree_on_the_surface() {
    let options = options();
    let (mut cell, truth) = cell(&options);
    let frame = cell.observe().unwrap();
    assert!(off(&frame.points, &truth) < 1e-9);
    assert_eq!(frame.colours().unwrap().len(), frame.points.len());
}

/// A camera that swings sees the same body from both sides, whichever camera it is; what it saw is given in its frame at rest.
#[test]
fn a_camera_that_swings_knows_where_it_is() {
    for camera in [CameraOptions::default(), CameraOptions::realsense()] {
        let mut options = options();
        options.camera = camera;
        let still = cell(&options).0.observe().unwrap();
        options.camera.sway = Some(Sway {
            angle: 0.5,
            period: 4.0,
        });
        let (mut cell, truth) = cell(&options);
        let frames: Vec<Observation> = (0..40).map(|_| cell.observe().unwrap()).collect();
        let lower = |seen: &Observation| {
            let heights = seen.points.iter().map(|p| cell.info().table.height(p));
            heights.filter(|h| *h < 0.02).count()
        };
        let turned = |seen: &Observation| seen.fixed_from_camera().rotation.angle();
        assert!(frames.iter().map(turned).fold(0.0, f64::max) > 0.45);
        for seen in &frames {
            let error = off(&seen.points, &truth);
            assert!(error < 0.004, "{error}");
            let own = seen.measured();
            let back = own.points.iter().zip(&seen.points);
            let pose = seen.fixed_from_camera();
            assert!(
                back.into_iter()
                    .all(|(own, p)| (pose * own - p).norm() < 1e-12)
            );
        }
        // The sides come into view.
        let most = frames.iter().map(lower).max().unwrap();
        assert!(
            most > lower(&still) + lower(&still) / 5,
            "{most} {}",
            lower(&still)
        );
    }
}

/// A texture sticks to the body: what is carried off by a jaw has the colour at the same place of the body.
#[test]
fn colours_stick_to_the_body() {
    let options = options();
    let (mut cell, truth) = cell(&options);
    let first = cell.observe().unwrap();
    let rest = truth.live();
    grasp_top(&mut cell, &truth);
    let tip = top(&truth) + Vector3::new(0.02, 0.01, -0.02);
    cell.move_arm(0, downward(tip), 0.1).unwrap();
    let moved = wait(&mut cell);
    let live = truth.live();
    let nearest = |p: &Point3<f64>, among: &[Point3<f64>]| {
        let away = |i: &usize| (among[*i] - p).norm_squared();
        (0..among.len())
            .min_by(|a, b| away(a).total_cmp(&away(b)))
            .unwrap()
    };
    let colour = |frame: &Observation, at: &Point3<f64>| {
        let k = nearest(at, &frame.points);
        let near = (frame.points[k] - at).norm() < 0.0015;
        near.then(|| frame.colours().unwrap()[k].map(f64::from))
    };
    let (mut compared, mut differs) = (0, 0);
    for v in (0..rest.len()).step_by(5) {
        if let (Some(a), Some(b)) = (colour(&first, &rest[v]), colour(&moved, &live[v])) {
            compared += 1;
            let apart = (0..3).map(|c| (a[c] - b[c]).abs()).fold(0.0, f64::max);
            differs += usize::from(apart > 25.0);
        }
    }
    assert!(compared > 60, "{compared}");
    // The nearest pixels lie up to a pixel beside it, where a vein may begin.
    assert!(5 * differs < compared, "{differs} of {compared}");
}

/// Of two bodies the larger one is explored, unless a point of the other is given.
#[test]
fn the_body_asked_for_is_the_one_that_is_seen() {
    for small in [false, true] {
        let mut options = SimOptions::new(Scene::named("clutter").unwrap());
        options.fidelity.tetrahedra = 500;
        if small {
            // Where the ellipsoid lies, give or take.
            options.seed_point = Some(Point3::new(0.185, 0.13, 0.52));
        }
        let (mut cell, truth) = cell(&options);
        let frame = cell.observe().unwrap();
        let (low, high) = truth.rest().bounds();
        assert_eq!((high - low).max() < 0.1, small);
        assert!(frame.points.len() > 300);
        assert!(off(&frame.points, &truth) < 0.002);
    }
}

/// What is held to the table stays there while the other end is lifted.
#[test]
fn an_attached_body_stays_where_it_is_held() {
    let mut options = SimOptions::new(Scene::named("attached").unwrap());
    options.fidelity.tetrahedra = 500;
    let own = options.scene.mesh().vertices.clone();
    let end = (0..own.len())
        .max_by(|a, b| own[*a].x.total_cmp(&own[*b].x))
        .unwrap();
    let (mut cell, truth) = cell(&options);
    cell.observe().unwrap();
    let rest = truth.live();
    cell.move_arm(0, downward(rest[end]), 0.25).unwrap();
    wait(&mut cell);
    cell.close_jaw(0).unwrap();
    let lifted = rest[end] - Vector3::new(0.0, 0.0, 0.05);
    cell.move_arm(0, downward(lifted), 0.05).unwrap();
    wait(&mut cell);
    let moved: Vec<f64> = rest
        .iter()
        .zip(&truth.live())
        .map(|(a, b)| (a - b).norm())
        .collect();
    let still = moved.iter().filter(|d| **d < 1e-6).count();
    let carried = moved.iter().filter(|d| **d > 0.02).count();
    assert!(still > 10 && carried > 100, "{still} {carried}");
}
