//! `std_msgs`: String, Bool, Float64 and Empty.

use super::{Decoder, Encoder, Message};
use crate::Error;

/// A `std_msgs/String`.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Text {
    /// The text.
    pub data: String,
}

impl Message for Text {
    const TYPE: &'static str = "std_msgs/msg/String";

    fn read(decoder: &mut Decoder<'_>) -> Result<Self, Error> {
        Ok(Self {
            data: decoder.string("data")?,
        })
    }

    fn write(&self, encoder: &mut Encoder) -> Result<(), Error> {
        encoder.string("data", &self.data)
    }
}

/// A `std_msgs/Bool`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Bool {
    /// The value.
    pub data: bool,
}

impl Message for Bool {
    const TYPE: &'static str = "std_msgs/msg/Bool";

    fn read(decoder: &mut Decoder<'_>) -> Result<Self, Error> {
        Ok(Self {
            data: decoder.bool("data")?,
        })
    }

    fn write(&self, encoder: &mut Encoder) -> Result<(), Error> {
        encoder.bool(self.data);
        Ok(())
    }
}

/// A `std_msgs/Float64`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Float64 {
    /// The value.
    pub data: f64,
}

impl Message for Float64 {
    const TYPE: &'static str = "std_msgs/msg/Float64";

    fn read(decoder: &mut Decoder<'_>) -> Result<Self, Error> {
        Ok(Self {
            data: decoder.f64("data")?,
        })
    }

    fn write(&self, encoder: &mut Encoder) -> Result<(), Error> {
        encoder.f64(self.data);
        Ok(())
    }
}

/// A `std_msgs/Empty`. On the wire it is one byte without meaning, as IDL has no empty structures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Empty;

impl Message for Empty {
    const TYPE: &'static str = "std_msgs/msg/Empty";

    fn read(decoder: &mut Decoder<'_>) -> Result<Self, Error> {
        decoder
            .u8("structure_needs_at_least_one_member")
            .map(|_| Self)
    }

    fn write(&self, encoder: &mut Encoder) -> Result<(), Error> {
        encoder.u8(0);
        Ok(())
    }
}
