//! Recording a session so that a killed process, or a full disk, costs the last frame at most.
//!
//! Each chunk of the file is written in one piece, never patched afterwards, and one is closed before every
//! cloud: what is in the file is then a valid beginning of an MCAP file at any time.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use mcap::records::MessageHeader;
use nalgebra::{Isometry3, Point3, UnitVector3};

use super::schema::{SCHEMAS, Schema};
use super::topic::{Topic, check_arm_name};
use crate::Error;
use crate::cdr::{
    self, Endian, Header, JointState, Message, Plane, PointCloud2, PoseStamped, Time,
};

/// Frame of everything that is written.
const CAMERA_FRAME: &str = "camera";
/// A chunk goes to the file when it holds this many bytes …
const CHUNK_BYTES: usize = 1 << 20;
/// … or when its messages span this many nanoseconds: arms are recorded without a camera, too.
const CHUNK_NANOSECONDS: u64 = 1_000_000_000;

/// Writes a session, message by message. Stamps are seconds; everything is in the camera frame.
///
/// Dropping the writer closes the file as well, but only [`finish`](Self::finish) says whether that worked.
pub struct SessionWriter {
    /// Gone once a write has failed: the library must not be called again then, not even to be dropped.
    mcap: Option<mcap::Writer<BufWriter<File>>>,
    path: PathBuf,
    schemas: BTreeMap<&'static str, (u16, &'static str)>,
    channels: BTreeMap<String, Channel>,
    pending: usize,
    flushed_at: Option<u64>,
}

#[derive(Clone, Copy, Default)]
struct Channel {
    id: u16,
    messages: u32,
}

impl SessionWriter {
    /// Creates the file; one that is there already is replaced.
    ///
    /// # Errors
    /// The file cannot be created or written.
    pub fn create(path: impl AsRef<Path>) -> Result<Self, Error> {
        let path = path.as_ref().to_owned();
        let file = File::create(&path).map_err(|source| Error::Io {
            path: path.clone(),
            source,
        })?;
        let options = mcap::WriteOptions::new()
            .profile("ros2")
            .library(concat!("dvrk-io-", env!("CARGO_PKG_VERSION")))
            .compression(None)
            .chunk_size(None)
            // Without seeking a chunk is collected in memory and written whole.
            .disable_seeking(true);
        let mcap = options
            .create(BufWriter::new(file))
            .map_err(|source| Error::Write {
                path: path.clone(),
                source,
            })?;
        let mut writer = Self {
            mcap: Some(mcap),
            path,
            schemas: BTreeMap::new(),
            channels: BTreeMap::new(),
            pending: 0,
            flushed_at: None,
        };
        for Schema {
            type_name,
            definition,
            hash,
        } in SCHEMAS
        {
            let text = definition.as_bytes();
            let id = writer.with(|mcap| mcap.add_schema(type_name, "ros2msg", text))?;
            writer.schemas.insert(type_name, (id, hash));
        }
        Ok(writer)
    }

    /// The table: `normal · x + offset ≥ 0` on the free side.
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
        self.write(&Topic::Table, Time::from_seconds(stamp)?, &plane)
    }

    /// The segmented cloud of the object. Everything recorded before goes to the file now.
    ///
    /// # Errors
    /// A point or stamp not finite, stamp negative, or the file cannot be written.
    pub fn points(&mut self, stamp: f64, points: &[Point3<f64>]) -> Result<(), Error> {
        let cloud = PointCloud2::from_points(header(stamp)?, points)?;
        self.flush()?;
        self.write(&Topic::Points, cloud.header.stamp, &cloud)
    }

    /// Tip pose of an arm.
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
            header: header(stamp)?,
            pose: camera_from_tip.into(),
        };
        pose.pose.isometry()?;
        self.write(&Topic::Pose(arm.to_owned()), pose.header.stamp, &pose)
    }

    /// Opening of the jaw of an arm in radians, 0 = closed.
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
        self.write(&Topic::Jaw(arm.to_owned()), joints.header.stamp, &joints)
    }

    /// Where the material points truly are: always all of them, always in the same order.
    ///
    /// # Errors
    /// A point or stamp not finite, stamp negative, or the file cannot be written.
    pub fn truth(&mut self, stamp: f64, points: &[Point3<f64>]) -> Result<(), Error> {
        let cloud = PointCloud2::from_points(header(stamp)?, points)?;
        self.write(&Topic::Truth, cloud.header.stamp, &cloud)
    }

    /// Hands everything recorded so far to the operating system: it survives the process from here on.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn flush(&mut self) -> Result<(), Error> {
        // A chunk without messages would stand in the index with the time 0.
        if self.pending == 0 {
            return Ok(());
        }
        self.with(mcap::Writer::flush)?;
        self.pending = 0;
        self.flushed_at = None;
        Ok(())
    }

    /// Writes the index and waits until the disk has it all.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn finish(mut self) -> Result<(), Error> {
        self.with(|mcap| mcap.finish().map(|_| ()))?;
        let path = self.path;
        let Some(mcap) = self.mcap else {
            return Ok(());
        };
        let io_error = |source| Error::Io {
            path: path.clone(),
            source,
        };
        let file = mcap
            .into_inner()
            .into_inner()
            .map_err(|error| io_error(error.into_error()))?;
        file.sync_all().map_err(io_error)
    }

    fn write<M: Message>(&mut self, topic: &Topic, stamp: Time, message: &M) -> Result<(), Error> {
        let data = cdr::encode(message, Endian::Little)?;
        let time = stamp.nanoseconds();
        self.append(&topic.name(), M::TYPE, time, &data)?;
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
        type_name: &str,
        time: u64,
        data: &[u8],
    ) -> Result<(), Error> {
        if !self.channels.contains_key(topic) {
            // Every type written has its schema since `create`; id 0 would mean "no schema".
            let (schema, hash) = self.schemas.get(type_name).copied().unwrap_or_default();
            let metadata = [("offered_qos_profiles", "[]"), ("topic_type_hash", hash)];
            let metadata = metadata
                .map(|(key, value)| (key.to_owned(), value.to_owned()))
                .into();
            let id = self.with(|mcap| mcap.add_channel(schema, topic, "cdr", &metadata))?;
            self.channels
                .insert(topic.to_owned(), Channel { id, messages: 0 });
        }
        let channel = self.channels.entry(topic.to_owned()).or_default();
        let (channel_id, sequence) = (channel.id, channel.messages);
        channel.messages = sequence.wrapping_add(1);
        let header = MessageHeader {
            channel_id,
            sequence,
            log_time: time,
            publish_time: time,
        };
        self.with(|mcap| mcap.write_to_known_channel(&header, data))
    }

    fn with<T>(
        &mut self,
        call: impl FnOnce(&mut mcap::Writer<BufWriter<File>>) -> mcap::McapResult<T>,
    ) -> Result<T, Error> {
        let done = self
            .mcap
            .as_mut()
            .map_or(Err(mcap::McapError::AttemptedWriteAfterFailure), call);
        done.map_err(|source| {
            // Dropping it would try to write again, which panics after some failures.
            std::mem::forget(self.mcap.take());
            let path = self.path.clone();
            match source {
                // What the system said, a full disk for example.
                mcap::McapError::Io(source) => Error::Io { path, source },
                source => Error::Write { path, source },
            }
        })
    }
}

fn header(stamp: f64) -> Result<Header, Error> {
    Ok(Header {
        stamp: Time::from_seconds(stamp)?,
        frame_id: CAMERA_FRAME.to_owned(),
    })
}
