//! The topics of a session, in one place for reader and writer.

use crate::Error;
use crate::cdr::{JointState, Message, Plane, PointCloud2, PoseStamped};

/// The segmented cloud of the object, camera frame.
pub(super) const POINTS: &str = "/cell/points";
/// The table, camera frame.
pub(super) const TABLE: &str = "/cell/table";
/// Where the material points truly are: only from simulations, only for measures.
pub(super) const TRUTH: &str = "/truth/points";
const POSE: &str = "/measured_cp";
const JAW: &str = "/jaw/measured_js";

/// What a topic means to a session.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Topic {
    Points,
    Table,
    Truth,
    /// Tip pose of the arm of this name.
    Pose(String),
    /// Jaw angle of the arm of this name.
    Jaw(String),
}

impl Topic {
    /// What `name` means, if anything. Arms that hold no instrument (endoscope, master arms) publish topics
    /// of the same names; they are not arms of a session.
    pub(super) fn parse(name: &str) -> Option<Self> {
        let arm = |suffix| {
            let arm: &str = name.strip_prefix('/')?.strip_suffix(suffix)?;
            let is_instrument =
                is_arm_name(arm) && !arm.starts_with("ECM") && !arm.starts_with("MTM");
            is_instrument.then(|| arm.to_owned())
        };
        match name {
            POINTS => Some(Self::Points),
            TABLE => Some(Self::Table),
            TRUTH => Some(Self::Truth),
            _ => arm(JAW)
                .map(Self::Jaw)
                .or_else(|| arm(POSE).map(Self::Pose)),
        }
    }

    pub(super) fn name(&self) -> String {
        match self {
            Self::Points => POINTS.to_owned(),
            Self::Table => TABLE.to_owned(),
            Self::Truth => TRUTH.to_owned(),
            Self::Pose(arm) => format!("/{arm}{POSE}"),
            Self::Jaw(arm) => format!("/{arm}{JAW}"),
        }
    }

    pub(super) fn type_name(&self) -> &'static str {
        match self {
            Self::Points | Self::Truth => PointCloud2::TYPE,
            Self::Table => Plane::TYPE,
            Self::Pose(_) => PoseStamped::TYPE,
            Self::Jaw(_) => JointState::TYPE,
        }
    }
}

/// One segment of a ROS 2 topic name.
fn is_arm_name(name: &str) -> bool {
    let ok = |c: char| c.is_ascii_alphanumeric() || c == '_';
    name.chars().all(ok) && !name.is_empty() && !name.starts_with(|c: char| c.is_ascii_digit())
}

/// # Errors
/// The name cannot be one segment of a topic, or names an arm without an instrument.
pub(super) fn check_arm_name(name: &str) -> Result<(), Error> {
    match Topic::parse(&Topic::Pose(name.to_owned()).name()) {
        Some(Topic::Pose(_)) => Ok(()),
        _ => Err(Error::BadArmName {
            name: name.to_owned(),
        }),
    }
}
