//! The one trait between the loop and a world.
//!
//! A [`Cell`] is a fixed depth camera, a table and a few arms. The loop sees nothing else: what it knows of
//! the object it knows from [`Observation`]s. The simulated cell ([`sim`]), a recorded session
//! ([`replay`]) and a dVRK implement the trait; a user's own robot is one more `impl`.
//!
//! All poses and points are in the camera frame: +z along the optical axis, away from the camera, metres.
//! A tip frame has its origin midway between the jaws, +z along the approach (from the wrist to the
//! object) and ±y along the direction in which the jaws open.

use nalgebra::{Isometry3, Point3, UnitVector3};

pub mod faults;
pub mod mesh_io;
pub mod replay;
pub mod sim;

/// The plane `normal · x + offset = 0`; `normal` points to the free side, so that everything real has
/// `normal · x + offset ≥ 0`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    /// Unit normal, toward the free side.
    pub normal: UnitVector3<f64>,
    /// Offset in metres.
    pub offset: f64,
}

impl Plane {
    /// Signed height of `point` above the plane, in metres.
    pub fn height(&self, point: &Point3<f64>) -> f64 {
        self.normal.dot(&point.coords) + self.offset
    }
}

/// What the loop may know of an arm before it moves.
#[derive(Debug, Clone, PartialEq)]
pub struct ArmInfo {
    /// The arm's name, `PSM1` and so on: the name space of its topics.
    pub name: String,
    /// Where the tip waits without hiding the object from the camera.
    pub camera_from_home: Isometry3<f64>,
    /// The foot of the arm: which side of the table it comes from (camera frame).
    pub base: Point3<f64>,
    /// Farthest distance of the tip from `base`, metres.
    pub reach: f64,
    /// Half the width of what fits between the open jaws, metres.
    pub jaw_radius: f64,
    /// The fastest the tip may go, m/s.
    pub max_speed: f64,
}

/// What is fixed in a cell.
#[derive(Debug, Clone, PartialEq)]
pub struct CellInfo {
    /// The arms, in the order of [`Observation::arms`].
    pub arms: Vec<ArmInfo>,
    /// The table the object lies on.
    pub table: Plane,
    /// Frames a second.
    pub camera_rate: f64,
}

/// An arm as it was when a frame was taken.
#[derive(Debug, Clone, PartialEq)]
pub struct ArmState {
    /// Pose of the tip.
    pub camera_from_tip: Isometry3<f64>,
    /// Jaw angle in radians: 0 is closed on the object or on itself.
    pub jaw: f64,
    /// Whether the jaw holds something, as far as the arm can tell (jaw torque, stall).
    pub holding: bool,
    /// Whether the last commanded pose is still being approached.
    pub moving: bool,
}

/// One frame: what the camera saw of the object (table and arms already removed), and where the arms were.
#[derive(Debug, Clone, PartialEq)]
pub struct Observation {
    /// Time of the frame, seconds since the cell started.
    pub stamp: f64,
    /// Points on the visible surface of the object, unordered.
    pub points: Vec<Point3<f64>>,
    /// The arms, in the order of [`CellInfo::arms`].
    pub arms: Vec<ArmState>,
}

/// Why a cell could not do what it was asked.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CellError {
    /// The jaw closed and there was nothing in it.
    #[error("arm {arm}: the jaw closed on nothing")]
    NothingGrasped {
        /// Index of the arm.
        arm: usize,
    },
    /// There is no such arm.
    #[error("there is no arm {arm}: the cell has {count}")]
    NoSuchArm {
        /// Index asked for.
        arm: usize,
        /// Number of arms.
        count: usize,
    },
    /// The pose or speed cannot be commanded.
    #[error("arm {arm}: {reason}")]
    BadCommand {
        /// Index of the arm.
        arm: usize,
        /// What is wrong with the command.
        reason: String,
    },
    /// The arm does not take commands: a fault state, an emergency stop.
    #[error("arm {arm} is in a fault state: {reason}")]
    ArmFault {
        /// Index of the arm.
        arm: usize,
        /// What it says.
        reason: String,
    },
    /// The world behind the cell failed.
    #[error("the cell failed: {0}")]
    Failed(String),
    /// A recording has no next frame.
    #[error("the recording ended")]
    Ended,
    /// This world cannot be moved (a recording).
    #[error("a recorded session cannot be commanded")]
    ReadOnly,
}

/// A world the loop can look at and act in.
pub trait Cell {
    /// What is fixed.
    fn info(&self) -> &CellInfo;

    /// Waits for the next frame and returns it; time passes (commanded motions go on).
    ///
    /// # Errors
    /// [`CellError::Ended`] when a recording is over, [`CellError::Failed`] when the world breaks.
    fn observe(&mut self) -> Result<Observation, CellError>;

    /// Starts a straight motion of the tip (translation and slerp) at `speed` m/s and returns at once.
    ///
    /// # Errors
    /// Unknown arm, non-finite pose, speed not positive.
    fn move_arm(
        &mut self,
        arm: usize,
        camera_from_tip: Isometry3<f64>,
        speed: f64,
    ) -> Result<(), CellError>;

    /// Closes a jaw on what is between its fingers.
    ///
    /// # Errors
    /// [`CellError::NothingGrasped`] when it closed on nothing; the jaw is open again then.
    fn close_jaw(&mut self, arm: usize) -> Result<(), CellError>;

    /// Opens a jaw and lets go.
    ///
    /// # Errors
    /// Unknown arm.
    fn open_jaw(&mut self, arm: usize) -> Result<(), CellError>;

    /// Sends every arm home, out of the camera's view, and returns when they are there.
    ///
    /// # Errors
    /// The world breaks.
    fn home(&mut self) -> Result<(), CellError>;

    /// Stops every motion where it is.
    ///
    /// # Errors
    /// The world breaks.
    fn stop(&mut self) -> Result<(), CellError>;
}
