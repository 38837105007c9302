//! A topic that is published continuously: its newest valid sample, or why there is none.
//!
//! ```text
//! a sample counts  ⇔  stamp ≠ 0                                a dVRK marks unmeasured samples with 0
//!                  ∧  |now − stamp| ≤ stale                    no backlog, and synchronised clocks
//!                  ∧  stamp > that of the last one             a frozen publisher repeats itself
//!                  ∧  all numbers are finite
//! age = now − (arrival time of the newest one)
//! ```

use std::fmt;
use std::time::Duration;

use nalgebra::Isometry3;

use crate::Error;
use crate::cdr::{Header, JointState, Message, PoseStamped, TwistStamped};
use crate::kinematics::Joint;
use crate::transport::{Qos, Reader, Transport};

/// A measurement and its times since the epoch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample<T> {
    /// The measurement.
    pub value: T,
    /// Time of the measurement, by the clock of the sender.
    pub stamp: Duration,
    /// Arrival time, by the local clock.
    pub arrived: Duration,
}

/// Why a topic delivers nothing usable.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[non_exhaustive]
pub enum Absence {
    /// There is no publisher.
    NobodyPublishes,
    /// There is no listener: a command would be lost.
    NobodyListens,
    /// The topic is there with another type.
    OtherType {
        /// That type.
        found: String,
    },
    /// The topic exists, but its quality of service does not match the reader's.
    OtherQuality {
        /// What it lacks.
        lacks: &'static str,
    },
    /// There is a publisher, but no sample arrived.
    Silent,
    /// Samples have the stamp 0: not measured.
    Invalid,
    /// Samples are this old, seconds.
    Old(f64),
    /// Samples are this far in the future, seconds.
    Ahead(f64),
    /// Samples cannot be read.
    Unreadable(String),
}

impl fmt::Display for Absence {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NobodyPublishes => f.write_str("nobody publishes it"),
            Self::NobodyListens => f.write_str("nobody listens to it"),
            Self::OtherType { found } => write!(f, "it carries {found}"),
            Self::OtherQuality { lacks } => write!(f, "its publisher is not {lacks}"),
            Self::Silent => f.write_str("nothing came"),
            Self::Invalid => f.write_str("its samples are marked as not measured (stamp 0)"),
            Self::Old(age) => write!(
                f,
                "its samples are {age:.2} s old: are the clocks synchronised?"
            ),
            Self::Ahead(by) => write!(
                f,
                "its samples are {by:.2} s in the future: are the clocks synchronised?"
            ),
            Self::Unreadable(reason) => f.write_str(reason),
        }
    }
}

/// A message with a stamp, and its meaning.
pub(crate) trait Measurement: Message {
    type Value: Clone;

    fn header(&self) -> &Header;

    /// # Errors
    /// Numbers that are not finite.
    fn value(&self) -> Result<Self::Value, Error>;
}

/// A pose and its frame.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct FramedPose {
    pub(crate) frame: String,
    pub(crate) pose: Isometry3<f64>,
}

impl Measurement for PoseStamped {
    type Value = FramedPose;

    fn header(&self) -> &Header {
        &self.header
    }

    fn value(&self) -> Result<FramedPose, Error> {
        Ok(FramedPose {
            frame: self.header.frame_id.clone(),
            pose: self.pose.isometry()?,
        })
    }
}

/// Values of the joints or of the jaw, as many as were sent.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct JointValues {
    pub(crate) position: Vec<f64>,
    pub(crate) velocity: Vec<f64>,
    pub(crate) effort: Vec<f64>,
}

impl Measurement for JointState {
    type Value = JointValues;

    fn header(&self) -> &Header {
        &self.header
    }

    fn value(&self) -> Result<JointValues, Error> {
        // Sorted by name if the names are ours, as ROS allows any order.
        let place = |joint: Joint| self.name.iter().position(|name| name == joint.name());
        let order: Option<Vec<usize>> = Joint::ALL.into_iter().map(place).collect();
        let sorted = |values: &[f64]| -> Vec<f64> {
            let ours = order.as_ref().map(|order| {
                order
                    .iter()
                    .filter_map(|&index| values.get(index).copied())
                    .collect::<Vec<_>>()
            });
            match ours {
                Some(ours) if ours.len() == Joint::ALL.len() => ours,
                _ => values.to_vec(),
            }
        };
        if let Some(&value) = self.position.iter().find(|value| !value.is_finite()) {
            return Err(Error::OutOfRange {
                what: "joint value",
                value,
                expected: "must be finite",
            });
        }
        if self.position.is_empty() {
            return Err(Error::OutOfRange {
                what: "number of joint values",
                value: 0.0,
                expected: "must be at least 1",
            });
        }
        Ok(JointValues {
            position: sorted(&self.position),
            velocity: sorted(&self.velocity),
            effort: sorted(&self.effort),
        })
    }
}

/// Velocity of the control point.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Velocity {
    /// m/s.
    pub linear: [f64; 3],
    /// rad/s.
    pub angular: [f64; 3],
}

impl Measurement for TwistStamped {
    type Value = Velocity;

    fn header(&self) -> &Header {
        &self.header
    }

    fn value(&self) -> Result<Velocity, Error> {
        let mut values = self.linear.iter().chain(&self.angular);
        match values.find(|value| !value.is_finite()) {
            Some(&value) => Err(Error::OutOfRange {
                what: "velocity",
                value,
                expected: "must be finite",
            }),
            None => Ok(Velocity {
                linear: self.linear,
                angular: self.angular,
            }),
        }
    }
}

/// The newest valid sample of a topic.
pub(crate) struct Stream<M: Measurement> {
    reader: Reader<M>,
    stale: Duration,
    latest: Option<Sample<M::Value>>,
    /// Why the last message was rejected, if it was.
    trouble: Option<Absence>,
    heard: bool,
}

impl<M: Measurement> Stream<M> {
    pub(crate) fn new(
        transport: &dyn Transport,
        name: String,
        stale: Duration,
    ) -> Result<Self, Error> {
        Ok(Self {
            reader: Reader::new(transport, name, Qos::NEWEST)?,
            stale,
            latest: None,
            trouble: None,
            heard: false,
        })
    }

    pub(crate) fn name(&self) -> &str {
        &self.reader.topic().name
    }

    /// Reads new messages.
    pub(crate) fn poll(&mut self, now: Duration) {
        loop {
            match self.reader.take() {
                Ok(None) => return,
                Ok(Some(message)) => self.take(&message, now),
                Err(error) => self.trouble = Some(Absence::Unreadable(error.to_string())),
            }
        }
    }

    fn take(&mut self, message: &M, now: Duration) {
        self.heard = true;
        let stamp = Duration::from_nanos(message.header().stamp.nanoseconds());
        let trouble = if stamp.is_zero() {
            // The previous measurement is no longer valid.
            self.latest = None;
            Some(Absence::Invalid)
        } else if stamp + self.stale < now {
            Some(Absence::Old(now.saturating_sub(stamp).as_secs_f64()))
        } else if now + self.stale < stamp {
            Some(Absence::Ahead(stamp.saturating_sub(now).as_secs_f64()))
        } else {
            match message.value() {
                Err(error) => Some(Absence::Unreadable(error.to_string())),
                Ok(value) => {
                    let last = self.latest.as_ref().map(|sample| sample.stamp);
                    if last.is_none_or(|last| stamp > last) {
                        let arrived = now;
                        self.latest = Some(Sample {
                            value,
                            stamp,
                            arrived,
                        });
                    }
                    None
                }
            }
        };
        self.trouble = trouble;
    }

    /// The newest valid sample, however old.
    pub(crate) fn latest(&self) -> Option<&Sample<M::Value>> {
        self.latest.as_ref()
    }

    /// The newest sample, unless it is stale.
    pub(crate) fn fresh(&self, now: Duration) -> Option<&Sample<M::Value>> {
        let fresh = |sample: &&Sample<_>| sample.arrived + self.stale >= now;
        self.latest.as_ref().filter(fresh)
    }

    /// Why there is no usable sample; if `measured`, samples marked as not measured do not count.
    pub(crate) fn absence(
        &self,
        transport: &dyn Transport,
        now: Duration,
        measured: bool,
    ) -> Option<Absence> {
        if self.fresh(now).is_some() || (self.heard && !measured) {
            return None;
        }
        match &self.trouble {
            Some(trouble) => Some(trouble.clone()),
            None => Some(unheard(transport, &self.reader)),
        }
    }
}

/// Why nothing arrives from a topic.
pub(crate) fn unheard<M: Message>(transport: &dyn Transport, reader: &Reader<M>) -> Absence {
    let asked = reader.topic();
    let writers = transport.writers(&asked.name);
    let Some(first) = writers.first() else {
        return Absence::NobodyPublishes;
    };
    let of_type = |kind: &str| writers.iter().find(|writer| writer.kind == kind);
    match of_type(asked.kind) {
        None => Absence::OtherType {
            found: first.kind.clone(),
        },
        Some(writer) if !writer.qos.satisfies(asked.qos) => Absence::OtherQuality {
            lacks: if asked.qos.reliable && !writer.qos.reliable {
                "reliable"
            } else {
                "latched (transient local)"
            },
        },
        Some(_) => Absence::Silent,
    }
}
