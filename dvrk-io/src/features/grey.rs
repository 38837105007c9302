//! Grey images.
//!
//! ```text
//! grey = (77 R + 150 G + 29 B) / 256            the weights of ITU-R BT.601
//! ```

use crate::Error;

/// A grey image, row by row.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GreyImage {
    width: usize,
    height: usize,
    pixels: Vec<u8>,
}

impl GreyImage {
    /// An image from grey values.
    ///
    /// # Errors
    /// Another number of pixels than width × height.
    pub fn new(width: usize, height: usize, pixels: Vec<u8>) -> Result<Self, Error> {
        if width.checked_mul(height) != Some(pixels.len()) {
            let length = pixels.len();
            return Err(Error::ImageSize {
                width,
                height,
                length,
            });
        }
        Ok(Self {
            width,
            height,
            pixels,
        })
    }

    /// An image from red, green and blue.
    ///
    /// # Errors
    /// Another number of pixels than width × height.
    pub fn from_rgb(width: usize, height: usize, pixels: &[[u8; 3]]) -> Result<Self, Error> {
        let grey = |&[r, g, b]: &[u8; 3]| {
            ((77 * u32::from(r) + 150 * u32::from(g) + 29 * u32::from(b)) >> 8) as u8
        };
        Self::new(width, height, pixels.iter().map(grey).collect())
    }

    /// Columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Grey values, row by row.
    pub fn pixels(&self) -> &[u8] {
        &self.pixels
    }

    pub(super) fn at(&self, column: usize, row: usize) -> i32 {
        i32::from(self.pixels[row * self.width + column])
    }

    /// Sums over 5 × 5 pixels, 0 where these are not inside the image: single pixels are too noisy to be compared.
    pub(super) fn smoothed(&self) -> Smoothed {
        let (width, height) = (self.width, self.height);
        let mut across = vec![0_u16; self.pixels.len()];
        for (row, sums) in self
            .pixels
            .chunks_exact(width.max(1))
            .zip(across.chunks_exact_mut(width.max(1)))
        {
            for (window, sum) in row.windows(5).zip(sums.iter_mut().skip(2)) {
                *sum = window.iter().map(|&p| u16::from(p)).sum();
            }
        }
        let mut sums = vec![0_u16; self.pixels.len()];
        for row in 2..height.saturating_sub(2) {
            for column in 0..width {
                let around = (row - 2..=row + 2).map(|r| across[r * width + column]);
                sums[row * width + column] = around.sum();
            }
        }
        Smoothed { width, sums }
    }
}

/// A smoothed image.
pub(super) struct Smoothed {
    width: usize,
    sums: Vec<u16>,
}

impl Smoothed {
    pub fn at(&self, column: usize, row: usize) -> u16 {
        self.sums[row * self.width + column]
    }
}
