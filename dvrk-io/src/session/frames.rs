//! The second pass through a session: cloud by cloud in the order of time, each with the nearest arm samples.

use nalgebra::{Isometry3, Point3, UnitVector3};

use super::chunk::Cache;
use super::frame::{ArmSample, Frame, TopicCount};
use super::index::{Arm, Index, Track};
use super::scan::Place;
use super::skipped::{Skip, Skipped};
use super::source::{Input, Source};
use crate::Error;
use crate::cdr::{self, Image, PointCloud2, Time};
use crate::depth::Scan;
use crate::features::Feature;

/// The frames of a session, in the order of time; each is read from the file on demand.
///
/// A cloud that cannot be decoded is skipped and reported in [`Frames::skipped`]. An error ends the frames; it occurs only
/// if the file can no longer be read.
///
/// *Memory.* One cloud, one chunk if it is compressed, every arm sample (about 80 bytes each), and 48 bytes for each frame.
pub struct Frames<'a> {
    source: Source<'a>,
    tolerance: f64,
    index: Index,
    names: Vec<String>,
    next: usize,
    open: Option<(usize, Input<'a>, Cache)>,
    buffer: Vec<u8>,
}

impl std::fmt::Debug for Frames<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Frames")
            .field("names", &self.names)
            .field("next", &self.next)
            .finish_non_exhaustive()
    }
}

impl<'a> Frames<'a> {
    pub(super) fn new(source: Source<'a>, tolerance: f64, index: Index) -> Self {
        let names = index.arms.keys().cloned().collect();
        Self {
            source,
            tolerance,
            index,
            names,
            next: 0,
            open: None,
            buffer: Vec::new(),
        }
    }

    /// The table: `normal · x + offset ≥ 0` on the free side, camera frame. The first one recorded.
    pub fn table(&self) -> Option<(UnitVector3<f64>, f64)> {
        self.index.table
    }

    /// Whether any arm has a pose in the recording: arms may have topics without messages.
    pub fn has_poses(&self) -> bool {
        self.index.arms.values().any(|arm| !arm.poses.is_empty())
    }

    /// Whether poses of the camera were recorded, so that it moves. A cloud without a pose around its time is then skipped.
    pub fn camera_moves(&self) -> bool {
        !self.index.cameras.is_empty()
    }

    /// Names of the arms, sorted.
    pub fn arm_names(&self) -> &[String] {
        &self.names
    }

    /// Name of the frame of the clouds.
    pub fn camera_frame(&self) -> &str {
        &self.index.camera_frame
    }

    /// Every topic of the session, sorted, whether this crate knows it or not.
    pub fn topics(&self) -> &[TopicCount] {
        &self.index.topics
    }

    /// Whether the recorder closed every file. If not, the session ends where the files do.
    pub fn complete(&self) -> bool {
        self.index.complete
    }

    /// What was skipped so far.
    pub fn skipped(&self) -> &Skipped {
        &self.index.skipped
    }

    /// Stamps of the remaining clouds, seconds, in order. A cloud that turns out to be damaged
    /// gives no frame.
    pub fn stamps(&self) -> impl ExactSizeIterator<Item = f64> + '_ {
        let left = &self.index.clouds[self.next.min(self.index.clouds.len())..];
        left.iter().map(|(stamp, _)| seconds(*stamp))
    }

    pub(super) fn into_index(self) -> Index {
        self.index
    }

    /// Reads the bytes of a message into the buffer.
    fn read(&mut self, place: Place) -> Result<(), Error> {
        let same = self.open.take().filter(|(part, ..)| *part == place.part);
        let open = match same {
            Some(open) => open,
            None => (place.part, self.source.open(place.part)?, Cache::default()),
        };
        let (_, input, cache) = self.open.insert(open);
        match place.chunk {
            None => input.read(place.at, place.length, &mut self.buffer),
            Some(chunk) => cache.read(input, chunk, [place.at, place.length], &mut self.buffer),
        }
    }

    /// The features that belong to a cloud; those that cannot be decoded are skipped.
    fn features(&mut self, stamp: u64) -> Result<Option<Vec<Feature>>, Error> {
        let Some(place) = self.closest(&self.index.features, stamp).copied() else {
            return Ok(None);
        };
        self.read(place)?;
        let decoded = cdr::decode::<PointCloud2>(&self.buffer).and_then(|c| c.features());
        Ok(match decoded {
            Ok(features) => Some(features),
            Err(error) => {
                let topic = self.index.feature_topic.clone();
                self.skip(place.record(), &topic, &error);
                None
            }
        })
    }

    /// A scan with the colours of the colour image that belongs to it; one that cannot be decoded, or has another size, is skipped.
    pub(super) fn coloured(&mut self, scan: Scan, stamp: u64) -> Result<Scan, Error> {
        let Some(place) = self.closest(&self.index.colours, stamp).copied() else {
            return Ok(scan);
        };
        self.read(place)?;
        let coloured = cdr::decode::<Image>(&self.buffer).and_then(|i| scan.colours_of(&i));
        Ok(match coloured {
            Ok(colours) => scan.with_colours(colours),
            Err(error) => {
                let topic = self.index.colour_topic.clone();
                self.skip(place.record(), &topic, &error);
                scan
            }
        })
    }

    /// The pose of the camera at a time, if it moves.
    fn camera(&self, stamp: u64) -> Result<Option<Isometry3<f64>>, Error> {
        if self.index.cameras.is_empty() {
            return Ok(None);
        }
        match self.closest(&self.index.cameras, stamp) {
            Some(pose) => Ok(Some(*pose)),
            None => Err(Error::NoCameraPose {
                stamp: seconds(stamp),
                tolerance: self.tolerance,
            }),
        }
    }

    fn frame(
        &self,
        stamp: u64,
        cloud: Coloured,
        features: Option<Vec<Feature>>,
    ) -> Result<Frame, Error> {
        let camera = self.camera(stamp)?;
        Ok(Frame {
            stamp: seconds(stamp),
            camera,
            points: cloud.points,
            colours: cloud.colours,
            features,
            arms: self.samples(stamp),
        })
    }

    fn sample(&self, name: &str, arm: &Arm, stamp: u64) -> ArmSample {
        let pose: Option<&Isometry3<f64>> = self.closest(&arm.poses, stamp);
        ArmSample {
            name: name.to_owned(),
            pose: pose.copied(),
            jaw: self.closest(&arm.jaws, stamp).copied(),
            jaw_setpoint: self.closest(&arm.jaw_setpoints, stamp).copied(),
            joints: self.closest(&arm.joints, stamp).copied(),
        }
    }

    pub(super) fn samples(&self, stamp: u64) -> Vec<ArmSample> {
        let arms = self.index.arms.iter();
        arms.map(|(name, arm)| self.sample(name, arm, stamp))
            .collect()
    }

    pub(super) fn index(&mut self) -> &mut Index {
        &mut self.index
    }

    /// The result of the next cloud or image that can be decoded; others are skipped and reported.
    pub(super) fn next_with<T>(
        &mut self,
        decode: impl Fn(&mut Self, u64, &[u8]) -> Result<Result<T, Error>, Error>,
    ) -> Option<Result<T, Error>> {
        loop {
            let &(stamp, place) = self.index.clouds.get(self.next)?;
            self.next += 1;
            let read = self.read(place).and_then(|()| {
                let data = std::mem::take(&mut self.buffer);
                let decoded = decode(self, stamp, &data);
                self.buffer = data;
                decoded
            });
            match read {
                Ok(Ok(frame)) => return Some(Ok(frame)),
                Ok(Err(error)) => {
                    let topic = self.index.cloud_topic.clone();
                    self.skip(place.record(), &topic, &error);
                }
                Err(error) => {
                    self.next = self.index.clouds.len();
                    return Some(Err(error));
                }
            }
        }
    }

    /// The value closest in time to `stamp` (the earlier of two equally close), if it lies within the tolerance.
    fn closest<'t, T>(&self, track: &'t Track<T>, stamp: u64) -> Option<&'t T> {
        let after = track.partition_point(|(time, _)| *time < stamp);
        let candidates = &track[after.saturating_sub(1)..track.len().min(after + 1)];
        let (time, value) = candidates
            .iter()
            .min_by_key(|(time, _)| time.abs_diff(stamp))?;
        (time.abs_diff(stamp) as f64 * 1e-9 <= self.tolerance).then_some(value)
    }

    fn skip(&mut self, place: Place, topic: &str, error: &Error) {
        self.index.skipped.add(Skip {
            file: self.source.path(place.part),
            byte: place.chunk.unwrap_or(place.at),
            byte_in_chunk: place.chunk.map(|_| place.at),
            topic: topic.to_owned(),
            messages: 1,
            reason: error.to_string(),
        });
    }
}

impl Iterator for Frames<'_> {
    type Item = Result<Frame, Error>;

    fn next(&mut self) -> Option<Self::Item> {
        self.next_with(|frames, stamp, data| {
            let cloud = match object_points(data) {
                Ok(cloud) => cloud,
                Err(error) => return Ok(Err(error)),
            };
            let features = frames.features(stamp)?;
            Ok(frames.frame(stamp, cloud, features))
        })
    }
}

/// Points with their colours, if they have any.
struct Coloured {
    points: Vec<Point3<f64>>,
    colours: Option<Vec<[u8; 3]>>,
}

/// The valid points of a cloud message. Unreadable colours are ignored, because a frame needs only points.
fn object_points(data: &[u8]) -> Result<Coloured, Error> {
    let cloud = cdr::decode::<PointCloud2>(data)?;
    let mut points = cloud.points()?;
    let colours = cloud.colours().ok().flatten();
    let is_valid = |point: &Point3<f64>| {
        point.iter().all(|value| value.is_finite()) && *point != Point3::origin()
    };
    let colours = colours.map(|colours| {
        let both = colours.into_iter().zip(&points);
        both.filter(|(_, p)| is_valid(p)).map(|(c, _)| c).collect()
    });
    points.retain(is_valid);
    Ok(Coloured { points, colours })
}

pub(super) fn seconds(nanoseconds: u64) -> f64 {
    Time::from_nanoseconds(nanoseconds).seconds()
}
