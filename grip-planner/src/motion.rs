//! Motions: the timed paths of the tips.
//!
//! All tips pass their way points together. Between two way points the motion is straight (translation and slerp), and
//! takes the time that the slowest tip needs:
//!
//! ```text
//! Δt = max over arms( |Δp| / v,  Δφ / ω ),     v(σ) = min(v_max, min over corners √(v_c² + 2 a |σ − σ_c|))
//! ```
//!
//! with `σ` the path length of the tip that moves most. The corners are both ends, with `v_c = v_0`, and the way points, with `v_c = v_0 / b`
//! where `b` is the change of a tip's velocity there for each m/s of speed. This avoids jerks at the start, at the
//! end, and at corners of the path.

use std::fmt;

use nalgebra::Isometry3;

use crate::{Grip, Role};

/// The stage of a motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Stage {
    /// The arms move from home to the grips, open the jaws, and move straight in.
    Reach,
    /// First quarter of a turn: the lifted side is raised until the body hangs.
    Lift,
    /// The hanging body is tilted to one side and to the other, to show its ends.
    Tilt,
    /// Second quarter: the body is retracted and laid down on its other side.
    Lower,
    /// The sides of a hole are pulled apart.
    Pull,
    /// The hole is held open.
    Hold,
    /// The hole is closed again by the wanted amount, and set down.
    Ease,
    /// The jaws are open: back along the tools, and home.
    Withdraw,
}

impl fmt::Display for Stage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Reach => "reach",
            Self::Lift => "lift",
            Self::Tilt => "tilt",
            Self::Lower => "lower",
            Self::Pull => "pull",
            Self::Hold => "hold",
            Self::Ease => "ease",
            Self::Withdraw => "withdraw",
        })
    }
}

/// A stage and its end.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Leg {
    /// The stage.
    pub stage: Stage,
    /// Its end, seconds since the motion began.
    pub until: f64,
}

/// A pose at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Keyframe {
    /// Seconds since the motion began.
    pub time: f64,
    /// Pose of the tip.
    pub camera_from_tip: Isometry3<f64>,
}

/// The path of one arm.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ArmPath {
    /// The arm.
    pub arm: usize,
    /// The purpose of its grip.
    pub role: Role,
    /// Poses in order of time; straight in between. The first is the grasp pose.
    pub keyframes: Vec<Keyframe>,
    /// Time at which the jaws open: the end for a lifting arm, earlier for a supporting one, 0 for an empty one.
    pub release: f64,
    /// Pose after the end, once the jaws are open: back along the tool and up.
    pub camera_from_retreat: Isometry3<f64>,
}

impl ArmPath {
    /// Pose of the tip at `time`, constant before the start and after the end.
    pub fn at(&self, time: f64) -> Option<Isometry3<f64>> {
        let after = self.keyframes.partition_point(|k| k.time <= time);
        let (Some(from), to) = (
            self.keyframes.get(after.saturating_sub(1)),
            self.keyframes.get(after),
        ) else {
            return None;
        };
        let Some(to) = to.filter(|_| after > 0) else {
            return Some(from.camera_from_tip);
        };
        let share = (time - from.time) / (to.time - from.time);
        Some(between(&from.camera_from_tip, &to.camera_from_tip, share))
    }

    /// The pose at `time`, and the key frames for which `moved` gives a time after that.
    fn part(&self, time: f64, moved: &dyn Fn(f64) -> Option<f64>) -> Vec<Keyframe> {
        let now = self.at(time).map(|camera_from_tip| Keyframe {
            time: 0.0,
            camera_from_tip,
        });
        let later = self.keyframes.iter().filter_map(|k| {
            let time = moved(k.time)?;
            Some(Keyframe { time, ..*k })
        });
        now.into_iter().chain(later).collect()
    }

    /// Largest speed of the tip, m/s.
    pub fn peak_speed(&self) -> f64 {
        let speed = |w: &[Keyframe]| {
            travelled(&w[0].camera_from_tip, &w[1].camera_from_tip) / (w[1].time - w[0].time)
        };
        self.keyframes
            .windows(2)
            .filter(|w| w[1].time > w[0].time)
            .map(speed)
            .fold(0.0, f64::max)
    }
}

/// A motion of several arms, checked and timed.
///
/// ```
/// use grip_planner::nalgebra::{Isometry3, Vector3};
/// use grip_planner::{ArmPath, Keyframe, Leg, Motion, Role, Stage};
///
/// // Up (−z) by 0.1 m in 5 s, then to the side by 0.2 m in 5 s.
/// let key = |time: f64, x: f64, z: f64| Keyframe {
///     time,
///     camera_from_tip: Isometry3::translation(x, 0.0, z),
/// };
/// let path = ArmPath {
///     arm: 0,
///     role: Role::Lift,
///     keyframes: vec![key(0.0, 0.0, 0.4), key(5.0, 0.0, 0.3), key(10.0, 0.2, 0.3)],
///     release: 10.0,
///     camera_from_retreat: Isometry3::translation(0.2, 0.0, 0.25),
/// };
/// let legs = [(Stage::Lift, 5.0), (Stage::Lower, 10.0)].map(|(stage, until)| Leg { stage, until });
/// let motion = Motion { arms: vec![path], duration: 10.0, legs: legs.to_vec() };
///
/// // It is never faster than 0.04 m/s: with a quarter of that, its time runs four times more slowly.
/// assert!((motion.rate(0.01) - 0.25).abs() < 1e-12);
/// assert_eq!(motion.rate(0.1), 1.0);
///
/// // On from 6 s, when the tip is at x = 0.04, and back from there.
/// let (on, back) = (motion.onward(6.0), motion.back(6.0));
/// let at = |m: &Motion, time: f64| m.arms[0].at(time).unwrap().translation.vector;
/// for m in [&on, &back] {
///     assert!((at(m, 0.0).x - 0.04).abs() < 1e-12);
/// }
/// assert_eq!((on.duration, on.legs.len()), (4.0, 1));
/// assert_eq!(at(&on, 4.0), Vector3::new(0.2, 0.0, 0.3));
/// assert_eq!(back.duration, 6.0);
/// assert!(at(&back, 1.0).x.abs() < 1e-12);
/// assert_eq!(at(&back, 6.0), Vector3::new(0.0, 0.0, 0.4));
/// ```
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Motion {
    /// One path for each arm involved.
    pub arms: Vec<ArmPath>,
    /// Seconds.
    pub duration: f64,
    /// The stages in order of time; the last one ends with the motion.
    pub legs: Vec<Leg>,
}

impl Motion {
    /// Largest speed of any tip, m/s.
    pub fn peak_speed(&self) -> f64 {
        self.arms
            .iter()
            .map(ArmPath::peak_speed)
            .fold(0.0, f64::max)
    }

    /// The rate, seconds a second and at most 1, at which the time of this motion may run such that no tip is faster than `speed` (m/s), for use with a
    /// [`crate::SpeedGovernor`].
    pub fn rate(&self, speed: f64) -> f64 {
        let rate = speed / self.peak_speed();
        // NaN stops the motion.
        if rate.is_nan() {
            return 0.0;
        }
        rate.clamp(0.0, 1.0)
    }

    /// The rest of the motion after `time`.
    #[must_use]
    pub fn onward(&self, time: f64) -> Self {
        let time = time.clamp(0.0, self.duration);
        let left = |path: &ArmPath| ArmPath {
            keyframes: path.part(time, &|k| (k > time).then_some(k - time)),
            release: (path.release - time).max(0.0),
            ..path.clone()
        };
        let leg = |l: &Leg| Leg {
            until: l.until - time,
            ..*l
        };
        Self {
            arms: self.arms.iter().map(left).collect(),
            duration: self.duration - time,
            legs: self
                .legs
                .iter()
                .filter(|l| l.until >= time)
                .map(leg)
                .collect(),
        }
    }

    /// The motion back from `time` to its beginning, at the same speed; jaws open at the end.
    #[must_use]
    pub fn back(&self, time: f64) -> Self {
        let time = time.clamp(0.0, self.duration);
        let returned = |path: &ArmPath| {
            let mut keyframes = path.part(time, &|k| (k < time).then_some(time - k));
            keyframes.sort_by(|a, b| a.time.total_cmp(&b.time));
            ArmPath {
                keyframes,
                release: time,
                ..path.clone()
            }
        };
        let leg = Leg {
            stage: Stage::Lower,
            until: time,
        };
        Self {
            arms: self.arms.iter().map(returned).collect(),
            duration: time,
            legs: vec![leg],
        }
    }

    /// The stage at `time`.
    pub fn stage_at(&self, time: f64) -> Stage {
        let later = self.legs.iter().find(|l| time <= l.until);
        later.or(self.legs.last()).map_or(Stage::Reach, |l| l.stage)
    }
}

/// The same motion for every arm: way points passed at common times.
pub(crate) fn assemble(
    grips: &[Grip],
    paths: &[Vec<Isometry3<f64>>],
    times: &[f64],
    legs: Vec<Leg>,
) -> Motion {
    let duration = times.last().copied().unwrap_or(0.0);
    let arm = |(grip, path): (&Grip, &Vec<Isometry3<f64>>)| ArmPath {
        arm: grip.arm,
        role: grip.role,
        keyframes: times
            .iter()
            .zip(path)
            .map(|(&time, &camera_from_tip)| Keyframe {
                time,
                camera_from_tip,
            })
            .collect(),
        release: duration,
        camera_from_retreat: grip.camera_from_retreat,
    };
    Motion {
        arms: grips.iter().zip(paths).map(arm).collect(),
        duration,
        legs,
    }
}

/// The pose `share` of the way from `a` to `b`.
pub(crate) fn between(a: &Isometry3<f64>, b: &Isometry3<f64>, share: f64) -> Isometry3<f64> {
    // The slerp of opposite rotations is undefined; then the rotation happens at the middle.
    a.try_lerp_slerp(b, share, 1e-9)
        .unwrap_or(if share < 0.5 { *a } else { *b })
}

pub(crate) fn travelled(a: &Isometry3<f64>, b: &Isometry3<f64>) -> f64 {
    (b.translation.vector - a.translation.vector).norm()
}

/// Limits of speed along the way points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Pace {
    /// m/s.
    pub speed: f64,
    /// m/s².
    pub acceleration: f64,
    /// rad/s.
    pub turn_rate: f64,
}

/// Speed at the start and the end, as a share of the full speed: at zero the motion would never begin.
const CREEP: f64 = 0.1;

/// A point of the path where the tips must be slow: metres from the start, m/s.
struct Corner {
    at: f64,
    speed: f64,
}

/// Times at which the way points are passed; `paths` all have the same number of them.
pub(crate) fn times(paths: &[Vec<Isometry3<f64>>], pace: &Pace) -> Vec<f64> {
    let count = paths.first().map_or(0, Vec::len);
    let step = |k: usize| {
        let moved = paths
            .iter()
            .map(|p| travelled(&p[k], &p[k + 1]))
            .fold(0.0, f64::max);
        let turned = paths
            .iter()
            .map(|p| p[k].rotation.angle_to(&p[k + 1].rotation))
            .fold(0.0, f64::max);
        (moved, turned)
    };
    let steps: Vec<(f64, f64)> = (0..count.saturating_sub(1)).map(step).collect();
    let corners = corners(paths, &steps, CREEP * pace.speed);
    let allowed = |at: f64| {
        let ramp =
            |c: &Corner| (c.speed * c.speed + 2.0 * pace.acceleration * (at - c.at).abs()).sqrt();
        corners.iter().map(ramp).fold(pace.speed, f64::min)
    };
    let (mut gone, mut time) = (0.0, 0.0);
    let mut times = vec![0.0; count.min(1)];
    for (moved, turned) in steps {
        let speed = allowed(gone + 0.5 * moved);
        time += (moved / speed).max(turned / pace.turn_rate);
        gone += moved;
        times.push(time);
    }
    times
}

/// The ends of the path, and every way point at which the velocity of a tip would change by more than the creep at full speed.
fn corners(paths: &[Vec<Isometry3<f64>>], steps: &[(f64, f64)], creep: f64) -> Vec<Corner> {
    let whole: f64 = steps.iter().map(|s| s.0).sum();
    let mut corners = vec![
        Corner {
            at: 0.0,
            speed: creep,
        },
        Corner {
            at: whole,
            speed: creep,
        },
    ];
    // Path length of a tip for each metre of the fastest tip.
    let course = |path: &[Isometry3<f64>], k: usize| {
        let way = path[k + 1].translation.vector - path[k].translation.vector;
        if steps[k].0 > 0.0 {
            way / steps[k].0
        } else {
            way
        }
    };
    let mut gone = 0.0;
    for k in 1..steps.len() {
        gone += steps[k - 1].0;
        let bend = |path: &Vec<Isometry3<f64>>| (course(path, k) - course(path, k - 1)).norm();
        let bend = paths.iter().map(bend).fold(0.0, f64::max);
        if bend > 0.0 {
            let speed = creep / bend;
            corners.push(Corner { at: gone, speed });
        }
    }
    corners
}
