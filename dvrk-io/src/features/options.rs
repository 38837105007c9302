//! Options of features.

use derive_setters::Setters;

/// Options for finding, lifting and matching features. The defaults are for colour images of about 640 × 480 pixels of an object half a metre
/// away, that is about one pixel for each millimetre.
#[derive(Debug, Clone, Copy, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct FeatureOptions {
    /// How much brighter or darker the surroundings of a corner must be, grey levels. Default 8.
    pub threshold: u8,
    /// Corners have no stronger one within this many pixels. Default 3.
    pub apart: usize,
    /// Edge of the squares over which corners are spread, pixels. Default 32.
    pub square: usize,
    /// Most corners in a square. Default 6.
    pub per_square: usize,
    /// Largest difference in depth around a corner, metres: with more, the surface has an edge, and it is unknown on which side the corner
    /// is. Default 8 mm.
    pub edge: f64,
    /// Corners within this distance of an arm are rejected, metres. Default 6 mm.
    pub clearance: f64,
    /// Largest motion of a feature between two frames, metres. Default 30 mm.
    pub motion: f64,
    /// Most bits that may differ between two descriptors of the same point, of 256. Default 60.
    pub most_different: u32,
    /// The number of different bits of a match must be below this share, at most 1, of that of the second best. Default 0.8.
    pub ratio: f64,
}

impl Default for FeatureOptions {
    fn default() -> Self {
        Self {
            threshold: 8,
            apart: 3,
            square: 32,
            per_square: 6,
            edge: 0.008,
            clearance: 0.006,
            motion: 0.030,
            most_different: 60,
            ratio: 0.8,
        }
    }
}
