//! Colour features as 3-D landmarks: corners of a colour image with descriptors, lifted to the surface, and matched with the next frame.
//!
//! ```text
//! image ──► corners ──► descriptors ──► points on the surface ──┐
//!           (FAST)      (steered BRIEF)  (depth, interpolated)   ├──► pairs x_A ↔ x_B with a confidence in (0, 1]
//! image of the next frame ──► … ────────────────────────────────┘     (mutual best, ratio test, bound on the motion)
//! ```
//! Geometry cannot detect that a surface slides along itself; texture can. The pairs are uncertain landmarks for a registration, which
//! should also weight them by their agreement with the surrounding motion, as some are wrong.
//!
//! Everything but the lifting to 3-D is integer arithmetic, so that the same images give the same features to the bit on any machine.
//!
//! *Limits.* One scale: for consecutive frames of a camera at a nearly constant distance. In an image that is blurred over more
//! than about five pixels, or whose grey values differ by less than [`FeatureOptions::threshold`], nothing is found.
//!
//! *Sources.* E. Rosten and T. Drummond (2006), FAST; M. Calonder et al. (2010), BRIEF; E. Rublee et al. (2011), ORB: orientation by the
//! intensity centroid, steered tests; D. Lowe (2004), the ratio test.

mod brief;
mod corners;
mod grey;
mod lift;
mod matching;
mod options;
mod orientation;

pub use brief::Descriptor;
pub use grey::GreyImage;
pub use lift::{Feature, Surface, lift};
pub use matching::{FeatureMatch, LandmarkPair, landmark_pairs, match_features};
pub use options::FeatureOptions;

/// A corner of an image with its descriptor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Keypoint {
    /// Column of its pixel.
    pub column: usize,
    /// Row of its pixel.
    pub row: usize,
    /// Strength of the corner, grey levels: by how much the pixels of its circle are brighter (or darker) beyond the threshold, summed.
    pub score: u32,
    /// Its descriptor.
    pub descriptor: Descriptor,
}

/// Finds and describes the corners of an image, row by row; only the strongest of each neighbourhood.
///
/// # Complexity
/// O(pixels + corners · 10³).
///
/// ```
/// use dvrk_io::features::{FeatureOptions, GreyImage, detect};
/// // A bright square has four corners, a plain image has none.
/// let inside = |u: usize, v: usize| (40..100).contains(&u) && (40..80).contains(&v);
/// let grey = |k: usize| if inside(k % 160, k / 160) { 180 } else { 60 };
/// let pixels = (0..120 * 160).map(grey).collect();
/// let options = FeatureOptions::default();
/// assert_eq!(detect(&GreyImage::new(160, 120, pixels)?, &options).len(), 4);
/// assert!(detect(&GreyImage::new(160, 120, vec![90; 160 * 120])?, &options).is_empty());
/// # Ok::<(), dvrk_io::Error>(())
/// ```
pub fn detect(image: &GreyImage, options: &FeatureOptions) -> Vec<Keypoint> {
    let found = corners::corners(image, options);
    let smooth = image.smoothed();
    let steered = brief::Tests::default();
    let describe = |corner: corners::Corner| {
        let (column, row) = (corner.column, corner.row);
        let turn = orientation::turn(image, column, row);
        Keypoint {
            column,
            row,
            score: corner.score,
            descriptor: steered.describe(&smooth, column, row, turn),
        }
    };
    found.into_iter().map(describe).collect()
}

/// Radius of the patch of a descriptor, pixels; corners closer to the border of the image are skipped.
const PATCH: usize = 16;
