//! Laws of the parts, for any motion, and a known shape.

use super::depth::DepthMap;
use super::equations::{Equations, Structure};
use super::solve::{rigidity, rigidity_energy};
use super::tsdf::{Volume, around};
use super::warp::Warp;
use crate::measure::MeshReport;
use nalgebra::{
    DMatrix, DVector, Isometry3, Matrix6, Point3, Translation3, UnitQuaternion, Vector3, Vector6,
};
use proptest::prelude::*;

/// Nodes on a bent sheet, 20 mm apart or more, all levels.
fn sheet() -> Warp {
    let mut warp = Warp::new(0.02, 0.02, 3, 2.0);
    let places: Vec<Point3<f64>> = (0..400)
        .map(|k| {
            let (x, y) = (0.01 * f64::from(k % 20), 0.01 * f64::from(k / 20));
            Point3::new(x - 0.1, y - 0.1, 0.5 + 3.0 * (x - 0.1) * (x - 0.1))
        })
        .collect();
    assert!(warp.support(&places).len() > 40);
    warp
}

fn motion() -> impl Strategy<Value = Isometry3<f64>> {
    (
        prop::array::uniform3(-3.0..3.0_f64),
        prop::array::uniform3(-0.5..0.5_f64),
    )
        .prop_map(|(turn, shift)| {
            let turn = UnitQuaternion::from_scaled_axis(Vector3::from(turn));
            Isometry3::from_parts(Translation3::from(Vector3::from(shift)), turn)
        })
}

/// Twists of every node, up to 0.5 rad and 50 mm.
fn twists(count: usize) -> impl Strategy<Value = Vec<Vector6<f64>>> {
    prop::collection::vec(prop::array::uniform6(-1.0..1.0_f64), count).prop_map(|all| {
        all.into_iter()
            .map(|t| Vector6::from(t).component_mul(&Vector6::new(0.5, 0.5, 0.5, 0.05, 0.05, 0.05)))
            .collect()
    })
}

/// A step of the finite differences: their error is of the order of its square, and of 1e-16 over it.
const STEP: f64 = 1e-5;

proptest! {
    #[test]
    fn a_rigid_motion_costs_nothing_and_is_reproduced(motion in motion(), x in prop::array::uniform3(-0.1..0.1_f64)) {
        let mut warp = sheet();
        warp.carry(&motion);
        let place = Point3::from(x) + Vector3::z() * 0.5;
        // Rounding: places of 1 m, sums of a dozen terms.
        prop_assert!((warp.apply(&place) - motion * place).norm() < 1e-13);
        prop_assert!(rigidity_energy(&warp) < 1e-24 * warp.edges.len() as f64);
    }

    #[test]
    fn a_motion_that_is_not_rigid_costs(twists in twists(60)) {
        let mut warp = sheet();
        warp.step(&twists);
        prop_assert!(rigidity_energy(&warp) > 1e-6);
    }

    #[test]
    fn derivatives_of_the_blend_are_its_finite_differences(
        motion in motion(), twists in twists(200), x in prop::array::uniform3(-0.1..0.1_f64), node in 0..4_usize, axis in 0..6_usize
    ) {
        let mut warp = sheet();
        warp.carry(&motion);
        warp.step(&twists);
        let place = Point3::from(x) + Vector3::z() * 0.5;
        let skin = warp.skin(&place).unwrap();
        let exact = warp.derivatives(&skin, &place)[node].column(axis).into_owned();
        let mut nudged = |step: f64| {
            let mut all = vec![Vector6::zeros(); warp.len()];
            all[skin.nodes[node] as usize][axis] = step;
            warp.step(&all);
            let there = warp.blend(&skin).apply(&place);
            // A step about where the node is now is undone by its opposite there.
            all[skin.nodes[node] as usize][axis] = -step;
            warp.step(&all);
            there
        };
        let difference = (nudged(STEP) - nudged(-STEP)) / (2.0 * STEP);
        prop_assert!((difference - exact).norm() < 1e-7, "{difference} {exact}");
    }

    #[test]
    fn derivatives_of_rigidity_are_its_finite_differences(motion in motion(), twists in twists(200), edge in 0..1000_usize, end in 0..2_usize, axis in 0..6_usize) {
        let mut warp = sheet();
        warp.carry(&motion);
        warp.step(&twists);
        let [i, j] = warp.edges[edge % warp.edges.len()];
        let exact = rigidity(&warp, i, j).1[end].column(axis).into_owned();
        let mut nudged = |step: f64| {
            let mut all = vec![Vector6::zeros(); warp.len()];
            all[[i, j][end] as usize][axis] = step;
            warp.step(&all);
            let there = rigidity(&warp, i, j).0;
            all[[i, j][end] as usize][axis] = -step;
            warp.step(&all);
            there
        };
        let difference = (nudged(STEP) - nudged(-STEP)) / (2.0 * STEP);
        prop_assert!((difference - exact).norm() < 1e-7);
    }

    #[test]
    fn the_sparse_answer_is_the_dense_one(values in prop::collection::vec(-1.0..1.0_f64, 36 * 40)) {
        let count = 20;
        let pairs: Vec<[u32; 2]> = (0..count).flat_map(|i| [1, 7].map(|d| [i, (i + d) % count])).collect();
        let structure = Structure::new(count as usize, pairs.iter().copied()).unwrap();
        let mut equations = Equations::new(&structure);
        let size = 6 * count as usize;
        let mut dense = DMatrix::<f64>::identity(size, size) * 1e-12;
        let mut right = DVector::<f64>::zeros(size);
        for (pair, block) in pairs.iter().zip(values.chunks_exact(36)) {
            let rows = Matrix6::from_column_slice(block) + Matrix6::identity() * 3.0;
            for i in pair {
                let force = rows.transpose() * Vector6::repeat(1.0);
                equations.add_right(*i, &force);
                let mut part = right.fixed_rows_mut::<6>(6 * *i as usize);
                part += force;
                for j in pair {
                    let sign = if i == j { 1.0 } else { 0.3 };
                    let product = rows.transpose() * rows * sign;
                    equations.add(*i, *j, &product);
                    let mut view = dense.fixed_view_mut::<6, 6>(6 * *i as usize, 6 * *j as usize);
                    view += product;
                }
            }
        }
        let expected = dense.cholesky().unwrap().solve(&right);
        let found = equations.solve(0.0).unwrap();
        for (i, twist) in found.iter().enumerate() {
            prop_assert!((twist - expected.fixed_rows::<6>(6 * i)).norm() < 1e-8 * expected.norm());
        }
    }
}

/// What the camera sees of a ball.
fn ball(centre: &Point3<f64>, radius: f64) -> Vec<Point3<f64>> {
    let count = 6000;
    let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    (0..count)
        .map(|k| {
            let z = 1.0 - 2.0 * (f64::from(k) + 0.5) / f64::from(count);
            let (sin, cos) = (golden * f64::from(k)).sin_cos();
            let r = (1.0 - z * z).sqrt();
            Vector3::new(r * cos, r * sin, z)
        })
        .filter(|n| n.dot(&(centre + n * radius).coords) < 0.0)
        .map(|n| centre + n * radius)
        .collect()
}

/// A ball turned about its centre shows the camera the same cloud for ever: all that its volume knows of the turn it has from the warp.
#[test]
fn a_ball_seen_from_all_around_is_the_ball() {
    let (centre, radius, voxel) = (Point3::new(0.01, -0.02, 0.5), 0.05, 0.004);
    let cloud = ball(&centre, radius);
    let depth = DepthMap::new(&cloud).unwrap().unwrap();
    let [low, high] = around(&[centre], 0.09).unwrap();
    let mut volume = Volume::new(&low, &high, voxel, 0.012, [0.3, 60.0]);
    volume.integrate_still(&depth);
    let mut warp = Warp::new(0.02, 0.02, 3, 2.0);
    let grow = |volume: &mut Volume, warp: &mut Warp| {
        let fresh = warp.support(&volume.surface().vertices);
        volume.reach(&fresh, warp, 0.04);
    };
    grow(&mut volume, &mut warp);
    for k in 0..48 {
        let axis = if k < 24 { Vector3::x() } else { Vector3::y() };
        let turn = UnitQuaternion::from_scaled_axis(axis * (15.0_f64).to_radians());
        let shift = centre.coords - turn * centre.coords;
        warp.carry(&Isometry3::from_parts(Translation3::from(shift), turn));
        volume.integrate(&depth, &warp, 0.04);
        grow(&mut volume, &mut warp);
    }
    let surface = volume.surface();
    let report = MeshReport::of(&surface.vertices, &surface.triangles);
    assert!(report.watertight && report.euler == 2, "{report:?}");
    let off: Vec<f64> = surface
        .vertices
        .iter()
        .map(|v| ((v - centre).norm() - radius).abs())
        .collect();
    let mean = off.iter().sum::<f64>() / off.len() as f64;
    let worst = off.iter().copied().fold(0.0, f64::max);
    // A projective distance is not the distance to the surface: it is longer at a slant, and the mean of many slants is off by a share of a voxel.
    assert!(mean < 0.1 * voxel && worst < 0.4 * voxel, "{mean} {worst}");
}

/// Between its points the depth map of a ball is the ball, to the sagitta of a triangle.
#[test]
fn a_depth_map_is_the_surface_along_every_ray() {
    let (centre, radius) = (Point3::new(0.0, 0.0, 0.5), 0.05);
    let depth = DepthMap::new(&ball(&centre, radius)).unwrap().unwrap();
    let mut hits = 0;
    for k in 0..1000 {
        let (x, y) = (
            f64::from(k % 32) / 16.0 - 1.0,
            f64::from(k / 32) / 16.0 - 1.0,
        );
        let behind = Point3::new(0.05 * x, 0.05 * y, 0.6);
        let Some(hit) = depth.at(&behind) else {
            continue;
        };
        hits += 1;
        assert!(((hit.point - centre).norm() - radius).abs() < 1e-4);
        assert!(hit.point.coords.cross(&behind.coords).norm() < 1e-12);
        assert!(hit.normal.dot(&((hit.point - centre) / radius)) > 0.98);
    }
    assert!(hits > 500);
    assert!(depth.at(&Point3::new(0.3, 0.0, 0.5)).is_none());
}
