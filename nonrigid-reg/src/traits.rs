//! The four parts that a caller can replace: the search for matches, the residual of a pair, its weight, and the stopping rule.
//!
//! ```text
//! repeat  q = Correspondence(y)                   match of the source point y = p + Φu
//!         w = Rejection(y, q)                     weight of the pair, 0 … 1
//!         r(y + δ) ≈ r + J δ = Residual(y, q)     residual:  (w/n) |r + J Φδ|²
//!         solve for u with the prior, landmarks and features
//! until   Termination
//! ```
//!
//! Each is a small trait with one default, whose parameters are the fields of [`Options`](crate::Options) of the same name. They
//! are `Sync` because matches are searched in parallel with the feature `rayon`.

use nalgebra::{Matrix3, Point3, Vector3};

use crate::registration::Status;
use crate::target::Target;

/// A source point during an iteration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Probe {
    /// Index in the source cloud.
    pub index: usize,
    /// Where it is now, in m.
    pub position: Point3<f64>,
    /// Its unit normal, rotated with the surface around it.
    pub normal: Vector3<f64>,
}

/// A source point and the target point matched with it.
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
    /// Whether the target point lies on the boundary of the visible surface.
    pub on_boundary: bool,
}

impl Pair {
    /// From the target point to the source point, in m.
    pub fn offset(&self) -> Vector3<f64> {
        self.probe.position - self.point
    }
}

/// `r(y + δ) ≈ r + J δ`; with fewer than three residuals the other rows are zero.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Linearised {
    /// `r`, in m.
    pub residual: Vector3<f64>,
    /// `J`, without a unit.
    pub jacobian: Matrix3<f64>,
}

/// Progress of one iteration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// Iterations made, this one included.
    pub iteration: usize,
    /// Largest motion of a node in it, in m.
    pub step: f64,
    /// Share of source points whose match has a weight.
    pub overlap: f64,
    /// Root mean square residual of the matches before the step, weighted, in m.
    pub residual: f64,
}

/// Search for the match of a source point.
pub trait Correspondence: Sync {
    /// Index of the target point matched with `probe`, if there is one within `reach` (m).
    fn find(&self, probe: &Probe, target: &Target, reach: f64) -> Option<usize>;
}

/// Residual of a pair.
pub trait Residual: Sync {
    /// The residual at the present position of the pair, and its derivative by the source point.
    fn linearise(&self, pair: &Pair) -> Linearised;
}

/// Weight of a pair.
///
/// ```
/// use nonrigid_reg::nalgebra::Point3;
/// use nonrigid_reg::{Cloud, Pair, Registrar, Rejection, estimate_normals};
/// # let before: Vec<_> = (0..1600).map(|k| {
/// #     let (x, y) = (f64::from(k % 40) * 0.0025, f64::from(k / 40) * 0.0025);
/// #     Point3::new(x, y, 0.006 * (60.0 * x).sin() * (50.0 * y).cos())
/// # }).collect();
/// # let normals = estimate_normals(&before, 16, &Point3::new(0.05, 0.05, 0.5))?;
/// /// Leaves out the source points that are marked, such as those on a tool.
/// struct Masked(Vec<bool>);
/// impl Rejection for Masked {
///     fn reach(&self, _: usize) -> f64 {
///         0.008
///     }
///     fn weight(&self, pair: &Pair, _: usize) -> f64 {
///         if self.0[pair.probe.index] { 0.0 } else { 1.0 }
///     }
/// }
/// let mask: Vec<bool> = (0..1600).map(|k| k % 40 < 4).collect();
/// let sheet = Cloud { points: &before, normals: &normals };
/// let mut registrar = Registrar::default().with_rejection(Masked(mask.clone()));
/// let found = registrar.register(&sheet, &sheet, &[], &[], None)?;
/// assert!(found.matches.iter().zip(&mask).all(|(hit, masked)| hit.is_none() || !masked));
/// assert!(found.matches.iter().flatten().count() > 1000);
/// # Ok::<(), nonrigid_reg::Error>(())
/// ```
pub trait Rejection: Sync {
    /// Distance (m) beyond which pairs have no weight in this iteration: the limit of the search.
    fn reach(&self, iteration: usize) -> f64;

    /// Weight from 0 (rejected) to 1. The final statistics use `iteration = usize::MAX`.
    fn weight(&self, pair: &Pair, iteration: usize) -> f64;
}

/// Stopping rule.
pub trait Termination: Sync {
    /// The final status, or `None` to continue. [`Options::iterations`](crate::Options::iterations) limits the number in any case.
    fn verdict(&self, progress: &Progress) -> Option<Status>;
}
