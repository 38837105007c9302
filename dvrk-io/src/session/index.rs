//! The result of the first pass through a session: everything but the points of its clouds, and the positions of these in the file.
//!
//! Poses, jaw angles and the table are small and kept. Of a cloud only its stamp and its position in the file are kept, so
//! that clouds can be read again in the order of time, one by one.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Isometry3, UnitVector3};

use super::frame::TopicCount;
use super::scan::{Channel, Place};
use super::skipped::Skipped;
use super::source::Source;
use super::topic::{Role, Topics};
use super::walk::walk;
use crate::Error;
use crate::arm::Measurement;
use crate::cdr::{self, CameraInfo, Decoder, Header, JointState, Plane, PoseStamped};

/// Values of one topic, ordered by stamp (nanoseconds).
pub(super) type Track<T> = Vec<(u64, T)>;

/// The data of an arm.
#[derive(Debug, Default)]
pub(super) struct Arm {
    pub(super) poses: Track<Isometry3<f64>>,
    pub(super) jaws: Track<f64>,
    pub(super) jaw_setpoints: Track<f64>,
    pub(super) joints: Track<[f64; 6]>,
}

/// The requested content of a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Content {
    /// Clouds of the object.
    Objects,
    /// Scans of everything in view.
    Scans,
}

impl Content {
    fn wants(self, role: &Role) -> bool {
        match role {
            Role::Truth => false,
            Role::Points | Role::Camera | Role::Table | Role::Jaw(_) => true,
            Role::Features | Role::Pose(_) => self == Self::Objects,
            Role::Depth
            | Role::CameraInfo
            | Role::Colour
            | Role::Joints(_)
            | Role::JawSetpoint(_) => self == Self::Scans,
        }
    }
}

/// A session without its points.
#[derive(Debug, Default)]
pub(super) struct Index {
    /// In the order of time.
    pub(super) clouds: Track<Place>,
    /// The features, likewise.
    pub(super) features: Track<Place>,
    /// Poses of the camera, if it moves.
    pub(super) cameras: Track<Isometry3<f64>>,
    /// The depth images, likewise.
    pub(super) images: Track<Place>,
    /// Camera parameters, with the time of each change.
    pub(super) lenses: Track<CameraInfo>,
    /// The colour images, likewise, and the frame of the first.
    pub(super) colours: Track<Place>,
    pub(super) colour_frame: String,
    pub(super) table: Option<(UnitVector3<f64>, f64)>,
    pub(super) arms: BTreeMap<String, Arm>,
    pub(super) camera_frame: String,
    /// Frame of the poses of a moving camera, and then also of arms and table.
    fixed_frame: String,
    /// Topics of the clouds, of the features and of the colour images.
    pub(super) cloud_topic: String,
    pub(super) feature_topic: String,
    pub(super) colour_topic: String,
    pub(super) topics: Vec<TopicCount>,
    pub(super) complete: bool,
    pub(super) skipped: Skipped,
    /// By log time: the first plane is the table.
    planes: Track<(UnitVector3<f64>, f64)>,
    /// Topics and the frames of their messages; whether they are measured by the camera.
    frames: BTreeSet<(String, String, bool)>,
}

impl Index {
    /// # Errors
    /// See [`walk`]; also poses in another frame than the clouds.
    pub(super) fn of(
        source: &Source<'_>,
        topics: &Topics,
        content: Content,
    ) -> Result<Self, Error> {
        let mut index = Self::default();
        let wanted = |role: &Role| content.wants(role);
        let take = |role: &Role, channel: &Channel, log_time, place, data: &[u8]| {
            index.take(role, channel, log_time, place, data)
        };
        let (counts, complete, skipped) = walk(source, topics, wanted, take)?;
        // An arm with topics but without messages is an arm too.
        for count in &counts {
            let role = topics.role(&count.topic).filter(wanted);
            if let Some(Role::Pose(arm) | Role::Jaw(arm) | Role::Joints(arm)) = role {
                index.arm(&arm);
            }
        }
        for track in [
            &mut index.clouds,
            &mut index.features,
            &mut index.images,
            &mut index.colours,
        ] {
            track.sort_by_key(|(stamp, _)| *stamp);
        }
        index.lenses.sort_by_key(|(stamp, _)| *stamp);
        index.cameras.sort_by_key(|(stamp, _)| *stamp);
        index.planes.sort_by_key(|(time, _)| *time);
        index.table = index.planes.first().map(|(_, plane)| *plane);
        for arm in index.arms.values_mut() {
            // Stable sort: messages with the same stamp stay in the order of the file.
            arm.poses.sort_by_key(|(stamp, _)| *stamp);
            arm.jaws.sort_by_key(|(stamp, _)| *stamp);
            arm.jaw_setpoints.sort_by_key(|(stamp, _)| *stamp);
            arm.joints.sort_by_key(|(stamp, _)| *stamp);
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
                let stamp = self.seen(channel, data)?;
                self.clouds.push((stamp, place));
            }
            Role::Depth => {
                let stamp = self.seen(channel, data)?;
                self.images.push((stamp, place));
            }
            Role::CameraInfo => {
                let mut info: CameraInfo = cdr::decode(data)?;
                let stamp = std::mem::take(&mut info.header).stamp.nanoseconds();
                if self.lenses.last().is_none_or(|(_, last)| *last != info) {
                    self.lenses.push((stamp, info));
                }
            }
            Role::Colour => self.colour(channel, place, data)?,
            Role::Features => {
                let header = Header::read(&mut Decoder::new(data)?)?;
                self.features.push((header.stamp.nanoseconds(), place));
                self.feature_topic.clone_from(&channel.topic);
                self.in_frame(channel, header.frame_id, true);
            }
            Role::Camera => {
                let PoseStamped { header, pose } = cdr::decode(data)?;
                if let Some(stamp) = valid_stamp(&header, log_time) {
                    self.cameras.push((stamp, pose.isometry()?));
                    if self.fixed_frame.is_empty() {
                        self.fixed_frame.clone_from(&header.frame_id);
                    }
                    self.in_frame(channel, header.frame_id, false);
                }
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
                    self.in_frame(channel, header.frame_id, false);
                }
            }
            Role::Jaw(arm) => {
                let sample = jaw_angle(data, log_time)?;
                self.arm(arm).jaws.extend(sample);
            }
            Role::JawSetpoint(arm) => {
                let sample = jaw_angle(data, log_time)?;
                self.arm(arm).jaw_setpoints.extend(sample);
            }
            Role::Joints(arm) => {
                let joints: JointState = cdr::decode(data)?;
                let values = joints.value()?.position.try_into().ok();
                let sample = valid_stamp(&joints.header, log_time).zip(values);
                self.arm(arm).joints.extend(sample);
            }
        }
        Ok(())
    }

    /// Records topic and frame of a cloud or an image; returns its stamp.
    fn seen(&mut self, channel: &Channel, data: &[u8]) -> Result<u64, Error> {
        let header = Header::read(&mut Decoder::new(data)?)?;
        if self.cloud_topic.is_empty() {
            self.cloud_topic.clone_from(&channel.topic);
        }
        if self.camera_frame.is_empty() {
            self.camera_frame.clone_from(&header.frame_id);
        }
        self.in_frame(channel, header.frame_id, true);
        Ok(header.stamp.nanoseconds())
    }

    /// Records a colour image. Many recordings have the usual topic, from another point of view than the depth images; a topic that was named must be
    /// from the same.
    fn colour(&mut self, channel: &Channel, place: Place, data: &[u8]) -> Result<(), Error> {
        let header = Header::read(&mut Decoder::new(data)?)?;
        self.colours.push((header.stamp.nanoseconds(), place));
        self.colour_topic.clone_from(&channel.topic);
        if self.colour_frame.is_empty() {
            self.colour_frame.clone_from(&header.frame_id);
        }
        if channel.topic != Role::Colour.topic() {
            self.in_frame(channel, header.frame_id, true);
        }
        Ok(())
    }

    fn arm(&mut self, name: &str) -> &mut Arm {
        if !self.arms.contains_key(name) {
            self.arms.insert(name.to_owned(), Arm::default());
        }
        self.arms.entry(name.to_owned()).or_default()
    }

    fn in_frame(&mut self, channel: &Channel, frame: String, measured: bool) {
        let entry = (channel.topic.clone(), frame, measured);
        if !self.frames.contains(&entry) {
            self.frames.insert(entry);
        }
    }

    /// Poses must be in the frame of the clouds, or grips would be misplaced; if the camera moves, in the frame of its poses. An
    /// empty name is ignored.
    fn check_frames(&self) -> Result<(), Error> {
        let expected = |measured: bool| match (measured, self.cameras.is_empty()) {
            (false, false) => &self.fixed_frame,
            _ => &self.camera_frame,
        };
        let is_wrong = |found: &str, expected: &str| {
            !found.is_empty() && !expected.is_empty() && found != expected
        };
        let mut frames = self.frames.iter();
        match frames.find(|(_, found, measured)| is_wrong(found, expected(*measured))) {
            Some((topic, found, measured)) => Err(Error::FrameMismatch {
                topic: topic.clone(),
                found: found.clone(),
                expected: expected(*measured).clone(),
            }),
            None => Ok(()),
        }
    }
}

/// A jaw state without a position is ignored.
fn jaw_angle(data: &[u8], log_time: u64) -> Result<Option<(u64, f64)>, Error> {
    let jaw: JointState = cdr::decode(data)?;
    let angle = jaw.position.first().copied();
    let angle = angle.filter(|angle| angle.is_finite());
    Ok(valid_stamp(&jaw.header, log_time).zip(angle))
}

/// A dVRK marks unmeasured samples with the stamp zero. A simulation that starts at time zero logs at zero too.
fn valid_stamp(header: &Header, log_time: u64) -> Option<u64> {
    let stamp = header.stamp.nanoseconds();
    (stamp != 0 || log_time == 0).then_some(stamp)
}
