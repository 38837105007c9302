//! The moving model and the clouds, frame by frame: as many frames as fit.

use super::packed::{Bytes, Indices, Points, Values, bits};
use super::thinned::Thinned;
use crate::canonical::CanonicalModel;
use crate::canonical::surface::triangulate;
use crate::cell::{ArmState, Observation};
use crate::reconstruct::FrameReport;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// Most frames that are stored.
const MOST_FRAMES: usize = 240;
/// Most bytes of all frames together; Base64 adds a third.
const MOST_BYTES: usize = 6_000_000;
/// Most points of a cloud.
const MOST_POINTS: usize = 1_200;
/// Largest share of vertices without a triangle (drawn as dots) before the mesh is computed again.
const MOST_DOTS: f64 = 0.03;

/// A frame as the page shows it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct LiveFrame {
    time: f64,
    frame: u32,
    phase: String,
    manipulation: usize,
    /// The live vertices.
    vertices: Points,
    /// Index of its mesh.
    mesh: usize,
    /// Frame in which each vertex was added.
    born: Values,
    /// Whether each vertex was measured in this frame.
    measured: Bytes,
    /// Distance of each vertex from its true position, mm; empty where unknown.
    error: Values,
    /// The cloud.
    cloud: Points,
    arms: Vec<Arm>,
}

impl LiveFrame {
    fn size(&self) -> usize {
        let values = self.born.len() + self.error.len() + self.measured.0.len();
        self.vertices.len() + self.cloud.len() + values
    }
}

/// The pose of an arm.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Arm {
    /// Position of the tip, m.
    at: [f64; 3],
    /// Direction of approach.
    along: [f64; 3],
    /// Direction in which the jaws open.
    across: [f64; 3],
    jaw: f64,
    holding: bool,
}

impl Arm {
    fn of(arm: &ArmState) -> Self {
        let pose = &arm.camera_from_tip;
        Self {
            at: short(pose.translation.vector.into()),
            along: short((pose.rotation * nalgebra::Vector3::z()).into()),
            across: short((pose.rotation * nalgebra::Vector3::y()).into()),
            jaw: rounded(arm.jaw),
            holding: arm.holding,
        }
    }
}

/// Rounded to a hundredth of a millimetre, which is fine enough for drawing.
pub(super) fn short(vector: [f64; 3]) -> [f64; 3] {
    vector.map(rounded)
}

fn rounded(value: f64) -> f64 {
    (value * 1e5).round() / 1e5
}

/// The time of a frame, and the phase it belongs to.
pub(super) struct Moment<'a> {
    pub time: f64,
    pub phase: &'a str,
    pub manipulation: usize,
}

/// The stored frames. Frames between which the surface only moved share a mesh.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Live {
    frames: Thinned<LiveFrame>,
    meshes: Vec<Indices>,
    /// Vertices of the last mesh, and their number.
    drawn: Vec<u64>,
}

impl Live {
    pub fn new() -> Self {
        Self {
            frames: Thinned::new(MOST_FRAMES),
            meshes: Vec::new(),
            drawn: Vec::new(),
        }
    }

    /// Stores a frame if it is due.
    pub fn push(
        &mut self,
        moment: &Moment<'_>,
        observation: &Observation,
        report: &FrameReport,
        model: &CanonicalModel,
        errors: &[f64],
        spacing: f64,
    ) {
        if !self.frames.takes_next() {
            return;
        }
        self.draw(model, spacing);
        let every = observation.points.len().div_ceil(MOST_POINTS).max(1);
        let born: Vec<f64> = model.born().iter().map(|b| f64::from(*b)).collect();
        let error: Vec<f64> = errors.iter().map(|e| 1e3 * e).collect();
        self.frames.keep(LiveFrame {
            time: rounded(moment.time),
            frame: report.frame,
            phase: moment.phase.to_owned(),
            manipulation: moment.manipulation,
            vertices: Points::of(model.live().iter()),
            mesh: self.meshes.len().saturating_sub(1),
            born: Values::of(&born),
            measured: bits(&report.measured),
            error: Values::of(&error),
            cloud: Points::of(observation.points.iter().step_by(every)),
            arms: observation.arms.iter().map(Arm::of).collect(),
        });
        // The first and last frames are kept, however large the model is.
        while self.size() > MOST_BYTES && self.frames.kept().len() > 2 {
            self.frames.halve();
            self.drop_unused();
        }
        // Halving may have dropped frames.
        if self.meshes.len() > self.frames.kept().len() {
            self.drop_unused();
        }
    }

    /// Computes the mesh again when vertices were removed or many were added.
    fn draw(&mut self, model: &CanonicalModel, spacing: f64) {
        let new = model.len().saturating_sub(self.drawn.len());
        let few = new as f64 <= MOST_DOTS * model.len() as f64;
        if few && !self.meshes.is_empty() && model.ids().starts_with(&self.drawn) {
            return;
        }
        let triangles = triangulate(model.rest(), model.rest_normals(), spacing);
        self.meshes.push(Indices::of(&triangles));
        model.ids().clone_into(&mut self.drawn);
    }

    /// Drops meshes that no frame uses, except the last, and renumbers the others.
    fn drop_unused(&mut self) {
        let Some(last) = self.meshes.len().checked_sub(1) else {
            return;
        };
        let frames = self.frames.kept().iter().map(|f| f.mesh);
        let used: BTreeSet<usize> = frames.chain([last]).collect();
        let meshes = std::mem::take(&mut self.meshes).into_iter().enumerate();
        let kept = meshes.filter(|(k, _)| used.contains(k));
        self.meshes = kept.map(|(_, mesh)| mesh).collect();
        for frame in self.frames.kept_mut() {
            frame.mesh = used.range(..frame.mesh).count();
        }
    }

    fn size(&self) -> usize {
        let frames: usize = self.frames.kept().iter().map(LiveFrame::size).sum();
        frames + self.meshes.iter().map(Indices::len).sum::<usize>()
    }

    /// The data for the page.
    pub fn page(&self) -> serde_json::Value {
        serde_json::json!({
            "every": self.frames.every(),
            "frames": self.frames.kept(),
            "meshes": &self.meshes,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::{Indices, Live, MOST_BYTES, MOST_FRAMES, Moment, triangulate};
    use crate::canonical::{CanonicalModel, NewVertex};
    use crate::cell::Observation;
    use crate::reconstruct::FrameReport;
    use nalgebra::{Point3, UnitVector3, Vector3};

    /// A square sheet of `side`² vertices, with a report that measured all of them.
    fn sheet(side: usize, frame: u32) -> (CanonicalModel, Observation, FrameReport) {
        let mut model = CanonicalModel::default();
        for i in 0..side * side {
            let at = Point3::new((i % side) as f64, (i / side) as f64, 0.0) * 0.005;
            let up = UnitVector3::new_normalize(Vector3::z());
            model.push(NewVertex::new(at, up), 0);
        }
        let observation = Observation {
            stamp: 0.1 * f64::from(frame),
            camera: None,
            points: model.rest().to_vec(),
            colours: None,
            features: None,
            arms: Vec::new(),
        };
        let report = FrameReport {
            frame,
            overlap: 1.0,
            registration_ms: 1.0,
            frame_ms: 2.0,
            ..FrameReport::measured(model.len())
        };
        (model, observation, report)
    }

    /// However long a run is and however large its model, what is kept of it fits, and every frame has its mesh.
    #[test]
    fn long_runs_fit() {
        let moment = Moment {
            time: 0.0,
            phase: "look",
            manipulation: 0,
        };
        let mut live = Live::new();
        for k in 0..10_000 {
            let (model, observation, report) = sheet(2 + (k / 200) as usize, k);
            live.push(&moment, &observation, &report, &model, &[], 0.005);
            assert!(live.size() <= MOST_BYTES);
        }
        let kept = live.frames.kept();
        assert!(
            kept.len() <= MOST_FRAMES && kept.len() > 20,
            "{}",
            kept.len()
        );
        assert!(live.meshes.len() <= kept.len() + 1);
        for (k, frame) in kept.iter().enumerate() {
            assert_eq!(u64::from(frame.frame), k as u64 * live.frames.every());
            let side = 2 + (frame.frame / 200) as usize;
            // A side more is more than the few vertices that may wait for a mesh, so each frame has that of its own sheet.
            let (model, ..) = sheet(side, 0);
            let triangles = triangulate(model.rest(), model.rest_normals(), 0.005);
            assert_eq!(live.meshes[frame.mesh], Indices::of(&triangles));
        }
    }
}
