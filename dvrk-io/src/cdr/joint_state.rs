//! `sensor_msgs/JointState`: values of the joints of an arm, and of its jaw.

use super::{Decoder, Encoder, Header, Message};
use crate::Error;

/// A `sensor_msgs/JointState`. Sequences that are not measured stay empty.
#[derive(Debug, Clone, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct JointState {
    /// When, and in which frame.
    pub header: Header,
    /// One name a joint.
    pub name: Vec<String>,
    /// Radians or metres.
    pub position: Vec<f64>,
    /// Radians or metres a second.
    pub velocity: Vec<f64>,
    /// Newton metres or newtons.
    pub effort: Vec<f64>,
}

impl Message for JointState {
    const TYPE: &'static str = "sensor_msgs/msg/JointState";

    fn read(decoder: &mut Decoder<'_>) -> Result<Self, Error> {
        // The shortest string is only a length.
        const STRING: usize = 4;
        const DOUBLE: usize = 8;
        Ok(Self {
            header: Header::read(decoder)?,
            name: decoder.sequence("name", STRING, |d| d.string("name"))?,
            position: decoder.sequence("position", DOUBLE, |d| d.f64("position"))?,
            velocity: decoder.sequence("velocity", DOUBLE, |d| d.f64("velocity"))?,
            effort: decoder.sequence("effort", DOUBLE, |d| d.f64("effort"))?,
        })
    }

    fn write(&self, encoder: &mut Encoder) -> Result<(), Error> {
        self.header.write(encoder)?;
        encoder.sequence("name", &self.name, |e, name| e.string("name", name))?;
        for (field, values) in [
            ("position", &self.position),
            ("velocity", &self.velocity),
            ("effort", &self.effort),
        ] {
            encoder.sequence(field, values, |e, &value| {
                e.f64(value);
                Ok(())
            })?;
        }
        Ok(())
    }
}
