#![doc = include_str!("../README.md")]

mod among;
mod columns;
mod compliance;
mod consistency;
mod constrain;
mod contact;
mod dual;
mod error;
mod filter;
mod graph;
mod interior;
mod marginal;
mod memory;
mod motion;
mod observability;
mod observation;
mod options;
mod pivots;
mod project;
mod regraph;
mod report;
mod rotation;
mod rows;
mod search;
mod system;
mod table;

pub use consistency::{Consistency, Verdict};
pub use error::Error;
pub use filter::Filter;
pub use nalgebra;
pub use observability::Observability;
pub use observation::{Frame, Inequality, Observation, Plane};
pub use options::{Motion, Options, Projection, Unseen};
pub use project::Status;
pub use report::StepReport;
