//! From a camera to the cloud of the object, by removing everything else.
//!
//! [`Scan`] reads the messages of any depth camera; [`find_object`] finds the table if it is not known, and returns oriented
//! points with an account of the removed ones:
//!
//! ```text
//! X(u, v) = z · ((u − cx)/fx, (v − cy)/fy, 1)                                       back-projection
//! keep X  ⇔  X in the workspace                                                     crop
//!          ∧ distance(X, axis of c) > radius of c + clearance  for all capsules c   not an arm
//!          ∧ normal · X + offset > clearance                                        not the table
//!          ∧ the pixel is not between two surfaces                           not flying
//!          ∧ enough others are near, and a chain of near ones leads to the object   no outlier, no other part
//! ```
//!
//! Images are rectified (no lens distortion), row by row, depth along the optical axis. See
//! [`find_object`] for its guarantees, and [`Psm::capsules`](crate::Psm::capsules) for the
//! capsules of a dVRK arm.

mod account;
mod camera;
mod capsule;
mod hanging;
mod image;
mod normals;
mod object;
mod options;
mod part;
mod scan;
mod table;
mod voxels;
mod workspace;

pub use account::Account;
pub use camera::Intrinsics;
pub use capsule::{Capsule, chain};
pub use image::DepthImage;
pub use object::{Object, find_object};
pub use options::ObjectOptions;
pub use scan::{LengthUnit, Scan, UnitSource};
pub use table::Table;
pub use workspace::Workspace;
