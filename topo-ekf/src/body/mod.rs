//! Tracks the body, not only its surface: a volumetric elastic prior with the surface embedded in it.
//!
//! ```text
//! min over x     elastic energy from rest (x)  +  ½ Σ rows ((d·(x(e) − q)) / σ)²  +  ½ ‖x − expected‖² / σ_motion²  −  weight · x
//! s.t.           no point below the table, inequalities of the caller
//! ```
//!
//! | file | content |
//! |---|---|
//! | `cube` | shape functions and stiffness of the unit cube |
//! | `lattice` | cells and nodes at rest, embedding of points |
//! | `pieces` | copies of a cell for pieces of material that are not connected in it |
//! | `removal` | removal of cells, new indices |
//! | `pose` | live nodes, rotations, forward and inverse map |
//! | `row` | equations and inequalities on embedded points |
//! | `self_contact` | inequalities where the surface comes near itself |
//! | `elastic` | energy, forces, assembly and one Gauss–Newton step |
//! | `weight` | gravity and the reaction of the table at rest, estimate of weight over stiffness |
//! | `frame` | input and result of a frame |
//! | `project` | the nearest estimate that satisfies the constraints |
//! | `variance` | covariances of embedded points, and which of them are determined |
//! | `filter` | the filter: predict, relinearise, update, project |
//!
//! A block of 64 × 32 × 32 mm is gripped at one end and lifted. All of it follows, and sags under its weight:
//!
//! ```
//! use topo_ekf::Plane;
//! use topo_ekf::body::{BodyFilter, BodyFrame, BodyOptions, Embedding, Lattice};
//! use topo_ekf::nalgebra::{Point3, Rotation3, UnitVector3, Vector3};
//!
//! # fn main() -> Result<(), topo_ekf::Error> {
//! let mut lattice = Lattice::new(0.016, Point3::origin(), Rotation3::identity());
//! for k in 0..16 {
//!     lattice.ensure([k % 4, k / 4 % 2, k / 8]);
//! }
//! let table = Plane { normal: UnitVector3::new_normalize(Vector3::z()), offset: 0.0 };
//! let mut body = BodyFilter::new(lattice, table, &BodyOptions::default())?;
//!
//! // The surface: the middles of the top faces and of the bottom ones.
//! let top: Vec<Embedding> = (8..16).map(|cell| Embedding::new(cell, [0.5, 0.5, 1.0])).collect();
//! let bottom: Vec<Embedding> = (0..8).map(|cell| Embedding::new(cell, [0.5, 0.5, 0.0])).collect();
//! let surface = [&top[..], &bottom[..]].concat();
//! let grip = Embedding::new(8, [0.0, 0.5, 1.0]);
//!
//! let mut report = Default::default();
//! for frame in 1..=20 {
//!     let lift = Vector3::new(0.0, 0.0, 0.002 * f64::from(frame));
//!     let held = [(grip, Point3::new(0.0, 0.016, 0.032) + lift)];
//!     report = body.step(
//!         &BodyFrame::new(&held, &surface),
//!         // What a camera measures goes here: a row for every surface point that it saw.
//!         &mut |_, _, _| Vec::new(),
//!         &mut |_, _| {},
//!     )?;
//! }
//! let lifted = body.pose().position(body.lattice(), &grip);
//! assert!((lifted.z - 0.072).abs() < 0.004);
//! // Nothing is below the table, and the far end is less certain than the gripped one.
//! let lowest = surface.iter().map(|at| body.pose().position(body.lattice(), at).z);
//! assert!(lowest.fold(f64::INFINITY, f64::min) > -1e-6);
//! let sigmas = body.marginal_sigmas(&[grip, bottom[3]])?;
//! assert!(sigmas[0] < sigmas[1]);
//! assert!(report.grip_force.z > 0.0);
//! # Ok(())
//! # }
//! ```

mod cube;
mod elastic;
mod filter;
mod frame;
mod lattice;
mod options;
mod pieces;
mod pose;
mod project;
mod removal;
mod row;
#[cfg(feature = "serde")]
mod saved;
mod self_contact;
mod spent;
mod variance;
mod weight;

pub use cube::{Occupancy, PARTS};
pub use filter::BodyFilter;
pub use frame::{BodyFrame, BodyReport, Limits, Progress};
pub use lattice::{Cell, Embedding, Lattice};
pub use options::{BodyOptions, Table};
pub use pieces::Piece;
pub use pose::{AtRest, Pose};
pub use removal::Renumbered;
pub use row::{BodyInequality, Row};
pub use self_contact::SelfContact;
pub use spent::Spent;
pub use variance::BodyObservability;
pub use weight::Foot;
