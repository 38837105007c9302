//! Points sampled evenly by area, the same for the same seed.
//!
//! ```text
//! k-th sample:  triangle where the cumulative area passes (k + u₀)/n of the whole,
//!               place in it from the R₂ sequence  r_k = frac(s + k · (1/φ₂, 1/φ₂²)),  φ₂³ = φ₂ + 1
//! ```
//! Every triangle gets its share of the samples to within one, and within a triangle the samples cover it evenly: the error of
//! a mean falls nearly as 1/n instead of 1/√n. The seed sets `u₀` and `s`.

use derive_setters::Setters;

/// The number of samples, and their seed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct Sampling {
    /// Number of samples on each surface. Default 6,000, with an error of a few parts in ten thousand for a share of the area.
    pub count: usize,
    /// Seed of the sequence. Default 0.
    pub seed: u64,
}

impl Default for Sampling {
    fn default() -> Self {
        Self {
            count: 6000,
            seed: 0,
        }
    }
}

impl Sampling {
    /// The positions of the samples: in the cumulative area, and in the triangle (both in 0..1).
    pub(super) fn positions(self) -> impl Iterator<Item = (f64, [f64; 2])> {
        /// The plastic number, which the R₂ sequence is based on.
        const PLASTIC: f64 = 1.324_717_957_244_746;
        let count = self.count.max(1);
        let mut state = self.seed;
        let [first, s, t] = [(); 3].map(|()| unit(&mut state));
        (0..count).map(move |k| {
            let step = k as f64;
            (
                (step + first) / count as f64,
                [
                    (s + step / PLASTIC).fract(),
                    (t + step / (PLASTIC * PLASTIC)).fract(),
                ],
            )
        })
    }
}

/// The next number in 0..1 of the splitmix64 sequence.
fn unit(state: &mut u64) -> f64 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^= z >> 31;
    (z >> 11) as f64 / (1u64 << 53) as f64
}
