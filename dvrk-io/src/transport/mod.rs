//! Transport of messages between processes, behind a trait: DDS for robots, memory for tests.
//!
//! ```text
//! topic      name · type · quality of service                    /PSM1/servo_cp · geometry_msgs/msg/PoseStamped · reliable
//! match      a reader receives from a writer of the same name and type if the writer offers what the reader requests:
//!            reliable ≥ best effort,  latched ≥ volatile         otherwise nothing arrives, without an error
//! clock      now() is the time since the epoch, as in stamps, and is monotonic
//! ```
//! [`Transport`] carries whole messages as bytes, which are all decoded by [`cdr`](crate::cdr). Code built on it takes the time
//! only from [`Transport::now`] and sleeps only in [`Transport::wait`]: on [`Bus`] it therefore runs in simulated time,
//! reproducibly.
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

/// The quality of service that a writer offers, or a reader requests.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Qos {
    /// Whether lost messages are sent again.
    pub reliable: bool,
    /// Whether late readers get the last messages (*transient local*).
    pub latched: bool,
    /// How many messages are kept for a slow or late reader.
    pub depth: u32,
}

impl Qos {
    /// For poses and joints, published 100 times a second by a dVRK.
    pub const PERIODIC: Self = Self {
        reliable: true,
        latched: false,
        depth: 100,
    };
    /// For states and texts of a dVRK: late readers get the last ones.
    pub const EVENT: Self = Self {
        reliable: true,
        latched: true,
        depth: 100,
    };
    /// For commands to a dVRK: reliable, and only the last one counts.
    pub const COMMAND: Self = Self {
        reliable: true,
        latched: false,
        depth: 1,
    };
    /// For readers of periodic topics: compatible with every writer; only the newest message counts.
    pub const NEWEST: Self = Self {
        reliable: false,
        latched: false,
        depth: 10,
    };

    /// Whether a writer that offers `self` matches a reader that requests `asked`.
    pub fn satisfies(self, asked: Self) -> bool {
        (self.reliable || !asked.reliable) && (self.latched || !asked.latched)
    }
}

/// Name, type and quality of service of a topic, for a reader or writer.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Topic {
    /// For example `/PSM1/measured_cp`.
    pub name: String,
    /// For example `geometry_msgs/msg/PoseStamped`.
    pub kind: &'static str,
    /// The quality that is offered, or requested.
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
    /// Its type, for example `geometry_msgs/msg/PoseStamped`.
    pub kind: String,
    /// The quality that it offers or requests; the depth of others is unknown and 0.
    pub qos: Qos,
    /// Whether it belongs to this transport.
    pub own: bool,
}

/// A network on which topics are read and written. Handles stop when they are dropped.
pub trait Transport: Send + Sync {
    /// Time since the epoch, as in the stamps of messages.
    fn now(&self) -> Duration;

    /// Returns at `until`, or earlier if a message may have arrived.
    fn wait(&self, until: Duration);

    /// Starts to listen.
    ///
    /// # Errors
    /// The network reports an error.
    fn subscribe(&self, topic: &Topic) -> Result<Box<dyn Subscriber>, Error>;

    /// Starts to publish messages.
    ///
    /// # Errors
    /// The network reports an error.
    fn advertise(&self, topic: &Topic) -> Result<Box<dyn Publisher>, Error>;

    /// The writers of a topic, of any type and quality of service.
    fn writers(&self, name: &str) -> Vec<Peer>;

    /// The readers of a topic, of any type and quality of service.
    fn readers(&self, name: &str) -> Vec<Peer>;
}

/// The reading end of a topic.
pub trait Subscriber: Send {
    /// The next message with its encapsulation header, if there is one.
    ///
    /// # Errors
    /// A message arrived but could not be received.
    fn take(&mut self) -> Result<Option<Vec<u8>>, Error>;
}

/// The writing end of a topic.
pub trait Publisher: Send {
    /// Sends a message with its encapsulation header.
    ///
    /// # Errors
    /// The message is not sent.
    fn publish(&mut self, message: Vec<u8>) -> Result<(), Error>;

    /// Whether every reliable reader has received everything that was sent; true if unknown.
    fn is_delivered(&self) -> bool {
        true
    }
}
