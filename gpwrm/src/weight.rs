//! Compactly supported weights.
//!
//! ```text
//! W : [0, 1) → (0, 1],  W(0) = 1,  W(1) = W'(1) = 0,  t = distance / support
//! Wendland C2  W(t) = (1 − t)⁴ (4t + 1)
//! Wendland C4  W(t) = (1 − t)⁶ (35t² + 18t + 3) / 3
//! quartic      W(t) = 1 − 6t² + 8t³ − 3t⁴
//! ```
//!
//! All are flat at 0, so `W'(t)/t` is bounded and the gradient of `W(‖x‖/ρ)` needs no division by `‖x‖`.

/// Radial weight of a node.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Weight {
    /// Wendland's function of smoothness two: the most accurate of the three on surfaces.
    #[default]
    WendlandC2,
    /// Wendland's function of smoothness four: narrower, smoother.
    WendlandC4,
    /// The quartic spline common in meshless mechanics: wider at the same support.
    Quartic,
}

impl Weight {
    /// `W(t)`; zero from `t = 1` on.
    pub fn value(self, t: f64) -> f64 {
        let s = (1.0 - t).max(0.0);
        let s2 = s * s;
        match self {
            Self::WendlandC2 => s2 * s2 * (4.0 * t + 1.0),
            Self::WendlandC4 => s2 * s2 * s2 * ((35.0 * t + 18.0) * t + 3.0) / 3.0,
            Self::Quartic => s2 * s * (1.0 + 3.0 * t),
        }
    }

    /// `W'(t)/t`, finite at 0.
    pub fn slope_over_t(self, t: f64) -> f64 {
        let s = (1.0 - t).max(0.0);
        let s2 = s * s;
        match self {
            Self::WendlandC2 => -20.0 * s2 * s,
            Self::WendlandC4 => -56.0 / 3.0 * (5.0 * t + 1.0) * s2 * s2 * s,
            Self::Quartic => -12.0 * s2,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slope_is_the_derivative_of_the_value() {
        for weight in [Weight::WendlandC2, Weight::WendlandC4, Weight::Quartic] {
            assert!((weight.value(0.0) - 1.0).abs() < 1e-15);
            assert!(weight.value(1.5).abs() < 1e-300);
            for k in 1..20 {
                let (t, h) = (f64::from(k) / 20.0, 1e-6);
                let difference = (weight.value(t + h) - weight.value(t - h)) / (2.0 * h);
                // Central difference: error h²·W''' / 6, far below 1e-8.
                assert!((difference - t * weight.slope_over_t(t)).abs() < 1e-8);
            }
        }
    }
}
