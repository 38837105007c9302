//! Corners (FAST-9): of the 16 pixels on a circle of radius 3, nine consecutive ones are all brighter, or all darker, than the centre by a threshold.
//!
//! ```text
//! score = max over both signs of Σ (|I_k − I| − threshold)₊        over the pixels of that sign
//! ```
//! Only the strongest corner within a few pixels is kept, and in each square of the image the strongest few, so that corners are spread over it.

use super::options::FeatureOptions;
use super::{GreyImage, PATCH};

/// The circle, clockwise from the top.
const CIRCLE: [(isize, isize); 16] = [
    (0, -3),
    (1, -3),
    (2, -2),
    (3, -1),
    (3, 0),
    (3, 1),
    (2, 2),
    (1, 3),
    (0, 3),
    (-1, 3),
    (-2, 2),
    (-3, 1),
    (-3, 0),
    (-3, -1),
    (-2, -2),
    (-1, -3),
];
/// Number of consecutive pixels.
const ARC: u32 = 9;

/// A corner.
#[derive(Debug, Clone, Copy)]
pub(super) struct Corner {
    pub column: usize,
    pub row: usize,
    pub score: u32,
}

/// The corners of an image, row by row.
pub(super) fn corners(image: &GreyImage, options: &FeatureOptions) -> Vec<Corner> {
    let scores = scores(image, i32::from(options.threshold));
    let mut found = strongest_around(image, &scores, options.apart.max(1));
    spread(&mut found, options.square.max(1), options.per_square);
    found
}

/// The score of every pixel, 0 where there is no corner.
fn scores(image: &GreyImage, threshold: i32) -> Vec<u32> {
    let (width, height) = (image.width(), image.height());
    let mut scores = vec![0; width * height];
    let circle = CIRCLE.map(|(x, y)| y * width.cast_signed() + x);
    let pixels = image.pixels();
    for row in PATCH..height.saturating_sub(PATCH) {
        for column in PATCH..width.saturating_sub(PATCH) {
            let at = row * width + column;
            let centre = i32::from(pixels[at]);
            let differs = |k: usize| i32::from(pixels[at.wrapping_add_signed(circle[k])]) - centre;
            // Nine consecutive pixels of sixteen contain two adjacent ones of these four.
            let quarters = [0, 4, 8, 12].map(differs);
            let some = |sign: i32| {
                (0..4).any(|k| {
                    sign * quarters[k] > threshold && sign * quarters[(k + 1) % 4] > threshold
                })
            };
            if some(1) || some(-1) {
                scores[at] = score(std::array::from_fn(differs), threshold);
            }
        }
    }
    scores
}

/// The score of a centre from its differences to the circle.
fn score(differences: [i32; 16], threshold: i32) -> u32 {
    let of_sign = |sign: i32| {
        let beyond = differences.map(|d| (sign * d - threshold).max(0));
        let mask = (0..16).fold(0_u32, |mask, k| mask | u32::from(beyond[k] > 0) << k);
        if has_arc(mask) {
            beyond.iter().sum::<i32>().unsigned_abs()
        } else {
            0
        }
    };
    of_sign(1).max(of_sign(-1))
}

/// Whether nine consecutive bits, cyclically, are set.
fn has_arc(mask: u32) -> bool {
    let twice = mask | mask << 16;
    (1..ARC).fold(twice, |run, k| run & twice >> k) != 0
}

/// The corners without a stronger one nearby; of equal ones the first.
fn strongest_around(image: &GreyImage, scores: &[u32], apart: usize) -> Vec<Corner> {
    let (width, height) = (image.width(), image.height());
    let mut found = Vec::new();
    for row in PATCH..height.saturating_sub(PATCH) {
        for column in PATCH..width.saturating_sub(PATCH) {
            let score = scores[row * width + column];
            if score == 0 {
                continue;
            }
            let reach = |x: usize, end: usize| {
                x.saturating_sub(apart)..x.saturating_add(apart).saturating_add(1).min(end)
            };
            let stronger = |r: usize, c: usize| {
                let other = scores[r * width + c];
                other > score || (other == score && (r, c) < (row, column))
            };
            let beaten = reach(row, height).any(|r| reach(column, width).any(|c| stronger(r, c)));
            if !beaten {
                found.push(Corner { column, row, score });
            }
        }
    }
    found
}

/// Keeps the strongest of each square, in the same order.
fn spread(found: &mut Vec<Corner>, square: usize, most: usize) {
    let place = |c: &Corner| (c.row / square, c.column / square);
    let mut order: Vec<usize> = (0..found.len()).collect();
    order.sort_by_key(|&k| (place(&found[k]), std::cmp::Reverse(found[k].score), k));
    let mut keep = vec![false; found.len()];
    for same in order.chunk_by(|&a, &b| place(&found[a]) == place(&found[b])) {
        same.iter().take(most).for_each(|&k| keep[k] = true);
    }
    let mut marks = keep.into_iter();
    found.retain(|_| marks.next().unwrap_or(false));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_arc_may_go_around_the_end() {
        assert!(has_arc(0b1111_0000_0001_1111));
        assert!(!has_arc(0b1111_0000_0000_1111));
        assert!(has_arc(0b0000_1111_1111_1000));
        assert!(!has_arc(0b0101_0101_0101_0101));
        assert!(has_arc(0xffff));
    }
}
