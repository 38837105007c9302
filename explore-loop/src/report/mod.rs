//! What a run leaves behind: `metrics.json`, `canonical.ply`, pictures, and a page that shows it all.

pub mod colour;
pub mod frames;
#[cfg(feature = "cli")]
pub mod html;
#[cfg(feature = "rerun")]
pub mod live;
pub mod metrics;
#[cfg(feature = "cli")]
pub mod picture;
