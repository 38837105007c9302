//! Matches visible vertices with points of the cloud, and weights the matches.
//!
//! ```text
//! match    the nearest point whose normal agrees, within the gate
//! cost     (n · (x − q))² / σ²,        n halfway between the two normals
//! weight   Tukey (1 − r²/c²)²₊, less where the cloud ends or the vertex is new
//! ```
//! Gate and Tukey's constant shrink from the first step of a frame to its last.

use super::ReconstructOptions;
use super::view::FrameView;
use crate::canonical::{CanonicalModel, graph};
use crate::visibility::{Sight, facing};
use nalgebra::{Point3, UnitVector3};
use topo_ekf::body::{Embedding, Lattice, Pose, Progress, Row};

/// Standard deviation of a matched point, metres.
const SIGMA: f64 = 0.001;
/// Least cosine between the normals of a match.
const AGREE: f64 = 0.5;
/// Weight of a match where the seen surface ends.
const RIM: f64 = 0.1;
/// Weight of a vertex seen in fewer than [`YOUNG`] frames.
const YOUNG_WEIGHT: f64 = 0.3;
const YOUNG: u32 = 3;
/// Number of points of the cloud that are tried for a match.
const TRIED: usize = 6;

/// Gates of the matches in a step, metres.
#[derive(Clone, Copy)]
pub(crate) struct Gates {
    pub gate: f64,
    pub tukey: f64,
}

impl Gates {
    /// From the first step of a frame to its last; wider where the body may have fallen.
    pub fn at(progress: Progress) -> Self {
        let t = progress.share;
        let (gate, tukey) = if progress.released {
            (0.035, 0.025)
        } else {
            (0.020, 0.012)
        };
        Self {
            gate: gate * (1.0 - t) + 0.008 * t,
            tukey: tukey * (1.0 - t) + 0.005 * t,
        }
    }

    /// For a frame that was fitted before.
    pub fn again(progress: Progress) -> Self {
        let t = progress.share;
        Self {
            gate: 0.012 * (1.0 - t) + 0.008 * t,
            tukey: 0.008 * (1.0 - t) + 0.005 * t,
        }
    }

    /// For the evaluation of a finished frame.
    pub const JUDGE: Self = Self {
        gate: 0.008,
        tukey: 0.006,
    };
    /// For the evaluation of a prediction that has not used the frame.
    pub const PREDICTION: Self = Self {
        gate: 0.020,
        tukey: 0.050,
    };
}

/// A vertex and its matched point.
#[derive(Clone, Copy)]
pub(crate) struct Match {
    pub vertex: usize,
    pub point: usize,
    pub normal: UnitVector3<f64>,
    /// Signed distance along the normal, metres.
    pub residual: f64,
    /// Distance perpendicular to the normal, metres.
    pub aside: f64,
    pub weight: f64,
}

/// The live surface at one step.
pub(crate) struct Posed {
    pub points: Vec<Point3<f64>>,
    pub normals: Vec<UnitVector3<f64>>,
}

impl Posed {
    pub fn new(
        model: &CanonicalModel,
        embeddings: &[Embedding],
        lattice: &Lattice,
        pose: &Pose,
    ) -> Self {
        Self {
            points: embeddings
                .iter()
                .map(|at| pose.position(lattice, at))
                .collect(),
            normals: embeddings
                .iter()
                .zip(model.rest_normals())
                .map(|(at, n)| pose.normal(lattice, at, n))
                .collect(),
        }
    }
}

/// The data of a frame against which poses are fitted.
pub(crate) struct Look<'a> {
    model: &'a CanonicalModel,
    embeddings: &'a [Embedding],
    view: &'a FrameView,
    eye: Point3<f64>,
    min_facing: f64,
    spacing: f64,
}

impl<'a> Look<'a> {
    pub fn new(
        model: &'a CanonicalModel,
        embeddings: &'a [Embedding],
        view: &'a FrameView,
        options: &ReconstructOptions,
    ) -> Self {
        Self {
            model,
            embeddings,
            view,
            eye: view.eye(),
            min_facing: options.min_facing,
            spacing: options.spacing,
        }
    }

    /// Matches of all visible vertices of the body in a pose.
    pub fn matches(&self, lattice: &Lattice, pose: &Pose, gates: Gates) -> Vec<Match> {
        let posed = Posed::new(self.model, self.embeddings, lattice, pose);
        let vertices = posed.points.iter().zip(&posed.normals).enumerate();
        vertices
            .filter_map(|(i, (at, normal))| self.meet(i, at, normal, gates))
            .collect()
    }

    /// The match of a vertex, if it is visible.
    fn meet(
        &self,
        vertex: usize,
        at: &Point3<f64>,
        normal: &UnitVector3<f64>,
        gates: Gates,
    ) -> Option<Match> {
        let view = self.view;
        if facing(at, normal, &self.eye) < self.min_facing {
            return None;
        }
        let sight = view.depth.sight(at, f64::INFINITY, 3.0 * self.spacing);
        if matches!(sight, Sight::Occluded | Sight::NoData) {
            return None;
        }
        let near = graph::near(&view.tree, at, gates.gate, TRIED);
        let (point, _) = near
            .into_iter()
            .find(|(k, _)| view.normals[*k].dot(normal) > AGREE)?;
        let across =
            UnitVector3::new_normalize(view.normals[point].into_inner() + normal.into_inner());
        let offset = at - view.points[point];
        let residual = across.dot(&offset);
        let relative = residual / gates.tukey;
        let share = (1.0 - relative * relative).max(0.0);
        let rim = if view.rim[point] { RIM } else { 1.0 };
        let young = if self.model.times_seen()[vertex] < YOUNG {
            YOUNG_WEIGHT
        } else {
            1.0
        };
        let weight = SIGMA.powi(-2) * share * share * rim * young;
        (weight > 0.0).then(|| Match {
            vertex,
            point,
            normal: across,
            residual,
            aside: (offset - across.into_inner() * residual).norm(),
            weight,
        })
    }

    /// The same matches as rows of the fit.
    pub fn rows(&self, lattice: &Lattice, pose: &Pose, gates: Gates) -> Vec<Row> {
        let row = |m: &Match| {
            let (at, meets) = (self.embeddings[m.vertex], self.view.points[m.point]);
            Row::along(at, meets, m.normal, m.weight)
        };
        self.matches(lattice, pose, gates).iter().map(row).collect()
    }
}
