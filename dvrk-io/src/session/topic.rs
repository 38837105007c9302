//! Roles of topics in a session, shared by reader and writer.

use std::fmt;
use std::str::FromStr;

use crate::Error;
use crate::cdr::{CameraInfo, Image, JointState, Message, Plane, PointCloud2, PoseStamped};

const POINTS: &str = "/cell/points";
const FEATURES: &str = "/cell/features";
const CAMERA: &str = "/cell/camera";
const TABLE: &str = "/cell/table";
const TRUTH: &str = "/truth/points";
const POSE: &str = "/measured_cp";
const JAW: &str = "/jaw/measured_js";
const JAW_SETPOINT: &str = "/jaw/setpoint_js";
const JOINTS: &str = "/measured_js";
/// With the names of a RealSense driver.
const DEPTH: &str = "/camera/camera/depth/image_rect_raw";
const CAMERA_INFO: &str = "/camera/camera/depth/camera_info";
const COLOUR: &str = "/camera/camera/color/image_raw";

/// The role of a topic in a session.
///
/// Written and parsed as its usual topic without the leading slash, or as `points`, `depth`, `camera_info`, `colour`, `features`, `camera`,
/// `table`, `truth`:
///
/// ```
/// use dvrk_io::session::Role;
/// assert_eq!("points".parse::<Role>()?, Role::Points);
/// assert_eq!("PSM1/measured_cp".parse::<Role>()?, Role::Pose("PSM1".into()));
/// assert_eq!(Role::Jaw("PSM2".into()).topic(), "/PSM2/jaw/measured_js");
/// # Ok::<(), dvrk_io::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub enum Role {
    /// Cloud of the object; in a recording of [scans](super::SessionReader::scans), of everything in view.
    Points,
    /// Depth image of everything in view.
    Depth,
    /// Camera parameters of the depth images.
    CameraInfo,
    /// Colour images with the rays and the frame of the depth images.
    Colour,
    /// Features of the colour image on the object: x, y, z and a descriptor.
    Features,
    /// Pose of a camera that moves, in the frame of arms and table.
    Camera,
    /// The table.
    Table,
    /// True positions of the material points: only from simulations, only for measures.
    Truth,
    /// Tip pose of the arm of this name.
    Pose(String),
    /// Jaw angle of the arm of this name.
    Jaw(String),
    /// Commanded jaw angle of the arm of this name.
    JawSetpoint(String),
    /// Joint values of the arm of this name.
    Joints(String),
}

impl Role {
    /// The role of the topic `name`, if it has one. Arms that hold no instrument (endoscope, master
    /// arms) publish topics of the same names, but are not arms of a session.
    pub(super) fn of_topic(name: &str) -> Option<Self> {
        let arm = |suffix| {
            let arm: &str = name.strip_prefix('/')?.strip_suffix(suffix)?;
            let is_instrument =
                is_arm_name(arm) && !arm.starts_with("ECM") && !arm.starts_with("MTM");
            is_instrument.then(|| arm.to_owned())
        };
        match name {
            POINTS => Some(Self::Points),
            FEATURES => Some(Self::Features),
            CAMERA => Some(Self::Camera),
            TABLE => Some(Self::Table),
            TRUTH => Some(Self::Truth),
            DEPTH => Some(Self::Depth),
            CAMERA_INFO => Some(Self::CameraInfo),
            COLOUR => Some(Self::Colour),
            _ => arm(JAW)
                .map(Self::Jaw)
                .or_else(|| arm(JAW_SETPOINT).map(Self::JawSetpoint))
                .or_else(|| arm(POSE).map(Self::Pose))
                .or_else(|| arm(JOINTS).map(Self::Joints)),
        }
    }

    /// The topic of this role unless [`SessionReader::with_topic`](super::SessionReader::with_topic) sets another.
    pub fn topic(&self) -> String {
        match self {
            Self::Points => POINTS.to_owned(),
            Self::Features => FEATURES.to_owned(),
            Self::Camera => CAMERA.to_owned(),
            Self::Table => TABLE.to_owned(),
            Self::Truth => TRUTH.to_owned(),
            Self::Pose(arm) => format!("/{arm}{POSE}"),
            Self::Jaw(arm) => format!("/{arm}{JAW}"),
            Self::JawSetpoint(arm) => format!("/{arm}{JAW_SETPOINT}"),
            Self::Joints(arm) => format!("/{arm}{JOINTS}"),
            Self::Depth => DEPTH.to_owned(),
            Self::CameraInfo => CAMERA_INFO.to_owned(),
            Self::Colour => COLOUR.to_owned(),
        }
    }

    /// ROS 2 type of its messages.
    pub fn type_name(&self) -> &'static str {
        match self {
            Self::Points | Self::Features | Self::Truth => PointCloud2::TYPE,
            Self::Table => Plane::TYPE,
            Self::Pose(_) | Self::Camera => PoseStamped::TYPE,
            Self::Jaw(_) | Self::JawSetpoint(_) | Self::Joints(_) => JointState::TYPE,
            Self::Depth | Self::Colour => Image::TYPE,
            Self::CameraInfo => CameraInfo::TYPE,
        }
    }
}

impl fmt::Display for Role {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Points => formatter.write_str("points"),
            Self::Features => formatter.write_str("features"),
            Self::Camera => formatter.write_str("camera"),
            Self::Table => formatter.write_str("table"),
            Self::Truth => formatter.write_str("truth"),
            Self::Depth => formatter.write_str("depth"),
            Self::CameraInfo => formatter.write_str("camera_info"),
            Self::Colour => formatter.write_str("colour"),
            Self::Pose(_) | Self::Jaw(_) | Self::JawSetpoint(_) | Self::Joints(_) => {
                formatter.write_str(&self.topic()[1..])
            }
        }
    }
}

impl FromStr for Role {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        match text {
            "points" => Ok(Self::Points),
            "features" => Ok(Self::Features),
            "camera" => Ok(Self::Camera),
            "table" => Ok(Self::Table),
            "truth" => Ok(Self::Truth),
            "depth" => Ok(Self::Depth),
            "camera_info" => Ok(Self::CameraInfo),
            "colour" => Ok(Self::Colour),
            _ => Self::of_topic(&format!("/{text}")).ok_or_else(|| Error::BadRole {
                text: text.to_owned(),
            }),
        }
    }
}

/// Roles with another topic than the usual one.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Topics {
    renamed: Vec<(Role, String)>,
}

impl Topics {
    pub(super) fn insert(&mut self, role: Role, topic: String) {
        self.renamed
            .retain(|(other, name)| *other != role && *name != topic);
        self.renamed.push((role, topic));
    }

    /// The role of the topic `name`. A role with another topic no longer has its usual one.
    pub(super) fn role(&self, name: &str) -> Option<Role> {
        let renamed = self.renamed.iter().find(|(_, topic)| topic == name);
        let moved = |role: &Role| self.renamed.iter().any(|(other, _)| other == role);
        match renamed {
            Some((role, _)) => Some(role.clone()),
            None => Role::of_topic(name).filter(|role| !moved(role)),
        }
    }

    pub(super) fn renamed(&self) -> impl Iterator<Item = &(Role, String)> {
        self.renamed.iter()
    }
}

/// One segment of a ROS 2 topic name.
fn is_arm_name(name: &str) -> bool {
    let ok = |c: char| c.is_ascii_alphanumeric() || c == '_';
    name.chars().all(ok) && !name.is_empty() && !name.starts_with(|c: char| c.is_ascii_digit())
}

/// # Errors
/// The name cannot be one segment of a topic, or names an arm without an instrument.
pub(crate) fn check_arm_name(name: &str) -> Result<(), Error> {
    match Role::of_topic(&Role::Pose(name.to_owned()).topic()) {
        Some(Role::Pose(_)) => Ok(()),
        _ => Err(Error::BadArmName {
            name: name.to_owned(),
        }),
    }
}
