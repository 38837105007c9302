//! Records a session such that a killed process, or a full disk, costs at most the last frame.
//!
//! Each chunk of the file is written in one piece and never changed afterwards, and one is closed before every
//! cloud: the file is a valid beginning of an MCAP file at any time.

use derive_setters::Setters;
use std::collections::BTreeMap;
use std::fs::File;
use std::path::{Path, PathBuf};

use nalgebra::{Isometry3, Point3, UnitVector3};

use super::compression::Compression;
use super::container::Container;
use super::schema::SCHEMAS;
use super::source::io_error;
use super::topic::{Role, check_arm_name};
use crate::Error;
use crate::cdr::{
    self, Endian, Header, JointState, Message, Plane, PointCloud2, PoseStamped, Time,
};

use crate::features::Feature;

/// Frame of all data if the camera does not move.
const CAMERA_FRAME: &str = "camera";
/// Frame of poses and truth if the camera moves.
const FIXED_FRAME: &str = "fixed";
/// A chunk is written when it has this many bytes …
const CHUNK_BYTES: usize = 1 << 20;
/// … or when its messages span this many nanoseconds, because arms are recorded without a camera, too.
const CHUNK_NANOSECONDS: u64 = 1_000_000_000;

/// Options for writing a session.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Setters)]
#[setters(prefix = "with_")]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct WriterOptions {
    /// Compression of chunks. Default: none. Each chunk contains one cloud, so at most one cloud is
    /// compressed together.
    pub compression: Compression,
}

/// Writes a session, message by message. Stamps are in seconds; everything is in the camera frame, except that with a moving
/// camera ([`Self::camera`]) poses and truth are in a fixed one.
///
/// Dropping the writer closes the file as well, but only [`finish`](Self::finish) reports whether that succeeded.
pub struct SessionWriter {
    /// `None` after a failed write: data appended after an incomplete chunk could not be read.
    container: Option<Container>,
    path: PathBuf,
    schemas: BTreeMap<&'static str, u16>,
    channels: BTreeMap<String, u16>,
    pending: usize,
    flushed_at: Option<u64>,
    /// Whether a pose of the camera was written.
    moves: bool,
}

impl std::fmt::Debug for SessionWriter {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SessionWriter")
            .field("path", &self.path)
            .finish_non_exhaustive()
    }
}

impl SessionWriter {
    /// Creates the file, replacing an existing one.
    ///
    /// # Errors
    /// The file cannot be created or written.
    pub fn create(path: impl AsRef<Path>) -> Result<Self, Error> {
        Self::create_with(path, WriterOptions::default())
    }

    /// Creates the file with these options, replacing an existing one.
    ///
    /// # Errors
    /// The file cannot be created or written.
    pub fn create_with(path: impl AsRef<Path>, options: WriterOptions) -> Result<Self, Error> {
        let path = path.as_ref().to_owned();
        let library = concat!("dvrk-io-", env!("CARGO_PKG_VERSION"));
        let container = File::create(&path)
            .and_then(|file| Container::new(file, "ros2", library, options.compression))
            .map_err(|error| io_error(&path, error))?;
        Ok(Self {
            container: Some(container),
            path,
            schemas: BTreeMap::new(),
            channels: BTreeMap::new(),
            pending: 0,
            flushed_at: None,
            moves: false,
        })
    }

    /// Writes the pose of a moving camera, for the cloud of the same stamp: for every cloud, and before any pose of an arm, which is in the
    /// same fixed frame.
    ///
    /// # Errors
    /// Pose or stamp not finite, or the file cannot be written.
    pub fn camera(&mut self, stamp: f64, fixed_from_camera: &Isometry3<f64>) -> Result<(), Error> {
        self.moves = true;
        let pose = PoseStamped {
            header: self.fixed(stamp)?,
            pose: fixed_from_camera.into(),
        };
        pose.pose.isometry()?;
        self.write(&Role::Camera, pose.header.stamp, &pose)
    }

    /// Header of data in the fixed frame.
    fn fixed(&self, stamp: f64) -> Result<Header, Error> {
        let mut header = header(stamp)?;
        if self.moves {
            FIXED_FRAME.clone_into(&mut header.frame_id);
        }
        Ok(header)
    }

    /// Writes the table: `normal · x + offset ≥ 0` on the free side.
    ///
    /// # Errors
    /// Stamp or offset not finite, stamp negative, or the file cannot be written.
    pub fn table(
        &mut self,
        stamp: f64,
        normal: &UnitVector3<f64>,
        offset: f64,
    ) -> Result<(), Error> {
        let plane = Plane {
            coef: [normal.x, normal.y, normal.z, offset],
        };
        plane.normalized()?;
        self.write(&Role::Table, Time::from_seconds(stamp)?, &plane)
    }

    /// Writes the segmented cloud of the object. Everything recorded before is then in the file.
    ///
    /// # Errors
    /// A point or stamp not finite, stamp negative, or the file cannot be written.
    pub fn points(&mut self, stamp: f64, points: &[Point3<f64>]) -> Result<(), Error> {
        let cloud = PointCloud2::from_points(header(stamp)?, points)?;
        self.flush()?;
        self.write(&Role::Points, cloud.header.stamp, &cloud)
    }

    /// The same with a colour for every point.
    ///
    /// # Errors
    /// Another number of colours than of points, and those of [`Self::points`].
    pub fn coloured_points(
        &mut self,
        stamp: f64,
        points: &[Point3<f64>],
        colours: &[[u8; 3]],
    ) -> Result<(), Error> {
        let cloud = PointCloud2::from_coloured_points(header(stamp)?, points, colours)?;
        self.flush()?;
        self.write(&Role::Points, cloud.header.stamp, &cloud)
    }

    /// Writes features of the colour image on the object, for the cloud of the same stamp.
    ///
    /// # Errors
    /// A point or stamp not finite, stamp negative, or the file cannot be written.
    pub fn features(&mut self, stamp: f64, features: &[Feature]) -> Result<(), Error> {
        let cloud = PointCloud2::from_features(header(stamp)?, features)?;
        self.write(&Role::Features, cloud.header.stamp, &cloud)
    }

    /// Writes the tip pose of an arm.
    ///
    /// # Errors
    /// A name that cannot be part of a topic, pose or stamp not finite, or the file cannot be written.
    pub fn pose(
        &mut self,
        stamp: f64,
        arm: &str,
        camera_from_tip: &Isometry3<f64>,
    ) -> Result<(), Error> {
        check_arm_name(arm)?;
        let pose = PoseStamped {
            header: self.fixed(stamp)?,
            pose: camera_from_tip.into(),
        };
        pose.pose.isometry()?;
        self.write(&Role::Pose(arm.to_owned()), pose.header.stamp, &pose)
    }

    /// Writes the opening of the jaw of an arm in radians, 0 = closed.
    ///
    /// # Errors
    /// A name that cannot be part of a topic, angle or stamp not finite, or the file cannot be written.
    pub fn jaw(&mut self, stamp: f64, arm: &str, angle: f64) -> Result<(), Error> {
        check_arm_name(arm)?;
        if !angle.is_finite() {
            return Err(Error::OutOfRange {
                what: "jaw angle",
                value: angle,
                expected: "must be finite",
            });
        }
        let (name, position) = (vec!["jaw".to_owned()], vec![angle]);
        let joints = JointState {
            header: header(stamp)?,
            name,
            position,
            ..JointState::default()
        };
        self.write(&Role::Jaw(arm.to_owned()), joints.header.stamp, &joints)
    }

    /// Writes the true positions of the material points: always all of them, in the same order.
    ///
    /// # Errors
    /// A point or stamp not finite, stamp negative, or the file cannot be written.
    pub fn truth(&mut self, stamp: f64, points: &[Point3<f64>]) -> Result<(), Error> {
        let cloud = PointCloud2::from_points(self.fixed(stamp)?, points)?;
        self.write(&Role::Truth, cloud.header.stamp, &cloud)
    }

    /// Passes everything recorded so far to the operating system, so that it survives a crash of the process.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn flush(&mut self) -> Result<(), Error> {
        self.with(Container::flush)?;
        self.pending = 0;
        self.flushed_at = None;
        Ok(())
    }

    /// Writes the index and waits until everything is on disk.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn finish(mut self) -> Result<(), Error> {
        self.with(Container::finish)?;
        // It is already closed.
        self.container = None;
        Ok(())
    }

    fn write<M: Message>(&mut self, role: &Role, stamp: Time, message: &M) -> Result<(), Error> {
        let data = cdr::encode(message, Endian::Little)?;
        let time = stamp.nanoseconds();
        self.append(&role.topic(), M::TYPE, time, &data)?;
        self.pending += data.len();
        let since = *self.flushed_at.get_or_insert(time);
        if self.pending >= CHUNK_BYTES || time.abs_diff(since) >= CHUNK_NANOSECONDS {
            self.flush()?;
        }
        Ok(())
    }

    fn append(
        &mut self,
        topic: &str,
        type_name: &'static str,
        time: u64,
        data: &[u8],
    ) -> Result<(), Error> {
        let channel = match self.channels.get(topic) {
            Some(channel) => *channel,
            None => self.add_channel(topic, type_name)?,
        };
        self.with(|container| {
            container.message(channel, time, data);
            Ok(())
        })
    }

    fn add_channel(&mut self, topic: &str, type_name: &'static str) -> Result<u16, Error> {
        // Every written type has a schema; number 0 would mean "no schema".
        let schema = SCHEMAS.iter().find(|schema| schema.type_name == type_name);
        let id = match (self.schemas.get(type_name), schema) {
            (Some(id), _) => *id,
            (None, Some(schema)) => {
                self.with(|container| container.schema(type_name, "ros2msg", schema.definition))?
            }
            (None, None) => 0,
        };
        self.schemas.insert(type_name, id);
        let hash = schema.map_or("", |schema| schema.hash);
        let metadata = [("offered_qos_profiles", "[]"), ("topic_type_hash", hash)];
        let channel = self.with(|container| container.channel(id, topic, "cdr", &metadata))?;
        self.channels.insert(topic.to_owned(), channel);
        Ok(channel)
    }

    fn with<T>(
        &mut self,
        call: impl FnOnce(&mut Container) -> std::io::Result<T>,
    ) -> Result<T, Error> {
        let Some(container) = &mut self.container else {
            let path = self.path.clone();
            return Err(Error::Write { path });
        };
        call(container).map_err(|error| {
            self.container = None;
            // The error of the operating system, a full disk for example.
            io_error(&self.path, error)
        })
    }
}

impl Drop for SessionWriter {
    fn drop(&mut self) {
        if let Some(mut container) = self.container.take() {
            // To get the error, call `finish`.
            let _unknown = container.finish();
        }
    }
}

fn header(stamp: f64) -> Result<Header, Error> {
    Ok(Header {
        stamp: Time::from_seconds(stamp)?,
        frame_id: CAMERA_FRAME.to_owned(),
    })
}
