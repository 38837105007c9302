//! The feedback topics of an arm, in both dialects.

use std::time::Duration;

use super::options::{ArmOptions, LocalPose};
use super::state::{ArmStatus, Dialect, EventKind};
use super::stream::{Absence, Measurement, Stream, unheard};
use super::topics::{self, Names};
use crate::Error;
use crate::cdr::{
    Bool, JointState, Joy, Message, OperatingState, PoseStamped, StringStamped, Text, TwistStamped,
};
use crate::transport::{Qos, Reader, Transport};

/// A stream that is missing, and why.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct MissingStream {
    /// Its topic.
    pub topic: String,
    /// Why it is missing.
    pub reason: Absence,
}

/// Text topics, with the kind of event of each.
type Texts<M> = Vec<(Reader<M>, fn(String) -> EventKind)>;

/// The feedback of an arm.
pub(crate) struct Feedback {
    pub(crate) measured: Stream<PoseStamped>,
    pub(crate) setpoint: Stream<PoseStamped>,
    pub(crate) local: Option<Stream<PoseStamped>>,
    pub(crate) velocity: Stream<TwistStamped>,
    pub(crate) joints: Stream<JointState>,
    pub(crate) joint_setpoint: Stream<JointState>,
    pub(crate) jaw: Stream<JointState>,
    pub(crate) jaw_setpoint: Stream<JointState>,
    state: Reader<OperatingState>,
    texts: Texts<Text>,
    stamped: Texts<StringStamped>,
    tool: Reader<Text>,
    goal: Reader<Bool>,
    clutch: Reader<Joy>,
    teleop: Reader<Bool>,
    said: Said,
    error_topic: String,
}

/// The last message of each event topic.
#[derive(Debug, Clone, Default)]
pub(crate) struct Said {
    pub(crate) status: Option<ArmStatus>,
    /// Number of state messages, to detect a new one.
    pub(crate) states: u64,
    pub(crate) goal: Option<bool>,
    pub(crate) clutch: bool,
    pub(crate) teleop: bool,
    pub(crate) tool: Option<String>,
}

impl Feedback {
    pub(crate) fn new(
        transport: &dyn Transport,
        names: &Names,
        options: &ArmOptions,
    ) -> Result<Self, Error> {
        let pose = |topic| Stream::new(transport, names.of(topic), options.stale);
        let joints = |topic| Stream::new(transport, names.of(topic), options.stale);
        // Messages from before the connection do not count: an old error must not stop a new motion.
        let from_now = Qos {
            latched: false,
            ..Qos::EVENT
        };
        let event = |topic| Reader::new(transport, names.of(topic), from_now);
        let stamped = |topic| Reader::new(transport, names.of(topic), from_now);
        Ok(Self {
            measured: pose(topics::MEASURED_CP)?,
            setpoint: pose(topics::SETPOINT_CP)?,
            local: match options.local {
                LocalPose::Published => Some(pose(topics::LOCAL_MEASURED_CP)?),
                LocalPose::FromJoints => None,
            },
            velocity: Stream::new(transport, names.of(topics::MEASURED_CV), options.stale)?,
            joints: joints(topics::MEASURED_JS)?,
            joint_setpoint: joints(topics::SETPOINT_JS)?,
            jaw: joints(topics::JAW_MEASURED_JS)?,
            jaw_setpoint: joints(topics::JAW_SETPOINT_JS)?,
            state: Reader::new(transport, names.of(topics::OPERATING_STATE), Qos::EVENT)?,
            texts: vec![
                (event(topics::ERROR)?, EventKind::Error),
                (event(topics::WARNING)?, EventKind::Warning),
                (event(topics::STATUS)?, EventKind::Info),
            ],
            stamped: vec![
                (stamped(topics::ERROR)?, EventKind::Error),
                (stamped(topics::WARNING)?, EventKind::Warning),
                (stamped(topics::INFO)?, EventKind::Info),
            ],
            tool: Reader::new(transport, names.of(topics::TOOL_TYPE), Qos::EVENT)?,
            goal: Reader::new(transport, names.of(topics::GOAL_REACHED), from_now)?,
            clutch: Reader::new(transport, names.of(topics::ARM_CLUTCH), Qos::EVENT)?,
            teleop: Reader::new(
                transport,
                format!("/{}/{}", options.console, topics::TELEOP_ENABLED),
                Qos::EVENT,
            )?,
            said: Said::default(),
            error_topic: names.of(topics::ERROR),
        })
    }

    /// Reads new messages, and appends events to `events`.
    pub(crate) fn poll(&mut self, now: Duration, events: &mut Vec<EventKind>) {
        self.measured.poll(now);
        self.setpoint.poll(now);
        if let Some(local) = &mut self.local {
            local.poll(now);
        }
        self.velocity.poll(now);
        self.joints.poll(now);
        self.joint_setpoint.poll(now);
        self.jaw.poll(now);
        self.jaw_setpoint.poll(now);
        // Texts before states, because they explain a change of state.
        for (reader, kind) in &mut self.texts {
            drain(reader, events, |text, events| events.push(kind(text.data)));
        }
        for (reader, kind) in &mut self.stamped {
            drain(reader, events, |text, events| {
                events.push(kind(text.string));
            });
        }
        let said = &mut self.said;
        drain(&mut self.state, events, |message, events| {
            let status = ArmStatus::from(&message);
            said.states += 1;
            if said.status != Some(status) {
                events.push(EventKind::Status(status));
            }
            said.status = Some(status);
        });
        drain(&mut self.tool, events, |tool, events| {
            events.push(EventKind::Tool(tool.data.clone()));
            said.tool = Some(tool.data);
        });
        drain(&mut self.goal, events, |goal, _| {
            said.goal = Some(goal.data);
        });
        drain(&mut self.clutch, events, |joy, _| {
            said.clutch = joy.is_pressed();
        });
        drain(&mut self.teleop, events, |teleop, _| {
            said.teleop = teleop.data;
        });
    }

    pub(crate) fn said(&self) -> &Said {
        &self.said
    }

    /// Forgets an old answer, so that the next one belongs to a new command.
    pub(crate) fn forget_goal(&mut self) {
        self.said.goal = None;
    }

    /// Whether it is a robot or a simulator: simulators put stamps on their errors.
    pub(crate) fn dialect(&self, transport: &dyn Transport) -> Dialect {
        let writers = transport.writers(&self.error_topic);
        if writers
            .iter()
            .any(|writer| writer.kind == StringStamped::TYPE)
        {
            Dialect::Simulator
        } else {
            Dialect::Robot
        }
    }

    /// The required streams without a valid sample; if `measured`, samples that are marked as not measured do not
    /// count.
    pub(crate) fn missing(
        &self,
        transport: &dyn Transport,
        now: Duration,
        measured: bool,
    ) -> Vec<MissingStream> {
        fn of<M: Measurement>(
            stream: &Stream<M>,
            (transport, now, measured): (&dyn Transport, Duration, bool),
        ) -> Option<MissingStream> {
            let reason = stream.absence(transport, now, measured)?;
            Some(MissingStream {
                topic: stream.name().to_owned(),
                reason,
            })
        }
        let at = (transport, now, measured);
        let state = self.said.status.is_none().then(|| MissingStream {
            topic: self.state.topic().name.clone(),
            reason: unheard(transport, &self.state),
        });
        let streams = [
            state,
            of(&self.measured, at),
            of(&self.setpoint, at),
            self.local.as_ref().and_then(|local| of(local, at)),
            of(&self.joints, at),
            of(&self.jaw, at),
            of(&self.jaw_setpoint, at),
        ];
        streams.into_iter().flatten().collect()
    }

    /// A required stream that has been silent for too long, and for how long.
    pub(crate) fn stale(&self, now: Duration, limit: Duration) -> Option<(String, f64)> {
        fn of<M: Measurement>(stream: &Stream<M>, now: Duration) -> (&str, Duration) {
            let age = stream
                .latest()
                .map_or(Duration::MAX, |sample| now.saturating_sub(sample.arrived));
            (stream.name(), age)
        }
        let local = self.local.as_ref().map(|local| of(local, now));
        let streams = [
            of(&self.measured, now),
            of(&self.setpoint, now),
            of(&self.joints, now),
            of(&self.jaw, now),
            of(&self.jaw_setpoint, now),
        ];
        let mut all = streams.into_iter().chain(local);
        let (name, age) = all.find(|&(_, age)| age > limit)?;
        // A stream that became invalid has no age.
        let age = if age == Duration::MAX {
            f64::INFINITY
        } else {
            age.as_secs_f64()
        };
        Some((name.to_owned(), age))
    }
}

/// All new messages of a topic; unreadable ones are reported and skipped.
fn drain<M: Message>(
    reader: &mut Reader<M>,
    events: &mut Vec<EventKind>,
    mut each: impl FnMut(M, &mut Vec<EventKind>),
) {
    loop {
        match reader.take() {
            Ok(None) => return,
            Ok(Some(message)) => each(message, events),
            Err(error) => events.push(EventKind::Trouble(error.to_string())),
        }
    }
}
