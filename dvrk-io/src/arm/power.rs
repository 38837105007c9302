//! Power, homing and faults: commands that an arm answers with states.
//!
//! ```text
//! enable         DISABLED ⇒ (busy up to 3 s) ⇒ ENABLED;  then poses are valid
//! home           ENABLED  ⇒ busy ⇒ homed and not busy;   needs an instrument
//! clear_fault    FAULT    ⇒ enable (robot) or clear_fault (simulator)
//! ```
//! A robot reads only the last command, and none that was sent before DDS has connected it with the sender: a command without
//! effect is sent again every second. A command that the state does not allow is answered with a warning.

use std::time::Duration;

use super::driver::Arm;
use super::state::{ArmStatus, Dialect, Mode};
use super::stop::Stop;
use crate::Error;

/// A command without an answer is sent again after this.
const REPEAT: Duration = Duration::from_secs(1);

impl Arm {
    /// Powers the arm and waits until it is enabled, its poses are valid and its frames known. Does nothing if it is enabled.
    ///
    /// # Errors
    /// [`Error::ArmStopped`] in a fault: see [`Arm::clear_fault`]. [`Error::CommandRefused`], [`Error::ArmTimeout`],
    /// [`Error::StreamsMissing`], [`Error::FramesDisagree`].
    pub fn enable(&mut self, timeout: Duration) -> Result<(), Error> {
        let start = self.transport.now();
        self.tick();
        if self.mode() == Mode::Paused {
            self.command("resume", timeout, |status| status.mode == Mode::Enabled)?;
        }
        self.command("enable", timeout, |status| {
            status.mode == Mode::Enabled && !status.busy
        })?;
        let left = timeout.saturating_sub(self.transport.now().saturating_sub(start));
        self.await_streams(left)?;
        self.check()?;
        Ok(())
    }

    /// Homes the arm and waits until it is homed. Does nothing if it is.
    ///
    /// # Errors
    /// See [`Arm::enable`]; an arm without an instrument stays busy or not homed until the timeout.
    pub fn home(&mut self, timeout: Duration) -> Result<(), Error> {
        self.command("home", timeout, |status| {
            status.mode == Mode::Enabled && status.homed && !status.busy
        })
    }

    /// Switches the power off and waits until it is off.
    ///
    /// # Errors
    /// [`Error::ArmTimeout`].
    pub fn disable(&mut self, timeout: Duration) -> Result<(), Error> {
        self.hold();
        self.command("disable", timeout, |status| {
            status.mode == Mode::Disabled && !status.busy
        })
    }

    /// Leaves a fault, and waits until the arm is enabled. Call it only after a person has found the cause. Does nothing to an arm without
    /// a fault.
    ///
    /// # Errors
    /// See [`Arm::enable`].
    pub fn clear_fault(&mut self, timeout: Duration) -> Result<(), Error> {
        self.tick();
        if self.mode() != Mode::Fault {
            return Ok(());
        }
        let command = match self.dialect() {
            Dialect::Robot => "enable",
            Dialect::Simulator => "clear_fault",
        };
        self.send_until(command, timeout, true, |status| {
            status.mode != Mode::Fault && !status.busy
        })?;
        self.enable(timeout)
    }

    fn command(
        &mut self,
        command: &'static str,
        timeout: Duration,
        done: impl Fn(ArmStatus) -> bool,
    ) -> Result<(), Error> {
        self.send_until(command, timeout, false, done)
    }

    fn send_until(
        &mut self,
        command: &'static str,
        timeout: Duration,
        from_fault: bool,
        done: impl Fn(ArmStatus) -> bool,
    ) -> Result<(), Error> {
        self.tick();
        if done(self.status()) {
            return Ok(());
        }
        self.expect_busy = true;
        let result = self.drive_command(command, timeout, from_fault, done);
        self.expect_busy = false;
        result
    }

    fn drive_command(
        &mut self,
        command: &'static str,
        timeout: Duration,
        mut from_fault: bool,
        done: impl Fn(ArmStatus) -> bool,
    ) -> Result<(), Error> {
        let start = self.transport.now();
        let mut sent: Option<Duration> = None;
        let before = self.status();
        self.last_warning.clear();
        loop {
            let (now, status) = (self.transport.now(), self.status());
            if done(status) {
                return Ok(());
            }
            from_fault &= status.mode == Mode::Fault;
            if status.mode == Mode::Fault && !from_fault && command != "disable" {
                return Err(self.stopped(Stop::NotReady {
                    status,
                    said: self.last_error.clone(),
                }));
            }
            if self.last_warning.contains("not supported") {
                return Err(Error::CommandRefused {
                    arm: self.name.clone(),
                    command,
                    said: std::mem::take(&mut self.last_warning),
                });
            }
            if now >= start + timeout {
                return Err(self.late(command, timeout));
            }
            let unanswered = status == before;
            if sent.is_none_or(|sent| unanswered && now >= sent + REPEAT) {
                let result = self.commands.state(now, command);
                self.note(now, result);
                sent = Some(now);
            }
            self.sleep();
            self.tick();
        }
    }
}
