//! Checks the frames of an arm.
//!
//! ```text
//! rcm_from_wrist(measured_js)  ≟  local/measured_cp             a dVRK:      the control point is on the wrist
//! rcm_from_tip(measured_js)    ≟  local/measured_cp             a simulator: it is at the tips of the jaws, 10.2 mm further
//! reference_from_rcm           =  measured_cp · (local/measured_cp)⁻¹
//! ```
//! An arm of another generation, with another instrument, or with another order of joints, agrees with neither.

use super::frames::ReferenceFromRcm;
use super::line::apart;
use super::options::Tolerance;
use super::state::ControlPoint;
use crate::Error;
use crate::kinematics::Kinematics;
use nalgebra::Isometry3;

/// The frames of an arm, as determined by the check.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct FrameCheck {
    /// The point that the arm reports and follows.
    pub control_point: ControlPoint,
    /// Pose of the remote centre in the frame of `measured_cp`.
    pub reference_from_rcm: ReferenceFromRcm,
    /// The name of that frame in the messages of the robot.
    pub reference: String,
    /// Distance between the reported pose and that of the joint values, metres.
    pub distance: f64,
    /// Angle between them.
    pub angle: f64,
}

/// The poses to compare.
pub(crate) struct Frames<'a> {
    pub(crate) measured: &'a Isometry3<f64>,
    pub(crate) reference: &'a str,
    /// `None`: the reference frame is assumed to be that of the remote centre.
    pub(crate) local: Option<&'a Isometry3<f64>>,
    pub(crate) joints: &'a [f64; 6],
}

pub(crate) fn check_frames(
    kinematics: &Kinematics,
    tolerance: Tolerance,
    frames: &Frames<'_>,
) -> Result<FrameCheck, Error> {
    let reported = frames.local.unwrap_or(frames.measured);
    let wrist = kinematics.rcm_from_wrist(frames.joints)?;
    let tip = kinematics.tip_of(&wrist);
    let from_wrist = apart(reported, &wrist.0);
    let from_tip = apart(reported, &tip.0);
    let (control_point, (distance, angle)) = if from_wrist.0 <= from_tip.0 {
        (ControlPoint::Wrist, from_wrist)
    } else {
        (ControlPoint::Tip, from_tip)
    };
    if !tolerance.holds((distance, angle)) {
        return Err(Error::FramesDisagree { distance, angle });
    }
    let reference_from_rcm = frames.local.map_or_else(Isometry3::identity, |local| {
        frames.measured * local.inverse()
    });
    Ok(FrameCheck {
        control_point,
        reference_from_rcm: ReferenceFromRcm(reference_from_rcm),
        reference: frames.reference.to_owned(),
        distance,
        angle,
    })
}

impl FrameCheck {
    /// Compares with the expected reference frame, such as
    /// [`Calibration::dvrk_camera_from_rcm`](crate::calibration::Calibration::dvrk_camera_from_rcm) if the robot was configured with it. Returns
    /// distance and angle.
    ///
    /// # Errors
    /// [`Error::BaseFrame`]: the frames differ by more than `tolerance`.
    pub fn compare_base(
        &self,
        expected: &ReferenceFromRcm,
        tolerance: Tolerance,
    ) -> Result<(f64, f64), Error> {
        let (distance, angle) = apart(&self.reference_from_rcm.0, &expected.0);
        if tolerance.holds((distance, angle)) {
            Ok((distance, angle))
        } else {
            Err(Error::BaseFrame { distance, angle })
        }
    }
}
