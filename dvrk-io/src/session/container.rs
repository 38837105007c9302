//! Writing MCAP: chunks as they fill up, and an index of them at the end.
//!
//! ```text
//! file    = magic · header · (chunk · message index*)* · data end · summary · footer · magic
//! summary = schema* · channel* · statistics · chunk index* · summary offset*
//! ```
//! The `mcap` crate compresses only with the C libraries of Zstandard and LZ4; this module does without them.
//! Schemas and channels stand in the chunk of their first message and once more in the summary. All checksums are written.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Write};

use super::compression::Compression;
use super::scan::{CHANNEL, CHUNK, FOOTER, MAGIC, MESSAGE, SCHEMA};

const FILE_HEADER: u8 = 0x01;
const MESSAGE_INDEX: u8 = 0x07;
const CHUNK_INDEX: u8 = 0x08;
const STATISTICS: u8 = 0x0B;
const SUMMARY_OFFSET: u8 = 0x0E;
const DATA_END: u8 = 0x0F;

/// A file being written.
pub(super) struct Container {
    file: File,
    position: u64,
    checksum: crc32fast::Hasher,
    compression: Compression,
    chunk: OpenChunk,
    summary: Summary,
}

/// The chunk that is not yet in the file.
#[derive(Default)]
struct OpenChunk {
    content: Vec<u8>,
    /// For each channel, time and byte offset of each message.
    index: BTreeMap<u16, Vec<(u64, u64)>>,
    span: Span,
}

#[derive(Default)]
struct Summary {
    schemas: Vec<u8>,
    channels: Vec<u8>,
    chunks: Vec<u8>,
    counts: BTreeMap<u16, u64>,
    schema_count: u16,
    channel_count: u16,
    chunk_count: u32,
    span: Span,
}

/// First and last time of messages.
#[derive(Clone, Copy, Default)]
struct Span(Option<[u64; 2]>);

impl Span {
    fn add(&mut self, time: u64) {
        let [first, last] = self.0.unwrap_or([time; 2]);
        self.0 = Some([first.min(time), last.max(time)]);
    }

    fn ends(self) -> [u64; 2] {
        self.0.unwrap_or_default()
    }
}

impl Container {
    /// Starts the file.
    pub(super) fn new(
        file: File,
        profile: &str,
        library: &str,
        compression: Compression,
    ) -> io::Result<Self> {
        let mut container = Self {
            file,
            position: 0,
            checksum: crc32fast::Hasher::new(),
            compression,
            chunk: OpenChunk::default(),
            summary: Summary::default(),
        };
        let mut start = MAGIC.to_vec();
        let body = Body::default().text(profile)?.text(library)?;
        body.append_to(&mut start, FILE_HEADER);
        container.put(&start)?;
        Ok(container)
    }

    /// Adds the definition of a message type and returns its number.
    pub(super) fn schema(&mut self, name: &str, encoding: &str, text: &str) -> io::Result<u16> {
        // 0 means "no schema".
        let id = next(self.summary.schema_count)?;
        let body = Body::default()
            .u16(id)
            .text(name)?
            .text(encoding)?
            .text(text)?;
        body.append_to(&mut self.chunk.content, SCHEMA);
        body.append_to(&mut self.summary.schemas, SCHEMA);
        self.summary.schema_count = id;
        Ok(id)
    }

    /// Adds a topic and returns its number.
    pub(super) fn channel(
        &mut self,
        schema: u16,
        topic: &str,
        encoding: &str,
        metadata: &[(&str, &str)],
    ) -> io::Result<u16> {
        let id = next(self.summary.channel_count)?;
        let pair = |pairs: Body, (key, value): &(&str, &str)| pairs.text(key)?.text(value);
        let pairs = metadata.iter().try_fold(Body::default(), pair)?;
        let body = Body::default()
            .u16(id)
            .u16(schema)
            .text(topic)?
            .text(encoding)?
            .bytes(&pairs.0)?;
        body.append_to(&mut self.chunk.content, CHANNEL);
        body.append_to(&mut self.summary.channels, CHANNEL);
        self.summary.channel_count = id;
        self.summary.counts.insert(id, 0);
        Ok(id)
    }

    /// Adds a message to the open chunk.
    pub(super) fn message(&mut self, channel: u16, time: u64, data: &[u8]) {
        let count = self.summary.counts.entry(channel).or_default();
        let head = Body::default()
            .u16(channel)
            .u32(*count as u32)
            .u64(time)
            .u64(time);
        *count += 1;
        let at = self.chunk.content.len() as u64;
        self.chunk
            .index
            .entry(channel)
            .or_default()
            .push((time, at));
        self.chunk.span.add(time);
        self.summary.span.add(time);
        let content = &mut self.chunk.content;
        content.push(MESSAGE);
        content.extend(((head.0.len() + data.len()) as u64).to_le_bytes());
        content.extend(&head.0);
        content.extend(data);
    }

    /// Writes the open chunk in one piece, unless it has no messages.
    pub(super) fn flush(&mut self) -> io::Result<()> {
        if self.chunk.index.is_empty() {
            return Ok(());
        }
        let OpenChunk {
            content,
            index,
            span,
        } = std::mem::take(&mut self.chunk);
        let [first, last] = span.ends();
        let (size, checksum) = (content.len() as u64, crc32fast::hash(&content));
        let packed = self.compression.compress(content)?;
        let (name, packed_size) = (self.compression.name(), packed.len() as u64);
        let head = Body::default()
            .u64(first)
            .u64(last)
            .u64(size)
            .u32(checksum)
            .text(name)?;
        let mut bytes = vec![CHUNK];
        bytes.extend((head.0.len() as u64 + 8 + packed_size).to_le_bytes());
        bytes.extend(head.u64(packed_size).0);
        bytes.extend(packed);

        let start = self.position;
        let length = bytes.len() as u64;
        let mut offsets = Body::default();
        for (channel, entries) in index {
            offsets = offsets.u16(channel).u64(start + bytes.len() as u64);
            let entries = entries
                .into_iter()
                .fold(Body::default(), |entries, (time, at)| {
                    entries.u64(time).u64(at)
                });
            Body::default()
                .u16(channel)
                .bytes(&entries.0)?
                .append_to(&mut bytes, MESSAGE_INDEX);
        }
        let index_length = bytes.len() as u64 - length;
        let entry = Body::default()
            .u64(first)
            .u64(last)
            .u64(start)
            .u64(length)
            .bytes(&offsets.0)?;
        let entry = entry
            .u64(index_length)
            .text(name)?
            .u64(packed_size)
            .u64(size);
        entry.append_to(&mut self.summary.chunks, CHUNK_INDEX);
        self.summary.chunk_count += 1;
        self.put(&bytes)
    }

    /// Writes the index, and waits until everything is on disk.
    pub(super) fn finish(&mut self) -> io::Result<()> {
        self.flush()?;
        let mut end = Vec::new();
        let data_checksum = self.checksum.clone().finalize();
        Body::default()
            .u32(data_checksum)
            .append_to(&mut end, DATA_END);
        self.put(&end)?;

        let start = self.position;
        let mut summary = Vec::new();
        let mut offsets = Vec::new();
        let groups = [
            (SCHEMA, std::mem::take(&mut self.summary.schemas)),
            (CHANNEL, std::mem::take(&mut self.summary.channels)),
            (STATISTICS, self.statistics()?),
            (CHUNK_INDEX, std::mem::take(&mut self.summary.chunks)),
        ];
        for (opcode, group) in groups {
            if !group.is_empty() {
                let at = start + summary.len() as u64;
                let entry = Body::default().u8(opcode).u64(at).u64(group.len() as u64);
                entry.append_to(&mut offsets, SUMMARY_OFFSET);
                summary.extend(group);
            }
        }
        let offsets_at = start + summary.len() as u64;
        summary.extend(offsets);
        // The checksum of the summary covers the footer up to itself.
        summary.push(FOOTER);
        summary.extend(20_u64.to_le_bytes());
        summary.extend(start.to_le_bytes());
        summary.extend(offsets_at.to_le_bytes());
        let checksum = crc32fast::hash(&summary);
        summary.extend(checksum.to_le_bytes());
        summary.extend(MAGIC);
        self.put(&summary)?;
        self.file.sync_all()
    }

    fn statistics(&self) -> io::Result<Vec<u8>> {
        let summary = &self.summary;
        let [first, last] = summary.span.ends();
        let add = |counts: Body, (channel, count): (&u16, &u64)| counts.u16(*channel).u64(*count);
        let counts = summary.counts.iter().fold(Body::default(), add);
        let mut bytes = Vec::new();
        Body::default()
            .u64(summary.counts.values().sum())
            .u16(summary.schema_count)
            .u32(u32::from(summary.channel_count))
            // Attachments and metadata: none.
            .u32(0)
            .u32(0)
            .u32(summary.chunk_count)
            .u64(first)
            .u64(last)
            .bytes(&counts.0)?
            .append_to(&mut bytes, STATISTICS);
        Ok(bytes)
    }

    fn put(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.checksum.update(bytes);
        self.position += bytes.len() as u64;
        self.file.write_all(bytes)
    }
}

fn next(count: u16) -> io::Result<u16> {
    let full = || io::Error::new(io::ErrorKind::InvalidInput, "more than 65,535 topics");
    count.checked_add(1).ok_or_else(full)
}

/// The body of a record.
#[derive(Default)]
struct Body(Vec<u8>);

impl Body {
    fn u8(mut self, value: u8) -> Self {
        self.0.push(value);
        self
    }

    fn u16(mut self, value: u16) -> Self {
        self.0.extend(value.to_le_bytes());
        self
    }

    fn u32(mut self, value: u32) -> Self {
        self.0.extend(value.to_le_bytes());
        self
    }

    fn u64(mut self, value: u64) -> Self {
        self.0.extend(value.to_le_bytes());
        self
    }

    /// Preceded by its length in 32 bits.
    fn bytes(self, bytes: &[u8]) -> io::Result<Self> {
        let length = u32::try_from(bytes.len()).map_err(io::Error::other)?;
        let mut body = self.u32(length);
        body.0.extend(bytes);
        Ok(body)
    }

    fn text(self, text: &str) -> io::Result<Self> {
        self.bytes(text.as_bytes())
    }

    fn append_to(&self, bytes: &mut Vec<u8>, opcode: u8) {
        bytes.push(opcode);
        bytes.extend((self.0.len() as u64).to_le_bytes());
        bytes.extend(&self.0);
    }
}
