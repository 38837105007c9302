//! Where a mesh has a sheet that the truth has not.
//!
//! From every sample `p` of the true surface, with outward normal `n`, a line is followed along `±n`:
//!
//! ```text
//! M(p) = sheets of the mesh that the line crosses within ±20 mm, facing n      (angle under 60°)
//! T(p) = sheets of the truth that the line crosses within ±25 mm, facing n     (angle under 90°)
//! p is doubled  ⇔  M(p) > max(1, T(p))
//! ```
//! A correct closed body has `M = T` however thin it is or close its parts come to each other: the far side of a
//! sheet faces the other way and does not count, and the next finger or the other side of a fold is a sheet of the truth
//! too. A second layer 15 mm beside the first, a blister, a flap that lies over the surface: each adds a sheet that faces
//! `n` once more than the truth has.
//!
//! The truth is counted generously and the mesh strictly, so that small errors of the mesh never make a sheet: the truth's interval is
//! longer (a true sheet at 21 mm that the mesh has at 19.5 mm stays a true sheet) and its angle wider. For
//! the same reason crossings of the mesh that are less than 1 mm apart are one sheet: a crease of a rough mesh, not a second layer.
//!
//! **Limits.** Where the truth has a fold within 25 mm and the mesh lacks one of its sheets but has another twice, the counts
//! agree and nothing is reported; completeness reports the sheet that lacks. A layer within 1 mm of another is not seen.

use super::{Crossing, Sampling, Surface};

/// What counts as a second sheet.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct DoubledOptions {
    /// How far along the normal, on either side, sheets of the mesh are counted, metres. Default 0.02: strips that drifted apart behind
    /// an object of a hand's size lie up to 15 mm from each other.
    pub reach: f64,
    /// How much farther sheets of the truth are counted, metres. Default 0.005: the largest error of position that a mesh may have
    /// without a true sheet being taken for a second one.
    pub margin: f64,
    /// Least distance between two sheets of the mesh, metres. Default 0.001: twice the depth noise of a common camera.
    pub apart: f64,
    /// Least cosine between the normals for a sheet of the mesh to face the same way. Default 0.5.
    pub facing: f64,
}

impl Default for DoubledOptions {
    fn default() -> Self {
        Self {
            reach: 0.02,
            margin: 0.005,
            apart: 0.001,
            facing: 0.5,
        }
    }
}

/// Share of the true area over which the mesh has a sheet more than the truth, facing the same way: 0 to 1.
///
/// # Complexity
/// `O(s (log n + c))` for `s` samples, `n` triangles and `c` triangles near a line.
pub fn doubled(
    mesh: &Surface,
    truth: &Surface,
    options: &DoubledOptions,
    sampling: Sampling,
) -> f64 {
    let samples = truth.samples(sampling);
    let doubled = samples
        .iter()
        .filter(|sample| {
            let found = mesh.crossings(&sample.point, &sample.normal, options.reach);
            let sheets = sheets(&found, options.facing, options.apart);
            // One sheet is never two: most lines need no second look.
            sheets > 1 && {
                let reach = options.reach + options.margin;
                let real = truth.crossings(&sample.point, &sample.normal, reach);
                sheets > self::sheets(&real, 0.0, 0.0)
            }
        })
        .count();
    doubled as f64 / samples.len().max(1) as f64
}

/// Sheets among crossings in order: those that face the line, each more than `apart` from the one before.
fn sheets(crossings: &[Crossing], facing: f64, apart: f64) -> usize {
    let mut count = 0;
    let mut last = f64::NEG_INFINITY;
    for crossing in crossings.iter().filter(|c| c.facing > facing) {
        if crossing.along - last > apart {
            count += 1;
        }
        last = crossing.along;
    }
    count
}
