//! Options of the planner.

use derive_setters::Setters;
use nalgebra::UnitVector3;

use crate::scene::{not_negative, positive, within};
use crate::turn::check_tilt;
use crate::{CoverageOptions, Error};

/// Which vertices may be gripped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum CandidateSource {
    /// Only the visible boundary of the explored part.
    Boundary,
    /// The visible boundary first; the remaining places go to visible vertices near the outline of the body,
    /// so that a body whose boundary is hidden can still be turned.
    BoundaryThenVisible,
}

/// Use of a third arm.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Support {
    /// None.
    None,
    /// It holds the body near the pivot while the others lift, if it can reach.
    Hold,
}

/// Options of [`crate::candidates`] and [`crate::plan_grips`].
#[derive(Debug, Clone, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Options {
    /// The stiffness and the target weights.
    pub coverage: CoverageOptions,
    /// Which vertices may be gripped. Default: the boundary, then the visible outline.
    pub source: CandidateSource,
    /// Largest number of candidates, spread out. Default 100.
    pub max_candidates: usize,
    /// Least angle between a tool and the table, radians. Default 40°: flatter tools collide with the table or the neighbour.
    pub min_elevation: f64,
    /// A vertex whose normal points farther below the horizontal is not approached, radians. Default 50°.
    pub max_dip: f64,
    /// How far the tip goes beyond the vertex, metres. Default 0.003, so that the jaws close on tissue and not in front of it.
    pub grip_depth: f64,
    /// Length of the straight last part of the approach, metres. Default 0.03.
    pub approach_distance: f64,
    /// Factor on the score for each grip that is visible but not on the boundary. Default 0.8.
    pub outline_weight: f64,
    /// Weight of the suitability for turning in the score, from 0 (coverage alone; paper, Algorithm 2) to 1. Default 0.5.
    pub turning_weight: f64,
    /// Wanted distance of two lifting grips, as a share of the box along the axis. Default 0.4 to 0.8.
    pub spread: [f64; 2],
    /// Largest tilt of a hanging body to either side, to show its ends, radians, at most 60°. Default 30°; 0 never tilts.
    pub tilt: f64,
    /// Largest number of sets. Default 24.
    pub max_sets: usize,
    /// Lift only the side in this direction. Default: whichever is best.
    pub lift: Option<UnitVector3<f64>>,
    /// Use of a third arm. Default: holds.
    pub support: Support,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            coverage: CoverageOptions::default(),
            source: CandidateSource::BoundaryThenVisible,
            max_candidates: 100,
            min_elevation: 40f64.to_radians(),
            max_dip: 50f64.to_radians(),
            grip_depth: 0.003,
            approach_distance: 0.03,
            outline_weight: 0.8,
            turning_weight: 0.5,
            spread: [0.4, 0.8],
            tilt: 30f64.to_radians(),
            max_sets: 24,
            lift: None,
            support: Support::Hold,
        }
    }
}

impl Options {
    pub(crate) fn check(&self) -> Result<(), Error> {
        let right = std::f64::consts::FRAC_PI_2;
        self.coverage.check()?;
        within(
            "min_elevation",
            self.min_elevation,
            0.0,
            right,
            "between 0 and a right angle",
        )?;
        within(
            "max_dip",
            self.max_dip,
            0.0,
            right,
            "between 0 and a right angle",
        )?;
        not_negative("grip_depth", self.grip_depth)?;
        positive("approach_distance", self.approach_distance)?;
        if self.max_candidates < 2 {
            return Err(Error::BadSetting {
                name: "max_candidates",
                value: self.max_candidates as f64,
                expected: "at least 2",
            });
        }
        within(
            "outline_weight",
            self.outline_weight,
            0.0,
            1.0,
            "between 0 and 1",
        )?;
        within(
            "turning_weight",
            self.turning_weight,
            0.0,
            1.0,
            "between 0 and 1",
        )?;
        check_tilt(self.tilt)?;
        positive("spread[0]", self.spread[0])?;
        within(
            "spread[1]",
            self.spread[1],
            self.spread[0],
            10.0,
            "at least spread[0]",
        )
    }
}
