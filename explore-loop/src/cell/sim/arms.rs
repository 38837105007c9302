//! The arms of the cell: where they stand, where they wait, and what they can reach.
//!
//! ```text
//!            free                               PSM
//! stands     0.40 m from the centre             remote centre 0.24 m from a point 3 cm above the centre, 50° up
//! waits      0.34 m from the centre, 0.16 m up  the shaft straight down from the remote centre, 55 mm beyond it
//! reaches    every pose within 0.65 m           poses within the joint limits of an S or Si with a large needle driver
//! ```

use dvrk_io::Psm;
use dvrk_io::kinematics::{Kinematics, PsmWorkspace, RcmFromTip, SafetyMargins};
use nalgebra::{Isometry3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::SimOptions;
use super::options::ArmModel;
use crate::cell::{ArmInfo, Poses};

/// Names and sides of the arms in the world frame; the third arm stands at the camera's −y, the world's +y.
fn sides() -> [(&'static str, Vector3<f64>); 3] {
    [
        ("PSM1", Vector3::x()),
        ("PSM2", -Vector3::x()),
        ("PSM3", Vector3::y()),
    ]
}

/// The point that a remote centre faces (height above the table), its distance, and its elevation.
const MIDDLE: f64 = 0.03;
const AWAY: f64 = 0.24;
const ELEVATION: f64 = 50.0;
/// Distance that joints keep from their limits: radians and metres.
const MARGIN: f64 = 0.02;
const LENGTH_MARGIN: f64 = 0.002;
/// Insertion while an arm waits, metres: its wrist is 55 mm beyond the remote centre.
const WAITING: f64 = 0.0706;

/// The properties of the arms of a cell.
pub(super) fn arms(
    options: &SimOptions,
    camera_from_world: &Isometry3<f64>,
) -> Result<Vec<ArmInfo>, dvrk_io::Error> {
    let sides = sides().into_iter().take(options.arms);
    let arm = |(name, side): (&str, Vector3<f64>)| match options.arm_model {
        ArmModel::Free => Ok(free(options, camera_from_world, name, &side)),
        ArmModel::Psm => psm(options, camera_from_world, name, &side),
    };
    sides.map(arm).collect()
}

/// Poses of the remote centres of the arms, camera frame; empty for arms without joints.
pub(super) fn remote_centres(
    options: &SimOptions,
    camera_from_world: &Isometry3<f64>,
) -> Vec<Isometry3<f64>> {
    match options.arm_model {
        ArmModel::Free => Vec::new(),
        ArmModel::Psm => sides()
            .iter()
            .take(options.arms)
            .map(|(_, side)| camera_from_world * world_from_rcm(side))
            .collect(),
    }
}

/// The instrument of a simulated PSM.
pub(super) fn kinematics() -> Kinematics {
    Kinematics::new(Psm::Si)
}

/// Joint values of a waiting simulated PSM: its shaft hangs straight down.
pub(super) fn waiting() -> [f64; 6] {
    let down = (90.0 - ELEVATION).to_radians();
    [0.0, down, WAITING, 0.0, 0.0, 0.0]
}

/// The frame of a remote centre: −z, the direction of the shaft at zero joint values, points to the centre of the table; x is horizontal.
fn world_from_rcm(side: &Vector3<f64>) -> Isometry3<f64> {
    let (sin, cos) = ELEVATION.to_radians().sin_cos();
    let outward = side * cos + Vector3::z() * sin;
    let place = Vector3::new(0.0, 0.0, MIDDLE) + AWAY * outward;
    let x = Vector3::z().cross(side);
    let axes = Rotation3::from_basis_unchecked(&[x, outward.cross(&x), outward]);
    Isometry3::from_parts(
        Translation3::from(place),
        UnitQuaternion::from_rotation_matrix(&axes),
    )
}

/// An arm without joints.
fn free(
    options: &SimOptions,
    camera_from_world: &Isometry3<f64>,
    name: &str,
    side: &Vector3<f64>,
) -> ArmInfo {
    let base = Point3::from(side * 0.40 + Vector3::z() * 0.10);
    let tip = Point3::from(side * 0.34 + Vector3::z() * 0.16);
    let approach = -(side + Vector3::z());
    let world_from_home = Isometry3::from_parts(
        Translation3::from(tip.coords),
        // y is horizontal, so the jaws open sideways.
        UnitQuaternion::face_towards(&approach, &side.cross(&Vector3::z())),
    );
    ArmInfo {
        name: name.to_owned(),
        camera_from_home: camera_from_world * world_from_home,
        base: camera_from_world * base,
        reach: 0.65,
        poses: None,
        jaw_radius: options.jaw.half_opening,
        max_speed: options.max_speed,
    }
}

fn psm(
    options: &SimOptions,
    camera_from_world: &Isometry3<f64>,
    name: &str,
    side: &Vector3<f64>,
) -> Result<ArmInfo, dvrk_io::Error> {
    let (arm, camera_from_rcm) = (kinematics(), camera_from_world * world_from_rcm(side));
    let margins = SafetyMargins::default()
        .with_angle(MARGIN)
        .with_length(LENGTH_MARGIN)
        .with_wrist(MARGIN);
    let workspace = PsmWorkspace::new(arm, &camera_from_rcm)?.with_margins(margins)?;
    let RcmFromTip(home) = arm.rcm_from_tip(&waiting())?;
    let [_, _, [_, insertion], ..] = *arm.limits();
    Ok(ArmInfo {
        name: name.to_owned(),
        camera_from_home: camera_from_rcm * home,
        base: Point3::from(camera_from_rcm.translation.vector),
        reach: insertion + arm.instrument().jaw,
        poses: Some(Poses::new(move |pose| workspace.contains(pose))),
        jaw_radius: options.jaw.half_opening,
        max_speed: options.max_speed,
    })
}
