//! Lines of text as bytes.
//!
//! Comments and names are bytes in whatever encoding their author used, so nothing here asks for UTF-8: words are compared and parsed as
//! they stand. Lines end with `\n`, `\r\n` or `\r`; a byte-order mark in front is passed over.

use std::borrow::Cow;

use crate::{Error, Format, Place};

/// What UTF-8 files from some programs begin with.
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

    /// Lines of what follows line `number`.
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

    /// The next line with anything on it.
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

/// Words between blanks.
pub fn words(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    line.split(u8::is_ascii_whitespace)
        .filter(|w| !w.is_empty())
}

/// For messages.
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

/// Whether these are the bytes of text at all.
///
/// # Errors
/// UTF-16, whose letters are two bytes each.
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
