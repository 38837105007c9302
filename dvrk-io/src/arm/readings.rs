//! The feedback of an arm: its state, its joints and poses, its jaw.

use std::time::Duration;

use nalgebra::Isometry3;

use super::check::FrameCheck;
use super::driver::Arm;
use super::motion::Motion;
use super::options::LocalPose;
use super::state::{ArmStatus, ControlPoint, Dialect, Mode};
use super::stream::{JointValues, Sample, Velocity};
use super::topics::MOVES_THE_ARM;
use crate::kinematics::{RcmFromTip, RcmFromWrist};

/// Feedback of the jaw.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct JawState {
    /// Angle between the fingers, radians; 0 is closed, negative squeezes.
    pub angle: f64,
    /// The commanded angle.
    pub setpoint: f64,
    /// Torque, N·m, if the robot reports it.
    pub effort: Option<f64>,
}

impl JawState {
    /// By how much it is more open than commanded, because of something between the fingers.
    pub fn gap(&self) -> f64 {
        self.angle - self.setpoint
    }
}

impl Arm {
    /// Its state, as far as known.
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

    /// The instrument that it reports, if it does; empty without an instrument.
    pub fn tool(&self) -> Option<&str> {
        self.feedback.said().tool.as_deref()
    }

    /// Whether it is guided by hand.
    pub fn is_clutched(&self) -> bool {
        let status = self.status();
        let busy = status.mode == Mode::Enabled && status.busy;
        let ours = self.expect_busy || matches!(self.motion, Some(Motion::Move(_)));
        // Simulated arms are not guided by hand, and use busy differently.
        self.feedback.said().clutch || (busy && !ours && self.dialect() == Dialect::Robot)
    }

    /// Whether teleoperation is enabled at the console: it then commands arms without ROS and without arbitration.
    pub fn is_teleoperated(&self) -> bool {
        self.feedback.said().teleop
    }

    /// The topics on which another client can move this arm.
    pub fn other_writers(&self) -> Vec<String> {
        let topics = MOVES_THE_ARM.iter().map(|topic| self.names.of(topic));
        let others = |topic: &String| {
            let writers = self.transport.writers(topic);
            writers.iter().any(|writer| !writer.own)
        };
        topics.filter(others).collect()
    }

    /// Its six joint values, in the order of [`Joint::ALL`](crate::kinematics::Joint::ALL); `None` while they are stale.
    pub fn joints(&self) -> Option<Sample<[f64; 6]>> {
        six(self.feedback.joints.fresh(self.transport.now())?)
    }

    /// The commanded joint values, if reported.
    pub fn joint_setpoint(&self) -> Option<Sample<[f64; 6]>> {
        six(self.feedback.joint_setpoint.fresh(self.transport.now())?)
    }

    /// Measured pose of the tips; `None` while the stream is stale or the frames are unknown.
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

    /// Measured pose of the control point of a dVRK, whichever point the arm reports.
    pub fn rcm_from_wrist(&self) -> Option<Sample<RcmFromWrist>> {
        let tip = self.rcm_from_tip()?;
        Some(Sample {
            value: self.options.kinematics.wrist_of(&tip.value),
            stamp: tip.stamp,
            arrived: tip.arrived,
        })
    }

    /// Commanded pose of the tips.
    pub fn tip_setpoint(&self) -> Option<Sample<RcmFromTip>> {
        let frames = self.frames.as_ref()?;
        let sample = self.feedback.setpoint.fresh(self.transport.now())?;
        Some(Sample {
            value: frames.tip(&self.options.kinematics, &sample.value.pose),
            stamp: sample.stamp,
            arrived: sample.arrived,
        })
    }

    /// Velocity of the control point that the arm reports, in the axes of its reference frame, if reported.
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

    /// The frames from the last check.
    pub fn frames(&self) -> Option<&FrameCheck> {
        self.frames.as_ref()
    }

    /// Which point the arm reports, once known.
    pub fn control_point(&self) -> Option<ControlPoint> {
        self.frames.as_ref().map(|frames| frames.control_point)
    }

    /// Base frame from the newest samples, if they belong together.
    pub(crate) fn base_now(&self) -> Option<Isometry3<f64>> {
        const TOGETHER: Duration = Duration::from_millis(5);
        let local = self.feedback.local.as_ref()?.latest()?;
        let measured = self.feedback.measured.latest()?;
        let apart = local.stamp.abs_diff(measured.stamp);
        (apart <= TOGETHER).then(|| measured.value.pose * local.value.pose.inverse())
    }
}

fn six(sample: &Sample<JointValues>) -> Option<Sample<[f64; 6]>> {
    Some(Sample {
        value: sample.value.position.as_slice().try_into().ok()?,
        stamp: sample.stamp,
        arrived: sample.arrived,
    })
}
