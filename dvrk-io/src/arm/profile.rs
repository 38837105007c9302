//! The distance to move in each tick, so that speed, acceleration and step keep their limits and the end is met exactly.
//!
//! ```text
//! r          remaining distance,  v  the speed of the last tick,  h  the time of a tick,  a  the acceleration allowed
//! v_brake    the largest v' with  v'·h + v'²/(2a) ≤ r      v_brake = √(a²h² + 2·a·r) − a·h
//! v'         = min(v + a·h, v_max, step/h, v_brake)
//! r'         = r − v'·h
//! ```
//! Braking from v' in ticks covers less than v'²/(2a), so v' ≥ v − a·h is always possible: no limit is ever exceeded, and the
//! end is never passed. v_brake approaches r = 0 only in the limit; the last tick covers the rest at once when its speed
//! r/h is within a·h of both v and 0.
//!
//! A tick counts as the same time whether it comes late or not: a late tick makes the motion slower, never faster.

use crate::Error;

/// Speed, acceleration and step of a motion along a line: metres or radians.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ProfileLimits {
    /// Highest speed, units a second.
    pub speed: f64,
    /// Highest acceleration, units a second squared.
    pub acceleration: f64,
    /// Largest distance in one tick, units.
    pub step: f64,
}

impl ProfileLimits {
    /// # Errors
    /// [`Error::OutOfRange`]: a limit that is not positive or not finite.
    pub(crate) fn check(&self) -> Result<(), Error> {
        for (what, value) in [
            ("speed limit", self.speed),
            ("acceleration limit", self.acceleration),
            ("step limit", self.step),
        ] {
            if !(value > 0.0 && value.is_finite()) {
                return Err(Error::OutOfRange {
                    what,
                    value,
                    expected: "must be positive and finite",
                });
            }
        }
        Ok(())
    }
}

/// A motion along a line of a given length, from rest or from a speed, to rest.
///
/// ```
/// use dvrk_io::arm::{Profile, ProfileLimits};
///
/// // 10 cm with at most 5 cm/s and 10 cm/s², in ticks of 10 ms.
/// let limits = ProfileLimits { speed: 0.05, acceleration: 0.1, step: 0.01 };
/// let mut motion = Profile::new(0.1, 0.01, limits)?;
/// let (mut ticks, mut before) = (0, 0.0);
/// while !motion.is_done() {
///     motion.advance();
///     assert!(motion.speed() <= 0.05 && (motion.speed() - before).abs() <= 0.1 * 0.01 + 1e-12);
///     (ticks, before) = (ticks + 1, motion.speed());
/// }
/// assert_eq!(motion.travelled(), 0.1);
/// // At full speed all the way it would be 200.
/// assert!(ticks > 200);
/// # Ok::<(), dvrk_io::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Profile {
    length: f64,
    travelled: f64,
    speed: f64,
    tick: f64,
    limits: ProfileLimits,
}

impl Profile {
    /// A motion of `length` (positive or 0), with a tick every `tick` seconds.
    ///
    /// # Errors
    /// [`Error::OutOfRange`]: a length that is negative or not finite, a tick or a limit that is not positive and finite.
    pub fn new(length: f64, tick: f64, limits: ProfileLimits) -> Result<Self, Error> {
        limits.check()?;
        if !(length >= 0.0 && length.is_finite()) {
            return Err(Error::OutOfRange {
                what: "length of a motion",
                value: length,
                expected: "must be finite and not negative",
            });
        }
        if !(tick > 0.0 && tick.is_finite()) {
            return Err(Error::OutOfRange {
                what: "time of a tick",
                value: tick,
                expected: "must be positive and finite",
            });
        }
        Ok(Self {
            length,
            travelled: 0.0,
            speed: 0.0,
            tick,
            limits,
        })
    }

    /// Starts with the speed of a motion that it continues, limited to a speed from which it can stop in time.
    #[must_use]
    pub fn with_speed(self, speed: f64) -> Self {
        let most = self
            .top_speed()
            .min((2.0 * self.limits.acceleration * self.length).sqrt());
        Self {
            speed: if speed.is_finite() {
                speed.clamp(0.0, most)
            } else {
                0.0
            },
            ..self
        }
    }

    /// Starts with this speed, unless that would violate a limit: it is too fast, or the end is too near to stop there.
    pub(crate) fn continuing(self, speed: f64) -> Option<Self> {
        let profile = self.with_speed(speed);
        (profile.speed >= speed).then_some(profile)
    }

    /// Units a second, in the last tick.
    pub fn speed(&self) -> f64 {
        self.speed
    }

    /// Distance from the start.
    pub fn travelled(&self) -> f64 {
        self.travelled
    }

    /// The whole length.
    pub fn length(&self) -> f64 {
        self.length
    }

    /// Whether the end is reached.
    pub fn is_done(&self) -> bool {
        self.travelled >= self.length
    }

    /// Whether the end is reached and the last tick did not move: the last tick of a motion still has a speed.
    pub(crate) fn is_at_rest(&self) -> bool {
        self.is_done() && self.speed == 0.0
    }

    /// Shortens the motion to the braking distance.
    pub fn brake(&mut self) {
        let way = self.speed * self.speed / (2.0 * self.limits.acceleration);
        self.length = self.length.min(self.travelled + way);
    }

    fn top_speed(&self) -> f64 {
        self.limits.speed.min(self.limits.step / self.tick)
    }

    /// Advances one tick; returns the distance from the start.
    pub fn advance(&mut self) -> f64 {
        let (tick, gain) = (self.tick, self.limits.acceleration * self.tick);
        let left = self.length - self.travelled;
        if left <= 0.0 {
            self.speed = 0.0;
            return self.travelled;
        }
        let highest = (self.speed + gain).min(self.top_speed());
        let last = left / tick;
        if last <= highest && last <= gain && self.speed - last <= gain {
            self.speed = last;
            self.travelled = self.length;
            return self.travelled;
        }
        // The same as √(a²h² + 2ar) − ah, without the difference of two nearly equal numbers.
        let brake = 2.0 * self.limits.acceleration * left
            / ((gain * gain + 2.0 * self.limits.acceleration * left).sqrt() + gain);
        self.speed = highest.min(brake);
        let next = self.travelled + self.speed * tick;
        // If a step is too small to change the sum, the motion has reached its end.
        self.travelled = if next > self.travelled {
            next.min(self.length)
        } else {
            self.length
        };
        self.travelled
    }
}
