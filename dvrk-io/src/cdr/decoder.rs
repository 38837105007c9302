//! Reading CDR: a cursor that knows its byte order and aligns before each primitive.

use super::Endian;
use crate::Error;

/// Length of the encapsulation header; alignment counts from behind it.
pub(super) const HEADER: usize = 4;

/// A cursor over the bytes of one message.
#[derive(Debug, Clone)]
pub struct Decoder<'a> {
    bytes: &'a [u8],
    position: usize,
    endian: Endian,
}

impl<'a> Decoder<'a> {
    /// Reads the encapsulation header.
    ///
    /// # Errors
    /// Fewer than four bytes, or a representation other than plain CDR.
    pub fn new(bytes: &'a [u8]) -> Result<Self, Error> {
        let [first, second, _, _, ..] = *bytes else {
            let (needed, available) = (HEADER, bytes.len());
            return Err(Error::Truncated {
                field: "encapsulation",
                offset: 0,
                needed,
                available,
            });
        };
        let endian = match u16::from_be_bytes([first, second]) {
            0 => Endian::Big,
            1 => Endian::Little,
            found => return Err(Error::Encapsulation { found }),
        };
        Ok(Self {
            bytes,
            position: HEADER,
            endian,
        })
    }

    /// Byte offset of the cursor in the message, header included.
    pub fn offset(&self) -> usize {
        self.position
    }

    fn remaining(&self) -> usize {
        self.bytes.len() - self.position
    }

    fn take(&mut self, field: &'static str, needed: usize) -> Result<&'a [u8], Error> {
        let rest = &self.bytes[self.position..];
        let Some((taken, _)) = rest.split_at_checked(needed) else {
            let (offset, available) = (self.position, rest.len());
            return Err(Error::Truncated {
                field,
                offset,
                needed,
                available,
            });
        };
        self.position += needed;
        Ok(taken)
    }

    fn primitive<const N: usize>(&mut self, field: &'static str) -> Result<[u8; N], Error> {
        let padding = (self.position - HEADER).next_multiple_of(N) - (self.position - HEADER);
        self.take(field, padding)?;
        let mut value = [0; N];
        value.copy_from_slice(self.take(field, N)?);
        // From here on numbers are little-endian, whatever was sent.
        if self.endian == Endian::Big {
            value.reverse();
        }
        Ok(value)
    }

    /// One byte.
    ///
    /// # Errors
    /// The bytes end.
    pub fn u8(&mut self, field: &'static str) -> Result<u8, Error> {
        self.primitive(field).map(u8::from_le_bytes)
    }

    /// A Boolean: every byte but 0 is true, as middlewares differ in what they send.
    ///
    /// # Errors
    /// The bytes end.
    pub fn bool(&mut self, field: &'static str) -> Result<bool, Error> {
        self.u8(field).map(|byte| byte != 0)
    }

    /// A 32-bit unsigned integer.
    ///
    /// # Errors
    /// The bytes end.
    pub fn u32(&mut self, field: &'static str) -> Result<u32, Error> {
        self.primitive(field).map(u32::from_le_bytes)
    }

    /// A 32-bit signed integer.
    ///
    /// # Errors
    /// The bytes end.
    pub fn i32(&mut self, field: &'static str) -> Result<i32, Error> {
        self.primitive(field).map(i32::from_le_bytes)
    }

    /// A double.
    ///
    /// # Errors
    /// The bytes end.
    pub fn f64(&mut self, field: &'static str) -> Result<f64, Error> {
        self.primitive(field).map(f64::from_le_bytes)
    }

    /// A fixed array of doubles.
    ///
    /// # Errors
    /// The bytes end.
    pub fn f64_array<const N: usize>(&mut self, field: &'static str) -> Result<[f64; N], Error> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.f64(field)?;
        }
        Ok(values)
    }

    /// A sequence of bytes, without a copy.
    ///
    /// # Errors
    /// The bytes end.
    pub fn bytes(&mut self, field: &'static str) -> Result<&'a [u8], Error> {
        let length = self.u32(field)? as usize;
        self.take(field, length)
    }

    /// A string. Length 0 (no NUL at all) is read as the empty string: some writers send that.
    ///
    /// # Errors
    /// The bytes end, the last byte is not NUL, or the rest is not UTF-8.
    pub fn string(&mut self, field: &'static str) -> Result<String, Error> {
        let bytes = self.bytes(field)?;
        let offset = self.position - bytes.len();
        let text = match bytes {
            [] => &[],
            [text @ .., 0] => text,
            _ => {
                return Err(Error::BadString {
                    field,
                    offset,
                    reason: "no NUL at its end",
                });
            }
        };
        String::from_utf8(text.to_vec()).map_err(|_| Error::BadString {
            field,
            offset,
            reason: "not UTF-8",
        })
    }

    /// A sequence of what `element` reads; `least` is the fewest bytes one element can take.
    ///
    /// # Errors
    /// The bytes cannot hold that many elements, or an element cannot be read.
    pub fn sequence<T>(
        &mut self,
        field: &'static str,
        least: usize,
        mut element: impl FnMut(&mut Self) -> Result<T, Error>,
    ) -> Result<Vec<T>, Error> {
        let count = self.u32(field)? as usize;
        // The count is checked against the remaining bytes before anything is allocated.
        let needed = count.saturating_mul(least);
        if needed > self.remaining() {
            let (offset, available) = (self.position, self.remaining());
            return Err(Error::Truncated {
                field,
                offset,
                needed,
                available,
            });
        }
        (0..count).map(|_| element(self)).collect()
    }
}
