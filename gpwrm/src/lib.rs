#![doc = include_str!("../README.md")]

mod error;
mod field;
pub mod mls;
mod nodal;
mod options;
mod rotation;
mod shape;
mod tree;
mod weight;

pub use error::Error;
pub use field::Field;
pub use nalgebra;
pub use options::{Determinacy, FieldOptions, Sample, Support};
pub use rotation::nearest_rotation;
pub use shape::ShapeFunctions;
pub use weight::Weight;
