//! Kinematics of the PSM: round trips, the Jacobian against differences, and what is refused.
#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::float_cmp,
    reason = "tests; copied values must be the same bits"
)]

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use dvrk_io::kinematics::{
    Instrument, Joint, Kinematics, PsmWorkspace, RcmFromTip, RcmFromWrist, SafetyMargins,
    Unreachable,
};
use dvrk_io::{Error, Psm};
use nalgebra::{
    DMatrix, Isometry3, Matrix3, Matrix6, Quaternion, Rotation3, Translation3, UnitQuaternion,
    Vector3, Vector6,
};
use proptest::prelude::*;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Distance from the remote centre to the wrist pitch axis is the insertion less this, both generations.
const WRIST_BEFORE_INSERTION: f64 = 0.0156;
const GENERATIONS: [Psm; 2] = [Psm::Classic, Psm::Si];

/// Joint values from shares of the ranges, with the wrist beyond the least distance.
fn joints_at(arm: &Kinematics, shares: [f64; 6]) -> [f64; 6] {
    let mut joints: [f64; 6] = std::array::from_fn(|i| {
        let [lower, upper] = arm.limits()[i];
        (lower + shares[i] * (upper - lower)).clamp(lower, upper)
    });
    let least = arm.min_wrist_distance() + WRIST_BEFORE_INSERTION;
    let most = arm.limits()[2][1];
    joints[2] = (least + shares[2] * (most - least)).clamp(least, most);
    joints
}

fn gap(left: &Isometry3<f64>, right: &Isometry3<f64>) -> f64 {
    // Matrices, not angles: an angle near 0 has only half the digits.
    let turn =
        left.rotation.to_rotation_matrix().matrix() - right.rotation.to_rotation_matrix().matrix();
    (left.translation.vector - right.translation.vector)
        .norm()
        .max(turn.norm())
}

fn reason<T: std::fmt::Debug>(result: Result<T, Error>) -> Unreachable {
    match result {
        Err(Error::Unreachable(reason)) => reason,
        other => panic!("expected a reason, got {other:?}"),
    }
}

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

/// Poses drawn in space rather than from joints: what is answered is the pose, what is refused breaks a limit
/// by an independent account.
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

/// Numbers of the configuration files of the robot, copied once more from there.
#[test]
fn known_limits() {
    let wrist = [-1.39626, 1.39626];
    let roll = [-4.53786, 4.53786];
    assert_eq!(
        Kinematics::new(Psm::Classic).limits(),
        &[
            [-1.588, 1.588],
            [-0.925, 0.925],
            [0.0, 0.240],
            roll,
            wrist,
            wrist
        ]
    );
    assert_eq!(
        Kinematics::new(Psm::Si).limits(),
        &[
            [-2.964, 2.964],
            [-1.265, 1.301],
            [0.0, 0.290],
            roll,
            wrist,
            wrist
        ]
    );
}

#[test]
fn exactly_at_every_limit() {
    for psm in GENERATIONS {
        let arm = Kinematics::new(psm);
        for i in 0..6 {
            for end in 0..2 {
                let mut joints = joints_at(&arm, [0.5; 6]);
                let [lower, upper] = arm.limits()[i];
                // The insertion begins where the wrist is far enough out.
                let first = if i == 2 {
                    arm.min_wrist_distance() + WRIST_BEFORE_INSERTION
                } else {
                    lower
                };
                joints[i] = if end == 0 { first } else { upper };
                let pose = arm.rcm_from_wrist(&joints).unwrap();
                let reach = arm.inverse_near(&pose, &joints).unwrap();
                assert!((reach.joints[i] - joints[i]).abs() < 1e-10);
                let margin = if i == 2 && end == 0 {
                    reach.margins.remote_centre
                } else {
                    reach.margins.joints[i]
                };
                assert!(margin.abs() < 1e-10, "{margin}");
                assert!((lower..=upper).contains(&reach.joints[i]));

                // A micrometre or microradian beyond is refused, with the joint named.
                joints[i] += if end == 0 { -1e-6 } else { 1e-6 };
                let beyond = arm.rcm_from_wrist(&joints).unwrap();
                if i == 3 {
                    // A roll of 260° and a bit is also one of −100°.
                    let roll = arm.inverse_near(&beyond, &joints).unwrap().joints[3];
                    assert!(((roll - joints[3]).abs() - TAU).abs() < 1e-10);
                    continue;
                }
                match reason(arm.inverse_near(&beyond, &joints)) {
                    Unreachable::JointLimit {
                        joint,
                        value,
                        range,
                    } => {
                        assert_eq!((joint, range), (Joint::ALL[i], [lower, upper]));
                        assert!((value - joints[i]).abs() < 1e-9);
                    }
                    Unreachable::TooNearRemoteCentre { distance, limit } => {
                        assert!(i == 2 && end == 0 && limit == 0.045);
                        assert!((distance - limit + 1e-6).abs() < 1e-9);
                    }
                    other => panic!("{other}"),
                }
            }
        }
    }
}

#[test]
fn whole_turns_of_the_roll() {
    let arm = Kinematics::new(Psm::Classic);
    let at = |roll| {
        arm.rcm_from_wrist(&[0.1, 0.2, 0.15, roll, 0.3, 0.4])
            .unwrap()
    };
    // 200° and −160° are the same pose: the reference decides, 0 without one.
    let (over, under) = (200_f64.to_radians(), -160_f64.to_radians());
    let near = |reference: f64| {
        arm.inverse_near(&at(over), &[0.0, 0.0, 0.1, reference, 0.0, 0.0])
            .unwrap()
            .joints[3]
    };
    assert!((near(3.0) - over).abs() < 1e-12);
    assert!((near(-1.0) - under).abs() < 1e-12);
    assert!((near(1e300) - over).abs() < 1e-12);
    assert!((arm.inverse(&at(over)).unwrap().joints[3] - under).abs() < 1e-12);
    // 90° has no second turn within ±260°, whatever the reference.
    let quarter = |reference: f64| {
        arm.inverse_near(&at(FRAC_PI_2), &[0.0, 0.0, 0.1, reference, 0.0, 0.0])
            .unwrap()
            .joints[3]
    };
    assert!(
        [-4.5, 0.0, 4.5, -1e9]
            .map(quarter)
            .iter()
            .all(|roll| (roll - FRAC_PI_2).abs() < 1e-12)
    );
    // ±180° do not flip between two neighbours.
    for roll in [PI - 1e-9, PI, PI + 1e-9, 1e-9 - PI, -PI, -PI - 1e-9] {
        let joints = [0.1, 0.2, 0.15, roll, 0.3, 0.4];
        let back = arm.inverse_near(&at(roll), &joints).unwrap().joints[3];
        assert!((back - roll).abs() < 1e-12);
    }
}

#[test]
fn at_the_remote_centre_and_at_the_singular_wrist() {
    let arm = Kinematics::new(Psm::Classic);
    let any_turn = UnitQuaternion::from_euler_angles(0.3, 0.5, 0.7);
    for distance in [0.0, 1e-12, 1e-4, 0.01, 0.03] {
        let pose = Isometry3::from_parts(Translation3::new(0.0, 0.0, -distance), any_turn);
        let reason = reason(arm.inverse(&RcmFromWrist(pose)));
        assert!(
            matches!(reason, Unreachable::TooNearRemoteCentre { .. }),
            "{distance}: {reason}"
        );
    }
    // Wrist yaw axis through the remote centre: the axis is −x of the wrist frame.
    let axis = UnitQuaternion::rotation_between(&Vector3::x(), &Vector3::z()).unwrap();
    let pose = Isometry3::from_parts(Translation3::new(0.0, 0.0, -0.1), axis);
    assert!(matches!(
        reason(arm.inverse(&RcmFromWrist(pose))),
        Unreachable::WristSingular { distance } if distance < 1e-5
    ));
    // Bent by 85°: a wrist limit, not a number that is not one.
    let bent = arm
        .rcm_from_wrist(&[0.0, 0.0, 0.15, 0.0, 85_f64.to_radians(), 0.0])
        .unwrap();
    assert!(matches!(
        reason(arm.inverse(&bent)),
        Unreachable::JointLimit {
            joint: Joint::WristPitch,
            ..
        }
    ));
    // Above the remote centre, outside the body.
    let above = Isometry3::from_parts(Translation3::new(0.0, 0.0, 0.1), any_turn);
    assert!(arm.inverse(&RcmFromWrist(above)).is_err());
}

#[test]
fn numbers_that_are_none() {
    let arm = Kinematics::new(Psm::Classic);
    let good = arm
        .rcm_from_wrist(&[0.0, 0.0, 0.12, 0.0, 0.0, 0.0])
        .unwrap()
        .0;
    for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300] {
        for axis in 0..3 {
            let mut bad = good;
            bad.translation.vector[axis] = value;
            assert!(matches!(
                arm.inverse(&RcmFromWrist(bad)),
                Err(Error::OutOfRange { .. })
            ));
            assert!(matches!(
                arm.inverse_of_tip(&RcmFromTip(bad)),
                Err(Error::OutOfRange { .. })
            ));
        }
        for i in 0..4 {
            let mut quaternion = good.rotation.into_inner();
            quaternion[i] = value;
            let bad =
                Isometry3::from_parts(good.translation, UnitQuaternion::new_unchecked(quaternion));
            assert!(matches!(
                arm.inverse(&RcmFromWrist(bad)),
                Err(Error::OutOfRange { .. })
            ));
            let workspace = PsmWorkspace::new(arm, &Isometry3::identity()).unwrap();
            assert!(!workspace.contains(&bad));
            assert!(PsmWorkspace::new(arm, &bad).is_err());
        }
    }
    let zero = UnitQuaternion::new_unchecked(Quaternion::new(0.0, 0.0, 0.0, 0.0));
    let bad = Isometry3::from_parts(good.translation, zero);
    assert!(arm.inverse(&RcmFromWrist(bad)).is_err());
    for value in [f64::NAN, f64::INFINITY] {
        for i in 0..6 {
            let mut joints = [0.0, 0.0, 0.12, 0.0, 0.0, 0.0];
            joints[i] = value;
            assert!(arm.rcm_from_wrist(&joints).is_err() && arm.rcm_from_tip(&joints).is_err());
            assert!(arm.wrist_jacobian(&joints).is_err() && arm.margins(&joints).is_err());
            assert!(arm.inverse_near(&RcmFromWrist(good), &joints).is_err());
        }
        let bad = Instrument::default().with_jaw(value);
        assert!(arm.with_instrument(bad).is_err());
        assert!(arm.with_min_wrist_distance(value).is_err());
        let margins = SafetyMargins::default().with_angle(value);
        let workspace = PsmWorkspace::new(arm, &Isometry3::identity()).unwrap();
        assert!(workspace.with_margins(margins).is_err());
        for i in 0..6 {
            let mut limits = *arm.limits();
            limits[i][1] = value;
            assert!(arm.with_limits(limits).is_err());
        }
    }
    let mut swapped = *arm.limits();
    swapped[4] = [0.5, -0.5];
    assert!(arm.with_limits(swapped).is_err());
    let mut folded = *arm.limits();
    folded[4] = [-1.6, 1.0];
    assert!(arm.with_limits(folded).is_err());
    assert!(
        arm.with_instrument(Instrument::default().with_wrist(0.0))
            .is_err()
    );
    assert!(arm.with_min_wrist_distance(0.0).is_err());
}

/// A joint may be locked; then only its value is reached.
#[test]
fn a_locked_joint() {
    let mut limits = *Kinematics::new(Psm::Classic).limits();
    limits[3] = [0.5, 0.5];
    let arm = Kinematics::new(Psm::Classic).with_limits(limits).unwrap();
    let at = |roll| {
        arm.rcm_from_wrist(&[0.1, 0.2, 0.15, roll, 0.3, 0.4])
            .unwrap()
    };
    assert_eq!(arm.inverse(&at(0.5)).unwrap().joints[3], 0.5);
    assert!(matches!(
        reason(arm.inverse(&at(0.6))),
        Unreachable::JointLimit {
            joint: Joint::Roll,
            ..
        }
    ));
}

#[test]
fn margins_of_a_workspace() {
    let arm = Kinematics::new(Psm::Si);
    let camera_from_rcm =
        Isometry3::new(Vector3::new(0.1, -0.2, 0.3), Vector3::new(1.0, 0.3, -0.4));
    let workspace = PsmWorkspace::new(arm, &camera_from_rcm).unwrap();
    let at = |joints: [f64; 6]| camera_from_rcm * arm.rcm_from_tip(&joints).unwrap().0;
    let inside = [0.4, 0.3, 0.2, 1.0, 0.5, -0.5];
    let reach = workspace.reach(&at(inside)).unwrap();
    assert!((0..6).all(|i| (reach.joints[i] - inside[i]).abs() < 1e-10));
    // 1.5° before a limit: within the range, not within the margin of 2°.
    let mut close = inside;
    close[1] = 1.301 - 1.5_f64.to_radians();
    let Unreachable::LittleMargin {
        what,
        margin,
        wanted,
        ..
    } = reason(workspace.reach(&at(close)))
    else {
        panic!()
    };
    assert_eq!((what, wanted), ("pitch", 0.035));
    assert!((margin - 1.5_f64.to_radians()).abs() < 1e-9);
    let eager = workspace.with_margins(SafetyMargins::NONE).unwrap();
    assert!(!workspace.contains(&at(close)) && eager.contains(&at(close)));
    // Without margins, the limit itself is reached.
    close[1] = 1.301;
    close[2] = 0.045 + WRIST_BEFORE_INSERTION;
    assert!(eager.contains(&at(close)));
}

/// Messages say joint, value, range and unit in few digits.
#[test]
fn messages() {
    let arm = Kinematics::new(Psm::Classic);
    let beyond = arm
        .rcm_from_wrist(&[0.0, 1.0, 0.15, 0.0, 0.0, 0.0])
        .unwrap();
    let message = arm.inverse(&beyond).unwrap_err().to_string();
    assert_eq!(
        message,
        "unreachable: pitch would be 1.000 rad, its range is -0.925 to 0.925"
    );
    let near = arm
        .rcm_from_wrist(&[0.0, 0.0, 0.04, 0.0, 0.0, 0.0])
        .unwrap();
    let message = arm.inverse(&near).unwrap_err().to_string();
    assert_eq!(
        message,
        "unreachable: the wrist would be 24.4 mm from the remote centre, at least 45.0 mm are needed"
    );
}

type Pose = fn(&Kinematics, &[f64; 6]) -> Isometry3<f64>;

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

    /// Any bits: an answer or a named error, and an answer is finite and within limits.
    #[test]
    fn any_pose(bits in prop::array::uniform7(any::<f64>()), unit: bool, near in prop::array::uniform6(any::<f64>())) {
        let arm = Kinematics::new(Psm::Classic);
        let [x, y, z, qx, qy, qz, qw] = bits;
        let turn = Quaternion::new(qw, qx, qy, qz);
        let turn = if unit { UnitQuaternion::new_normalize(turn) } else { UnitQuaternion::new_unchecked(turn) };
        let pose = RcmFromWrist(Isometry3::from_parts(Translation3::new(x, y, z), turn));
        for reach in [arm.inverse(&pose), arm.inverse_near(&pose, &near)].into_iter().flatten() {
            prop_assert!(reach.joints.iter().all(|joint| joint.is_finite()));
            prop_assert!(reach.margins.joints.iter().all(|&margin| margin >= 0.0));
        }
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
