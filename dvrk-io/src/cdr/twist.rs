//! Velocities and forces: `geometry_msgs/TwistStamped` and `geometry_msgs/WrenchStamped`.

use super::{Decoder, Encoder, Header, Message};
use crate::Error;

/// A `geometry_msgs/TwistStamped`.
#[derive(Debug, Clone, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct TwistStamped {
    /// When, and in which frame.
    pub header: Header,
    /// m/s.
    pub linear: [f64; 3],
    /// rad/s.
    pub angular: [f64; 3],
}

impl Message for TwistStamped {
    const TYPE: &'static str = "geometry_msgs/msg/TwistStamped";

    fn read(decoder: &mut Decoder<'_>) -> Result<Self, Error> {
        Ok(Self {
            header: Header::read(decoder)?,
            linear: decoder.f64_array("twist.linear")?,
            angular: decoder.f64_array("twist.angular")?,
        })
    }

    fn write(&self, encoder: &mut Encoder) -> Result<(), Error> {
        self.header.write(encoder)?;
        encoder.f64_array(&self.linear);
        encoder.f64_array(&self.angular);
        Ok(())
    }
}

/// A `geometry_msgs/WrenchStamped`.
#[derive(Debug, Clone, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct WrenchStamped {
    /// When, and in which frame.
    pub header: Header,
    /// N.
    pub force: [f64; 3],
    /// N·m.
    pub torque: [f64; 3],
}

impl Message for WrenchStamped {
    const TYPE: &'static str = "geometry_msgs/msg/WrenchStamped";

    fn read(decoder: &mut Decoder<'_>) -> Result<Self, Error> {
        Ok(Self {
            header: Header::read(decoder)?,
            force: decoder.f64_array("wrench.force")?,
            torque: decoder.f64_array("wrench.torque")?,
        })
    }

    fn write(&self, encoder: &mut Encoder) -> Result<(), Error> {
        self.header.write(encoder)?;
        encoder.f64_array(&self.force);
        encoder.f64_array(&self.torque);
        Ok(())
    }
}
