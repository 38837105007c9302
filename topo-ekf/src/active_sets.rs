//! Alternates two active sets of the projection: vertices on the main plane, and active inequality rows.
//!
//! ```text
//! pass p     min ½ λᵀ (G + ς I) λ − gᵖᵀ λ,  λ ≥ 0     with the set of the plane, until neither set changes
//! residual   g − G λᵖ = ς (λᵖ − λᵖ⁻¹)                  of active rows
//! shift      gᵖ⁺¹ = g + ς λᵖ                            where the residual exceeds the tolerance
//! ```
//!
//! The regularisation `ς` makes `G` definite where rows are linearly dependent, and leaves a share of every gap open. For gaps of millimetres
//! one pass leaves less than the tolerance; for gaps of metres, or where rows oppose each other, it leaves more, and the gap is shifted by the
//! remainder: the method of multipliers of Hestenes and Powell. Rows that are feasible together then hold to the tolerance; infeasible rows end at
//! the least sum of squares. If the sets have not converged after the allowed rounds, an interior point method is used
//! ([`crate::interior`]).

use crate::Error;
use crate::compliance::{Compliance, Influence};
use crate::dual::{Dual, Forces, Model};
use crate::interior::interior_point;
use crate::plane_contact::PlaneContact;
use crate::problem::{Problem, ROW_DEPTH, Warm};
use crate::rows::{FEASIBLE, Stack};
use crate::system::System;

/// Alternations before the interior point method is used. A sheet that peels off the table takes one for every few rings
/// of vertices.
const ROUNDS: usize = 40;
/// Rounds in which the next set is predicted by relaxation. After them only the primal-dual active set is used, which is known to terminate.
const PREDICTED: usize = 3;
/// While the set of the plane still changes, forces are computed only to this share of the largest gap.
const COARSE: f64 = 3e-1;
/// Most passes. Usually one suffices; gaps of metres take two or three.
const PASSES: usize = 20;
/// Change of the remaining gaps, m, below which the passes have converged: the rows are then infeasible.
const STILL: f64 = 1e-2 * FEASIBLE;

/// A projection in progress, and finally its result.
pub(crate) struct ActiveSets<'a> {
    problem: &'a Problem<'a>,
    stack: Stack,
    /// Gaps without forces, m.
    gaps: Vec<f64>,
    /// The vertices on the plane.
    pub table: PlaneContact,
    /// Forces of the rows (Lagrange multipliers).
    pub forces: Vec<f64>,
    /// Displacement, as a block in the frame of the plane.
    pub shift: Vec<f64>,
    pub rounds: usize,
    pub solves: usize,
    model: Model,
}

impl<'a> ActiveSets<'a> {
    /// Starts from the forces of `warm`.
    pub fn new(
        problem: &'a Problem,
        stack: Stack,
        gaps: Vec<f64>,
        table: PlaneContact,
        warm: &Warm,
    ) -> Self {
        let force = |key| warm.forces.get(key).copied().unwrap_or(0.0);
        Self {
            problem,
            stack,
            gaps,
            forces: problem.rows.iter().map(|r| force(&r.key)).collect(),
            shift: table.start(&warm.risen),
            table,
            rounds: 0,
            solves: 0,
            model: Model::new(),
        }
    }

    /// Makes passes until the rows hold or no more progress is possible.
    pub fn run(&mut self, system: &mut System, influence: &mut Influence) -> Result<(), Error> {
        let held = self.held_compliance(system);
        let rows = self.problem.rows;
        let soft: Vec<f64> = rows.iter().map(|r| r.softness() * held).collect();
        if self.problem.plane.is_some() {
            self.predict_set(system);
        }
        let mut asked = self.gaps.clone();
        let mut left = vec![f64::INFINITY; rows.len()];
        for _ in 0..PASSES {
            self.alternate((&asked, &soft), system, influence)?;
            let before = std::mem::replace(&mut left, self.left());
            // Slightly tighter than the tolerance on the positions, which are rounded differently.
            let kept = rows
                .iter()
                .zip(&left)
                .all(|(r, l)| *l <= 0.99 * r.tolerance());
            let still = left
                .iter()
                .zip(&before)
                .all(|(l, b)| (l - b).abs() <= STILL);
            if kept || still {
                break;
            }
            for (k, a) in asked.iter_mut().enumerate() {
                *a = self.gaps[k] + soft[k] * self.forces[k];
            }
        }
        Ok(())
    }

    /// One pass: alternates the two active sets.
    fn alternate(
        &mut self,
        (asked, soft): (&[f64], &[f64]),
        system: &mut System,
        influence: &mut Influence,
    ) -> Result<(), Error> {
        let values = self.problem.values;
        let mut tolerance = asked.iter().fold(ROW_DEPTH, |a, g| a.max(COARSE * g));
        let last = self.rounds + ROUNDS;
        let (mut settled, mut lift) = (false, vec![]);
        while !settled && self.rounds < last {
            self.rounds += 1;
            if self.table.refactor(values, system)? || lift.is_empty() {
                lift = self.table.lift(values, system);
            }
            let dual = Dual {
                gaps: asked,
                soft,
                tolerance,
            };
            let found = self.push(&dual, &lift, system, influence)?;
            let push = self.stack.push(&self.forces, lift.len());
            let changed = self.table.update(values, system, &self.shift, &push);
            if changed && self.rounds < PREDICTED {
                self.predict_set(system);
            }
            settled = !changed && tolerance <= ROW_DEPTH && found;
            if !changed {
                tolerance = ROW_DEPTH;
            }
        }
        if !settled {
            (self.shift, self.forces) = interior_point(
                self.problem,
                &self.stack,
                asked,
                soft,
                system,
                &mut self.table,
            )?;
        }
        Ok(())
    }

    /// Forces of the rows and the displacement for the present set of the plane; returns whether they are optimal.
    fn push(
        &mut self,
        dual: &Dual,
        lift: &[f64],
        system: &mut System,
        influence: &mut Influence,
    ) -> Result<bool, Error> {
        if self.problem.rows.is_empty() {
            self.shift = vec![0.0; 3 * lift.len()];
            self.raise(lift);
            return Ok(true);
        }
        let mut lifted = vec![0.0; 3 * lift.len()];
        lifted[2 * lift.len()..].copy_from_slice(lift);
        let reached = self.stack.reach(&lifted);
        let gaps: Vec<f64> = dual.gaps.iter().zip(reached).map(|(g, r)| g - r).collect();
        let dual = Dual {
            gaps: &gaps,
            ..*dual
        };
        let mut compliance = Compliance {
            stack: &self.stack,
            table: &self.table,
            factor: self.problem.factor,
            system,
        };
        let start = std::mem::take(&mut self.forces);
        let Forces {
            values,
            shift,
            settled,
            products,
        } = dual.solve(start, &mut self.model, influence, &mut compliance)?;
        (self.forces, self.shift) = (values, shift);
        self.raise(lift);
        self.solves += products;
        Ok(settled)
    }

    /// Adds the displacement that puts the held vertices on the plane.
    fn raise(&mut self, lift: &[f64]) {
        for (s, l) in self.shift[2 * lift.len()..].iter_mut().zip(lift) {
            *s += l;
        }
    }

    fn predict_set(&mut self, system: &System) {
        let push = self.stack.push(&self.forces, self.problem.estimate.len());
        let (values, pattern) = (self.problem.values, &system.pattern);
        self.table.predict_set(values, pattern, &self.shift, &push);
    }

    /// The gaps that remain after the displacement.
    fn left(&self) -> Vec<f64> {
        let reached = self.stack.reach(&self.shift);
        self.gaps.iter().zip(reached).map(|(g, r)| g - r).collect()
    }

    /// Mean of `Σ_v ‖a_v‖² / W_vv` over the rows: the displacement of a row under a unit force when everything around it is fixed.
    fn held_compliance(&self, system: &System) -> f64 {
        let diagonal = |v: u32| self.problem.values[system.pattern.diagonal[v as usize]];
        let of = |k: usize| {
            let terms = self.stack.row(k).iter();
            terms
                .map(|(v, a)| a.norm_squared() / diagonal(*v))
                .sum::<f64>()
        };
        (0..self.stack.len()).map(of).sum::<f64>() / self.stack.len().max(1) as f64
    }
}
