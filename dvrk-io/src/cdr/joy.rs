//! `sensor_msgs/Joy`: the buttons and pedals of a dVRK.

use super::{Decoder, Encoder, Header, Message};
use crate::Error;

/// A `sensor_msgs/Joy`. A button of a dVRK is `buttons[0]`: 0 released, 1 pressed, 2 pressed and released quickly.
#[derive(Debug, Clone, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Joy {
    /// When.
    pub header: Header,
    /// Not used by a dVRK.
    pub axes: Vec<f32>,
    /// The buttons.
    pub buttons: Vec<i32>,
}

impl Joy {
    /// Whether its button is pressed and held.
    pub fn is_pressed(&self) -> bool {
        self.buttons.first() == Some(&1)
    }
}

impl Message for Joy {
    const TYPE: &'static str = "sensor_msgs/msg/Joy";

    fn read(decoder: &mut Decoder<'_>) -> Result<Self, Error> {
        const WORD: usize = 4;
        Ok(Self {
            header: Header::read(decoder)?,
            axes: decoder.sequence("axes", WORD, |d| d.u32("axes").map(f32::from_bits))?,
            buttons: decoder.sequence("buttons", WORD, |d| d.i32("buttons"))?,
        })
    }

    fn write(&self, encoder: &mut Encoder) -> Result<(), Error> {
        self.header.write(encoder)?;
        encoder.sequence("axes", &self.axes, |e, value| {
            e.u32(value.to_bits());
            Ok(())
        })?;
        encoder.sequence("buttons", &self.buttons, |e, &value| {
            e.i32(value);
            Ok(())
        })
    }
}
