//! What a run leaves behind: `metrics.json`, `canonical.ply`, pictures.

pub mod frames;
pub mod metrics;
#[cfg(feature = "cli")]
pub mod picture;
pub mod ply;
