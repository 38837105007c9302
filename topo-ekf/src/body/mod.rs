//! The body, not only its surface: a volumetric elastic prior with the surface embedded in it.
//!
//! | file | what it holds |
//! |---|---|
//! | `cube` | shape functions and stiffness of the unit cube |
//! | `lattice` | cells and nodes at rest, embedding of points |
//! | `pose` | live nodes, rotations, forward and inverse map |
//! | `elastic` | energy, forces, assembly and one Gauss–Newton step |
//! | `weight` | gravity and the table's lost reaction, estimate of weight over stiffness |
//! | `filter` | the filter: predict, relinearise, update |

mod cube;
mod elastic;
mod filter;
mod lattice;
mod options;
mod pose;
mod weight;

pub use cube::{Occupancy, PARTS};
pub use elastic::Row;
pub use filter::{BodyFilter, BodyFrame, BodyReport, Progress};
pub use lattice::{Cell, Embedding, Lattice};
pub use options::BodyOptions;
pub use pose::{AtRest, Pose};
pub use weight::Foot;
