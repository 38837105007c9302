//! Input and result of a frame of the body filter.

use derive_setters::Setters;
use nalgebra::{Point3, Vector3};

use super::lattice::{Embedding, Lattice};
use super::row::BodyInequality;
use crate::graph::usable_point;
use crate::{Error, Status};

/// Progress of the steps of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Progress {
    /// 0 at the first step, 1 at the last.
    pub share: f64,
    /// Whether the body may have moved far: it was released a few frames ago, or [fell](BodyFrame::fell).
    pub released: bool,
}

/// Plausibility limits of a frame; a step beyond them is undone and returns [`Error::Beyond`].
#[derive(Clone, Copy, Debug, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Limits {
    /// How far 95 % of the surface may move in a frame, m.
    pub motion: f64,
    /// The same when the body may fall, after a release or where [`BodyFrame::fell`] says so, m.
    pub fall: f64,
    /// Largest total force of the grips, in weights of the body: grips that carry the body pull with about its weight, grips that slip or tear
    /// with many times that. For this limit the weight is at least half of what was assumed before anything was lifted: a stiff body does not sag, seems to
    /// weigh nothing, and would exceed any number of weights.
    pub pull: f64,
}

impl Default for Limits {
    /// No limits.
    fn default() -> Self {
        Self {
            motion: f64::INFINITY,
            fall: f64::INFINITY,
            pull: f64::INFINITY,
        }
    }
}

/// What a frame brings besides observations.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct BodyFrame<'a> {
    /// Points held by grippers, and their present positions.
    pub grips: &'a [(Embedding, Point3<f64>)],
    /// The estimated surface, for contact with the table.
    pub surface: &'a [Embedding],
    /// Linear inequalities on embedded points; may be empty.
    pub inequalities: &'a [BodyInequality],
    /// Plausibility limits.
    pub limits: Limits,
    /// The body may have moved far since the last frame: it fell over an edge while it was held, or frames were missed. It is fitted as after a release,
    /// but bears its weight.
    pub fell: bool,
}

impl<'a> BodyFrame<'a> {
    /// A frame without inequalities; both lists may be empty.
    pub fn new(grips: &'a [(Embedding, Point3<f64>)], surface: &'a [Embedding]) -> Self {
        Self {
            grips,
            surface,
            inequalities: &[],
            limits: Limits::default(),
            fell: false,
        }
    }

    /// Sets the plausibility limits.
    #[must_use]
    pub fn with_limits(mut self, limits: Limits) -> Self {
        self.limits = limits;
        self
    }

    /// Says whether the body may have moved far since the last frame, as when it falls over an edge while it is held.
    #[must_use]
    pub fn with_fell(mut self, fell: bool) -> Self {
        self.fell = fell;
        self
    }

    /// Adds linear inequalities, for example against self-intersection ([`BodyInequality::separation`]).
    #[must_use]
    pub fn with_inequalities(mut self, inequalities: &'a [BodyInequality]) -> Self {
        self.inequalities = inequalities;
        self
    }

    /// Rejects input that is invalid for this lattice.
    pub(crate) fn check(&self, lattice: &Lattice) -> Result<(), Error> {
        for (index, (at, target)) in self.grips.iter().enumerate() {
            lattice.check_embedding("grip", index, at)?;
            if !usable_point(target) {
                return Err(Error::NonFinitePoint {
                    what: "grip",
                    index,
                    value: target.coords.into(),
                });
            }
        }
        for (index, at) in self.surface.iter().enumerate() {
            lattice.check_embedding("surface point", index, at)?;
        }
        for (index, row) in self.inequalities.iter().enumerate() {
            row.check(index, lattice)?;
        }
        Ok(())
    }
}

/// The result of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct BodyReport {
    /// Number of steps, each with one factorisation.
    pub solves: usize,
    /// Mean displacement of the nodes since the last frame, m.
    pub moved: f64,
    /// Longest displacement of a node in the last step, m.
    pub last_step: f64,
    /// Outcome of the constraints: `Free` when nothing was violated, `Constrained` when all hold, `Infeasible` when they cannot hold
    /// together (they are then violated as little as possible, by least squares).
    pub status: Status,
    /// Number of active constraints: points against the table and inequalities.
    pub pushing: usize,
    /// Largest violation of a constraint, before the projection and after it, m.
    pub violation: [f64; 2],
    /// Force of the table on the body along its normal, in units of the energy per metre; compare with
    /// [`BodyFilter::weight`](super::BodyFilter::weight).
    pub table_force: f64,
    /// Total force of the grips on the body, in units of the energy per metre.
    pub grip_force: Vector3<f64>,
}

impl Default for BodyReport {
    fn default() -> Self {
        Self {
            solves: 0,
            moved: 0.0,
            last_step: 0.0,
            status: Status::Free,
            pushing: 0,
            violation: [0.0; 2],
            table_force: 0.0,
            grip_force: Vector3::zeros(),
        }
    }
}
