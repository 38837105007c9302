//! The results of a run: `metrics.json`, `canonical.ply`, pictures, and a page that shows everything.

pub mod colour;
pub mod frames;
#[cfg(feature = "cli")]
pub mod html;
#[cfg(feature = "rerun")]
pub mod live;
pub mod metrics;
#[cfg(feature = "cli")]
pub mod picture;
