//! Reads recordings.

use std::path::Path;

use nalgebra::Point3;

use super::frame::{Session, Truth, TruthFrame};
use super::frames::{Frames, seconds};
use super::index::{Content, Index};
use super::scans::Scans;
use super::source::Source;
use super::topic::{Role, Topics};
use super::walk::walk;
use crate::Error;
use crate::cdr::{self, PointCloud2};

/// Reads sessions: an MCAP file, or the directory of a rosbag2 recording with one or more of them. Chunks may be
/// compressed with zstd or LZ4.
///
/// Damage does not end a session: a message that cannot be read is skipped, as is a chunk with a wrong checksum,
/// and both are reported with their position ([`Session::skipped`]). A truncated file is read up to its last
/// complete message ([`Session::complete`]).
///
/// ```no_run
/// use dvrk_io::session::{Role, SessionReader};
/// let reader = SessionReader::default()
///     .with_topic(Role::Points, "/camera/object")
///     .with_topic(Role::Pose("PSM1".into()), "/left/measured_cp");
/// for frame in reader.frames("recording")? {
///     println!("{} points", frame?.points.len());
/// }
/// # Ok::<(), dvrk_io::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct SessionReader {
    /// Largest time difference between an arm sample and a cloud in the same frame, seconds.
    ///
    /// Default 0.02: a dVRK publishes at 100 Hz, so that a measured arm always has a sample within 5 ms of a
    /// cloud and 20 ms allow for jitter; where arms are recorded once a frame, it is still less than half the
    /// frame period up to 25 Hz, so that no pose is assigned to a wrong frame.
    pub tolerance: f64,
    topics: Topics,
}

impl Default for SessionReader {
    fn default() -> Self {
        Self {
            tolerance: 0.02,
            topics: Topics::default(),
        }
    }
}

impl SessionReader {
    /// Reads a session with the default settings.
    ///
    /// # Errors
    /// See [`SessionReader::frames`].
    pub fn open(path: impl AsRef<Path>) -> Result<Session, Error> {
        Self::default().read(path)
    }

    /// The same reader with another [`tolerance`](Self::tolerance), in seconds.
    #[must_use]
    pub fn with_tolerance(self, tolerance: f64) -> Self {
        Self { tolerance, ..self }
    }

    /// The same reader, which takes this topic (`/camera/object`) for this role instead of the
    /// [usual one](Role::topic). The last call for a role or a topic counts.
    #[must_use]
    pub fn with_topic(mut self, role: Role, topic: impl Into<String>) -> Self {
        self.topics.insert(role, topic.into());
        self
    }

    /// Opens a session for reading frame by frame; the file is read once, and of the clouds only the positions in the file
    /// are kept.
    ///
    /// # Errors
    /// A file cannot be read or is not an MCAP file; a directory is not a recording; a topic with a role has another
    /// type; a topic given to [`with_topic`](Self::with_topic) does not exist; poses and clouds are in different frames.
    ///
    /// # Complexity
    /// O(bytes of the file).
    pub fn frames(&self, path: impl AsRef<Path>) -> Result<Frames<'static>, Error> {
        let source = Source::of_path(path.as_ref())?;
        self.frames_of(source, Content::Objects)
    }

    /// Opens a recording of everything in view: its depth images, or its clouds if there are no images. Scans are
    /// read one by one, each with joint values and jaws of the arms nearest in time, for use with
    /// [`find_object`](crate::depth::find_object).
    ///
    /// # Errors
    /// See [`SessionReader::frames`]; [`Error::NoSuchTopic`] for images without `CameraInfo`; [`Error::ScansOfMovingCamera`].
    ///
    /// # Complexity
    /// O(bytes of the file).
    pub fn scans(&self, path: impl AsRef<Path>) -> Result<Scans<'static>, Error> {
        let source = Source::of_path(path.as_ref())?;
        Scans::new(self.frames_of(source, Content::Scans)?)
    }

    /// Opens a recording of everything in view, from the bytes of its file.
    ///
    /// # Errors
    /// See [`SessionReader::scans`].
    pub fn scans_of_bytes<'a>(&self, file: &'a [u8]) -> Result<Scans<'a>, Error> {
        Scans::new(self.frames_of(Source::Bytes(file), Content::Scans)?)
    }

    /// Reads a whole session into memory.
    ///
    /// # Errors
    /// See [`SessionReader::frames`].
    pub fn read(&self, path: impl AsRef<Path>) -> Result<Session, Error> {
        collect(self.frames(path)?)
    }

    /// Reads a session from the bytes of its file.
    ///
    /// # Errors
    /// See [`SessionReader::frames`].
    pub fn read_bytes(&self, file: &[u8]) -> Result<Session, Error> {
        collect(self.frames_of(Source::Bytes(file), Content::Objects)?)
    }

    /// Reads the ground truth: for measures, never for algorithms. Empty if there is none. A frame with non-finite
    /// points cannot be read.
    ///
    /// # Errors
    /// A file cannot be read or is not an MCAP file; the topic of the truth has another type, or was given and does not
    /// exist.
    pub fn read_truth(&self, path: impl AsRef<Path>) -> Result<Truth, Error> {
        self.truth_of(&Source::of_path(path.as_ref())?)
    }

    fn frames_of<'a>(&self, source: Source<'a>, content: Content) -> Result<Frames<'a>, Error> {
        if !(self.tolerance >= 0.0 && self.tolerance.is_finite()) {
            let (what, value) = ("tolerance", self.tolerance);
            return Err(Error::OutOfRange {
                what,
                value,
                expected: "must be finite and not negative",
            });
        }
        let index = Index::of(&source, &self.topics, content)?;
        Ok(Frames::new(source, self.tolerance, index))
    }

    fn truth_of(&self, source: &Source<'_>) -> Result<Truth, Error> {
        let mut frames = Vec::new();
        let wanted = |role: &Role| *role == Role::Truth;
        let (_, _, skipped) = walk(source, &self.topics, wanted, |_, _, _, _, data| {
            let cloud: PointCloud2 = cdr::decode(data)?;
            let points = cloud.points()?;
            let is_finite = |point: &Point3<f64>| point.iter().all(|value| value.is_finite());
            if let Some(index) = points.iter().position(|point| !is_finite(point)) {
                let point = points[index].into();
                return Err(Error::NonFinitePoint { index, point });
            }
            frames.push((cloud.header.stamp.nanoseconds(), points));
            Ok(())
        })?;
        frames.sort_by_key(|(stamp, _)| *stamp);
        let frame = |(stamp, points)| TruthFrame {
            stamp: seconds(stamp),
            points,
        };
        let frames = frames.into_iter().map(frame).collect();
        Ok(Truth { frames, skipped })
    }
}

fn collect(mut frames: Frames<'_>) -> Result<Session, Error> {
    let all = frames.by_ref().collect::<Result<_, _>>()?;
    let arm_names = frames.arm_names().to_vec();
    let index = frames.into_index();
    Ok(Session {
        frames: all,
        table: index.table,
        arm_names,
        camera_frame: index.camera_frame,
        topics: index.topics,
        complete: index.complete,
        skipped: index.skipped,
    })
}

/// The true positions of the material points: for measures, never for algorithms. Empty if the file has none.
/// Damaged frames are skipped; [`SessionReader::read_truth`] reports them.
///
/// # Errors
/// See [`SessionReader::read_truth`].
pub fn read_truth(path: impl AsRef<Path>) -> Result<Vec<TruthFrame>, Error> {
    Ok(SessionReader::default().read_truth(path)?.frames)
}

/// [`read_truth`] from the bytes of a file.
///
/// # Errors
/// See [`SessionReader::read_truth`].
pub fn read_truth_from_bytes(file: &[u8]) -> Result<Vec<TruthFrame>, Error> {
    let truth = SessionReader::default().truth_of(&Source::Bytes(file))?;
    Ok(truth.frames)
}
