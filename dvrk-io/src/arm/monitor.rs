//! Checks whether the set-point of an arm is one that was sent.
//!
//! ```text
//! off(t) = min over the goals sent in [t − window, t] of  apart(setpoint(t), goal)
//! ```
//! A set-point that lags by less than the window is on the path that was sent; one that was clipped, dropped, or set by
//! another client is not. Goals older than the window are forgotten, except for the last one; the goals of a motion that was held or has arrived are
//! forgotten no earlier: the set-point may still be on its way to them when the next motion starts.

use std::collections::VecDeque;
use std::time::Duration;

use nalgebra::Isometry3;

use super::line::apart;
use super::options::Tolerance;

/// Longer than any delay between a command and the resulting set-point.
pub(crate) const WINDOW: Duration = Duration::from_millis(500);

/// The goals of the last half second.
#[derive(Debug, Clone, Default)]
pub(crate) struct Monitor {
    sent: VecDeque<(Duration, Isometry3<f64>)>,
}

impl Monitor {
    pub(crate) fn sent(&mut self, now: Duration, goal: Isometry3<f64>) {
        self.sent.push_back((now, goal));
        // The oldest goal is dropped when the next one is older than the window too.
        while self
            .sent
            .get(1)
            .is_some_and(|(time, _)| *time + WINDOW < now)
        {
            self.sent.pop_front();
        }
    }

    /// Distance and angle to the nearest goal sent, if every goal is beyond `tolerance`.
    pub(crate) fn off(
        &self,
        setpoint: &Isometry3<f64>,
        tolerance: Tolerance,
    ) -> Option<(f64, f64)> {
        let scaled = |(distance, angle): (f64, f64)| {
            (distance / tolerance.length).max(angle / tolerance.angle)
        };
        let all = self.sent.iter().map(|(_, goal)| apart(setpoint, goal));
        let nearest = all.min_by(|a, b| scaled(*a).total_cmp(&scaled(*b)))?;
        (!tolerance.holds(nearest)).then_some(nearest)
    }

    /// The last goal sent, and when.
    pub(crate) fn last(&self) -> Option<&(Duration, Isometry3<f64>)> {
        self.sent.back()
    }

    pub(crate) fn clear(&mut self) {
        self.sent.clear();
    }
}
