//! A depth camera, served.

use std::time::Duration;

use nalgebra::Point3;

use crate::Error;
use crate::arm::header;
use crate::cdr::PointCloud2;
use crate::transport::{Qos, Transport, Writer};

/// Publishes clouds as a depth camera does.
pub struct CameraServer {
    clouds: Writer<PointCloud2>,
    frame: String,
}

impl CameraServer {
    /// Offers clouds in a frame, on a topic such as `/camera/depth/color/points`. A `reliable` camera, as those of RealSense
    /// are, is heard by every reader.
    ///
    /// # Errors
    /// [`Error::Network`].
    pub fn new(
        transport: &dyn Transport,
        topic: &str,
        frame: &str,
        reliable: bool,
    ) -> Result<Self, Error> {
        let qos = Qos {
            reliable,
            latched: false,
            depth: 2,
        };
        Ok(Self {
            clouds: Writer::new(transport, topic, qos)?,
            frame: frame.to_owned(),
        })
    }

    /// Publishes the points that were seen at a time, metres.
    ///
    /// # Errors
    /// [`Error::NonFinitePoint`]; [`Error::OnTopic`] when the network does not take it.
    pub fn publish(&mut self, stamp: Duration, points: &[Point3<f64>]) -> Result<(), Error> {
        let cloud = PointCloud2::from_points(header(stamp, &self.frame), points)?;
        self.clouds.publish(&cloud)
    }
}
