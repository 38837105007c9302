//! The simulated cell: a soft body on a table, two or three grippers, a depth camera.
//!
//! ```text
//! surface (implicit or file) ──► tetrahedra (isosurface stuffing) ──► soft body (rapier, decimetres)
//!        │                              │ barycentric weights                │ 10 ms steps, held nodes kinematic
//!        └──────────────────────────────┴──► fine surface ◄──────────────────┘
//!                                               │ z-buffer, with the arms
//!                                               ▼
//!                                          Observation            Truth: only for the caller of SimCell::new
//! ```
//!
//! | what | where |
//! |---|---|
//! | the scene on the table | [`Scene`], [`TriangleMesh`] |
//! | options | [`SimOptions`] |
//! | the cell | [`SimCell`] |
//! | the ground truth | [`Truth`] |
//! | the same world for clients of a robot | [`SimCell::drive`], [`SimCell::depth_image`], [`PsmStand`] |
//! | the recorded commands, to reproduce a state | [`Journal`], [`SimCell::repeat`] |
//!
//! ```
//! use explore_loop::cell::Cell;
//! use explore_loop::cell::sim::{Scene, SimCell, SimOptions};
//!
//! let mut options = SimOptions::new(Scene::ellipsoid([0.05, 0.04, 0.03])?);
//! options.fidelity.tetrahedra = 300;
//! let (mut cell, truth) = SimCell::new(&options)?;
//! let frame = cell.observe()?;
//! assert!(frame.points.len() > 1000);
//! assert_eq!(truth.live().len(), truth.rest().vertices.len());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

// Grid coordinates are clamped to be non-negative before they become indices.
#![allow(clippy::cast_sign_loss)]

mod arms;
mod body;
mod camera;
mod clutter;
mod colour_image;
mod driven;
mod embedding;
mod error;
mod glove;
mod gripper;
mod hollows;
mod implicit;
mod journal;
mod lattice;
mod links;
mod mesh;
mod options;
mod realsense;
mod scene;
mod segment;
mod shapes;
mod sight;
mod surface_nets;
mod sway;
mod texture;
mod truth;
mod world;

pub use clutter::Attachment;
pub use driven::PsmStand;
pub use error::SimError;
pub use journal::{Command, Journal};
pub use mesh::{MAX_TRIANGLES, TriangleMesh};
pub use options::{
    ArmModel, CameraModel, CameraOptions, Fidelity, JawOptions, Material, SimOptions,
};
pub use realsense::StereoOptions;
pub use scene::{SCENES, Scene, about};
pub use sway::Sway;
pub use truth::Truth;
pub use world::SimCell;
