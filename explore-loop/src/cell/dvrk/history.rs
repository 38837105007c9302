//! The pose of a tip at the time of a frame.
//!
//! ```text
//! t₀ ≤ t ≤ t₁:   p = lerp(p₀, p₁, s),  q = slerp(q₀, q₁, s),  s = (t − t₀)/(t₁ − t₀)
//! ```

use std::collections::VecDeque;
use std::time::Duration;

use nalgebra::Isometry3;

/// Number of poses that are kept.
const KEPT: usize = 600;

/// Poses with their stamps, in order of time.
#[derive(Debug, Clone, Default)]
pub(super) struct History(VecDeque<(Duration, Isometry3<f64>)>);

impl History {
    /// Adds a pose, unless there is a newer one.
    pub fn add(&mut self, stamp: Duration, pose: Isometry3<f64>) {
        if self.0.back().is_some_and(|(last, _)| *last >= stamp) {
            return;
        }
        if self.0.len() == KEPT {
            self.0.pop_front();
        }
        self.0.push_back((stamp, pose));
    }

    /// The pose at an instant; before the first and after the last, the nearest one.
    pub fn at(&self, stamp: Duration) -> Option<Isometry3<f64>> {
        let after = self.0.partition_point(|(time, _)| *time <= stamp);
        let Some((from_time, from)) = after.checked_sub(1).and_then(|i| self.0.get(i)) else {
            return self.0.front().map(|(_, pose)| *pose);
        };
        let Some((to_time, to)) = self.0.get(after) else {
            return Some(*from);
        };
        let way = stamp.saturating_sub(*from_time);
        let whole = to_time.saturating_sub(*from_time);
        let share = way.as_secs_f64() / whole.as_secs_f64().max(1e-9);
        Some(from.try_lerp_slerp(to, share, 1e-9).unwrap_or(*to))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn between_two_poses_and_not_beyond() {
        let at = |x: f64| Isometry3::translation(x, 0.0, 0.0);
        let (mut history, second) = (History::default(), Duration::from_secs(1));
        assert_eq!(history.at(second), None);
        history.add(second, at(1.0));
        history.add(3 * second, at(2.0));
        // A pose that arrives late is dropped.
        history.add(2 * second, at(9.0));
        let x = |time: Duration| history.at(time).map(|pose| pose.translation.x);
        assert_eq!(x(Duration::ZERO), Some(1.0));
        assert_eq!(x(2 * second), Some(1.5));
        assert_eq!(x(5 * second), Some(2.0));
    }
}
