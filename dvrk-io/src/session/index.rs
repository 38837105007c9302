//! The first walk through a session: everything but the points of its clouds, and where those are.
//!
//! Poses, jaw angles and the table are small and kept. Of a cloud only its stamp is, and the place of its bytes, so
//! that the clouds can be read again in the order of time, one by one.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Isometry3, UnitVector3};

use super::frame::TopicCount;
use super::scan::{Channel, Event, Place, Scanner};
use super::skipped::{Skip, Skipped};
use super::source::Source;
use super::topic::{Role, Topics};
use crate::Error;
use crate::cdr::{self, Decoder, Header, JointState, Plane, PoseStamped};

/// Values of one topic, ordered by stamp (nanoseconds).
pub(super) type Track<T> = Vec<(u64, T)>;

/// What is known of an arm.
#[derive(Debug, Default)]
pub(super) struct Arm {
    pub(super) poses: Track<Isometry3<f64>>,
    pub(super) jaws: Track<f64>,
}

/// A session but for its points.
#[derive(Debug, Default)]
pub(super) struct Index {
    /// In the order of time.
    pub(super) clouds: Track<Place>,
    pub(super) table: Option<(UnitVector3<f64>, f64)>,
    pub(super) arms: BTreeMap<String, Arm>,
    pub(super) camera_frame: String,
    /// Topic of the clouds.
    pub(super) cloud_topic: String,
    pub(super) topics: Vec<TopicCount>,
    pub(super) complete: bool,
    pub(super) skipped: Skipped,
    /// By log time: the first plane is the table.
    planes: Track<(UnitVector3<f64>, f64)>,
    /// Topics and the frames their messages are in.
    frames: BTreeSet<(String, String)>,
}

/// Walks through every file of `source` and hands `take` each message that has a role, with its channel. What `take`
/// refuses is passed over; damage is as well. Counts the messages of every topic, and says whether every file was
/// closed.
///
/// # Errors
/// A file cannot be read or is no MCAP file; a topic with a role carries another type; a topic that was named is in
/// none of the files.
pub(super) fn walk(
    source: &Source<'_>,
    topics: &Topics,
    wanted: impl Fn(&Role) -> bool,
    mut take: impl FnMut(&Role, &Channel, u64, Place, &[u8]) -> Result<(), Error>,
) -> Result<(Vec<TopicCount>, bool, Skipped), Error> {
    let mut counts = BTreeMap::new();
    let (mut complete, mut skipped) = (true, Skipped::default());
    for part in 0..source.parts() {
        let mut scanner = Scanner::open(source, part)?;
        let path = source.path(part);
        let mut add = |place: Place, topic: &str, messages, reason| {
            skipped.add(Skip {
                file: path.clone(),
                byte: place.chunk.unwrap_or(place.at),
                byte_in_chunk: place.chunk.map(|_| place.at),
                topic: topic.to_owned(),
                messages,
                reason,
            });
        };
        while let Some(event) = scanner.next()? {
            let (id, log_time, place) = match event {
                Event::Message {
                    channel,
                    log_time,
                    place,
                } => (channel, log_time, place),
                Event::Skip {
                    place,
                    messages,
                    reason,
                } => {
                    add(place, "", messages, reason);
                    continue;
                }
            };
            let Some(channel) = scanner.channels().get(&id) else {
                add(
                    place.record(),
                    "",
                    1,
                    format!("channel {id} is not declared"),
                );
                continue;
            };
            *count(&mut counts, channel) += 1;
            let Some(role) = topics.role(&channel.topic).filter(&wanted) else {
                continue;
            };
            check_type(&role, channel)?;
            if let Err(error) = take(&role, channel, log_time, place, scanner.data()) {
                add(place.record(), &channel.topic, 1, error.to_string());
            }
        }
        for channel in scanner.channels().values() {
            count(&mut counts, channel);
            if let Some(role) = topics.role(&channel.topic).filter(&wanted) {
                check_type(&role, channel)?;
            }
        }
        complete &= scanner.complete();
    }
    let topic = |(topic, (type_name, count))| TopicCount {
        topic,
        type_name,
        count,
    };
    let counts: Vec<_> = counts.into_iter().map(topic).collect();
    for (_, name) in topics.renamed().filter(|(role, _)| wanted(role)) {
        if !counts.iter().any(|count| count.topic == *name) {
            let names: Vec<_> = counts.iter().map(|count| count.topic.as_str()).collect();
            let (topic, available) = (name.clone(), names.join(", "));
            return Err(Error::NoSuchTopic { topic, available });
        }
    }
    Ok((counts, complete, skipped))
}

type Counts = BTreeMap<String, (String, usize)>;

fn count<'a>(counts: &'a mut Counts, channel: &Channel) -> &'a mut usize {
    // Two channels may carry one topic (a recorder that was restarted): they are one here.
    if !counts.contains_key(&channel.topic) {
        counts.insert(channel.topic.clone(), (channel.type_name.clone(), 0));
    }
    &mut counts.entry(channel.topic.clone()).or_default().1
}

fn check_type(role: &Role, channel: &Channel) -> Result<(), Error> {
    for (found, expected) in [
        (&channel.encoding, "cdr"),
        (&channel.type_name, role.type_name()),
    ] {
        if found != expected {
            let (topic, found) = (channel.topic.clone(), found.clone());
            return Err(Error::WrongType {
                topic,
                found,
                expected,
            });
        }
    }
    Ok(())
}

impl Index {
    /// # Errors
    /// See [`walk`]; also poses in another frame than the clouds.
    pub(super) fn of(source: &Source<'_>, topics: &Topics) -> Result<Self, Error> {
        let mut index = Self::default();
        let wanted = |role: &Role| *role != Role::Truth;
        let take = |role: &Role, channel: &Channel, log_time, place, data: &[u8]| {
            index.take(role, channel, log_time, place, data)
        };
        let (counts, complete, skipped) = walk(source, topics, wanted, take)?;
        // An arm that was recorded without saying anything is an arm.
        for count in &counts {
            if let Some(Role::Pose(arm) | Role::Jaw(arm)) = topics.role(&count.topic) {
                index.arm(&arm);
            }
        }
        index.clouds.sort_by_key(|(stamp, _)| *stamp);
        index.planes.sort_by_key(|(time, _)| *time);
        index.table = index.planes.first().map(|(_, plane)| *plane);
        for arm in index.arms.values_mut() {
            // Stable: messages with one stamp stay in the order of the file.
            arm.poses.sort_by_key(|(stamp, _)| *stamp);
            arm.jaws.sort_by_key(|(stamp, _)| *stamp);
        }
        (index.topics, index.complete, index.skipped) = (counts, complete, skipped);
        index.check_frames()?;
        Ok(index)
    }

    fn take(
        &mut self,
        role: &Role,
        channel: &Channel,
        log_time: u64,
        place: Place,
        data: &[u8],
    ) -> Result<(), Error> {
        match role {
            Role::Truth => {}
            Role::Points => {
                let header = Header::read(&mut Decoder::new(data)?)?;
                if self.cloud_topic.is_empty() {
                    self.cloud_topic.clone_from(&channel.topic);
                }
                if self.camera_frame.is_empty() {
                    self.camera_frame.clone_from(&header.frame_id);
                }
                self.clouds.push((header.stamp.nanoseconds(), place));
                self.in_frame(channel, header.frame_id);
            }
            Role::Table => {
                let plane = cdr::decode::<Plane>(data)?.normalized()?;
                self.planes.push((log_time, plane));
            }
            Role::Pose(arm) => {
                let PoseStamped { header, pose } = cdr::decode(data)?;
                if let Some(stamp) = valid_stamp(&header, log_time) {
                    let pose = pose.isometry()?;
                    self.arm(arm).poses.push((stamp, pose));
                    self.in_frame(channel, header.frame_id);
                }
            }
            Role::Jaw(arm) => {
                let jaw: JointState = cdr::decode(data)?;
                // A jaw state without a position says nothing and is left out.
                let angle = jaw
                    .position
                    .first()
                    .copied()
                    .filter(|angle| angle.is_finite());
                let sample = valid_stamp(&jaw.header, log_time).zip(angle);
                self.arm(arm).jaws.extend(sample);
            }
        }
        Ok(())
    }

    fn arm(&mut self, name: &str) -> &mut Arm {
        if !self.arms.contains_key(name) {
            self.arms.insert(name.to_owned(), Arm::default());
        }
        self.arms.entry(name.to_owned()).or_default()
    }

    fn in_frame(&mut self, channel: &Channel, frame: String) {
        let entry = (channel.topic.clone(), frame);
        if !self.frames.contains(&entry) {
            self.frames.insert(entry);
        }
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

/// A dVRK stamps with zero what it could not measure. A simulation that starts at zero logs at zero too.
fn valid_stamp(header: &Header, log_time: u64) -> Option<u64> {
    let stamp = header.stamp.nanoseconds();
    (stamp != 0 || log_time == 0).then_some(stamp)
}
