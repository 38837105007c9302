//! Default implementations of the four traits.
//!
//! ```text
//! match    the nearest point, if the normals agree:  n_y · n_q > cos
//! residual (n · (y − q))² + α |Π δ|²                 to the plane of the match; α damps sliding
//! weight   (1 − d²/g²)²₊ · (small if q is a boundary point)
//! stop     once no node moves more than the tolerance with the last gate
//! ```
//!
//! The gate `g` shrinks from iteration to iteration. A source point that leaves the view is matched with the boundary of the visible
//! surface and would be dragged along with it; so matches with boundary points have a small weight.

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
        let (index, squared) = target.nearest_to(probe)?;
        let compatible = probe.normal.dot(&target.normals()[index]) > self.normal_cosine;
        (squared < reach * reach && compatible).then_some(index)
    }
}

/// Distance to the plane of the match, and damping of sliding along it.
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
            // √α times the whole step, and the step along the normal in full.
            jacobian: Matrix3::from_diagonal_element(root) + n * n.transpose() * (1.0 - root),
        }
    }
}

/// Tukey's weight with a gate that shrinks, and a small weight for boundary points of the target.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct AnnealedTukey {
    /// Gate of each iteration, in m; the last stays: [`Options::gates`].
    pub gates: Vec<f64>,
    /// Factor for a match with a boundary point: [`Options::boundary_weight`].
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
        let trust = if pair.on_boundary {
            self.boundary_weight
        } else {
            1.0
        };
        share * share * trust
    }
}

/// Converged once no node moves more than a tolerance with the last gate.
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
