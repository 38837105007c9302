//! A trajectory in joint space, like `move_cp` of a dVRK: all joints start and stop together.
//!
//! ```text
//! q(t) = q₀ + s(t)/S · (q₁ − q₀)         S = max |Δq| / v_max      v_max = 90°/s, 0.2 m/s;  a_max the same per second
//! ```

use std::f64::consts::FRAC_PI_2;
use std::time::Duration;

use crate::Error;
use crate::arm::{Profile, ProfileLimits};

/// Highest speed of the joints: rad/s, m/s for the insertion.
const SPEEDS: [f64; 6] = [FRAC_PI_2, FRAC_PI_2, 0.2, FRAC_PI_2, FRAC_PI_2, FRAC_PI_2];
/// Time of a step of the profile.
const STEP: Duration = Duration::from_millis(1);

/// A motion of `N` values at once.
#[derive(Debug, Clone, Copy)]
pub(super) struct Trajectory<const N: usize> {
    start: [f64; N],
    goal: [f64; N],
    profile: Profile,
    left_over: Duration,
}

impl Trajectory<6> {
    pub(super) fn of_joints(start: [f64; 6], goal: [f64; 6]) -> Result<Self, Error> {
        Self::new(start, goal, SPEEDS)
    }
}

impl Trajectory<1> {
    pub(super) fn of_jaw(start: f64, goal: f64) -> Result<Self, Error> {
        Self::new([start], [goal], [FRAC_PI_2])
    }
}

impl<const N: usize> Trajectory<N> {
    fn new(start: [f64; N], goal: [f64; N], speeds: [f64; N]) -> Result<Self, Error> {
        let times = (0..N).map(|i| (goal[i] - start[i]).abs() / speeds[i]);
        let limits = ProfileLimits {
            speed: 1.0,
            acceleration: 1.0,
            step: 1.0,
        };
        Ok(Self {
            start,
            goal,
            profile: Profile::new(times.fold(0.0, f64::max), STEP.as_secs_f64(), limits)?,
            left_over: Duration::ZERO,
        })
    }

    /// Advances the time; returns the values then.
    pub(super) fn advance(&mut self, time: Duration) -> [f64; N] {
        self.left_over += time;
        while self.left_over >= STEP && !self.profile.is_done() {
            self.left_over -= STEP;
            self.profile.advance();
        }
        if self.profile.is_done() {
            return self.goal;
        }
        let share = self.profile.travelled() / self.profile.length();
        std::array::from_fn(|i| self.start[i] + share * (self.goal[i] - self.start[i]))
    }

    pub(super) fn is_done(&self) -> bool {
        self.profile.is_done()
    }
}
