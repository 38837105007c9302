//! Forward kinematics of the PSM against published values and closed forms.
#![allow(missing_docs, clippy::unwrap_used, reason = "tests")]

use dvrk_io::Psm;
use dvrk_io::kinematics::Kinematics;
use nalgebra::{Isometry3, Matrix3, Point3, Vector3};
use proptest::prelude::*;

/// Distance from the remote centre to the wrist pitch axis is the insertion less this, both generations.
const WRIST_BEFORE_INSERTION: f64 = 0.0156;

#[test]
fn home_is_where_the_robot_says() {
    for psm in [Psm::Classic, Psm::Si] {
        let wrist = Kinematics::new(psm).rcm_from_wrist(&[0.0, 0.0, 0.12, 0.0, 0.0, 0.0]);
        let tip = wrist.unwrap().0;
        // 0.12 − 0.0156 + 0.0091 below the remote centre.
        assert!(
            (tip.translation.vector - Vector3::new(0.0, 0.0, -0.1135)).norm() < 1e-12,
            "{tip}"
        );
        let expected = Matrix3::new(0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -1.0);
        assert!(
            (tip.rotation.to_rotation_matrix().matrix() - expected).norm() < 1e-12,
            "{tip}"
        );
    }
}

#[test]
fn yaw_goes_to_plus_x_and_pitch_to_minus_y() {
    let tip = |yaw, pitch| {
        Kinematics::new(Psm::Classic)
            .rcm_from_wrist(&[yaw, pitch, 0.12, 0.0, 0.0, 0.0])
            .unwrap()
            .0
            .translation
    };
    assert!(tip(0.1, 0.0).x > 0.01 && tip(0.1, 0.0).y.abs() < 1e-12);
    assert!(tip(0.0, 0.1).y < -0.01 && tip(0.0, 0.1).x.abs() < 1e-12);
}

#[test]
fn the_jaws_open_across_the_approach() {
    let camera_from_base =
        Isometry3::new(Vector3::new(0.1, 0.2, 0.5), Vector3::new(0.3, -0.2, 0.1));
    let joints = [0.2, -0.3, 0.15, 0.7, -0.4, 0.5];
    let camera_from_tip =
        camera_from_base * Kinematics::new(Psm::Si).rcm_from_wrist(&joints).unwrap().0;
    let ends = |jaw: f64| {
        let capsules = Psm::Si.capsules(&camera_from_base, &joints, jaw).unwrap();
        [2, 3].map(|finger: usize| camera_from_tip.inverse_transform_point(&capsules[finger].end))
    };
    let [left, right] = ends(0.8);
    // Mirror images in the plane y = 0 of the tip, half the angle each, 10.2 mm long.
    assert!(
        left.x.abs() < 1e-12
            && (left.y + right.y).abs() < 1e-12
            && (left.z - right.z).abs() < 1e-12
    );
    assert!(
        (left.coords.norm() - 0.0102).abs() < 1e-12
            && (left.y.abs() - 0.0102 * 0.4_f64.sin()).abs() < 1e-12
    );
    // Closed and squeezing look the same: both fingers along the approach.
    for jaw in [0.0, -0.3] {
        assert!(
            ends(jaw)
                .iter()
                .all(|end| (end - Point3::new(0.0, 0.0, 0.0102)).norm() < 1e-12)
        );
    }
}

#[test]
fn joints_that_are_not_numbers() {
    assert!(
        Kinematics::new(Psm::Classic)
            .rcm_from_wrist(&[0.0, f64::NAN, 0.1, 0.0, 0.0, 0.0])
            .is_err()
    );
    assert!(
        Psm::Classic
            .capsules(&Isometry3::identity(), &[0.0; 6], f64::INFINITY)
            .is_err()
    );
}

proptest! {
    #[test]
    fn the_shaft_passes_through_the_remote_centre(
        yaw in -1.5..1.5, pitch in -0.9..0.9, insertion in 0.05..0.24, turns in prop::array::uniform3(-1.3..1.3), si: bool,
    ) {
        let [roll, wrist_pitch, wrist_yaw] = turns;
        let joints = [yaw, pitch, insertion, roll, wrist_pitch, wrist_yaw];
        let psm = if si { Psm::Si } else { Psm::Classic };
        let [shaft, wrist, ..] = psm.capsules(&Isometry3::identity(), &joints, 0.0)?[..] else { unreachable!() };
        // Closed form, from the geometry of the remote centre alone.
        let direction = Vector3::new(yaw.sin() * pitch.cos(), -pitch.sin(), -yaw.cos() * pitch.cos());
        prop_assert!((shaft.end.coords - direction * (insertion - WRIST_BEFORE_INSERTION)).norm() < 1e-12);
        prop_assert!(shaft.start.coords.cross(&direction).norm() < 1e-12);
        prop_assert!(shaft.start.coords.dot(&direction) < 0.0);
        prop_assert!(((wrist.end - wrist.start).norm() - 0.0091).abs() < 1e-12);
        let tip = Kinematics::new(psm).rcm_from_wrist(&joints)?.0;
        prop_assert!((tip.translation.vector - wrist.end.coords).norm() < 1e-12);
    }
}
