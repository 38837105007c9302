//! Where a mesh has a sheet that the truth has not.
//!
//! From every sample `p` of the true surface, with outward normal `n`, a line is followed along `±n`:
//!
//! ```text
//! M(p) = sheets of the mesh that the line crosses within ±20 mm, facing n      (angle under 60°)
//! T(p) = sheets of the truth that the line crosses within ±25 mm, facing n     (angle under 90°)
//! O(p) = those of M(p) that no other sheet of the truth explains
//! p is doubled  ⇔  M(p) > T(p)  and  O(p) ≥ 2
//! ```
//! A crossing `q` at `p + t n` is explained by another sheet if, of the truth within 5 mm of `q` that faces as the mesh does there,
//! the nearest point `x` is on the far half of the way: `(x − p)·n / t > ½`.
//!
//! A correct closed body has `M = T` however thin it is or close its parts come to each other: the far side of a
//! sheet faces the other way and does not count, and the next finger or the other side of a fold is a sheet of the truth
//! too. A second layer 15 mm beside the first, a blister, a flap that lies over the surface: each adds a sheet that faces
//! `n` once more than the truth has, and that no other part of the truth can be taken for.
//!
//! The truth is counted generously and the mesh strictly, so that errors of the mesh below 5 mm make no sheet: a true sheet at 21 mm that
//! the mesh has at 19.5 mm stays a true sheet, and a finger that the line misses by 2 mm explains that it meets the mesh of the
//! finger. For the same reason crossings of the mesh that are less than 1 mm apart are one sheet: a crease of a rough mesh, not a
//! second layer.
//!
//! **Limits.** Where the truth has a fold within 25 mm and the mesh lacks one of its sheets but has another twice, the counts
//! agree and nothing is reported; completeness reports the sheet that lacks. A layer within 1 mm of another is not seen.

use super::{Crossing, Sample, Sampling, Surface};

/// What counts as a second sheet.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct DoubledOptions {
    /// How far along the normal, on either side, sheets of the mesh are counted, metres. Default 0.02: strips that drifted apart behind
    /// an object of a hand's size lie up to 15 mm from each other.
    pub reach: f64,
    /// How much farther sheets of the truth are counted, and how far from a crossing a true sheet explains it, metres. Default
    /// 0.005: the largest error of position that a mesh may have without a true sheet being taken for a second one.
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
        .filter(|sample| is_doubled(mesh, truth, options, sample))
        .count();
    doubled as f64 / samples.len().max(1) as f64
}

fn is_doubled(mesh: &Surface, truth: &Surface, options: &DoubledOptions, at: &Sample) -> bool {
    let mut found = mesh.crossings(&at.point, &at.normal, options.reach);
    found.retain(|crossing| crossing.facing > options.facing);
    let count = sheets(&found, options.apart);
    // Most lines cross one sheet and need no second look.
    if count < 2 {
        return false;
    }
    let mut real = truth.crossings(&at.point, &at.normal, options.reach + options.margin);
    real.retain(|crossing| crossing.facing > 0.0);
    if count <= sheets(&real, 0.0) {
        return false;
    }
    found.retain(|crossing| !explained(crossing, truth, options, at));
    sheets(&found, options.apart) >= 2
}

/// Whether another sheet of the truth than the one at the foot of the line is what the mesh means by a crossing.
fn explained(crossing: &Crossing, truth: &Surface, options: &DoubledOptions, at: &Sample) -> bool {
    let place = at.point + at.normal.scale(crossing.along);
    truth
        .nearest_facing(&place, &crossing.normal, options.facing, options.margin)
        .is_some_and(|x| {
            let toward = (x - at.point).dot(&at.normal) * crossing.along.signum();
            // Within the least distance of two sheets there is no far half.
            toward > 0.5 * crossing.along.abs().max(options.apart)
        })
}

/// Sheets among crossings in order: each more than `apart` from the one before.
fn sheets(crossings: &[Crossing], apart: f64) -> usize {
    let far = crossings
        .windows(2)
        .filter(|pair| pair[1].along - pair[0].along > apart);
    usize::from(!crossings.is_empty()) + far.count()
}
