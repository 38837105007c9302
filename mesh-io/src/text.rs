//! Lines of text as bytes.
//!
//! Comments and names may be in any encoding, so UTF-8 is not required: words are compared and parsed as
//! bytes. Lines end with `
//! `, `\r
//! ` or `\r`; a byte-order mark at the start is skipped.

use std::borrow::Cow;

use crate::{Error, Format, Place};

/// The UTF-8 byte-order mark, which some programs write.
const MARK: &[u8] = b"\xef\xbb\xbf";

/// Lines, each with its number from 1.
#[derive(Clone)]
pub struct Lines<'a> {
    rest: &'a [u8],
    number: usize,
}

impl<'a> Lines<'a> {
    pub fn new(bytes: &'a [u8]) -> Self {
        Self::from_line(bytes, 0)
    }

    /// Lines after line `number`.
    pub fn from_line(bytes: &'a [u8], number: usize) -> Self {
        Self {
            rest: bytes.strip_prefix(MARK).unwrap_or(bytes),
            number,
        }
    }

    /// What has not been read yet.
    pub fn rest(&self) -> &'a [u8] {
        self.rest
    }

    /// Number of the line that was read last.
    pub fn number(&self) -> usize {
        self.number
    }

    pub fn place(&self) -> Place {
        Place::Line(self.number)
    }

    /// The next non-empty line.
    pub fn next_filled(&mut self) -> Option<&'a [u8]> {
        self.find(|line| !line.trim_ascii().is_empty())
    }
}

impl<'a> Iterator for Lines<'a> {
    type Item = &'a [u8];

    fn next(&mut self) -> Option<&'a [u8]> {
        if self.rest.is_empty() {
            return None;
        }
        self.number += 1;
        let end = self.rest.iter().position(|b| matches!(b, b'\n' | b'\r'));
        let (line, rest) = self.rest.split_at(end.unwrap_or(self.rest.len()));
        self.rest = rest
            .strip_prefix(b"\r\n")
            .or_else(|| rest.get(1..))
            .unwrap_or_default();
        Some(line)
    }
}

/// Words separated by spaces.
pub fn words(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    line.split(u8::is_ascii_whitespace)
        .filter(|w| !w.is_empty())
}

/// A word in a form for messages.
pub fn shown(word: &[u8]) -> Cow<'_, str> {
    const LONGEST: usize = 60;
    match word.get(..LONGEST) {
        Some(start) => format!("{}…", String::from_utf8_lossy(start)).into(),
        None => String::from_utf8_lossy(word),
    }
}

pub fn number(word: &[u8]) -> Option<f64> {
    std::str::from_utf8(word).ok()?.parse().ok()
}

pub fn whole<T: std::str::FromStr>(word: &[u8]) -> Option<T> {
    std::str::from_utf8(word).ok()?.parse().ok()
}

/// Checks that the bytes are single-byte text.
///
/// # Errors
/// UTF-16, whose characters take two bytes or more.
pub fn is_single_byte(bytes: &[u8], format: Format) -> Result<(), Error> {
    if bytes.starts_with(b"\xff\xfe") || bytes.starts_with(b"\xfe\xff") {
        return Err(Error::Syntax {
            format,
            place: Place::Byte(0),
            reason: "this is UTF-16 text: save it as UTF-8 or ASCII".into(),
        });
    }
    Ok(())
}
