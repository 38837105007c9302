//! Time spent in a body filter.

use std::ops::AddAssign;
use std::time::Duration;

/// Time spent on the normal equations. It is not part of the result: it differs between filters with the same input.
#[derive(Clone, Copy, Debug, Default)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Spent {
    /// Assembling: elasticity of every cell, rows and loads.
    pub assembling: Duration,
    /// Factorising.
    pub factoring: Duration,
}

impl AddAssign for Spent {
    fn add_assign(&mut self, other: Self) {
        self.assembling += other.assembling;
        self.factoring += other.factoring;
    }
}
