//! Serves a depth camera: clouds, or depth images with their camera.
//!
//! A message is sent in one burst of packets. Readers with the default receive buffers of Linux (0.2 MB) lose most of a larger
//! message, and receive it again, at 0.6 MB a second at best; a newer message sent meanwhile delays them further. Therefore
//! frames are not published while a reader is still receiving the last message:
//!
//! ```text
//! publish  ⇔  every reliable reader has the last message,  or it was sent 1 s + bytes/(0.3 MB/s) ago
//! ```
//! A reader that has disappeared without notice thus delays the others by at most that time for each message, until the network
//! drops it.
//!
//! *Limits.* A reader of Fast DDS with default buffers gets a cloud of 300,000 points (3.6 MB) every few seconds, and a depth image
//! of as many pixels (0.6 MB) about every second. They come at the rate of the camera when its buffers take a whole message:
//! `sysctl -w net.core.rmem_max=16777216 net.core.rmem_default=16777216` on its machine, or the same `rmem_max` and a profile of
//! Fast DDS with `<receiveBufferSize>16777216</receiveBufferSize>` for its UDP transport. Readers of this crate ask for 16 MB
//! themselves, and get up to `rmem_max`.

use std::time::Duration;

use nalgebra::Point3;

use crate::Error;
use crate::arm::header;
use crate::cdr::{CameraInfo, Image, Message, PointCloud2};
use crate::depth::{DepthImage, Intrinsics};
use crate::transport::{Qos, Transport, Writer};

/// Millimetres in a metre.
const MILLI: f64 = 1e3;

/// How long a message waits for readers of the previous one: one and a half times the time that it takes to send that one
/// again.
fn patience(bytes: usize) -> Duration {
    const REPAIR_BYTES_PER_SECOND: f64 = 0.3e6;
    Duration::from_secs(1) + Duration::from_secs_f64(bytes as f64 / REPAIR_BYTES_PER_SECOND)
}

/// When the last message was sent, and how long the next one waits for its readers.
#[derive(Debug, Default)]
struct Pace {
    next: Duration,
}

impl Pace {
    fn allows<M: Message>(&self, stamp: Duration, writer: &Writer<M>) -> bool {
        stamp >= self.next || writer.is_delivered()
    }

    fn sent(&mut self, stamp: Duration, bytes: usize) {
        self.next = stamp + patience(bytes);
    }
}

fn quality(reliable: bool) -> Qos {
    Qos {
        reliable,
        latched: false,
        depth: 2,
    }
}

/// Publishes clouds as a depth camera does.
pub struct CloudServer {
    frame: String,
    clouds: Writer<PointCloud2>,
    pace: Pace,
}

impl std::fmt::Debug for CloudServer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("CloudServer")
            .field("frame", &self.frame)
            .finish_non_exhaustive()
    }
}

impl CloudServer {
    /// Publishes clouds in a frame, on a topic such as `/camera/depth/color/points`. A `reliable` camera, such as those of RealSense,
    /// is received by every reader.
    ///
    /// # Errors
    /// [`Error::Network`].
    pub fn new(
        transport: &dyn Transport,
        topic: &str,
        frame: &str,
        reliable: bool,
    ) -> Result<Self, Error> {
        Ok(Self {
            clouds: Writer::new(transport, topic, quality(reliable))?,
            frame: frame.to_owned(),
            pace: Pace::default(),
        })
    }

    /// Publishes the points measured at a time, metres. Returns whether they were sent: they are not while a reader is still receiving
    /// the last ones.
    ///
    /// # Errors
    /// [`Error::NonFinitePoint`]; [`Error::OnTopic`] when the network rejects it.
    pub fn publish(&mut self, stamp: Duration, points: &[Point3<f64>]) -> Result<bool, Error> {
        if !self.pace.allows(stamp, &self.clouds) {
            return Ok(false);
        }
        let cloud = PointCloud2::from_points(header(stamp, &self.frame), points)?;
        self.clouds.publish(&cloud)?;
        self.pace.sent(stamp, cloud.data.len());
        Ok(true)
    }
}

/// Publishes depth images in millimetres (`16UC1`), and the camera that they belong to.
pub struct DepthServer {
    images: Writer<Image>,
    infos: Writer<CameraInfo>,
    info: CameraInfo,
    pace: Pace,
}

impl std::fmt::Debug for DepthServer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("DepthServer")
            .field("info", &self.info)
            .finish_non_exhaustive()
    }
}

impl DepthServer {
    /// Publishes the images of a camera in a frame, on topics such as `/camera/depth/image_rect_raw` and
    /// `/camera/depth/camera_info`.
    ///
    /// # Errors
    /// [`Error::Network`]; [`Error::TooLong`] for a camera of more than 2³² columns or rows.
    pub fn new(
        transport: &dyn Transport,
        [image, info]: [&str; 2],
        frame: &str,
        camera: &Intrinsics,
        reliable: bool,
    ) -> Result<Self, Error> {
        let size =
            |field, length| u32::try_from(length).map_err(|_| Error::TooLong { field, length });
        let ([fx, fy], [cx, cy]) = (camera.focal(), camera.center());
        let k = [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0];
        Ok(Self {
            images: Writer::new(transport, image, quality(reliable))?,
            infos: Writer::new(transport, info, quality(reliable))?,
            info: CameraInfo {
                header: header(Duration::ZERO, frame),
                width: size("width", camera.width())?,
                height: size("height", camera.height())?,
                distortion_model: "plumb_bob".to_owned(),
                d: vec![0.0; 5],
                k,
                r: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
                p: [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
                ..CameraInfo::default()
            },
            pace: Pace::default(),
        })
    }

    /// Publishes the depths measured at a time. Pixels without a measurement, or beyond 65.5 m, are 0.
    /// Returns whether they were sent: they are not while a reader is still receiving the last image.
    ///
    /// # Errors
    /// [`Error::ImageSize`] for an image of another size than the camera; [`Error::OnTopic`] when the network rejects it.
    pub fn publish(&mut self, stamp: Duration, depths: &DepthImage) -> Result<bool, Error> {
        let (width, height) = (self.info.width as usize, self.info.height as usize);
        if (depths.width(), depths.height()) != (width, height) {
            return Err(Error::ImageSize {
                width,
                height,
                length: depths.width() * depths.height(),
            });
        }
        if !self.pace.allows(stamp, &self.images) {
            return Ok(false);
        }
        let millimetres = |depth: f64| {
            let rounded = (MILLI * depth).round();
            if rounded <= f64::from(u16::MAX) {
                rounded as u16
            } else {
                0
            }
        };
        let rows = (0..height).flat_map(|row| (0..width).map(move |column| (column, row)));
        let pixel = |(column, row)| depths.depth(column, row).map_or(0, millimetres);
        let data = rows.map(pixel).flat_map(u16::to_le_bytes).collect();
        self.info.header.stamp = header(stamp, "").stamp;
        let image = Image {
            header: self.info.header.clone(),
            height: self.info.height,
            width: self.info.width,
            encoding: "16UC1".to_owned(),
            is_bigendian: false,
            step: 2 * self.info.width,
            data,
        };
        self.infos.publish(&self.info)?;
        self.images.publish(&image)?;
        self.pace.sent(stamp, image.data.len());
        Ok(true)
    }
}
