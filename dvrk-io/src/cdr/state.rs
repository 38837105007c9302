//! `crtk_msgs`: the state of an arm, and text with a stamp.

use super::{Decoder, Encoder, Header, Message};
use crate::Error;

/// A `crtk_msgs/OperatingState`.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct OperatingState {
    /// Time of the last change.
    pub header: Header,
    /// `DISABLED`, `ENABLED`, `PAUSED` or `FAULT`.
    pub state: String,
    /// Whether the joint encoders are referenced and an instrument is engaged.
    pub is_homed: bool,
    /// Whether the arm moves on its own: powering, homing, a trajectory, guided by hand.
    pub is_busy: bool,
}

impl Message for OperatingState {
    const TYPE: &'static str = "crtk_msgs/msg/OperatingState";

    fn read(decoder: &mut Decoder<'_>) -> Result<Self, Error> {
        Ok(Self {
            header: Header::read(decoder)?,
            state: decoder.string("state")?,
            is_homed: decoder.bool("is_homed")?,
            is_busy: decoder.bool("is_busy")?,
        })
    }

    fn write(&self, encoder: &mut Encoder) -> Result<(), Error> {
        self.header.write(encoder)?;
        encoder.string("state", &self.state)?;
        encoder.bool(self.is_homed);
        encoder.bool(self.is_busy);
        Ok(())
    }
}

/// A `crtk_msgs/StringStamped`: a `state_command`, or a message of a simulator.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct StringStamped {
    /// When.
    pub header: Header,
    /// The text.
    pub string: String,
}

impl Message for StringStamped {
    const TYPE: &'static str = "crtk_msgs/msg/StringStamped";

    fn read(decoder: &mut Decoder<'_>) -> Result<Self, Error> {
        Ok(Self {
            header: Header::read(decoder)?,
            string: decoder.string("string")?,
        })
    }

    fn write(&self, encoder: &mut Encoder) -> Result<(), Error> {
        self.header.write(encoder)?;
        encoder.string("string", &self.string)
    }
}
