//! A list of what a reader skipped because it was damaged, with positions.

use std::fmt;
use std::path::PathBuf;

/// Something that was skipped.
#[derive(Debug, Clone, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Skip {
    /// The file; empty when the session was read from memory.
    pub file: PathBuf,
    /// Offset of the record in the file; if it is in a compressed chunk, that of the chunk.
    pub byte: u64,
    /// Offset in the decompressed chunk, if the record is in a compressed one.
    pub byte_in_chunk: Option<u64>,
    /// Topic of the message, or empty if unknown.
    pub topic: String,
    /// Number of lost messages: more than one for a chunk, 0 if unknown.
    pub messages: usize,
    /// The reason.
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

/// Everything that was skipped.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Skipped {
    /// Number of messages that could not be read, including those in damaged chunks as far as they could be counted.
    pub messages: usize,
    /// Number of places where something was skipped: single records, or whole chunks.
    pub places: usize,
    /// The first [`Skipped::LISTED`] places, in order.
    pub first: Vec<Skip>,
}

impl Skipped {
    /// Most places that are listed, so that a badly damaged file does not fill the memory.
    pub const LISTED: usize = 100;

    /// Whether nothing was skipped.
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
