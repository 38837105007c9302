//! Where the links of a patient-side manipulator (PSM) are, to take them out of a depth image.
//!
//! ```text
//! base_from_i = Π_{k ≤ i} RotX(α_k) · TransX(a_k) · RotZ(θ_k) · TransZ(d_k)          modified Denavit–Hartenberg
//!
//! joint        α      a        θ            d
//! yaw          π/2    0        q1 + π/2     0
//! pitch       −π/2    0        q2 − π/2     0
//! insertion    π/2    0        0            q3 − carriage
//! roll         0      0        q4           shaft
//! wrist pitch −π/2    0        q5 − π/2     0
//! wrist yaw   −π/2    0.0091   q6 − π/2     0
//! ```
//! The base is the remote centre of motion, the point that the shaft always passes through. The tip frame has
//! +z along the approach, and the jaws turn about its x axis. Numbers are those of the robot's own
//! configuration (PSM.json, PSM_Si.json, large needle driver).

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

use crate::Error;
use crate::depth::Capsule;

/// Wrist pitch axis to wrist yaw axis, metres.
const WRIST: f64 = 0.0091;
/// Wrist yaw axis to the tip of the jaws, metres: the robot leaves it out of its poses.
const JAW: f64 = 0.0102;
/// Radii of shaft, wrist and one finger of an 8 mm instrument, metres.
const SHAFT_RADIUS: f64 = 0.0042;
const WRIST_RADIUS: f64 = 0.0045;
const FINGER_RADIUS: f64 = 0.0025;

/// The generation of a da Vinci.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Psm {
    /// The first generation.
    #[default]
    Classic,
    /// S and Si.
    Si,
}

impl Psm {
    /// Carriage offset and shaft length, metres.
    fn lengths(self) -> (f64, f64) {
        match self {
            Self::Classic => (0.4318, 0.4162),
            Self::Si => (0.4826, 0.4670),
        }
    }

    /// Frames after each joint, in the base frame, for joint values in radians (insertion in metres).
    fn frames(self, joints: &[f64; 6]) -> [Isometry3<f64>; 6] {
        let (carriage, shaft) = self.lengths();
        let [yaw, pitch, insertion, roll, wrist_pitch, wrist_yaw] = *joints;
        let links = [
            (FRAC_PI_2, 0.0, yaw + FRAC_PI_2, 0.0),
            (-FRAC_PI_2, 0.0, pitch - FRAC_PI_2, 0.0),
            (FRAC_PI_2, 0.0, 0.0, insertion - carriage),
            (0.0, 0.0, roll, shaft),
            (-FRAC_PI_2, 0.0, wrist_pitch - FRAC_PI_2, 0.0),
            (-FRAC_PI_2, WRIST, wrist_yaw - FRAC_PI_2, 0.0),
        ];
        let mut base_from_link = Isometry3::identity();
        links.map(|link| {
            base_from_link *= modified_dh(link);
            base_from_link
        })
    }

    /// Pose of the control point (on the wrist yaw axis) in the base frame: what the robot calls
    /// `local/measured_cp`.
    ///
    /// # Errors
    /// A joint value that is not finite.
    pub fn base_from_tip(self, joints: &[f64; 6]) -> Result<Isometry3<f64>, Error> {
        check(joints)?;
        let tip = Matrix3::new(0.0, -1.0, 0.0, 0.0, 0.0, 1.0, -1.0, 0.0, 0.0);
        let yaw_from_tip =
            UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(tip));
        let [.., base_from_yaw] = self.frames(joints);
        Ok(base_from_yaw * yaw_from_tip)
    }

    /// The instrument as capsules in the camera frame: shaft from carriage to wrist, wrist, two fingers.
    /// `jaw` is the angle between the fingers in radians.
    ///
    /// # Errors
    /// A joint value or jaw angle that is not finite.
    pub fn capsules(
        self,
        camera_from_base: &Isometry3<f64>,
        joints: &[f64; 6],
        jaw: f64,
    ) -> Result<Vec<Capsule>, Error> {
        check(&[jaw])?;
        let camera_from_tip = camera_from_base * self.base_from_tip(joints)?;
        let [_, _, carriage, wrist, ..] = self
            .frames(joints)
            .map(|frame| camera_from_base * Point3::from(frame.translation.vector));
        let yaw = camera_from_tip * Point3::origin();
        // A squeezing jaw has a negative angle; its fingers touch.
        let finger = |side: f64| {
            let turn = Rotation3::from_axis_angle(&Vector3::x_axis(), side * jaw.max(0.0) / 2.0);
            Capsule {
                start: yaw,
                end: camera_from_tip * (turn * Point3::new(0.0, 0.0, JAW)),
                radius: FINGER_RADIUS,
            }
        };
        Ok(vec![
            Capsule {
                start: carriage,
                end: wrist,
                radius: SHAFT_RADIUS,
            },
            Capsule {
                start: wrist,
                end: yaw,
                radius: WRIST_RADIUS,
            },
            finger(1.0),
            finger(-1.0),
        ])
    }
}

fn modified_dh((alpha, a, theta, d): (f64, f64, f64, f64)) -> Isometry3<f64> {
    let about = |axis, angle| UnitQuaternion::from_axis_angle(&axis, angle);
    let turn_x = Isometry3::from_parts(Translation3::identity(), about(Vector3::x_axis(), alpha));
    let turn_z = Isometry3::from_parts(
        Translation3::new(a, 0.0, 0.0),
        about(Vector3::z_axis(), theta),
    );
    turn_x * turn_z * Translation3::new(0.0, 0.0, d)
}

fn check(joints: &[f64]) -> Result<(), Error> {
    match joints.iter().find(|value| !value.is_finite()) {
        Some(&value) => Err(Error::OutOfRange {
            what: "joint value",
            value,
            expected: "must be finite",
        }),
        None => Ok(()),
    }
}
