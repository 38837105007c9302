//! dVRK input and output: sessions of ROS 2 messages in MCAP, RGB-D depth images to segmented clouds

pub mod cdr;
pub mod depth;
mod error;
mod psm;
pub mod session;

pub use error::Error;
pub use psm::Psm;
