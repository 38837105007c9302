//! What a run leaves behind: `metrics.json`, `canonical.ply`, pictures, and a page that shows it all.

pub mod frames;
#[cfg(feature = "cli")]
pub mod html;
pub mod metrics;
#[cfg(feature = "cli")]
pub mod picture;
