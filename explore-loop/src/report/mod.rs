//! What a run leaves behind: `metrics.json`, `canonical.ply`, pictures.

pub mod frames;
pub mod metrics;
pub mod picture;
pub mod ply;
