//! Walking through the records of an MCAP file, whatever state it is in.
//!
//! ```text
//! file   = magic · record*           record = opcode(u8) · length(u64) · body
//! chunk  = times · sizes · crc · compression · record*
//! ```
//!
//! The `mcap` crate writes our files. Its readers are not used here for three reasons: they stop before a
//! chunk that a killed recorder left half written, although the messages in it are whole; they trust lengths
//! (a damaged attachment panics, a damaged string reserves 4 GB); and they copy every message twice. Only the
//! four records that carry messages are read; all others, indexes included, are stepped over by length.

use std::collections::BTreeMap;

use super::crc::crc32;
use crate::Error;

const MAGIC: &[u8] = b"\x89MCAP0\r\n";
const FOOTER: u8 = 0x02;
const SCHEMA: u8 = 0x03;
const CHANNEL: u8 = 0x04;
const MESSAGE: u8 = 0x05;
const CHUNK: u8 = 0x06;

/// A topic of the file.
#[derive(Debug, Clone)]
pub(super) struct Channel {
    pub(super) topic: String,
    /// ROS 2 type of the messages, empty if the file does not say.
    pub(super) type_name: String,
    pub(super) encoding: String,
}

/// One message, not yet decoded.
#[derive(Debug, Clone, Copy)]
pub(super) struct RawMessage<'a> {
    pub(super) channel: u16,
    /// Nanoseconds.
    pub(super) log_time: u64,
    pub(super) data: &'a [u8],
}

/// What a file holds, in the order of the file.
#[derive(Debug, Default)]
pub(super) struct Records<'a> {
    pub(super) channels: BTreeMap<u16, Channel>,
    pub(super) messages: Vec<RawMessage<'a>>,
    /// Whether the file was closed properly (it has its footer).
    pub(super) complete: bool,
    schemas: BTreeMap<u16, String>,
}

/// Reads every whole record; a file that ends inside a record is read up to there.
pub(super) fn read(file: &[u8]) -> Result<Records<'_>, Error> {
    let mut records = Records::default();
    let Some(body) = file.strip_prefix(MAGIC) else {
        return Err(Error::NotMcap);
    };
    let mut cursor = Cursor {
        bytes: body,
        base: MAGIC.len(),
    };
    while let Some(record) = cursor.record() {
        match record.opcode {
            CHUNK => records.chunk(&record)?,
            // A chunk may be cut anywhere; any other record that is not whole is the end.
            _ if !record.whole => break,
            FOOTER => {
                records.complete = true;
                break;
            }
            _ => records.plain(&record)?,
        }
    }
    Ok(records)
}

impl<'a> Records<'a> {
    fn chunk(&mut self, record: &Record<'a>) -> Result<(), Error> {
        const SIZE_AND_TIMES: usize = 8 + 8 + 8;
        let mut fields = Fields::of(record);
        let header = fields.take(SIZE_AND_TIMES).and_then(|_| {
            let checksum = fields.u32()?;
            Some((checksum, fields.text()?, fields.u64()?))
        });
        let Some((stored, compression, size)) = header else {
            return if record.whole {
                Err(record.bad("chunk header does not fit"))
            } else {
                Ok(())
            };
        };
        let offset = record.offset;
        if !compression.is_empty() {
            return Err(Error::Compressed {
                offset,
                compression: compression.to_owned(),
            });
        }
        let content = if record.whole {
            let length = usize::try_from(size).ok();
            let content = length.and_then(|length| fields.rest.get(..length));
            content.ok_or_else(|| record.bad("chunk is longer than its record"))?
        } else {
            fields.rest
        };
        let computed = crc32(content);
        // A checksum of 0 means that the writer made none.
        if record.whole && stored != 0 && stored != computed {
            return Err(Error::BadChecksum {
                offset,
                stored,
                computed,
            });
        }
        self.chunk_content(content, record)
    }

    fn chunk_content(&mut self, content: &'a [u8], chunk: &Record<'a>) -> Result<(), Error> {
        let base = chunk.offset + HEADER + (chunk.body.len() - content.len());
        let mut cursor = Cursor {
            bytes: content,
            base,
        };
        while let Some(record) = cursor.record() {
            if record.whole {
                self.plain(&record)?;
            } else if chunk.whole {
                return Err(record.bad("record is longer than its chunk"));
            }
        }
        Ok(())
    }

    fn plain(&mut self, record: &Record<'a>) -> Result<(), Error> {
        let mut fields = Fields::of(record);
        let read = match record.opcode {
            SCHEMA => self.schema(&mut fields),
            CHANNEL => self.channel(&mut fields),
            MESSAGE => self.message(&mut fields),
            _ => Some(()),
        };
        read.ok_or_else(|| record.bad("its fields do not fit, or a name is not UTF-8"))
    }

    fn schema(&mut self, fields: &mut Fields<'a>) -> Option<()> {
        let (id, name) = (fields.u16()?, fields.text()?);
        self.schemas.insert(id, name.to_owned());
        Some(())
    }

    fn channel(&mut self, fields: &mut Fields<'a>) -> Option<()> {
        let (id, schema) = (fields.u16()?, fields.u16()?);
        let (topic, encoding) = (fields.text()?.to_owned(), fields.text()?.to_owned());
        let type_name = self.schemas.get(&schema).cloned().unwrap_or_default();
        self.channels.insert(
            id,
            Channel {
                topic,
                type_name,
                encoding,
            },
        );
        Some(())
    }

    fn message(&mut self, fields: &mut Fields<'a>) -> Option<()> {
        let channel = fields.u16()?;
        let (_sequence, log_time, _publish_time) = (fields.u32()?, fields.u64()?, fields.u64()?);
        self.messages.push(RawMessage {
            channel,
            log_time,
            data: fields.rest,
        });
        Some(())
    }
}

/// Opcode and length before each body.
const HEADER: usize = 9;

struct Record<'a> {
    opcode: u8,
    /// The body, or as much of it as there is.
    body: &'a [u8],
    whole: bool,
    offset: usize,
}

impl Record<'_> {
    fn bad(&self, reason: &'static str) -> Error {
        Error::BadRecord {
            offset: self.offset,
            opcode: self.opcode,
            reason,
        }
    }
}

struct Cursor<'a> {
    bytes: &'a [u8],
    /// Where `bytes` starts in the file.
    base: usize,
}

impl<'a> Cursor<'a> {
    /// The next record; nothing once fewer bytes than a record header are left.
    fn record(&mut self) -> Option<Record<'a>> {
        let (&[opcode, ref length @ ..], rest) = self.bytes.split_first_chunk::<HEADER>()?;
        let claimed = usize::try_from(u64::from_le_bytes(*length)).unwrap_or(usize::MAX);
        let (body, rest) = rest.split_at(claimed.min(rest.len()));
        let record = Record {
            opcode,
            body,
            whole: body.len() == claimed,
            offset: self.base,
        };
        self.bytes = rest;
        self.base += HEADER + body.len();
        Some(record)
    }
}

/// The fields of one body; `None` once they do not fit.
struct Fields<'a> {
    rest: &'a [u8],
}

impl<'a> Fields<'a> {
    fn of(record: &Record<'a>) -> Self {
        Self { rest: record.body }
    }

    fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.rest.split_at_checked(count)?;
        self.rest = rest;
        Some(taken)
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (taken, rest) = self.rest.split_first_chunk()?;
        self.rest = rest;
        Some(*taken)
    }

    fn u16(&mut self) -> Option<u16> {
        self.array().map(u16::from_le_bytes)
    }

    fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Option<u64> {
        self.array().map(u64::from_le_bytes)
    }

    fn text(&mut self) -> Option<&'a str> {
        let length = self.u32()? as usize;
        std::str::from_utf8(self.take(length)?).ok()
    }
}
