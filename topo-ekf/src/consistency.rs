//! Whether the covariances are honest: errors measured in the filter's own standard deviations.
//!
//! ```text
//! innovation   ε = νᵀ (H P⁻ Hᵀ + R)⁻¹ ν,   ν = z − H x⁻           ~ χ² with 3 · (seen vertices) degrees
//! estimation   ε = (x̂ − x)ᵀ Λ (x̂ − x),     x the truth             ~ χ² with 3 Q degrees
//! band         χ²_p(k) ≈ k (1 − 2/(9k) + u_p √(2/(9k)))³            Wilson and Hilferty
//! ```
//!
//! In the information form no covariance is needed: with the posterior `x⁺` from the same prior, `(H P⁻ Hᵀ + R)⁻¹ ν = R⁻¹ (z − H x⁺)`.
//! Source: Bar-Shalom, Li and Kirubarajan, *Estimation with Applications to Tracking and Navigation* (2001), section 5.4.

/// A sum of squares of normalised errors with its degrees of freedom.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Consistency {
    /// `ε`: squared error in the metric of its information.
    pub squared: f64,
    /// Degrees of freedom: the value expected of `squared`.
    pub degrees: usize,
}

/// What a statistic says of the covariances it was normalised by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Verdict {
    /// Below the band: errors are smaller than claimed.
    Cautious,
    /// Inside the 95 % band.
    Honest,
    /// Above the band: errors are larger than claimed.
    Optimistic,
}

/// 97.5 % quantile of the normal distribution.
const TWO_SIDED_95: f64 = 1.959_963_984_540_054;

impl Consistency {
    pub(crate) fn new(squared: f64, degrees: usize) -> Self {
        Self { squared, degrees }
    }

    /// Both statistics together: frames of a run, or runs with different noise. Independent ones add.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self::new(self.squared + other.squared, self.degrees + other.degrees)
    }

    /// `ε / degrees`: 1 for honest covariances. NaN without degrees of freedom.
    pub fn mean(&self) -> f64 {
        self.squared / self.degrees as f64
    }

    /// The 95 % band of [`Consistency::mean`] for honest covariances.
    pub fn band(&self) -> [f64; 2] {
        let spread = 2.0 / (9.0 * self.degrees as f64);
        [-TWO_SIDED_95, TWO_SIDED_95].map(|u| (1.0 - spread + u * spread.sqrt()).max(0.0).powi(3))
    }

    /// Where the mean lies with respect to the band. Without degrees of freedom nothing speaks against honesty.
    pub fn verdict(&self) -> Verdict {
        let [low, high] = self.band();
        match self.mean() {
            mean if mean < low => Verdict::Cautious,
            mean if mean > high => Verdict::Optimistic,
            _ => Verdict::Honest,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_band_is_that_of_the_tables() {
        // χ² quantiles at 2.5 % and 97.5 %: 10 degrees 3.247, 20.483; 100 degrees 74.222, 129.561.
        for (degrees, low, high) in [(10, 3.247, 20.483), (100, 74.222, 129.561)] {
            let band = Consistency::new(0.0, degrees).band();
            let found = band.map(|b| b * degrees as f64);
            // The approximation is good to one per cent from ten degrees on.
            assert!((found[0] / low - 1.0).abs() < 0.01, "{found:?}");
            assert!((found[1] / high - 1.0).abs() < 0.01, "{found:?}");
        }
    }

    #[test]
    fn the_verdict_follows_the_band() {
        let of = |squared| Consistency::new(squared, 100).verdict();
        assert_eq!(of(70.0), Verdict::Cautious);
        assert_eq!(of(100.0), Verdict::Honest);
        assert_eq!(of(135.0), Verdict::Optimistic);
        assert_eq!(Consistency::new(0.0, 0).verdict(), Verdict::Honest);
    }
}
