//! `sensor_msgs/Image` and `sensor_msgs/CameraInfo`: images of a depth camera, and its projection.
//!
//! ```text
//! pixel (row, column) starts at   row · step + column · (bytes of a pixel), in the byte order of `is_bigendian`
//! ```

use super::{Decoder, Encoder, Header, Message};
use crate::Error;

/// A `sensor_msgs/Image`.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Image {
    /// When, and in which frame.
    pub header: Header,
    /// Rows.
    pub height: u32,
    /// Columns.
    pub width: u32,
    /// Type of a pixel: `16UC1`, `32FC1`, `rgb8`, ….
    pub encoding: String,
    /// Whether numbers in `data` have their most significant byte first.
    pub is_bigendian: bool,
    /// Bytes from row to row.
    pub step: u32,
    /// The pixels.
    pub data: Vec<u8>,
}

impl Image {
    /// The pixels in the order of the rows, each read by `pixel` from its `N` bytes in little-endian order.
    ///
    /// # Errors
    /// Fewer bytes than the sizes say, or rows that overlap.
    pub fn pixels<const N: usize, T>(&self, pixel: impl Fn([u8; N]) -> T) -> Result<Vec<T>, Error> {
        let (height, width, step) = (
            self.height as usize,
            self.width as usize,
            self.step as usize,
        );
        let row = width as u128 * N as u128;
        // The last row may lack the padding to `step`.
        let needed = u128::from(self.height.saturating_sub(1)) * u128::from(self.step) + row;
        let bad = |reason| Err(Error::BadImage { reason });
        if width == 0 || height == 0 {
            return bad(format!("an image of {width} × {height} pixels"));
        }
        if (height > 1 && (step as u128) < row) || needed > self.data.len() as u128 {
            return bad(format!(
                "{width} × {height} pixels of {N} bytes, {step} bytes a row, need {needed} bytes; data has {}",
                self.data.len()
            ));
        }
        let read = |bytes: &[u8]| {
            let mut value = [0; N];
            value.copy_from_slice(bytes);
            if self.is_bigendian {
                value.reverse();
            }
            pixel(value)
        };
        let rows = (0..height).map(|index| &self.data[index * step..]);
        Ok(rows
            .flat_map(|row| row.chunks_exact(N).take(width))
            .map(read)
            .collect())
    }
}

impl Message for Image {
    const TYPE: &'static str = "sensor_msgs/msg/Image";

    fn read(decoder: &mut Decoder<'_>) -> Result<Self, Error> {
        Ok(Self {
            header: Header::read(decoder)?,
            height: decoder.u32("height")?,
            width: decoder.u32("width")?,
            encoding: decoder.string("encoding")?,
            is_bigendian: decoder.bool("is_bigendian")?,
            step: decoder.u32("step")?,
            data: decoder.bytes("data")?.to_vec(),
        })
    }

    fn write(&self, encoder: &mut Encoder) -> Result<(), Error> {
        self.header.write(encoder)?;
        encoder.u32(self.height);
        encoder.u32(self.width);
        encoder.string("encoding", &self.encoding)?;
        encoder.bool(self.is_bigendian);
        encoder.u32(self.step);
        encoder.bytes("data", &self.data)
    }
}

/// A `sensor_msgs/CameraInfo`.
#[derive(Debug, Clone, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct CameraInfo {
    /// When, and in which frame.
    pub header: Header,
    /// Rows.
    pub height: u32,
    /// Columns.
    pub width: u32,
    /// `plumb_bob`, ….
    pub distortion_model: String,
    /// Coefficients of the distortion.
    pub d: Vec<f64>,
    /// Camera matrix of the image as it was taken, row by row.
    pub k: [f64; 9],
    /// Rotation that rectifies.
    pub r: [f64; 9],
    /// Projection of the rectified image, row by row; zeros where there is none.
    pub p: [f64; 12],
    /// Horizontal binning: pixels that were merged into one; 0 and 1 mean none.
    pub binning_x: u32,
    /// Vertical binning.
    pub binning_y: u32,
    /// Region of interest on the sensor: column, row, rows, columns; zeros mean all of it.
    pub roi: [u32; 4],
    /// Whether the region was rectified on its own.
    pub roi_do_rectify: bool,
}

impl Message for CameraInfo {
    const TYPE: &'static str = "sensor_msgs/msg/CameraInfo";

    fn read(decoder: &mut Decoder<'_>) -> Result<Self, Error> {
        const DOUBLE: usize = 8;
        Ok(Self {
            header: Header::read(decoder)?,
            height: decoder.u32("height")?,
            width: decoder.u32("width")?,
            distortion_model: decoder.string("distortion_model")?,
            d: decoder.sequence("d", DOUBLE, |d| d.f64("d"))?,
            k: decoder.f64_array("k")?,
            r: decoder.f64_array("r")?,
            p: decoder.f64_array("p")?,
            binning_x: decoder.u32("binning_x")?,
            binning_y: decoder.u32("binning_y")?,
            roi: [
                decoder.u32("roi.x_offset")?,
                decoder.u32("roi.y_offset")?,
                decoder.u32("roi.height")?,
                decoder.u32("roi.width")?,
            ],
            roi_do_rectify: decoder.bool("roi.do_rectify")?,
        })
    }

    fn write(&self, encoder: &mut Encoder) -> Result<(), Error> {
        self.header.write(encoder)?;
        encoder.u32(self.height);
        encoder.u32(self.width);
        encoder.string("distortion_model", &self.distortion_model)?;
        encoder.sequence("d", &self.d, |e, &value| {
            e.f64(value);
            Ok(())
        })?;
        encoder.f64_array(&self.k);
        encoder.f64_array(&self.r);
        encoder.f64_array(&self.p);
        encoder.u32(self.binning_x);
        encoder.u32(self.binning_y);
        self.roi.iter().for_each(|&value| encoder.u32(value));
        encoder.bool(self.roi_do_rectify);
        Ok(())
    }
}
