//! Errors in bytes, files, images and numbers given to this crate.

use std::path::PathBuf;

use crate::arm::{ArmStatus, MissingStream, Stop};
use crate::kinematics::Unreachable;

/// The error type of this crate. Every variant has the place and the value.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The file cannot be opened, read, written or synchronised.
    #[error("{path}: {error}")]
    Io {
        /// The file.
        path: PathBuf,
        /// The error of the operating system.
        error: std::io::Error,
    },
    /// An earlier write failed, so that nothing more can be appended.
    #[error("{path}: nothing can be written after a write that failed")]
    Write {
        /// The file.
        path: PathBuf,
    },
    /// The file does not start with the magic bytes of MCAP.
    #[error("{path}: not an MCAP file: it does not start with the MCAP magic")]
    NotMcap {
        /// The file; empty for bytes in memory.
        path: PathBuf,
    },
    /// A directory is not a rosbag2 recording that this crate reads.
    #[error("{path}: {reason}")]
    BadBag {
        /// The directory, or its `metadata.yaml`.
        path: PathBuf,
        /// What is missing, or what is stored there instead.
        reason: String,
    },
    /// The given topic is in none of the files.
    #[error("there is no topic {topic}; the topics are {available}")]
    NoSuchTopic {
        /// The topic.
        topic: String,
        /// All topics.
        available: String,
    },
    /// Text that is not a role of a topic.
    #[error(
        "`{text}` is not a role; roles are points, features, table, truth, ARM/measured_cp, ARM/jaw/measured_js and so on"
    )]
    BadRole {
        /// The text.
        text: String,
    },
    /// A topic this crate knows carries another message type or encoding.
    #[error("topic {topic} carries {found}, expected {expected}")]
    WrongType {
        /// The topic.
        topic: String,
        /// Type or encoding in the file.
        found: String,
        /// Type or encoding this crate reads there.
        expected: &'static str,
    },
    /// One message of a session cannot be read or written.
    #[error("{topic}, message {index}: {error}")]
    InMessage {
        /// The topic.
        topic: String,
        /// Which message of that topic, from 0.
        index: usize,
        /// What is wrong with it.
        error: Box<Error>,
    },
    /// CDR bytes end before a field does.
    #[error("CDR field `{field}` at byte {offset} needs {needed} bytes, {available} are left")]
    Truncated {
        /// The field.
        field: &'static str,
        /// Byte offset in the message, encapsulation header included.
        offset: usize,
        /// Bytes the field needs.
        needed: usize,
        /// Bytes that are left.
        available: usize,
    },
    /// The encapsulation header names a representation other than plain CDR.
    #[error("CDR encapsulation {found:#06x} is not plain CDR (0x0000 big, 0x0001 little endian)")]
    Encapsulation {
        /// The representation identifier found.
        found: u16,
    },
    /// A CDR string does not end with its NUL byte or is not UTF-8.
    #[error("CDR string `{field}` at byte {offset}: {reason}")]
    BadString {
        /// The field.
        field: &'static str,
        /// Byte offset of its first character.
        offset: usize,
        /// What is wrong with it.
        reason: &'static str,
    },
    /// A string or sequence is too long for CDR (2³² − 1).
    #[error("CDR field `{field}` has {length} elements, more than fit in 32 bits")]
    TooLong {
        /// The field.
        field: &'static str,
        /// Its length.
        length: usize,
    },
    /// A point cloud message is inconsistent.
    #[error("point cloud: {reason}")]
    BadCloud {
        /// What does not fit, with the values.
        reason: String,
    },
    /// A point is NaN, infinite, or too large for the 32-bit floats of a point cloud.
    #[error("point {index} is {point:?}: not finite in 32-bit floats")]
    NonFinitePoint {
        /// Which point.
        index: usize,
        /// Its coordinates.
        point: [f64; 3],
    },
    /// A quantity is NaN, infinite, or out of its range.
    #[error("{what} is {value}, but {expected}")]
    OutOfRange {
        /// Which quantity.
        what: &'static str,
        /// Its value.
        value: f64,
        /// What it must be.
        expected: &'static str,
    },
    /// The position of the table in scans is fixed only if the camera does not move.
    #[error(
        "the camera moves: its recording can be read as clouds of the object, but not as scans of everything in view"
    )]
    ScansOfMovingCamera,
    /// A camera that moves was not measured around the time of a cloud.
    #[error("no pose of the camera within {tolerance} s of the cloud at {stamp:.3} s")]
    NoCameraPose {
        /// Time of the cloud, seconds.
        stamp: f64,
        /// Largest time difference of a pose, seconds.
        tolerance: f64,
    },
    /// Data are in another coordinate frame than the clouds, or, with a moving camera, than its poses.
    #[error("{topic} is in frame `{found}` instead of `{expected}`")]
    FrameMismatch {
        /// The topic.
        topic: String,
        /// Its frame.
        found: String,
        /// Frame of the clouds, or of the poses of the camera.
        expected: String,
    },
    /// The tip of an arm cannot reach this pose.
    #[error("unreachable: {0}")]
    Unreachable(Unreachable),
    /// A sample of a calibration is invalid.
    #[error("sample {index}: {error}")]
    BadSample {
        /// Which sample, from 0.
        index: usize,
        /// What is wrong with it.
        error: Box<Error>,
    },
    /// Too few samples for a calibration or its check.
    #[error("{given} samples, at least {needed} are needed")]
    TooFewSamples {
        /// How many there are.
        given: usize,
        /// How many are needed.
        needed: usize,
    },
    /// Samples of a calibration are too similar: more than one transform fits them.
    #[error(
        "{what} is {value:.4} {unit}, at least {needed:.4} {unit} is needed: vary the poses more"
    )]
    Degenerate {
        /// The quantity that is too small.
        what: &'static str,
        /// Its value, in `unit`.
        value: f64,
        /// The required value, in `unit`.
        needed: f64,
        /// `m` or `rad`.
        unit: &'static str,
    },
    /// Half of the measured points are nearer than 2 cm or farther than 20 m.
    #[error(
        "the median distance is {median:.3} m, taken in {}: this is implausible for a camera; check the unit",
        unit.plural()
    )]
    DepthUnit {
        /// Median distance of the measured points, m.
        median: f64,
        /// The assumed unit.
        unit: crate::depth::LengthUnit,
    },
    /// Distances measured by the camera and by the arm differ.
    #[error("distances in the camera are {ratio:.3} times those at the arm: are both in metres?")]
    ScaleMismatch {
        /// Camera over arm, median.
        ratio: f64,
    },
    /// A reflection fits the samples of a calibration, but no rotation does.
    #[error(
        "camera and arm points are mirror images: an axis has the wrong sign in one of the two frames"
    )]
    Mirrored,
    /// The samples of a calibration do not agree with each other.
    #[error("{outliers} of {samples} samples do not agree with the others")]
    TooManyOutliers {
        /// How many do not agree.
        outliers: usize,
        /// How many there are.
        samples: usize,
    },
    /// A calibration without a marker cannot be checked with sightings.
    #[error("this calibration has no marker: check it with touches")]
    NoMarker,
    /// A calibration file, or a calibration to be written, is invalid.
    #[error("calibration, line {line}, `{key}`: {reason}")]
    BadCalibration {
        /// Line of the file, from 1; 0 if there is no file yet.
        line: usize,
        /// The key, or the table.
        key: String,
        /// What is wrong with it.
        reason: String,
    },
    /// The name of an arm cannot be part of a topic.
    #[error(
        "arm name `{name}` cannot be part of a topic: letters, digits and underscores, not starting with a digit"
    )]
    BadArmName {
        /// The name.
        name: String,
    },
    /// An image message is inconsistent in itself or with its camera.
    #[error("image: {reason}")]
    BadImage {
        /// What does not fit, with the values.
        reason: String,
    },
    /// No plane contains enough of the points to be the table.
    #[error("no table in view: the best plane holds {:.0} % of {points} points, {reason}", 100.0 * share)]
    NoTable {
        /// Number of points tested.
        points: usize,
        /// Share of them on the best plane.
        share: f64,
        /// Why that is not enough.
        reason: String,
    },
    /// No points are left for the object.
    #[error("no object: {reason}")]
    NoObject {
        /// What was removed, or the distance of the seed point from the nearest point.
        reason: String,
    },
    /// A depth image does not have the stated size.
    #[error("{length} depths do not make an image of {width} × {height}")]
    ImageSize {
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
        /// Number of depths.
        length: usize,
    },
    /// A network setting is invalid.
    #[error("{what} is `{value}`, but must be {expected}")]
    BadNetwork {
        /// The setting.
        what: &'static str,
        /// Its value.
        value: String,
        /// What it must be.
        expected: &'static str,
    },
    /// An operation on the network failed.
    #[error("network, {what}: {reason}")]
    Network {
        /// The operation.
        what: &'static str,
        /// The reason.
        reason: String,
    },
    /// A message of a topic cannot be sent or read.
    #[error("{topic}: {error}")]
    OnTopic {
        /// The topic.
        topic: String,
        /// What is wrong with it.
        error: Box<Error>,
    },
    /// An arm cannot be driven, or a camera not read: streams or listeners are missing.
    #[error("{arm}: after {waited:.1} s still missing: {}", listed(streams))]
    StreamsMissing {
        /// The arm.
        arm: String,
        /// Seconds that were waited.
        waited: f64,
        /// Each of them, and why.
        streams: Vec<MissingStream>,
    },
    /// An arm does not move, or stopped before its goal.
    #[error("{arm}: {reason}")]
    ArmStopped {
        /// The arm.
        arm: String,
        /// Why.
        reason: Box<Stop>,
    },
    /// An arm did not do something in time.
    #[error(
        "{arm}: {what} took longer than {waited:.1} s; the arm is {status}{}",
        last_words(said)
    )]
    ArmTimeout {
        /// The arm.
        arm: String,
        /// The operation.
        what: &'static str,
        /// Seconds that were waited.
        waited: f64,
        /// Its state.
        status: ArmStatus,
        /// The last error or warning that it reported, if any.
        said: String,
    },
    /// An arm refuses a command in its present state.
    #[error("{arm} refuses `{command}`: {said}")]
    CommandRefused {
        /// The arm.
        arm: String,
        /// The command.
        command: &'static str,
        /// The reason it gave.
        said: String,
    },
    /// The pose that an arm reports does not agree with its joint values.
    #[error(
        "the pose that the arm reports differs by {:.1} mm and {angle:.3} rad from that of its joint values: check the instrument, the generation of the arm, and the frames",
        1e3 * distance
    )]
    FramesDisagree {
        /// Metres.
        distance: f64,
        /// Radians.
        angle: f64,
    },
    /// The reference frame of an arm is not where the calibration expects it.
    #[error(
        "the base frame of the arm is {:.1} mm and {angle:.3} rad from where the calibration expects it",
        1e3 * distance
    )]
    BaseFrame {
        /// Metres.
        distance: f64,
        /// Radians.
        angle: f64,
    },
}

// Not `#[from]`: the message contains the reason already, so that `source` must not return it again.
impl From<Unreachable> for Error {
    fn from(reason: Unreachable) -> Self {
        Self::Unreachable(reason)
    }
}

fn listed(streams: &[MissingStream]) -> String {
    let each = |stream: &MissingStream| format!("{} ({})", stream.topic, stream.reason);
    streams.iter().map(each).collect::<Vec<_>>().join(", ")
}

fn last_words(said: &str) -> String {
    if said.is_empty() {
        String::new()
    } else {
        format!("; it said: {said}")
    }
}
