//! The entries of a cell file, and their conversions to a network, topics, a plane, lengths and limits.

use std::net::IpAddr;
use std::path::{Path, PathBuf};
use std::time::Duration;

use dvrk_io::Psm;
use dvrk_io::calibration::Calibration;
use dvrk_io::camera::CameraTopics;
use dvrk_io::kinematics::{Instrument, Kinematics};
use dvrk_io::transport::{Interfaces, Network};
use nalgebra::Isometry3;
use serde::{Deserialize, Serialize};

use super::values::{Direction, PoseEntry, Positive};
use crate::cell::Plane;

/// Lowest frame rate that can be requested: arms move no farther than one frame ahead.
const LEAST_RATE: f64 = 0.1;

/// The network.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NetworkEntry {
    /// The ROS domain.
    #[serde(default)]
    pub domain: u16,
    /// Whether to communicate within this machine only.
    #[serde(default)]
    pub loopback: bool,
    /// Addresses of the interfaces of this machine to use; empty: all.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub interfaces: Vec<IpAddr>,
}

/// The depth camera: either `cloud`, or `image` and `info`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraEntry {
    /// Its optical frame, by the name in its messages.
    pub frame: String,
    /// Frames used each second: not more than the camera sends or the computer can process.
    pub rate: Positive,
    /// Topic of the depth images.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub image: Option<String>,
    /// Topic of the `CameraInfo`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub info: Option<String>,
    /// Topic of colour images with the rays of the depth images, for features of the texture; none by default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub colour: Option<String>,
    /// Topic of the clouds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cloud: Option<String>,
    /// Points within this distance of an arm are removed with it, metres.
    #[serde(default = "arm_clearance")]
    pub arm_clearance: Positive,
}

fn arm_clearance() -> Positive {
    Positive(0.005)
}

/// The table, camera frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TableEntry {
    /// Unit normal, towards the camera.
    pub normal: Direction,
    /// `normal · x + offset = 0`, metres.
    pub offset: f64,
}

/// Limits of straight motions.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LimitsEntry {
    /// Speed of the fastest point of the jaws, m/s.
    pub speed: Positive,
    /// Acceleration, m/s².
    pub acceleration: Positive,
}

impl Default for LimitsEntry {
    fn default() -> Self {
        Self {
            speed: Positive(0.05),
            acceleration: Positive(1.0),
        }
    }
}

/// The generation of an arm.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// The first.
    Classic,
    /// S and Si.
    Si,
}

/// An arm; its pose is given by either `calibration` or `camera_from_base`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ArmEntry {
    /// Its name, such as `PSM1`.
    pub name: String,
    /// Its generation.
    pub kind: Kind,
    /// Joint values out of the camera's view: radians, metres for the insertion.
    pub home: [f64; 6],
    /// A calibration file of dvrk-io; the path is relative to the cell file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calibration: Option<PathBuf>,
    /// Pose of the frame of its remote centre in the camera frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera_from_base: Option<PoseEntry>,
    /// The content of the calibration file, once it was read.
    #[serde(skip)]
    pub calibrated: Option<Calibration>,
    /// Lengths of its instrument; the default is a large needle driver.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tool: Option<ToolEntry>,
    /// Its jaw.
    #[serde(default)]
    pub jaw: JawEntry,
}

/// Lengths of an instrument, metres.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ToolEntry {
    /// Roll joint to wrist pitch axis.
    pub shaft: f64,
    /// Wrist pitch axis to wrist yaw axis.
    pub wrist: f64,
    /// Wrist yaw axis to the tips.
    pub jaw: f64,
}

/// A jaw: angles in radians, 0 when closed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct JawEntry {
    /// Angle when open.
    pub open: f64,
    /// Angle commanded to hold something; negative values squeeze.
    pub closed: f64,
    /// By how much a jaw that holds something stays more open than commanded.
    pub holds_above: Positive,
    /// Half the width that fits between the open jaws, metres.
    pub radius: Positive,
}

impl Default for JawEntry {
    fn default() -> Self {
        Self {
            open: 1.0,
            closed: -0.2,
            holds_above: Positive(0.08),
            radius: Positive(0.008),
        }
    }
}

impl NetworkEntry {
    pub(super) fn check(&self) -> Result<(), String> {
        if self.loopback && !self.interfaces.is_empty() {
            return Err("give either `loopback = true` or `interfaces`, not both".into());
        }
        let network = self.network();
        network.map(drop).map_err(|error| error.to_string())
    }

    pub(super) fn network(&self) -> Result<Network, dvrk_io::Error> {
        let interfaces = match (self.loopback, self.interfaces.as_slice()) {
            (true, _) => Interfaces::Loopback,
            (false, []) => Interfaces::All,
            (false, some) => Interfaces::Only(some.to_vec()),
        };
        let network = Network::default().with_interfaces(interfaces);
        network.with_domain(self.domain)
    }
}

impl CameraEntry {
    /// Least time between two used frames.
    pub(super) fn period(&self) -> Result<Duration, String> {
        let rate = self.rate.get();
        if rate < LEAST_RATE {
            return Err(format!(
                "a rate of {rate} frames a second is less than {LEAST_RATE}"
            ));
        }
        Ok(Duration::from_secs_f64(1.0 / rate))
    }

    /// Its topics.
    ///
    /// # Errors
    /// Neither `cloud` nor both `image` and `info` are given, or all of them; `colour` beside `cloud`.
    pub fn topics(&self) -> Result<CameraTopics, String> {
        match (&self.cloud, &self.image, &self.info) {
            (Some(_), None, None) if self.colour.is_some() => {
                Err("`colour` belongs to `image` and `info`; a cloud has its own colours".into())
            }
            (Some(cloud), None, None) => Ok(CameraTopics::Cloud(cloud.clone())),
            (None, Some(image), Some(info)) => Ok(CameraTopics::Depth {
                image: image.clone(),
                info: info.clone(),
                colour: self.colour.clone(),
            }),
            _ => Err("the camera needs either `cloud`, or `image` and `info`".into()),
        }
    }
}

impl TableEntry {
    pub(super) fn check(&self) -> Result<(), String> {
        if self.offset.is_finite() {
            Ok(())
        } else {
            Err(format!("the offset of the table is {}", self.offset))
        }
    }

    /// The plane.
    pub fn plane(&self) -> Plane {
        Plane {
            normal: self.normal.0,
            offset: self.offset,
        }
    }
}

impl ArmEntry {
    /// Takes the pose of its remote centre from its calibration.
    pub(super) fn place(&mut self, cell: &Path) -> Result<(), String> {
        match (&self.calibration, self.camera_from_base) {
            (None, Some(_)) => Ok(()),
            (Some(name), None) => {
                let path = cell.parent().unwrap_or(Path::new("")).join(name);
                let found = Calibration::load(&path)
                    .map_err(|error| format!("{}: {error}", path.display()))?;
                if found.arm != self.name {
                    return Err(format!("{} belongs to {}", path.display(), found.arm));
                }
                self.camera_from_base = Some(PoseEntry(found.camera_from_rcm));
                self.calibrated = Some(found);
                Ok(())
            }
            _ => Err(format!(
                "{} needs either `calibration` or `camera_from_base`",
                self.name
            )),
        }
    }

    pub(super) fn check(&self) -> Result<(), String> {
        self.kinematics().map_err(|error| error.to_string())?;
        if !self.home.iter().all(|value| value.is_finite()) {
            return Err(format!("{}: the home is not finite", self.name));
        }
        let (open, closed) = (self.jaw.open, self.jaw.closed);
        if !(open.is_finite() && closed.is_finite() && closed < open) {
            return Err(format!(
                "{}: the jaw cannot close from {open} to {closed} rad",
                self.name
            ));
        }
        Ok(())
    }

    /// Pose of its remote centre in the camera frame; the identity before the file was loaded.
    pub fn camera_from_rcm(&self) -> Isometry3<f64> {
        self.camera_from_base
            .map_or_else(Isometry3::identity, |pose| pose.0)
    }

    /// Its lengths and limits.
    ///
    /// # Errors
    /// [`dvrk_io::Error::OutOfRange`]: a length outside the range of instruments.
    pub fn kinematics(&self) -> Result<Kinematics, dvrk_io::Error> {
        let arm = Kinematics::new(match self.kind {
            Kind::Classic => Psm::Classic,
            Kind::Si => Psm::Si,
        });
        let Some(tool) = self.tool else {
            return Ok(arm);
        };
        let instrument = Instrument::default()
            .with_shaft(tool.shaft)
            .with_wrist(tool.wrist)
            .with_jaw(tool.jaw);
        arm.with_instrument(instrument)
    }
}
