//! The filter: predict, update, project.
//!
//! ```text
//! state      live x̃, rotations R, data information d with the place y where the data put each vertex
//! predict    x⁻, ΔR from the motion of what is seen;  y ← x⁻ + ΔR (y − x̃);  d ← d/(1 + q d)
//! update     S = diag(d + r + a) + Σ_e w_e (e_i − e_j)(e_i − e_j)ᵀ,   S x̂ = d y + r z + a x⁻ + shape(R)
//! project    x̃ = argmin (x − x̂)ᵀ (S ⊗ I₃) (x − x̂) over the constraints
//! keep       x̃, R;  d ← d + r,  y ← (d y + r z)/(d + r) + x̃ − x̂
//! ```
//!
//! Data and shape are kept apart: `(d, y)` is what was measured, the shape memory is a standing prior that enters each
//! frame once. Pulling to the last estimate instead of `y` would count the shape again in every frame.

use nalgebra::{Point3, Rotation3};

use crate::consistency::Consistency;
use crate::constrain::Constrained;
use crate::contact::Surface;
use crate::graph::{Graph, check_points};
use crate::memory::{Memory, Relaxed, fit_rotations};
use crate::motion::{Moved, predict};
use crate::observability::Observability;
use crate::observation::{Frame, Observation, Seen};
use crate::options::{Motion, Options};
use crate::project::Warm;
use crate::report::StepReport;
use crate::rotation::clean;
use crate::system::{Factor, System};
use crate::{Error, columns};

/// Live positions of the vertices of a surface graph, with their rotations from rest and the information about them.
///
/// # Guarantees
/// After a step that returned `Ok`, no vertex is lower than rounding (1e-12 m for an object of a metre) below the plane
/// most vertices touch, and with [`Status::Constrained`](crate::Status) every constraint holds within 1e-6 m. A rigid
/// motion of everything given (rest, live, observations, planes) moves the answer by the same motion.
/// After an error the filter is what it was before the call.
///
/// # Limits
/// Shape memory of a surface graph resists stretch and, by the overlap of neighbouring rotations, bending over about two edges. A
/// hollow shell that is unseen on one half keeps that half's bulge only as well as that; edges through the body stiffen it.
///
/// Covariances are those of the linearised model: they take the predicted motion and the fitted rotations for given. See
/// [`Filter::innovation_statistic`] and [`Filter::error_statistic`] for how honest that is on your data.
pub struct Filter {
    pub(crate) options: Options,
    pub(crate) graph: Graph,
    pub(crate) system: System,
    pub(crate) rest: Vec<Point3<f64>>,
    pub(crate) live: Vec<Point3<f64>>,
    /// Estimate before the constraints.
    pub(crate) estimate: Vec<Point3<f64>>,
    /// Where the data of all frames put every vertex, carried along by the motion.
    pub(crate) evidence: Vec<Point3<f64>>,
    pub(crate) rotations: Vec<Rotation3<f64>>,
    /// Data information of every vertex, 1/m²: what was measured, less what time has taken.
    pub(crate) information: Vec<f64>,
    /// Vertices measured in the last step.
    pub(crate) seen: Vec<bool>,
    pub(crate) warm: Warm,
    pub(crate) surface: Surface,
    /// What the statistics of the last step need.
    pub(crate) last: Option<Prior>,
}

/// The prior of the last update and what was weighed in against it.
pub(crate) struct Prior {
    seen: Seen,
    /// Data information before the update.
    information: Vec<f64>,
    /// Predicted places, the origin of `pull`.
    origin: Vec<Point3<f64>>,
    /// Right-hand side of the prior alone, for displacements from the origin.
    pull: Vec<f64>,
}

/// Everything the prediction hands to the update.
struct Prediction {
    seen: Seen,
    positions: Vec<Point3<f64>>,
    rotations: Vec<Rotation3<f64>>,
    information: Vec<f64>,
    evidence: Vec<Point3<f64>>,
}

/// The unconstrained posterior.
pub(crate) struct Update {
    /// Lower triangle of the information matrix.
    pub values: Vec<f64>,
    pub factor: Factor,
    pub relaxed: Relaxed,
    weights: Vec<f64>,
    information: Vec<f64>,
}

impl Filter {
    /// Filter whose live positions are the rest positions.
    ///
    /// # Errors
    /// No vertices, unusable points, edges out of range or from a vertex to itself, options out of range.
    ///
    /// # Complexity
    /// `O(E)` and one symbolic factorisation, about 1.5 ms at 2,000 vertices.
    pub fn new(rest: &[Point3<f64>], edges: &[[u32; 2]], options: &Options) -> Result<Self, Error> {
        options.check()?;
        let graph = Graph::new(rest, edges)?;
        let system = System::new(rest, edges)?;
        Ok(Self {
            options: *options,
            graph,
            system,
            rest: rest.to_vec(),
            live: rest.to_vec(),
            estimate: rest.to_vec(),
            evidence: rest.to_vec(),
            rotations: vec![Rotation3::identity(); rest.len()],
            information: vec![options.initial_sigma.powi(-2); rest.len()],
            seen: vec![false; rest.len()],
            warm: Warm::default(),
            surface: Surface::default(),
            last: None,
        })
    }

    /// Live positions.
    pub fn live(&self) -> &[Point3<f64>] {
        &self.live
    }

    /// Estimate of the last step before the constraints; equal to [`Filter::live`] where nothing was violated. The covariance is its.
    pub fn unconstrained(&self) -> &[Point3<f64>] {
        &self.estimate
    }

    /// Rest positions.
    pub fn rest(&self) -> &[Point3<f64>] {
        &self.rest
    }

    /// Local rotation from rest to live at every vertex.
    pub fn rotations(&self) -> &[Rotation3<f64>] {
        &self.rotations
    }

    /// Edges of the graph.
    pub fn edges(&self) -> &[[u32; 2]] {
        &self.graph.edges
    }

    /// What is left of what was measured of every vertex, 1/m².
    pub fn information(&self) -> &[f64] {
        &self.information
    }

    /// Settings.
    pub fn options(&self) -> &Options {
        &self.options
    }

    /// Stiffness of every edge relative to `1/edge_sigma²`, in the order of the edges. A new graph starts with 1.
    ///
    /// # Errors
    /// Wrong length, or a stiffness outside `[0, 1e6]`. An edge of stiffness 0 carries no shape.
    pub fn set_stiffness(&mut self, stiffness: &[f64]) -> Result<(), Error> {
        let expected = self.graph.edges.len();
        if stiffness.len() != expected {
            return Err(Error::Length {
                what: "stiffness",
                found: stiffness.len(),
                expected,
            });
        }
        if let Some(index) = stiffness.iter().position(|s| !(0.0..=1e6).contains(s)) {
            let must = "between 0 and 1e6";
            return Err(Error::Value {
                what: "stiffness of edge",
                index,
                value: stiffness[index],
                must,
            });
        }
        self.graph.stiffness.copy_from_slice(stiffness);
        self.last = None;
        Ok(())
    }

    /// Standard deviation of each coordinate of every vertex, m: the data of all frames, the shape memory and the
    /// anchor together. A constraint does not lower it (a resting vertex is known better along the normal than this says).
    ///
    /// # Errors
    /// As [`Filter::step`], after stiffness or options that leave the information matrix unusable.
    ///
    /// # Complexity
    /// One factorisation and one selected inverse, together about two linear updates.
    pub fn marginal_sigmas(&self) -> Result<Vec<f64>, Error> {
        Ok(self.variances()?.into_iter().map(f64::sqrt).collect())
    }

    fn variances(&self) -> Result<Vec<f64>, Error> {
        let values = self.values(&self.information, &self.weights());
        self.system.variances(&values)
    }

    /// What the last step determined, by connection; [`Filter::marginal_sigmas`] says how well.
    pub fn observability(&self) -> Observability {
        Observability::new(&self.seen, &self.graph.component, self.graph.components)
    }

    /// Normalised innovation squared of the last step: what was seen against what data, shape and motion foretold, one innovation
    /// per seen vertex. `None` before the first step and after a change of graph or stiffness.
    ///
    /// Exact for [`Motion::Still`]. With [`Motion::Spread`] the motion was estimated from the same observations, so the statistic
    /// reads low; how low, the README says.
    ///
    /// # Errors
    /// As [`Filter::step`].
    ///
    /// # Complexity
    /// One factorisation and one solve.
    pub fn innovation_statistic(&mut self) -> Result<Option<Consistency>, Error> {
        let Some(last) = &self.last else {
            return Ok(None);
        };
        let values = self.values(&last.information, &self.weights());
        let factor = self.system.factorise(&values)?;
        let mut expected = last.pull.clone();
        self.system.solve(&factor, &mut expected);
        let expected = columns::read(&expected);
        let (mut squared, mut count) = (0.0, 0);
        for i in 0..self.live.len() {
            let r = last.seen.information[i];
            if r > 0.0 {
                let innovation = last.seen.position[i] - (last.origin[i] + expected[i]);
                let residual = last.seen.position[i] - self.estimate[i];
                squared += r * innovation.dot(&residual);
                count += 1;
            }
        }
        Ok(Some(Consistency::new(squared, 3 * count)))
    }

    /// Normalised estimation error squared of the live positions, where the truth is known: in simulations.
    ///
    /// # Errors
    /// A truth of another length or with unusable points.
    pub fn error_statistic(&self, truth: &[Point3<f64>]) -> Result<Consistency, Error> {
        let (found, expected) = (truth.len(), self.live.len());
        if found != expected {
            return Err(Error::Length {
                what: "truth",
                found,
                expected,
            });
        }
        check_points("truth", truth)?;
        let values = self.values(&self.information, &self.weights());
        let along = |axis: usize| {
            let error: Vec<f64> = self
                .live
                .iter()
                .zip(truth)
                .map(|(x, t)| x[axis] - t[axis])
                .collect();
            let pulled = self.system.pattern.multiply(&values, &error);
            error.iter().zip(&pulled).map(|(e, p)| e * p).sum::<f64>()
        };
        Ok(Consistency::new((0..3).map(along).sum(), 3 * expected))
    }

    /// What the last step left of each of its observations, in the standard deviations that an honest residual has:
    /// `‖z − x̂‖ / √(3 (σ² − P))`, `P` the marginal variance. About 1 is ordinary, 3 and more is an outlier.
    ///
    /// # Errors
    /// Unusable observations; otherwise as [`Filter::marginal_sigmas`], whose cost it has.
    pub fn normalised_residuals(&self, observations: &[Observation]) -> Result<Vec<f64>, Error> {
        Frame::new(observations).check(self.live.len())?;
        let variances = self.variances()?;
        let of = |o: &Observation| {
            let i = o.vertex as usize;
            // A vertex that nothing but this observation holds leaves no residual, and no variance of one: 0, not 0/0.
            let left = (o.sigma * o.sigma - variances[i]).max(1e-12 * o.sigma * o.sigma);
            (o.position - self.estimate[i]).norm() / (3.0 * left).sqrt()
        };
        Ok(observations.iter().map(of).collect())
    }

    /// One frame: predict, update, project.
    ///
    /// # Errors
    /// Unusable observations, planes, triangles or inequalities; information too far apart to be factorised. The filter is left as
    /// it was.
    ///
    /// # Complexity
    /// Three numeric factorisations (one for [`Motion::Still`]) and `rotation_iterations + 2` solves; a touched table costs one or two
    /// factorisations more, contacts some hundred columns of the inverse.
    pub fn step(&mut self, frame: &Frame) -> Result<StepReport, Error> {
        frame.check(self.live.len())?;
        let prediction = self.predict(frame)?;
        let update = self.update(&prediction)?;
        let constrained = self.constrain(frame, &update)?;
        let rotations = match self.options.motion {
            Motion::Still => prediction.rotations.clone(),
            Motion::Spread => fit_rotations(
                &self.graph,
                &update.weights,
                &constrained.positions,
                &prediction.rotations,
                &update.relaxed.rotations,
                self.options.rotation_memory,
            )
            .iter()
            .map(clean)
            .collect(),
        };
        let report = StepReport {
            iterations: update.relaxed.iterations,
            last_move: update.relaxed.last_move,
            ..constrained.report.clone()
        };
        // From here on nothing can fail.
        self.rotations = rotations;
        self.accept(prediction, update, constrained);
        Ok(report)
    }

    fn accept(&mut self, prediction: Prediction, update: Update, constrained: Constrained) {
        let seen = &prediction.seen;
        self.seen = seen.information.iter().map(|&r| r > 0.0).collect();
        self.evidence = (0..self.live.len())
            .map(|i| {
                let (y, z) = (prediction.evidence[i], seen.position[i]);
                // What the constraints did is fed back, or a motion that they stop would carry the evidence on through the table.
                let pushed = constrained.positions[i] - update.relaxed.positions[i];
                y + (z - y) * (seen.information[i] / update.information[i]) + pushed
            })
            .collect();
        self.live = constrained.positions;
        self.information = update.information;
        self.warm = constrained.warm;
        self.surface = constrained.surface;
        self.last = Some(Prior {
            pull: prior_pull(update.relaxed.pull, &prediction),
            seen: prediction.seen,
            information: prediction.information,
            origin: prediction.positions,
        });
        self.estimate = update.relaxed.positions;
    }

    /// Carries everything to this frame.
    fn predict(&mut self, frame: &Frame) -> Result<Prediction, Error> {
        let seen = Seen::gather(frame.observations, &self.live);
        let moved = match self.options.motion {
            Motion::Still => Moved::still(&self.live),
            Motion::Spread => predict(
                &self.graph,
                &mut self.system,
                &self.live,
                &seen,
                &self.options,
            )?,
        };
        let turned = |(turn, r): (&Rotation3<f64>, &Rotation3<f64>)| turn * r;
        let carried =
            |i: usize| moved.positions[i] + moved.turns[i] * (self.evidence[i] - self.live[i]);
        Ok(Prediction {
            rotations: moved
                .turns
                .iter()
                .zip(&self.rotations)
                .map(turned)
                .collect(),
            evidence: (0..self.live.len()).map(carried).collect(),
            information: self.decayed(frame.dt_frames),
            positions: moved.positions,
            seen,
        })
    }

    /// Weighs the observations in.
    fn update(&mut self, prediction: &Prediction) -> Result<Update, Error> {
        let seen = &prediction.seen;
        let information: Vec<f64> = prediction
            .information
            .iter()
            .zip(&seen.information)
            .map(|(d, r)| d + r)
            .collect();
        let weights = self.weights();
        let values = self.values(&information, &weights);
        let factor = self.system.factorise(&values)?;
        let mut data = vec![0.0; 3 * self.live.len()];
        for i in 0..self.live.len() {
            let origin = prediction.positions[i];
            let pull = (seen.position[i] - origin) * seen.information[i]
                + (prediction.evidence[i] - origin) * prediction.information[i];
            columns::add(&mut data, i, &pull);
        }
        let memory = Memory {
            graph: &self.graph,
            weights: &weights,
            predicted: &prediction.rotations,
            origin: &prediction.positions,
            data: &data,
        };
        let relaxed = memory.relax(&mut self.system, &factor, &self.options)?;
        Ok(Update {
            values,
            factor,
            relaxed,
            weights,
            information,
        })
    }

    /// `d/(1 + q d)`: the information of a vertex that walked at random with variance `q`.
    fn decayed(&self, frames: f64) -> Vec<f64> {
        let q = self.options.process_noise.powi(2) * frames;
        self.information.iter().map(|d| d / (1.0 + q * d)).collect()
    }

    fn weights(&self) -> Vec<f64> {
        let unit = self.options.edge_sigma.powi(-2);
        self.graph.stiffness.iter().map(|s| s * unit).collect()
    }

    /// Lower triangle of the information matrix.
    fn values(&self, information: &[f64], weights: &[f64]) -> Vec<f64> {
        let anchor = self.options.anchor_sigma.powi(-2);
        let diagonal: Vec<f64> = information.iter().map(|d| d + anchor).collect();
        self.system
            .pattern
            .assemble(&diagonal, &self.graph.edges, |e| weights[e])
    }
}

/// The right-hand side of the update without this frame's observations.
fn prior_pull(mut pull: Vec<f64>, prediction: &Prediction) -> Vec<f64> {
    let seen = &prediction.seen;
    for (i, origin) in prediction.positions.iter().enumerate() {
        let measured = (seen.position[i] - origin) * seen.information[i];
        columns::add(&mut pull, i, &-measured);
    }
    pull
}
