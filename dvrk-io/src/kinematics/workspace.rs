//! The workspace of an arm as a test on poses of its tip in the camera frame, with safety margins.
//!
//! ```text
//! contains(camera_from_tip)  ⇔  inverse(rcm_from_camera · camera_from_tip · TransZ(−jaw)) exists, margins kept
//! ```

use derive_setters::Setters;
use nalgebra::Isometry3;

use super::{Joint, Kinematics, RcmFromTip, Reach, Unreachable, check_pose};
use crate::Error;

/// Distances that planned poses keep from limits and singularities. The robot silently clips joint values at their
/// limits, so the defaults are larger than the error of a calibration.
#[derive(Debug, Clone, Copy, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct SafetyMargins {
    /// To the limits of the rotational joints, radians. Default 0.035 (2°): 7 mm at the far end of the arm, the
    /// 5–10 mm error of a camera registration.
    pub angle: f64,
    /// To the limits of the insertion and to the least distance from the remote centre, metres. Default 0.005.
    pub length: f64,
    /// To the singularity of the wrist, radians. Default 0.17 (10°), which the joint limits of an 8 mm
    /// instrument guarantee anyway.
    pub wrist: f64,
}

impl Default for SafetyMargins {
    fn default() -> Self {
        Self {
            angle: 0.035,
            length: 0.005,
            wrist: 0.17,
        }
    }
}

impl SafetyMargins {
    /// No margins: only the joint limits.
    pub const NONE: Self = Self {
        angle: 0.0,
        length: 0.0,
        wrist: 0.0,
    };

    pub(crate) fn check(&self) -> Result<(), Error> {
        let values = [self.angle, self.length, self.wrist];
        match values.into_iter().find(|x| !(*x >= 0.0 && x.is_finite())) {
            Some(value) => Err(Error::OutOfRange {
                what: "safety margin",
                value,
                expected: "must be finite and not negative",
            }),
            None => Ok(()),
        }
    }

    /// The first margin that is too small.
    pub(crate) fn short(&self, reach: &Reach) -> Option<Unreachable> {
        let margins = &reach.margins;
        let joints = Joint::ALL
            .into_iter()
            .zip(margins.joints)
            .map(|(joint, margin)| {
                let wanted = if joint == Joint::Insertion {
                    self.length
                } else {
                    self.angle
                };
                (joint.name(), margin, wanted, joint.unit())
            });
        let others = [
            (
                "the distance from the remote centre",
                margins.remote_centre,
                self.length,
                "m",
            ),
            (
                "the wrist before its singularity",
                margins.wrist,
                self.wrist,
                "rad",
            ),
        ];
        joints
            .chain(others)
            .find_map(|(what, margin, wanted, unit)| {
                // A margin that rounding makes slightly negative counts as zero.
                let short = margin < wanted && !(wanted == 0.0 && margin > -1e-9);
                short.then_some(Unreachable::LittleMargin {
                    what,
                    margin,
                    wanted,
                    unit,
                })
            })
    }
}

/// Reachable poses of the tips of an arm's closed jaws, in the camera frame: with +z along the approach and the
/// jaws opening along y.
///
/// A planner that takes a test on poses gets `move |pose| workspace.contains(pose)`.
///
/// ```
/// use std::sync::Arc;
///
/// use dvrk_io::Psm;
/// use dvrk_io::kinematics::{Kinematics, PsmWorkspace};
/// use dvrk_io::nalgebra::Isometry3;
///
/// # fn main() -> Result<(), dvrk_io::Error> {
/// let arm = Kinematics::new(Psm::Classic);
/// let camera_from_rcm = Isometry3::translation(0.1, 0.0, 0.4);
/// let workspace = PsmWorkspace::new(arm, &camera_from_rcm)?;
/// let camera_from_tip = camera_from_rcm * arm.rcm_from_tip(&[0.1, 0.2, 0.15, 0.0, 0.3, 0.0])?.0;
///
/// let test: Arc<dyn Fn(&Isometry3<f64>) -> bool + Send + Sync> =
///     Arc::new(move |pose| workspace.contains(pose));
/// assert!(test(&camera_from_tip));
/// assert!(!test(&Isometry3::translation(0.1, 0.0, 0.8)));
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PsmWorkspace {
    arm: Kinematics,
    rcm_from_camera: Isometry3<f64>,
    margins: SafetyMargins,
}

impl PsmWorkspace {
    /// The workspace of `arm`, whose remote centre is at `camera_from_rcm`, with the default [`SafetyMargins`].
    ///
    /// # Errors
    /// A pose that is not finite or whose quaternion is not a unit.
    pub fn new(arm: Kinematics, camera_from_rcm: &Isometry3<f64>) -> Result<Self, Error> {
        Ok(Self {
            arm,
            rcm_from_camera: check_pose(camera_from_rcm)?.inverse(),
            margins: SafetyMargins::default(),
        })
    }

    /// The same with other margins.
    ///
    /// # Errors
    /// A margin that is negative or not finite.
    pub fn with_margins(self, margins: SafetyMargins) -> Result<Self, Error> {
        margins.check()?;
        Ok(Self { margins, ..self })
    }

    /// Whether the tips can be at `camera_from_tip` with all margins kept; false for a pose that is not
    /// finite.
    pub fn contains(&self, camera_from_tip: &Isometry3<f64>) -> bool {
        self.reach(camera_from_tip).is_ok()
    }

    /// The joint values for a pose of the tips.
    ///
    /// # Errors
    /// [`Error::Unreachable`] with the reason, [`Unreachable::LittleMargin`] among them; [`Error::OutOfRange`]
    /// for an invalid pose.
    pub fn reach(&self, camera_from_tip: &Isometry3<f64>) -> Result<Reach, Error> {
        let rcm_from_tip = RcmFromTip(self.rcm_from_camera * check_pose(camera_from_tip)?);
        let reach = self.arm.inverse_of_tip(&rcm_from_tip)?;
        match self.margins.short(&reach) {
            Some(reason) => Err(reason.into()),
            None => Ok(reach),
        }
    }
}
