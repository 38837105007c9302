//! Iterates over the records of an MCAP file, even a damaged one.
//!
//! ```text
//! file   = magic · record*           record = opcode(u8) · length(u64) · body
//! chunk  = times · sizes · crc · compression · record*
//! ```
//!
//! A record is in memory only while it is processed, a chunk only while it is read and only if it is compressed or
//! small; the rest stays in the file. The readers of the `mcap` crate are not used for three reasons: they
//! decompress with C libraries; they stop before a chunk that a killed recorder left incomplete, although its first
//! messages are intact; and they trust lengths (a damaged attachment panics, a damaged string reserves 4 GB).
//!
//! Damage is handled locally: an invalid record is skipped, and so is a chunk with a wrong checksum, because it is
//! unknown which of its messages are intact. Only the end of the bytes ends the iteration.

use std::collections::BTreeMap;

use super::chunk::{self, Chunk};
use super::fields::Fields;
use super::source::{Input, Source};
use crate::Error;

pub(super) const MAGIC: &[u8] = b"\x89MCAP0\r\n";
pub(super) const FOOTER: u8 = 0x02;
pub(super) const SCHEMA: u8 = 0x03;
pub(super) const CHANNEL: u8 = 0x04;
pub(super) const MESSAGE: u8 = 0x05;
pub(super) const CHUNK: u8 = 0x06;

/// Opcode and length before each body.
pub(super) const HEADER: u64 = 9;
/// Channel, sequence and two times before the data of a message.
const MESSAGE_HEADER: u64 = 2 + 4 + 8 + 8;
/// Largest message that is read: a cloud of four million points.
const LARGEST_MESSAGE: u64 = 128 << 20;
/// Names are at the start of their records; at most this many bytes are read.
const LARGEST_NAMES: u64 = 1 << 16;

/// A topic of the file.
#[derive(Debug, Clone)]
pub(super) struct Channel {
    pub(super) topic: String,
    /// ROS 2 type of the messages, empty if the file does not state it.
    pub(super) type_name: String,
    pub(super) encoding: String,
}

/// The position of the data of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Place {
    pub(super) part: usize,
    /// The compressed chunk that contains it, by its offset in the file.
    pub(super) chunk: Option<u64>,
    /// Offset in the file, or in the decompressed chunk.
    pub(super) at: u64,
    pub(super) length: u64,
}

impl Place {
    /// The position of the record of a message, instead of its data.
    pub(super) fn record(self) -> Self {
        let at = self.at.saturating_sub(HEADER + MESSAGE_HEADER);
        Self { at, ..self }
    }
}

/// A result of the iteration.
#[derive(Debug)]
pub(super) enum Event {
    /// A message; [`Scanner::data`] holds it until the next event.
    Message {
        channel: u16,
        /// Nanoseconds.
        log_time: u64,
        place: Place,
    },
    /// Something was skipped.
    Skip {
        place: Place,
        messages: usize,
        reason: String,
    },
}

/// The iteration over one file.
pub(super) struct Scanner<'a> {
    input: Input<'a>,
    part: usize,
    /// Next record outside of chunks.
    at: u64,
    chunk: Option<Chunk>,
    schemas: BTreeMap<u16, String>,
    channels: BTreeMap<u16, Channel>,
    body: Vec<u8>,
    complete: bool,
}

/// A record header.
#[derive(Clone, Copy)]
pub(super) struct Record {
    pub(super) opcode: u8,
    /// Offset of the body.
    pub(super) at: u64,
    pub(super) length: u64,
    /// Whether the body is complete.
    pub(super) whole: bool,
}

impl<'a> Scanner<'a> {
    /// # Errors
    /// The file cannot be read, or does not start like an MCAP file.
    pub(super) fn open(source: &Source<'a>, part: usize) -> Result<Self, Error> {
        let mut input = source.open(part)?;
        let mut body = Vec::new();
        input.read(0, MAGIC.len() as u64, &mut body)?;
        if body != MAGIC {
            let path = input.path().to_owned();
            return Err(Error::NotMcap { path });
        }
        let mut scanner = Self {
            input,
            part,
            at: MAGIC.len() as u64,
            chunk: None,
            schemas: BTreeMap::new(),
            channels: BTreeMap::new(),
            body,
            complete: false,
        };
        scanner.read_summary()?;
        Ok(scanner)
    }

    pub(super) fn channels(&self) -> &BTreeMap<u16, Channel> {
        &self.channels
    }

    /// Whether the footer was reached: the recorder closed the file.
    pub(super) fn complete(&self) -> bool {
        self.complete
    }

    /// The message of the last event.
    pub(super) fn data(&self) -> &[u8] {
        self.body.get(MESSAGE_HEADER as usize..).unwrap_or_default()
    }

    /// The next message or damage; `None` at the end of the file, or of its intact part.
    ///
    /// # Errors
    /// The file cannot be read.
    pub(super) fn next(&mut self) -> Result<Option<Event>, Error> {
        loop {
            let event = if let Some(mut chunk) = self.chunk.take() {
                let Some(record) = chunk.record(&mut self.input, &mut self.body)? else {
                    continue;
                };
                let event = self.chunk_record(&chunk, record)?;
                self.chunk = Some(chunk);
                event
            } else {
                let Some(record) = self.record()? else {
                    return Ok(None);
                };
                self.plain_record(record)?
            };
            if event.is_some() {
                return Ok(event);
            }
        }
    }

    /// The next record outside of chunks; `None` after the footer. An incomplete record is returned only if it is a chunk.
    fn record(&mut self) -> Result<Option<Record>, Error> {
        if self.complete {
            return Ok(None);
        }
        let end = self.input.length();
        self.input.read(self.at, HEADER, &mut self.body)?;
        let Some(record) = Record::parse(&self.body, self.at, end) else {
            return Ok(None);
        };
        self.at = record.end(end);
        self.complete = record.whole && record.opcode == FOOTER;
        let usable = record.whole || record.opcode == CHUNK;
        Ok(Some(record).filter(|_| usable))
    }

    fn plain_record(&mut self, record: Record) -> Result<Option<Event>, Error> {
        let place = self.place(None, record.at - HEADER, record.length);
        if record.opcode == CHUNK {
            return match chunk::open(&mut self.input, record, &mut self.body)? {
                Ok(chunk) => {
                    self.chunk = Some(chunk);
                    Ok(None)
                }
                Err(damage) => Ok(Some(Event::Skip {
                    place,
                    messages: damage.messages,
                    reason: damage.reason,
                })),
            };
        }
        let Some(length) = body_length(record) else {
            return Ok((record.opcode == MESSAGE).then(|| too_large(place)));
        };
        self.input.read(record.at, length, &mut self.body)?;
        Ok(self.body(record, place))
    }

    fn chunk_record(&mut self, chunk: &Chunk, record: Record) -> Result<Option<Event>, Error> {
        let place = self.place(chunk.compressed_at(), record.at - HEADER, record.length);
        if !record.whole {
            // In a truncated file the recorder was killed here.
            let reason = "record is longer than its chunk".to_owned();
            return Ok(chunk.whole.then_some(Event::Skip {
                place,
                messages: 0,
                reason,
            }));
        }
        let Some(length) = body_length(record) else {
            return Ok((record.opcode == MESSAGE).then(|| too_large(place)));
        };
        chunk.read(&mut self.input, record.at, length, &mut self.body)?;
        Ok(self.body(record, place))
    }

    fn place(&self, chunk: Option<u64>, at: u64, length: u64) -> Place {
        let part = self.part;
        Place {
            part,
            chunk,
            at,
            length,
        }
    }

    /// Processes the record whose body was read.
    fn body(&mut self, record: Record, place: Place) -> Option<Event> {
        let taken = match record.opcode {
            SCHEMA => self.schema(),
            CHANNEL => self.channel(),
            MESSAGE => match self.message() {
                None => None,
                Some((channel, log_time)) => {
                    let (at, length) = (record.at + MESSAGE_HEADER, record.length - MESSAGE_HEADER);
                    let place = Place {
                        at,
                        length,
                        ..place
                    };
                    return Some(Event::Message {
                        channel,
                        log_time,
                        place,
                    });
                }
            },
            _ => Some(()),
        };
        if taken.is_some() {
            return None;
        }
        let opcode = record.opcode;
        Some(Event::Skip {
            place,
            messages: usize::from(opcode == MESSAGE),
            reason: format!(
                "fields of the record with opcode {opcode:#04x} do not fit, or a name is not UTF-8"
            ),
        })
    }

    fn schema(&mut self) -> Option<()> {
        let mut fields = Fields::new(&self.body);
        let (id, name) = (fields.u16()?, fields.text()?);
        self.schemas.insert(id, name.to_owned());
        Some(())
    }

    fn channel(&mut self) -> Option<()> {
        let mut fields = Fields::new(&self.body);
        let (id, schema) = (fields.u16()?, fields.u16()?);
        let (topic, encoding) = (fields.text()?.to_owned(), fields.text()?.to_owned());
        let type_name = self.schemas.get(&schema).cloned().unwrap_or_default();
        let channel = Channel {
            topic,
            type_name,
            encoding,
        };
        self.channels.insert(id, channel);
        Some(())
    }

    fn message(&self) -> Option<(u16, u64)> {
        let mut fields = Fields::new(&self.body);
        let (channel, _sequence) = (fields.u16()?, fields.u32()?);
        let (log_time, _publish_time) = (fields.u64()?, fields.u64()?);
        Some((channel, log_time))
    }

    /// Reads the topics from the summary at the end of a closed file, if it has one, so that messages after a damaged
    /// chunk are known even if their topics were declared in it.
    fn read_summary(&mut self) -> Result<(), Error> {
        const FOOTER_BODY: u64 = 8 + 8 + 4;
        let tail = HEADER + FOOTER_BODY + MAGIC.len() as u64;
        let Some(footer) = self.input.length().checked_sub(tail) else {
            return Ok(());
        };
        self.input.read(footer, HEADER + 8, &mut self.body)?;
        let start = Record::parse(&self.body, footer, self.input.length());
        let is_footer = start.is_some_and(|r| r.opcode == FOOTER && r.length == FOOTER_BODY);
        let Some(mut at) = Fields::new(&self.body[self.body.len().min(HEADER as usize)..]).u64()
        else {
            return Ok(());
        };
        // 0 means that there is no summary.
        while is_footer && at >= MAGIC.len() as u64 && at < footer {
            self.input.read(at, HEADER, &mut self.body)?;
            let Some(record) = Record::parse(&self.body, at, footer).filter(|record| record.whole)
            else {
                break;
            };
            if let (SCHEMA | CHANNEL, Some(length)) = (record.opcode, body_length(record)) {
                self.input.read(record.at, length, &mut self.body)?;
                self.body(record, self.place(None, at, 0));
            }
            at = record.end(footer);
        }
        Ok(())
    }
}

fn too_large(place: Place) -> Event {
    let reason = format!(
        "a message of {} bytes exceeds the limit of {LARGEST_MESSAGE}",
        place.length
    );
    Event::Skip {
        place,
        messages: 1,
        reason,
    }
}

/// How many bytes of a body must be read; `None` for a message that is too large.
fn body_length(record: Record) -> Option<u64> {
    match record.opcode {
        MESSAGE => Some(record.length).filter(|length| *length <= LARGEST_MESSAGE),
        SCHEMA | CHANNEL => Some(record.length.min(LARGEST_NAMES)),
        _ => Some(0),
    }
}

impl Record {
    /// Parses the header at offset `at` in data that end at `end`.
    pub(super) fn parse(header: &[u8], at: u64, end: u64) -> Option<Self> {
        let (&[opcode, ref length @ ..], _) = header.split_first_chunk::<{ HEADER as usize }>()?;
        let (at, length) = (at + HEADER, u64::from_le_bytes(*length));
        let whole = at.checked_add(length).is_some_and(|stop| stop <= end);
        Some(Self {
            opcode,
            at,
            length,
            whole,
        })
    }

    /// Offset of the next record, or the end.
    pub(super) fn end(&self, end: u64) -> u64 {
        if self.whole {
            self.at + self.length
        } else {
            end
        }
    }
}
