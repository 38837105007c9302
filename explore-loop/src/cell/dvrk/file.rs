//! The TOML file that describes a cell of dVRK arms: arms, poses, camera, limits.
//!
//! ```toml
//! format = "explore cell"
//! version = 1
//!
//! [network]                         # optional; default: the environment variables of ROS 2
//! domain = 0
//! loopback = false                  # true: communicate within this machine only
//! # interfaces = ["192.168.1.5"]    # addresses of the interfaces to use; default: all
//!
//! [camera]
//! frame = "camera_depth_optical_frame"
//! rate = 10.0                       # frames used each second: at most what the camera sends and the computer can process
//! image = "/camera/depth/image_rect_raw"
//! info = "/camera/depth/camera_info"
//! # colour = "/camera/color/image_raw"        beside both, if the depth is aligned to the colour: features against sliding
//! # cloud = "/camera/depth/color/points"      instead of both
//! arm_clearance = 0.005             # points within this distance of an arm are removed with it, m
//!
//! [table]                           # optional; default: found in the first frame
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
//! # tool = { shaft = 0.4670, wrist = 0.0091, jaw = 0.0102 }    # default: large needle driver
//! jaw = { open = 1.0, closed = -0.2, holds_above = 0.08, radius = 0.008 }
//! ```
//! `camera_from_base` is the pose of the frame of the remote centre (`PSM1_base`) in the optical frame of the camera: x to the right, y down,
//! z away. `holds_above`: a jaw that stays this much more open than commanded holds something, rad. `radius`: half the width that fits between the
//! open jaws, m.

use std::path::Path;

use dvrk_io::transport::Network;
use serde::{Deserialize, Serialize};

use super::entries::{ArmEntry, CameraEntry, LimitsEntry, NetworkEntry, TableEntry};
use super::values::{Format, Version};
use crate::cell::CellError;
use crate::cell::replay::{RecordedArm, ScanOptions};

/// A file that describes a cell.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CellFile {
    format: Format,
    version: Version,
    /// The network; by default that of the environment variables of ROS 2.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub network: Option<NetworkEntry>,
    /// The depth camera.
    pub camera: CameraEntry,
    /// The table; by default it is found in the first frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub table: Option<TableEntry>,
    /// The limits of motion.
    #[serde(default)]
    pub limits: LimitsEntry,
    /// The arms.
    pub arm: Vec<ArmEntry>,
}

impl CellFile {
    /// A cell with this camera and these arms; everything else has its default.
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

    /// Reads a file and the calibrations that it names; afterwards every arm has its `camera_from_base`.
    ///
    /// # Errors
    /// [`CellError::BadFile`] with the line of the mistake.
    pub fn load(path: &Path) -> Result<Self, CellError> {
        let text = std::fs::read_to_string(path).map_err(|error| CellError::BadFile {
            path: path.to_owned(),
            line: 0,
            reason: error.to_string(),
        })?;
        Self::parse(&text, path)
    }

    /// Parses the text of a file at `path`.
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
            let content = |line: &str| line.split('#').next().unwrap_or("").trim() == wanted;
            let mut found = (1..).zip(text.lines()).filter(|(_, line)| content(line));
            found.nth(index).map_or(0, |(line, _)| line)
        };
        let camera = file.camera.topics().and(file.camera.period());
        camera.map_err(|reason| bad(line("[camera]", 0), reason))?;
        if let Some(network) = &file.network {
            let checked = network.check();
            checked.map_err(|reason| bad(line("[network]", 0), reason))?;
        }
        if let Some(table) = &file.table {
            let checked = table.check();
            checked.map_err(|reason| bad(line("[table]", 0), reason))?;
        }
        if file.arm.len() < 2 {
            let reason = format!("{} arms, but at least 2 are needed", file.arm.len());
            return Err(bad(line("[[arm]]", 0), reason));
        }
        for index in 0..file.arm.len() {
            let names = file.arm[..index].iter().map(|arm| &arm.name);
            let twice = names.into_iter().any(|name| *name == file.arm[index].name);
            let arm = &mut file.arm[index];
            let checked = if twice {
                Err(format!("there is a second arm with the name {}", arm.name))
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
    /// [`CellError::Failed`]: it cannot be serialised as TOML.
    pub fn to_toml(&self) -> Result<String, CellError> {
        toml::to_string(self).map_err(|error| CellError::Failed(error.to_string()))
    }

    /// Options for finding the object in a recording of this cell.
    ///
    /// # Errors
    /// [`dvrk_io::Error::OutOfRange`]: a length outside the range of instruments.
    pub fn scan_options(&self) -> Result<ScanOptions, dvrk_io::Error> {
        let recorded = |arm: &ArmEntry| -> Result<RecordedArm, dvrk_io::Error> {
            Ok(RecordedArm {
                name: arm.name.clone(),
                kinematics: arm.kinematics()?,
                camera_from_rcm: arm.camera_from_rcm(),
                jaw_radius: arm.jaw.radius.get(),
            })
        };
        let arms = self.arm.iter().map(recorded).collect::<Result<_, _>>()?;
        Ok(ScanOptions::default()
            .with_arms(arms)
            .with_arm_clearance(self.camera.arm_clearance.get())
            .with_table(self.table.map(|table| table.plane())))
    }

    /// The network.
    ///
    /// # Errors
    /// [`dvrk_io::Error::BadNetwork`]: a domain over 232, an environment variable that cannot be read.
    pub fn network(&self) -> Result<Network, dvrk_io::Error> {
        let entry = self.network.as_ref();
        entry.map_or_else(Network::from_env, NetworkEntry::network)
    }
}
