//! The content of one chunk: left in the file if it is not compressed, in memory if it is.
//!
//! The checksum is compared before anything in the chunk is used. An uncompressed chunk is read for that,
//! and a second time record by record, then from the cache of the operating system.

use super::compression::{self, Compression};
use super::fields::Fields;
use super::scan::{HEADER, MESSAGE, Record};
use super::source::Input;
use crate::Error;

/// Times, sizes, checksum and the name of the compression are within this many bytes.
const LARGEST_HEADER: u64 = 256;

/// A chunk being read.
#[derive(Debug)]
pub(super) struct Chunk {
    content: Content,
    /// Next record: byte offset in the file or in the decompressed content.
    at: u64,
    end: u64,
    /// Whether the file contains the whole chunk.
    pub(super) whole: bool,
}

#[derive(Debug)]
enum Content {
    InFile,
    Decompressed { chunk_at: u64, bytes: Vec<u8> },
}

/// Why a chunk is skipped.
#[derive(Debug)]
pub(super) struct Damage {
    pub(super) reason: String,
    /// Estimated number of messages in it.
    pub(super) messages: usize,
}

impl From<String> for Damage {
    fn from(reason: String) -> Self {
        Self {
            reason,
            messages: 0,
        }
    }
}

/// The part before the content.
struct Header {
    size: u64,
    checksum: u32,
    compression: String,
    /// Offset and length of the content in the file.
    at: u64,
    length: u64,
}

/// Opens the chunk whose record header was read; `buffer` is scratch.
///
/// # Errors
/// Outer: the file cannot be read. Inner: the chunk is invalid.
pub(super) fn open(
    input: &mut Input<'_>,
    record: Record,
    buffer: &mut Vec<u8>,
) -> Result<Result<Chunk, Damage>, Error> {
    input.read(record.at, record.length.min(LARGEST_HEADER), buffer)?;
    let header = match header(buffer, record, record.end(input.length())) {
        Ok(header) => header,
        // A chunk without even a complete header is the end of a truncated file.
        Err(_) if !record.whole => return Ok(Ok(Chunk::empty())),
        Err(reason) => return Ok(Err(Damage::from(reason))),
    };
    let Some(compression) = Compression::of_name(&header.compression) else {
        let reason = format!(
            "chunk is compressed with `{}`, but only none, lz4 and zstd are supported",
            header.compression
        );
        return Ok(Err(Damage::from(reason)));
    };
    let content = match compression {
        Compression::None => Content::InFile,
        _ => match decompressed(input, &header, compression, record.whole, buffer)? {
            Ok(bytes) => Content::Decompressed {
                chunk_at: record.at - HEADER,
                bytes,
            },
            Err(reason) => return Ok(Err(Damage::from(reason))),
        },
    };
    let (at, end) = match &content {
        Content::InFile => (header.at, header.at + header.length),
        Content::Decompressed { bytes, .. } => (0, bytes.len() as u64),
    };
    let mut chunk = Chunk {
        content,
        at,
        end,
        whole: record.whole,
    };
    // A checksum of 0 means that the writer computed none.
    if record.whole && header.checksum != 0 {
        let (stored, computed) = (header.checksum, chunk.checksum(input, buffer)?);
        if stored != computed {
            let reason =
                format!("chunk has the checksum {computed:08x}, but {stored:08x} is stored");
            let messages = chunk.count_messages(input, buffer)?;
            return Ok(Err(Damage { reason, messages }));
        }
    }
    Ok(Ok(chunk))
}

fn header(bytes: &[u8], record: Record, end: u64) -> Result<Header, String> {
    let mut fields = Fields::new(bytes);
    let read = |fields: &mut Fields<'_>| {
        let (_first, _last) = (fields.u64()?, fields.u64()?);
        let (size, checksum) = (fields.u64()?, fields.u32()?);
        Some((size, checksum, fields.text()?.to_owned(), fields.u64()?))
    };
    let found = read(&mut fields).ok_or("fields of the chunk header do not fit")?;
    let (size, checksum, compression, stored) = found;
    let at = record.at + (bytes.len() - fields.rest.len()) as u64;
    let available = end.saturating_sub(at);
    if record.whole && stored > available {
        return Err(format!(
            "chunk of {stored} bytes in a record that has {available} left"
        ));
    }
    let length = stored.min(available);
    Ok(Header {
        size,
        checksum,
        compression,
        at,
        length,
    })
}

/// Outer error: the file cannot be read. Inner: the content is invalid.
fn decompressed(
    input: &mut Input<'_>,
    header: &Header,
    compression: Compression,
    whole: bool,
    buffer: &mut Vec<u8>,
) -> Result<Result<Vec<u8>, String>, Error> {
    let size = header.size;
    if size > compression::LARGEST || header.length > compression::LARGEST {
        let largest = compression::LARGEST >> 20;
        let reason = format!(
            "compressed chunk of {} bytes, {size} when decompressed: no more than {largest} MiB are held in memory",
            header.length
        );
        return Ok(Err(reason));
    }
    let mut content = Vec::new();
    if !whole {
        input.read(header.at, header.length, buffer)?;
        if compression == Compression::Zstd && !compression::close_zstd_frame(buffer) {
            buffer.clear();
        }
        // Up to its last complete block.
        let length = buffer.len() as u64;
        let _cut = compression.decompress(&mut buffer.as_slice(), length, size, &mut content);
        return Ok(Ok(content));
    }
    let stream = input.stream_at(header.at)?;
    let decoded = compression.decompress(stream, header.length, size, &mut content);
    Ok(match decoded {
        Err(error) => Err(format!(
            "{} chunk cannot be decompressed: {error}",
            compression.name()
        )),
        Ok(()) if content.len() as u64 == size => Ok(content),
        Ok(()) => Err(format!(
            "{} chunk decompresses to {}{} bytes, {size} are stored",
            compression.name(),
            if content.len() as u64 > size {
                "at least "
            } else {
                ""
            },
            content.len()
        )),
    })
}

impl Chunk {
    fn empty() -> Self {
        Self {
            content: Content::InFile,
            at: 0,
            end: 0,
            whole: false,
        }
    }

    /// Offset of the chunk in the file, if it is compressed.
    pub(super) fn compressed_at(&self) -> Option<u64> {
        match self.content {
            Content::InFile => None,
            Content::Decompressed { chunk_at, .. } => Some(chunk_at),
        }
    }

    /// The header of the next record; `None` when fewer bytes than a header are left.
    pub(super) fn record(
        &mut self,
        input: &mut Input<'_>,
        buffer: &mut Vec<u8>,
    ) -> Result<Option<Record>, Error> {
        if self.end.saturating_sub(self.at) < HEADER {
            return Ok(None);
        }
        self.read(input, self.at, HEADER, buffer)?;
        let record = Record::parse(buffer, self.at, self.end);
        self.at = record.map_or(self.end, |record| record.end(self.end));
        Ok(record)
    }

    /// Replaces `buffer` by `length` bytes of the content.
    pub(super) fn read(
        &self,
        input: &mut Input<'_>,
        at: u64,
        length: u64,
        buffer: &mut Vec<u8>,
    ) -> Result<(), Error> {
        match &self.content {
            Content::InFile => input.read(at, length, buffer),
            Content::Decompressed { bytes, .. } => {
                let start = bytes.len().min(at as usize);
                let end = bytes.len().min(start.saturating_add(length as usize));
                buffer.clear();
                buffer.extend_from_slice(&bytes[start..end]);
                Ok(())
            }
        }
    }

    fn checksum(&self, input: &mut Input<'_>, buffer: &mut Vec<u8>) -> Result<u32, Error> {
        const BLOCK: u64 = 1 << 18;
        let mut hasher = crc32fast::Hasher::new();
        match &self.content {
            Content::Decompressed { bytes, .. } => hasher.update(bytes),
            Content::InFile => {
                let mut at = self.at;
                while at < self.end {
                    input.read(at, BLOCK.min(self.end - at), buffer)?;
                    hasher.update(buffer);
                    at += BLOCK;
                }
            }
        }
        Ok(hasher.finalize())
    }

    fn count_messages(
        &mut self,
        input: &mut Input<'_>,
        buffer: &mut Vec<u8>,
    ) -> Result<usize, Error> {
        let mut messages = 0;
        while let Some(record) = self.record(input, buffer)? {
            messages += usize::from(record.whole && record.opcode == MESSAGE);
        }
        Ok(messages)
    }
}

/// Decompressed chunks are decompressed again when their messages are read again; the last one is kept.
#[derive(Default)]
pub(super) struct Cache {
    last: Option<(u64, Chunk)>,
}

impl Cache {
    /// Replaces `buffer` by `length` bytes at `at` of the compressed chunk that starts at `chunk_at`.
    ///
    /// # Errors
    /// The file cannot be read.
    pub(super) fn read(
        &mut self,
        input: &mut Input<'_>,
        chunk_at: u64,
        [at, length]: [u64; 2],
        buffer: &mut Vec<u8>,
    ) -> Result<(), Error> {
        if self.last.as_ref().is_none_or(|(open, _)| *open != chunk_at) {
            self.last = None;
            input.read(chunk_at, HEADER, buffer)?;
            let record = Record::parse(buffer, chunk_at, input.length());
            // It was opened before: this fails only if the file has changed meanwhile, and then gives no bytes.
            if let Some(record) = record
                && let Ok(chunk) = open(input, record, buffer)?
            {
                self.last = Some((chunk_at, chunk));
            }
        }
        buffer.clear();
        match &self.last {
            Some((_, chunk)) => chunk.read(input, at, length, buffer),
            None => Ok(()),
        }
    }
}
