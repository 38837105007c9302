//! One pair of frames: the terms that every iteration adds to the equations.

use nalgebra::{Matrix3, Vector3};

use crate::align::Alignment;
use crate::cloud::Cloud;
use crate::each::each;
use crate::error::Error;
use crate::model::{Model, Shape, blend};
use crate::options::Options;
use crate::registration::{Feature, Landmark};
use crate::system::{Solver, System};
use crate::target::Target;
use crate::traits::{Correspondence, Pair, Probe, Rejection, Residual};

/// Weight that ties undetermined nodes (a part without matches and without matched neighbours) to the start.
const ANCHOR: f64 = 1e-7;

/// Iterations in which the rotations of a landmark field converge.
const LANDMARK_ITERATIONS: usize = 6;
/// Iterations in which local rotations are found from given displacements: each leaves a small part of the angle.
const ROTATION_ITERATIONS: usize = 6;

/// The displacement field of an iteration.
#[derive(Clone)]
pub(crate) struct State {
    /// Displacement of each node.
    pub u: Vec<Vector3<f64>>,
    /// Local rotation at each node.
    pub rotations: Vec<Matrix3<f64>>,
}

/// A pair and its weight.
pub(crate) type Match = (Pair, f64);

/// The checked input of the caller, and the model made of it.
pub(crate) struct Frame<'a> {
    pub source: &'a Cloud<'a>,
    pub landmarks: &'a [Landmark],
    pub features: &'a [Feature],
    /// Whether a prediction ties every point.
    pub predicted: bool,
    pub options: &'a Options,
    pub model: &'a Model,
}

impl Frame<'_> {
    /// The next state. Local rotations are updated from the previous ones, so that they may grow beyond half a turn.
    pub fn advance(&self, before: &State, u: Vec<Vector3<f64>>) -> State {
        let rotations = self.model.prior.rotations(&u, &before.rotations);
        State { u, rotations }
    }

    /// A state from displacements alone.
    pub fn state(&self, u: Vec<Vector3<f64>>) -> State {
        let mut state = self.rest();
        state.u = u;
        for _ in 0..ROTATION_ITERATIONS {
            state.rotations = self.model.prior.rotations(&state.u, &state.rotations);
        }
        state
    }

    pub fn rigid(&self, pose: &Alignment) -> State {
        let turn = pose
            .target_from_source
            .rotation
            .to_rotation_matrix()
            .into_inner();
        State {
            u: pose.displacements(&self.model.nodes.positions),
            rotations: vec![turn; self.model.nodes.len()],
        }
    }

    pub fn rest(&self) -> State {
        let count = self.model.nodes.len();
        State {
            u: vec![Vector3::zeros(); count],
            rotations: vec![Matrix3::identity(); count],
        }
    }

    /// Node displacements from predicted point displacements: the mean over the points that a node influences.
    pub fn smoothed(&self, predicted: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        let mut sums = vec![(Vector3::zeros(), 0.0); self.model.nodes.len()];
        for (shape, u) in self.model.shapes.iter().zip(predicted) {
            for &(k, phi) in shape {
                let w = phi.max(0.0).powi(2);
                sums[k].0 += w * u;
                sums[k].1 += w;
            }
        }
        let mut start: Vec<Vector3<f64>> = sums
            .iter()
            .map(|(sum, w)| if *w > 0.0 { sum / *w } else { Vector3::zeros() })
            .collect();
        for (landmark, &node) in self.landmarks.iter().zip(&self.model.nodes.of_landmark) {
            start[node] = landmark.motion();
        }
        start
    }

    /// Membrane, landmarks and anchor, which are the same in all iterations.
    pub fn assemble_fixed(&self, start: &[Vector3<f64>], system: &mut System) {
        let structure = &self.model.structure;
        system.reset(structure);
        self.model
            .prior
            .add_membrane(&self.model.nodes, structure, system);
        let points = self.source.points.len() as f64;
        for (landmark, &node) in self.landmarks.iter().zip(&self.model.nodes.of_landmark) {
            let relative = self.options.point_sigma / landmark.sigma;
            // Exact landmarks have an infinite relative weight.
            let w = (relative * relative).min(self.options.landmark_weight) / points;
            system.add_scalar(structure, node, node, w);
            system.add_right(node, &(w * (landmark.motion())));
        }
        let anchor = ANCHOR / self.model.nodes.len() as f64;
        for (k, u) in start.iter().enumerate() {
            system.add_scalar(structure, k, k, anchor);
            system.add_right(k, &(anchor * u));
        }
    }

    /// The smoothest field through the landmarks; `fixed` as assembled at rest.
    pub fn landmark_field(
        &self,
        fixed: &System,
        system: &mut System,
        solver: &mut Solver,
    ) -> Result<State, Error> {
        let mut state = self.rest();
        // Strain is measured in the local rotations, which are updated as the field turns.
        for iteration in 0..LANDMARK_ITERATIONS {
            system.copy_from(fixed);
            let structure = &self.model.structure;
            self.model
                .prior
                .add_forms(&state.rotations, structure, system);
            let u = solver.solve(structure, system);
            state = self.advance(&state, u.ok_or(Error::Singular { iteration })?);
        }
        Ok(state)
    }

    /// Ties every source point to its predicted displacement with `weight` times the weight of a cloud point.
    pub fn add_prediction(&self, predicted: &[Vector3<f64>], weight: f64, system: &mut System) {
        let metric = Matrix3::from_diagonal_element(weight / self.source.points.len() as f64);
        for (shape, wanted) in self.model.shapes.iter().zip(predicted) {
            self.add_observation(shape, &metric, wanted, system);
        }
    }

    /// The current position of every source point, its match there, and the weight of the match.
    pub fn find_matches(
        &self,
        state: &State,
        iteration: usize,
        (correspondence, rejection): (&impl Correspondence, &impl Rejection),
        target: &mut Target,
    ) -> Vec<Option<Match>> {
        let reach = rejection.reach(iteration);
        let (open, count) = (&*target, target.points().len());
        let hits = each(self.source.points.len(), |i| {
            let probe = self.probe(i, state);
            let hit = correspondence.find(&probe, open, reach);
            // An index out of range, which a caller's implementation may return, is no match.
            hit.filter(|&q| q < count).map(|q| (probe, q))
        });
        target.prepare(hits.iter().map(|hit| hit.map(|(_, q)| q)));
        let weigh = |(probe, q): (Probe, usize)| {
            let place = target.place(q)?;
            let pair = Pair {
                probe,
                target: q,
                point: place.point,
                normal: target.normals()[q].into_inner(),
                on_boundary: place.on_boundary,
            };
            let weight = rejection.weight(&pair, iteration);
            (weight > 0.0).then(|| (pair, weight.min(1.0)))
        };
        hits.into_iter().map(|hit| hit.and_then(weigh)).collect()
    }

    fn probe(&self, i: usize, state: &State) -> Probe {
        let shape = &self.model.shapes[i];
        let (mut turn, mut moved) = (Matrix3::zeros(), Vector3::zeros());
        for &(k, phi) in shape {
            turn += state.rotations[k] * phi;
            moved += state.u[k] * phi;
        }
        let n = self.source.normals[i];
        Probe {
            index: i,
            position: self.model.clean[i] + moved,
            normal: (turn * n.as_ref()).try_normalize(1e-12).unwrap_or(*n),
        }
    }

    /// `Σ (w/n) |r + J (Φu − Φu₀)|²`. Returns the weighted mean square of `r`.
    pub fn add_matches(
        &self,
        matches: &[Option<Match>],
        residual: &impl Residual,
        system: &mut System,
    ) -> f64 {
        let points = self.source.points.len() as f64;
        let (mut squares, mut weights) = (0.0, f64::MIN_POSITIVE);
        for (pair, weight) in matches.iter().flatten() {
            let r = residual.linearise(pair);
            let shape = &self.model.shapes[pair.probe.index];
            let jt = r.jacobian.transpose() * (weight / points);
            let metric = jt * r.jacobian;
            let here = pair.probe.position - self.model.clean[pair.probe.index];
            let force = metric * here - jt * r.residual;
            self.add_quadratic(shape, &metric, &force, system);
            squares += weight * r.residual.norm_squared();
            weights += weight;
        }
        squares / weights
    }

    /// Adds features, weighted by how well they agree with the motion of the nodes around them. Returns these weights.
    pub fn add_features(&self, u: &[Vector3<f64>], system: &mut System) -> Vec<f64> {
        let confidence = self.feature_confidence(u);
        let relative = self.options.point_sigma / self.options.feature_sigma;
        let full = relative * relative / self.source.points.len() as f64;
        let shapes = self.model.feature_shapes.iter();
        for ((shape, feature), c) in shapes.zip(self.features).zip(&confidence) {
            let metric = Matrix3::from_diagonal_element(full * c);
            self.add_observation(shape, &metric, &(feature.target - feature.source), system);
        }
        confidence
    }

    /// `(1 − |d − Φu|²/c²)²₊`, with a cut-off `c` of 2.5 medians, but not below the noise of the features.
    pub fn feature_confidence(&self, u: &[Vector3<f64>]) -> Vec<f64> {
        let shapes = self.model.feature_shapes.iter();
        let misfit: Vec<f64> = shapes
            .zip(self.features)
            .map(|(shape, f)| (blend(shape, u) - (f.target - f.source)).norm())
            .collect();
        let cutoff = (2.5 * median(&misfit)).max(2.7 * self.options.feature_sigma);
        let weight = |m: &f64| (1.0 - (m / cutoff).powi(2)).max(0.0).powi(2);
        misfit.iter().map(weight).collect()
    }

    /// Adds `(Φu − wanted)ᵀ metric (Φu − wanted)`.
    fn add_observation(
        &self,
        shape: &Shape,
        metric: &Matrix3<f64>,
        wanted: &Vector3<f64>,
        system: &mut System,
    ) {
        self.add_quadratic(shape, metric, &(metric * wanted), system);
    }

    /// Adds `(Φu)ᵀ metric Φu − 2 forceᵀ Φu`; shapes list later nodes first.
    fn add_quadratic(
        &self,
        shape: &Shape,
        metric: &Matrix3<f64>,
        force: &Vector3<f64>,
        system: &mut System,
    ) {
        for (a, &(k, phi_k)) in shape.iter().enumerate() {
            system.add_right(k, &(phi_k * force));
            for &(l, phi_l) in &shape[a..] {
                system.add_scaled(&self.model.structure, (k, l), phi_k * phi_l, metric);
            }
        }
    }
}

fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(0.0)
}
