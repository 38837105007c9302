#![doc = include_str!("../README.md")]

mod align;
mod boxes;
mod cloud;
mod defaults;
mod each;
mod error;
mod frame;
mod input;
mod model;
mod nodes;
mod off_rigid;
mod options;
mod prior;
mod register;
mod registration;
mod report;
mod slippage;
mod system;
mod target;
mod traits;

pub use align::{Alignment, align_rigid, even_rotations, refine_rigid, rigid_alignments};
pub use cloud::{Cloud, Downsampled, boundary_points, estimate_normals, voxel_downsample};
pub use defaults::{AnnealedTukey, ClosestPoint, PointToPlane, Settled};
pub use error::Error;
pub use nalgebra;
pub use options::Options;
pub use register::{Registrar, register};
pub use registration::{Feature, Landmark, LandmarkField, Registration, Residuals, Status};
pub use target::Target;
pub use traits::{
    Correspondence, Linearised, Pair, Probe, Progress, Rejection, Residual, Termination,
};
