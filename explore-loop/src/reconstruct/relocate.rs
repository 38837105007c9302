//! Moves the body after it was lost and found again.

use super::Reconstructor;
use nalgebra::Isometry3;

impl Reconstructor {
    /// Moves the deformed body by a rigid motion of the camera frame; nothing else in the model changes.
    pub fn relocate(&mut self, found_from_lost: &Isometry3<f64>) {
        for track in self.track.iter_mut().chain(self.rival.as_mut()) {
            track.body.relocate(found_from_lost);
            track.pose();
        }
    }
}
