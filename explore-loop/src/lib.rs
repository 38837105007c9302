//! Robotic exploration of unknown soft objects.
//!
//! A depth camera observes an object on a table; two or three arms grip it and turn it over until its whole surface has been seen and its
//! topology is that of a solid body. The method follows the paper on topology-aware robotic exploration of unknown soft objects, *The International
//! Journal of Robotics Research*, DOI [10.1177/02783649251415415](https://doi.org/10.1177/02783649251415415), called *the paper* in this crate.
//!
//! | step of the method | module |
//! |---|---|
//! | the cell: camera, table, arms (simulated, recorded or real) | [`cell`] |
//! | registration of the elastic body in each frame, growth, re-fusion | [`reconstruct`] |
//! | the baseline: a volume fused through a warp field | [`baseline`] |
//! | the model: cut, topology, mesh | [`canonical`] |
//! | visibility from the camera | [`visibility`] |
//! | grips and motions | [`plan`] |
//! | the loop as a state machine | [`explore`] |
//! | checkpoints of an interrupted run | [`checkpoint`] |
//! | measures against a ground truth | [`measure`] |
//! | files and pictures | [`report`] |
//! | meshes and clouds in and out (the crate `mesh-io`) | [`mesh`] |
//!
//! Units are SI, everything is in the camera frame (+z away from the camera) unless a name says `rest`: the frame of the first
//! observation. The same input gives the same bits.
//!
//! # Example
//! The first frames of an ellipsoid in the simulated cell:
//! ```
//! # #[cfg(feature = "sim")] {
//! use explore_loop::canonical::topology;
//! use explore_loop::cell::Cell;
//! use explore_loop::cell::sim::{Scene, SimCell, SimOptions};
//! use explore_loop::reconstruct::{ReconstructOptions, Reconstructor};
//!
//! let mut options = SimOptions::new(Scene::ellipsoid([0.05, 0.04, 0.03])?);
//! options.fidelity.tetrahedra = 300;
//! let (mut cell, _truth) = SimCell::new(&options)?;
//! let spacing = 0.005;
//! let mut reconstructor = Reconstructor::new(ReconstructOptions::new(spacing))?;
//! for _ in 0..3 {
//!     let observation = cell.observe()?;
//!     reconstructor.process(&observation, &cell.info().table)?;
//! }
//! // The upper half is known, so the surface is one piece and still open.
//! let topology = topology::analyse(reconstructor.model(), spacing)?;
//! assert!(!topology.is_closed());
//! assert_eq!(topology.persistent[0], 1);
//! # }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! A whole exploration is the program `explore run`; `src/bin/explore/run.rs` shows the calls.

pub use mesh_io as mesh;
pub use nalgebra;

pub mod baseline;
pub mod canonical;
pub mod cell;
pub mod checkpoint;
mod error;
pub mod explore;
pub mod measure;
pub mod plan;
pub mod reconstruct;
pub mod report;
pub mod visibility;

pub use error::Error;
