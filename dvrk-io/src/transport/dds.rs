//! ROS 2 on DDS, by RustDDS.
//!
//! ```text
//! topic    /PSM1/measured_cp                   ⇒  rt/PSM1/measured_cp
//! type     geometry_msgs/msg/PoseStamped       ⇒  geometry_msgs::msg::dds_::PoseStamped_
//! payload  encapsulation header and CDR body, unchanged
//! ```
//! This module contains only what ROS 2 adds to DDS for topics: the bytes of [`cdr`](crate::cdr) are sent and received unchanged.
//!
//! *Limits.* `ros2 topic` shows these readers and writers; `ros2 node list` does not, as they announce no node. Services,
//! parameters and simulated time (`/clock`) are not supported.

use std::fmt::Display;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::task::{Wake, Waker};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use rustdds::bytes::Bytes;
use rustdds::discovery::DiscoveredWriterData;
use rustdds::no_key::{
    DataWriter, Decode, DefaultDecoder, DeserializedCacheChange, DeserializerAdapter,
    SerializerAdapter, SimpleDataReader,
};
use rustdds::policy::{Deadline, Durability, History, Reliability};
use rustdds::{
    DomainParticipant, DomainParticipantBuilder, GUID, QosPolicies, QosPolicyBuilder, RTPSEntity,
    RepresentationIdentifier, TopicKind,
};

use super::{Network, Peer, Publisher, Qos, Subscriber, Topic, Transport};
use crate::Error;
use crate::cdr::{Image, Message, PointCloud2};

/// Types with messages of megabytes, larger than a receive buffer.
const BIG: [&str; 2] = [PointCloud2::TYPE, Image::TYPE];
/// How long a command waits for space before it is dropped: less than the interval between two commands.
const MAX_BLOCKING: rustdds::Duration = rustdds::Duration::from_millis(5);
/// Requested buffer size of each socket: a cloud of 300,000 points has 6 MB, and arrives in one burst.
const SOCKET_BUFFER: usize = 16 << 20;
/// Deadline offered by writers of clouds and images, for its side effect: RustDDS resends 2 kB of lost data every
/// fifth of it, at most once a millisecond, and without a deadline every 10 ms: 0.2 MB/s. Readers request no
/// deadline, so they match, and RustDDS writers do not count missed deadlines.
const REPAIR_DEADLINE: rustdds::Duration = rustdds::Duration::from_millis(5);
/// How long a list of all writers is reused: it is copied as a whole, and a check for other commanders of an arm requests ten topics at once.
const WRITERS_SERVE: Duration = Duration::from_millis(10);
/// Bytes of the encapsulation header.
const HEADER: usize = 4;

/// A participant in a ROS 2 network. Clones are the same participant; every thread that waits should have its own.
pub struct Participant {
    shared: Arc<Shared>,
    /// Number of arrivals that this clone has woken up for.
    seen: AtomicU64,
}

impl std::fmt::Debug for Participant {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Participant").finish_non_exhaustive()
    }
}

struct Shared {
    participant: DomainParticipant,
    publisher: rustdds::Publisher,
    subscriber: rustdds::Subscriber,
    arrivals: Arc<Arrivals>,
    start: (Instant, Duration),
    writers: Mutex<Option<(Instant, Arc<[DiscoveredWriterData]>)>>,
}

impl Shared {
    /// Every writer on the network.
    fn writers(&self) -> Arc<[DiscoveredWriterData]> {
        let mut kept = self.writers.lock().unwrap_or_else(PoisonError::into_inner);
        match kept.as_ref() {
            Some((time, writers)) if time.elapsed() < WRITERS_SERVE => Arc::clone(writers),
            _ => {
                let writers: Arc<[_]> = self.participant.discovered_writers().into();
                *kept = Some((Instant::now(), Arc::clone(&writers)));
                writers
            }
        }
    }
}

/// Counts arrivals of messages, and wakes waiting threads.
#[derive(Default)]
struct Arrivals {
    count: Mutex<u64>,
    changed: Condvar,
}

impl Arrivals {
    fn count(&self) -> MutexGuard<'_, u64> {
        self.count.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Wake for Arrivals {
    fn wake(self: Arc<Self>) {
        *self.count() += 1;
        self.changed.notify_all();
    }
}

fn refused(what: &'static str, reason: impl Display) -> Error {
    Error::Network {
        what,
        reason: reason.to_string(),
    }
}

impl Participant {
    /// Joins a network.
    ///
    /// # Errors
    /// [`Error::Network`]: no socket, no thread.
    pub fn join(network: &Network) -> Result<Self, Error> {
        let mut builder = DomainParticipantBuilder::new(network.domain())
            .socket_receive_buffer_size(SOCKET_BUFFER)
            .socket_send_buffer_size(SOCKET_BUFFER);
        if let Some(addresses) = network.addresses() {
            builder = builder.with_only_networks(addresses);
        }
        let participant = builder
            .build()
            .map_err(|error| refused("participant", error))?;
        let qos = QosPolicies::qos_none();
        let publisher = participant
            .create_publisher(&qos)
            .map_err(|error| refused("publisher", error))?;
        let subscriber = participant
            .create_subscriber(&qos)
            .map_err(|error| refused("subscriber", error))?;
        // The wall clock may be adjusted while the program runs; from here on only its rate is used.
        let wall = SystemTime::now().duration_since(UNIX_EPOCH);
        let start = (Instant::now(), wall.unwrap_or_default());
        Ok(Self {
            shared: Arc::new(Shared {
                participant,
                publisher,
                subscriber,
                arrivals: Arc::default(),
                start,
                writers: Mutex::default(),
            }),
            seen: AtomicU64::new(0),
        })
    }

    fn topic(&self, topic: &Topic, qos: &QosPolicies) -> Result<rustdds::Topic, Error> {
        let created = self.shared.participant.create_topic(
            dds_name(&topic.name),
            dds_type(topic.kind),
            qos,
            TopicKind::NoKey,
        );
        created.map_err(|error| refused("topic", error))
    }

    fn is_own(&self, endpoint: GUID) -> bool {
        endpoint.prefix == self.shared.participant.guid().prefix
    }

    fn peer(&self, guid: GUID, kind: &str, reliable: bool, latched: bool) -> Peer {
        Peer {
            kind: ros_type(kind),
            qos: Qos {
                reliable,
                latched,
                depth: 0,
            },
            own: self.is_own(guid),
        }
    }
}

impl Clone for Participant {
    fn clone(&self) -> Self {
        Self {
            shared: Arc::clone(&self.shared),
            seen: AtomicU64::new(0),
        }
    }
}

impl Transport for Participant {
    fn now(&self) -> Duration {
        let (instant, wall) = self.shared.start;
        wall + instant.elapsed()
    }

    fn wait(&self, until: Duration) {
        let arrivals = &self.shared.arrivals;
        let mut count = arrivals.count();
        while *count == self.seen.load(Ordering::Relaxed) {
            let left = until.saturating_sub(self.now());
            if left.is_zero() {
                return;
            }
            let waited = arrivals.changed.wait_timeout(count, left);
            count = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
        self.seen.store(*count, Ordering::Relaxed);
    }

    fn subscribe(&self, topic: &Topic) -> Result<Box<dyn Subscriber>, Error> {
        let qos = policies(topic.qos).build();
        let created = self.topic(topic, &qos)?;
        let start = rustdds::Timestamp::now();
        let reader = self
            .shared
            .subscriber
            .create_simple_datareader_no_key::<Vec<u8>, Raw>(&created, Some(qos))
            .map_err(|error| refused("reader", error))?;
        Ok(Box::new(DdsReader {
            reader,
            waker: Arc::clone(&self.shared.arrivals).into(),
            shared: Arc::clone(&self.shared),
            start,
            new_only: topic.qos.reliable && !topic.qos.latched,
        }))
    }

    fn advertise(&self, topic: &Topic) -> Result<Box<dyn Publisher>, Error> {
        let policies = policies(topic.qos);
        let qos = if BIG.contains(&topic.kind) {
            policies.deadline(Deadline(REPAIR_DEADLINE)).build()
        } else {
            policies.build()
        };
        let created = self.topic(topic, &qos)?;
        let writer = self
            .shared
            .publisher
            .create_datawriter_no_key::<Vec<u8>, Raw>(&created, Some(qos))
            .map_err(|error| refused("writer", error))?;
        Ok(Box::new(DdsWriter { writer }))
    }

    fn writers(&self, name: &str) -> Vec<Peer> {
        let name = dds_name(name);
        let writers = self.shared.writers();
        let data = writers.iter().map(|writer| &writer.publication_topic_data);
        data.filter(|data| data.topic_name == name)
            .map(|data| {
                // By default writers are reliable and volatile.
                let reliable = data.reliability != Some(Reliability::BestEffort);
                let latched = !is_volatile(data.durability);
                self.peer(data.key, &data.type_name, reliable, latched)
            })
            .collect()
    }

    fn readers(&self, name: &str) -> Vec<Peer> {
        let name = dds_name(name);
        let readers = self.shared.participant.discovered_readers();
        let data = readers.iter().map(|reader| &reader.subscription_topic_data);
        data.filter(|data| data.topic_name() == &name)
            .map(|data| {
                let qos = data.qos();
                let latched = !is_volatile(qos.durability());
                self.peer(data.key(), data.type_name(), qos.is_reliable(), latched)
            })
            .collect()
    }
}

struct DdsReader {
    reader: SimpleDataReader<Vec<u8>, Raw>,
    waker: Waker,
    shared: Arc<Shared>,
    /// When it began to listen.
    start: rustdds::Timestamp,
    /// Whether it requested only new messages, and receives lost ones again.
    new_only: bool,
}

impl DdsReader {
    fn next(&self) -> Result<Option<Vec<u8>>, Error> {
        self.reader.drain_read_notifications();
        loop {
            let change = self.reader.try_take_one();
            match change.map_err(|error| refused("message", error))? {
                Some(change) if self.is_history(&change) => {}
                change => return Ok(change.map(DeserializedCacheChange::into_value)),
            }
        }
    }

    /// Whether a writer kept the message for late readers, although this reader did not request that: `RustDDS`
    /// writers send kept messages to every reliable reader. Judged by the clock of the writer, and only for writers that keep messages,
    /// so that messages from a clock that is behind are still received otherwise.
    fn is_history(&self, change: &DeserializedCacheChange<Vec<u8>>) -> bool {
        let before = |time: rustdds::Timestamp| time < self.start;
        if !self.new_only || !change.source_timestamp().is_some_and(before) {
            return false;
        }
        let writers = self.shared.participant.discovered_writers();
        let data = writers.iter().map(|writer| &writer.publication_topic_data);
        let mut sender = data.filter(|data| data.key == change.writer_guid());
        sender.any(|data| !is_volatile(data.durability))
    }
}

impl Subscriber for DdsReader {
    fn take(&mut self) -> Result<Option<Vec<u8>>, Error> {
        match self.next() {
            // A waker wakes once: it is set again, and then messages that arrived meanwhile are checked for.
            Ok(None) => {
                self.reader.set_waker(Some(self.waker.clone()));
                self.next()
            }
            other => other,
        }
    }
}

struct DdsWriter {
    writer: DataWriter<Vec<u8>, Raw>,
}

impl Publisher for DdsWriter {
    fn publish(&mut self, message: Vec<u8>) -> Result<(), Error> {
        self.writer
            .write(message, Some(rustdds::Timestamp::now()))
            .map_err(|error| refused("message", error))
    }

    fn is_delivered(&self) -> bool {
        let acknowledged = self.writer.wait_for_acknowledgments(Duration::ZERO);
        acknowledged.unwrap_or(true)
    }
}

/// Unchanged bytes, to be decoded elsewhere.
struct Raw;

#[derive(Clone)]
struct RawDecoder;

impl DeserializerAdapter<Vec<u8>> for Raw {
    type Error = Error;
    type Decoded = Vec<u8>;

    fn supported_encodings() -> &'static [RepresentationIdentifier] {
        &[
            RepresentationIdentifier::CDR_LE,
            RepresentationIdentifier::CDR_BE,
        ]
    }

    fn transform_decoded(decoded: Self::Decoded) -> Vec<u8> {
        decoded
    }
}

impl DefaultDecoder<Vec<u8>> for Raw {
    type Decoder = RawDecoder;
    const DECODER: RawDecoder = RawDecoder;
}

impl Decode<'_, Vec<u8>> for RawDecoder {
    type Error = Error;

    fn decode_bytes(
        self,
        body: &[u8],
        encoding: RepresentationIdentifier,
    ) -> Result<Vec<u8>, Error> {
        let little = u8::from(encoding == RepresentationIdentifier::CDR_LE);
        let mut message = Vec::with_capacity(HEADER + body.len());
        message.extend([0, little, 0, 0]);
        message.extend_from_slice(body);
        Ok(message)
    }
}

impl SerializerAdapter<Vec<u8>> for Raw {
    type Error = Error;

    fn output_encoding() -> RepresentationIdentifier {
        RepresentationIdentifier::CDR_LE
    }

    fn to_bytes(message: &Vec<u8>) -> Result<Bytes, Error> {
        match message.as_slice() {
            [0, 1, _, _, body @ ..] => Ok(Bytes::copy_from_slice(body)),
            other => Err(refused(
                "message",
                format!(
                    "{} bytes that do not start as little-endian CDR",
                    other.len()
                ),
            )),
        }
    }
}

/// Volatile is the default.
fn is_volatile(durability: Option<Durability>) -> bool {
    matches!(durability, None | Some(Durability::Volatile))
}

fn policies(qos: Qos) -> QosPolicyBuilder {
    let builder = QosPolicyBuilder::new().history(History::KeepLast {
        depth: i32::try_from(qos.depth.max(1)).unwrap_or(i32::MAX),
    });
    let builder = if qos.reliable {
        builder.reliable(MAX_BLOCKING)
    } else {
        builder.best_effort()
    };
    let durability = if qos.latched {
        Durability::TransientLocal
    } else {
        Durability::Volatile
    };
    builder.durability(durability)
}

fn dds_name(topic: &str) -> String {
    format!("rt/{}", topic.trim_start_matches('/'))
}

fn dds_type(kind: &str) -> String {
    let mut parts: Vec<_> = kind.split('/').collect();
    let name = parts.pop().unwrap_or_default();
    format!("{}::dds_::{name}_", parts.join("::"))
}

/// The reverse conversion; a type of another form is unchanged.
fn ros_type(kind: &str) -> String {
    let name = kind.strip_suffix('_').unwrap_or(kind);
    name.replace("::dds_::", "::").replace("::", "/")
}
