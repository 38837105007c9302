//! Motions from the present poses of the tips, for situations that no plan contains.
//!
//! ```text
//! carry      here ─► goal                  holding; the body moves with the tips
//! put_down   here ─► start or end          along a motion that is given up: back if it was lifting, on if it was lowering
//! lower      here ─► release height        straight down, if that motion cannot be used
//! go_home    here ─► retreat ─► home       empty; straight, over, or one arm after the other
//! ```
//!
//! A plan begins and ends with its arms at home. After an interruption they may be anywhere, so these motions begin
//! anywhere, with the same checks and the same timing. The table is approached along its normal, so that nothing is dragged along it.

use derive_setters::Setters;
use nalgebra::{Isometry3, Point3, Translation3};

use crate::body::Body;
use crate::check::{Carried, Surroundings};
use crate::motion::{assemble, times};
use crate::reach::{dense, withdraw_from};
use crate::scene::{not_negative, positive};
use crate::{Error, Grip, Leg, Motion, ReachOptions, Refusal, Role, Scene, Stage};

/// A tool at its present pose.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Tip {
    /// The arm.
    pub arm: usize,
    /// The purpose of its grip.
    pub role: Role,
    /// Its pose.
    pub camera_from_tip: Isometry3<f64>,
}

/// Options of motions that no plan contains.
#[derive(Debug, Clone, Copy, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct CarryOptions {
    /// Largest speed of a tip, m/s; an arm's own limit counts too. Default 0.02.
    pub speed: f64,
    /// Acceleration and deceleration, m/s². Default 0.05.
    pub acceleration: f64,
    /// Largest rotation rate of a tip, rad/s. Default 1.
    pub turn_rate: f64,
    /// Height of the tips above the table at which [`lower`] ends, metres. Default 0.012.
    pub release_height: f64,
}

impl Default for CarryOptions {
    fn default() -> Self {
        Self {
            speed: 0.02,
            acceleration: 0.05,
            turn_rate: 1.0,
            release_height: 0.012,
        }
    }
}

impl CarryOptions {
    fn check(&self) -> Result<(), Error> {
        positive("carry speed", self.speed)?;
        positive("carry acceleration", self.acceleration)?;
        positive("carry turn_rate", self.turn_rate)?;
        not_negative("release_height", self.release_height)
    }

    fn pace(&self) -> ReachOptions {
        ReachOptions {
            speed: self.speed,
            acceleration: self.acceleration,
            turn_rate: self.turn_rate,
        }
    }
}

/// Straight from the present poses of the holding tips to `goals`, all together; `body` are the points that move with them, empty if
/// unknown.
///
/// # Errors
/// Why it is not feasible: which arm leaves its workspace, or collides with the table, another tool or the body, and when. Invalid input, or
/// not one goal for each tip.
///
/// # Complexity
/// `O(n log n)` for the obstacle of `n` points, `O(log n)` for each of about a hundred way points.
///
/// ```
/// use grip_planner::nalgebra::{Isometry3, Point3, Vector3};
/// use grip_planner::{Arm, CarryOptions, Plane, Role, Scene, Tip, Workspace, carry};
/// let base = Point3::new(0.3, 0.0, 0.3);
/// let workspace = Workspace::Ball { center: base, radius: 0.6 };
/// let arms = [Arm { base, workspace, home: Isometry3::translation(0.3, 0.0, 0.3), max_speed: 0.1 }];
/// let table = Plane { normal: -Vector3::z_axis(), offset: 0.5 };
/// let scene = Scene { table, arms: &arms, camera: Point3::origin(), jaw_radius: 0.005, shaft_length: 0.05, jaw_separation: 0.02, clearance: 0.003 };
/// let tip = Tip { arm: 0, role: Role::Lift, camera_from_tip: Isometry3::translation(0.0, 0.0, 0.4) };
/// let motion = carry(&[], &scene, &[tip], &[Isometry3::translation(0.05, 0.0, 0.45)], &CarryOptions::default())?;
/// assert!(motion.peak_speed() <= 0.02 + 1e-12);
/// // Moving through the table is rejected.
/// assert!(carry(&[], &scene, &[tip], &[Isometry3::translation(0.0, 0.0, 0.6)], &CarryOptions::default()).is_err());
/// # Ok::<(), grip_planner::Refusal>(())
/// ```
pub fn carry(
    body: &[Point3<f64>],
    scene: &Scene,
    tips: &[Tip],
    goals: &[Isometry3<f64>],
    options: &CarryOptions,
) -> Result<Motion, Refusal> {
    options.check()?;
    let grips = checked(body, scene, tips)?;
    if goals.len() != tips.len() {
        let (what, count) = ("goals", goals.len());
        let points = tips.len();
        return Err(Error::LengthMismatch {
            what,
            count,
            points,
        }
        .into());
    }
    if let Some(k) = goals.iter().position(|g| !finite(g)) {
        let (arm, what) = (tips[k].arm, "its goal");
        return Err(Error::BadArm { arm, what }.into());
    }
    let stations: Vec<Vec<Isometry3<f64>>> = tips
        .iter()
        .zip(goals)
        .map(|(tip, goal)| vec![tip.camera_from_tip, *goal])
        .collect();
    let paths = dense(&stations);
    let times = times(&paths, &options.pace().pace(&grips, scene));
    let until = times.last().copied().unwrap_or(0.0);
    let stage = Stage::Lower;
    let motion = assemble(&grips, &paths, &times, vec![Leg { stage, until }]);
    let obstacle = Body::new(body, scene.tool_radius());
    let carried = Carried::Turned {
        turned: &[],
        leaving: 0.0,
    };
    Surroundings::new(scene, &obstacle).check(&motion, &carried)?;
    Ok(motion)
}

/// The path down along a motion that is given up at `time`: back to its beginning if it was lifting or pulling, on to its end if it was lowering or easing. The body
/// is then where it was, or where it was to be. A supporting arm that has already released is left out and stays where it is.
///
/// # Errors
/// An arm that stays is in the way of the others; invalid input.
///
/// # Complexity
/// Linear in the number of way points.
///
/// ```
/// use grip_planner::nalgebra::{Isometry3, Point3, Vector3};
/// use grip_planner::{ArmPath, Keyframe, Leg, Motion, Role, Stage, put_down};
/// # use grip_planner::{Arm, Plane, Scene, Workspace};
/// # let base = Point3::new(0.3, 0.0, 0.3);
/// # let workspace = Workspace::Ball { center: base, radius: 0.6 };
/// # let arms = [Arm { base, workspace, home: Isometry3::translation(0.3, 0.0, 0.3), max_speed: 0.1 }];
/// # let table = Plane { normal: -Vector3::z_axis(), offset: 0.5 };
/// # let scene = Scene { table, arms: &arms, camera: Point3::origin(), jaw_radius: 0.005, shaft_length: 0.05, jaw_separation: 0.02, clearance: 0.003 };
///
/// // Lifts for 5 s, and lowers 0.1 m farther along for 5 s.
/// let key = |time: f64, x: f64, z: f64| Keyframe {
///     time,
///     camera_from_tip: Isometry3::translation(x, 0.0, z),
/// };
/// let path = ArmPath {
///     arm: 0,
///     role: Role::Lift,
///     keyframes: vec![key(0.0, 0.0, 0.45), key(5.0, 0.0, 0.35), key(10.0, 0.1, 0.45)],
///     release: 10.0,
///     camera_from_retreat: Isometry3::translation(0.1, 0.0, 0.4),
/// };
/// let legs = [(Stage::Lift, 5.0), (Stage::Lower, 10.0)].map(|(stage, until)| Leg { stage, until });
/// let motion = Motion { arms: vec![path], duration: 10.0, legs: legs.to_vec() };
///
/// let end = |m: &Motion| m.arms[0].at(m.duration).unwrap().translation.vector;
/// // Given up while it lifts, it goes back; while it lowers, on.
/// let down = put_down(&scene, &motion, 2.0)?;
/// assert_eq!((down.duration, end(&down)), (2.0, Vector3::new(0.0, 0.0, 0.45)));
/// let down = put_down(&scene, &motion, 7.0)?;
/// assert_eq!((down.duration, end(&down)), (3.0, Vector3::new(0.1, 0.0, 0.45)));
/// # Ok::<(), grip_planner::Refusal>(())
/// ```
pub fn put_down(scene: &Scene, motion: &Motion, time: f64) -> Result<Motion, Refusal> {
    scene.check()?;
    not_negative("time", time)?;
    if let Some(path) = motion.arms.iter().find(|p| p.arm >= scene.arms.len()) {
        let (arm, what) = (path.arm, "its number: there is no such arm");
        return Err(Error::BadArm { arm, what }.into());
    }
    let mut down = match motion.stage_at(time) {
        Stage::Lower | Stage::Ease | Stage::Withdraw => motion.onward(time),
        Stage::Reach | Stage::Lift | Stage::Tilt | Stage::Pull | Stage::Hold => motion.back(time),
    };
    let stays = |arm: usize| {
        let of = motion.arms.iter().find(|p| p.arm == arm);
        of.is_some_and(|p| p.role == Role::Support && p.release <= time)
    };
    for path in down.arms.iter_mut().filter(|p| stays(p.arm)) {
        let here = path.keyframes.first().map(|k| k.camera_from_tip);
        for key in &mut path.keyframes {
            key.camera_from_tip = here.unwrap_or(key.camera_from_tip);
        }
    }
    let obstacle = Body::new(&[], scene.tool_radius());
    let carried = Carried::Turned {
        turned: &[],
        leaving: 0.0,
    };
    Surroundings::new(scene, &obstacle).check(&down, &carried)?;
    down.arms.retain(|p| !stays(p.arm));
    Ok(down)
}

/// Straight down from the present poses of the holding tips, all by the distance of the lowest from the release height; collisions with the body are not checked,
/// as it hangs below them and gives way.
///
/// A tip that is already lower keeps its height.
///
/// # Errors
/// As [`carry`].
///
/// # Complexity
/// As [`carry`].
pub fn lower(scene: &Scene, tips: &[Tip], options: &CarryOptions) -> Result<Motion, Refusal> {
    let height = |tip: &Tip| {
        scene
            .table
            .height(&Point3::from(tip.camera_from_tip.translation.vector))
    };
    let down = |tip: &Tip| {
        let way = (height(tip) - options.release_height).max(0.0);
        Translation3::from(scene.table.normal.as_ref() * -way) * tip.camera_from_tip
    };
    let goals: Vec<_> = tips.iter().map(down).collect();
    carry(&[], scene, tips, &goals, options)
}

/// From the present poses of the empty tips to home, jaws open: back along the tool (straight up, or home at once, if it cannot back off), up and home; `body` are the points at rest, empty if
/// unknown. `distance` is how far a tip retreats before it rotates, metres.
///
/// # Errors
/// As [`carry`].
///
/// # Complexity
/// As [`carry`].
pub fn go_home(
    body: &[Point3<f64>],
    scene: &Scene,
    tips: &[Tip],
    distance: f64,
    options: &ReachOptions,
) -> Result<Motion, Refusal> {
    options.check()?;
    positive("distance", distance)?;
    let grips = checked(body, scene, tips)?;
    let obstacle = Body::new(body, scene.tool_radius());
    let around = Surroundings::new(scene, &obstacle);
    withdraw_from(&around, &grips, distance, options)
}

/// The tips as grips at their present poses.
fn checked(body: &[Point3<f64>], scene: &Scene, tips: &[Tip]) -> Result<Vec<Grip>, Error> {
    scene.check()?;
    if let Some((index, p)) = body
        .iter()
        .enumerate()
        .find(|(_, p)| !p.iter().all(|x| x.is_finite()))
    {
        let point = (*p).into();
        return Err(Error::NonFinitePoint { index, point });
    }
    let mut taken = vec![false; scene.arms.len()];
    for tip in tips {
        let arm = tip.arm;
        let what = match taken.get_mut(arm) {
            None => "its number: there is no such arm",
            Some(true) => "its number: it is given twice",
            Some(_) if !finite(&tip.camera_from_tip) => "where it is",
            Some(taken) => {
                *taken = true;
                continue;
            }
        };
        return Err(Error::BadArm { arm, what });
    }
    let grip = |tip: &Tip| Grip {
        arm: tip.arm,
        vertex: 0,
        role: tip.role,
        camera_from_tip: tip.camera_from_tip,
        camera_from_approach: tip.camera_from_tip,
        camera_from_retreat: tip.camera_from_tip,
    };
    Ok(tips.iter().map(grip).collect())
}

fn finite(pose: &Isometry3<f64>) -> bool {
    pose.to_homogeneous().iter().all(|x| x.is_finite())
}
