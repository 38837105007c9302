//! Binary numbers of any type and byte order.

use crate::{Error, Format, Place};

/// Type of a number in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

/// Byte order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Order {
    Little,
    Big,
}

impl Scalar {
    pub fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }

    pub fn is_whole(self) -> bool {
        !matches!(self, Self::F32 | Self::F64)
    }

    /// The number in the first bytes; `None` if there are too few.
    pub fn read(self, bytes: &[u8], order: Order) -> Option<f64> {
        match order {
            Order::Little => self.little(bytes),
            Order::Big => {
                let mut reversed = [0; 8];
                let size = self.size();
                reversed[..size].copy_from_slice(bytes.get(..size)?);
                reversed[..size].reverse();
                self.little(&reversed)
            }
        }
    }

    #[inline]
    fn little(self, bytes: &[u8]) -> Option<f64> {
        Some(match self {
            Self::I8 => i8::from_le_bytes(*bytes.first_chunk()?).into(),
            Self::U8 => u8::from_le_bytes(*bytes.first_chunk()?).into(),
            Self::I16 => i16::from_le_bytes(*bytes.first_chunk()?).into(),
            Self::U16 => u16::from_le_bytes(*bytes.first_chunk()?).into(),
            Self::I32 => i32::from_le_bytes(*bytes.first_chunk()?).into(),
            Self::U32 => u32::from_le_bytes(*bytes.first_chunk()?).into(),
            Self::I64 => i64::from_le_bytes(*bytes.first_chunk()?) as f64,
            Self::U64 => u64::from_le_bytes(*bytes.first_chunk()?) as f64,
            Self::F32 => f32::from_le_bytes(*bytes.first_chunk()?).into(),
            Self::F64 => f64::from_le_bytes(*bytes.first_chunk()?),
        })
    }
}

/// Reads bytes in order and tracks the place in the file.
pub struct Cursor<'a> {
    bytes: &'a [u8],
    at: usize,
    order: Order,
    format: Format,
}

impl<'a> Cursor<'a> {
    /// Reads `bytes` from `start` on.
    pub fn new(bytes: &'a [u8], start: usize, order: Order, format: Format) -> Self {
        Self {
            bytes,
            at: start.min(bytes.len()),
            order,
            format,
        }
    }

    pub fn place(&self) -> Place {
        Place::Byte(self.at)
    }

    /// Bytes that are left.
    pub fn left(&self) -> usize {
        self.bytes.len() - self.at
    }

    pub fn number(&mut self, scalar: Scalar) -> Option<f64> {
        let value = scalar.read(&self.bytes[self.at..], self.order)?;
        self.at += scalar.size();
        Some(value)
    }

    pub fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let taken = self.bytes.get(self.at..self.at.checked_add(count)?)?;
        self.at += count;
        Some(taken)
    }

    pub fn order(&self) -> Order {
        self.order
    }

    pub fn error(&self, reason: String) -> Error {
        Error::Syntax {
            format: self.format,
            place: self.place(),
            reason,
        }
    }
}
