//! The scan of a depth camera, from any message: points with optional rows and optional colours.
//!
//! ```text
//! PointCloud2                the points themselves; a cloud with rows is a grid
//! Image + CameraInfo         X(u, v) = z · ((u − cx)/fx, (v − cy)/fy, 1)
//! DepthImage + Intrinsics    the same, without a message
//! ```
//! A point that was not measured is NaN, infinite, or zero, depending on the camera. Lengths are metres by the
//! conventions of ROS for `32FC1` images and clouds, millimetres for `16UC1`; cameras that send millimetres as
//! floats exist, and are recognised by their range.

use std::fmt;

use nalgebra::Point3;

use super::{DepthImage, Intrinsics};
use crate::Error;
use crate::cdr::{CameraInfo, Image, PointCloud2};

/// The unit of lengths in a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum LengthUnit {
    /// 1.
    Metres,
    /// 0.001.
    Millimetres,
}

impl LengthUnit {
    pub(crate) fn plural(self) -> &'static str {
        match self {
            Self::Metres => "metres",
            Self::Millimetres => "millimetres",
        }
    }

    /// Metres in one unit.
    pub fn in_metres(self) -> f64 {
        match self {
            Self::Metres => 1.0,
            Self::Millimetres => 0.001,
        }
    }
}

/// How the unit of a scan was determined.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum UnitSource {
    /// By the caller.
    Given,
    /// By the encoding of the image: `16UC1` is in millimetres.
    Encoding,
    /// By the median distance: from 20 on it is in millimetres, since no camera measures nearer than 20 mm, or farther than 20 m
    /// in a cell.
    Range,
}

impl fmt::Display for LengthUnit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Metres => "metres",
            Self::Millimetres => "millimetres",
        })
    }
}

impl fmt::Display for UnitSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Given => "as given",
            Self::Encoding => "by the encoding",
            Self::Range => "by the range",
        })
    }
}

/// A median distance of at least this many units is in millimetres.
const MILLIMETRES_FROM: f64 = 20.0;

/// Plausible median distances of a depth image, m: outside, the unit must be wrong. (Clouds may be in any frame.)
const RANGES: std::ops::Range<f64> = 0.02..20.0;

/// Points measured by a depth camera, in metres.
#[derive(Debug, Clone, PartialEq)]
pub struct Scan {
    /// In the order of the message; NaN where not measured.
    points: Vec<Point3<f64>>,
    colours: Option<Vec<[u8; 3]>>,
    /// Columns; 0 for points without rows.
    width: usize,
    unit: LengthUnit,
    unit_source: UnitSource,
}

impl Scan {
    /// Converts a cloud; `unit` is determined by its range unless it is given.
    ///
    /// # Errors
    /// See [`PointCloud2::points`] and [`PointCloud2::colours`].
    pub fn from_cloud(cloud: &PointCloud2, unit: Option<LengthUnit>) -> Result<Self, Error> {
        Ok(Self::of(
            cloud.points()?,
            cloud.colours()?,
            [cloud.width as usize, cloud.height as usize],
            unit.map(|unit| (unit, UnitSource::Given)),
        ))
    }

    /// Converts a rectified depth image (`16UC1`, `mono16` or `32FC1`); `unit` is determined by encoding and range unless
    /// it is given.
    ///
    /// # Errors
    /// Another encoding, an inconsistent image or one of another size than the camera, a camera
    /// without focal lengths, or [`Error::DepthUnit`].
    pub fn from_depth(
        image: &Image,
        info: &CameraInfo,
        unit: Option<LengthUnit>,
    ) -> Result<Self, Error> {
        let given = unit.map(|unit| (unit, UnitSource::Given));
        let (depths, unit): (Vec<f64>, _) = match image.encoding.as_str() {
            "16UC1" | "mono16" => (
                image.pixels(|bytes| f64::from(u16::from_le_bytes(bytes)))?,
                given.or(Some((LengthUnit::Millimetres, UnitSource::Encoding))),
            ),
            "32FC1" => (
                image.pixels(|bytes| f64::from(f32::from_le_bytes(bytes)))?,
                given,
            ),
            other => {
                let reason = format!("encoding `{other}` is not a depth: use 16UC1 or 32FC1");
                return Err(Error::BadImage { reason });
            }
        };
        if (image.width, image.height) != (info.width, info.height) {
            let reason = format!(
                "the image has {} × {} pixels, but its camera {} × {}",
                image.width, image.height, info.width, info.height
            );
            return Err(Error::BadImage { reason });
        }
        Self::of_depths(depths, &intrinsics(info)?, unit)
    }

    /// Converts a rectified depth image without a message. Point i belongs to pixel row · width + column.
    ///
    /// # Errors
    /// Image and camera of different size, or [`Error::DepthUnit`].
    ///
    /// ```
    /// use dvrk_io::Error;
    /// use dvrk_io::depth::{DepthImage, Intrinsics, Scan};
    ///
    /// let camera = Intrinsics::new(2, 1, [500.0; 2], [0.5, 0.0])?;
    /// let scan = Scan::from_image(&DepthImage::from_units(2, 1, &[400, 410], 0.001)?, &camera)?;
    /// assert!((scan.points()[1].z - 0.41).abs() < 1e-6);
    /// // Millimetres, taken for metres.
    /// let wrong = Scan::from_image(&DepthImage::from_metres(2, 1, &[400.0, 410.0])?, &camera);
    /// assert!(matches!(wrong, Err(Error::DepthUnit { .. })));
    /// # Ok::<(), Error>(())
    /// ```
    pub fn from_image(image: &DepthImage, camera: &Intrinsics) -> Result<Self, Error> {
        let (width, height) = (camera.width(), camera.height());
        if (image.width(), image.height()) != (width, height) {
            return Err(Error::ImageSize {
                width,
                height,
                length: image.width() * image.height(),
            });
        }
        let row = |row| (0..width).map(move |column| image.depth(column, row));
        let depths = (0..height).flat_map(row);
        let metres = (LengthUnit::Metres, UnitSource::Given);
        Self::of_depths(depths.map(Option::unwrap_or_default), camera, Some(metres))
    }

    /// Depths row by row; zero and negative values are not measured, as nothing is visible behind the camera.
    fn of_depths(
        depths: impl IntoIterator<Item = f64>,
        camera: &Intrinsics,
        unit: Option<(LengthUnit, UnitSource)>,
    ) -> Result<Self, Error> {
        let width = camera.width();
        let point = |(index, depth): (usize, f64)| {
            let (column, row) = (index % width, index / width);
            let depth = if depth > 0.0 { depth } else { f64::NAN };
            camera.back_project(column as f64, row as f64, depth)
        };
        let points = depths.into_iter().enumerate().map(point).collect();
        let scan = Self::of(points, None, [width, camera.height()], unit);
        match median_range(&scan.points) {
            Some(median) if !RANGES.contains(&median) => {
                let unit = scan.unit;
                Err(Error::DepthUnit { median, unit })
            }
            _ => Ok(scan),
        }
    }

    fn of(
        mut points: Vec<Point3<f64>>,
        colours: Option<Vec<[u8; 3]>>,
        [width, height]: [usize; 2],
        unit: Option<(LengthUnit, UnitSource)>,
    ) -> Self {
        let (unit, unit_source) =
            unit.unwrap_or_else(|| (unit_by_range(&points), UnitSource::Range));
        for point in &mut points {
            if is_measured(point) {
                *point *= unit.in_metres();
            } else {
                *point = Point3::new(f64::NAN, f64::NAN, f64::NAN);
            }
        }
        Self {
            points,
            colours,
            width: if height > 1 { width } else { 0 },
            unit,
            unit_source,
        }
    }

    /// The points in the order of the message, metres; NaN where nothing was measured.
    pub fn points(&self) -> &[Point3<f64>] {
        &self.points
    }

    /// Red, green and blue of each point, if the message has them.
    pub fn colours(&self) -> Option<&[[u8; 3]]> {
        self.colours.as_deref()
    }

    /// The colour of each point, from a colour image with the same rays (`rgb8`, `bgr8`, `rgba8`, `bgra8` or `mono8`): that of a RealSense whose
    /// depth is aligned to its colour.
    ///
    /// # Errors
    /// [`Error::BadImage`]: another encoding, another size than the scan, a scan without rows, an inconsistent image.
    pub fn colours_of(&self, image: &Image) -> Result<Vec<[u8; 3]>, Error> {
        let colours = match image.encoding.as_str() {
            "rgb8" => image.pixels(|rgb: [u8; 3]| rgb)?,
            "bgr8" => image.pixels(|[b, g, r]: [u8; 3]| [r, g, b])?,
            "rgba8" => image.pixels(|[r, g, b, _]: [u8; 4]| [r, g, b])?,
            "bgra8" => image.pixels(|[b, g, r, _]: [u8; 4]| [r, g, b])?,
            "mono8" => image.pixels(|[grey]: [u8; 1]| [grey; 3])?,
            other => {
                let reason = format!(
                    "encoding `{other}` is not a colour: use rgb8, bgr8, rgba8, bgra8 or mono8"
                );
                return Err(Error::BadImage { reason });
            }
        };
        let rows = self.points.len().checked_div(self.width).unwrap_or(0);
        if (image.width as usize, image.height as usize) != (self.width, rows) {
            let reason = format!(
                "the colour image has {} × {} pixels, the depth image {} × {rows}: align the depth to the colour",
                image.width, image.height, self.width
            );
            return Err(Error::BadImage { reason });
        }
        Ok(colours)
    }

    /// The scan with these colours, if there is one for each point.
    pub(crate) fn with_colours(self, colours: Vec<[u8; 3]>) -> Self {
        let fits = colours.len() == self.points.len();
        Self {
            colours: if fits { Some(colours) } else { self.colours },
            ..self
        }
    }

    /// Columns, if neighbours in the message are neighbours in the image.
    pub fn columns(&self) -> Option<usize> {
        (self.width > 1).then_some(self.width)
    }

    /// The unit of the message, and how it was determined.
    pub fn unit(&self) -> (LengthUnit, UnitSource) {
        (self.unit, self.unit_source)
    }
}

/// Larger coordinates are invalid, whatever the unit: sums and squares of smaller ones are accurate enough.
const FARTHEST: f64 = 1e7;

pub(super) fn is_measured(point: &Point3<f64>) -> bool {
    point.iter().all(|value| value.abs() < FARTHEST) && *point != Point3::origin()
}

/// The median distance of the measured points.
fn median_range(points: &[Point3<f64>]) -> Option<f64> {
    let measured = points.iter().filter(|point| is_measured(point));
    let mut ranges: Vec<f64> = measured.map(|point| point.coords.norm()).collect();
    let middle = ranges.len() / 2;
    (middle < ranges.len()).then(|| {
        let (_, median, _) = ranges.select_nth_unstable_by(middle, f64::total_cmp);
        *median
    })
}

fn unit_by_range(points: &[Point3<f64>]) -> LengthUnit {
    match median_range(points) {
        Some(median) if median >= MILLIMETRES_FROM => LengthUnit::Millimetres,
        _ => LengthUnit::Metres,
    }
}

/// A rectified image is projected by `p`; a camera without it has no distortion and is projected by `k`.
fn intrinsics(info: &CameraInfo) -> Result<Intrinsics, Error> {
    let (width, height) = (info.width as usize, info.height as usize);
    let [fx, skew, cx, _, _, fy, cy, ..] = info.p;
    if fx == 0.0 {
        return Intrinsics::from_k(width, height, &info.k);
    }
    Intrinsics::from_k(width, height, &[fx, skew, cx, 0.0, fy, cy, 0.0, 0.0, 1.0])
}
