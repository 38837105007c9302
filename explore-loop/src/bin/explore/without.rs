//! Parts of the method that can be left out, to measure what each contributes.
//!
//! Not among them are parts that everything else depends on: the elastic body that is always deformed from its rest shape, the closed surface that
//! is fitted, filled and written, the gates and robust weights of the matches, and the missing vector area by which turns are planned.

use crate::Failure;
use clap::ValueEnum;
use explore_loop::explore::{ClosedBy, ExploreOptions};
use explore_loop::plan::CoveragePlanner;
use explore_loop::reconstruct::{Material, ReconstructOptions};
use topo_ekf::body::Table;

/// A part that can be left out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Part {
    /// The table: no constraint, contact or friction in the filter
    Table,
    /// Self-contact: surface that may not pass through other surface
    SelfContact,
    /// The whole filter: no momentum, weight, grips or constraints; only registration is left
    Filter,
    /// The weight of the body
    Weight,
    /// The estimate of weight over stiffness, which keeps its initial value
    WeightEstimate,
    /// Friction with the table
    Friction,
    /// Pieces of material within a lattice cell: fingers that touch stick together
    Pieces,
    /// The hollow body that is tracked beside the solid one
    Hollow,
    /// The re-fusion of all keyframes at rest: the shape stays as it grew
    Refusion,
    /// Fitting the poses of the keyframes anew before the re-fusion
    Refit,
    /// The tests of the surface before the end: Betti numbers alone decide, as in the paper
    SurfaceTest,
    /// Stretching holes open
    Stretching,
    /// Keeping a long body from being stood on its end
    Lying,
    /// What keeps grips slower than the requested speed: the limits by the motion of the surface between frames, on rotation and on acceleration, and slowing down where frames fit badly
    SpeedLimit,
    /// Recovery: the first failed manipulation ends the run
    Recovery,
}

/// A standard deviation small enough to keep the assumed value, 1/m.
const CERTAIN: f64 = 1e-9;
/// Motion of the surface between frames that is never reached, metres.
const UNLIMITED: f64 = 1.0;
/// Acceleration, m/s², and rotation rate, rad/s, that do not limit grips at 0.25 m/s and 10 Hz.
const ABRUPT: f64 = 2.5;
const WHIRLING: f64 = 10.0;

impl Part {
    /// The name on the command line.
    fn name(self) -> String {
        let value = self.to_possible_value();
        value.map_or_else(String::new, |value| value.get_name().to_owned())
    }

    /// Removes the part from the reconstruction, if it belongs there.
    pub fn leave_out_of_reconstruction(self, options: &mut ReconstructOptions) {
        let body = &mut options.body;
        match self {
            Self::Table => body.table = Table::Absent,
            Self::SelfContact => options.separation = None,
            Self::Filter => {
                (body.presteps, body.momentum) = (0, 0.0);
                for part in [Self::Table, Self::SelfContact, Self::Weight] {
                    part.leave_out_of_reconstruction(options);
                }
            }
            Self::Weight => {
                (body.initial_weight, body.initial_weight_sigma) = (0.0, CERTAIN);
                // The limit on the pull of a grip is expressed in weights of the body.
                options.limits.pull = f64::INFINITY;
            }
            Self::WeightEstimate => body.initial_weight_sigma = CERTAIN,
            Self::Friction => body.friction = 0.0,
            Self::Pieces => options.material = Material::Whole,
            Self::Hollow => options.hollow = None,
            Self::Refusion => options.fusion_rounds = 0,
            Self::Refit => options.fusion_rounds = options.fusion_rounds.min(1),
            _ => {}
        }
    }

    /// Whether the part belongs to the planning of grips.
    pub fn is_of_planner(self) -> bool {
        matches!(self, Self::Stretching | Self::Lying | Self::SpeedLimit)
    }

    /// Whether the part belongs to exploring, not to the reconstruction.
    pub fn is_of_exploring(self) -> bool {
        self.is_of_planner() || matches!(self, Self::SurfaceTest | Self::Recovery)
    }

    /// Removes the part from the loop, if it belongs there.
    pub fn leave_out_of_loop(self, options: &mut ExploreOptions) {
        match self {
            Self::SurfaceTest => options.closed_by = ClosedBy::BettiNumbers,
            Self::Recovery => options.max_recoveries = 0,
            Self::SpeedLimit => {
                options.steady_speed = true;
                options.limits.holding.acceleration = ABRUPT;
                options.limits.holding.turn_rate = WHIRLING;
            }
            _ => {}
        }
    }
}

/// The planner without these parts.
pub(crate) fn planner_without(parts: &[Part]) -> CoveragePlanner {
    let mut planner = CoveragePlanner::default();
    for part in parts {
        match part {
            Part::Stretching => planner.holes = 0,
            Part::Lying => planner.upright = f64::INFINITY,
            Part::SpeedLimit => planner.options.tracking.xi = UNLIMITED,
            _ => {}
        }
    }
    planner
}

/// Rejects parts that do not exist here.
pub(crate) fn refuse(parts: &[Part], is: fn(Part) -> bool, who: &str) -> Result<(), Failure> {
    match parts.iter().find(|part| is(**part)) {
        Some(part) => Err(format!("--without {}: {who} this part", part.name()).into()),
        None => Ok(()),
    }
}

/// The names of some parts.
pub(crate) fn names(parts: &[Part]) -> Vec<String> {
    parts.iter().map(|part| part.name()).collect()
}
