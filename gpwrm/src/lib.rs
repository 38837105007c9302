#![doc = include_str!("../README.md")]

mod batch;
mod collinear;
mod error;
mod field;
mod linear;
pub mod mls;
mod moments;
mod nodal;
mod options;
mod partition;
mod reach;
mod rotation;
mod shape;
mod time;
mod tree;
mod weight;

pub use error::Error;
pub use field::Field;
pub use linear::ShapeFunctions;
pub use nalgebra;
pub use options::{Determinacy, FieldOptions, Sample, Support};
pub use rotation::nearest_rotation;
pub use shape::Shape;
pub use tree::{Neighbour, Tree};
pub use weight::Weight;
