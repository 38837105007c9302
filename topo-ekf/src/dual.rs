//! Rows of the projection and their small dense dual.
//!
//! ```text
//! min ½ λᵀ G λ − gᵀ λ   s.t. λ ≥ 0              λ: forces, g: how far each row is violated without them
//! optimal:  λ ≥ 0,  Gλ ≥ g,  λᵀ(Gλ − g) = 0
//! ```
//!
//! A primal-dual active set settles in a few dense factorisations; where it does not, or where the rows contradict each
//! other and no force is enough, clarabel's interior point solves the softened problem.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettingsBuilder, DefaultSolver, IPSolver, SupportedConeT};
use nalgebra::{Cholesky, DMatrix, DVector, Point3, Vector3};

use crate::Error;

/// Steps of the active set before clarabel is asked.
const STEPS: usize = 20;
/// Softness relative to the largest diagonal entry: rows that repeat each other would make `G` singular. A row of gap 1 mm
/// keeps a violation of 1e-12 m.
const SOFT: f64 = 1e-9;
/// Softness where the rows contradict each other.
const SOFTER: f64 = 1e-6;

/// `direction · Σ coefficient · x_vertex ≥ bound`.
#[derive(Clone, Debug)]
pub(crate) struct Row {
    pub terms: Vec<(u32, f64)>,
    pub direction: Vector3<f64>,
    pub bound: f64,
}

impl Row {
    /// How far the row is violated; negative where it holds.
    pub fn gap(&self, positions: &[Point3<f64>]) -> f64 {
        let sum: Vector3<f64> = self.terms.iter().map(|&(v, c)| positions[v as usize].coords * c).sum();
        self.bound - self.direction.dot(&sum)
    }

    /// `cᵀ v`.
    pub fn dot(&self, v: &[f64]) -> f64 {
        self.terms.iter().map(|&(i, c)| v[i as usize] * c).sum()
    }
}

/// Forces of the rows.
pub(crate) fn solve_dual(gram: &DMatrix<f64>, gaps: &[f64]) -> Result<Vec<f64>, Error> {
    if gaps.is_empty() {
        return Ok(vec![]);
    }
    let largest = gram.diagonal().max().max(f64::MIN_POSITIVE);
    match active_set(gram, gaps, SOFT * largest) {
        Some(forces) => Ok(forces),
        None => interior_point(gram, gaps, SOFTER * largest),
    }
}

fn active_set(gram: &DMatrix<f64>, gaps: &[f64], soft: f64) -> Option<Vec<f64>> {
    let mut active: Vec<bool> = gaps.iter().map(|&g| g > 0.0).collect();
    for _ in 0..STEPS {
        let chosen: Vec<usize> = (0..gaps.len()).filter(|&k| active[k]).collect();
        let mut part = gram.select_rows(&chosen).select_columns(&chosen);
        for k in 0..chosen.len() {
            part[(k, k)] += soft;
        }
        let rhs = DVector::from_iterator(chosen.len(), chosen.iter().map(|&k| gaps[k]));
        let solved = Cholesky::new(part)?.solve(&rhs);
        let mut forces = DVector::zeros(gaps.len());
        for (&k, &force) in chosen.iter().zip(solved.iter()) {
            forces[k] = force;
        }
        let reached = gram * &forces;
        let next: Vec<bool> = (0..gaps.len())
            .map(|k| if active[k] { forces[k] > 0.0 } else { reached[k] < gaps[k] - 1e-12 })
            .collect();
        if next == active {
            return Some(forces.as_slice().to_vec());
        }
        active = next;
    }
    None
}

fn interior_point(gram: &DMatrix<f64>, gaps: &[f64], soft: f64) -> Result<Vec<f64>, Error> {
    let count = gaps.len();
    // In units of the largest entry and the largest gap: clarabel's tolerances are absolute.
    let scale = gram.diagonal().max().max(f64::MIN_POSITIVE);
    let depth = gaps.iter().fold(f64::MIN_POSITIVE, |a, g| a.max(g.abs()));
    let (mut starts, mut rows, mut values) = (vec![0], vec![], vec![]);
    for l in 0..count {
        for k in 0..=l {
            let g = gram[(k, l)] + if k == l { soft } else { 0.0 };
            if g != 0.0 {
                rows.push(k);
                values.push(g / scale);
            }
        }
        starts.push(rows.len());
    }
    let quadratic = CscMatrix::new(count, count, starts, rows, values);
    let linear: Vec<f64> = gaps.iter().map(|g| -g / depth).collect();
    let minus: CscMatrix = CscMatrix::new(count, count, (0..=count).collect(), (0..count).collect(), vec![-1.0; count]);
    let settings = DefaultSettingsBuilder::default()
        .verbose(false)
        .max_threads(1)
        .tol_gap_abs(1e-10)
        .tol_gap_rel(1e-10)
        .tol_feas(1e-10)
        .build()
        .map_err(|_| Error::Factorisation)?;
    let cone = [SupportedConeT::NonnegativeConeT(count)];
    let mut solver = DefaultSolver::new(&quadratic, &linear, &minus, &vec![0.0; count], &cone, settings)
        .map_err(|_| Error::Factorisation)?;
    solver.solve();
    let forces: Vec<f64> = solver.solution.x.iter().map(|f| f.max(0.0) * depth / scale).collect();
    if forces.iter().all(|f| f.is_finite()) { Ok(forces) } else { Err(Error::Factorisation) }
}
