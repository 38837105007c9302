//! Robots explore unknown soft objects.
pub mod cell;
