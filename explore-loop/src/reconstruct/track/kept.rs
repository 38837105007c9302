//! The keyframes of a track, and fitting their poses anew to an improved shape.

use super::Track;
use crate::cell::ArmState;
use crate::reconstruct::ReconstructOptions;
use crate::reconstruct::keyframe::Keyframe;
use crate::reconstruct::landmark;
use crate::reconstruct::matching::{Gates, Look};
use crate::reconstruct::view::FrameView;
use std::sync::Arc;
use topo_ekf::body::BodyFrame;

impl Track {
    /// Stores a frame for the re-fusion.
    pub fn keep_keyframe(&mut self, view: Arc<FrameView>, arms: &[ArmState], at_rest: bool) {
        self.keyframes.keep(Keyframe {
            view,
            pose: self.body.pose().clone(),
            arms: arms.to_vec(),
            grips: self.grips_now(arms),
            sightings: self.landmarks.sighted(),
            at_rest,
            frame: self.frame,
        });
    }

    /// Fits the poses of the keyframes to their clouds again, with the improved shape. A pose that cannot be fitted is kept.
    pub fn refit_keyframes(&mut self, options: &ReconstructOptions) {
        let mut keyframes = std::mem::take(&mut self.keyframes);
        for keyframe in keyframes.all_mut().iter_mut().filter(|k| k.frame > 0) {
            let frame = BodyFrame::new(&keyframe.grips, &self.embeddings);
            let look = Look::new(&self.model, &self.embeddings, &keyframe.view, options);
            let met = landmark::embedded(&keyframe.sightings, self.body.lattice());
            let refitted =
                self.body
                    .refit(&keyframe.pose, &frame, &mut |lattice, pose, progress| {
                        let gates = Gates::again(progress);
                        let mut rows = look.rows(lattice, pose, gates);
                        rows.extend(landmark::rows(&met, lattice, pose, gates));
                        rows
                    });
            if let Ok(pose) = refitted {
                keyframe.pose = pose;
            }
        }
        self.keyframes = keyframes;
    }
}
