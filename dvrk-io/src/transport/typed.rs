//! Readers and writers of typed messages.

use std::fmt;
use std::marker::PhantomData;

use super::{Publisher, Qos, Subscriber, Topic, Transport};
use crate::Error;
use crate::cdr::{Endian, Message, decode, encode};

/// A reader or writer of bytes, with its topic.
struct End<T: ?Sized> {
    topic: Topic,
    inner: Box<T>,
}

impl<T: ?Sized> End<T> {
    fn open<M: Message>(
        name: impl Into<String>,
        qos: Qos,
        open: impl FnOnce(&Topic) -> Result<Box<T>, Error>,
    ) -> Result<Self, Error> {
        let topic = Topic::new::<M>(name, qos);
        let inner = open(&topic)?;
        Ok(Self { topic, inner })
    }

    fn on_topic(&self, error: Error) -> Error {
        Error::OnTopic {
            topic: self.topic.name.clone(),
            error: Box::new(error),
        }
    }

    fn debug(&self, name: &str, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct(name)
            .field("topic", &self.topic)
            .finish_non_exhaustive()
    }
}

/// Reads messages `M` of one topic.
pub struct Reader<M> {
    end: End<dyn Subscriber>,
    message: PhantomData<fn() -> M>,
}

impl<M> fmt::Debug for Reader<M> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.end.debug("Reader", f)
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
        Ok(Self {
            end: End::open::<M>(name, qos, |topic| transport.subscribe(topic))?,
            message: PhantomData,
        })
    }

    /// The topic it listens to.
    pub fn topic(&self) -> &Topic {
        &self.end.topic
    }

    /// The next message, if there is one.
    ///
    /// # Errors
    /// [`Error::OnTopic`]: a message that arrived but cannot be decoded. The next call continues with the message after it.
    pub fn take(&mut self) -> Result<Option<M>, Error> {
        let message = self.end.inner.take().and_then(|bytes| {
            let message = bytes.map(|bytes| decode(&bytes));
            message.transpose()
        });
        message.map_err(|error| self.end.on_topic(error))
    }

    /// The newest message since the last call; earlier ones are skipped.
    ///
    /// # Errors
    /// [`Error::OnTopic`]: it cannot be decoded.
    pub fn newest(&mut self) -> Result<Option<M>, Error> {
        let mut last = None;
        let taken = loop {
            match self.end.inner.take() {
                Ok(Some(bytes)) => last = Some(bytes),
                Ok(None) => break Ok(()),
                Err(error) => break Err(error),
            }
        };
        let message = last.map(|bytes| decode(&bytes)).transpose();
        taken.and(message).map_err(|error| self.end.on_topic(error))
    }
}

/// Writes messages `M` of one topic.
pub struct Writer<M> {
    end: End<dyn Publisher>,
    message: PhantomData<fn(M)>,
}

impl<M> fmt::Debug for Writer<M> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.end.debug("Writer", f)
    }
}

impl<M: Message> Writer<M> {
    /// Starts to publish on the topic `name`.
    ///
    /// # Errors
    /// See [`Transport::advertise`].
    pub fn new(
        transport: &dyn Transport,
        name: impl Into<String>,
        qos: Qos,
    ) -> Result<Self, Error> {
        Ok(Self {
            end: End::open::<M>(name, qos, |topic| transport.advertise(topic))?,
            message: PhantomData,
        })
    }

    /// The topic it publishes on.
    pub fn topic(&self) -> &Topic {
        &self.end.topic
    }

    /// Sends a message.
    ///
    /// # Errors
    /// [`Error::OnTopic`]: it cannot be encoded, or the network rejects it.
    pub fn publish(&mut self, message: &M) -> Result<(), Error> {
        let bytes = encode(message, Endian::Little);
        bytes
            .and_then(|bytes| self.end.inner.publish(bytes))
            .map_err(|error| self.end.on_topic(error))
    }

    /// Whether every reliable reader has received everything that was sent; parts of large messages may still be resent.
    pub fn is_delivered(&self) -> bool {
        self.end.inner.is_delivered()
    }
}
