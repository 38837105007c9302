// The example of the README samples a surface.
#![cfg_attr(
    any(feature = "manifolds", not(doctest)),
    doc = include_str!("../README.md")
)]

mod active_set;
mod barrier;
mod cohomology;
mod complex;
mod cylinder;
mod distortion;
mod error;
mod filtration;
mod geodesic;
mod local_homology;
mod loops;
#[cfg(feature = "manifolds")]
pub mod manifolds;
mod nerve;
mod optimality;
mod persistence;
mod problem;
mod short_cycles;
mod skeleton;
mod update;

pub use complex::{Complex, Options, Orientation};
pub use cylinder::Cylinder;
pub use distortion::{DistortionLimits, Removed, displacement_cosine, displacement_difference};
pub use error::Error;
pub use filtration::{FiltrationValue, filtration_value};
pub use local_homology::{LocalHomology, VertexKind};
pub use loops::{BoundaryLoop, missing_vector_area, vector_area_of_loop};
pub use persistence::{Bar, Barcode};
pub use update::{Change, Updated};

pub use nalgebra;
