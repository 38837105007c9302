//! Forces of the rows: a quadratic programme with bounds.
//!
//! ```text
//! min ½ λᵀ G λ − gᵀ λ   s.t. λ ≥ 0              G = A S⁻¹ Aᵀ + ς I,  g: gaps without forces
//! gradient q = Gλ − g
//! model    μ = argmin ½ (μ − λ)ᵀ M (μ − λ) + qᵀ(μ − λ)   s.t. μ ≥ 0        M: dense, of the included rows
//! step     λ ← λ + t (μ − λ),   t from the exact G
//! ```
//!
//! `M` holds entries of `G` from when each row was included, possibly with another set of resting vertices or before the last linearisation.
//! The gradient and the length of the step are exact, so an old model costs steps but no accuracy: the objective falls in every step, and where it no
//! longer does the result is optimal for the exact `G`. While the set of resting vertices still changes, forces are needed only roughly, and an old model
//! is enough; for the final tolerance a model of another set is renewed first ([`crate::compliance`]).

use nalgebra::DMatrix;

use crate::Error;
use crate::compliance::{Compliance, Influence};
use crate::pivots::{column, minimise};
use crate::problem::ROW_DEPTH;

/// Steps with a model before it is renewed.
const PATIENCE: usize = 3;
/// Most steps in all.
const STEPS: usize = 60;

/// The programme.
pub(crate) struct Dual<'a> {
    /// Gaps without forces, m.
    pub gaps: &'a [f64],
    /// Softness `ς`: equal or infeasible rows would make `G` singular.
    pub soft: &'a [f64],
    /// Gradient entries below this count as zero, m.
    pub tolerance: f64,
}

/// `G` among the included rows, with entries from when each was included.
pub(crate) struct Model {
    /// Indices of the rows in the stack.
    rows: Vec<usize>,
    gram: DMatrix<f64>,
}

/// Forces, and whether they are optimal within the tolerance.
pub(crate) struct Forces {
    pub values: Vec<f64>,
    /// Displacement under them, as a block.
    pub shift: Vec<f64>,
    pub settled: bool,
    /// Products with `G`.
    pub products: usize,
}

impl Dual<'_> {
    /// Descends from the forces of `start`.
    pub fn solve(
        &self,
        start: Vec<f64>,
        model: &mut Model,
        influence: &mut Influence,
        compliance: &mut Compliance,
    ) -> Result<Forces, Error> {
        let mut forces = start;
        let (mut shift, mut gradient) = self.product(&forces, compliance);
        for (q, g) in gradient.iter_mut().zip(self.gaps) {
            *q -= g;
        }
        let (mut products, mut age) = (1, 0);
        let mut settled = false;
        while products <= STEPS {
            if self.holds(&forces, &gradient) {
                settled = true;
                break;
            }
            if age == 0 && self.tolerance <= ROW_DEPTH && influence.outdated(compliance.table) {
                // A few exact steps are cheaper than many with a model of another set.
                model.renew(&forces, &gradient, influence, compliance)?;
            }
            model.admit(
                &self.lacking(&forces, &gradient, model),
                influence,
                compliance,
            )?;
            if self.defect(&forces, &gradient, model) <= self.tolerance {
                settled = true;
                break;
            }
            age += 1;
            if age > PATIENCE {
                model.renew(&forces, &gradient, influence, compliance)?;
                age = 0;
            }
            let mut target = self.target(&forces, &gradient, model);
            if target.is_none() {
                // Entries from different times need not form a positive matrix.
                model.renew(&forces, &gradient, influence, compliance)?;
                target = self.target(&forces, &gradient, model);
            }
            let direction = target.ok_or(Error::Factorisation)?;
            let (moved, product) = self.product(&direction, compliance);
            products += 1;
            let slope = dot(&gradient, &direction);
            if slope >= 0.0 {
                break;
            }
            let length = advance(&mut forces, &mut gradient, &direction, &product, slope);
            for (s, m) in shift.iter_mut().zip(&moved) {
                *s += length * m;
            }
        }
        Ok(Forces {
            values: forces,
            shift,
            settled,
            products,
        })
    }

    /// The displacement under forces, and `G` times them.
    fn product(&self, v: &[f64], compliance: &mut Compliance) -> (Vec<f64>, Vec<f64>) {
        if v.iter().all(|v| *v == 0.0) {
            let size = compliance.system.pattern.size();
            return (vec![0.0; 3 * size], vec![0.0; v.len()]);
        }
        let (shift, mut product) = compliance.times(v);
        for (p, (v, soft)) in product.iter_mut().zip(v.iter().zip(self.soft)) {
            *p += soft * v;
        }
        (shift, product)
    }

    /// Whether active rows are closed and the others open, within the tolerance; needs no model, unlike [`Self::defect`], which also allows small forces on
    /// open rows.
    fn holds(&self, forces: &[f64], gradient: &[f64]) -> bool {
        let violated = |(f, q): (&f64, &f64)| if *f > 0.0 { q.abs() } else { -q };
        let rows = forces.iter().zip(gradient);
        rows.map(violated).all(|v| v <= self.tolerance)
    }

    /// Rows that are active or should be, and are not included.
    fn lacking(&self, forces: &[f64], gradient: &[f64], model: &Model) -> Vec<usize> {
        let mut known = vec![false; forces.len()];
        for &k in &model.rows {
            known[k] = true;
        }
        (0..forces.len())
            .filter(|&k| !known[k] && (forces[k] > 0.0 || gradient[k] < -self.tolerance))
            .collect()
    }

    /// Largest of `min(λ_k G_kk, q_k)` in absolute value: how much, in metres, the optimality conditions are violated.
    fn defect(&self, forces: &[f64], gradient: &[f64], model: &Model) -> f64 {
        let inside = (0..model.rows.len()).map(|at| {
            let k = model.rows[at];
            let give = forces[k] * (model.gram[(at, at)] + self.soft[k]);
            give.min(gradient[k]).abs()
        });
        inside.fold(0.0, f64::max)
    }

    /// Direction to the minimum of the model.
    fn target(&self, forces: &[f64], gradient: &[f64], model: &Model) -> Option<Vec<f64>> {
        let now: Vec<f64> = model.rows.iter().map(|&k| forces[k]).collect();
        let mut gaps = vec![0.0; now.len()];
        for (l, &f) in now.iter().enumerate().filter(|(_, f)| **f != 0.0) {
            for (g, m) in gaps.iter_mut().zip(column(&model.gram, l)) {
                *g += m * f;
            }
        }
        for (at, &k) in model.rows.iter().enumerate() {
            gaps[at] += self.soft[k] * now[at] - gradient[k];
        }
        let soft: Vec<f64> = model.rows.iter().map(|&k| self.soft[k]).collect();
        // The guess is the rows that are active or violated now: mostly right, so that one or two pivots are enough.
        let active = model
            .rows
            .iter()
            .map(|&k| forces[k] > 0.0 || gradient[k] < 0.0)
            .collect();
        let target = minimise(&model.gram, &gaps, active, &soft, 0.1 * self.tolerance)?;
        let mut direction = vec![0.0; forces.len()];
        for (at, &k) in model.rows.iter().enumerate() {
            direction[k] = target[at] - now[at];
        }
        Some(direction)
    }
}

/// Moves along the direction to the lowest objective with non-negative forces; returns the length of the step.
fn advance(
    forces: &mut [f64],
    gradient: &mut [f64],
    direction: &[f64],
    product: &[f64],
    slope: f64,
) -> f64 {
    let lowest = -slope / dot(direction, product);
    let room = forces
        .iter()
        .zip(direction)
        .filter(|(_, d)| **d < 0.0)
        .map(|(f, d)| -f / d)
        .fold(f64::INFINITY, f64::min);
    // A full step of the model makes removed forces exactly zero; within these limits it lowers the objective as well.
    let length = if (0.7..1.5).contains(&lowest) {
        1.0
    } else {
        lowest.min(room)
    };
    for ((f, q), (d, p)) in forces
        .iter_mut()
        .zip(gradient)
        .zip(direction.iter().zip(product))
    {
        // Rounding of `f + (μ − f)` must not leave a force of 1e-17.
        let next = f64::max(*f + length * d, 0.0);
        *f = if next < 1e-14 * d.abs() { 0.0 } else { next };
        *q += length * p;
    }
    length
}

impl Model {
    pub fn new() -> Self {
        Self {
            rows: vec![],
            gram: DMatrix::zeros(0, 0),
        }
    }

    /// Includes rows.
    fn admit(
        &mut self,
        new: &[usize],
        influence: &mut Influence,
        compliance: &mut Compliance,
    ) -> Result<(), Error> {
        if new.is_empty() {
            return Ok(());
        }
        let old = self.rows.len();
        self.rows.extend_from_slice(new);
        let columns = compliance.columns(&self.rows, new.len(), influence)?;
        let count = self.rows.len();
        if old == 0 {
            self.gram = columns;
        } else {
            self.gram = std::mem::take(&mut self.gram).resize(count, count, 0.0);
            self.gram.columns_mut(old, new.len()).copy_from(&columns);
        }
        self.gram.fill_lower_triangle_with_upper_triangle();
        Ok(())
    }

    /// Starts again with the rows that are active or should be.
    fn renew(
        &mut self,
        forces: &[f64],
        gradient: &[f64],
        influence: &mut Influence,
        compliance: &mut Compliance,
    ) -> Result<(), Error> {
        let of_use = |k: &usize| forces[*k] > 0.0 || gradient[*k] < 0.0;
        let rows: Vec<usize> = self.rows.iter().copied().filter(of_use).collect();
        influence.renew(compliance)?;
        *self = Self::new();
        self.admit(&rows, influence, compliance)
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
