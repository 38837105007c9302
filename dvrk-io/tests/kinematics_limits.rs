//! Kinematics of the PSM: limits, whole turns, margins, and what is refused.
#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::float_cmp,
    reason = "tests; copied values must be the same bits"
)]

mod arms;

use arms::*;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

use dvrk_io::kinematics::{
    Instrument, Joint, Kinematics, PsmWorkspace, RcmFromTip, RcmFromWrist, SafetyMargins,
    Unreachable,
};
use dvrk_io::{Error, Psm};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use proptest::prelude::*;

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

proptest! {
    /// Any bits: an answer or a named error, and an answer is finite and within limits.
    #[test]
    fn any_pose(bits in prop::array::uniform7(prop::num::f64::ANY), unit: bool, near_by: bool, near in prop::array::uniform6(prop::num::f64::ANY)) {
        let arm = Kinematics::new(Psm::Classic);
        let [x, y, z, qx, qy, qz, qw] = bits.map(|x| if near_by { x % 0.3 } else { x });
        let turn = Quaternion::new(qw, qx, qy, qz);
        let turn = if unit { UnitQuaternion::new_normalize(turn) } else { UnitQuaternion::new_unchecked(turn) };
        let pose = RcmFromWrist(Isometry3::from_parts(Translation3::new(x, y, z), turn));
        for reach in [arm.inverse(&pose), arm.inverse_near(&pose, &near)].into_iter().flatten() {
            prop_assert!(reach.joints.iter().all(|joint| joint.is_finite()));
            prop_assert!(reach.margins.joints.iter().all(|&margin| margin >= 0.0));
        }
    }
}
