#![doc = include_str!("../README.md")]

pub mod cloud;
mod error;
mod frame;
mod matching;
mod nodes;
mod options;
mod prior;
mod register;
mod registration;
mod report;
mod system;
mod tree;

pub use cloud::{Cloud, Downsampled, boundary_points, estimate_normals, voxel_downsample};
pub use error::Error;
pub use nalgebra;
pub use options::Options;
pub use register::{Registrar, register};
pub use registration::{Feature, Landmark, Registration, Status};
