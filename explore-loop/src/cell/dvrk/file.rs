//! A cell of dVRK arms as a TOML file: which arms, where they stand, which camera, how fast.
//!
//! ```toml
//! format = "explore cell"
//! version = 1
//!
//! [network]                         # left out: ROS_DOMAIN_ID and so on
//! domain = 0
//! loopback = false                  # this machine only
//!
//! [camera]
//! frame = "camera_depth_optical_frame"
//! rate = 10.0                       # frames a second that are used: what the camera sends and the computer can follow
//! image = "/camera/depth/image_rect_raw"
//! info = "/camera/depth/camera_info"
//! # cloud = "/camera/depth/color/points"      instead of both
//! arm_clearance = 0.005             # what is this near to an arm is taken for the arm, m
//!
//! [table]                           # left out: found in the first frame
//! normal = [0.0, 0.0, -1.0]
//! offset = 0.55                     # normal · x + offset = 0
//!
//! [limits]
//! speed = 0.05                      # of the fastest point of the jaws, m/s
//! acceleration = 1.0                # m/s²
//!
//! [[arm]]
//! name = "PSM1"
//! kind = "si"                       # or "classic"
//! home = [0.0, 0.7, 0.07, 0.0, 0.0, 0.0]      # joint values out of the camera's view: rad, m
//! calibration = "PSM1.toml"         # of dvrk-io, beside this file; or
//! # camera_from_base = { translation = [0.1, 0.0, 0.3], quaternion_xyzw = [0.0, 0.0, 0.0, 1.0] }
//! # tool = { shaft = 0.4670, wrist = 0.0091, jaw = 0.0102 }    left out: large needle driver
//! jaw = { open = 1.0, closed = -0.2, holds_above = 0.08, radius = 0.008 }
//! ```
//! `camera_from_base` takes coordinates in the frame of the remote centre (`PSM1_base`) to the optical frame of the camera: x to the right, y down,
//! z away. `holds_above`: a jaw that stays this much more open than it was sent to be holds something, rad. `radius`: half of what fits between the
//! open jaws, m.

use std::path::{Path, PathBuf};

use dvrk_io::Psm;
use dvrk_io::calibration::Calibration;
use dvrk_io::camera::CameraTopics;
use dvrk_io::kinematics::{Instrument, Kinematics};
use dvrk_io::transport::{Interfaces, Network};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, UnitVector3, Vector3};
use serde::{Deserialize, Serialize};

use crate::cell::{CellError, Plane};

const FORMAT: &str = "explore cell";
const VERSION: u32 = 1;

/// A file that describes a cell.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CellFile {
    format: Format,
    version: Version,
    /// The network; nothing: what the environment variables of ROS 2 say.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub network: Option<NetworkEntry>,
    /// The depth camera.
    pub camera: CameraEntry,
    /// The table; nothing: it is found in the first frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub table: Option<TableEntry>,
    /// How fast the arms may go.
    #[serde(default)]
    pub limits: LimitsEntry,
    /// The arms.
    pub arm: Vec<ArmEntry>,
}

/// The network.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NetworkEntry {
    /// The domain.
    #[serde(default)]
    pub domain: u16,
    /// This machine only.
    #[serde(default)]
    pub loopback: bool,
}

/// The depth camera: either `cloud`, or `image` and `info`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraEntry {
    /// Its optical frame, as it names it.
    pub frame: String,
    /// Frames a second that are used: no more than the camera sends, nor than the computer can follow.
    pub rate: Positive,
    /// Topic of the depth images.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub image: Option<String>,
    /// Topic of their camera.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub info: Option<String>,
    /// Topic of the clouds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cloud: Option<String>,
    /// What is this near to an arm is taken for the arm, metres.
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
    /// Towards the camera.
    pub normal: Direction,
    /// `normal · x + offset = 0`, metres.
    pub offset: f64,
}

/// Limits of straight motions.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LimitsEntry {
    /// Of the fastest point of the jaws, m/s.
    pub speed: Positive,
    /// m/s².
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

/// An arm; where it stands says either `calibration` or `camera_from_base`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ArmEntry {
    /// Its name, such as `PSM1`.
    pub name: String,
    /// Its generation.
    pub kind: Kind,
    /// Joint values out of the camera's view: radians, metres for the insertion.
    pub home: [f64; 6],
    /// A calibration of dvrk-io, beside the file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calibration: Option<PathBuf>,
    /// Where its remote centre is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera_from_base: Option<PoseEntry>,
    /// Lengths of its instrument; nothing: large needle driver.
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

/// A jaw: angles in radians, 0 closed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct JawEntry {
    /// Where it is open.
    pub open: f64,
    /// Where it is sent to hold; negative squeezes.
    pub closed: f64,
    /// By how much a jaw that holds something stays more open than it was sent to be.
    pub holds_above: Positive,
    /// Half of what fits between the open jaws, metres.
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

/// A number that is positive and finite.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "f64", into = "f64")]
pub struct Positive(f64);

impl Positive {
    /// # Errors
    /// It is not.
    pub fn new(value: f64) -> Result<Self, String> {
        if value > 0.0 && value.is_finite() {
            Ok(Self(value))
        } else {
            Err(format!("{value} is not positive and finite"))
        }
    }

    /// The number.
    pub fn get(self) -> f64 {
        self.0
    }
}

impl TryFrom<f64> for Positive {
    type Error = String;

    fn try_from(value: f64) -> Result<Self, String> {
        Self::new(value)
    }
}

impl From<Positive> for f64 {
    fn from(value: Positive) -> Self {
        value.0
    }
}

/// A direction that is none of length 0.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "[f64; 3]", into = "[f64; 3]")]
pub struct Direction(pub UnitVector3<f64>);

impl TryFrom<[f64; 3]> for Direction {
    type Error = String;

    fn try_from(value: [f64; 3]) -> Result<Self, String> {
        let unit = UnitVector3::try_new(Vector3::from(value), 1e-6);
        let unit = unit.filter(|unit| unit.iter().all(|x| x.is_finite()));
        unit.map(Self)
            .ok_or_else(|| format!("{value:?} is no direction"))
    }
}

impl From<Direction> for [f64; 3] {
    fn from(value: Direction) -> Self {
        value.0.into_inner().into()
    }
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct RawPose {
    translation: [f64; 3],
    quaternion_xyzw: [f64; 4],
}

/// A pose.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "RawPose", into = "RawPose")]
pub struct PoseEntry(pub Isometry3<f64>);

impl TryFrom<RawPose> for PoseEntry {
    type Error = String;

    fn try_from(raw: RawPose) -> Result<Self, String> {
        let [x, y, z, w] = raw.quaternion_xyzw;
        let quaternion = Quaternion::new(w, x, y, z);
        // Typed by hand, with four digits or so.
        if !(-1e-3..=1e-3).contains(&(quaternion.norm() - 1.0)) {
            return Err("the quaternion must be four numbers of norm 1, the scalar last".into());
        }
        if !raw.translation.iter().all(|x| x.is_finite()) {
            return Err("the translation must be three finite numbers, metres".into());
        }
        Ok(Self(Isometry3::from_parts(
            Translation3::from(Vector3::from(raw.translation)),
            UnitQuaternion::new_normalize(quaternion),
        )))
    }
}

impl From<PoseEntry> for RawPose {
    fn from(PoseEntry(pose): PoseEntry) -> Self {
        Self {
            translation: pose.translation.vector.into(),
            quaternion_xyzw: pose.rotation.coords.into(),
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
struct Format;

impl TryFrom<String> for Format {
    type Error = String;

    fn try_from(value: String) -> Result<Self, String> {
        (value == FORMAT)
            .then_some(Self)
            .ok_or_else(|| format!("the format must be \"{FORMAT}\""))
    }
}

impl From<Format> for String {
    fn from(_: Format) -> Self {
        FORMAT.to_owned()
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "u32", into = "u32")]
struct Version;

impl TryFrom<u32> for Version {
    type Error = String;

    fn try_from(value: u32) -> Result<Self, String> {
        (value == VERSION)
            .then_some(Self)
            .ok_or_else(|| format!("this program reads version {VERSION}"))
    }
}

impl From<Version> for u32 {
    fn from(_: Version) -> Self {
        VERSION
    }
}

impl CellFile {
    /// A cell of a camera and arms; the rest by default.
    pub fn new(camera: CameraEntry, arm: Vec<ArmEntry>) -> Self {
        Self {
            format: Format,
            version: Version,
            network: None,
            camera,
            table: None,
            limits: LimitsEntry::default(),
            arm,
        }
    }

    /// Reads a file; calibrations that it names are read too, so that afterwards every arm has its `camera_from_base`.
    ///
    /// # Errors
    /// [`CellError::BadFile`] with the line of what is wrong.
    pub fn load(path: &Path) -> Result<Self, CellError> {
        let text = std::fs::read_to_string(path).map_err(|error| CellError::BadFile {
            path: path.to_owned(),
            line: 0,
            reason: error.to_string(),
        })?;
        Self::parse(&text, path)
    }

    /// Reads the text of a file that lies at `path`.
    ///
    /// # Errors
    /// See [`CellFile::load`].
    pub fn parse(text: &str, path: &Path) -> Result<Self, CellError> {
        let bad = |line: usize, reason: String| CellError::BadFile {
            path: path.to_owned(),
            line,
            reason,
        };
        let mut file: Self = toml::from_str(text).map_err(|error| {
            let place = error.span().map_or(0, |span| span.start.min(text.len()));
            let line = text.as_bytes()[..place].iter().filter(|b| **b == b'\n');
            bad(line.count() + 1, error.message().to_owned())
        })?;
        let line = |wanted: &str, index: usize| {
            let mut found = (1..).zip(text.lines()).filter(|(_, l)| l.trim() == wanted);
            found.nth(index).map_or(0, |(line, _)| line)
        };
        file.camera
            .topics()
            .map_err(|reason| bad(line("[camera]", 0), reason))?;
        if file.arm.len() < 2 {
            let reason = format!("{} arms: at least 2 are needed", file.arm.len());
            return Err(bad(line("[[arm]]", 0), reason));
        }
        for index in 0..file.arm.len() {
            let names = file.arm[..index].iter().map(|arm| &arm.name);
            let twice = names.into_iter().any(|name| *name == file.arm[index].name);
            let arm = &mut file.arm[index];
            let checked = if twice {
                Err(format!("a second arm {}", arm.name))
            } else {
                arm.place(path).and_then(|()| arm.check())
            };
            checked.map_err(|reason| bad(line("[[arm]]", index), reason))?;
        }
        Ok(file)
    }

    /// The text of the file.
    ///
    /// # Errors
    /// [`CellError::Failed`]: it cannot be written as TOML.
    pub fn to_toml(&self) -> Result<String, CellError> {
        toml::to_string(self).map_err(|error| CellError::Failed(error.to_string()))
    }

    /// The network.
    ///
    /// # Errors
    /// [`dvrk_io::Error::BadNetwork`]: a domain over 232, an environment variable that cannot be read.
    pub fn network(&self) -> Result<Network, dvrk_io::Error> {
        let Some(entry) = self.network else {
            return Network::from_env();
        };
        let network = Network::default().with_domain(entry.domain)?;
        Ok(if entry.loopback {
            network.with_interfaces(Interfaces::Loopback)
        } else {
            network
        })
    }
}

impl CameraEntry {
    /// Its topics.
    ///
    /// # Errors
    /// Neither `cloud` nor `image` and `info`, or all of them.
    pub fn topics(&self) -> Result<CameraTopics, String> {
        match (&self.cloud, &self.image, &self.info) {
            (Some(cloud), None, None) => Ok(CameraTopics::Cloud(cloud.clone())),
            (None, Some(image), Some(info)) => Ok(CameraTopics::Depth {
                image: image.clone(),
                info: info.clone(),
            }),
            _ => Err("the camera needs either `cloud`, or `image` and `info`".into()),
        }
    }
}

impl TableEntry {
    /// The plane.
    pub fn plane(&self) -> Plane {
        Plane {
            normal: self.normal.0,
            offset: self.offset,
        }
    }
}

impl ArmEntry {
    /// Takes where it stands from its calibration.
    fn place(&mut self, cell: &Path) -> Result<(), String> {
        match (&self.calibration, self.camera_from_base) {
            (None, Some(_)) => Ok(()),
            (Some(name), None) => {
                let path = cell.parent().unwrap_or(Path::new("")).join(name);
                let found = Calibration::load(&path)
                    .map_err(|error| format!("{}: {error}", path.display()))?;
                if found.arm != self.name {
                    return Err(format!("{} is of {}", path.display(), found.arm));
                }
                self.camera_from_base = Some(PoseEntry(found.camera_from_rcm));
                Ok(())
            }
            _ => Err(format!(
                "{} needs either `calibration` or `camera_from_base`",
                self.name
            )),
        }
    }

    fn check(&self) -> Result<(), String> {
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

    /// Where its remote centre is in the camera frame; the identity before the file was loaded.
    pub fn camera_from_rcm(&self) -> Isometry3<f64> {
        self.camera_from_base
            .map_or_else(Isometry3::identity, |pose| pose.0)
    }

    /// Its lengths and limits.
    ///
    /// # Errors
    /// [`dvrk_io::Error::OutOfRange`]: a length that no instrument has.
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
