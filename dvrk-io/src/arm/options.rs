//! Options of an arm.

use derive_setters::Setters;
use std::time::Duration;

use super::profile::ProfileLimits;
use crate::kinematics::{Kinematics, SafetyMargins};
use crate::{Error, Psm};

/// Largest difference between two poses.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Tolerance {
    /// Metres.
    pub length: f64,
    /// Radians.
    pub angle: f64,
}

impl Tolerance {
    pub(crate) fn holds(&self, (distance, angle): (f64, f64)) -> bool {
        distance <= self.length && angle <= self.angle
    }

    fn check(&self) -> Result<(), Error> {
        for value in [self.length, self.angle] {
            if !(value > 0.0 && value.is_finite()) {
                return Err(Error::OutOfRange {
                    what: "tolerance",
                    value,
                    expected: "must be positive and finite",
                });
            }
        }
        Ok(())
    }
}

/// The source of the pose in the frame of the remote centre.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum LocalPose {
    /// `local/measured_cp`, as published by a dVRK: base frames are determined and monitored.
    #[default]
    Published,
    /// The joint values: for arms without that topic. Their reference frame must be the remote centre.
    FromJoints,
}

/// What to do when another client can command the arm too.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum OtherWriters {
    /// Do not move.
    #[default]
    Refuse,
    /// Move: for use with programs that open every topic without publishing.
    Allow,
}

/// Options of an arm; see [`Arm::connect`](super::Arm::connect).
#[derive(Debug, Clone, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct ArmOptions {
    /// Lengths and joint limits. Default: a Classic with a large needle driver.
    pub kinematics: Kinematics,
    /// Limits of straight motions: of the fastest point of the jaws, metres. Default 0.05 m/s, 0.2 m/s², 1 mm a tick.
    pub motion: ProfileLimits,
    /// Limits of the jaw, radians. Default 1.5 rad/s, 10 rad/s², 0.05 rad a tick.
    pub jaw: ProfileLimits,
    /// Angles that the jaw may be commanded to. Default −0.349 to 1.396 rad: large needle driver of an Si.
    pub jaw_range: [f64; 2],
    /// Time between two set-points. Default 10 ms, the rate at which a dVRK publishes.
    pub period: Duration,
    /// Age at which a sample, or a stream, is stale. Default 0.2 s.
    pub stale: Duration,
    /// Largest distance of the set-point from those sent within the last half second. Default 1 mm, 0.02 rad.
    pub divergence: Tolerance,
    /// Largest distance of the arm from its set-point. Default 15 mm, 0.35 rad: a dVRK goes into FAULT at 50 mm, 0.5 rad.
    pub tracking: Tolerance,
    /// Largest disagreement of frames, and largest motion of the base frame during a motion. Default 2 mm, 0.035 rad.
    pub frames: Tolerance,
    /// Distances that goals keep from joint limits. The default is that of [`SafetyMargins`].
    pub margins: SafetyMargins,
    /// Largest motion of a joint in a tick: radians, metres for the insertion. Default 0.1.
    pub joint_step: f64,
    /// The source of the pose in the frame of the remote centre.
    pub local: LocalPose,
    /// What to do when another client can command the arm.
    pub other_writers: OtherWriters,
    /// Name of the console. Default `console`.
    pub console: String,
}

impl Default for ArmOptions {
    fn default() -> Self {
        Self {
            kinematics: Kinematics::new(Psm::Classic),
            motion: ProfileLimits {
                speed: 0.05,
                acceleration: 0.2,
                step: 1e-3,
            },
            jaw: ProfileLimits {
                speed: 1.5,
                acceleration: 10.0,
                step: 0.05,
            },
            jaw_range: [-0.349, 1.396],
            period: Duration::from_millis(10),
            stale: Duration::from_millis(200),
            divergence: Tolerance {
                length: 1e-3,
                angle: 0.02,
            },
            tracking: Tolerance {
                length: 0.015,
                angle: 0.35,
            },
            frames: Tolerance {
                length: 2e-3,
                angle: 0.035,
            },
            margins: SafetyMargins::default(),
            joint_step: 0.1,
            local: LocalPose::default(),
            other_writers: OtherWriters::default(),
            console: "console".to_owned(),
        }
    }
}

impl ArmOptions {
    /// # Errors
    /// [`Error::OutOfRange`]: an invalid value.
    pub(crate) fn check(&self) -> Result<(), Error> {
        self.motion.check()?;
        self.jaw.check()?;
        self.divergence.check()?;
        self.tracking.check()?;
        self.frames.check()?;
        self.margins.check()?;
        let times = [
            ("period", self.period, 1, 100),
            ("stale", self.stale, 10, 10_000),
        ];
        for (what, time, least, most) in times {
            if time < Duration::from_millis(least) || time > Duration::from_millis(most) {
                return Err(Error::OutOfRange {
                    what,
                    value: time.as_secs_f64(),
                    expected: "must be 1 to 100 ms (period), 10 ms to 10 s (stale)",
                });
            }
        }
        let [lower, upper] = self.jaw_range;
        if !(lower <= upper && lower.is_finite() && upper.is_finite()) {
            return Err(Error::OutOfRange {
                what: "range of the jaw",
                value: lower,
                expected: "must be finite, lower ≤ upper",
            });
        }
        if !(self.joint_step > 0.0 && self.joint_step.is_finite()) {
            return Err(Error::OutOfRange {
                what: "joint step",
                value: self.joint_step,
                expected: "must be positive and finite",
            });
        }
        Ok(())
    }
}
