//! Parts of the method that can be left out, to learn what each of them is worth.
//!
//! Not among them is what the rest is built on and that has no other way to be done: the elastic body that is always bent from its rest shape, the
//! closed surface that is fitted, filled and written, the gates and robust weights of the matches, and the missing vector area that turns are planned by.

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
    /// Surface that keeps its side of other surface
    SelfContact,
    /// The whole filter: no momentum, no weight, no grips before the data, no constraints; what is left is registration
    Filter,
    /// The weight of the body
    Weight,
    /// The estimate of weight over stiffness: it stays as it is first assumed
    WeightEstimate,
    /// Friction with the table
    Friction,
    /// Pieces of material within a cell: fingers that touch hang together
    Pieces,
    /// The hollow body that is followed beside the solid one
    Hollow,
    /// The fusion of all keyframes at rest: the shape stays as it grew
    Refusion,
    /// Fitting the poses of the keyframes anew before they are fused again
    Refit,
    /// The tests of the surface before the end: Betti numbers alone stop, as in the paper
    SurfaceTest,
    /// Stretching holes open
    Stretching,
    /// Keeping a long body from being stood on its end
    Lying,
    /// The speed limit by how far the surface moves between frames: the speed asked for is tried
    SpeedLimit,
    /// Going on after something was given up: the first trouble is the end
    Recovery,
}

/// The smallest standard deviation that the body takes, 1/m: what is assumed stays.
const CERTAIN: f64 = 1e-9;
/// Motion of the surface between frames that no arm makes, metres.
const UNLIMITED: f64 = 1.0;

impl Part {
    /// The name on the command line.
    fn name(self) -> String {
        let value = self.to_possible_value();
        value.map_or_else(String::new, |value| value.get_name().to_owned())
    }

    /// Leaves it out of the reconstruction, if it is a part of that.
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
                // How hard grips pull is told in weights of the body.
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

    /// Whether it is a part of how grips are planned.
    pub fn is_of_planner(self) -> bool {
        matches!(self, Self::Stretching | Self::Lying | Self::SpeedLimit)
    }

    /// Whether it is a part of exploring, and not of the reconstruction.
    pub fn is_of_exploring(self) -> bool {
        self.is_of_planner() || matches!(self, Self::SurfaceTest | Self::Recovery)
    }

    /// Leaves it out of the loop, if it is a part of that.
    pub fn leave_out_of_loop(self, options: &mut ExploreOptions) {
        match self {
            Self::SurfaceTest => options.closed_by = ClosedBy::BettiNumbers,
            Self::Recovery => options.max_recoveries = 0,
            _ => {}
        }
    }
}

/// The planner without some parts.
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

/// Refuses parts that are not there to be left out.
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
