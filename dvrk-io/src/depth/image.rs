//! Depth images as cameras send them.

use crate::Error;

/// A depth image, row by row.
#[derive(Debug, Clone, PartialEq)]
pub struct DepthImage {
    width: usize,
    height: usize,
    /// Metres; 0 where there is no measurement.
    depths: Vec<f32>,
}

impl DepthImage {
    /// Depths in metres (`32FC1`). NaN, infinite, zero and negative values all mean "no measurement".
    ///
    /// # Errors
    /// Another number of depths than width × height.
    pub fn from_metres(width: usize, height: usize, depths: &[f32]) -> Result<Self, Error> {
        Self::new(width, height, depths, |&depth| {
            if depth > 0.0 && depth.is_finite() {
                depth
            } else {
                0.0
            }
        })
    }

    /// Depths in whole units of `unit` metres (`16UC1`: 0.001 in ROS 2), 0 where there is no measurement.
    ///
    /// # Errors
    /// Another number of depths than width × height, or a unit that is not positive.
    pub fn from_units(
        width: usize,
        height: usize,
        depths: &[u16],
        unit: f64,
    ) -> Result<Self, Error> {
        if !(unit > 0.0 && unit.is_finite()) {
            let expected = "must be positive and finite";
            return Err(Error::OutOfRange {
                what: "depth unit",
                value: unit,
                expected,
            });
        }
        Self::new(width, height, depths, |&depth| {
            (f64::from(depth) * unit) as f32
        })
    }

    fn new<T>(
        width: usize,
        height: usize,
        depths: &[T],
        metres: impl Fn(&T) -> f32,
    ) -> Result<Self, Error> {
        if width.checked_mul(height) != Some(depths.len()) {
            return Err(Error::ImageSize {
                width,
                height,
                length: depths.len(),
            });
        }
        Ok(Self {
            width,
            height,
            depths: depths.iter().map(metres).collect(),
        })
    }

    /// Columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Depth of a pixel in metres; `None` outside the image and where nothing was measured.
    pub fn depth(&self, column: usize, row: usize) -> Option<f64> {
        if column >= self.width || row >= self.height {
            return None;
        }
        let depth = self.depths[row * self.width + column];
        (depth > 0.0).then(|| f64::from(depth))
    }
}
