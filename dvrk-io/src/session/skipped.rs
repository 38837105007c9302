//! What a reader passed over because it was damaged, and where.

use std::fmt;
use std::path::PathBuf;

/// One thing that was passed over.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Skip {
    /// The file; empty when the session was read from memory.
    pub file: PathBuf,
    /// Byte of the file at which the record starts: of the chunk, where the record lies in a compressed one.
    pub byte: u64,
    /// Byte in the decompressed chunk, where the record lies in a compressed one.
    pub byte_in_chunk: Option<u64>,
    /// Topic of the message, or empty where none is known.
    pub topic: String,
    /// How many messages were lost: more than one when a chunk was, 0 when it is not known.
    pub messages: usize,
    /// What is wrong.
    pub reason: String,
}

impl fmt::Display for Skip {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        if !self.file.as_os_str().is_empty() {
            write!(formatter, "{}, ", self.file.display())?;
        }
        write!(formatter, "byte {}", self.byte)?;
        if let Some(byte) = self.byte_in_chunk {
            write!(formatter, " (chunk), byte {byte} of its content")?;
        }
        if !self.topic.is_empty() {
            write!(formatter, ", {}", self.topic)?;
        }
        write!(formatter, ": {}", self.reason)?;
        if self.messages > 1 {
            write!(formatter, " ({} messages)", self.messages)?;
        }
        Ok(())
    }
}

/// Everything that was passed over.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Skipped {
    /// Messages that could not be read, those in damaged chunks included as far as they could be counted.
    pub messages: usize,
    /// Places at which something was passed over: single records, or whole chunks.
    pub places: usize,
    /// The first [`Skipped::LISTED`] places, in the order in which they were met.
    pub first: Vec<Skip>,
}

impl Skipped {
    /// How many places are listed: a file of nothing but damage must not fill the memory with its description.
    pub const LISTED: usize = 100;

    /// Whether nothing was passed over.
    pub fn is_empty(&self) -> bool {
        self.places == 0
    }

    pub(super) fn add(&mut self, skip: Skip) {
        self.messages = self.messages.saturating_add(skip.messages);
        self.places += 1;
        if self.first.len() < Self::LISTED {
            self.first.push(skip);
        }
    }
}
