//! Why a motion ended.

use std::fmt;

use super::state::ArmStatus;
use crate::kinematics::Unreachable;

/// Why a motion ended: at its goal, or why not.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[non_exhaustive]
pub enum Stop {
    /// The set-point of the arm is at the goal.
    Arrived,
    /// [`Arm::hold`](super::Arm::hold) was called.
    Held,
    /// The arm is in a state in which it does not move.
    NotReady {
        /// That state.
        status: ArmStatus,
        /// The last error that it reported, if any.
        said: String,
    },
    /// The arm is guided by hand.
    Clutched,
    /// A stream has become silent.
    Stale {
        /// Its topic.
        topic: String,
        /// Seconds since its last sample.
        age: f64,
    },
    /// The set-point of the arm is not the one sent: the goal was clipped or dropped, or another client commands.
    Diverged {
        /// Metres between set-point and goal.
        distance: f64,
        /// Radians between them.
        angle: f64,
    },
    /// The set-point of the jaw is not the one sent.
    JawDiverged {
        /// Radians between set-point and goal.
        angle: f64,
    },
    /// The arm does not follow its set-point: something obstructs it.
    Blocked {
        /// Metres between measured pose and set-point.
        distance: f64,
        /// Radians between them.
        angle: f64,
    },
    /// The reference frame moved relative to the remote centre.
    BaseMoved {
        /// Metres.
        distance: f64,
        /// Radians.
        angle: f64,
    },
    /// Another client can command the arm.
    OtherWriter {
        /// The topic on which.
        topic: String,
    },
    /// Teleoperation is enabled at the console.
    Teleoperation,
    /// The arm reported an error.
    Said(String),
    /// A trajectory was rejected, or ended elsewhere.
    NotReached {
        /// The message of the arm, if any.
        said: String,
    },
    /// The next pose cannot be reached.
    Unreachable(Unreachable),
    /// A joint would have to jump.
    JointJump {
        /// Radians, or metres for the insertion, in one tick.
        by: f64,
    },
}

impl Stop {
    /// Whether the arm should be told to hold: not if another client controls it, nor if it is not enabled.
    pub(crate) fn holds(&self) -> bool {
        !matches!(
            self,
            Self::Arrived
                | Self::NotReady { .. }
                | Self::Clutched
                | Self::OtherWriter { .. }
                | Self::Teleoperation
        )
    }
}

fn said(f: &mut fmt::Formatter<'_>, text: &str) -> fmt::Result {
    if text.is_empty() {
        Ok(())
    } else {
        write!(f, "; it said: {text}")
    }
}

impl fmt::Display for Stop {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let apart = |f: &mut fmt::Formatter<'_>, distance: f64, angle: f64| {
            write!(f, "{:.1} mm and {angle:.3} rad", 1e3 * distance)
        };
        match self {
            Self::Arrived => f.write_str("arrived"),
            Self::Held => f.write_str("held"),
            Self::NotReady { status, said: text } => {
                write!(f, "the arm is {status}")?;
                said(f, text)
            }
            Self::Clutched => f.write_str("the arm is guided by hand"),
            Self::Stale { topic, age } => write!(f, "{topic} has been silent for {age:.2} s"),
            Self::Diverged { distance, angle } => {
                f.write_str("the set-point differs from the one sent by ")?;
                apart(f, *distance, *angle)
            }
            Self::JawDiverged { angle } => write!(
                f,
                "the set-point of the jaw differs from the one sent by {angle:.3} rad"
            ),
            Self::Blocked { distance, angle } => {
                f.write_str("the arm lags behind its set-point by ")?;
                apart(f, *distance, *angle)
            }
            Self::BaseMoved { distance, angle } => {
                f.write_str("the base frame moved by ")?;
                apart(f, *distance, *angle)
            }
            Self::OtherWriter { topic } => write!(f, "another client publishes {topic}"),
            Self::Teleoperation => f.write_str("teleoperation is enabled at the console"),
            Self::Said(text) => write!(f, "the arm reported: {text}"),
            Self::NotReached { said: text } => {
                f.write_str("the goal was not reached")?;
                said(f, text)
            }
            Self::Unreachable(reason) => write!(f, "unreachable: {reason}"),
            Self::JointJump { by } => write!(f, "a joint would jump by {by:.3}"),
        }
    }
}
