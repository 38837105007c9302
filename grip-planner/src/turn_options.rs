//! Options of turning over.

use derive_setters::Setters;
use std::f64::consts::{FRAC_PI_2, PI};

use nalgebra::Point3;

use crate::scene::{not_negative, positive, within};
use crate::{Error, Turn};

/// Position of the body after a turn.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Recentre {
    /// Where it tumbles to: at a distance of about its width and its thickness.
    Tumble,
    /// Where it lay.
    Stay,
    /// With its centre at this point, as far as a shift perpendicular to the axis allows.
    At(Point3<f64>),
}

/// Options of [`crate::turn_over`].
#[derive(Debug, Clone, Copy, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct TurnOptions {
    /// Angle of the turn, radians, between a quarter and half a turn. Default: [`Turn::angle`].
    pub angle: Option<f64>,
    /// Additional lift for the sag, as a share of the lever. Default 0.12: a body of 10 kPa stretches by about 7 % under
    /// its own weight at 0.15 m, and must come off the table.
    pub slack: f64,
    /// Shortening of the lever while the body is laid down, so that it is not dragged. Default 0.08.
    pub retract: f64,
    /// Least height of the tips above the table at the end, metres. Default 0.012.
    pub release_height: f64,
    /// Position of the body after the turn. Default: where it was.
    pub recentre: Recentre,
    /// Distance by which the lifting grips move apart along the axis during the lift, metres. Default 0.
    pub stretch: f64,
    /// Largest speed of a tip, m/s; an arm's own limit counts too. Default 0.05.
    pub speed: f64,
    /// Acceleration and deceleration, m/s². Default 0.05.
    pub acceleration: f64,
    /// Largest rotation rate of a tip, rad/s. Default 1.
    pub turn_rate: f64,
    /// Least angle between a tool and the table at any time, radians. Default 30°.
    pub min_elevation: f64,
    /// Angle at which a supporting arm releases, radians. Default 60°.
    pub support_until: f64,
    /// How far the tips retreat after the release, metres. Default 0.05.
    pub retreat_distance: f64,
    /// Largest angle between way points, radians. Default 3°.
    pub step: f64,
}

impl Default for TurnOptions {
    fn default() -> Self {
        Self {
            angle: None,
            slack: 0.12,
            retract: 0.08,
            release_height: 0.012,
            recentre: Recentre::Stay,
            stretch: 0.0,
            speed: 0.05,
            acceleration: 0.05,
            turn_rate: 1.0,
            min_elevation: 30f64.to_radians(),
            support_until: 60f64.to_radians(),
            retreat_distance: 0.05,
            step: 3f64.to_radians(),
        }
    }
}

impl TurnOptions {
    pub(crate) fn check(&self) -> Result<(), Error> {
        if let Some(angle) = self.angle {
            within(
                "angle",
                angle,
                FRAC_PI_2,
                PI,
                "between a quarter and half a turn",
            )?;
        }
        within("slack", self.slack, 0.0, 1.0, "between 0 and 1")?;
        within("retract", self.retract, 0.0, 0.9, "between 0 and 0.9")?;
        not_negative("release_height", self.release_height)?;
        not_negative("stretch", self.stretch)?;
        positive("speed", self.speed)?;
        positive("acceleration", self.acceleration)?;
        positive("turn_rate", self.turn_rate)?;
        within(
            "min_elevation",
            self.min_elevation,
            0.0,
            FRAC_PI_2,
            "between 0 and a right angle",
        )?;
        within(
            "support_until",
            self.support_until,
            0.0,
            FRAC_PI_2,
            "between 0 and a right angle",
        )?;
        positive("retreat_distance", self.retreat_distance)?;
        within(
            "step",
            self.step,
            1e-3,
            FRAC_PI_2,
            "between 0.001 and a right angle",
        )
    }

    /// Angle of the turn, radians.
    pub(crate) fn end(&self, turn: &Turn) -> f64 {
        self.angle.unwrap_or(turn.angle).clamp(FRAC_PI_2, PI)
    }
}
