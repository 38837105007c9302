//! The descriptor of a corner (steered BRIEF): 256 bits, each a comparison of the smoothed image at two points.
//!
//! ```text
//! bit k  =  S(p + R a_k) < S(p + R b_k)        a_k, b_k drawn once, about normal with σ = 5 pixels, within 13
//! ```
//! R rotates by the direction of the corner. The distance of two descriptors is the number of different bits.

use super::grey::Smoothed;
use super::orientation::{TURNS, direction};

/// Largest offset of a test point from the corner along an axis before rotation, and of its length: rotated ones stay within the patch.
const FARTHEST: i64 = 13;
/// Number of bits of a descriptor.
pub(super) const BITS: u32 = 256;
const TESTS: usize = BITS as usize;

/// A descriptor of the neighbourhood of a corner.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Descriptor(pub [u32; 8]);

impl Descriptor {
    /// Number of bits that differ, 0 to 256.
    pub fn distance(&self, other: &Self) -> u32 {
        let pairs = self.0.iter().zip(&other.0);
        pairs.map(|(a, b)| (a ^ b).count_ones()).sum()
    }
}

/// The two points of a test, pixels from the corner.
type Test = [[i32; 2]; 2];

/// The tests, rotated by every step.
pub(super) struct Tests(Vec<[Test; TESTS]>);

impl Default for Tests {
    fn default() -> Self {
        let upright = upright();
        Self(
            (0..TURNS)
                .map(|step| upright.map(|t| turned(t, step)))
                .collect(),
        )
    }
}

impl Tests {
    /// Describes the neighbourhood of a pixel rotated by `turn` steps.
    pub fn describe(&self, image: &Smoothed, column: usize, row: usize, turn: usize) -> Descriptor {
        let value = |[x, y]: [i32; 2]| {
            image.at(
                column.wrapping_add_signed(x as isize),
                row.wrapping_add_signed(y as isize),
            )
        };
        let mut bits = [0_u32; 8];
        for (k, [a, b]) in self.0[turn].iter().enumerate() {
            bits[k / 32] |= u32::from(value(*a) < value(*b)) << (k % 32);
        }
        Descriptor(bits)
    }
}

fn turned(test: Test, step: usize) -> Test {
    let [cos, sin] = direction(step);
    let round = |v: i64| ((v + (1 << 13)) >> 14) as i32;
    test.map(|[x, y]| {
        let (x, y) = (i64::from(x), i64::from(y));
        [round(cos * x - sin * y), round(sin * x + cos * y)]
    })
}

/// The tests of an unrotated corner, fixed for all versions.
fn upright() -> [Test; TESTS] {
    let mut state = 0x005e_ed0f_b71e_f000_u64;
    let mut place = || loop {
        let [x, y] = [0, 0].map(|_: i32| about_normal(&mut state));
        if x * x + y * y <= FARTHEST * FARTHEST {
            break [x as i32, y as i32];
        }
    };
    std::array::from_fn(|_| {
        loop {
            let test = [place(), place()];
            if test[0] != test[1] {
                break test;
            }
        }
    })
}

/// An integer approximately normally distributed with σ = 5: the scaled sum of twelve uniform ones (SplitMix64).
fn about_normal(state: &mut u64) -> i64 {
    let mut sum = 0;
    for _ in 0..12 {
        *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = *state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        sum += ((z ^ (z >> 31)) >> 32).cast_signed();
    }
    // Twelve numbers in [0, 2³²) have a sum of mean 6 · 2³² and standard deviation 2³².
    (5 * (sum - (6 << 32)) + (1 << 31)) >> 32
}

#[cfg(test)]
mod tests {
    use super::super::PATCH;
    use super::*;

    #[test]
    fn tests_stay_within_the_patch_and_differ() {
        let tests = Tests::default();
        // The smoothing extends two pixels farther.
        let most = PATCH as u32 - 2;
        for [a, b] in tests.0.iter().flatten() {
            assert!(
                [a, b]
                    .iter()
                    .all(|p| p.iter().all(|x| x.unsigned_abs() <= most))
            );
        }
        let places = |t: &Test| t.map(|[x, y]| f64::from(x * x + y * y));
        let squares: f64 = upright().iter().flat_map(places).sum();
        let sigma = (squares / (4.0 * TESTS as f64)).sqrt();
        assert!((4.0..6.0).contains(&sigma), "{sigma}");
    }
}
