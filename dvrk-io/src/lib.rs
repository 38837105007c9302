#![doc = include_str!("../README.md")]

pub mod cdr;
pub mod depth;
mod error;
mod psm;
pub mod session;

pub use error::Error;
pub use nalgebra;
pub use psm::Psm;
