//! Options of the filter, with the reasons for their defaults.

use crate::Error;
use derive_setters::Setters;

/// Stiffness, noise, numbers of iterations. All lengths in metres, angles in radians.
///
/// ```
/// use topo_ekf::Options;
/// let options = Options::default().with_edge_sigma(0.3e-3).with_separation(1.5e-3);
/// assert_eq!(options.rotation_iterations, 6);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Options {
    /// Standard deviation of an edge vector around its rotated rest vector. The shape prior is as strong as
    /// `1/edge_sigma²`. Default 0.5 mm: a tenth of the usual edge of 5 mm, the strain of soft tissue under its own weight.
    pub edge_sigma: f64,
    /// Standard deviation of the part of a vertex's motion in a frame that the prediction does not explain; the information about a vertex decays by it.
    /// Default 0.5 mm: with less, old errors of the hidden side persist; with more, a bent hidden side returns to its rest shape.
    pub process_noise: f64,
    /// Standard deviation, per frame, of the change of a live edge vector beyond its rotation. It determines over how many
    /// neighbours the predicted motion is averaged. Default 0.2 mm.
    pub motion_sigma: f64,
    /// Standard deviation, per frame, of the difference between the rotations of the two ends of an edge.
    /// Default 0.05 rad. A smaller value averages the rotations of the hidden side over more of the seen one: less noise under rigid
    /// motion (0.17 mm instead of 0.25 mm at 0.02 rad), but a hidden end then lags behind a bend (4 mm instead of 0.5 mm).
    pub bend_sigma: f64,
    /// Most alternations between rotations and positions per frame. Default 6.
    pub rotation_iterations: usize,
    /// Alternations stop when no vertex moved farther than this. Default 10 µm, well below what a camera resolves.
    pub tolerance: f64,
    /// Weight of the predicted rotation relative to the edges of a vertex.
    /// It matters only where the edges do not determine the rotation (one edge, or all collinear). Default 0.01.
    pub rotation_memory: f64,
    /// Standard deviation of the pull of every vertex to its predicted position. It matters only for vertices that nothing else
    /// determines. Default 0.1 m.
    pub anchor_sigma: f64,
    /// Standard deviation of the position of a vertex added to the graph. Default 5 mm, one spacing.
    pub initial_sigma: f64,
    /// Least distance `δ` that a vertex keeps from a triangle far along the surface. Default 1 mm.
    pub separation: f64,
    /// Largest penetration depth at which a vertex is returned to its side of a triangle. It must cover the relative motion
    /// of two folds within a frame; deeper penetrations are not detected. Default 5 mm.
    pub contact_reach: f64,
    /// How a component of the graph without observations moves.
    pub unseen: Unseen,
    /// How the next frame is predicted.
    pub motion: Motion,
    /// The metric in which an estimate that violates a constraint is projected.
    pub projection: Projection,
}

/// What is predicted before a frame's observations are used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Motion {
    /// The motion of the seen side is spread over the graph, and rotations follow the edges: for objects that are manipulated.
    Spread,
    /// Vertices move only by the process noise, without rotation: one linear Kalman update per frame with the rest shape as
    /// fixed prior. For objects at rest, and for comparison with the textbook filter.
    Still,
}

/// Which of Simon's projections is used for an estimate that violates constraints (IET Control Theory and Applications 2010, sections 2.4 and 2.5).
///
/// The example `projections` compares them; the README has its figures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Projection {
    /// Estimate projection with the information as metric: the most probable state that satisfies the constraints. An active
    /// constraint moves the vertices around it too.
    Estimate,
    /// Gain projection: the gain nearest to the Kalman gain whose estimate satisfies the constraints. It equals the Euclidean projection
    /// of the estimate, so it moves only the violating vertices, away from their neighbours.
    Gain,
}

/// How a component without observations moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Unseen {
    /// It stays where it was: the components are different objects.
    Hold,
    /// It follows the rigid motion common to everything seen: the components are parts of one object whose connection
    /// has not been seen yet.
    Follow,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            edge_sigma: 0.5e-3,
            process_noise: 0.5e-3,
            motion_sigma: 0.2e-3,
            bend_sigma: 0.05,
            rotation_iterations: 6,
            tolerance: 1e-5,
            rotation_memory: 0.01,
            anchor_sigma: 0.1,
            initial_sigma: 5e-3,
            separation: 1e-3,
            contact_reach: 5e-3,
            unseen: Unseen::Hold,
            motion: Motion::Spread,
            projection: Projection::Estimate,
        }
    }
}

/// Range in which a standard deviation can be squared and inverted without loss of precision: the ratio of the
/// largest to the smallest information stays below 1e24.
const SIGMA_RANGE: std::ops::RangeInclusive<f64> = 1e-9..=1e3;

/// Whether a standard deviation can be converted to information.
pub(crate) fn usable_sigma(sigma: f64) -> bool {
    SIGMA_RANGE.contains(&sigma)
}

impl Options {
    /// Rejects invalid options.
    pub(crate) fn check(&self) -> Result<(), Error> {
        for (name, value) in [
            ("edge_sigma", self.edge_sigma),
            ("motion_sigma", self.motion_sigma),
            ("bend_sigma", self.bend_sigma),
            ("anchor_sigma", self.anchor_sigma),
            ("initial_sigma", self.initial_sigma),
        ] {
            if !usable_sigma(value) {
                return Err(Error::Option {
                    name,
                    value,
                    must: "between 1e-9 and 1e3",
                });
            }
        }
        for (name, value) in [
            ("process_noise", self.process_noise),
            ("tolerance", self.tolerance),
            ("rotation_memory", self.rotation_memory),
            ("separation", self.separation),
            ("contact_reach", self.contact_reach),
        ] {
            if !(0.0..=1e3).contains(&value) {
                return Err(Error::Option {
                    name,
                    value,
                    must: "between 0 and 1e3",
                });
            }
        }
        if self.rotation_iterations == 0 {
            return Err(Error::Option {
                name: "rotation_iterations",
                value: 0.0,
                must: "at least 1",
            });
        }
        Ok(())
    }
}
