//! The loop: match, weigh, solve, until nothing moves (Algorithm 1).
//!
//! ```text
//! E(u) = (1/n) Σ_p w_p ( (n_q·(p + Φu − q))² + α |Π_q Φ(u − u₀)|² )        matches
//!      + (1/n) Σ_l w_l |u_l − (y_l − x_l)|²                             landmarks, which are nodes
//!      + (1/n) Σ_f w_f |Φ_f u − (y_f − x_f)|²                           features, Tukey weights
//!      + (κ/n) Σ_p |Φu − ũ_p|²                                          prediction, if κ > 0
//!      + prior(u)                                                       see `prior`
//! ```
//!
//! `u₀` is the previous iterate and `Π_q` projects on the tangent plane of the match: `α` drags on sliding, in every iteration
//! anew. The usual term pulls to the matched point itself, `α |p + Φu − q|²`; it drags as well, but also pulls the surface by the offset
//! between the two samplings, which on regular clouds does not average out (0.5 mm at rest on clouds 4 mm apart).

use nalgebra::Vector3;

use crate::cloud::Cloud;
use crate::error::Error;
use crate::frame::Frame;
use crate::matching::Matcher;
use crate::options::Options;
use crate::registration::{Feature, Landmark, Registration, Status};
use crate::system::System;
use crate::tree::Tree;

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

/// Registers frame after frame and keeps its storage between them.
#[derive(Default)]
pub struct Registrar {
    options: Options,
    fixed: System,
    system: System,
}

impl Registrar {
    /// A registrar with these settings.
    pub fn new(options: Options) -> Self {
        Self {
            options,
            ..Self::default()
        }
    }

    /// The settings.
    pub fn options(&self) -> &Options {
        &self.options
    }

    /// Finds the motion that carries `source` onto `target`.
    ///
    /// `initial` is a displacement predicted for every source point: the search starts from it instead of from rest,
    /// and is drawn to it as strongly as [`Options::prediction`] says.
    ///
    /// # Errors
    /// Empty or mismatched clouds, coordinates that are not finite, a negative `sigma`, options out of range, a node spacing that
    /// makes too many nodes, or normal equations that lose definiteness. A poor fit is no error but a [`Status`].
    pub fn register(
        &mut self,
        source: &Cloud,
        target: &Cloud,
        landmarks: &[Landmark],
        features: &[Feature],
        initial: Option<&[Vector3<f64>]>,
    ) -> Result<Registration, Error> {
        let Self {
            options,
            fixed,
            system,
        } = self;
        options.check()?;
        let frame = Frame::new(source, landmarks, features, initial, options)?;
        target.check("target")?;
        let tree = Tree::new(target.points).ok_or(Error::EmptyCloud { cloud: "target" })?;
        let mut matcher = Matcher::new(target, tree);

        let start = initial.map_or_else(
            || vec![Vector3::zeros(); frame.nodes.len()],
            |predicted| frame.smoothed(predicted),
        );
        frame.assemble_fixed(&start, fixed);
        if let Some(predicted) = initial.filter(|_| options.prediction > 0.0) {
            frame.add_prediction(predicted, fixed);
        }
        let mut u = start;
        let mut rotations = frame.rotations(&u);
        let mut status = Status::MaxIterations;
        let mut iterations = 0;
        while iterations < options.iterations {
            let gate = options.gate(iterations);
            let matches = frame.find_matches(&u, &rotations, gate, &mut matcher);
            system.copy_from(fixed);
            frame.prior.add_forms(&rotations, system);
            frame.add_matches(&u, &matches, &matcher, system);
            frame.add_features(&u, system);
            let next = system.solve().ok_or(Error::Singular {
                iteration: iterations,
            })?;
            let step = largest_step(&u, &next);
            u = next;
            rotations = frame.rotations(&u);
            iterations += 1;
            if step <= options.tolerance && iterations >= options.gates.len() {
                status = Status::Converged;
                break;
            }
        }
        Ok(frame.report(u, &rotations, &mut matcher, iterations, status))
    }
}

fn largest_step(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    let step = |(x, y): (&Vector3<f64>, &Vector3<f64>)| (x - y).norm();
    a.iter().zip(b).map(step).fold(0.0, f64::max)
}
