//! One tick: read messages, check the arm, send the next set-point.
//!
//! ```text
//! state not ENABLED · guided by hand · teleoperation · error reported · silent stream · base moved · set-point differs · blocked · other writer
//!         any of these    ⇒  the motion ends, the arm is told to hold (see Stop)
//! else    next pose of the line, next angle of the jaw, both sent now
//! ```
//! A tick that comes late sends one set-point, not those that were missed; one that comes early sends none. Set-points therefore never
//! follow each other faster than the limits assume.

use std::time::Duration;

use super::drive::unreachable;
use super::driver::Arm;
use super::line::apart;
use super::monitor::WINDOW;
use super::motion::{JawMotion, LineMotion, Motion, MoveMotion};
use super::options::OtherWriters;
use super::state::{EventKind, Mode};
use super::stop::Stop;

/// Interval between two checks for other writers, which traverse the list of all writers on the network.
const OTHER_WRITERS: Duration = Duration::from_millis(50);
/// How long a robot may take to begin a trajectory.
const BEGIN: Duration = Duration::from_secs(1);
/// How far the jaw's set-point may be from what was sent, radians.
pub(super) const JAW: f64 = 0.02;

impl Arm {
    /// Reads messages, and executes the current motion. Call it once a [period](super::ArmOptions::period), or let
    /// [`Arm::wait`] or an [`ArmThread`](super::ArmThread) do it.
    pub fn tick(&mut self) {
        let now = self.transport.now();
        self.last_tick = now;
        let error = self.take_in(now);
        if now >= self.writers_checked + OTHER_WRITERS {
            self.look_for_rivals(now);
        }
        let Some(mut motion) = self.motion.take() else {
            return;
        };
        let trouble = self.trouble(now, &motion, error);
        let stop = trouble.or_else(|| match &mut motion {
            Motion::Line { line, jaw, done } => self.send_setpoints(now, line, jaw, done),
            Motion::Move(state) => self.follow_move(now, state),
        });
        self.motion = Some(motion);
        if let Some(stop) = stop {
            self.finish(stop);
        }
    }

    /// The next set-points of tips and jaw; if both are at their ends, whether the arm is too.
    fn send_setpoints(
        &mut self,
        now: Duration,
        line: &mut LineMotion,
        jaw: &mut Option<JawMotion>,
        done: &mut Option<Duration>,
    ) -> Option<Stop> {
        if now < self.last_sent + self.options.period {
            return None;
        }
        if let Some(stop) = self.advance(now, line) {
            return Some(stop);
        }
        if let Some(jaw) = jaw {
            let angle = jaw.advance();
            self.sent.jaw = Some((now, angle));
            let sent = self.commands.jaw(now, angle);
            self.note(now, sent);
        }
        let jaw_done = jaw.as_ref().is_none_or(JawMotion::is_done);
        if !(line.is_done() && jaw_done) {
            return None;
        }
        let since = *done.get_or_insert(now);
        self.arrived(now, since, jaw.as_ref().map(JawMotion::angle))
    }

    /// Reads every topic; returns the last error that was reported, if any.
    fn take_in(&mut self, now: Duration) -> Option<String> {
        let mut events = Vec::new();
        self.feedback.poll(now, &mut events);
        let mut error = None;
        for event in events {
            match &event {
                EventKind::Error(text) => {
                    self.last_error.clone_from(text);
                    error = Some(text.clone());
                }
                EventKind::Warning(text) => self.last_warning.clone_from(text),
                // A message from a fault that is over is not the reason for the next one.
                EventKind::Status(status) if status.mode == Mode::Enabled => {
                    self.last_error.clear();
                }
                _ => {}
            }
            self.event(now, event);
        }
        error
    }

    /// Why the motion must stop. A loss of control explains more than the errors that follow it.
    fn trouble(&self, now: Duration, motion: &Motion, error: Option<String>) -> Option<Stop> {
        let hand = match motion {
            Motion::Move(_) => self.feedback.said().clutch,
            Motion::Line { .. } => self.is_clutched(),
        };
        let taken = self.taken(hand);
        let said = || error.map(Stop::Said);
        taken
            .or_else(said)
            .or_else(|| self.unwatched(now))
            .or_else(|| self.elsewhere())
    }

    /// Whether the state of the arm, a hand, or the console has taken control of it.
    fn taken(&self, hand: bool) -> Option<Stop> {
        let status = self.status();
        if status.mode != Mode::Enabled || !status.homed {
            let said = self.last_error.clone();
            Some(Stop::NotReady { status, said })
        } else if hand {
            Some(Stop::Clutched)
        } else {
            self.is_teleoperated().then_some(Stop::Teleoperation)
        }
    }

    /// Whether the arm cannot be observed, or is not ours to command.
    fn unwatched(&self, now: Duration) -> Option<Stop> {
        if let Some((topic, age)) = self.feedback.stale(now, self.options.stale) {
            return Some(Stop::Stale { topic, age });
        }
        let topic = self.rival.clone()?;
        Some(Stop::OtherWriter { topic })
    }

    /// Why the arm could not start a motion, as of the last tick: its state, guided by hand, teleoperation, a stale stream, another
    /// client that can command it. An arm at rest has no motion that such a reason could end, so use this to monitor arms at rest
    /// while others move.
    pub fn unready(&self) -> Option<Stop> {
        let taken = self.taken(self.is_clutched());
        taken.or_else(|| self.unwatched(self.transport.now()))
    }

    /// Records the topic on which another client can command the arm, unless that is allowed.
    pub(crate) fn look_for_rivals(&mut self, now: Duration) {
        self.writers_checked = now;
        self.rival = match self.options.other_writers {
            OtherWriters::Allow => None,
            OtherWriters::Refuse => self.other_writers().into_iter().next(),
        };
    }

    /// Why poses are not the expected ones, if so.
    fn elsewhere(&self) -> Option<Stop> {
        let (frames, base) = (self.frames.as_ref()?, self.base_now());
        if let Some(base) = base {
            let (distance, angle) = apart(&base, &frames.reference_from_rcm.0);
            if !self.options.frames.holds((distance, angle)) {
                return Some(Stop::BaseMoved { distance, angle });
            }
        }
        let setpoint = &self.feedback.setpoint.latest()?.value.pose;
        if let Some((distance, angle)) = self.monitor.off(setpoint, self.options.divergence) {
            return Some(Stop::Diverged { distance, angle });
        }
        let measured = &self.feedback.measured.latest()?.value.pose;
        let (distance, angle) = apart(setpoint, measured);
        let follows = self.options.tracking.holds((distance, angle));
        (!follows).then_some(Stop::Blocked { distance, angle })
    }

    /// Sends the next set-point of the line.
    fn advance(&mut self, now: Duration, motion: &mut LineMotion) -> Option<Stop> {
        let tip = motion.advance();
        let kinematics = &self.options.kinematics;
        let wrist = kinematics.wrist_of(&tip);
        let joints = match kinematics.inverse_near(&wrist, &motion.joints) {
            Ok(reach) => reach.joints,
            Err(error) => return Some(unreachable(error)),
        };
        let steps = joints
            .iter()
            .zip(motion.joints)
            .map(|(next, last)| (next - last).abs());
        let by = steps.fold(0.0, f64::max);
        if by > self.options.joint_step {
            return Some(Stop::JointJump { by });
        }
        motion.joints = joints;
        let frames = self.frames.clone()?;
        let pose = frames.command(kinematics, &tip);
        self.monitor.sent(now, pose);
        self.last_sent = now;
        self.sent.tip = Some((now, tip));
        let sent = self.commands.servo(now, &frames.reference, &pose);
        self.note(now, sent);
        None
    }

    /// Whether the arm's set-points are at the end; false if there is no answer within the window.
    fn arrived(&self, now: Duration, since: Duration, jaw: Option<f64>) -> Option<Stop> {
        let setpoint = &self.feedback.setpoint.latest()?.value.pose;
        let (_, goal) = self.monitor.last()?;
        let (distance, angle) = apart(setpoint, goal);
        let there = self.options.divergence.holds((distance, angle));
        let jaw_off = jaw.map_or(0.0, |jaw| {
            let setpoint = self.feedback.jaw_setpoint.latest();
            let setpoint = setpoint.and_then(|sample| sample.value.position.first().copied());
            setpoint.map_or(f64::INFINITY, |setpoint| (setpoint - jaw).abs())
        });
        match (there, jaw_off <= JAW) {
            (true, true) => Some(Stop::Arrived),
            _ if now < since + WINDOW => None,
            (true, false) => Some(Stop::JawDiverged { angle: jaw_off }),
            (false, _) => Some(Stop::Diverged { distance, angle }),
        }
    }

    /// Busy must rise and fall again, or the robot must say that the goal is reached.
    fn follow_move(&mut self, now: Duration, motion: &mut MoveMotion) -> Option<Stop> {
        let (said, status) = (self.feedback.said().clone(), self.status());
        // States from before the command do not count.
        motion.busy_seen |= status.busy && said.states > motion.states;
        let setpoint = &self.feedback.setpoint.latest()?.value.pose;
        let there = self.options.divergence.holds(apart(setpoint, &motion.goal));
        let not_reached = || Stop::NotReached {
            said: if self.last_error.is_empty() {
                self.last_warning.clone()
            } else {
                self.last_error.clone()
            },
        };
        match said.goal {
            Some(false) => return Some(not_reached()),
            Some(true) if there && !status.busy => return Some(Stop::Arrived),
            _ => {}
        }
        if motion.busy_seen {
            let ended = !status.busy;
            // The set-point may lag a period behind the state.
            return match (ended, there) {
                (false, _) => None,
                (true, true) => Some(Stop::Arrived),
                (true, false) => (now > motion.ended(now) + WINDOW).then(not_reached),
            };
        }
        if now < motion.sent + BEGIN {
            return None;
        }
        if there {
            return Some(Stop::Arrived);
        }
        if motion.repeated {
            return Some(not_reached());
        }
        // Lost, or overwritten by a command right after it: sent again.
        let frame = self.frames.as_ref().map(|frames| frames.reference.clone());
        let sent = self
            .commands
            .move_to(now, &frame.unwrap_or_default(), &motion.goal);
        self.note(now, sent);
        (motion.sent, motion.repeated) = (now, true);
        None
    }
}
