//! The command topics of an arm: everything that moves it.

use std::time::Duration;

use nalgebra::Isometry3;

use super::feedback::MissingStream;
use super::stream::Absence;
use super::topics::{self, Names};
use crate::Error;
use crate::cdr::{Empty, Header, JointState, Message, Pose, PoseStamped, StringStamped, Time};
use crate::transport::{Qos, Transport, Writer};

pub(crate) struct Commands {
    state: Writer<StringStamped>,
    servo: Writer<PoseStamped>,
    move_to: Writer<PoseStamped>,
    jaw: Writer<JointState>,
    hold: Writer<Empty>,
}

impl Commands {
    pub(crate) fn new(transport: &dyn Transport, names: &Names) -> Result<Self, Error> {
        Ok(Self {
            state: Writer::new(transport, names.of(topics::STATE_COMMAND), Qos::COMMAND)?,
            servo: Writer::new(transport, names.of(topics::SERVO_CP), Qos::COMMAND)?,
            move_to: Writer::new(transport, names.of(topics::MOVE_CP), Qos::COMMAND)?,
            jaw: Writer::new(transport, names.of(topics::JAW_SERVO_JP), Qos::COMMAND)?,
            hold: Writer::new(transport, names.of(topics::HOLD), Qos::COMMAND)?,
        })
    }

    pub(crate) fn state(&mut self, now: Duration, command: &str) -> Result<(), Error> {
        self.state.publish(&StringStamped {
            header: header(now, ""),
            string: command.to_owned(),
        })
    }

    pub(crate) fn servo(
        &mut self,
        now: Duration,
        frame: &str,
        pose: &Isometry3<f64>,
    ) -> Result<(), Error> {
        self.servo.publish(&stamped(now, frame, pose))
    }

    pub(crate) fn move_to(
        &mut self,
        now: Duration,
        frame: &str,
        pose: &Isometry3<f64>,
    ) -> Result<(), Error> {
        self.move_to.publish(&stamped(now, frame, pose))
    }

    pub(crate) fn jaw(&mut self, now: Duration, angle: f64) -> Result<(), Error> {
        self.jaw.publish(&JointState {
            header: header(now, ""),
            name: vec!["jaw".to_owned()],
            position: vec![angle],
            ..JointState::default()
        })
    }

    pub(crate) fn hold(&mut self) -> Result<(), Error> {
        self.hold.publish(&Empty)
    }

    /// Command topics without a listener.
    pub(crate) fn missing(&self, transport: &dyn Transport) -> Vec<MissingStream> {
        fn of<M: Message>(writer: &Writer<M>, transport: &dyn Transport) -> Option<MissingStream> {
            let topic = writer.topic();
            let readers = transport.readers(&topic.name);
            let mut ours = readers.iter().filter(|reader| reader.kind == topic.kind);
            let reason = match (ours.next(), readers.first()) {
                (Some(_), _) => return None,
                (None, None) => Absence::NobodyListens,
                (None, Some(other)) => Absence::OtherType {
                    found: other.kind.clone(),
                },
            };
            Some(MissingStream {
                topic: topic.name.clone(),
                reason,
            })
        }
        let all = [
            of(&self.state, transport),
            of(&self.servo, transport),
            of(&self.move_to, transport),
            of(&self.jaw, transport),
            of(&self.hold, transport),
        ];
        all.into_iter().flatten().collect()
    }
}

pub(crate) fn header(now: Duration, frame: &str) -> Header {
    // 64-bit nanoseconds last until the year 2554.
    Header {
        stamp: Time::from_nanoseconds(u64::try_from(now.as_nanos()).unwrap_or(u64::MAX)),
        frame_id: frame.to_owned(),
    }
}

pub(crate) fn stamped(now: Duration, frame: &str, pose: &Isometry3<f64>) -> PoseStamped {
    PoseStamped {
        header: header(now, frame),
        pose: Pose::from(pose),
    }
}
