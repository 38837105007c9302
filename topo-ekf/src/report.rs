//! The report of a step.

use crate::project::Status;

/// Outcome of one [`Filter::step`](crate::Filter::step).
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct StepReport {
    /// Outcome of the constraints.
    pub status: Status,
    /// Alternations between rotations and positions.
    pub iterations: usize,
    /// Largest displacement of a vertex in the last of them, m.
    pub last_move: f64,
    /// Deepest vertex below a plane, before the projection and after it, m.
    pub plane_depth: [f64; 2],
    /// Largest lack of separation between a vertex and a triangle far along the surface, before and after, m.
    pub contact_depth: [f64; 2],
    /// Largest violation of a further plane or of the caller's inequalities (those divided by their largest coefficient), before
    /// and after, m.
    pub inequality_depth: [f64; 2],
    /// Vertices resting on the plane that most vertices touch.
    pub resting: Vec<u32>,
    /// Number of active rows: self-contacts, further planes and inequalities.
    pub pushing: usize,
    /// Number of pairs of vertex and triangle that were constrained.
    pub watched: usize,
    /// Rounds of the two alternating active sets, over all linearisations.
    pub rounds: usize,
    /// Sparse solves for the forces of the rows.
    pub solves: usize,
    /// Factorisations in addition to those of every step.
    pub factorisations: usize,
}
