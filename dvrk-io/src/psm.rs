//! The links of a patient-side manipulator (PSM), for removing them from a depth image.
//!
//! ```text
//! shaft    frame 3 (carriage) … frame 4 (wrist pitch axis)
//! wrist    frame 4 … wrist frame (wrist yaw axis)
//! finger   wrist frame … RotX(±jaw/2) · (0, 0, 10.2 mm)
//! ```
//! Frames are those of [`kinematics`](crate::kinematics), poses in that of the remote centre.

use nalgebra::{Isometry3, Point3, Rotation3, Vector3};

use crate::Error;
use crate::depth::Capsule;
use crate::kinematics::{Kinematics, check_joints};

/// Radii of shaft, wrist and one finger of an 8 mm instrument, metres.
const SHAFT_RADIUS: f64 = 0.0042;
const WRIST_RADIUS: f64 = 0.0045;
const FINGER_RADIUS: f64 = 0.0025;

/// The generation of a da Vinci.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub enum Psm {
    /// The first generation.
    #[default]
    Classic,
    /// S and Si.
    Si,
}

impl Psm {
    /// The arm with the large needle driver of its generation as capsules in the camera frame: see
    /// [`Kinematics::capsules`].
    ///
    /// # Errors
    /// A joint value or jaw angle that is not finite.
    pub fn capsules(
        self,
        camera_from_rcm: &Isometry3<f64>,
        joints: &[f64; 6],
        jaw: f64,
    ) -> Result<Vec<Capsule>, Error> {
        Kinematics::new(self).capsules(camera_from_rcm, joints, jaw)
    }
}

impl Kinematics {
    /// The instrument as capsules in the camera frame: shaft from carriage to wrist, wrist, two fingers.
    /// `jaw` is the angle between the fingers in radians. Thick enough for an instrument of 8 mm.
    ///
    /// # Errors
    /// A joint value or jaw angle that is not finite.
    pub fn capsules(
        &self,
        camera_from_rcm: &Isometry3<f64>,
        joints: &[f64; 6],
        jaw: f64,
    ) -> Result<Vec<Capsule>, Error> {
        check_joints(&[jaw])?;
        let camera_from_wrist = camera_from_rcm * self.rcm_from_wrist(joints)?.0;
        let [_, _, carriage, pitch, ..] = self
            .frames(joints)
            .map(|frame| camera_from_rcm * Point3::from(frame.translation.vector));
        let yaw = camera_from_wrist * Point3::origin();
        // A squeezing jaw has a negative angle; its fingers touch.
        let finger = |side: f64| {
            let turn = Rotation3::from_axis_angle(&Vector3::x_axis(), side * jaw.max(0.0) / 2.0);
            Capsule {
                start: yaw,
                end: camera_from_wrist * (turn * Point3::new(0.0, 0.0, self.instrument().jaw)),
                radius: FINGER_RADIUS,
            }
        };
        Ok(vec![
            Capsule {
                start: carriage,
                end: pitch,
                radius: SHAFT_RADIUS,
            },
            Capsule {
                start: pitch,
                end: yaw,
                radius: WRIST_RADIUS,
            },
            finger(1.0),
            finger(-1.0),
        ])
    }
}
