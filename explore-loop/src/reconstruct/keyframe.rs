//! Frames kept for later: the cloud and the body's pose, from which the rest shape is fused anew whenever the object rests.

use super::landmark::Sighting;
use super::view::FrameView;
use crate::cell::ArmState;
use nalgebra::Point3;
use std::sync::Arc;
use topo_ekf::body::{Embedding, Lattice, Pose};

/// Most keyframes kept.
const MOST: usize = 26;

/// A frame that was kept.
#[derive(Clone, serde::Serialize, serde::Deserialize)]
pub(crate) struct Keyframe {
    pub view: Arc<FrameView>,
    pub pose: Pose,
    pub arms: Vec<ArmState>,
    /// Places held, and where they were.
    pub grips: Vec<(Embedding, Point3<f64>)>,
    /// Landmarks recognised in it.
    pub sightings: Vec<Sighting>,
    /// Whether the object rested.
    pub at_rest: bool,
    pub frame: u32,
}

/// The keyframes of a track, oldest first.
#[derive(Clone, Default, serde::Serialize, serde::Deserialize)]
pub(crate) struct Keyframes {
    kept: Vec<Keyframe>,
    travelled: f64,
}

impl Keyframes {
    /// Adds up how far the body moved since the last keyframe, metres.
    pub fn travel(&mut self, moved: f64) -> f64 {
        self.travelled += moved;
        self.travelled
    }

    /// Keeps a frame. When there are too many, the moving one that lies closest between its neighbours in time goes.
    pub fn keep(&mut self, keyframe: Keyframe) {
        self.travelled = 0.0;
        self.kept.push(keyframe);
        if self.kept.len() <= MOST {
            return;
        }
        let gap = |k: usize| self.kept[k + 1].frame - self.kept[k - 1].frame;
        let densest = (1..self.kept.len() - 1)
            .filter(|&k| !self.kept[k].at_rest)
            .min_by_key(|&k| gap(k));
        self.kept.remove(densest.unwrap_or(1));
    }

    /// All of them.
    pub fn all(&self) -> &[Keyframe] {
        &self.kept
    }

    /// All of them, to be changed.
    pub fn all_mut(&mut self) -> &mut [Keyframe] {
        &mut self.kept
    }

    /// Brings the poses up to a lattice that has grown.
    pub fn extend(&mut self, lattice: &Lattice) {
        for keyframe in &mut self.kept {
            keyframe.pose.extend(lattice);
        }
    }
}
