//! Flying pixels: depths that hang between a near and a far surface because the camera averaged the two.
//!
//! On a surface whose normal makes the angle θ with the ray, depth changes from pixel to pixel by about
//! `z/f · tan θ`. With θ the steepest angle still trusted, a step counts as a jump when
//!
//! ```text
//! |z(q) − z(p)| > jump(p, q) = noise + tan θ · z(p)/f · ‖q − p‖        (‖q − p‖ in pixels: 1 or √2)
//! ```
//!
//! - A pixel **hangs** if in one of the four directions it jumps up to one neighbour and down to the
//!   opposite one. A pixel on the rim of an object jumps on one side only and stays.
//! - A pixel is **alone** if fewer than `support` of its eight neighbours are without a jump and still
//!   candidates for the object. This finds the flying pixels next to holes, where there is no far side to jump
//!   to, and those that hang so little in front of the table that only table is level with them.

use super::DepthImage;

/// Opposite neighbours: p + d and p − d.
const DIRECTIONS: [(isize, isize); 4] = [(1, 0), (0, 1), (1, 1), (1, -1)];

/// What counts as a jump, and how many neighbours must be without one.
#[derive(Clone, Copy)]
pub(super) struct EdgeTest {
    /// Metres, whatever the depth.
    pub(super) noise: f64,
    /// Metres of depth for a metre of depth and a pixel of distance: tan θ / f.
    pub(super) slope: f64,
    pub(super) support: usize,
}

/// Which way a neighbour lies.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Step {
    Nearer,
    /// The same surface.
    Level,
    /// Level, and known not to be the object.
    Surroundings,
    Farther,
    /// No measurement, or outside the image.
    Nothing,
}

impl EdgeTest {
    /// Whether the pixel hangs or is alone. `depth` is its depth; `candidate` tells which pixels (row · width +
    /// column) can be the object.
    pub(super) fn is_flying(
        self,
        image: &DepthImage,
        candidate: &[bool],
        [column, row]: [usize; 2],
        depth: f64,
    ) -> bool {
        let mut level = 0;
        for (du, dv) in DIRECTIONS {
            let jump = self.noise
                + self.slope * depth * f64::from(du.abs() as i32 + dv.abs() as i32).sqrt();
            let step = |sign: isize| {
                let at = column
                    .checked_add_signed(sign * du)
                    .zip(row.checked_add_signed(sign * dv));
                let seen = at.and_then(|(u, v)| {
                    Some((image.depth(u, v)?, candidate[v * image.width() + u]))
                });
                match seen {
                    None => Step::Nothing,
                    Some((other, _)) if other > depth + jump => Step::Farther,
                    Some((other, _)) if other < depth - jump => Step::Nearer,
                    Some((_, true)) => Step::Level,
                    Some((_, false)) => Step::Surroundings,
                }
            };
            let sides = [step(1), step(-1)];
            if matches!(
                sides,
                [Step::Nearer, Step::Farther] | [Step::Farther, Step::Nearer]
            ) {
                return true;
            }
            level += sides.iter().filter(|side| **side == Step::Level).count();
        }
        level < self.support
    }
}
