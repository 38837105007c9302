//! Writing CDR: the mirror of the decoder.

use super::{Endian, decoder::HEADER};
use crate::Error;

/// A message as it grows.
#[derive(Debug, Clone)]
pub struct Encoder {
    bytes: Vec<u8>,
    endian: Endian,
}

impl Encoder {
    /// Starts a message with its encapsulation header.
    pub fn new(endian: Endian) -> Self {
        let representation = u8::from(endian == Endian::Little);
        Self {
            bytes: vec![0, representation, 0, 0],
            endian,
        }
    }

    /// The whole message.
    pub fn finish(self) -> Vec<u8> {
        self.bytes
    }

    fn primitive<const N: usize>(&mut self, mut little_endian: [u8; N]) {
        let end = HEADER + (self.bytes.len() - HEADER).next_multiple_of(N);
        self.bytes.resize(end, 0);
        if self.endian == Endian::Big {
            little_endian.reverse();
        }
        self.bytes.extend_from_slice(&little_endian);
    }

    /// One byte.
    pub fn u8(&mut self, value: u8) {
        self.primitive(value.to_le_bytes());
    }

    /// A Boolean.
    pub fn bool(&mut self, value: bool) {
        self.u8(u8::from(value));
    }

    /// A 32-bit unsigned integer.
    pub fn u32(&mut self, value: u32) {
        self.primitive(value.to_le_bytes());
    }

    /// A 32-bit signed integer.
    pub fn i32(&mut self, value: i32) {
        self.primitive(value.to_le_bytes());
    }

    /// A double.
    pub fn f64(&mut self, value: f64) {
        self.primitive(value.to_le_bytes());
    }

    /// A fixed array of doubles: no length goes before it.
    pub fn f64_array(&mut self, values: &[f64]) {
        for &value in values {
            self.f64(value);
        }
    }

    fn length(&mut self, field: &'static str, length: usize) -> Result<(), Error> {
        let value = u32::try_from(length).map_err(|_| Error::TooLong { field, length })?;
        self.u32(value);
        Ok(())
    }

    /// A sequence of bytes.
    ///
    /// # Errors
    /// Longer than 2³² − 1.
    pub fn bytes(&mut self, field: &'static str, bytes: &[u8]) -> Result<(), Error> {
        self.length(field, bytes.len())?;
        self.bytes.extend_from_slice(bytes);
        Ok(())
    }

    /// A string.
    ///
    /// # Errors
    /// Longer than 2³² − 2.
    pub fn string(&mut self, field: &'static str, text: &str) -> Result<(), Error> {
        self.length(field, text.len().saturating_add(1))?;
        self.bytes.extend_from_slice(text.as_bytes());
        self.bytes.push(0);
        Ok(())
    }

    /// A sequence of what `element` writes.
    ///
    /// # Errors
    /// More than 2³² − 1 elements, or an element that cannot be written.
    pub fn sequence<T>(
        &mut self,
        field: &'static str,
        elements: &[T],
        mut element: impl FnMut(&mut Self, &T) -> Result<(), Error>,
    ) -> Result<(), Error> {
        self.length(field, elements.len())?;
        elements.iter().try_for_each(|value| element(self, value))
    }
}
