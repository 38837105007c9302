//! From a file to frames: decode each topic, sort by stamp, give every cloud the arm samples next to it.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use nalgebra::{Isometry3, Point3, UnitVector3};

use super::frame::{ArmSample, Frame, Session, TopicCount, TruthFrame};
use super::record::{self, RawMessage, Records};
use super::topic::Topic;
use crate::Error;
use crate::cdr::{self, Header, JointState, Message, Plane, PointCloud2, PoseStamped};

/// Reads sessions.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct SessionReader {
    /// Farthest an arm sample may be from a cloud in time to belong to its frame, seconds.
    ///
    /// Default 0.02: a dVRK publishes at 100 Hz, so that a measured arm always has a sample within 5 ms of a
    /// cloud and 20 ms forgive jitter; where arms are recorded once a frame, it is still less than half the
    /// time between frames up to 25 Hz, so that no pose leaks into a frame in which there was none.
    pub tolerance: f64,
}

impl Default for SessionReader {
    fn default() -> Self {
        Self { tolerance: 0.02 }
    }
}

/// Values of one topic, ordered by stamp (nanoseconds).
type Track<T> = Vec<(u64, T)>;

/// What is known of an arm.
#[derive(Default)]
struct Arm {
    poses: Track<Isometry3<f64>>,
    jaws: Track<f64>,
}

impl SessionReader {
    /// Reads a session with the default settings.
    ///
    /// # Errors
    /// See [`SessionReader::read`].
    pub fn open(path: impl AsRef<Path>) -> Result<Session, Error> {
        Self::default().read(path)
    }

    /// The same reader with another [`tolerance`](Self::tolerance), in seconds.
    #[must_use]
    pub fn with_tolerance(self, tolerance: f64) -> Self {
        Self { tolerance }
    }

    /// Reads a session.
    ///
    /// # Errors
    /// The file cannot be read, is no MCAP file, is compressed or damaged; a known topic carries another
    /// type; a message cannot be decoded; poses and clouds are in different frames. A file that merely ends
    /// early is not an error: see [`Session::complete`].
    pub fn read(self, path: impl AsRef<Path>) -> Result<Session, Error> {
        self.read_bytes(&file_bytes(path.as_ref())?)
    }

    /// Reads a session from the bytes of its file.
    ///
    /// # Errors
    /// See [`SessionReader::read`].
    pub fn read_bytes(self, file: &[u8]) -> Result<Session, Error> {
        if !(self.tolerance >= 0.0 && self.tolerance.is_finite()) {
            let (what, value) = ("tolerance", self.tolerance);
            return Err(Error::OutOfRange {
                what,
                value,
                expected: "must be finite and not negative",
            });
        }
        let records = record::read(file)?;
        let mut contents = Contents::default();
        for (topic, messages) in messages_by_topic(&records)? {
            contents.add(&topic, &messages)?;
        }
        contents.check_frames()?;
        Ok(self.assemble(contents, &records))
    }

    fn assemble(self, contents: Contents, records: &Records<'_>) -> Session {
        let arms = &contents.arms;
        let frame = |(stamp, points)| Frame {
            stamp: seconds(stamp),
            points,
            arms: arms
                .iter()
                .map(|(name, arm)| self.sample(name, arm, stamp))
                .collect(),
        };
        Session {
            frames: contents.clouds.into_iter().map(frame).collect(),
            table: contents.table,
            arm_names: arms.keys().cloned().collect(),
            camera_frame: contents.camera_frame,
            topics: count_topics(records),
            complete: records.complete,
        }
    }

    fn sample(self, name: &str, arm: &Arm, stamp: u64) -> ArmSample {
        ArmSample {
            name: name.to_owned(),
            pose: self.closest(&arm.poses, stamp).copied(),
            jaw: self.closest(&arm.jaws, stamp).copied(),
        }
    }

    /// The value closest to `stamp` (the earlier of two as close), if it lies within the tolerance.
    fn closest<T>(self, track: &Track<T>, stamp: u64) -> Option<&T> {
        let after = track.partition_point(|(time, _)| *time < stamp);
        let candidates = &track[after.saturating_sub(1)..track.len().min(after + 1)];
        let (time, value) = candidates
            .iter()
            .min_by_key(|(time, _)| time.abs_diff(stamp))?;
        (time.abs_diff(stamp) as f64 * 1e-9 <= self.tolerance).then_some(value)
    }
}

/// Where the material points truly were: for measures, never for algorithms. Empty without truth in the file.
///
/// # Errors
/// See [`SessionReader::read`]; also a point that is not finite, since leaving it out would break the order.
pub fn read_truth(path: impl AsRef<Path>) -> Result<Vec<TruthFrame>, Error> {
    read_truth_from_bytes(&file_bytes(path.as_ref())?)
}

/// [`read_truth`] from the bytes of the file.
///
/// # Errors
/// See [`read_truth`].
pub fn read_truth_from_bytes(file: &[u8]) -> Result<Vec<TruthFrame>, Error> {
    let records = record::read(file)?;
    let mut frames = Vec::new();
    for (topic, messages) in messages_by_topic(&records)? {
        if topic == Topic::Truth {
            let mut track = decode_all(&topic, &messages, |_, cloud: PointCloud2| {
                let points = cloud.points()?;
                match points.iter().position(|point| !is_finite(point)) {
                    Some(index) => Err(Error::NonFinitePoint {
                        index,
                        point: points[index].into(),
                    }),
                    None => Ok(Some((cloud.header.stamp.nanoseconds(), points))),
                }
            })?;
            frames.append(&mut track);
        }
    }
    frames.sort_by_key(|(stamp, _)| *stamp);
    let frame = |(stamp, points)| TruthFrame {
        stamp: seconds(stamp),
        points,
    };
    Ok(frames.into_iter().map(frame).collect())
}

/// The decoded topics of a session, truth left out.
#[derive(Default)]
struct Contents {
    clouds: Track<Vec<Point3<f64>>>,
    table: Option<(UnitVector3<f64>, f64)>,
    arms: BTreeMap<String, Arm>,
    camera_frame: String,
    /// Topics and the frames their messages are in.
    frames: BTreeSet<(String, String)>,
}

impl Contents {
    fn add(&mut self, topic: &Topic, messages: &[RawMessage<'_>]) -> Result<(), Error> {
        match topic {
            Topic::Truth => Ok(()),
            Topic::Points => self.add_clouds(topic, messages),
            Topic::Table => self.add_table(topic, messages),
            Topic::Pose(arm) => self.add_poses(topic, arm, messages),
            Topic::Jaw(arm) => self.add_jaws(topic, arm, messages),
        }
    }

    fn add_clouds(&mut self, topic: &Topic, messages: &[RawMessage<'_>]) -> Result<(), Error> {
        self.clouds = decode_all(topic, messages, |_, cloud: PointCloud2| {
            let mut points = cloud.points()?;
            points.retain(|point| is_finite(point) && *point != Point3::origin());
            let Header { stamp, frame_id } = cloud.header;
            if self.camera_frame.is_empty() {
                self.camera_frame.clone_from(&frame_id);
            }
            self.frames.insert((topic.name(), frame_id));
            Ok(Some((stamp.nanoseconds(), points)))
        })?;
        Ok(())
    }

    fn add_table(&mut self, topic: &Topic, messages: &[RawMessage<'_>]) -> Result<(), Error> {
        let planes = decode_all(topic, messages, |time, plane: Plane| {
            Ok(Some((time, plane.normalized()?)))
        })?;
        self.table = planes.into_iter().next().map(|(_, plane)| plane);
        Ok(())
    }

    fn add_poses(
        &mut self,
        topic: &Topic,
        arm: &str,
        messages: &[RawMessage<'_>],
    ) -> Result<(), Error> {
        let poses = decode_all(topic, messages, |time, pose: PoseStamped| {
            let Some(stamp) = valid_stamp(&pose.header, time) else {
                return Ok(None);
            };
            let isometry = pose.pose.isometry()?;
            self.frames.insert((topic.name(), pose.header.frame_id));
            Ok(Some((stamp, isometry)))
        })?;
        self.arms.entry(arm.to_owned()).or_default().poses = poses;
        Ok(())
    }

    /// A jaw state without a position says nothing and is left out.
    fn add_jaws(
        &mut self,
        topic: &Topic,
        arm: &str,
        messages: &[RawMessage<'_>],
    ) -> Result<(), Error> {
        let jaws = decode_all(topic, messages, |time, jaw: JointState| {
            let angle = jaw
                .position
                .first()
                .copied()
                .filter(|angle| angle.is_finite());
            Ok(valid_stamp(&jaw.header, time).zip(angle))
        })?;
        self.arms.entry(arm.to_owned()).or_default().jaws = jaws;
        Ok(())
    }

    /// Poses in another frame than the clouds would be grips in the wrong place. An empty name says nothing.
    fn check_frames(&self) -> Result<(), Error> {
        let expected = &self.camera_frame;
        let is_wrong = |found: &str| !found.is_empty() && !expected.is_empty() && found != expected;
        match self.frames.iter().find(|(_, found)| is_wrong(found)) {
            Some((topic, found)) => Err(Error::FrameMismatch {
                topic: topic.clone(),
                found: found.clone(),
                expected: expected.clone(),
            }),
            None => Ok(()),
        }
    }
}

fn file_bytes(path: &Path) -> Result<Vec<u8>, Error> {
    std::fs::read(path).map_err(|source| Error::Io {
        path: path.to_owned(),
        source,
    })
}

fn seconds(nanoseconds: u64) -> f64 {
    cdr::Time::from_nanoseconds(nanoseconds).seconds()
}

fn is_finite(point: &Point3<f64>) -> bool {
    point.iter().all(|value| value.is_finite())
}

/// A dVRK stamps with zero what it could not measure. A simulation that starts at zero logs at zero too.
fn valid_stamp(header: &Header, log_time: u64) -> Option<u64> {
    let stamp = header.stamp.nanoseconds();
    (stamp != 0 || log_time == 0).then_some(stamp)
}

/// The messages of each topic this crate knows, in the order of the file.
fn messages_by_topic<'a>(
    records: &Records<'a>,
) -> Result<Vec<(Topic, Vec<RawMessage<'a>>)>, Error> {
    // Two channels may carry one topic (a recorder that was restarted): they are one here.
    let mut by_name: BTreeMap<&str, (Topic, Vec<RawMessage<'a>>)> = BTreeMap::new();
    let mut known = BTreeMap::new();
    for (id, channel) in &records.channels {
        let Some(topic) = Topic::parse(&channel.topic) else {
            continue;
        };
        let type_name = topic.type_name();
        for (found, expected) in [(&channel.encoding, "cdr"), (&channel.type_name, type_name)] {
            if found != expected {
                let (topic, found) = (channel.topic.clone(), found.clone());
                return Err(Error::WrongType {
                    topic,
                    found,
                    expected,
                });
            }
        }
        known.insert(*id, channel.topic.as_str());
        by_name.entry(&channel.topic).or_insert((topic, Vec::new()));
    }
    for message in &records.messages {
        let entry = known
            .get(&message.channel)
            .and_then(|name| by_name.get_mut(name));
        if let Some((_, messages)) = entry {
            messages.push(*message);
        }
    }
    Ok(by_name.into_values().collect())
}

/// Decodes the messages of one topic and orders them by stamp; `keep` may leave one out.
fn decode_all<M: Message, T>(
    topic: &Topic,
    messages: &[RawMessage<'_>],
    mut keep: impl FnMut(u64, M) -> Result<Option<(u64, T)>, Error>,
) -> Result<Track<T>, Error> {
    let mut track = Vec::with_capacity(messages.len());
    for (index, message) in messages.iter().enumerate() {
        let kept = cdr::decode(message.data).and_then(|decoded| keep(message.log_time, decoded));
        let kept = kept.map_err(|source| Error::InMessage {
            topic: topic.name(),
            index,
            source: Box::new(source),
        })?;
        track.extend(kept);
    }
    // Stable: messages with one stamp stay in the order of the file.
    track.sort_by_key(|(stamp, _)| *stamp);
    Ok(track)
}

fn count_topics(records: &Records<'_>) -> Vec<TopicCount> {
    let mut counts = BTreeMap::new();
    for channel in records.channels.values() {
        counts
            .entry(&channel.topic)
            .or_insert((&channel.type_name, 0));
    }
    for message in &records.messages {
        let channel = records.channels.get(&message.channel);
        if let Some((_, count)) = channel.and_then(|channel| counts.get_mut(&channel.topic)) {
            *count += 1;
        }
    }
    let topic = |(topic, (type_name, count)): (&String, (&String, usize))| TopicCount {
        topic: topic.clone(),
        type_name: type_name.clone(),
        count,
    };
    counts.into_iter().map(topic).collect()
}
