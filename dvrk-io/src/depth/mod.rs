//! From a depth image to the cloud of the object: what is left once everything known is taken away.
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

mod camera;
mod capsule;
mod edge;
mod image;
mod segment;

pub use camera::Intrinsics;
pub use capsule::{Capsule, chain};
pub use image::DepthImage;
pub use segment::{ObjectCloud, Removed, Segmentation, Workspace, segment};
