//! Limits on the speed of the grips.
//!
//! ```text
//! v_max = ξ F / max_i ‖J_i v̂‖
//! ```
//!
//! Registration can follow a node that moves less than `ξ` between two frames, at `F` frames a second; for unit grip speed node `i` moves
//! with `‖J_i v̂‖` ([`crate::Coverage::field`] with unit velocities). The governor starts below the limit, accelerates, and slows down at once when the
//! registration residual rises: waiting for a frame that fits badly costs less than losing the body.

use derive_setters::Setters;
use nalgebra::Vector3;

use crate::Error;
use crate::scene::{positive, within};

/// Largest grip speed at which no node moves more than `xi` metres between frames, m/s.
///
/// `field` is the velocity of the nodes for unit grip speed. Infinite if no node moves.
///
/// # Errors
/// `xi` or `frame_rate` not positive, or a velocity that is not finite.
///
/// ```
/// # use grip_planner::speed_limit;
/// # use nalgebra::Vector3;
/// let field = [Vector3::x(), Vector3::new(0.0, 0.5, 0.0)];
/// assert_eq!(speed_limit(&field, 0.001, 10.0)?, 0.01);
/// # Ok::<(), grip_planner::Error>(())
/// ```
pub fn speed_limit(field: &[Vector3<f64>], xi: f64, frame_rate: f64) -> Result<f64, Error> {
    positive("xi", xi)?;
    positive("frame_rate", frame_rate)?;
    if let Some((index, v)) = field
        .iter()
        .enumerate()
        .find(|(_, v)| !v.iter().all(|x| x.is_finite()))
    {
        return Err(Error::NonFinitePoint {
            index,
            point: (*v).into(),
        });
    }
    let fastest = field.iter().map(Vector3::norm).fold(0.0, f64::max);
    Ok(xi * frame_rate / fastest)
}

/// Options of a [`SpeedGovernor`].
#[derive(Debug, Clone, Copy, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct GovernorOptions {
    /// Speed while frames fit well, m/s: at most that of [`speed_limit`].
    pub cruise: f64,
    /// Start speed and least speed, as a share of `cruise`. Default 0.2.
    pub least: f64,
    /// Acceleration, m/s². Default 0.02.
    pub acceleration: f64,
    /// Residual up to which the speed is not reduced, metres. Default 0.001.
    pub calm: f64,
    /// Residual at which the speed is reduced to the least, metres. Default 0.004.
    pub alarm: f64,
}

impl Default for GovernorOptions {
    fn default() -> Self {
        Self {
            cruise: 0.02,
            least: 0.2,
            acceleration: 0.02,
            calm: 0.001,
            alarm: 0.004,
        }
    }
}

/// Ramps the grip speed up and slows it down with the registration residual.
///
/// ```
/// # use grip_planner::{GovernorOptions, SpeedGovernor};
/// let mut governor = SpeedGovernor::new(GovernorOptions::default())?;
/// let calm = (0..100).map(|_| governor.next(0.1, 0.0)).last();
/// assert_eq!(calm, Some(0.02));
/// assert!(governor.next(0.1, 0.01) < 0.005);
/// # Ok::<(), grip_planner::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct SpeedGovernor {
    options: GovernorOptions,
    speed: f64,
}

impl SpeedGovernor {
    /// A governor at its start speed.
    ///
    /// # Errors
    /// Settings out of range.
    pub fn new(options: GovernorOptions) -> Result<Self, Error> {
        positive("cruise", options.cruise)?;
        within("least", options.least, 1e-6, 1.0, "above 0 and at most 1")?;
        positive("acceleration", options.acceleration)?;
        positive("calm", options.calm)?;
        positive("alarm", options.alarm)?;
        within(
            "alarm",
            options.alarm,
            options.calm,
            f64::INFINITY,
            "at least calm",
        )?;
        Ok(Self {
            options,
            speed: options.least * options.cruise,
        })
    }

    /// Speed for the next `dt` seconds, given the latest residual in metres. NaN reduces it to the least.
    pub fn next(&mut self, dt: f64, residual: f64) -> f64 {
        let allowed = self.options.cruise * self.share(residual);
        let risen = self.speed + self.options.acceleration * dt.max(0.0);
        self.speed = risen.min(allowed);
        self.speed
    }

    /// The last speed, m/s.
    pub fn speed(&self) -> f64 {
        self.speed
    }

    fn share(&self, residual: f64) -> f64 {
        let GovernorOptions {
            least, calm, alarm, ..
        } = self.options;
        if residual <= calm {
            return 1.0;
        }
        if residual < alarm {
            return 1.0 - (1.0 - least) * (residual - calm) / (alarm - calm);
        }
        least
    }
}
