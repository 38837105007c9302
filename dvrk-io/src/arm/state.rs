//! States and events of an arm.

use std::fmt;
use std::time::Duration;

use crate::cdr::OperatingState;

/// The state of an arm.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub enum Mode {
    /// Not powered.
    Disabled,
    /// Powered; takes commands when it is homed.
    Enabled,
    /// Powered, takes no commands.
    Paused,
    /// The arm has stopped and switched its power off because of an error; a person has to find the cause.
    Fault,
    /// A state that the protocol does not define.
    Unknown,
}

impl fmt::Display for Mode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Disabled => "DISABLED",
            Self::Enabled => "ENABLED",
            Self::Paused => "PAUSED",
            Self::Fault => "FAULT",
            Self::Unknown => "UNDEFINED",
        })
    }
}

/// State, and whether the arm is homed and busy.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ArmStatus {
    /// The state.
    pub mode: Mode,
    /// Whether its joint encoders are referenced and an instrument is engaged.
    pub homed: bool,
    /// Whether it moves on its own. Enabled and busy without a command of ours means guided by hand.
    pub busy: bool,
}

impl From<&OperatingState> for ArmStatus {
    fn from(message: &OperatingState) -> Self {
        Self {
            mode: match message.state.as_str() {
                "DISABLED" => Mode::Disabled,
                "ENABLED" => Mode::Enabled,
                "PAUSED" => Mode::Paused,
                "FAULT" => Mode::Fault,
                _ => Mode::Unknown,
            },
            homed: message.is_homed,
            busy: message.is_busy,
        }
    }
}

impl fmt::Display for ArmStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let homed = if self.homed { "homed" } else { "not homed" };
        let busy = if self.busy { ", busy" } else { "" };
        write!(f, "{} ({homed}{busy})", self.mode)
    }
}

/// The protocol variant of an arm.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Dialect {
    /// A dVRK: `error`, `warning` and `status` are `std_msgs/String`; a fault is left with `enable`.
    Robot,
    /// The simulators of its maintainers: `error`, `warning` and `info` are `crtk_msgs/StringStamped`; a fault is left with
    /// `clear_fault`.
    Simulator,
}

impl fmt::Display for Dialect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Robot => "dVRK",
            Self::Simulator => "simulator",
        })
    }
}

/// The point of the instrument whose pose an arm reports and follows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum ControlPoint {
    /// A point on the wrist yaw axis, as a dVRK does.
    Wrist,
    /// The tips of the closed jaws, as simulators do.
    Tip,
}

impl fmt::Display for ControlPoint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Wrist => "wrist",
            Self::Tip => "tips of the jaws",
        })
    }
}

/// An event.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Event {
    /// When, since the epoch.
    pub time: Duration,
    /// Its kind.
    pub kind: EventKind,
}

/// The kinds of events.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[non_exhaustive]
pub enum EventKind {
    /// The arm reports an error.
    Error(String),
    /// The arm warns; also of commands that it ignores.
    Warning(String),
    /// The arm reports information.
    Info(String),
    /// Its state changed.
    Status(ArmStatus),
    /// Its instrument changed: the new name, or empty without an instrument.
    Tool(String),
    /// A motion ended.
    Stopped(super::Stop),
    /// Something could not be sent or read.
    Trouble(String),
}

impl fmt::Display for EventKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Error(text) => write!(f, "error: {text}"),
            Self::Warning(text) => write!(f, "warning: {text}"),
            Self::Info(text) => write!(f, "info: {text}"),
            Self::Status(status) => write!(f, "now {status}"),
            Self::Tool(name) if name.is_empty() => write!(f, "the instrument was removed"),
            Self::Tool(name) => write!(f, "instrument {name}"),
            Self::Stopped(stop) => write!(f, "stopped: {stop}"),
            Self::Trouble(text) => write!(f, "trouble: {text}"),
        }
    }
}
