//! Colour features as 3-D landmarks: corners of a colour image, described, carried to the surface seen, and met again in the next frame.
//!
//! ```text
//! image ──► corners ──► descriptors ──► points on the surface ──┐
//!           (FAST)      (steered BRIEF)  (depth, interpolated)   ├──► pairs x_A ↔ x_B with a confidence in (0, 1]
//! image of the next frame ──► … ────────────────────────────────┘     (mutual best, ratio test, bound on the motion)
//! ```
//! Geometry does not see a surface slide along itself; its texture does. The pairs are what a registration takes as uncertain landmarks; it
//! should still weigh them by how well they agree with the motion around them, as some are wrong.
//!
//! Everything but the lifting to 3-D is whole numbers, so that the same images give the same features to the bit on any machine.
//!
//! *Limits.* One scale: made for frames that follow each other, and a camera that keeps its distance. Of an image that is blurred over more
//! than some five pixels, or whose grey values differ by less than [`FeatureOptions::threshold`], nothing is found.
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
pub use matching::{FeatureMatch, LandmarkPairs, landmark_pairs, match_features};
pub use options::FeatureOptions;

/// A corner of an image with the description of its neighbourhood.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Keypoint {
    /// Column of its pixel.
    pub column: usize,
    /// Row of its pixel.
    pub row: usize,
    /// How strong the corner is, grey levels: how much brighter (or darker) the pixels of the circle around it are, beyond the threshold, summed.
    pub score: u32,
    /// What it looks like.
    pub descriptor: Descriptor,
}

/// Finds and describes the corners of an image, row by row; strongest of each neighbourhood only.
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

/// Pixels around a corner that its description looks at; corners nearer to the border of the image than this are none.
const PATCH: usize = 16;
