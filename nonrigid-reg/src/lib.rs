#![doc = include_str!("../README.md")]

pub mod cloud;
mod error;
mod matching;
mod nodes;
mod options;
mod prior;
mod register;
mod system;
mod tree;

pub use cloud::{Cloud, Downsampled, boundary_points, estimate_normals, voxel_downsample};
pub use error::Error;
pub use nalgebra;
pub use options::Options;
pub use register::{Feature, Landmark, Registrar, Registration, Status, register};
