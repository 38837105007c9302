//! The constrained estimate nearest to the unconstrained one, in the metric of its information.
//!
//! ```text
//! min ½ (x − x̂)ᵀ (W ⊗ I₃) (x − x̂)      s.t.   n·x_i + c ≥ 0  for every i,      Σ_v a_kv·x_v ≥ b_k  for every row k
//! ```
//!
//! `W = S` is estimate projection, `W = I` gain projection ([`crate::Projection`]). The metric is the same in every direction, so
//! the main plane involves only the heights `n·x`: a bound-constrained problem with the scalar matrix `W`, solved by a primal-dual
//! active set ([`crate::plane_contact`]). The forces of rows (self-contact, further planes, the caller's inequalities) are found in the
//! dual ([`crate::dual`]), and the two alternate until neither changes ([`crate::active_sets`]). The optimum of a strictly convex
//! problem is unique, so the starting set affects the time and not the result.
//!
//! The filter keeps the projected mean; the set of active constraints is a property of this estimate and is not used as information
//! (that would make the filter overconfident by an order of magnitude, since the same table would be measured again in
//! every frame).

use std::collections::HashMap;

use nalgebra::{Matrix3, Point3, Rotation3, Vector3};

use crate::active_sets::ActiveSets;
use crate::compliance::Influence;
use crate::observation::Plane;
use crate::plane_contact::PlaneContact;
use crate::problem::{Problem, ROW_DEPTH, Warm};
use crate::rows::{Row, Stack, plane_rows};
use crate::system::System;
use crate::{Error, columns};

/// Height up to which a vertex that rested last time starts as resting, m.
const NEAR: f64 = 1e-3;

/// Outcome of the projection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Status {
    /// Nothing was violated: the estimate is the unconstrained one.
    Free,
    /// Nothing was observed and nothing violated: the estimate is the prediction, with its uncertainty.
    Unobserved,
    /// The constraints hold, and the estimate is the nearest that satisfies them.
    Constrained,
    /// The linearised contacts did not converge: planes and inequalities hold, but a contact may lack some separation
    /// (see [`StepReport::contact_depth`](crate::StepReport)).
    Unsettled,
    /// The constraints cannot hold together: the first plane holds, the others are violated as little as possible (least squares).
    Infeasible,
}

/// The projected estimate.
pub(crate) struct Projected {
    pub positions: Vec<Point3<f64>>,
    pub status: Status,
    pub warm: Warm,
    /// Number of active rows.
    pub pushing: usize,
    pub rounds: usize,
    pub solves: usize,
    pub factorisations: usize,
}

impl Problem<'_> {
    /// Solves from the active sets of `warm`; `influence` belongs to the metric and is used in all linearisations.
    pub fn solve(
        &self,
        system: &mut System,
        warm: &Warm,
        influence: &mut Influence,
    ) -> Result<Projected, Error> {
        let heights: Vec<f64> = self
            .estimate
            .iter()
            .map(|p| self.plane.map_or(f64::INFINITY, |plane| plane.height(p)))
            .collect();
        let gaps: Vec<f64> = self.rows.iter().map(|r| r.gap(self.estimate)).collect();
        if gaps.iter().all(|&g| g <= ROW_DEPTH) && heights.iter().all(|&h| h >= 0.0) {
            return Ok(self.unchanged());
        }
        let mut struck: Vec<bool> = heights.iter().map(|&h| h < 0.0).collect();
        for &i in &warm.resting {
            // Only vertices near the plane: a set from a different pose would cost rounds instead of saving them.
            struck[i as usize] |= heights[i as usize] < NEAR;
        }
        let basis = self.basis();
        let stack = Stack::new(self.rows, &basis);
        let mut search =
            ActiveSets::new(self, stack, gaps, PlaneContact::new(heights, struck), warm);
        search.run(system, influence)?;
        search.table.release(system);
        Ok(self.finish(&basis, &search))
    }

    /// Rotation into the frame whose third axis is the normal of the main plane.
    fn basis(&self) -> Matrix3<f64> {
        let Some(plane) = self.plane else {
            return Matrix3::identity();
        };
        let normal = plane.normal.into_inner();
        Rotation3::rotation_between(&normal, &Vector3::z()).map_or_else(
            // Straight down: half a turn about any horizontal axis.
            || Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0)),
            Rotation3::into_inner,
        )
    }

    fn finish(&self, basis: &Matrix3<f64>, search: &ActiveSets) -> Projected {
        let back = basis.transpose();
        let mut positions: Vec<_> = self
            .estimate
            .iter()
            .zip(columns::read(&search.shift))
            .map(|(p, d)| p + back * d)
            .collect();
        if let Some(plane) = &self.plane {
            lift_above(&mut positions, plane);
        }
        let feasible = self.rows.iter().all(|r| r.gap(&positions) <= r.tolerance());
        let pushing = |(r, f): (&Row, &f64)| (*f > 0.0).then_some((r.key, *f));
        let forces: HashMap<_, _> = self
            .rows
            .iter()
            .zip(&search.forces)
            .filter_map(pushing)
            .collect();
        Projected {
            status: if feasible {
                Status::Constrained
            } else {
                Status::Infeasible
            },
            pushing: forces.len(),
            warm: Warm {
                resting: search.table.resting(),
                risen: search.shift[2 * positions.len()..].to_vec(),
                forces,
            },
            positions,
            rounds: search.rounds,
            solves: search.solves,
            factorisations: search.table.factorisations,
        }
    }

    fn unchanged(&self) -> Projected {
        Projected {
            positions: self.estimate.to_vec(),
            status: Status::Free,
            warm: Warm::default(),
            pushing: 0,
            rounds: 0,
            solves: 0,
            factorisations: 0,
        }
    }
}

/// Moves vertices that rounding left a nanometre below onto the plane.
fn lift_above(positions: &mut [Point3<f64>], plane: &Plane) {
    for p in positions {
        let height = plane.height(p);
        if height < 0.0 {
            *p -= plane.normal.into_inner() * height;
        }
    }
}

/// Deepest violation of a plane, 0 if none.
pub(crate) fn deepest(planes: &[Plane], positions: &[Point3<f64>]) -> f64 {
    planes
        .iter()
        .flat_map(|plane| positions.iter().map(|p| -plane.height(p)))
        .fold(0.0, f64::max)
}

/// The plane that is handled by striking (the one violated by most vertices, the first of equals), and rows for the others.
pub(crate) fn split_planes(
    planes: &[Plane],
    estimate: &[Point3<f64>],
) -> (Option<Plane>, Vec<Row>) {
    let below = |plane: &Plane| estimate.iter().filter(|p| plane.height(p) < 0.0).count();
    let Some(main) = (0..planes.len()).max_by_key(|&k| (below(&planes[k]), std::cmp::Reverse(k)))
    else {
        return (None, vec![]);
    };
    let rows = planes
        .iter()
        .enumerate()
        .filter(|&(k, _)| k != main)
        .flat_map(|(k, plane)| plane_rows(plane, k, estimate.len()))
        .collect();
    (Some(planes[main]), rows)
}
