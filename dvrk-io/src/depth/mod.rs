//! From a camera to the cloud of the object: what is left once everything known is taken away.
//!
//! [`find_object`] takes what any depth camera sends ([`Scan`]), finds the table if it is not known, and gives oriented
//! points with an account of the rest. [`segment`] is its plain core for one image with everything known:
//!
//! ```text
//! X(u, v) = z · ((u − cx)/fx, (v − cy)/fy, 1)                                    back-projection
//! keep X  ⇔  X in the workspace                                                  crop
//!          ∧ normal · X + offset > clearance                                     not the table
//!          ∧ the pixel does not hang between two surfaces                        not flying
//!          ∧ distance(X, axis of c) > radius of c + clearance  for all capsules c   not an arm
//! ```
//!
//! Images are rectified (no lens distortion), row by row, depth along the optical axis. See
//! [`segment`] for what each step guarantees, and [`Psm::capsules`](crate::Psm::capsules) for the
//! capsules of a dVRK arm.

mod account;
mod camera;
mod capsule;
mod edge;
mod hanging;
mod image;
mod normals;
mod object;
mod options;
mod scan;
mod segment;
mod table;
mod voxels;

pub use account::Account;
pub use camera::Intrinsics;
pub use capsule::{Capsule, chain};
pub use image::DepthImage;
pub use object::{Object, find_object};
pub use options::ObjectOptions;
pub use scan::{LengthUnit, Scan, UnitSource};
pub use segment::{ObjectCloud, Removed, Segmentation, Workspace, segment};
pub use table::Table;
