//! The part of space that is used.

use nalgebra::{Isometry3, Point3, Vector3};

/// An oriented box; points outside of it are ignored.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Workspace {
    /// Pose of the centre of the box in the camera frame.
    pub camera_from_center: Isometry3<f64>,
    /// Half the length of each side, metres.
    pub half_extents: Vector3<f64>,
}

impl Workspace {
    /// Whether the box, surface included, contains a point given in the camera frame.
    pub fn contains(&self, point: &Point3<f64>) -> bool {
        let local = self.camera_from_center.inverse_transform_point(point);
        local
            .iter()
            .zip(&self.half_extents)
            .all(|(value, half)| value.abs() <= *half)
    }
}
