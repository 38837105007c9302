//! Where a mesh has an additional sheet.
//!
//! From every sample `p` of the true surface, with outward normal `n`, a line is cast along `±n`:
//!
//! ```text
//! M(p) = sheets of the mesh that the line crosses within ±20 mm, facing n      (angle under 60°)
//! T(p) = sheets of the truth that the line crosses within ±25 mm, facing n     (angle under 90°)
//! O(p) = those of M(p) that no other sheet of the true surface explains
//! p is doubled  ⇔  M(p) > T(p)  and  O(p) ≥ 2
//! ```
//! A crossing `q` at `p + t n` is explained by another sheet if, among the points of the true surface within 5 mm of `q` that face as the mesh does
//! there, the nearest one, `x`, is in the far half: `(x − p)·n / t > ½`.
//!
//! A correct closed body has `M = T` however thin it is or close its parts come to each other: the far side of a
//! sheet faces the other way and does not count, and the next finger or the other side of a fold is a sheet of the true
//! surface too. A second layer 15 mm beside the first, or a flap over the surface, adds a sheet that faces `n` and that
//! no part of the true surface explains.
//!
//! True sheets are counted generously and those of the mesh strictly, so that errors of the mesh below 5 mm make no sheet: a true sheet at 21 mm
//! that the mesh has at 19.5 mm is counted, and a finger that the line misses by 2 mm explains a crossing with the mesh of that finger. For the
//! same reason crossings of the mesh less than 1 mm apart are one sheet: a crease of a rough mesh, not a second layer.
//!
//! **Limits.** Where the true surface has a fold within 25 mm, and the mesh lacks one of its sheets but has another twice, the counts agree and
//! nothing is reported; completeness reports the missing sheet. A layer within 1 mm of another is not detected.

use super::{Crossing, Sample, Sampling, Surface};
use derive_setters::Setters;

/// Options for counting sheets.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct DoubledOptions {
    /// Distance along the normal, on either side, within which sheets of the mesh are counted, metres. Default 0.02: misplaced layers on an
    /// object of a hand's size are up to 15 mm apart.
    pub reach: f64,
    /// How much farther true sheets are counted, and the distance at which a true sheet explains a crossing, metres. Default 0.005: the
    /// largest error of position for which a true sheet is not counted as an additional one.
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

/// Share of the true area over which the mesh has an additional sheet that faces the same way: 0 to 1.
///
/// # Complexity
/// `O(s (log n + c))` for `s` samples, `n` triangles and `c` triangles near a line.
///
/// ```
/// use explore_loop::measure::{DoubledOptions, Sampling, Surface, doubled};
/// use explore_loop::nalgebra::Point3;
///
/// // A square, and a mesh of it with a second layer 1 cm above the first.
/// let layer = |z: f64| [[0.0, 0.0, z], [0.1, 0.0, z], [0.1, 0.1, z], [0.0, 0.1, z]].map(Point3::from);
/// let truth = Surface::new(&layer(0.0), &[[0, 1, 2], [0, 2, 3]])?;
/// let both = [layer(0.0), layer(0.01)].concat();
/// let mesh = Surface::new(&both, &[[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])?;
/// let (options, sampling) = (DoubledOptions::default(), Sampling::default());
/// assert!(doubled(&mesh, &truth, &options, sampling) > 0.999);
/// assert_eq!(doubled(&truth, &truth, &options, sampling), 0.0);
/// # Ok::<(), explore_loop::measure::MeasureError>(())
/// ```
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
    // Most lines cross one sheet and need no further test.
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

/// Whether a sheet of the true surface other than the one at the foot of the line explains a crossing.
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

/// Number of sheets among sorted crossings: each more than `apart` from the one before.
fn sheets(crossings: &[Crossing], apart: f64) -> usize {
    let far = crossings
        .windows(2)
        .filter(|pair| pair[1].along - pair[0].along > apart);
    usize::from(!crossings.is_empty()) + far.count()
}
