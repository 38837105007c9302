//! Convex quadratic programmes by clarabel's interior point method, for what active sets did not settle.
//!
//! ```text
//! min ½ xᵀ Q x + cᵀ x      s.t.   A x + s = b,   s ≥ 0            z: the multipliers of s ≥ 0
//! ```

use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettingsBuilder, DefaultSolution, DefaultSolver, IPSolver, SolverStatus, SupportedConeT,
};

use crate::Error;

/// Tolerance of the cost: it has to be posed in units in which its optimum is about one.
const GAP: f64 = 1e-11;

/// `x`, `s` and `z` at the optimum, on one thread; the constraints hold to `feasibility`. `Q` is given by its upper triangle.
pub(crate) fn minimise(
    quadratic: &CscMatrix<f64>,
    linear: &[f64],
    bounds: &CscMatrix<f64>,
    right: &[f64],
    feasibility: f64,
) -> Result<DefaultSolution<f64>, Error> {
    let settings = DefaultSettingsBuilder::default()
        .verbose(false)
        .max_threads(1)
        .tol_gap_abs(GAP)
        .tol_gap_rel(GAP)
        .tol_feas(feasibility)
        .build()
        .map_err(|_| Error::Factorisation)?;
    let cone = [SupportedConeT::NonnegativeConeT(right.len())];
    let mut solver = DefaultSolver::new(quadratic, linear, bounds, right, &cone, settings)
        .map_err(|_| Error::Factorisation)?;
    solver.solve();
    let found = solver.solution;
    let usable = matches!(
        found.status,
        SolverStatus::Solved | SolverStatus::AlmostSolved | SolverStatus::InsufficientProgress
    );
    if usable && found.x.iter().all(|v| v.is_finite()) {
        Ok(found)
    } else {
        Err(Error::Factorisation)
    }
}
