//! Ends of a topic that speak messages instead of bytes.

use std::marker::PhantomData;

use super::{Publisher, Qos, Subscriber, Topic, Transport};
use crate::Error;
use crate::cdr::{Endian, Message, decode, encode};

/// Reads messages `M` of one topic.
pub struct Reader<M> {
    topic: Topic,
    inner: Box<dyn Subscriber>,
    message: PhantomData<fn() -> M>,
}

impl<M> std::fmt::Debug for Reader<M> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Reader")
            .field("topic", &self.topic)
            .finish_non_exhaustive()
    }
}

impl<M: Message> Reader<M> {
    /// Starts to listen to the topic `name`.
    ///
    /// # Errors
    /// See [`Transport::subscribe`].
    pub fn new(
        transport: &dyn Transport,
        name: impl Into<String>,
        qos: Qos,
    ) -> Result<Self, Error> {
        let topic = Topic::new::<M>(name, qos);
        let inner = transport.subscribe(&topic)?;
        Ok(Self {
            topic,
            inner,
            message: PhantomData,
        })
    }

    /// What it listens to.
    pub fn topic(&self) -> &Topic {
        &self.topic
    }

    /// The next message, if there is one.
    ///
    /// # Errors
    /// [`Error::OnTopic`]: a message that came and cannot be read. The next call looks at the one behind it.
    pub fn take(&mut self) -> Result<Option<M>, Error> {
        let message = self.inner.take().and_then(|bytes| {
            let message = bytes.map(|bytes| decode(&bytes));
            message.transpose()
        });
        message.map_err(|source| on(&self.topic, source))
    }

    /// The last message that came since the last call; those before it are passed over unread.
    ///
    /// # Errors
    /// [`Error::OnTopic`]: it cannot be read.
    pub fn newest(&mut self) -> Result<Option<M>, Error> {
        let mut last = None;
        let taken = loop {
            match self.inner.take() {
                Ok(Some(bytes)) => last = Some(bytes),
                Ok(None) => break Ok(()),
                Err(error) => break Err(error),
            }
        };
        let message = last.map(|bytes| decode(&bytes)).transpose();
        taken.and(message).map_err(|source| on(&self.topic, source))
    }
}

/// Writes messages `M` of one topic.
pub struct Writer<M> {
    topic: Topic,
    inner: Box<dyn Publisher>,
    message: PhantomData<fn(M)>,
}

impl<M> std::fmt::Debug for Writer<M> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Writer")
            .field("topic", &self.topic)
            .finish_non_exhaustive()
    }
}

impl<M: Message> Writer<M> {
    /// Offers the topic `name`.
    ///
    /// # Errors
    /// See [`Transport::advertise`].
    pub fn new(
        transport: &dyn Transport,
        name: impl Into<String>,
        qos: Qos,
    ) -> Result<Self, Error> {
        let topic = Topic::new::<M>(name, qos);
        let inner = transport.advertise(&topic)?;
        Ok(Self {
            topic,
            inner,
            message: PhantomData,
        })
    }

    /// What it writes to.
    pub fn topic(&self) -> &Topic {
        &self.topic
    }

    /// Sends a message.
    ///
    /// # Errors
    /// [`Error::OnTopic`]: it cannot be encoded, or the network does not take it.
    pub fn publish(&mut self, message: &M) -> Result<(), Error> {
        let bytes = encode(message, Endian::Little);
        bytes
            .and_then(|bytes| self.inner.publish(bytes))
            .map_err(|source| on(&self.topic, source))
    }
}

fn on(topic: &Topic, source: Error) -> Error {
    Error::OnTopic {
        topic: topic.name.clone(),
        source: Box::new(source),
    }
}
