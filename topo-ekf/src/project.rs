//! The estimate nearest to the unconstrained one, in the metric of its information, that keeps the constraints.
//!
//! ```text
//! min ½ (x − x̂)ᵀ (S ⊗ I₃) (x − x̂)      s.t.   n·x_i + c ≥ 0  for every i,      m_k·Σ_v c_kv x_v ≥ b_k  for every row k
//! ```
//!
//! The metric is the same in every direction, so the table touches the heights `n·x` alone: a bound-constrained problem with the
//! scalar matrix `S`, solved by a primal-dual active set (resting vertices are struck from `S`, the pattern and its symbolic
//! factor stay). Rows (self-contact, further planes) go through the Schur complement
//!
//! ```text
//! G_kl = (m_k·m_l − m_kn m_ln) c_kᵀ S⁻¹ c_l  +  m_kn m_ln c_kᵀ S_free⁻¹ c_l
//! ```
//!
//! and the two alternate until neither set changes. The optimum of a strictly convex problem is unique, so the starting
//! set changes the time and not the answer. The projected mean is kept by the filter; the set of active constraints is a
//! property of this estimate and never becomes information (that would make the filter overconfident by an order of
//! magnitude, since the same table would be measured anew in every frame).

use std::collections::HashSet;

use nalgebra::Point3;

use crate::Error;
use crate::active::Active;
use crate::dual::Row;
use crate::observation::Plane;
use crate::system::{Factor, System};

/// Alternations between the two active sets before everything goes into the dual, where rows are only added.
const ROUNDS: usize = 15;
/// The same without rows: `S` is then an M-matrix and the active set monotone, so that it ends by itself; a sheet that
/// peels off the table takes a round for every few rings of vertices.
const ROUNDS_ALONE: usize = 60;
/// Most resting vertices and pushing rows for which the plane may go into the dense dual.
const DENSE: usize = 400;
/// Height up to which a vertex that rested last time is taken to rest again, m.
const NEAR: f64 = 1e-3;
/// A row violated by more than this enters the dual. It leaves a hundredfold reserve to the 1e-6 m that is promised.
const ROW_DEPTH: f64 = 1e-8;

/// How the projection ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Status {
    /// Nothing was violated: the estimate is the unconstrained one.
    Free,
    /// Constraints hold and the estimate is the nearest that keeps them.
    Constrained,
    /// The active set or the linearised contacts had not settled: the first plane holds, a contact may lack some separation
    /// (see [`StepReport::contact_depth`](crate::StepReport)).
    Unsettled,
    /// The constraints contradict each other: the first plane holds, the rest is violated as little as possible.
    Infeasible,
}

/// The projected estimate.
pub(crate) struct Projected {
    pub positions: Vec<Point3<f64>>,
    pub status: Status,
    /// Vertices resting on the main plane.
    pub resting: Vec<u32>,
    /// Rows that push.
    pub pushing: Vec<usize>,
    pub rounds: usize,
    pub factorisations: usize,
}

/// The plane handled by striking vertices; everything else is a row.
pub(crate) struct Projection<'a> {
    pub values: &'a [f64],
    pub factor: &'a Factor,
    pub estimate: &'a [Point3<f64>],
    pub plane: Option<Plane>,
    pub rows: &'a [Row],
}

/// Active sets to start from: those of the last frame or of the last linearisation.
#[derive(Clone, Debug, Default)]
pub(crate) struct Warm {
    /// Vertices that rested on the plane.
    pub resting: Vec<u32>,
    /// Vertices whose separation from a triangle pushed.
    pub pushed: HashSet<u32>,
}

impl Warm {
    pub fn of(projected: &Projected, rows: &[Row]) -> Self {
        let pushed = projected
            .pushing
            .iter()
            .map(|&k| &rows[k])
            .filter(|r| r.terms.len() > 1)
            .map(|r| r.terms[0].0);
        Self {
            resting: projected.resting.clone(),
            pushed: pushed.collect(),
        }
    }

    fn pushes(&self, row: &Row) -> bool {
        row.terms.len() > 1 && self.pushed.contains(&row.terms[0].0)
    }
}

impl Projection<'_> {
    /// Solves from the active sets of `warm`.
    pub fn solve(&self, system: &mut System, warm: &Warm) -> Result<Projected, Error> {
        let heights: Vec<f64> = self
            .estimate
            .iter()
            .map(|p| self.plane.map_or(f64::INFINITY, |plane| plane.height(p)))
            .collect();
        let mut rows = self.violated(self.estimate);
        if rows.is_empty() && heights.iter().all(|&h| h >= 0.0) {
            return Ok(self.unchanged());
        }
        let mut struck: Vec<bool> = heights.iter().map(|&h| h < 0.0).collect();
        for &i in &warm.resting {
            // Only those near the plane: a set left over from another place would cost rounds, not save them.
            struck[i as usize] |= heights[i as usize] < NEAR;
        }
        let held = |k: &usize| self.rows[*k].gap(self.estimate) <= ROW_DEPTH;
        rows.extend(
            (0..self.rows.len())
                .filter(held)
                .filter(|&k| warm.pushes(&self.rows[k])),
        );
        let mut active = Active::new(self, heights, struck);
        active.admit(&rows, system);
        let projected = self.alternate(system, active)?;
        match self.plane {
            Some(plane) if projected.status == Status::Unsettled => {
                self.rows_only(system, &plane, projected)
            }
            _ => Ok(projected),
        }
    }

    /// The two nested active sets.
    fn alternate(&self, system: &mut System, mut active: Active) -> Result<Projected, Error> {
        let mut shift = vec![];
        let (mut rounds, mut settled) = (0, false);
        while !settled
            && rounds
                < if active.has_rows() {
                    ROUNDS
                } else {
                    ROUNDS_ALONE
                }
        {
            rounds += 1;
            active.refactor(system)?;
            let push = active.push(system)?;
            settled = !active.update(&push, system) && push.exact;
            shift = push.shift;
        }
        let mut positions: Vec<_> = self
            .estimate
            .iter()
            .zip(&shift)
            .map(|(p, d)| p + d)
            .collect();
        if let Some(plane) = &self.plane {
            lift_above(&mut positions, plane);
        }
        let left = self
            .rows
            .iter()
            .map(|r| r.gap(&positions))
            .fold(0.0, f64::max);
        let status = match (settled, left > 1e-6) {
            (true, true) => Status::Infeasible,
            (true, false) => Status::Constrained,
            (false, _) => Status::Unsettled,
        };
        let (resting, pushing) = (active.resting(), active.pushing());
        Ok(Projected {
            positions,
            status,
            resting,
            pushing,
            rounds,
            factorisations: active.factorisations,
        })
    }

    /// The plane too as rows: vertices that were struck and freed again and again are then only ever added, which ends.
    /// Its dense dual is dear, so a set too large for it keeps what was reached, feasible for the plane.
    fn rows_only(
        &self,
        system: &mut System,
        plane: &Plane,
        reached: Projected,
    ) -> Result<Projected, Error> {
        if reached.resting.len() + reached.pushing.len() > DENSE {
            return Ok(reached);
        }
        let own = self.rows.len();
        let rows: Vec<_> = self
            .rows
            .iter()
            .cloned()
            .chain(plane_rows(plane, self.estimate.len()))
            .collect();
        let all = Projection {
            plane: None,
            rows: &rows,
            ..*self
        };
        let mut projected = all.solve(system, &Warm::default())?;
        projected.rounds += reached.rounds;
        projected.factorisations += reached.factorisations;
        projected.resting = projected
            .pushing
            .iter()
            .filter_map(|k| k.checked_sub(own))
            .map(|i| i as u32)
            .collect();
        projected.pushing.retain(|k| *k < own);
        lift_above(&mut projected.positions, plane);
        Ok(projected)
    }

    fn unchanged(&self) -> Projected {
        Projected {
            positions: self.estimate.to_vec(),
            status: Status::Free,
            resting: vec![],
            pushing: vec![],
            rounds: 0,
            factorisations: 0,
        }
    }

    /// Rows that do not hold at these positions.
    pub fn violated(&self, positions: &[Point3<f64>]) -> Vec<usize> {
        (0..self.rows.len())
            .filter(|&k| self.rows[k].gap(positions) > ROW_DEPTH)
            .collect()
    }
}

/// Puts on the plane what rounding left a nanometre below.
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

/// The plane that is handled by striking (the one most vertices violate, the first of equals) and rows for the others.
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
        .flat_map(|(_, plane)| plane_rows(plane, estimate.len()))
        .collect();
    (Some(planes[main]), rows)
}

/// A plane as one row per vertex.
fn plane_rows(plane: &Plane, vertices: usize) -> impl Iterator<Item = Row> + use<> {
    let (direction, bound) = (plane.normal.into_inner(), -plane.offset);
    (0..vertices as u32).map(move |v| Row {
        terms: vec![(v, 1.0)],
        direction,
        bound,
    })
}
