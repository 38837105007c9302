//! Robots explore unknown soft objects.
//!
//! One fixed depth camera looks at an object on a table; two or three arms grip it, turn it over or stretch it, until its
//! whole surface has been seen and its topology is that of a solid body.

pub use nalgebra;

pub mod canonical;
pub mod cell;
mod error;
pub mod explore;
pub mod measure;
pub mod plan;
pub mod reconstruct;
pub mod report;
pub mod stages;
pub mod visibility;

pub use error::Error;
