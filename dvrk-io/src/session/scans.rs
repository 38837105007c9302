//! A recording of everything in view: scan by scan in the order of time, each with the nearest arm samples.

use nalgebra::UnitVector3;

use super::frame::{RecordedScan, TopicCount};
use super::frames::{Frames, seconds};
use super::index::Track;
use super::skipped::Skipped;
use super::topic::Role;
use crate::Error;
use crate::cdr::{self, CameraInfo, Image, PointCloud2};
use crate::depth::Scan;

/// The scans of a recording, in the order of time: see [`SessionReader::scans`](super::SessionReader::scans).
///
/// Messages that cannot be decoded, or are inconsistent, are skipped and reported in [`Scans::skipped`]. An error ends the scans; it occurs
/// only if the file can no longer be read.
#[derive(Debug)]
pub struct Scans<'a> {
    frames: Frames<'a>,
    /// Camera parameters of the images; empty for clouds.
    lenses: Track<CameraInfo>,
}

impl<'a> Scans<'a> {
    /// # Errors
    /// Images without `CameraInfo`; a moving camera.
    pub(super) fn new(mut frames: Frames<'a>) -> Result<Self, Error> {
        if frames.camera_moves() {
            return Err(Error::ScansOfMovingCamera);
        }
        let index = frames.index();
        let images = std::mem::take(&mut index.images);
        let lenses = std::mem::take(&mut index.lenses);
        // Only images from the point of view of the depth images show the colours of their points.
        if images.is_empty() || index.colour_frame != index.camera_frame {
            index.colours.clear();
        }
        if images.is_empty() {
            let lenses = Track::new();
            return Ok(Self { frames, lenses });
        }
        if lenses.is_empty() {
            let names: Vec<_> = index.topics.iter().map(|t| t.topic.as_str()).collect();
            return Err(Error::NoSuchTopic {
                topic: Role::CameraInfo.topic(),
                available: names.join(", "),
            });
        }
        index.clouds = images;
        Ok(Self { frames, lenses })
    }

    /// The table, if it was recorded: `normal · x + offset ≥ 0` on the free side, camera frame.
    pub fn table(&self) -> Option<(UnitVector3<f64>, f64)> {
        self.frames.table()
    }

    /// Names of the arms, sorted.
    pub fn arm_names(&self) -> &[String] {
        self.frames.arm_names()
    }

    /// Name of the frame of the camera.
    pub fn camera_frame(&self) -> &str {
        self.frames.camera_frame()
    }

    /// Every topic of the recording, sorted.
    pub fn topics(&self) -> &[TopicCount] {
        self.frames.topics()
    }

    /// What was skipped so far.
    pub fn skipped(&self) -> &Skipped {
        self.frames.skipped()
    }

    /// Stamps of the remaining scans, seconds, in order. One that turns out to be damaged gives no scan.
    pub fn stamps(&self) -> impl ExactSizeIterator<Item = f64> + '_ {
        self.frames.stamps()
    }
}

impl Iterator for Scans<'_> {
    type Item = Result<RecordedScan, Error>;

    fn next(&mut self) -> Option<Self::Item> {
        let lenses = &self.lenses;
        self.frames.next_with(|frames, stamp, data| {
            let scan = match scan(data, lens(lenses, stamp)) {
                Ok(scan) => frames.coloured(scan, stamp)?,
                Err(error) => return Ok(Err(error)),
            };
            Ok(Ok(RecordedScan {
                stamp: seconds(stamp),
                scan,
                arms: frames.samples(stamp),
            }))
        })
    }
}

/// The camera parameters at a time: the last ones before it, else the first.
fn lens(lenses: &Track<CameraInfo>, stamp: u64) -> Option<&CameraInfo> {
    let after = lenses.partition_point(|(time, _)| *time <= stamp);
    let lens = lenses.get(after.saturating_sub(1));
    lens.map(|(_, lens)| lens)
}

/// # Errors
/// The message cannot be decoded, or is inconsistent in itself or with the camera parameters.
fn scan(data: &[u8], lens: Option<&CameraInfo>) -> Result<Scan, Error> {
    let Some(lens) = lens else {
        let cloud: PointCloud2 = cdr::decode(data)?;
        return Scan::from_cloud(&cloud, None);
    };
    let image: Image = cdr::decode(data)?;
    Scan::from_depth(&image, lens, None)
}
