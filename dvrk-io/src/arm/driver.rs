//! An arm: connecting to it, checking its frames, storing its events, releasing it.

use std::sync::Arc;
use std::time::Duration;

use super::check::{FrameCheck, Frames, check_frames};
use super::commands::Commands;
use super::feedback::{Feedback, MissingStream};
use super::monitor::Monitor;
use super::motion::{LastSent, Motion};
use super::options::ArmOptions;
use super::state::{Event, EventKind, Mode};
use super::stop::Stop;
use super::topics::Names;
use crate::Error;
use crate::session::check_arm_name;
use crate::transport::Transport;

/// Number of events stored for [`Arm::take_events`]; older ones are dropped first.
const EVENTS: usize = 256;

/// A patient-side manipulator on a ROS 2 network, as driven by one client.
///
/// There is no hidden thread: messages are read, checked and answered in [`Arm::tick`], which the blocking calls repeat while
/// they block. To drive the arm while something else is computed, move it into an
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
    /// While an arm is being homed or powered, busy does not mean that it is guided by hand.
    pub(crate) expect_busy: bool,
    pub(crate) last_tick: Duration,
    /// When the last set-point was sent.
    pub(crate) last_sent: Duration,
    /// The last set-points, unless the motion was stopped: the reported pose lags behind them.
    pub(crate) sent: LastSent,
    pub(crate) writers_checked: Duration,
    /// The topic on which another publisher can command the arm, as of the last check.
    pub(crate) rival: Option<String>,
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
    /// Finds an arm, and returns when it can be read and commanded: every stream has delivered a sample, every command has a
    /// listener, and the state is known. While the arm is not powered it may mark its samples as not measured; once it is
    /// enabled they must be valid.
    ///
    /// Streams: `operating_state`, `measured_cp`, `setpoint_cp`, `local/measured_cp` (unless
    /// [`LocalPose::FromJoints`](super::LocalPose::FromJoints)), `measured_js`, `jaw/measured_js`, `jaw/setpoint_js`. Optional:
    /// `measured_cv`, `setpoint_js`, `tool_type`, `arm_clutch`, `goal_reached`, `error`, `warning`, `status`, `info` and
    /// the console's `teleop/enabled`.
    ///
    /// Allow 6 s: DDS delivers states that were published earlier only with its next heartbeat, up to 3 s later.
    ///
    /// # Errors
    /// [`Error::StreamsMissing`] lists each stream that is missing after `timeout`, and why; [`Error::BadArmName`];
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
            rival: None,
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

    /// Why the arm cannot be driven: streams without a fresh sample, commands without a listener. Empty if it
    /// can.
    pub fn missing(&self) -> Vec<MissingStream> {
        let transport = self.transport.as_ref();
        // Without power a dVRK has no poses; without an instrument, no valid ones.
        let measured = self.mode() == Mode::Enabled;
        let mut missing = self.feedback.missing(transport, transport.now(), measured);
        missing.extend(self.commands.missing(transport));
        missing
    }

    /// Its name, as in `PSM1`.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Its options.
    pub fn options(&self) -> &ArmOptions {
        &self.options
    }

    /// Compares the reported poses with the joint values, and determines the frames. Called by [`Arm::connect`] and
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

    /// The timeout error of an operation, with the last message of the arm.
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

    /// Stores a failure to send as an event; the check of the set-point decides whether it matters.
    pub(crate) fn note(&mut self, now: Duration, sent: Result<(), Error>) {
        if let Err(error) = sent {
            self.event(now, EventKind::Trouble(error.to_string()));
        }
    }

    /// Releases the arm: a motion is stopped and held, then the command topics are closed, so that the next client finds
    /// no other writer. The arm stays powered and enabled, the jaw is not moved.
    pub fn release(mut self) {
        self.hold();
    }
}
