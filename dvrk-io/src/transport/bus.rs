//! A transport within one process, with a clock that advances only in `wait`.
//!
//! ```text
//! wait(until)    until the end is reached or a message arrives:
//!                    now ← next full millisecond;  run every task that is due
//! ```
//! Tasks simulate other processes: a robot that publishes, a second client that commands. As they run in the order in which
//! they were added, at multiples of a millisecond, every run is the same.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use super::{Peer, Publisher, Qos, Subscriber, Topic, Transport};
use crate::Error;

/// Step of the clock.
const STEP: Duration = Duration::from_millis(1);
/// Time at which every bus starts: stamps of 0 mean "not measured".
const START: Duration = Duration::from_secs(1_000);

/// The bus: clock, endpoints and tasks. Clones refer to the same bus.
#[derive(Clone, Default)]
pub struct Bus {
    shared: Arc<Shared>,
}

impl std::fmt::Debug for Bus {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Bus").finish_non_exhaustive()
    }
}

#[derive(Default)]
struct Shared {
    state: Mutex<State>,
    tasks: Mutex<Vec<Task>>,
}

struct Task {
    period: Duration,
    due: Duration,
    run: Box<dyn FnMut(Duration) + Send>,
}

#[derive(Default)]
struct State {
    elapsed: Duration,
    nodes: usize,
    next_id: usize,
    readers: Vec<Endpoint>,
    writers: Vec<Endpoint>,
    arrived: bool,
}

struct Endpoint {
    id: usize,
    node: usize,
    topic: Topic,
    /// Messages that a reader has not taken yet, or that a writer keeps for later readers.
    messages: VecDeque<Vec<u8>>,
}

impl Endpoint {
    fn keep(&mut self, message: Vec<u8>) {
        if self.messages.len() >= self.topic.qos.depth.max(1) as usize {
            self.messages.pop_front();
        }
        self.messages.push_back(message);
    }

    fn hears(&self, writer: &Topic) -> bool {
        self.topic.name == writer.name
            && self.topic.kind == writer.kind
            && writer.qos.satisfies(self.topic.qos)
    }

    fn seen_by(&self, node: usize) -> Peer {
        Peer {
            kind: self.topic.kind.to_owned(),
            qos: Qos {
                depth: 0,
                ..self.topic.qos
            },
            own: self.node == node,
        }
    }
}

impl Shared {
    fn state(&self) -> MutexGuard<'_, State> {
        // The state is consistent even if a thread that held the lock panicked.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn tasks(&self) -> MutexGuard<'_, Vec<Task>> {
        self.tasks.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Bus {
    /// An empty bus.
    pub fn new() -> Self {
        Self::default()
    }

    /// A new participant: its endpoints are not `own` to others.
    pub fn node(&self) -> BusNode {
        let mut state = self.shared.state();
        state.nodes += 1;
        BusNode {
            node: state.nodes,
            shared: Arc::clone(&self.shared),
        }
    }

    /// Runs `task` with the time from now on every `period` (whole milliseconds), whenever time advances.
    pub fn every(&self, period: Duration, task: impl FnMut(Duration) + Send + 'static) {
        let due = self.now();
        self.shared.tasks().push(Task {
            period: period.max(STEP),
            due,
            run: Box::new(task),
        });
    }

    /// Time since the epoch.
    pub fn now(&self) -> Duration {
        START + self.shared.state().elapsed
    }

    /// Advances the time, whether messages arrive or not.
    pub fn advance(&self, time: Duration) {
        let end = self.now() + time;
        while self.now() < end {
            self.step(end);
        }
    }

    fn step(&self, end: Duration) {
        let now = {
            let mut state = self.shared.state();
            let next = (state.elapsed + STEP).min(end.saturating_sub(START));
            state.elapsed = state.elapsed.max(next);
            START + state.elapsed
        };
        // Tasks publish, so the state must not be locked while they run.
        for task in self.shared.tasks().iter_mut() {
            if task.due <= now {
                task.due += task.period;
                (task.run)(now);
            }
        }
    }
}

/// One participant on a [`Bus`].
pub struct BusNode {
    node: usize,
    shared: Arc<Shared>,
}

impl std::fmt::Debug for BusNode {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("BusNode")
            .field("node", &self.node)
            .finish_non_exhaustive()
    }
}

impl BusNode {
    fn bus(&self) -> Bus {
        Bus {
            shared: Arc::clone(&self.shared),
        }
    }

    fn endpoint(&self, state: &mut State, topic: &Topic) -> Endpoint {
        state.next_id += 1;
        Endpoint {
            id: state.next_id,
            node: self.node,
            topic: topic.clone(),
            messages: VecDeque::new(),
        }
    }

    fn handle(&self, id: usize) -> Handle {
        Handle {
            id,
            shared: Arc::clone(&self.shared),
        }
    }
}

impl Transport for BusNode {
    fn now(&self) -> Duration {
        self.bus().now()
    }

    fn wait(&self, until: Duration) {
        let bus = self.bus();
        while bus.now() < until && !std::mem::take(&mut self.shared.state().arrived) {
            bus.step(until);
        }
    }

    fn subscribe(&self, topic: &Topic) -> Result<Box<dyn Subscriber>, Error> {
        let mut state = self.shared.state();
        let mut reader = self.endpoint(&mut state, topic);
        if topic.qos.latched {
            for writer in &state.writers {
                if reader.hears(&writer.topic) {
                    writer
                        .messages
                        .iter()
                        .for_each(|message| reader.keep(message.clone()));
                }
            }
        }
        let handle = self.handle(reader.id);
        state.readers.push(reader);
        Ok(Box::new(handle))
    }

    fn advertise(&self, topic: &Topic) -> Result<Box<dyn Publisher>, Error> {
        let mut state = self.shared.state();
        let writer = self.endpoint(&mut state, topic);
        let handle = self.handle(writer.id);
        state.writers.push(writer);
        Ok(Box::new(handle))
    }

    fn writers(&self, name: &str) -> Vec<Peer> {
        peers(&self.shared.state().writers, name, self.node)
    }

    fn readers(&self, name: &str) -> Vec<Peer> {
        peers(&self.shared.state().readers, name, self.node)
    }
}

fn peers(endpoints: &[Endpoint], name: &str, node: usize) -> Vec<Peer> {
    let of_topic = endpoints
        .iter()
        .filter(|endpoint| endpoint.topic.name == name);
    of_topic.map(|endpoint| endpoint.seen_by(node)).collect()
}

/// A reader or writer, until it is dropped.
struct Handle {
    id: usize,
    shared: Arc<Shared>,
}

impl Drop for Handle {
    fn drop(&mut self) {
        let mut state = self.shared.state();
        let id = self.id;
        state.readers.retain(|endpoint| endpoint.id != id);
        state.writers.retain(|endpoint| endpoint.id != id);
    }
}

impl Subscriber for Handle {
    fn take(&mut self) -> Result<Option<Vec<u8>>, Error> {
        let mut state = self.shared.state();
        let own = state.readers.iter_mut().find(|reader| reader.id == self.id);
        Ok(own.and_then(|reader| reader.messages.pop_front()))
    }
}

impl Publisher for Handle {
    fn publish(&mut self, message: Vec<u8>) -> Result<(), Error> {
        let mut state = self.shared.state();
        let State {
            readers,
            writers,
            arrived,
            ..
        } = &mut *state;
        let Some(writer) = writers.iter_mut().find(|writer| writer.id == self.id) else {
            return Ok(());
        };
        for reader in readers.iter_mut() {
            if reader.hears(&writer.topic) {
                reader.keep(message.clone());
                *arrived = true;
            }
        }
        if writer.topic.qos.latched {
            writer.keep(message);
        }
        Ok(())
    }
}
