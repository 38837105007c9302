//! How messages get from one process to another, behind a trait: DDS for robots, memory for tests.
//!
//! ```text
//! topic      name · type · quality of service                    /PSM1/servo_cp · geometry_msgs/msg/PoseStamped · reliable
//! match      a reader hears a writer of the same name and type if the writer offers what the reader asks for:
//!            reliable ≥ best effort,  latched ≥ volatile         otherwise nothing arrives, without an error
//! clock      now() counts from the epoch, as stamps do, and never goes back
//! ```
//! [`Transport`] carries whole messages as bytes, so that one decoder, that of [`cdr`](crate::cdr), reads all of them.
//! Code built on it takes the time only from [`Transport::now`] and sleeps only in [`Transport::wait`]: on [`Bus`] it runs in
//! simulated time and does the same in every run.
//!
//! | transport | use |
//! |---|---|
//! | [`Bus`] | within one process, own clock |
//! | `Participant` (feature `ros2`) | ROS 2 on DDS |

mod bus;
#[cfg(feature = "ros2")]
mod dds;
mod network;
mod typed;

use std::time::Duration;

pub use bus::{Bus, BusNode};
#[cfg(feature = "ros2")]
pub use dds::Participant;
pub use network::{Interfaces, Network};
pub use typed::{Reader, Writer};

use crate::Error;
use crate::cdr::Message;

/// What a writer offers, or a reader asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Qos {
    /// Whether lost messages are sent again.
    pub reliable: bool,
    /// Whether readers that come later get the last messages (*transient local*).
    pub latched: bool,
    /// How many messages are kept for a reader that is slow or comes later.
    pub depth: u32,
}

impl Qos {
    /// What a dVRK offers for poses and joints, 100 times a second.
    pub const PERIODIC: Self = Self {
        reliable: true,
        latched: false,
        depth: 100,
    };
    /// What a dVRK offers for states and texts: the last ones reach whoever comes later.
    pub const EVENT: Self = Self {
        reliable: true,
        latched: true,
        depth: 100,
    };
    /// What a dVRK asks of commands: reliable, and only the last one counts.
    pub const COMMAND: Self = Self {
        reliable: true,
        latched: false,
        depth: 1,
    };
    /// For readers of what is sent all the time: hears every writer, and the newest message is the one that counts.
    pub const NEWEST: Self = Self {
        reliable: false,
        latched: false,
        depth: 10,
    };

    /// Whether a writer that offers `self` is heard by a reader that asks for `asked`.
    pub fn satisfies(self, asked: Self) -> bool {
        (self.reliable || !asked.reliable) && (self.latched || !asked.latched)
    }
}

/// Name, type and quality of service of what one end of a connection writes or reads.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct Topic {
    /// As in `/PSM1/measured_cp`.
    pub name: String,
    /// As in `geometry_msgs/msg/PoseStamped`.
    pub kind: &'static str,
    /// What is offered, or asked for.
    pub qos: Qos,
}

impl Topic {
    /// A topic of messages `M`.
    pub fn new<M: Message>(name: impl Into<String>, qos: Qos) -> Self {
        Self {
            name: name.into(),
            kind: M::TYPE,
            qos,
        }
    }
}

/// A reader or writer of a topic somewhere on the network.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct Peer {
    /// Its type, as in `geometry_msgs/msg/PoseStamped`.
    pub kind: String,
    /// What it offers or asks for; the depth is not known of others and 0.
    pub qos: Qos,
    /// Whether it belongs to this transport.
    pub own: bool,
}

/// Where topics are read and written. Handles stop when they are dropped.
pub trait Transport: Send + Sync {
    /// Time since the epoch, as in the stamps of messages.
    fn now(&self) -> Duration;

    /// Returns at `until`, or earlier, when a message may have come.
    fn wait(&self, until: Duration);

    /// Starts to listen.
    ///
    /// # Errors
    /// The network refuses.
    fn subscribe(&self, topic: &Topic) -> Result<Box<dyn Subscriber>, Error>;

    /// Starts to offer messages.
    ///
    /// # Errors
    /// The network refuses.
    fn advertise(&self, topic: &Topic) -> Result<Box<dyn Publisher>, Error>;

    /// Who writes a topic, whatever type and quality of service.
    fn writers(&self, name: &str) -> Vec<Peer>;

    /// Who reads a topic, whatever type and quality of service.
    fn readers(&self, name: &str) -> Vec<Peer>;
}

/// The reading end of a topic.
pub trait Subscriber: Send {
    /// The next message with its encapsulation header, if there is one.
    ///
    /// # Errors
    /// A message that came and cannot be had.
    fn take(&mut self) -> Result<Option<Vec<u8>>, Error>;
}

/// The writing end of a topic.
pub trait Publisher: Send {
    /// Sends a message with its encapsulation header.
    ///
    /// # Errors
    /// The message is not sent.
    fn publish(&mut self, message: Vec<u8>) -> Result<(), Error>;

    /// Whether every reliable reader has all that was sent. Those who do not know say yes.
    fn is_delivered(&self) -> bool {
        true
    }
}
