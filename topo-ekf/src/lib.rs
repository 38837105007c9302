#![doc = include_str!("../README.md")]

mod active;
mod columns;
mod contact;
mod dual;
mod error;
mod filter;
mod graph;
mod marginal;
mod memory;
mod motion;
mod observability;
mod observation;
mod options;
mod project;
mod report;
mod rotation;
mod system;

pub use error::Error;
pub use filter::Filter;
pub use nalgebra;
pub use observability::Observability;
pub use observation::{Frame, Observation, Plane};
pub use options::{Options, Unseen};
pub use project::Status;
pub use report::StepReport;
