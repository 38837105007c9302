//! The content of a session as plain data.

use nalgebra::{Isometry3, Point3, UnitVector3};

use super::skipped::Skipped;
use crate::depth::Scan;
use crate::features::Feature;

/// One arm in one frame.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ArmSample {
    /// Name of the arm, the namespace of its topics: `PSM1`.
    pub name: String,
    /// Pose of its tip in the camera frame, if it was measured around the time of the frame.
    pub pose: Option<Isometry3<f64>>,
    /// Opening of its jaw in radians (0 = closed), if it was measured around the time of the frame.
    pub jaw: Option<f64>,
    /// Commanded jaw angle, radians; only in [scans](super::SessionReader::scans).
    pub jaw_setpoint: Option<f64>,
    /// Its joint values, in the order of [`Joint::ALL`](crate::kinematics::Joint::ALL); only in [scans](super::SessionReader::scans).
    pub joints: Option<[f64; 6]>,
}

/// The data of camera and arms at one time.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Frame {
    /// Time of the cloud in seconds.
    pub stamp: f64,
    /// Pose of the camera in the frame of arms and table, if the camera moves; points and features are in the camera frame at this time.
    pub camera: Option<Isometry3<f64>>,
    /// Valid points of the object, camera frame: without NaN, and without the zeros that depth cameras send for
    /// pixels without depth.
    pub points: Vec<Point3<f64>>,
    /// Red, green and blue of each point, if the cloud has them.
    pub colours: Option<Vec<[u8; 3]>>,
    /// Features of the colour image on the object, if they were recorded around the time of the frame.
    pub features: Option<Vec<Feature>>,
    /// Every arm of the session, in the order of [`Session::arm_names`].
    pub arms: Vec<ArmSample>,
}

/// A scan of everything in view at one time.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordedScan {
    /// Time of the cloud or image in seconds.
    pub stamp: f64,
    /// The scan, camera frame.
    pub scan: Scan,
    /// Every arm of the recording, in the order of [`Scans::arm_names`](super::Scans::arm_names), without poses: a robot gives these in a
    /// frame of its own, and joint values contain the same information.
    pub arms: Vec<ArmSample>,
}

/// Number of messages of a topic.
#[derive(Debug, Clone, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct TopicCount {
    /// The topic.
    pub topic: String,
    /// ROS 2 type of its messages.
    pub type_name: String,
    /// Number of messages.
    pub count: usize,
}

/// A recorded session without its ground truth.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Session {
    /// The frames in the order of time.
    pub frames: Vec<Frame>,
    /// The table: `normal · x + offset ≥ 0` on the free side, camera frame. The first one recorded.
    pub table: Option<(UnitVector3<f64>, f64)>,
    /// Names of the arms, sorted.
    pub arm_names: Vec<String>,
    /// Name of the frame of the clouds.
    pub camera_frame: String,
    /// Every topic of the file, sorted, whether this crate knows it or not.
    pub topics: Vec<TopicCount>,
    /// Whether the recorder closed the file. If not, the session ends where the file does.
    pub complete: bool,
    /// What could not be read, and where.
    pub skipped: Skipped,
}

/// The ground truth of a recorded session.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Truth {
    /// In the order of time.
    pub frames: Vec<TruthFrame>,
    /// What could not be read, and where.
    pub skipped: Skipped,
}

/// The true positions of the material points at one time.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct TruthFrame {
    /// Time in seconds.
    pub stamp: f64,
    /// All material points, always in the same order.
    pub points: Vec<Point3<f64>>,
}
