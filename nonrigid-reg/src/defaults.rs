//! What stands in the four traits if nobody says otherwise.
//!
//! ```text
//! meets    the nearest point, if the normals agree:  n_y · n_q > cos
//! costs    (n · (y − q))² + α |Π δ|²                 onto the plane of the match; α drags on sliding
//! counts   (1 − d²/g²)²₊ · (small if the target ends at q)
//! stops    once no node moves more than the tolerance with the last gate
//! ```
//!
//! The gate `g` shrinks from iteration to iteration. A source point that leaves the view finds its nearest target on the rim of
//! what is still seen, and would be dragged along with it; that is why rim matches count little.

use nalgebra::Matrix3;

use crate::options::Options;
use crate::registration::Status;
use crate::target::Target;
use crate::traits::{
    Correspondence, Linearised, Pair, Probe, Progress, Rejection, Residual, Termination,
};

/// The nearest point, if the normals agree.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ClosestPoint {
    /// Smallest cosine between the normals: [`Options::normal_cosine`].
    pub normal_cosine: f64,
}

impl Correspondence for ClosestPoint {
    fn find(&self, probe: &Probe, target: &Target, reach: f64) -> Option<usize> {
        let (index, squared) = target.nearest(&probe.position)?;
        let compatible = probe.normal.dot(&target.normals()[index]) > self.normal_cosine;
        (squared < reach * reach && compatible).then_some(index)
    }
}

/// Distance to the plane of the match, and a drag on sliding along it.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct PointToPlane {
    /// `α`: [`Options::drag`].
    pub drag: f64,
}

impl Residual for PointToPlane {
    fn linearise(&self, pair: &Pair) -> Linearised {
        let sum = pair.normal + pair.probe.normal;
        let n = sum.try_normalize(1e-9).unwrap_or(pair.normal);
        let root = self.drag.sqrt();
        Linearised {
            residual: n * n.dot(&pair.offset()),
            // √α of any step, and all of a step along the normal.
            jacobian: Matrix3::from_diagonal_element(root) + n * n.transpose() * (1.0 - root),
        }
    }
}

/// Tukey's weight with a gate that shrinks, and little trust in the rim of the target.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct AnnealedTukey {
    /// Gate of each iteration, in m; the last stays: [`Options::gates`].
    pub gates: Vec<f64>,
    /// Factor for a match with a point where the target ends: [`Options::boundary_weight`].
    pub boundary_weight: f64,
}

impl Rejection for AnnealedTukey {
    fn reach(&self, iteration: usize) -> f64 {
        let last = self.gates.len().saturating_sub(1);
        let gate = self.gates.get(iteration.min(last));
        gate.copied().unwrap_or(f64::MAX)
    }

    fn weight(&self, pair: &Pair, iteration: usize) -> f64 {
        let relative = pair.offset().norm() / self.reach(iteration);
        let share = (1.0 - relative * relative).max(0.0);
        let trust = if pair.on_rim {
            self.boundary_weight
        } else {
            1.0
        };
        share * share * trust
    }
}

/// At rest once no node moves more than a tolerance with the last gate.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Settled {
    /// In m: [`Options::tolerance`].
    pub tolerance: f64,
    /// Fewest iterations: the number of [`Options::gates`].
    pub at_least: usize,
}

impl Termination for Settled {
    fn verdict(&self, progress: &Progress) -> Option<Status> {
        let rests = progress.step <= self.tolerance && progress.iteration >= self.at_least;
        rests.then_some(Status::Converged)
    }
}

impl Options {
    pub(crate) fn closest_point(&self) -> ClosestPoint {
        ClosestPoint {
            normal_cosine: self.normal_cosine,
        }
    }

    pub(crate) fn point_to_plane(&self) -> PointToPlane {
        PointToPlane { drag: self.drag }
    }

    pub(crate) fn annealed_tukey(&self) -> AnnealedTukey {
        AnnealedTukey {
            gates: self.gates.clone(),
            boundary_weight: self.boundary_weight,
        }
    }

    pub(crate) fn settled(&self) -> Settled {
        Settled {
            tolerance: self.tolerance,
            at_least: self.gates.len(),
        }
    }
}
