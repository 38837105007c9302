//! The four places where a caller can put a part of their own: what meets what, what a pair costs, what it counts, and when to stop.
//!
//! ```text
//! repeat  q = Correspondence(y)                   who meets source point y = p + Φu
//!         w = Rejection(y, q)                     how much that counts, 0 … 1
//!         r(y + δ) ≈ r + J δ = Residual(y, q)     what it costs:  (w/n) |r + J Φδ|²
//!         solve for u with the prior, landmarks and features
//! until   Termination
//! ```
//!
//! Each is one small trait with one default, whose parameters are the fields of [`Options`](crate::Options) of the same name. The parts
//! are `Sync` because matches are looked for in parallel with the feature `rayon`.

use nalgebra::{Matrix3, Point3, Vector3};

use crate::registration::Status;
use crate::target::Target;

/// A source point on its way.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Probe {
    /// Index in the source cloud.
    pub index: usize,
    /// Where it is now, in m.
    pub position: Point3<f64>,
    /// Its unit normal, turned along with the surface around it.
    pub normal: Vector3<f64>,
}

/// A source point and the target point it meets.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pair {
    /// The source point.
    pub probe: Probe,
    /// Index in the target cloud.
    pub target: usize,
    /// The target point, in m.
    pub point: Point3<f64>,
    /// Its unit normal.
    pub normal: Vector3<f64>,
    /// Whether the seen part of the target ends there.
    pub on_rim: bool,
}

impl Pair {
    /// From the target point to the source point, in m.
    pub fn offset(&self) -> Vector3<f64> {
        self.probe.position - self.point
    }
}

/// `r(y + δ) ≈ r + J δ`; fewer than three residuals leave rows zero.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Linearised {
    /// `r`, in m.
    pub residual: Vector3<f64>,
    /// `J`, without unit.
    pub jacobian: Matrix3<f64>,
}

/// How one iteration went.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// Iterations made, this one included.
    pub iteration: usize,
    /// Largest motion of a node in it, in m.
    pub step: f64,
    /// Share of source points with a match that counted.
    pub overlap: f64,
    /// Root mean square residual of the matches before the step, weighted, in m.
    pub residual: f64,
}

/// Which target point a source point meets.
pub trait Correspondence: Sync {
    /// Index of the target point that `probe` meets, if any within `reach` (m).
    fn find(&self, probe: &Probe, target: &Target, reach: f64) -> Option<usize>;
}

/// What a pair costs.
pub trait Residual: Sync {
    /// The residual where the pair stands, and how it changes with the source point.
    fn linearise(&self, pair: &Pair) -> Linearised;
}

/// How much a pair counts.
pub trait Rejection: Sync {
    /// Distance (m) beyond which no pair counts in this iteration: where the search may end.
    fn reach(&self, iteration: usize) -> f64;

    /// Weight from 0 (rejected) to 1. The final statistics ask with `iteration = usize::MAX`.
    fn weight(&self, pair: &Pair, iteration: usize) -> f64;
}

/// When to stop.
pub trait Termination: Sync {
    /// How it ended, or nothing to go on. [`Options::iterations`](crate::Options::iterations) bounds the loop in any case.
    fn verdict(&self, progress: &Progress) -> Option<Status>;
}
