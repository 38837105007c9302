#![doc = include_str!("../README.md")]

mod bodies;
mod columns;
mod digits;
mod error;
mod format;
mod glb;
mod load;
mod mesh;
mod normals;
mod npy;
mod obj;
mod off;
mod pcd;
mod place;
mod ply;
mod polygon;
#[cfg(feature = "program")]
pub mod program;
mod raw;
mod scalar;
#[cfg(feature = "serde")]
mod serialised;
mod stl;
mod table;
mod text;
mod weld;
mod write;
mod xyz;

pub use digits::three as three_digits;
pub use error::{Error, Place};
pub use format::Format;
pub use load::{Load, Vertices, parse, read};
pub use mesh::{Mesh, Property};
pub use normals::{estimate_normals, opposing_share};
pub use npy::Array;
pub use place::{Units, Up};
pub use table::{Table, read_table};
pub use write::{Encoding, Options, Precision};

pub use nalgebra;
