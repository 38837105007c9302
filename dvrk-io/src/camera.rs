//! A depth camera on a ROS 2 network: its newest frame, as a [`Scan`] for
//! [`find_object`](crate::depth::find_object).
//!
//! ```text
//! cloud     sensor_msgs/PointCloud2                               6 MB a frame of 300,000 points
//! depth     sensor_msgs/Image (16UC1, 32FC1) + CameraInfo         0.6 MB for the same: preferable if available
//! ```
//! With colour images, a depth image waits up to 50 ms for the one that was taken with it; then it is used without colours.
//!
//! Frames that were not requested are skipped: the next one is the newest one. Cameras offer reliable or best-effort streams; a
//! reader that requests *reliable* receives nothing from a best-effort camera, and one that does not loses whole clouds of a reliable
//! camera when a single packet is lost. The reader therefore requests what the camera offers, and adapts when another camera takes over.
//!
//! A cloud comes in thousands of packets: the receive buffers of the system (`net.core.rmem_max` on Linux) should hold one, 8 MB
//! or more, or clouds are lost.

use derive_setters::Setters;
use std::sync::Arc;
use std::time::Duration;

use crate::Error;
use crate::arm::{Absence, MissingStream};
use crate::cdr::{CameraInfo, Header, Image, Message, PointCloud2};
use crate::depth::{LengthUnit, Scan};
use crate::transport::{Qos, Reader, Transport};

/// Interval for checking whether the camera still offers what the reader requests.
const LOOK_AGAIN: Duration = Duration::from_millis(500);

/// The topics of a camera.
#[derive(Debug, Clone, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub enum CameraTopics {
    /// A `sensor_msgs/PointCloud2`.
    Cloud(String),
    /// A depth image and its `CameraInfo`.
    Depth {
        /// A `sensor_msgs/Image`.
        image: String,
        /// A `sensor_msgs/CameraInfo`.
        info: String,
        /// A `sensor_msgs/Image` with colours, if there is one with the same rays: of a depth that is aligned to the colour.
        colour: Option<String>,
    },
}

/// Options for reading a camera.
#[derive(Debug, Clone, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct CameraOptions {
    /// The unit of its lengths; `None`: determined as by [`Scan`].
    pub unit: Option<LengthUnit>,
    /// Older frames are skipped. Default 1 s.
    pub stale: Duration,
}

impl Default for CameraOptions {
    fn default() -> Self {
        Self {
            unit: None,
            stale: Duration::from_secs(1),
        }
    }
}

/// One frame.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraFrame {
    /// Time at which it was taken, by the clock of the camera, since the epoch.
    pub stamp: Duration,
    /// The frame of its points.
    pub frame: String,
    /// The points, in metres.
    pub scan: Scan,
}

/// A reader that requests the offered quality of service.
struct Follower<M> {
    reader: Reader<M>,
    looked: Duration,
}

impl<M: Message> Follower<M> {
    fn new(transport: &dyn Transport, name: &str) -> Result<Self, Error> {
        let qos = offered::<M>(transport, name).unwrap_or(Qos::NEWEST);
        Ok(Self {
            reader: Reader::new(transport, name, qos)?,
            looked: transport.now(),
        })
    }

    fn newest(&mut self, transport: &dyn Transport) -> Result<Option<M>, Error> {
        let message = self.reader.newest();
        let now = transport.now();
        if matches!(message, Ok(Some(_))) || now < self.looked + LOOK_AGAIN {
            return message;
        }
        self.looked = now;
        let topic = self.reader.topic().clone();
        if let Some(qos) = offered::<M>(transport, &topic.name)
            && qos != topic.qos
        {
            self.reader = Reader::new(transport, topic.name, qos)?;
        }
        message
    }
}

/// The quality to request of a topic: reliable if all its publishers are.
fn offered<M: Message>(transport: &dyn Transport, name: &str) -> Option<Qos> {
    let writers = transport.writers(name);
    let mut ours = writers
        .iter()
        .filter(|writer| writer.kind == M::TYPE)
        .peekable();
    ours.peek()?;
    Some(Qos {
        reliable: ours.all(|writer| writer.qos.reliable),
        latched: false,
        depth: 2,
    })
}

/// Rejects a colour image from another point of view than the depth image.
fn of_same_view(depth: &Image, colour: &Image) -> Result<(), Error> {
    let [depth, colour] = [depth, colour].map(|image| &image.header.frame_id);
    if depth == colour {
        return Ok(());
    }
    let reason = format!(
        "the colour image is in frame `{colour}`, the depth image in `{depth}`: align the depth to the colour"
    );
    Err(Error::BadImage { reason })
}

enum Source {
    Cloud(Follower<PointCloud2>),
    Depth {
        image: Follower<Image>,
        info: Follower<CameraInfo>,
        last: Box<Option<CameraInfo>>,
        colour: Option<Box<Colours>>,
    },
}

/// Colour images, and the depth image that waits for its own.
struct Colours {
    images: Follower<Image>,
    newest: Option<Image>,
    waiting: Option<(Image, Duration)>,
}

/// Largest difference of the stamps of a depth image and its colour image: half a period at 30 Hz.
const TOGETHER: Duration = Duration::from_millis(17);
/// How long a depth image waits for its colour image.
const WAIT: Duration = Duration::from_millis(50);

impl Colours {
    fn open(transport: &dyn Transport, topic: &str) -> Result<Box<Self>, Error> {
        Ok(Box::new(Self {
            images: Follower::new(transport, topic)?,
            newest: None,
            waiting: None,
        }))
    }

    /// A depth image with its colour image, or alone when it has waited long enough; `depth` has just come.
    fn pair(
        &mut self,
        transport: &dyn Transport,
        depth: Option<Image>,
    ) -> Result<Option<(Image, Option<Image>)>, Error> {
        let now = transport.now();
        if let Some(image) = self.images.newest(transport)? {
            self.newest = Some(image);
        }
        if let Some(depth) = depth {
            // The time counts from the first that waits, or a camera without colours would never give a frame.
            let since = self.waiting.as_ref().map_or(now, |(_, since)| *since);
            self.waiting = Some((depth, since));
        }
        let Some((depth, since)) = self.waiting.take() else {
            return Ok(None);
        };
        let stamp = |image: &Image| Duration::from_nanos(image.header.stamp.nanoseconds());
        let own = |colour: &Image| stamp(colour).abs_diff(stamp(&depth)) <= TOGETHER;
        if self.newest.as_ref().is_some_and(own) {
            return Ok(Some((depth, self.newest.take())));
        }
        if now >= since + WAIT {
            return Ok(Some((depth, None)));
        }
        self.waiting = Some((depth, since));
        Ok(None)
    }
}

/// A camera on the network.
pub struct Camera {
    transport: Arc<dyn Transport>,
    options: CameraOptions,
    source: Source,
    /// Why the last frame was rejected, if it was.
    trouble: Option<Absence>,
}

impl std::fmt::Debug for Camera {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Camera")
            .field("options", &self.options)
            .finish_non_exhaustive()
    }
}

impl Camera {
    /// Starts to listen; [`Camera::next_frame`] reports whether anything arrives.
    ///
    /// # Errors
    /// [`Error::Network`].
    pub fn open(
        transport: Arc<dyn Transport>,
        topics: &CameraTopics,
        options: CameraOptions,
    ) -> Result<Self, Error> {
        let source = match topics {
            CameraTopics::Cloud(topic) => Source::Cloud(Follower::new(transport.as_ref(), topic)?),
            CameraTopics::Depth {
                image,
                info,
                colour,
            } => Source::Depth {
                image: Follower::new(transport.as_ref(), image)?,
                info: Follower::new(transport.as_ref(), info)?,
                last: Box::default(),
                colour: match colour {
                    Some(topic) => Some(Colours::open(transport.as_ref(), topic)?),
                    None => None,
                },
            },
        };
        Ok(Self {
            transport,
            options,
            source,
            trouble: None,
        })
    }

    /// The newest frame since the last one, if one has come.
    ///
    /// # Errors
    /// An inconsistent message: see [`Scan::from_cloud`] and [`Scan::from_depth`].
    pub fn try_frame(&mut self) -> Result<Option<CameraFrame>, Error> {
        let (transport, unit) = (self.transport.as_ref(), self.options.unit);
        let (header, scan) = match &mut self.source {
            Source::Cloud(clouds) => {
                let Some(cloud) = clouds.newest(transport)? else {
                    return Ok(None);
                };
                let scan = Scan::from_cloud(&cloud, unit)?;
                (cloud.header, scan)
            }
            Source::Depth {
                image,
                info,
                last,
                colour,
            } => {
                if let Some(info) = info.newest(transport)? {
                    **last = Some(info);
                }
                let Some(info) = last.as_ref() else {
                    return Ok(None);
                };
                let image = image.newest(transport)?;
                let pair = match colour {
                    Some(colours) => colours.pair(transport, image)?,
                    None => image.map(|image| (image, None)),
                };
                let Some((image, colour)) = pair else {
                    return Ok(None);
                };
                let mut scan = Scan::from_depth(&image, info, unit)?;
                if let Some(colour) = colour {
                    let colours =
                        of_same_view(&image, &colour).and_then(|()| scan.colours_of(&colour))?;
                    scan = scan.with_colours(colours);
                }
                (image.header, scan)
            }
        };
        Ok(self.dated(header, scan))
    }

    /// `None` for a frame that is too old.
    fn dated(&mut self, header: Header, scan: Scan) -> Option<CameraFrame> {
        let stamp = Duration::from_nanos(header.stamp.nanoseconds());
        let now = self.transport.now();
        if stamp + self.options.stale < now {
            let age = now.saturating_sub(stamp).as_secs_f64();
            self.trouble = Some(Absence::Old(age));
            return None;
        }
        self.trouble = None;
        Some(CameraFrame {
            stamp,
            frame: header.frame_id,
            scan,
        })
    }

    /// Waits for the next frame.
    ///
    /// # Errors
    /// [`Error::StreamsMissing`] after `timeout`, with the reason; see also [`Camera::try_frame`].
    pub fn next_frame(&mut self, timeout: Duration) -> Result<CameraFrame, Error> {
        let end = self.transport.now() + timeout;
        loop {
            if let Some(frame) = self.try_frame()? {
                return Ok(frame);
            }
            let now = self.transport.now();
            if now >= end {
                return Err(Error::StreamsMissing {
                    arm: "camera".to_owned(),
                    waited: timeout.as_secs_f64(),
                    streams: self.missing(),
                });
            }
            // No longer than the interval for checking for other cameras.
            self.transport.wait(end.min(now + LOOK_AGAIN / 2));
        }
    }

    fn missing(&self) -> Vec<MissingStream> {
        fn of<M: Message>(camera: &Camera, follower: &Follower<M>) -> MissingStream {
            let unheard = || crate::arm::unheard(camera.transport.as_ref(), &follower.reader);
            MissingStream {
                topic: follower.reader.topic().name.clone(),
                reason: camera.trouble.clone().unwrap_or_else(unheard),
            }
        }
        match &self.source {
            Source::Cloud(clouds) => vec![of(self, clouds)],
            Source::Depth { image, last, .. } if last.is_some() => vec![of(self, image)],
            Source::Depth { info, .. } => vec![of(self, info)],
        }
    }
}
