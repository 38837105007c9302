//! Keyframes: clouds with the body's poses, from which the rest shape is fused anew whenever the object rests.

use super::landmark::Sighting;
use super::view::FrameView;
use crate::cell::ArmState;
use nalgebra::Point3;
use std::sync::Arc;
use topo_ekf::body::{Embedding, Lattice, Pose};

/// Most keyframes.
const MOST: usize = 26;

/// A keyframe.
#[derive(Clone, serde::Serialize, serde::Deserialize)]
pub(crate) struct Keyframe {
    pub view: Arc<FrameView>,
    pub pose: Pose,
    pub arms: Vec<ArmState>,
    /// The held points, and their positions.
    pub grips: Vec<(Embedding, Point3<f64>)>,
    /// Landmarks recognised in the frame.
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
    /// Adds the motion of the body to that since the last keyframe, and returns the sum, metres.
    pub fn travel(&mut self, moved: f64) -> f64 {
        self.travelled += moved;
        self.travelled
    }

    /// Stores a keyframe. If there are too many, the moving one closest in time to its neighbours is dropped.
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

    /// All of them, mutable.
    pub fn all_mut(&mut self) -> &mut [Keyframe] {
        &mut self.kept
    }

    /// Keeps the marked keyframes.
    pub fn retain(&mut self, keep: &[bool]) {
        let mut kept = keep.iter();
        self.kept.retain(|_| kept.next().is_none_or(|keep| *keep));
    }

    /// Extends the poses to a lattice that has grown.
    pub fn extend(&mut self, lattice: &Lattice) {
        for keyframe in &mut self.kept {
            keyframe.pose.extend(lattice);
        }
    }
}
