//! The trait between the loop and a world, real, simulated or recorded.
//!
//! A [`Cell`] is a depth camera, a table and a few arms. The loop knows the object only from
//! [`Observation`]s. The simulated cell ([`sim`]), a recorded session ([`replay`]) and a dVRK implement the trait; a user's own
//! robot is one more `impl`.
//!
//! All poses and points are in the camera frame: +z along the optical axis, away from the camera, metres.
//! A moving camera reports its pose in every frame ([`Observation::camera`]); poses and points are then in one fixed frame, the camera frame at
//! some chosen moment.
//! A tip frame has its origin midway between the jaws, +z along the approach (from the wrist to the
//! object) and ±y along the direction in which the jaws open.
//!
//! # The contract
//! What a [`Cell`] guarantees, and what the loop does if it does not; the example `own_robot` is a cell written from this list.
//!
//! - **A grip transmits translation and rotation.** While [`ArmState::holding`] is true the patch between the jaws, some 10 mm around
//!   the tip, moves rigidly with the tip frame. If the object is soft, it deforms; a rigid object moves with the tip, and where two arms, or an arm
//!   and the table, constrain each other, the *arms* are held back.
//! - **The pose of an arm is where its tip is**, not where it was commanded. An arm that is held back reports the pose it reached; a jaw that has lost its
//!   grip reports `holding: false`. An unreported slip pulls the model with a force of many times the weight of the object: such frames are reported as
//!   failures and skipped (above 5 weights; grips that carry a body pull with at most 2.4).
//! - **A speed is that of the fastest point of the jaws.** A motion of length `d` and angle `θ` takes `max(d, 0.02 m · θ) / speed`: fingers are assumed to
//!   be 20 mm long, so that a pure rotation at 0.02 m/s has 1 rad/s.
//! - **A cloud is dense.** Where the surface faces the camera there is a point at least every half spacing of the model (2.5 mm for 5 mm), so at least 4
//!   for each square of the spacing; more are thinned, fewer leave gaps that count as never seen. It shows only the object. A frame needs at least 20 points.
//! - **Between two frames the surface moves by at most ξ = 15 mm** (95 % of it; 3 spacings, [`limits`](crate::reconstruct::ReconstructOptions)). A frame with
//!   more motion is reported as a failure in [`FrameReport::failure`](crate::reconstruct::FrameReport) and leaves the model unchanged; each skipped frame allows
//!   the next one ξ more. In the twelve frames after all jaws opened the object may fall by 100 mm in each frame.
//! - **Time passes only in [`Cell::observe`] and [`Cell::home`]**, as far as the loop can tell: commanded motions continue there.

use std::borrow::Cow;
use std::fmt;
use std::path::PathBuf;
use std::sync::Arc;

use dvrk_io::features::Feature;
pub use grip_planner::Plane;
use nalgebra::{Isometry3, Point3};

#[cfg(feature = "dvrk")]
pub mod dvrk;
pub mod faults;
mod noise;
pub mod replay;
mod scans;
mod see;
#[cfg(feature = "sim")]
pub mod sim;

/// The set of poses a tip can reach (camera frame), by joint limits and the like, which a maximal distance cannot express. Equal only to its clones.
#[derive(Clone)]
pub struct Poses(grip_planner::PoseTest);

impl Poses {
    /// The poses that pass a test.
    pub fn new(test: impl Fn(&Isometry3<f64>) -> bool + Send + Sync + 'static) -> Self {
        Self(Arc::new(test))
    }

    /// Whether the tip can be at `camera_from_tip`.
    pub fn contains(&self, camera_from_tip: &Isometry3<f64>) -> bool {
        (self.0)(camera_from_tip)
    }
}

impl fmt::Debug for Poses {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Poses(..)")
    }
}

impl PartialEq for Poses {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

/// What the loop knows about an arm in advance.
#[derive(Debug, Clone, PartialEq)]
pub struct ArmInfo {
    /// The arm's name, `PSM1` and so on: the name space of its topics.
    pub name: String,
    /// Pose in which the tip waits without hiding the object from the camera.
    pub camera_from_home: Isometry3<f64>,
    /// The base of the arm: the side of the table it comes from (camera frame).
    pub base: Point3<f64>,
    /// Farthest distance of the tip from `base`, metres.
    pub reach: f64,
    /// Which poses the tip can have within that reach; `None`: all.
    pub poses: Option<Poses>,
    /// Half the width that fits between the open jaws, metres.
    pub jaw_radius: f64,
    /// Largest speed of the tip, m/s.
    pub max_speed: f64,
}

/// The fixed properties of a cell.
#[derive(Debug, Clone, PartialEq)]
pub struct CellInfo {
    /// The arms, in the order of [`Observation::arms`].
    pub arms: Vec<ArmInfo>,
    /// The table the object lies on.
    pub table: Plane,
    /// Frames each second.
    pub camera_rate: f64,
}

/// The state of an arm at the time of a frame.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct ArmState {
    /// Actual pose of the tip, also where something holds it back from the commanded pose.
    pub camera_from_tip: Isometry3<f64>,
    /// Jaw angle in radians: 0 when closed.
    pub jaw: f64,
    /// Whether the jaw holds something, as far as the arm can tell (jaw torque, stall). What it holds moves rigidly with the tip.
    pub holding: bool,
    /// Whether the last commanded pose is still being approached.
    pub moving: bool,
}

/// One frame: the observed points of the object (table and arms already removed), and the states of the arms.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Observation {
    /// Time of the frame, seconds since the cell started.
    pub stamp: f64,
    /// Pose of the camera in the frame of all positions, if the camera moves; `None` if it does not, and that frame is its own.
    pub camera: Option<Isometry3<f64>>,
    /// Points on the visible surface of the object, unordered, at least one every half spacing of the model.
    pub points: Vec<Point3<f64>>,
    /// Red, green and blue of each point, if the camera has colours. Ignored if it has another length than the points.
    pub colours: Option<Vec<[u8; 3]>>,
    /// Features of the colour image on the object, if the camera has one: points that can be recognised in the next frame.
    pub features: Option<Vec<Feature>>,
    /// The arms, in the order of [`CellInfo::arms`].
    pub arms: Vec<ArmState>,
}

impl Observation {
    /// Pose of the camera: the identity if it does not move.
    pub fn fixed_from_camera(&self) -> Isometry3<f64> {
        self.camera.unwrap_or_else(Isometry3::identity)
    }

    /// Position of the camera.
    pub fn eye(&self) -> Point3<f64> {
        self.fixed_from_camera().translation.vector.into()
    }

    /// The same observation with points and features in the camera's own frame, as measured.
    pub fn measured(&self) -> Cow<'_, Self> {
        let Some(fixed_from_camera) = &self.camera else {
            return Cow::Borrowed(self);
        };
        let camera_from_fixed = fixed_from_camera.inverse();
        Cow::Owned(self.carried(&camera_from_fixed))
    }

    /// The same observation with points and features moved by a rigid motion.
    pub(crate) fn carried(&self, motion: &Isometry3<f64>) -> Self {
        let mut moved = self.clone();
        for point in &mut moved.points {
            *point = motion * *point;
        }
        for feature in moved.features.iter_mut().flatten() {
            feature.point = motion * feature.point;
        }
        moved
    }

    /// The colours of the points, if each has one.
    pub fn colours(&self) -> Option<&[[u8; 3]]> {
        let colours = self.colours.as_deref();
        colours.filter(|colours| colours.len() == self.points.len())
    }

    /// Keeps the points for which `keep` is true, with their colours, and the features.
    pub fn retain(&mut self, keep: impl Fn(&Point3<f64>) -> bool) {
        if let Some(colours) = self.colours.take().filter(|c| c.len() == self.points.len()) {
            let both = colours.into_iter().zip(&self.points);
            self.colours = Some(both.filter(|(_, p)| keep(p)).map(|(c, _)| c).collect());
        }
        if let Some(features) = &mut self.features {
            features.retain(|f| keep(&f.point));
        }
        self.points.retain(keep);
    }
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
        /// What it reports.
        reason: String,
    },
    /// The world behind the cell failed.
    #[error("the cell failed: {0}")]
    Failed(String),
    /// A file has invalid content.
    #[error("{}:{line}: {reason}", path.display())]
    BadFile {
        /// The file.
        path: PathBuf,
        /// Its line; 0 for the file as a whole.
        line: usize,
        /// What is wrong.
        reason: String,
    },
    /// A recording has no next frame.
    #[error("the recording ended")]
    Ended,
    /// This world cannot be moved (a recording).
    #[error("a recorded session cannot be commanded")]
    ReadOnly,
}

/// A world the loop can look at and act in.
pub trait Cell {
    /// The fixed properties.
    fn info(&self) -> &CellInfo;

    /// Waits for the next frame and returns it; time passes and commanded motions continue.
    ///
    /// # Errors
    /// [`CellError::Ended`] when a recording is over, [`CellError::Failed`] when the world fails.
    fn observe(&mut self) -> Result<Observation, CellError>;

    /// Starts a straight motion of the tip (translation and slerp) at `speed` m/s and returns at once. A motion of length `d` and angle
    /// `θ` takes `max(d, 0.02 m · θ) / speed`; a new command replaces the one under way.
    ///
    /// # Errors
    /// Unknown arm, non-finite pose, speed not positive.
    fn move_arm(
        &mut self,
        arm: usize,
        camera_from_tip: Isometry3<f64>,
        speed: f64,
    ) -> Result<(), CellError>;

    /// Closes a jaw on what is between its fingers, which then moves rigidly with the tip.
    ///
    /// # Errors
    /// [`CellError::NothingGrasped`] when it closed on nothing; the jaw is open again then.
    fn close_jaw(&mut self, arm: usize) -> Result<(), CellError>;

    /// Opens a jaw and releases what it holds.
    ///
    /// # Errors
    /// Unknown arm.
    fn open_jaw(&mut self, arm: usize) -> Result<(), CellError>;

    /// Sends every arm home, out of the camera's view, and returns when all have arrived.
    ///
    /// # Errors
    /// The world fails.
    fn home(&mut self) -> Result<(), CellError>;

    /// Stops every motion at its present position.
    ///
    /// # Errors
    /// The world fails.
    fn stop(&mut self) -> Result<(), CellError>;
}
