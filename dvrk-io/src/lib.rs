#![doc = include_str!("../README.md")]

pub mod arm;
pub mod calibration;
pub mod camera;
pub mod cdr;
pub mod depth;
mod error;
pub mod features;
pub mod kinematics;
mod psm;
pub mod serve;
pub mod session;
pub mod transport;

pub use error::Error;
pub use nalgebra;
pub use psm::Psm;
