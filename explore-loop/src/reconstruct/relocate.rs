//! The body somewhere else: what is done when it was lost and has been found again.

use super::Reconstructor;
use nalgebra::Isometry3;

impl Reconstructor {
    /// Carries the body, as it is bent now, by a rigid motion of the camera frame; nothing else of the model changes.
    pub fn relocate(&mut self, found_from_lost: &Isometry3<f64>) {
        for track in self.track.iter_mut().chain(self.rival.as_mut()) {
            track.body.relocate(found_from_lost);
            track.pose();
        }
    }
}
