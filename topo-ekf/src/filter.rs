//! The filter: predict, update, project.
//!
//! ```text
//! state      live x̃, rotations R, data information d, and the position y of each vertex by the data alone
//! predict    x⁻, ΔR from the motion of the seen vertices;  y ← x⁻ + ΔR (y − x̃);  d ← d/(1 + q d)
//! update     S = diag(d + r + a) + Σ_e w_e (e_i − e_j)(e_i − e_j)ᵀ,   S x̂ = d y + r z + a x⁻ + shape(R)
//! project    x̃ = argmin (x − x̂)ᵀ (S ⊗ I₃) (x − x̂) over the constraints
//! keep       x̃, R;  d ← d + r,  y ← (d y + r z)/(d + r) + x̃ − x̂
//! ```
//!
//! Data and shape are kept apart: `(d, y)` summarises the measurements, while the shape prior is a fixed prior that enters each frame
//! once. Pulling to the last estimate instead of `y` would count the shape again in every frame.

use nalgebra::{Point3, Rotation3};

use crate::compliance::Influence;
use crate::constrain::Constrained;
use crate::contact::Surface;
use crate::graph::Graph;
use crate::motion::{Moved, predict};
use crate::observability::Observability;
use crate::observation::{Frame, Seen};
use crate::options::{Motion, Options};
use crate::problem::Warm;
use crate::project::Status;
use crate::report::StepReport;
use crate::rotation::clean;
use crate::shape_prior::{Relaxed, ShapePrior, fit_rotations};
use crate::system::{Factor, System};
use crate::{Error, columns};

/// Live positions of the vertices of a surface graph, with their rotations from rest and the information about them.
///
/// # Guarantees
/// After a successful step, no vertex is lower than rounding (1e-12 m for an object of a metre) below the plane
/// that most vertices touch, and with [`Status::Constrained`](crate::Status) every constraint holds within 1e-6 m. A rigid
/// motion of all inputs (rest, live, observations, planes) moves the result by the same motion.
/// After an error the filter is unchanged.
///
/// # Limits
/// The shape prior of a surface graph resists stretching and, by the overlap of neighbouring rotations, bending over about two edges. The bulge of the
/// hidden half of a hollow shell is kept only by this bending resistance; edges through the body stiffen it.
///
/// Covariances are those of the linearised model: they treat the predicted motion and the fitted rotations as known; only [`Filter::marginal_sigmas`] adds the
/// uncertainty of the rotations. [`Filter::innovation_statistic`], [`Filter::error_statistic`] and [`Filter::calibration`] test this on your data.
pub struct Filter {
    pub(crate) options: Options,
    pub(crate) graph: Graph,
    pub(crate) system: System,
    pub(crate) rest: Vec<Point3<f64>>,
    pub(crate) live: Vec<Point3<f64>>,
    /// Estimate before the constraints.
    pub(crate) estimate: Vec<Point3<f64>>,
    /// Position of every vertex by the data of all frames, moved with the predicted motion.
    pub(crate) evidence: Vec<Point3<f64>>,
    pub(crate) rotations: Vec<Rotation3<f64>>,
    /// Data information of every vertex, 1/m²: what was measured, less the decay over time.
    pub(crate) information: Vec<f64>,
    /// Vertices measured in the last step.
    pub(crate) seen: Vec<bool>,
    pub(crate) warm: Warm,
    pub(crate) surface: Surface,
    pub(crate) influence: Influence,
    /// Data for the statistics of the last step.
    pub(crate) last: Option<Prior>,
}

impl std::fmt::Debug for Filter {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Filter")
            .field("options", &self.options)
            .field("vertices", &self.live.len())
            .finish_non_exhaustive()
    }
}

/// The prior of the last update and the observations.
pub(crate) struct Prior {
    pub seen: Seen,
    /// Data information before the update.
    pub information: Vec<f64>,
    /// Predicted positions, the origin of `pull`.
    pub origin: Vec<Point3<f64>>,
    /// Right-hand side of the prior alone, for displacements from the origin.
    pub pull: Vec<f64>,
}

/// The results of the prediction that the update needs.
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
    /// A filter whose live positions are the rest positions.
    ///
    /// # Errors
    /// No vertices, invalid points, edges out of range or from a vertex to itself, options out of range.
    ///
    /// # Complexity
    /// `O(E)`, an elimination order and one symbolic factorisation: about two linear updates.
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
            influence: Influence::default(),
            last: None,
        })
    }

    /// Live positions.
    pub fn live(&self) -> &[Point3<f64>] {
        &self.live
    }

    /// Estimate of the last step before the constraints; equal to [`Filter::live`] where nothing was violated. The covariances belong to it.
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

    /// Remaining data information of every vertex, 1/m².
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
    /// Wrong length, or a stiffness outside `[0, 1e6]`. An edge of stiffness 0 has no effect on the shape.
    ///
    /// ```
    /// use topo_ekf::{Filter, Frame, Motion, Observation, Options, nalgebra::{Point3, Vector3}};
    /// let rest: Vec<_> = (0..3).map(|k| Point3::new(0.005 * f64::from(k), 0.0, 0.0)).collect();
    /// let options = Options::default().with_motion(Motion::Still);
    /// let mut filter = Filter::new(&rest, &[[0, 1], [1, 2]], &options)?;
    /// // The second edge is cut; then the first vertex is seen 10 mm higher.
    /// filter.set_stiffness(&[1.0, 0.0])?;
    /// let seen = [Observation { vertex: 0, position: rest[0] + Vector3::z() * 0.01, sigma: 5e-4 }];
    /// filter.step(&Frame::new(&seen))?;
    /// assert!(filter.live()[1].z > 0.009);
    /// assert!(filter.live()[2].z.abs() < 1e-9);
    /// # Ok::<(), topo_ekf::Error>(())
    /// ```
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

    /// Standard deviation of each coordinate of every vertex, m: from the data of all frames, the shape prior and the
    /// anchor together, plus the uncertainty of the rotations of hidden parts. Constraints do not reduce it (a resting vertex is known better along the
    /// normal than this).
    ///
    /// # Errors
    /// As [`Filter::step`], after stiffness or options that leave the information matrix unusable.
    ///
    /// # Complexity
    /// One factorisation and one selected inverse, together about two linear updates; with [`Motion::Spread`] two factorisations and 96 more solves.
    pub fn marginal_sigmas(&self) -> Result<Vec<f64>, Error> {
        let weights = self.weights();
        let values = self.values(&self.information, &weights);
        let turned = self.turn_variances(&values, &weights)?;
        let given = self.system.variances(&values)?;
        Ok(given
            .iter()
            .zip(turned)
            .map(|(a, b)| (a + b).sqrt())
            .collect())
    }

    pub(crate) fn variances(&self) -> Result<Vec<f64>, Error> {
        let values = self.values(&self.information, &self.weights());
        self.system.variances(&values)
    }

    /// What the last step determined, by connectivity; for the accuracy see [`Filter::marginal_sigmas`].
    pub fn observability(&self) -> Observability {
        Observability::new(&self.seen, &self.graph.component, self.graph.components)
    }

    /// Processes one frame: predict, update, project.
    ///
    /// # Errors
    /// Invalid observations, planes, triangles or inequalities; information too far apart to be factorised. The filter is then
    /// unchanged.
    ///
    /// # Complexity
    /// Three numeric factorisations (one for [`Motion::Still`]) and `rotation_iterations + 2` solves; contact with a plane costs one or two
    /// more factorisations, self-contacts as many more and a dense problem among the vertices in contact.
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
        let report = match report.status {
            Status::Free if frame.observations.is_empty() => StepReport {
                status: Status::Unobserved,
                ..report
            },
            _ => report,
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
                // The displacement by the constraints is fed back, or a motion that they stop would carry the evidence on through the table.
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
        self.system.recycle(update.factor);
    }

    /// Predicts the state at this frame.
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

    /// Adds the observations.
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
        let prior = ShapePrior {
            graph: &self.graph,
            weights: &weights,
            predicted: &prediction.rotations,
            origin: &prediction.positions,
            data: &data,
        };
        let relaxed = prior.relax(&mut self.system, &factor, &self.options)?;
        Ok(Update {
            values,
            factor,
            relaxed,
            weights,
            information,
        })
    }

    /// `d/(1 + q d)`: the information about a vertex after a random walk with variance `q`.
    fn decayed(&self, frames: f64) -> Vec<f64> {
        let q = self.options.process_noise.powi(2) * frames;
        self.information.iter().map(|d| d / (1.0 + q * d)).collect()
    }

    pub(crate) fn weights(&self) -> Vec<f64> {
        let unit = self.options.edge_sigma.powi(-2);
        self.graph.stiffness.iter().map(|s| s * unit).collect()
    }

    /// Lower triangle of the information matrix.
    pub(crate) fn values(&self, information: &[f64], weights: &[f64]) -> Vec<f64> {
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
