//! The state machine of an arm.
//!
//! ```text
//! state       commands it takes
//! DISABLED    enable  disable  unhome
//! ENABLED     enable  disable  unhome  home  pause
//! PAUSED              disable  unhome        pause  resume
//! FAULT       enable  disable  unhome                          simulators: clear_fault instead of enable; fault anywhere
//! ```
//! Other commands are answered with a warning and ignored. While it powers up, an arm reports DISABLED and busy; while it
//! homes, ENABLED and busy.

use std::time::Duration;

use crate::arm::{ArmStatus, Dialect, Mode};

/// Operations that take time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    Powering,
    Homing,
}

/// State of an arm, and its current operation.
#[derive(Debug, Clone)]
pub(super) struct Machine {
    dialect: Dialect,
    mode: Mode,
    joints_homed: bool,
    phase: Option<(Phase, Duration)>,
}

impl Machine {
    pub(super) fn new(dialect: Dialect) -> Self {
        let ready = dialect == Dialect::Simulator;
        Self {
            dialect,
            mode: if ready { Mode::Enabled } else { Mode::Disabled },
            joints_homed: ready,
            phase: None,
        }
    }

    pub(super) fn mode(&self) -> Mode {
        self.mode
    }

    /// Whether joint values are valid.
    pub(super) fn is_powered(&self) -> bool {
        self.mode != Mode::Disabled
    }

    /// `moving`: whether a trajectory or a hand moves the arm.
    pub(super) fn status(&self, has_tool: bool, moving: bool) -> ArmStatus {
        ArmStatus {
            mode: self.mode,
            homed: self.joints_homed && has_tool,
            busy: self.phase.is_some() || moving,
        }
    }

    pub(super) fn advance(&mut self, now: Duration) {
        let Some((phase, end)) = self.phase else {
            return;
        };
        if now < end {
            return;
        }
        self.phase = None;
        match phase {
            Phase::Powering => self.mode = Mode::Enabled,
            Phase::Homing => self.joints_homed = true,
        }
    }

    pub(super) fn fail(&mut self) {
        self.mode = Mode::Fault;
        self.phase = None;
    }

    /// # Errors
    /// The warning about a command that the state does not allow.
    pub(super) fn command(
        &mut self,
        command: &str,
        now: Duration,
        powering: Duration,
        homing: Duration,
    ) -> Result<(), String> {
        let simulator = self.dialect == Dialect::Simulator;
        match (self.mode, command) {
            (Mode::Disabled, "enable") => self.power(now, powering),
            (Mode::Fault, "enable") if !simulator => self.power(now, powering),
            (Mode::Fault, "clear_fault") if simulator => self.mode = Mode::Disabled,
            (Mode::Enabled, "enable") | (Mode::Paused, "pause") => {}
            (_, "disable") => {
                self.mode = Mode::Disabled;
                self.phase = None;
            }
            (_, "unhome") => self.joints_homed = false,
            (Mode::Enabled, "home") if self.joints_homed || self.phase.is_some() => {}
            (Mode::Enabled, "home") => self.phase = Some((Phase::Homing, now + homing)),
            (Mode::Enabled, "pause") => {
                self.mode = Mode::Paused;
                self.phase = None;
            }
            (Mode::Paused, "resume") => self.mode = Mode::Enabled,
            (_, "fault") if simulator => self.fail(),
            (mode, other) => {
                return Err(format!(
                    "command \"{other}\" is not supported in state \"{mode}\""
                ));
            }
        }
        Ok(())
    }

    fn power(&mut self, now: Duration, powering: Duration) {
        if self.phase.is_none() {
            self.mode = Mode::Disabled;
            self.phase = Some((Phase::Powering, now + powering));
        }
    }
}
