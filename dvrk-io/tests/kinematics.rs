//! Kinematics of the PSM: round trips, the Jacobian against differences, singularities.
#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::float_cmp,
    reason = "tests; copied values must be the same bits"
)]

mod arms;

use std::f64::consts::TAU;

use arms::*;
use dvrk_io::kinematics::{Instrument, Kinematics, RcmFromWrist, Unreachable};
use dvrk_io::{Error, Psm};
use nalgebra::{
    DMatrix, Isometry3, Matrix3, Matrix6, Quaternion, Rotation3, Translation3, UnitQuaternion,
    Vector3, Vector6,
};
use proptest::prelude::*;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// 100 000 random configurations per generation, drawn up to the very limits: joints come back, poses come
/// back, the answer is within limits.
#[test]
fn inverse_and_forward_undo_each_other() {
    let mut random = ChaCha8Rng::seed_from_u64(14);
    for psm in GENERATIONS {
        let arm = Kinematics::new(psm);
        let mut worst = (0.0_f64, 0.0_f64);
        for _ in 0..100_000 {
            // One value in eight sits exactly at a limit.
            let joints = joints_at(
                &arm,
                std::array::from_fn(|_| match random.random_range(0..16) {
                    0 => 0.0,
                    1 => 1.0,
                    _ => random.random_range(0.0..1.0),
                }),
            );
            let pose = arm.rcm_from_wrist(&joints).unwrap();
            let near = arm.inverse_near(&pose, &joints).unwrap();
            for i in 0..6 {
                worst.0 = worst.0.max((near.joints[i] - joints[i]).abs());
            }
            let reach = arm.inverse(&pose).unwrap();
            assert!(reach.margins.joints.iter().all(|&margin| margin >= 0.0));
            // Without a reference the roll takes the turn nearest to 0.
            let turns = (reach.joints[3] - joints[3]) / TAU;
            assert!((turns - turns.round()).abs() < 1e-10 && reach.joints[3].abs() < 3.15);
            let again = arm.rcm_from_wrist(&reach.joints).unwrap();
            worst.1 = worst.1.max(gap(&again.0, &pose.0));
        }
        assert!(worst.0 <= 1e-10 && worst.1 <= 1e-9, "{psm:?}: {worst:?}");
    }
}

/// Poses drawn in space rather than from joints: what is answered is the pose, what is refused for a limit
/// names a value beyond it.
#[test]
fn poses_drawn_in_space() {
    let mut random = ChaCha8Rng::seed_from_u64(15);
    let arm = Kinematics::new(Psm::Si);
    let (mut reached, mut refused) = (0, 0);
    while reached < 20_000 {
        let mut uniform = || random.random_range(-1.0..1.0);
        let position = Vector3::new(uniform() * 0.3, uniform() * 0.3, uniform() * 0.3);
        let turn = Quaternion::new(uniform(), uniform(), uniform(), uniform());
        if turn.norm() < 0.1 {
            continue;
        }
        let pose = Isometry3::from_parts(position.into(), UnitQuaternion::new_normalize(turn));
        match arm.inverse(&RcmFromWrist(pose)) {
            Ok(reach) => {
                reached += 1;
                assert!(gap(&arm.rcm_from_wrist(&reach.joints).unwrap().0, &pose) <= 1e-9);
                assert!(reach.margins.are_kept());
            }
            Err(Error::Unreachable(Unreachable::JointLimit {
                joint,
                value,
                range,
            })) => {
                refused += 1;
                assert!(
                    value < range[0] || value > range[1],
                    "{joint} {value} {range:?}"
                );
            }
            Err(Error::Unreachable(_)) => refused += 1,
            Err(other) => panic!("{other}"),
        }
    }
    assert!(refused > 0);
}

/// A search that knows only the forward kinematics: Newton steps with a numerical Jacobian from many starts.
fn newton(arm: &Kinematics, pose: &Isometry3<f64>, start: [f64; 6]) -> Option<[f64; 6]> {
    let error = |joints: &[f64; 6]| {
        let at = arm.rcm_from_wrist(joints).unwrap().0;
        let turn = (pose.rotation * at.rotation.inverse()).scaled_axis();
        let shift = pose.translation.vector - at.translation.vector;
        Vector6::new(shift.x, shift.y, shift.z, turn.x, turn.y, turn.z)
    };
    let mut joints = start;
    for _ in 0..60 {
        let now = error(&joints);
        if now.norm() < 1e-11 {
            return Some(joints);
        }
        let mut slope = Matrix6::zeros();
        for i in 0..6 {
            let mut moved = joints;
            moved[i] += 1e-7;
            slope.set_column(i, &((error(&moved) - now) / 1e-7));
        }
        let step = slope.lu().solve(&-now)?;
        let scale = (0.3 / step.amax()).min(1.0);
        (0..6).for_each(|i| joints[i] += scale * step[i]);
    }
    None
}

/// Where the closed form says no, a blind search finds nothing within limits either.
#[test]
fn a_search_finds_nothing_where_the_closed_form_refuses() {
    let mut random = ChaCha8Rng::seed_from_u64(16);
    let arm = Kinematics::new(Psm::Classic);
    let wide = arm
        .limits()
        .map(|[lower, upper]| [lower * 1.4 - 0.03, upper * 1.4 + 0.03]);
    let (mut refused, mut found) = (0, 0);
    while refused < 40 {
        let beyond: [f64; 6] = std::array::from_fn(|i| random.random_range(wide[i][0]..wide[i][1]));
        let pose = arm.rcm_from_wrist(&beyond).unwrap();
        if arm.inverse(&pose).is_ok() {
            continue;
        }
        refused += 1;
        for _ in 0..25 {
            let start = joints_at(&arm, std::array::from_fn(|_| random.random_range(0.0..1.0)));
            if let Some(joints) = newton(&arm, &pose.0, start) {
                found += 1;
                assert!(
                    !arm.margins(&joints).unwrap().are_kept(),
                    "{beyond:?} {joints:?}"
                );
            }
        }
    }
    // The search does find solutions, only not allowed ones.
    assert!(found > 50, "{found}");
}

#[test]
fn known_home() {
    for psm in GENERATIONS {
        let arm = Kinematics::new(psm);
        let axes = Matrix3::new(0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -1.0);
        let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
        let at = |z| Isometry3::from_parts(Translation3::new(0.0, 0.0, z), turn);
        let reach = arm.inverse(&RcmFromWrist(at(-0.1135))).unwrap();
        let home = [0.0, 0.0, 0.12, 0.0, 0.0, 0.0];
        assert!(
            (0..6).all(|i| (reach.joints[i] - home[i]).abs() < 1e-12),
            "{reach:?}"
        );
        // The tips are 10.2 mm further.
        let tip = arm.rcm_from_tip(&home).unwrap();
        assert!(gap(&tip.0, &at(-0.1237)) < 1e-12);
        assert!(gap(&arm.wrist_of(&tip).0, &at(-0.1135)) < 1e-12);
        let of_tip = arm.inverse_of_tip(&tip).unwrap();
        assert!((of_tip.joints[2] - 0.12).abs() < 1e-12);
    }
}

type Pose = fn(&Kinematics, &[f64; 6]) -> Isometry3<f64>;

/// Kept from the determinant: at full rank inside the workspace, the smallest singular value stays away from 0.
#[test]
fn full_rank_within_limits() {
    let mut random = ChaCha8Rng::seed_from_u64(17);
    for psm in GENERATIONS {
        let arm = Kinematics::new(psm);
        for _ in 0..2_000 {
            let joints = joints_at(&arm, std::array::from_fn(|_| random.random_range(0.0..1.0)));
            let jacobian = arm.wrist_jacobian(&joints).unwrap();
            let values = DMatrix::from_iterator(6, 6, jacobian.iter().copied()).singular_values();
            assert!(values.min() > 1e-3, "{joints:?}: {values}");
        }
    }
}

proptest! {
    #[test]
    fn jacobian_is_the_slope_of_the_pose(
        shares in prop::array::uniform6(0.02..0.98), si: bool, jaw in 0.0..0.03,
    ) {
        let psm = if si { Psm::Si } else { Psm::Classic };
        let instrument = Kinematics::new(psm).instrument().with_jaw(jaw);
        let arm = Kinematics::new(psm).with_instrument(instrument)?;
        let joints = joints_at(&arm, shares);
        let cases: [(Matrix6<f64>, Pose); 2] = [
            (arm.wrist_jacobian(&joints)?, |arm, joints| arm.rcm_from_wrist(joints).unwrap().0),
            (arm.tip_jacobian(&joints)?, |arm, joints| arm.rcm_from_tip(joints).unwrap().0),
        ];
        for (jacobian, pose) in cases {
            let here = pose(&arm, &joints);
            for i in 0..6 {
                // Central differences: error step² / 6 = 2e-11 and rounding 1e-16 / step = 1e-11.
                let step = 1e-5;
                let [ahead, behind] = [step, -step].map(|step| {
                    let mut moved = joints;
                    moved[i] += step;
                    pose(&arm, &moved)
                });
                let linear = (ahead.translation.vector - behind.translation.vector) / (2.0 * step);
                let slope = (ahead.rotation.to_rotation_matrix().matrix()
                    - behind.rotation.to_rotation_matrix().matrix()) / (2.0 * step);
                let spin = slope * here.rotation.to_rotation_matrix().matrix().transpose();
                let angular = Vector3::new(spin[(2, 1)], spin[(0, 2)], spin[(1, 0)]);
                let column = jacobian.column(i);
                prop_assert!((column.fixed_rows::<3>(0) - linear).norm() < 1e-9);
                prop_assert!((column.fixed_rows::<3>(3) - angular).norm() < 1e-9);
            }
        }
    }

    /// The determinant in closed form: the singularities are where the margins say.
    #[test]
    fn singularities_are_where_the_margins_end(
        yaw in -3.0..3.0, pitch in -1.5..1.5, distance in 0.001..0.3, turns in prop::array::uniform3(-3.0..3.0),
    ) {
        let arm = Kinematics::new(Psm::Si);
        let [roll, wrist_pitch, wrist_yaw] = turns;
        let joints: [f64; 6] = [yaw, pitch, distance + WRIST_BEFORE_INSERTION, roll, wrist_pitch, wrist_yaw];
        let determinant = arm.wrist_jacobian(&joints)?.determinant();
        let expected: f64 = distance * pitch.cos() * (distance * wrist_pitch.cos() + 0.0091);
        prop_assert!((determinant.abs() - expected.abs()).abs() < 1e-12);
        let margin = arm.margins(&joints)?.wrist;
        if distance > 0.0091 {
            let mut singular = joints;
            singular[4] = wrist_pitch.abs() + margin;
            prop_assert!(arm.wrist_jacobian(&singular)?.determinant().abs() < 1e-12);
            prop_assert_eq!(margin > 0.0, distance * wrist_pitch.cos() + 0.0091 > 0.0);
        }
    }

    /// A yaw turns the whole arm about the y axis of the remote centre, whatever the other joints.
    #[test]
    fn a_symmetry(shares in prop::array::uniform6(0.1..0.9), more in -0.1..0.1) {
        let arm = Kinematics::new(Psm::Classic);
        let joints = joints_at(&arm, shares);
        let mut turned = joints;
        turned[0] += more;
        let turn = UnitQuaternion::from_axis_angle(&-Vector3::y_axis(), more);
        let expected = turn * arm.rcm_from_wrist(&joints)?.0;
        prop_assert!(gap(&arm.rcm_from_wrist(&turned)?.0, &expected) < 1e-12);
        let reach = arm.inverse_near(&RcmFromWrist(expected), &joints)?;
        prop_assert!((0..6).all(|i| (reach.joints[i] - turned[i]).abs() < 1e-10));
    }

    /// Other lengths round trip as well.
    #[test]
    fn any_instrument(
        shares in prop::array::uniform6(0.0..=1.0), shaft in 0.35..0.43, wrist in 0.001..0.03, jaw in 0.0..0.05,
    ) {
        let instrument = Instrument::default().with_shaft(shaft).with_wrist(wrist).with_jaw(jaw);
        let arm = Kinematics::new(Psm::Classic).with_instrument(instrument)?;
        let mut joints = joints_at(&arm, shares);
        joints[2] = joints[2].max(0.0451 + 0.4318 - shaft).min(0.24);
        let tip = arm.rcm_from_tip(&joints)?;
        let reach = arm.inverse_of_tip(&tip)?;
        prop_assert!(gap(&arm.rcm_from_tip(&reach.joints)?.0, &tip.0) < 1e-9);
    }
}
