//! Simulated arms with the joints of a dVRK: unreachable poses are neither planned nor commanded.
#![allow(missing_docs, clippy::unwrap_used, reason = "tests")]

use explore_loop::cell::sim::{ArmModel, Scene, SimCell, SimOptions};
use explore_loop::cell::{Cell, CellError};
use explore_loop::explore::{ExploreOptions, Explorer};
use explore_loop::nalgebra::{Translation3, UnitQuaternion, Vector3};
use explore_loop::plan::CoveragePlanner;

fn cell(seed: u64) -> SimCell {
    let mut options = SimOptions::new(Scene::liver().unwrap());
    options.arm_model = ArmModel::Psm;
    options.seed = seed;
    SimCell::new(&options).unwrap().0
}

/// Seed 3: joint limits do not let the tools rotate with the body all the way.
#[test]
fn the_liver_closes_with_the_arms_of_a_dvrk() {
    let mut cell = cell(3);
    let (mut planner, mut nobody) = (CoveragePlanner::default(), ());
    let exploring = ExploreOptions::new(0.005, 0.03);
    let mut explorer = Explorer::new(&mut cell, &mut planner, &mut nobody, exploring).unwrap();
    let outcome = explorer.run().unwrap();
    let reason = outcome.stop.reason();
    assert_eq!(outcome.stop.word(), "closed", "{reason:?}");
}

#[test]
fn a_pose_that_the_joints_do_not_allow_is_refused() {
    let mut cell = cell(0);
    let arms = cell.info().arms.clone();
    for (arm, info) in arms.iter().enumerate() {
        let home = info.camera_from_home;
        assert!(info.poses.as_ref().unwrap().contains(&home));
        let down = Translation3::new(0.0, 0.0, 0.02) * home;
        cell.move_arm(arm, down, 0.05).unwrap();
        // The wrist bends by 80°: it cannot point back at the remote centre.
        let mut back = home;
        back.rotation *= UnitQuaternion::from_axis_angle(&Vector3::x_axis(), 3.0);
        let refused = cell.move_arm(arm, back, 0.05);
        assert!(
            matches!(refused, Err(CellError::BadCommand { .. })),
            "{refused:?}"
        );
    }
}
