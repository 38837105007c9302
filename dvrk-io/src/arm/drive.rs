//! Motions: starting them, and waiting for their end.

use std::time::Duration;

use super::driver::Arm;
use super::line::Line;
use super::motion::{JawMotion, LastSent, LineMotion, Motion, MoveMotion, NextLine, in_flight};
use super::profile::{Profile, ProfileLimits};
use super::state::{EventKind, Mode};
use super::stop::Stop;
use super::tick::JAW;
use crate::Error;
use crate::kinematics::{RcmFromTip, Unreachable};

/// Spacing of the poses of a line that are checked before it starts, metres.
const LOOK_AHEAD: f64 = 0.002;
/// Speed is kept from one line to the next if that changes the velocity by at most this share of what a tick allows.
const SAME_LINE: f64 = 1e-3;

impl Arm {
    /// Starts a straight motion of the tips (translation and slerp together) with the speed of the fastest point of the jaws,
    /// m/s, and returns; [`Arm::tick`] or [`Arm::wait`] execute it. A new goal replaces the current one: without a stop if it
    /// lies ahead on the same straight line, far enough to stop there, at a speed that is not lower; otherwise the arm stops
    /// first.
    ///
    /// The whole line is checked before it starts: the goal with [margins](super::ArmOptions::margins), the path within joint
    /// limits.
    ///
    /// # Errors
    /// [`Error::ArmStopped`] with the reason why the arm does not move: its state, guided by hand, another writer, teleoperation, a
    /// stale stream. [`Error::Unreachable`]; [`Error::OutOfRange`] for a speed that is not positive and finite;
    /// [`Error::FramesDisagree`].
    pub fn start_line(&mut self, goal: &RcmFromTip, speed: f64) -> Result<(), Error> {
        if !(speed > 0.0 && speed.is_finite()) {
            return Err(Error::OutOfRange {
                what: "speed",
                value: speed,
                expected: "must be positive and finite",
            });
        }
        self.ready()?;
        let (mut line, jaw) = self.current_line()?;
        let limits = self.limits_at(speed);
        let here = line.line.pose(line.profile.travelled());
        let direct = Line::new(&here, &goal.0);
        let way = line.profile.speed();
        let profile = Profile::new(direct.length(), self.tick_seconds(), limits)?;
        let goes_on = way == 0.0 || self.is_same_line(&line.line, &direct, way);
        if goes_on && let Some(profile) = profile.continuing(way) {
            self.check_line(&direct, &line.joints)?;
            (line.line, line.profile, line.next) = (direct, profile, None);
        } else {
            line.profile.brake();
            let rest = line.line.pose(line.profile.length());
            let next = Line::new(&rest, &goal.0);
            self.check_line(&next, &line.joints)?;
            let profile = Profile::new(next.length(), self.tick_seconds(), limits)?;
            line.next = Some(NextLine {
                line: next,
                profile,
            });
        }
        self.begin(Motion::Line {
            line,
            jaw,
            done: None,
        });
        Ok(())
    }

    /// Starts to open or close the jaw to an angle, radians; a motion of the tips continues, with set-points in the same ticks. A
    /// new angle replaces the current one; if the jaw has to reverse, or is too fast to stop there, it stops
    /// first.
    ///
    /// # Errors
    /// See [`Arm::start_line`]; [`Error::OutOfRange`] for an angle outside
    /// [`ArmOptions::jaw_range`](super::ArmOptions::jaw_range).
    pub fn start_jaw(&mut self, angle: f64) -> Result<(), Error> {
        let [lower, upper] = self.options.jaw_range;
        if !(lower..=upper).contains(&angle) {
            return Err(Error::OutOfRange {
                what: "angle of the jaw",
                value: angle,
                expected: "must be within the range of the jaw",
            });
        }
        self.ready()?;
        let (line, jaw) = self.current_line()?;
        let (tick, limits) = (self.tick_seconds(), self.options.jaw);
        let next = match (jaw, self.jaw()) {
            (Some(jaw), _) => jaw.towards(angle, tick, limits)?,
            (None, Some(now)) => {
                let reported = now.value.setpoint;
                let sent = in_flight(self.sent.jaw, self.transport.now());
                let start = sent.filter(|sent| (sent - reported).abs() <= JAW);
                JawMotion::new(start.unwrap_or(reported), angle, tick, limits)?
            }
            (None, None) => {
                return Err(self.stopped(Stop::Stale {
                    topic: self.names.of(super::topics::JAW_MEASURED_JS),
                    age: f64::INFINITY,
                }));
            }
        };
        self.begin(Motion::Line {
            line,
            jaw: Some(next),
            done: None,
        });
        Ok(())
    }

    /// Sends the arm to a goal on the robot's own trajectory (`move_cp`): straight in joint space, not in Cartesian space, and at the robot's
    /// speed. [`Arm::wait`] waits until busy has risen and fallen, or for `goal_reached`.
    ///
    /// # Errors
    /// See [`Arm::start_line`].
    pub fn start_move(&mut self, goal: &RcmFromTip) -> Result<(), Error> {
        self.ready()?;
        self.check_goal(goal, &self.joints().map_or([0.0; 6], |joints| joints.value))?;
        let frames = self.check()?;
        let now = self.transport.now();
        let pose = frames.command(&self.options.kinematics, goal);
        self.feedback.forget_goal();
        self.monitor.clear();
        self.sent.tip = None;
        self.commands.move_to(now, &frames.reference, &pose)?;
        let states = self.feedback.said().states;
        self.begin(Motion::Move(MoveMotion {
            goal: pose,
            sent: now,
            states,
            busy_seen: false,
            repeated: false,
            idle: None,
        }));
        Ok(())
    }

    /// Stops the motion, and tells the arm to hold its position.
    pub fn hold(&mut self) {
        if self.mode() == Mode::Enabled || self.motion.is_some() {
            self.finish(Stop::Held);
        }
    }

    /// Ticks until the current motion has ended.
    ///
    /// # Errors
    /// [`Error::ArmStopped`] if it did not end at its goal; [`Error::ArmTimeout`] if it has not ended after `timeout`: it
    /// is not stopped then.
    pub fn wait(&mut self, timeout: Duration) -> Result<(), Error> {
        let end = self.transport.now() + timeout;
        while self.motion.is_some() {
            self.tick();
            if self.motion.is_none() {
                break;
            }
            if self.transport.now() >= end {
                return Err(self.late("the motion", timeout));
            }
            self.sleep();
        }
        self.outcome()
    }

    /// The outcome of the last motion.
    pub(crate) fn outcome(&self) -> Result<(), Error> {
        match &self.last_stop {
            None | Some(Stop::Arrived) => Ok(()),
            Some(stop) => Err(self.stopped(stop.clone())),
        }
    }

    /// Waits until the next tick is due.
    pub(crate) fn sleep(&self) {
        let next = self.last_tick + self.options.period;
        while self.transport.now() < next {
            self.transport.wait(next);
        }
    }

    pub(crate) fn tick_seconds(&self) -> f64 {
        self.options.period.as_secs_f64()
    }

    pub(crate) fn limits_at(&self, speed: f64) -> ProfileLimits {
        let limits = self.options.motion;
        ProfileLimits {
            speed: limits.speed.min(speed),
            ..limits
        }
    }

    fn is_same_line(&self, old: &Line, new: &Line, speed: f64) -> bool {
        let allowed = SAME_LINE * self.options.motion.acceleration * self.tick_seconds();
        let change = old.direction().into_iter().zip(new.direction());
        change
            .map(|(old, new)| speed * (old - new).norm())
            .all(|change| change <= allowed)
    }

    fn begin(&mut self, motion: Motion) {
        self.last_stop = None;
        self.motion = Some(motion);
    }

    /// Ends the motion.
    pub(crate) fn finish(&mut self, stop: Stop) {
        let now = self.transport.now();
        if stop.holds() && self.mode() == Mode::Enabled {
            let sent = self.commands.hold();
            self.note(now, sent);
        }
        self.motion = None;
        // After a hold the arm stays at the last set-point; its reported pose may lag behind for some time.
        if !matches!(stop, Stop::Arrived | Stop::Held) {
            self.monitor.clear();
            self.sent = LastSent::default();
        }
        self.last_stop = Some(stop.clone());
        self.event(now, EventKind::Stopped(stop));
    }

    /// # Errors
    /// Why the arm cannot start a motion now.
    fn ready(&mut self) -> Result<(), Error> {
        self.look_for_rivals(self.transport.now());
        let reason = self.unready();
        reason.map_or(Ok(()), |reason| Err(self.stopped(reason)))
    }

    /// The current line, or a line of length zero at the set-point.
    fn current_line(&mut self) -> Result<(Box<LineMotion>, Option<JawMotion>), Error> {
        if let Some(Motion::Line { line, jaw, .. }) = &self.motion {
            return Ok((line.clone(), *jaw));
        }
        let frames = self.check()?;
        let now = self.transport.now();
        let setpoint = self.feedback.setpoint.fresh(now);
        let measured = self.feedback.measured.fresh(now);
        let (Some(setpoint), Some(measured)) = (setpoint, measured) else {
            return Err(self.stopped(Stop::Stale {
                topic: self.names.of(super::topics::SETPOINT_CP),
                age: f64::INFINITY,
            }));
        };
        let behind = super::line::apart(&setpoint.value.pose, &measured.value.pose);
        if !self.options.tracking.holds(behind) {
            let (distance, angle) = behind;
            return Err(self.stopped(Stop::Blocked { distance, angle }));
        }
        let reported = frames.tip(&self.options.kinematics, &setpoint.value.pose);
        // While it follows the sent path, it will reach the end of it.
        let on_its_way = self
            .monitor
            .off(&setpoint.value.pose, self.options.divergence)
            .is_none();
        let start = in_flight(self.sent.tip, now).filter(|_| on_its_way);
        let start = start.unwrap_or(reported);
        let near = self.joints().map_or([0.0; 6], |joints| joints.value);
        let kinematics = &self.options.kinematics;
        let reach = kinematics.inverse_near(&kinematics.wrist_of(&start), &near)?;
        let stay = Line::new(&start.0, &start.0);
        Ok((
            Box::new(LineMotion {
                line: stay,
                profile: Profile::new(0.0, self.tick_seconds(), self.options.motion)?,
                next: None,
                joints: reach.joints,
            }),
            None,
        ))
    }

    fn check_goal(&self, goal: &RcmFromTip, near: &[f64; 6]) -> Result<(), Error> {
        let kinematics = &self.options.kinematics;
        let reach = kinematics.inverse_near(&kinematics.wrist_of(goal), near)?;
        match self.options.margins.short(&reach) {
            Some(reason) => Err(reason.into()),
            None => Ok(()),
        }
    }

    /// # Errors
    /// The goal violates the margins, or a pose of the path cannot be reached.
    fn check_line(&self, line: &Line, start: &[f64; 6]) -> Result<(), Error> {
        let kinematics = &self.options.kinematics;
        let steps = (line.length() / LOOK_AHEAD).ceil().clamp(1.0, 1000.0);
        let mut joints = *start;
        for step in 1..=steps as u32 {
            let tip = RcmFromTip(line.pose(line.length() * f64::from(step) / steps));
            joints = kinematics
                .inverse_near(&kinematics.wrist_of(&tip), &joints)?
                .joints;
        }
        self.check_goal(&RcmFromTip(line.pose(line.length())), &joints)
    }
}

/// The reason in an error of the kinematics, if there is one.
pub(crate) fn unreachable(error: Error) -> Stop {
    match error {
        Error::Unreachable(reason) => Stop::Unreachable(reason),
        other => Stop::Said(other.to_string()),
    }
}

impl From<Unreachable> for Stop {
    fn from(reason: Unreachable) -> Self {
        Self::Unreachable(reason)
    }
}
