//! The iteration: match, weight, solve, until nothing moves (paper, Algorithm 1).
//!
//! ```text
//! E(u) = (1/n) Σ_p w_p |r_p + J_p Φ(u − u₀)|²                          matches: see `traits` and `defaults`
//!      + (1/n) Σ_l w_l |u_l − (y_l − x_l)|²                             landmarks, which are nodes
//!      + (1/n) Σ_f w_f |Φ_f u − (y_f − x_f)|²                           features, Tukey weights
//!      + (κ/n) Σ_p |Φu − ũ_p|²                                          prediction, if κ > 0
//!      + prior(u)                                                       see `prior`
//! ```
//!
//! `u₀` is the previous iterate. By default `|r + J δ|² = (n_q·(y + δ − q))² + α |Π_q δ|²`, with `Π_q` the projection on the
//! tangent plane of the match: `α` damps sliding in every iteration.
//! The usual term `α |y + δ − q|²` pulls to the matched point itself. It damps as well, but also pulls the surface by the offset
//! between the two samplings, which on regular clouds does not average out (0.5 mm at rest on clouds with a spacing of 4 mm).

use nalgebra::{Point3, Vector3};

use crate::align::{Alignment, align_rigid};
use crate::cloud::Cloud;
use crate::defaults::{AnnealedTukey, ClosestPoint, PointToPlane, Settled};
use crate::error::Error;
use crate::frame::{Frame, State};
use crate::input::Input;
use crate::model::Model;
use crate::off_rigid::off_rigid;
use crate::options::Options;
use crate::registration::{Feature, Landmark, LandmarkField, Registration, Status};
use crate::system::{Solver, System};
use crate::target::Target;
use crate::traits::{Correspondence, Progress, Rejection, Residual, Termination};

/// Distance from rigid, in sizes of the source, from which on a search from rest that did not converge may have bent the source into a wrong place. True
/// bends of a few millimetres are at 0.01 to 0.02; a turn in place that was taken for a bend is at 0.11 in the median.
const BENT: f64 = 0.04;
/// Difference below which two overlaps count as equal, and ratio of the distances from rigid below which one is much less: of two motions that match as much, the one that bends much less is taken.
const AS_MUCH: f64 = 0.1;
const LESS_BENT: f64 = 0.5;

/// Registers `source` onto `target`: [`Registrar::register`] for a single pair.
///
/// # Errors
/// See [`Registrar::register`].
pub fn register(
    source: &Cloud,
    target: &Cloud,
    landmarks: &[Landmark],
    features: &[Feature],
    options: &Options,
) -> Result<Registration, Error> {
    Registrar::new(options.clone()).register(source, target, landmarks, features, None)
}

/// Registers frame after frame. Keeps its buffers, the search tree while the target stays the same, and nodes, shape
/// functions and symbolic factor while the source stays the same.
///
/// The four parts of the loop can be replaced one by one, see [`Correspondence`], [`Residual`], [`Rejection`] and [`Termination`].
///
/// ```
/// use nonrigid_reg::nalgebra::{Point3, Vector3};
/// use nonrigid_reg::{Cloud, Options, Registrar, estimate_normals};
/// # let before: Vec<_> = (0..1600).map(|k| {
/// #     let (x, y) = (f64::from(k % 40) * 0.0025, f64::from(k / 40) * 0.0025);
/// #     Point3::new(x, y, 0.006 * (60.0 * x).sin() * (50.0 * y).cos())
/// # }).collect();
/// # let normals = estimate_normals(&before, 16, &Point3::new(0.05, 0.05, 0.5))?;
/// // A wavy sheet, which the next frames show 1 and 2 mm higher.
/// let source = Cloud { points: &before, normals: &normals };
/// let mut registrar = Registrar::new(Options::default());
/// for lift in [Vector3::new(0.0, 0.0, 0.001), Vector3::new(0.0, 0.0, 0.002)] {
///     let after: Vec<Point3<f64>> = before.iter().map(|p| p + lift).collect();
///     let target = Cloud { points: &after, normals: &normals };
///     let found = registrar.register(&source, &target, &[], &[], None)?;
///     assert!((found.displacements[820] - lift).norm() < 0.0005); // in the middle
/// }
/// # Ok::<(), nonrigid_reg::Error>(())
/// ```
pub struct Registrar<C = ClosestPoint, R = PointToPlane, J = AnnealedTukey, T = Settled> {
    options: Options,
    correspondence: C,
    residual: R,
    rejection: J,
    termination: T,
    kept: Kept,
}

impl<C, R, J, T> std::fmt::Debug for Registrar<C, R, J, T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Registrar")
            .field("options", &self.options)
            .finish_non_exhaustive()
    }
}

/// Data kept from frame to frame; none of it changes a result.
#[derive(Default)]
struct Kept {
    model: Option<Model>,
    target: Option<Target>,
    fixed: System,
    system: System,
    solver: Solver,
}

impl Default for Registrar {
    fn default() -> Self {
        Self::new(Options::default())
    }
}

impl Registrar {
    /// A registrar with these settings and the default parts.
    pub fn new(options: Options) -> Self {
        Self {
            correspondence: options.closest_point(),
            residual: options.point_to_plane(),
            rejection: options.annealed_tukey(),
            termination: options.settled(),
            options,
            kept: Kept::default(),
        }
    }
}

impl<C, R, J, T> Registrar<C, R, J, T> {
    /// The settings.
    pub fn options(&self) -> &Options {
        &self.options
    }

    /// Replaces the search for matches.
    pub fn with_correspondence<P: Correspondence>(self, part: P) -> Registrar<P, R, J, T> {
        Registrar {
            options: self.options,
            correspondence: part,
            residual: self.residual,
            rejection: self.rejection,
            termination: self.termination,
            kept: self.kept,
        }
    }

    /// Replaces the residual of a pair.
    pub fn with_residual<P: Residual>(self, part: P) -> Registrar<C, P, J, T> {
        Registrar {
            options: self.options,
            correspondence: self.correspondence,
            residual: part,
            rejection: self.rejection,
            termination: self.termination,
            kept: self.kept,
        }
    }

    /// Replaces the weights of pairs.
    pub fn with_rejection<P: Rejection>(self, part: P) -> Registrar<C, R, P, T> {
        Registrar {
            options: self.options,
            correspondence: self.correspondence,
            residual: self.residual,
            rejection: part,
            termination: self.termination,
            kept: self.kept,
        }
    }

    /// Replaces the stopping rule.
    pub fn with_termination<P: Termination>(self, part: P) -> Registrar<C, R, J, P> {
        Registrar {
            options: self.options,
            correspondence: self.correspondence,
            residual: self.residual,
            rejection: self.rejection,
            termination: part,
            kept: self.kept,
        }
    }
}

impl<C: Correspondence, R: Residual, J: Rejection, T: Termination> Registrar<C, R, J, T> {
    /// Finds the motion that carries `source` onto `target`.
    ///
    /// `initial` is a predicted displacement of every source point: the search starts from it instead of from rest,
    /// and is tied to it with the weight [`Options::prediction`]. With neither landmarks, features nor `initial`, and if too few points
    /// are matched from rest or the source is bent without convergence (see [`Options::align_below`]), the search starts from [`align_rigid`].
    ///
    /// # Errors
    /// Clouds of fewer than four points or of mismatched slices, coordinates that are not finite, normals that are not unit vectors, a negative
    /// `sigma`, landmarks that contradict each other, options out of range, a node spacing that
    /// makes too many nodes, or normal equations that are not positive definite. A poor fit is no error but a [`Status`].
    pub fn register(
        &mut self,
        source: &Cloud,
        target: &Cloud,
        landmarks: &[Landmark],
        features: &[Feature],
        initial: Option<&[Vector3<f64>]>,
    ) -> Result<Registration, Error> {
        let input = Input {
            source,
            target,
            landmarks,
            features,
            initial,
        };
        input.check(&self.options)?;
        self.kept.model = Some(self.take_model(&input)?);
        self.kept.target = Some(self.take_target(target));
        let (result, met) = self.follow(&input, None)?;
        let free = landmarks.is_empty() && features.is_empty() && initial.is_none();
        if free && self.is_poor(source, &result, met) {
            return self.realign(&input, result);
        }
        Ok(result)
    }

    /// Whether the search from rest has probably ended beside the true motion: it failed, too few points matched at its beginning or end, or it did not
    /// converge and bends the source.
    fn is_poor(&self, source: &Cloud, result: &Registration, met: f64) -> bool {
        let failed = matches!(
            result.status,
            Status::LowOverlap { .. } | Status::HighResidual { .. }
        );
        let asked = self.options.align_below > 0.0;
        let few = met.min(result.overlap) < self.options.align_below;
        let bent = || off_rigid(source.points, &result.displacements) > BENT;
        failed || few || asked && result.status != Status::Converged && bent()
    }

    /// Only the clouds are given, and they were not brought together from rest: starts again from a rigid alignment.
    fn realign(&mut self, input: &Input, poor: Registration) -> Result<Registration, Error> {
        let bent = |result: &Registration| off_rigid(input.source.points, &result.displacements);
        let found = align_rigid(input.source, input.target)?;
        let (poor_bent, promises) = (bent(&poor), found.overlap > poor.overlap);
        if !promises && poor_bent <= BENT {
            return Ok(poor);
        }
        let (aligned, _) = self.follow(input, Some(&found))?;
        let more = promises && aligned.overlap > poor.overlap;
        let as_much = aligned.overlap > poor.overlap - AS_MUCH;
        let better = more || as_much && bent(&aligned) < LESS_BENT * poor_bent;
        Ok(if better { aligned } else { poor })
    }

    /// The smoothest field through the landmarks, without any target: every node and every source point moves as the prior
    /// implies. Without landmarks there is no motion.
    ///
    /// # Errors
    /// As for [`Registrar::register`].
    ///
    /// # Complexity
    /// Six solves of the normal equations.
    ///
    /// ```
    /// use nonrigid_reg::nalgebra::{Point3, Vector3};
    /// use nonrigid_reg::{Cloud, Landmark, Registrar, estimate_normals};
    /// # let before: Vec<_> = (0..1600).map(|k| {
    /// #     let (x, y) = (f64::from(k % 40) * 0.0025, f64::from(k / 40) * 0.0025);
    /// #     Point3::new(x, y, 0.006 * (60.0 * x).sin() * (50.0 * y).cos())
    /// # }).collect();
    /// # let normals = estimate_normals(&before, 16, &Point3::new(0.05, 0.05, 0.5))?;
    /// // The four corners of a sheet are lifted by 10 mm: so is all of it.
    /// let lift = Vector3::new(0.0, 0.0, 0.01);
    /// let grips = [0, 39, 1560, 1599].map(|k: usize| Landmark { source: before[k], target: before[k] + lift, sigma: 0.0 });
    /// let sheet = Cloud { points: &before, normals: &normals };
    /// let field = Registrar::default().landmark_field(&sheet, &grips)?;
    /// assert!(field.displacements.iter().all(|u| (u - lift).norm() < 1e-4));
    /// # Ok::<(), nonrigid_reg::Error>(())
    /// ```
    pub fn landmark_field(
        &mut self,
        source: &Cloud,
        landmarks: &[Landmark],
    ) -> Result<LandmarkField, Error> {
        let input = Input {
            source,
            target: source,
            landmarks,
            features: &[],
            initial: None,
        };
        input.check(&self.options)?;
        let model = self.take_model(&input)?;
        let frame = Frame {
            source,
            landmarks,
            features: &[],
            predicted: false,
            options: &self.options,
            model: &model,
        };
        let Kept {
            fixed,
            system,
            solver,
            ..
        } = &mut self.kept;
        frame.assemble_fixed(&frame.rest().u, fixed);
        let state = frame.landmark_field(fixed, system, solver)?;
        let field = LandmarkField {
            node_positions: model.nodes.positions.clone(),
            displacements: model.displacements(&state.u),
            node_displacements: state.u,
        };
        self.kept.model = Some(model);
        Ok(field)
    }

    /// The kept model if it belongs to this source, or a new one.
    fn take_model(&mut self, input: &Input) -> Result<Model, Error> {
        let anchors: Vec<Point3<f64>> = input.landmarks.iter().map(|l| l.source).collect();
        let features: Vec<Point3<f64>> = input.features.iter().map(|f| f.source).collect();
        let kept = self.kept.model.take();
        match kept.filter(|model| model.is_of(input.source, &anchors, &self.options)) {
            Some(mut model) => model.set_features(&features).map(|()| model),
            None => Model::new(input.source, &anchors, &features, &self.options),
        }
    }

    fn take_target(&mut self, target: &Cloud) -> Target {
        let kept = self.kept.target.take();
        kept.filter(|kept| kept.is_of(target))
            .unwrap_or_else(|| Target::new(target, &self.options))
    }

    /// Iterates from the start to the report; also gives the share of source points with a match at the start.
    fn follow(
        &mut self,
        input: &Input,
        aligned: Option<&Alignment>,
    ) -> Result<(Registration, f64), Error> {
        let (Some(model), Some(target)) = (self.kept.model.take(), self.kept.target.take()) else {
            return Err(Error::EmptyCloud { cloud: "source" });
        };
        let mut target = target;
        let answer = self.iterate(input, aligned, &model, &mut target);
        self.kept.model = Some(model);
        self.kept.target = Some(target);
        answer
    }

    fn iterate(
        &mut self,
        input: &Input,
        aligned: Option<&Alignment>,
        model: &Model,
        target: &mut Target,
    ) -> Result<(Registration, f64), Error> {
        let options = &self.options;
        let frame = Frame {
            source: input.source,
            landmarks: input.landmarks,
            features: input.features,
            predicted: input.initial.is_some() && options.prediction > 0.0,
            options,
            model,
        };
        let far = 0.5 * self.rejection.reach(0);
        let mut state = start(&frame, input.initial, aligned, far, &mut self.kept)?;
        let Kept {
            fixed,
            system,
            solver,
            ..
        } = &mut self.kept;
        let search = (&self.correspondence, &self.rejection);
        let mut status = Status::MaxIterations;
        let (mut iterations, mut met) = (0, 0.0);
        while iterations < options.iterations {
            let matches = frame.find_matches(&state, iterations, search, target);
            system.copy_from(fixed);
            model
                .prior
                .add_forms(&state.rotations, &model.structure, system);
            let squares = frame.add_matches(&matches, &self.residual, system);
            frame.add_features(&state.u, system);
            let iteration = iterations;
            let next = solver.solve(&model.structure, system);
            let next = next.ok_or(Error::Singular { iteration })?;
            iterations += 1;
            let progress = Progress {
                iteration: iterations,
                step: largest_step(&state.u, &next),
                overlap: matches.iter().flatten().count() as f64 / matches.len() as f64,
                residual: squares.sqrt(),
            };
            if iterations == 1 {
                met = progress.overlap;
            }
            state = frame.advance(&state, next);
            if let Some(verdict) = self.termination.verdict(&progress) {
                status = verdict;
                break;
            }
        }
        let matches = frame.find_matches(&state, usize::MAX, search, target);
        let result = frame.report(state, &matches, &self.residual, iterations, status);
        Ok((result, met))
    }
}

/// Returns the start of the search, and assembles in `kept.fixed` the terms that stay the same.
fn start(
    frame: &Frame,
    initial: Option<&[Vector3<f64>]>,
    aligned: Option<&Alignment>,
    far: f64,
    kept: &mut Kept,
) -> Result<State, Error> {
    let Kept {
        fixed,
        system,
        solver,
        ..
    } = kept;
    let state = match (aligned, initial) {
        (Some(pose), _) => frame.rigid(pose),
        (None, Some(predicted)) => frame.state(frame.smoothed(predicted)),
        (None, None) => frame.rest(),
    };
    frame.assemble_fixed(&state.u, fixed);
    if let Some(predicted) = initial.filter(|_| frame.predicted) {
        frame.add_prediction(predicted, frame.options.prediction, fixed);
    }
    // From rest, closest points mislead where the motion is a large part of the gate; the landmarks are then a better start.
    if initial.is_none() && frame.landmarks.iter().any(|l| l.motion().norm() > far) {
        return frame.landmark_field(fixed, system, solver);
    }
    Ok(state)
}

fn largest_step(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    let step = |(x, y): (&Vector3<f64>, &Vector3<f64>)| (x - y).norm();
    a.iter().zip(b).map(step).fold(0.0, f64::max)
}
