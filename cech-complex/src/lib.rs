// The example of the README samples a surface.
#![cfg_attr(
    any(feature = "manifolds", not(doctest)),
    doc = include_str!("../README.md")
)]

mod active_set;
mod barrier;
mod betti;
mod cohomology;
mod complex;
mod cut;
mod cylinder;
mod decision;
mod error;
mod filtration;
mod geodesic;
mod local_homology;
mod loops;
#[cfg(feature = "manifolds")]
pub mod manifolds;
mod matching;
mod nerve;
mod net;
mod optimality;
mod options;
mod persistence;
mod problem;
mod proposal;
mod short_cycles;
mod size;
mod skeleton;
mod sweep;
mod union_find;
mod update;
mod valuation;
mod values;

pub use betti::betti_numbers;
pub use complex::Complex;
pub use cut::{DistortionLimits, Removed, displacement_cosine, displacement_difference};
pub use cylinder::Cylinder;
pub use error::Error;
pub use filtration::{FiltrationValue, filtration_value};
pub use local_homology::{LocalHomology, VertexKind};
pub use loops::{BoundaryLoop, missing_vector_area, vector_area_of_loop};
pub use net::{epsilon_net, farthest_points};
pub use options::{Options, Orientation};
pub use persistence::{Bar, Barcode};
pub use proposal::{Proposal, propose};
pub use size::{SizeEstimate, estimate_size};
pub use update::{Change, Updated};

pub use nalgebra;
