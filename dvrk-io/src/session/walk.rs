//! Iterates over all messages of a session, and handles each by its role.

use std::collections::BTreeMap;
use std::path::Path;

use super::frame::TopicCount;
use super::scan::{Channel, Event, Place, Scanner};
use super::skipped::{Skip, Skipped};
use super::source::Source;
use super::topic::{Role, Topics};
use crate::Error;

/// Type and number of messages of each topic.
type Counts = BTreeMap<String, (String, usize)>;

/// Reads every file of `source` and calls `take` with each message that has a role, and its channel. Messages that `take`
/// rejects are skipped, and so is damage. Counts the messages of every topic, and returns whether every file was
/// closed.
///
/// # Errors
/// A file cannot be read or is not an MCAP file; a topic with a role has another type; a given topic is in
/// none of the files.
pub(super) fn walk(
    source: &Source<'_>,
    topics: &Topics,
    wanted: impl Fn(&Role) -> bool,
    take: impl FnMut(&Role, &Channel, u64, Place, &[u8]) -> Result<(), Error>,
) -> Result<(Vec<TopicCount>, bool, Skipped), Error> {
    let mut walk = Walk {
        topics,
        wanted,
        take,
        counts: Counts::new(),
        skipped: Skipped::default(),
    };
    let mut complete = true;
    for part in 0..source.parts() {
        let mut scanner = Scanner::open(source, part)?;
        let file = source.path(part);
        while let Some(event) = scanner.next()? {
            walk.meet(event, &scanner, &file)?;
        }
        walk.declared(&scanner)?;
        complete &= scanner.complete();
    }
    walk.named_are_there()?;
    Ok((topic_counts(walk.counts), complete, walk.skipped))
}

struct Walk<'a, Wanted, Take> {
    topics: &'a Topics,
    wanted: Wanted,
    take: Take,
    counts: Counts,
    skipped: Skipped,
}

impl<Wanted, Take> Walk<'_, Wanted, Take>
where
    Wanted: Fn(&Role) -> bool,
    Take: FnMut(&Role, &Channel, u64, Place, &[u8]) -> Result<(), Error>,
{
    fn meet(&mut self, event: Event, scanner: &Scanner<'_>, file: &Path) -> Result<(), Error> {
        match event {
            Event::Message {
                channel,
                log_time,
                place,
            } => self.message(channel, log_time, place, scanner, file),
            Event::Skip {
                place,
                messages,
                reason,
            } => {
                self.skipped.add(skip(file, place, "", messages, reason));
                Ok(())
            }
        }
    }

    /// Counts a message and handles it.
    fn message(
        &mut self,
        id: u16,
        log_time: u64,
        place: Place,
        scanner: &Scanner<'_>,
        file: &Path,
    ) -> Result<(), Error> {
        let Some(channel) = scanner.channels().get(&id) else {
            let reason = format!("channel {id} is not declared");
            self.skipped.add(skip(file, place.record(), "", 1, reason));
            return Ok(());
        };
        *count(&mut self.counts, channel) += 1;
        let Some(role) = self.role(channel)? else {
            return Ok(());
        };
        if let Err(error) = (self.take)(&role, channel, log_time, place, scanner.data()) {
            let (place, reason) = (place.record(), error.to_string());
            self.skipped
                .add(skip(file, place, &channel.topic, 1, reason));
        }
        Ok(())
    }

    /// Topics without messages count too, and must have the right type.
    fn declared(&mut self, scanner: &Scanner<'_>) -> Result<(), Error> {
        for channel in scanner.channels().values() {
            count(&mut self.counts, channel);
            self.role(channel)?;
        }
        Ok(())
    }

    /// The role of a channel, if it is requested.
    ///
    /// # Errors
    /// A type that does not match the role.
    fn role(&self, channel: &Channel) -> Result<Option<Role>, Error> {
        let role = self.topics.role(&channel.topic).filter(&self.wanted);
        if let Some(role) = &role {
            check_type(role, channel)?;
        }
        Ok(role)
    }

    /// # Errors
    /// A given topic is in none of the files.
    fn named_are_there(&self) -> Result<(), Error> {
        let mut named = self
            .topics
            .renamed()
            .filter(|(role, _)| (self.wanted)(role));
        match named.find(|(_, name)| !self.counts.contains_key(name)) {
            Some((_, name)) => {
                let names: Vec<_> = self.counts.keys().map(String::as_str).collect();
                let (topic, available) = (name.clone(), names.join(", "));
                Err(Error::NoSuchTopic { topic, available })
            }
            None => Ok(()),
        }
    }
}

fn skip(file: &Path, place: Place, topic: &str, messages: usize, reason: String) -> Skip {
    Skip {
        file: file.to_owned(),
        byte: place.chunk.unwrap_or(place.at),
        byte_in_chunk: place.chunk.map(|_| place.at),
        topic: topic.to_owned(),
        messages,
        reason,
    }
}

fn count<'a>(counts: &'a mut Counts, channel: &Channel) -> &'a mut usize {
    // Two channels may have the same topic (if the recorder was restarted): they are counted together.
    if !counts.contains_key(&channel.topic) {
        counts.insert(channel.topic.clone(), (channel.type_name.clone(), 0));
    }
    &mut counts.entry(channel.topic.clone()).or_default().1
}

fn topic_counts(counts: Counts) -> Vec<TopicCount> {
    let topic = |(topic, (type_name, count))| TopicCount {
        topic,
        type_name,
        count,
    };
    counts.into_iter().map(topic).collect()
}

fn check_type(role: &Role, channel: &Channel) -> Result<(), Error> {
    for (found, expected) in [
        (&channel.encoding, "cdr"),
        (&channel.type_name, role.type_name()),
    ] {
        if found != expected {
            let (topic, found) = (channel.topic.clone(), found.clone());
            return Err(Error::WrongType {
                topic,
                found,
                expected,
            });
        }
    }
    Ok(())
}
