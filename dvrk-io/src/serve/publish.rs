//! The publications of a served arm.

use std::time::Duration;

use nalgebra::{Isometry3, UnitQuaternion, Vector3};

use crate::Error;
use crate::arm::topics::{self, Names};
use crate::arm::{ArmStatus, Dialect, header, stamped};
use crate::cdr::{
    Bool, JointState, Joy, OperatingState, PoseStamped, StringStamped, Text, TwistStamped,
};
use crate::kinematics::Joint;
use crate::transport::{Qos, Transport, Writer};

/// Writers of texts, in one of two types.
enum Texts {
    Plain([Writer<Text>; 3]),
    Stamped([Writer<StringStamped>; 3]),
}

/// A kind of text.
#[derive(Debug, Clone, Copy)]
pub(super) enum Level {
    Error,
    Warning,
    Status,
}

pub(super) struct Publications {
    measured: Writer<PoseStamped>,
    setpoint: Writer<PoseStamped>,
    local_measured: Writer<PoseStamped>,
    local_setpoint: Writer<PoseStamped>,
    velocity: Writer<TwistStamped>,
    joints: Writer<JointState>,
    joint_setpoint: Writer<JointState>,
    jaw: Writer<JointState>,
    jaw_setpoint: Writer<JointState>,
    state: Writer<OperatingState>,
    tool: Writer<Text>,
    goal: Writer<Bool>,
    clutch: Writer<Joy>,
    texts: Texts,
    arm: String,
    last: Option<(Duration, Isometry3<f64>)>,
}

/// The data published 100 times a second.
pub(super) struct Periodic<'a> {
    /// 0 when nothing is measured.
    pub(super) stamp: Duration,
    pub(super) reference: &'a str,
    pub(super) base: &'a str,
    pub(super) measured: Isometry3<f64>,
    pub(super) setpoint: Isometry3<f64>,
    pub(super) local_measured: Isometry3<f64>,
    pub(super) local_setpoint: Isometry3<f64>,
    pub(super) joints: [f64; 6],
    pub(super) joint_setpoint: [f64; 6],
    /// Angle, set-point, effort.
    pub(super) jaw: [f64; 3],
}

impl Publications {
    pub(super) fn new(
        transport: &dyn Transport,
        arm: &str,
        dialect: Dialect,
    ) -> Result<Self, Error> {
        let names = Names::new(arm);
        // Simulators keep fewer events.
        let depth = match dialect {
            Dialect::Robot => Qos::EVENT.depth,
            Dialect::Simulator => 10,
        };
        let event = Qos {
            depth,
            ..Qos::EVENT
        };
        let pose = |topic| Writer::new(transport, names.of(topic), Qos::PERIODIC);
        let joints = |topic| Writer::new(transport, names.of(topic), Qos::PERIODIC);
        let texts = match dialect {
            Dialect::Robot => {
                let text = |topic| Writer::new(transport, names.of(topic), event);
                Texts::Plain([
                    text(topics::ERROR)?,
                    text(topics::WARNING)?,
                    text(topics::STATUS)?,
                ])
            }
            Dialect::Simulator => {
                let text = |topic| Writer::new(transport, names.of(topic), event);
                Texts::Stamped([
                    text(topics::ERROR)?,
                    text(topics::WARNING)?,
                    text(topics::INFO)?,
                ])
            }
        };
        Ok(Self {
            measured: pose(topics::MEASURED_CP)?,
            setpoint: pose(topics::SETPOINT_CP)?,
            local_measured: pose(topics::LOCAL_MEASURED_CP)?,
            local_setpoint: pose(topics::LOCAL_SETPOINT_CP)?,
            velocity: Writer::new(transport, names.of(topics::MEASURED_CV), Qos::PERIODIC)?,
            joints: joints(topics::MEASURED_JS)?,
            joint_setpoint: joints(topics::SETPOINT_JS)?,
            jaw: joints(topics::JAW_MEASURED_JS)?,
            jaw_setpoint: joints(topics::JAW_SETPOINT_JS)?,
            state: Writer::new(transport, names.of(topics::OPERATING_STATE), event)?,
            tool: Writer::new(transport, names.of(topics::TOOL_TYPE), event)?,
            goal: Writer::new(transport, names.of(topics::GOAL_REACHED), event)?,
            clutch: Writer::new(transport, names.of(topics::ARM_CLUTCH), event)?,
            texts,
            arm: arm.to_owned(),
            last: None,
        })
    }

    pub(super) fn periodic(&mut self, now: &Periodic<'_>) -> Result<(), Error> {
        let (stamp, reference, base) = (now.stamp, now.reference, now.base);
        self.measured
            .publish(&stamped(stamp, reference, &now.measured))?;
        self.setpoint
            .publish(&stamped(stamp, reference, &now.setpoint))?;
        self.local_measured
            .publish(&stamped(stamp, base, &now.local_measured))?;
        self.local_setpoint
            .publish(&stamped(stamp, base, &now.local_setpoint))?;
        let velocity = self.velocity_at(stamp, reference, &now.measured);
        self.velocity.publish(&velocity)?;
        self.joints.publish(&joint_state(stamp, &now.joints))?;
        self.joint_setpoint
            .publish(&joint_state(stamp, &now.joint_setpoint))?;
        let [angle, setpoint, effort] = now.jaw;
        let jaw = |position, velocity: &[f64]| JointState {
            header: header(stamp, ""),
            name: vec!["jaw".to_owned()],
            position: vec![position],
            velocity: velocity.to_vec(),
            effort: vec![effort],
        };
        self.jaw.publish(&jaw(angle, &[0.0]))?;
        self.jaw_setpoint.publish(&jaw(setpoint, &[]))
    }

    /// From the difference to the last pose.
    fn velocity_at(
        &mut self,
        stamp: Duration,
        reference: &str,
        pose: &Isometry3<f64>,
    ) -> TwistStamped {
        let (last, last_pose) = self.last.replace((stamp, *pose)).unwrap_or((stamp, *pose));
        let time = stamp.saturating_sub(last).as_secs_f64();
        let turn: UnitQuaternion<f64> = pose.rotation * last_pose.rotation.inverse();
        let shift = pose.translation.vector - last_pose.translation.vector;
        let rate = |change: Vector3<f64>| {
            if time > 0.0 {
                (change / time).into()
            } else {
                [0.0; 3]
            }
        };
        TwistStamped {
            header: header(stamp, reference),
            linear: rate(shift),
            angular: rate(turn.scaled_axis()),
        }
    }

    pub(super) fn state(&mut self, now: Duration, status: ArmStatus) -> Result<(), Error> {
        self.state.publish(&OperatingState {
            header: header(now, ""),
            state: status.mode.to_string(),
            is_homed: status.homed,
            is_busy: status.busy,
        })
    }

    pub(super) fn tool(&mut self, name: &str) -> Result<(), Error> {
        self.tool.publish(&Text {
            data: name.to_owned(),
        })
    }

    pub(super) fn goal(&mut self, reached: bool) -> Result<(), Error> {
        self.goal.publish(&Bool { data: reached })
    }

    pub(super) fn clutch(&mut self, now: Duration, pressed: bool) -> Result<(), Error> {
        self.clutch.publish(&Joy {
            header: header(now, ""),
            axes: Vec::new(),
            buttons: vec![i32::from(pressed)],
        })
    }

    pub(super) fn say(&mut self, now: Duration, level: Level, text: &str) -> Result<(), Error> {
        let text = format!("{}: {text}", self.arm);
        match &mut self.texts {
            Texts::Plain(writers) => writers[level as usize].publish(&Text { data: text }),
            Texts::Stamped(writers) => writers[level as usize].publish(&StringStamped {
                header: header(now, ""),
                string: text,
            }),
        }
    }
}

fn joint_state(stamp: Duration, joints: &[f64; 6]) -> JointState {
    JointState {
        header: header(stamp, ""),
        name: Joint::ALL.map(|joint| joint.name().to_owned()).to_vec(),
        position: joints.to_vec(),
        velocity: vec![0.0; 6],
        effort: vec![0.0; 6],
    }
}
