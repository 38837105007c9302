//! One arm as a client drives it.

use std::sync::Arc;
use std::time::Duration;

use nalgebra::Isometry3;

use super::check::{FrameCheck, Frames, check_frames};
use super::commands::Commands;
use super::feedback::{Feedback, MissingStream};
use super::monitor::Monitor;
use super::motion::{LastSent, Motion};
use super::options::{ArmOptions, LocalPose};
use super::state::{ArmStatus, ControlPoint, Dialect, Event, EventKind, Mode};
use super::stop::Stop;
use super::stream::{Sample, Velocity};
use super::topics::{MOVES_THE_ARM, Names};
use crate::Error;
use crate::kinematics::{RcmFromTip, RcmFromWrist};
use crate::session::check_arm_name;
use crate::transport::Transport;

/// Events that are kept for [`Arm::take_events`]; older ones go first.
const EVENTS: usize = 256;

/// What a jaw says of itself.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JawState {
    /// Angle between the fingers, radians; 0 is closed, less squeezes.
    pub angle: f64,
    /// Where it was sent.
    pub setpoint: f64,
    /// N·m, where the robot says.
    pub effort: Option<f64>,
}

impl JawState {
    /// By how much it stays more open than it was sent to be: what is between the fingers keeps it so.
    pub fn gap(&self) -> f64 {
        self.angle - self.setpoint
    }
}

/// A patient-side manipulator on a ROS 2 network, as one client drives it.
///
/// Nothing goes on behind the caller's back: what came is taken in, watched over and answered in [`Arm::tick`], which the
/// blocking calls do as long as they block. To have it done while something else is computed, give the arm to an
/// [`ArmThread`](super::ArmThread).
pub struct Arm {
    pub(crate) name: String,
    pub(crate) transport: Arc<dyn Transport>,
    pub(crate) names: Names,
    pub(crate) options: ArmOptions,
    pub(crate) feedback: Feedback,
    pub(crate) commands: Commands,
    pub(crate) frames: Option<FrameCheck>,
    pub(crate) motion: Option<Motion>,
    pub(crate) monitor: Monitor,
    pub(crate) last_stop: Option<Stop>,
    pub(crate) last_error: String,
    pub(crate) last_warning: String,
    /// Homing and powering make an arm busy: not somebody's hand then.
    pub(crate) expect_busy: bool,
    pub(crate) last_tick: Duration,
    /// When the last set-point was sent.
    pub(crate) last_sent: Duration,
    /// The last set-points, unless the motion was stopped: what the arm reports lags behind them.
    pub(crate) sent: LastSent,
    pub(crate) writers_checked: Duration,
    events: std::collections::VecDeque<Event>,
}

impl std::fmt::Debug for Arm {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Arm")
            .field("name", &self.name)
            .field("last_stop", &self.last_stop)
            .finish_non_exhaustive()
    }
}

impl Arm {
    /// Finds an arm, and returns when it can be read and commanded: every stream has brought a sample, every command has a
    /// listener, and the state has come. While the arm is not powered it may mark its samples as not measured; once it is
    /// enabled they must be valid.
    ///
    /// Streams: `operating_state`, `measured_cp`, `setpoint_cp`, `local/measured_cp` (unless
    /// [`LocalPose::FromJoints`]), `measured_js`, `jaw/measured_js`, `jaw/setpoint_js`. Heard if they are there:
    /// `measured_cv`, `setpoint_js`, `tool_type`, `arm_clutch`, `goal_reached`, `error`, `warning`, `status`, `info` and
    /// the console's `teleop/enabled`.
    ///
    /// Allow 6 s: DDS sends states that were published before only with its next heartbeat, up to 3 s later.
    ///
    /// # Errors
    /// [`Error::StreamsMissing`] names each stream that is missing after `timeout`, and why; [`Error::BadArmName`];
    /// [`Error::OutOfRange`] for an option; [`Error::Network`]; [`Error::FramesDisagree`] for an arm that is enabled.
    pub fn connect(
        transport: Arc<dyn Transport>,
        name: &str,
        options: ArmOptions,
        timeout: Duration,
    ) -> Result<Self, Error> {
        options.check()?;
        check_arm_name(name)?;
        let names = Names::new(name);
        let feedback = Feedback::new(transport.as_ref(), &names, &options)?;
        let commands = Commands::new(transport.as_ref(), &names)?;
        let now = transport.now();
        let mut arm = Self {
            name: name.to_owned(),
            names,
            options,
            feedback,
            commands,
            frames: None,
            motion: None,
            monitor: Monitor::default(),
            last_stop: None,
            last_error: String::new(),
            last_warning: String::new(),
            expect_busy: false,
            last_tick: now,
            last_sent: Duration::ZERO,
            sent: LastSent::default(),
            writers_checked: Duration::ZERO,
            events: std::collections::VecDeque::new(),
            transport,
        };
        arm.await_streams(timeout)?;
        if arm.mode() == Mode::Enabled {
            arm.check()?;
        }
        Ok(arm)
    }

    /// Ticks until nothing is missing.
    pub(crate) fn await_streams(&mut self, timeout: Duration) -> Result<(), Error> {
        let end = self.transport.now() + timeout;
        loop {
            self.tick();
            let missing = self.missing();
            if missing.is_empty() {
                return Ok(());
            }
            if self.transport.now() >= end {
                return Err(Error::StreamsMissing {
                    arm: self.name.clone(),
                    waited: timeout.as_secs_f64(),
                    streams: missing,
                });
            }
            self.sleep();
        }
    }

    /// What keeps the arm from being driven: streams without a fresh sample, commands without a listener. Empty if all is
    /// well.
    pub fn missing(&self) -> Vec<MissingStream> {
        let transport = self.transport.as_ref();
        // Before it is powered, a dVRK has no poses; before it has a tool, no valid ones.
        let measured = self.mode() == Mode::Enabled;
        let mut missing = self.feedback.missing(transport, transport.now(), measured);
        missing.extend(self.commands.missing(transport));
        missing
    }

    /// Its name, as in `PSM1`.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// How it is driven.
    pub fn options(&self) -> &ArmOptions {
        &self.options
    }

    /// Its state, as far as it is known.
    pub fn status(&self) -> ArmStatus {
        self.feedback.said().status.unwrap_or(ArmStatus {
            mode: Mode::Unknown,
            homed: false,
            busy: false,
        })
    }

    pub(crate) fn mode(&self) -> Mode {
        self.status().mode
    }

    /// Robot or simulator, by the type of its error messages.
    pub fn dialect(&self) -> Dialect {
        self.feedback.dialect(self.transport.as_ref())
    }

    /// The instrument that it reports, if it does; empty when there is none.
    pub fn tool(&self) -> Option<&str> {
        self.feedback.said().tool.as_deref()
    }

    /// Whether somebody guides the arm by hand.
    pub fn is_clutched(&self) -> bool {
        let status = self.status();
        let busy = status.mode == Mode::Enabled && status.busy;
        let ours = self.expect_busy || matches!(self.motion, Some(Motion::Move(_)));
        // Simulators have no hands at their arms, and their own ideas of busy.
        self.feedback.said().clutch || (busy && !ours && self.dialect() == Dialect::Robot)
    }

    /// Whether the console has teleoperation enabled: it commands arms without ROS then, and nobody arbitrates.
    pub fn is_teleoperated(&self) -> bool {
        self.feedback.said().teleop
    }

    /// The topics on which somebody else can move this arm.
    pub fn other_writers(&self) -> Vec<String> {
        let topics = MOVES_THE_ARM.iter().map(|topic| self.names.of(topic));
        let others = |topic: &String| {
            let writers = self.transport.writers(topic);
            writers.iter().any(|writer| !writer.own)
        };
        topics.filter(others).collect()
    }

    /// Compares what the arm reports with its joint values, and finds its frames. Done by [`Arm::connect`] and
    /// [`Arm::enable`], and before each motion from rest.
    ///
    /// # Errors
    /// [`Error::FramesDisagree`]: another instrument, another generation, joints in another order.
    /// [`Error::ArmStopped`] with [`Stop::Stale`] when a stream is silent.
    pub fn check(&mut self) -> Result<FrameCheck, Error> {
        let now = self.transport.now();
        let measured = self.feedback.measured.fresh(now);
        let local = self.feedback.local.as_ref().map(|local| local.fresh(now));
        let (Some(measured), Some(joints)) = (measured, self.joints()) else {
            return Err(self.silent(now));
        };
        let local = match local {
            None => None,
            Some(None) => return Err(self.silent(now)),
            Some(Some(sample)) => Some(&sample.value.pose),
        };
        let frames = Frames {
            measured: &measured.value.pose,
            reference: &measured.value.frame,
            local,
            joints: &joints.value,
        };
        let check = check_frames(&self.options.kinematics, self.options.frames, &frames)?;
        self.frames = Some(check.clone());
        Ok(check)
    }

    fn silent(&self, now: Duration) -> Error {
        let (topic, age) = self
            .feedback
            .stale(now, self.options.stale)
            .unwrap_or_else(|| (self.names.of(super::topics::MEASURED_JS), f64::INFINITY));
        self.stopped(Stop::Stale { topic, age })
    }

    pub(crate) fn stopped(&self, reason: Stop) -> Error {
        Error::ArmStopped {
            arm: self.name.clone(),
            reason: Box::new(reason),
        }
    }

    /// What took too long, with the last words of the arm.
    pub(crate) fn late(&self, what: &'static str, timeout: Duration) -> Error {
        let no_tool = (self.tool() == Some("")).then(|| "there is no instrument".to_owned());
        let words = [&self.last_error, &self.last_warning].map(Clone::clone);
        let mut words = words.into_iter().chain(no_tool);
        let said = words.find(|text| !text.is_empty());
        Error::ArmTimeout {
            arm: self.name.clone(),
            what,
            waited: timeout.as_secs_f64(),
            status: self.status(),
            said: said.unwrap_or_default(),
        }
    }

    /// Its six joint values, in the order of [`Joint::ALL`](crate::kinematics::Joint::ALL); nothing while they are stale.
    pub fn joints(&self) -> Option<Sample<[f64; 6]>> {
        six(self.feedback.joints.fresh(self.transport.now())?)
    }

    /// The joint values that it is sent to, where it says.
    pub fn joint_setpoint(&self) -> Option<Sample<[f64; 6]>> {
        six(self.feedback.joint_setpoint.fresh(self.transport.now())?)
    }

    /// Where the tips are, as measured; nothing while the stream is stale or the frames are not known.
    pub fn rcm_from_tip(&self) -> Option<Sample<RcmFromTip>> {
        let (frames, kinematics) = (self.frames.as_ref()?, &self.options.kinematics);
        let now = self.transport.now();
        let sample = match self.options.local {
            LocalPose::Published => self.feedback.local.as_ref()?.fresh(now)?,
            LocalPose::FromJoints => self.feedback.measured.fresh(now)?,
        };
        Some(Sample {
            value: frames.tip_of_local(kinematics, &sample.value.pose),
            stamp: sample.stamp,
            arrived: sample.arrived,
        })
    }

    /// Where the control point of a dVRK is, as measured, whichever point the arm reports.
    pub fn rcm_from_wrist(&self) -> Option<Sample<RcmFromWrist>> {
        let tip = self.rcm_from_tip()?;
        Some(Sample {
            value: self.options.kinematics.wrist_of(&tip.value),
            stamp: tip.stamp,
            arrived: tip.arrived,
        })
    }

    /// Where the tips are sent.
    pub fn tip_setpoint(&self) -> Option<Sample<RcmFromTip>> {
        let frames = self.frames.as_ref()?;
        let sample = self.feedback.setpoint.fresh(self.transport.now())?;
        Some(Sample {
            value: frames.tip(&self.options.kinematics, &sample.value.pose),
            stamp: sample.stamp,
            arrived: sample.arrived,
        })
    }

    /// Velocity of the control point that the arm reports, axes of its reference frame, where it says.
    pub fn velocity(&self) -> Option<Sample<Velocity>> {
        let sample = self.feedback.velocity.fresh(self.transport.now());
        sample.copied()
    }

    /// Angle, set-point and effort of the jaw.
    pub fn jaw(&self) -> Option<Sample<JawState>> {
        let now = self.transport.now();
        let measured = self.feedback.jaw.fresh(now)?;
        let setpoint = self.feedback.jaw_setpoint.fresh(now)?;
        Some(Sample {
            value: JawState {
                angle: *measured.value.position.first()?,
                setpoint: *setpoint.value.position.first()?,
                effort: measured.value.effort.first().copied(),
            },
            stamp: measured.stamp,
            arrived: measured.arrived,
        })
    }

    /// The frames as they were found last.
    pub fn frames(&self) -> Option<&FrameCheck> {
        self.frames.as_ref()
    }

    /// Which point the arm reports, once it is known.
    pub fn control_point(&self) -> Option<ControlPoint> {
        self.frames.as_ref().map(|frames| frames.control_point)
    }

    /// Whether a motion is under way.
    pub fn is_moving(&self) -> bool {
        self.motion.is_some()
    }

    /// Why the last motion ended.
    pub fn last_stop(&self) -> Option<&Stop> {
        self.last_stop.as_ref()
    }

    /// What happened since the last call, oldest first; the last 256 at most.
    pub fn take_events(&mut self) -> Vec<Event> {
        self.events.drain(..).collect()
    }

    pub(crate) fn event(&mut self, time: Duration, kind: EventKind) {
        if self.events.len() >= EVENTS {
            self.events.pop_front();
        }
        self.events.push_back(Event { time, kind });
    }

    /// Keeps trouble with sending as an event: the watch on the set-point tells whether it mattered.
    pub(crate) fn note(&mut self, now: Duration, sent: Result<(), Error>) {
        if let Err(error) = sent {
            self.event(now, EventKind::Trouble(error.to_string()));
        }
    }

    /// Base frame by the newest samples, if they belong together.
    pub(crate) fn base_now(&self) -> Option<Isometry3<f64>> {
        const TOGETHER: Duration = Duration::from_millis(5);
        let local = self.feedback.local.as_ref()?.latest()?;
        let measured = self.feedback.measured.latest()?;
        let apart = local.stamp.abs_diff(measured.stamp);
        (apart <= TOGETHER).then(|| measured.value.pose * local.value.pose.inverse())
    }

    /// Gives the arm back: what moves is stopped and held, then the command topics are closed, so that the next client finds
    /// no other writer. The arm stays powered and enabled, the jaw stays as it is.
    pub fn release(mut self) {
        self.hold();
    }
}

fn six(sample: &Sample<super::stream::JointValues>) -> Option<Sample<[f64; 6]>> {
    Some(Sample {
        value: sample.value.position.as_slice().try_into().ok()?,
        stamp: sample.stamp,
        arrived: sample.arrived,
    })
}
