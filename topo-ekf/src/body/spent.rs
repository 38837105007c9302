//! Where the time of a body filter goes.

use std::ops::AddAssign;
use std::time::Duration;

/// Time that was spent on the normal equations. It is no part of the result: two filters that are given the same differ in it.
#[derive(Clone, Copy, Debug, Default)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Spent {
    /// Putting them together: elasticity of every cell, rows and loads.
    pub assembling: Duration,
    /// Factorising them.
    pub factoring: Duration,
}

impl AddAssign for Spent {
    fn add_assign(&mut self, other: Self) {
        self.assembling += other.assembling;
        self.factoring += other.factoring;
    }
}
