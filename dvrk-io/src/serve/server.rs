//! Serves one arm.

use std::time::Duration;

use nalgebra::Isometry3;

use super::machine::Machine;
use super::options::ServeOptions;
use super::plant::ServedArm;
use super::publish::{Level, Periodic, Publications};
use super::trajectory::Trajectory;
use crate::Error;
use crate::arm::topics::{self, Names};
use crate::arm::{ArmStatus, Dialect, Mode};
use crate::cdr::{Empty, JointState, Message, PoseStamped, StringStamped};
use crate::kinematics::{Joint, Kinematics, RcmFromTip, RcmFromWrist};
use crate::session::check_arm_name;
use crate::transport::{Qos, Reader, Transport};

/// A dVRK goes into FAULT when a joint is farther than this from its set-point: rad, m.
const TRACKING: [f64; 6] = [0.5, 0.5, 0.05, 0.6, 0.6, 0.6];
/// A warning about a command that comes too early is not repeated within this time.
const NOT_READY: Duration = Duration::from_secs(2);
/// Longest time step; longer gaps between ticks count as this.
const LONGEST_STEP: Duration = Duration::from_millis(50);
/// Distance of the wrist from the remote centre below which a dVRK moves the goal, metres.
const PUSHED_OUT: f64 = 0.045;

struct Commands {
    state: Reader<StringStamped>,
    servo: Reader<PoseStamped>,
    move_to: Reader<PoseStamped>,
    jaw_servo: Reader<JointState>,
    jaw_move: Reader<JointState>,
    hold: Reader<Empty>,
}

/// Serves one arm: receives commands, moves the simulated arm, publishes. See [`serve`](super).
pub struct ArmServer<A> {
    arm: A,
    options: ServeOptions,
    /// The same arm without limits, to find what must be clipped.
    free: Kinematics,
    base: String,
    commands: Commands,
    publications: Publications,
    machine: Machine,
    joints: [f64; 6],
    jaw: f64,
    trajectory: Option<Trajectory<6>>,
    jaw_trajectory: Option<Trajectory<1>>,
    clutched: bool,
    published: Option<ArmStatus>,
    /// As published last; empty for none.
    tool: Option<String>,
    last: Option<Duration>,
    due: Duration,
    warned: Duration,
}

impl<A> std::fmt::Debug for ArmServer<A> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ArmServer")
            .field("base", &self.base)
            .field("joints", &self.joints)
            .field("jaw", &self.jaw)
            .finish_non_exhaustive()
    }
}

impl<A: ServedArm> ArmServer<A> {
    /// Creates the topics of an arm, which [`ArmServer::tick`] then serves.
    ///
    /// # Errors
    /// [`Error::BadArmName`], [`Error::Network`], [`Error::OutOfRange`] for joint values that are not finite.
    pub fn new(
        transport: &dyn Transport,
        name: &str,
        mut arm: A,
        options: ServeOptions,
    ) -> Result<Self, Error> {
        check_arm_name(name)?;
        let names = Names::new(name);
        let free = options
            .kinematics
            .with_limits([
                [-100.0, 100.0],
                [-1.55, 1.55],
                [-100.0, 100.0],
                [-100.0, 100.0],
                [-1.57, 1.57],
                [-100.0, 100.0],
            ])?
            .with_min_wrist_distance(0.001)?;
        let start = options.kinematics.rcm_from_wrist(&options.joints)?;
        arm.follow(&start, options.jaw, Duration::ZERO);
        let commands = Commands {
            state: Reader::new(transport, names.of(topics::STATE_COMMAND), Qos::COMMAND)?,
            servo: Reader::new(transport, names.of(topics::SERVO_CP), Qos::COMMAND)?,
            move_to: Reader::new(transport, names.of(topics::MOVE_CP), Qos::COMMAND)?,
            jaw_servo: Reader::new(transport, names.of(topics::JAW_SERVO_JP), Qos::COMMAND)?,
            jaw_move: Reader::new(transport, names.of(topics::JAW_MOVE_JP), Qos::COMMAND)?,
            hold: Reader::new(transport, names.of(topics::HOLD), Qos::COMMAND)?,
        };
        Ok(Self {
            free,
            base: format!("{name}_base"),
            commands,
            publications: Publications::new(transport, name, options.dialect)?,
            machine: Machine::new(options.dialect),
            joints: options.joints,
            jaw: options.jaw,
            trajectory: None,
            jaw_trajectory: None,
            clutched: false,
            published: None,
            tool: None,
            last: None,
            due: Duration::ZERO,
            warned: Duration::ZERO,
            arm,
            options,
        })
    }

    /// The simulated arm.
    pub fn arm(&mut self) -> &mut A {
        &mut self.arm
    }

    /// The state that is published.
    pub fn status(&self) -> ArmStatus {
        let moving = self.trajectory.is_some() || self.jaw_trajectory.is_some() || self.clutched;
        self.machine.status(self.arm.tool().is_some(), moving)
    }

    /// Puts the arm into FAULT with an error, as after a tracking error.
    pub fn fail(&mut self, now: Duration, reason: &str) {
        self.abort();
        self.machine.fail();
        self.say(now, Level::Error, reason);
    }

    /// Presses or releases the button for guiding the arm by hand.
    pub fn clutch(&mut self, now: Duration, pressed: bool) {
        if self.clutched != pressed {
            self.clutched = pressed;
            self.abort();
            // A failure to publish only affects listeners.
            let _ = self.publications.clutch(now, pressed);
        }
    }

    /// Serves until `stop` returns true, on the clock of a transport.
    pub fn run(&mut self, transport: &dyn Transport, mut stop: impl FnMut() -> bool) {
        const STEP: Duration = Duration::from_millis(2);
        while !stop() {
            let now = transport.now();
            self.tick(now);
            transport.wait(now + STEP);
        }
    }

    /// Receives commands, moves the arm toward its set-point, publishes when due. To be called every millisecond or two.
    pub fn tick(&mut self, now: Duration) {
        let last = self.last.replace(now).unwrap_or(now);
        let time = now.saturating_sub(last).min(LONGEST_STEP);
        self.take_commands(now);
        self.machine.advance(now);
        self.advance(time);
        self.watch(now);
        self.publish_events(now);
        if now >= self.due {
            // After a gap the schedule restarts now; otherwise it is kept.
            let next = self.due + self.options.period;
            self.due = if next > now {
                next
            } else {
                now + self.options.period
            };
            self.publish_periodic(now);
        }
    }

    fn take_commands(&mut self, now: Duration) {
        if let Some(command) = newest(&mut self.commands.state) {
            let (powering, homing) = (self.options.powering, self.options.homing);
            let done = self.machine.command(&command.string, now, powering, homing);
            if self.machine.mode() != Mode::Enabled {
                self.abort();
            }
            match done {
                Ok(()) => {}
                Err(warning) => self.say(now, Level::Warning, &warning),
            }
        }
        if newest(&mut self.commands.hold).is_some() {
            self.abort();
        }
        if let Some(goal) = newest(&mut self.commands.servo)
            && let Some(joints) = self.goal(now, &goal, topics::SERVO_CP)
        {
            self.abort();
            self.joints = joints;
        }
        if let Some(goal) = newest(&mut self.commands.move_to)
            && let Some(joints) = self.goal(now, &goal, topics::MOVE_CP)
        {
            self.abort();
            self.trajectory = Trajectory::of_joints(self.joints, joints).ok();
        }
        if let Some(goal) = newest(&mut self.commands.jaw_servo)
            && let Some(angle) = self.jaw_goal(now, &goal, topics::JAW_SERVO_JP)
        {
            self.jaw_trajectory = None;
            self.jaw = angle;
        }
        if let Some(goal) = newest(&mut self.commands.jaw_move)
            && let Some(angle) = self.jaw_goal(now, &goal, topics::JAW_MOVE_JP)
        {
            self.jaw_trajectory = Trajectory::of_jaw(self.jaw, angle).ok();
        }
    }

    /// Aborts trajectories.
    fn abort(&mut self) {
        if self.trajectory.take().is_some() {
            let _ = self.publications.goal(false);
        }
        self.jaw_trajectory = None;
    }

    fn is_ready(&mut self, now: Duration, command: &str) -> bool {
        let ready =
            self.machine.mode() == Mode::Enabled && self.arm.tool().is_some() && !self.clutched;
        if !ready && now >= self.warned + NOT_READY {
            self.warned = now;
            self.say(now, Level::Warning, &format!("{command}, arm not ready"));
        }
        ready
    }

    /// Joint values for an accepted goal.
    fn goal(&mut self, now: Duration, goal: &PoseStamped, command: &str) -> Option<[f64; 6]> {
        if !self.is_ready(now, command) {
            return None;
        }
        let solved = goal.pose.isometry().and_then(|pose| self.solve(&pose));
        match solved {
            Ok(joints) => Some(joints),
            Err(error) => {
                let text = format!("{command}: unable to solve inverse kinematics ({error})");
                self.say(now, Level::Error, &text);
                if command == topics::MOVE_CP {
                    let _ = self.publications.goal(false);
                }
                None
            }
        }
    }

    fn solve(&self, reference_from_point: &Isometry3<f64>) -> Result<[f64; 6], Error> {
        let local = self.options.reference_from_rcm.0.inverse() * reference_from_point;
        let kinematics = &self.options.kinematics;
        if self.options.dialect == Dialect::Simulator {
            let wrist = kinematics.wrist_of(&RcmFromTip(local));
            return Ok(kinematics.inverse_near(&wrist, &self.joints)?.joints);
        }
        let reach = self.free.inverse_near(&RcmFromWrist(local), &self.joints)?;
        // A robot clips silently.
        let mut joints = reach.joints;
        for (value, [lower, upper]) in joints.iter_mut().zip(*kinematics.limits()) {
            *value = value.clamp(lower, upper);
        }
        let inner = PUSHED_OUT + kinematics.wrist_before_insertion();
        joints[2] = joints[2].max(inner);
        Ok(joints)
    }

    fn jaw_goal(&mut self, now: Duration, goal: &JointState, command: &str) -> Option<f64> {
        if !self.is_ready(now, command) {
            return None;
        }
        let [lower, upper] = self.options.jaw_range;
        let angle = *goal.position.first().filter(|angle| angle.is_finite())?;
        if self.options.dialect == Dialect::Simulator && !(lower..=upper).contains(&angle) {
            self.say(now, Level::Error, &format!("{command}: jaw out of range"));
            return None;
        }
        Some(angle.max(lower).min(upper))
    }

    fn advance(&mut self, time: Duration) {
        if let Some(trajectory) = &mut self.trajectory {
            self.joints = trajectory.advance(time);
            if trajectory.is_done() {
                self.trajectory = None;
                let _ = self.publications.goal(true);
            }
        }
        if let Some(trajectory) = &mut self.jaw_trajectory {
            [self.jaw] = trajectory.advance(time);
            if trajectory.is_done() {
                self.jaw_trajectory = None;
            }
        }
        if self.machine.mode() == Mode::Enabled
            && let Ok(wrist) = self.options.kinematics.rcm_from_wrist(&self.joints)
        {
            self.arm.follow(&wrist, self.jaw, time);
        }
    }

    /// Joint values of the arm's pose; those of the set-point where the pose is unreachable.
    fn measured(&self) -> [f64; 6] {
        let reach = self
            .free
            .inverse_near(&self.arm.rcm_from_wrist(), &self.joints);
        reach.map_or(self.joints, |reach| reach.joints)
    }

    fn watch(&mut self, now: Duration) {
        if let Some(reason) = self.arm.fault() {
            self.fail(now, &reason);
        }
        if self.machine.mode() != Mode::Enabled {
            return;
        }
        let measured = self.measured();
        let behind = (0..6).find(|&i| (measured[i] - self.joints[i]).abs() > TRACKING[i]);
        if let Some(index) = behind {
            let joint = Joint::ALL[index];
            self.fail(now, &format!("received [PID: tracking error, {joint}]"));
        }
    }

    fn publish_events(&mut self, now: Duration) {
        let tool = self.arm.tool().unwrap_or_default();
        if self.tool.as_ref() != Some(&tool) {
            let _ = self.publications.tool(&tool);
            self.tool = Some(tool);
        }
        let status = self.status();
        if self.published != Some(status) {
            if self.published.map(|last| last.mode) != Some(status.mode) {
                self.say(now, Level::Status, &format!("state is {}", status.mode));
            }
            let _ = self.publications.state(now, status);
            self.published = Some(status);
        }
    }

    fn publish_periodic(&mut self, now: Duration) {
        // A robot without power does not measure its joints: it publishes the poses of zero joints, with stamp 0.
        let powered = self.machine.is_powered();
        let (measured, setpoint) = if powered {
            (self.measured(), self.joints)
        } else {
            ([0.0; 6], [0.0; 6])
        };
        let kinematics = &self.options.kinematics;
        let local = |joints: &[f64; 6]| {
            let wrist = kinematics.rcm_from_wrist(joints);
            let wrist = wrist.unwrap_or(RcmFromWrist(Isometry3::identity()));
            match self.options.dialect {
                Dialect::Robot => wrist.0,
                Dialect::Simulator => kinematics.tip_of(&wrist).0,
            }
        };
        let base = self.options.reference_from_rcm.0;
        let (local_measured, local_setpoint) = (local(&measured), local(&setpoint));
        let reference = self.options.reference.as_deref().unwrap_or(&self.base);
        let periodic = Periodic {
            stamp: if powered { now } else { Duration::ZERO },
            reference,
            base: &self.base,
            measured: base * local_measured,
            setpoint: base * local_setpoint,
            local_measured,
            local_setpoint,
            joints: measured,
            joint_setpoint: setpoint,
            jaw: [self.arm.jaw(), self.jaw, self.arm.jaw_effort()],
        };
        // A message that the network rejects is missed by the client.
        let _ = self.publications.periodic(&periodic);
    }

    fn say(&mut self, now: Duration, level: Level, text: &str) {
        let _ = self.publications.say(now, level, text);
    }
}

/// The last message; a robot keeps no more. Unreadable ones are skipped.
fn newest<M: Message>(reader: &mut Reader<M>) -> Option<M> {
    reader.newest().ok().flatten()
}
