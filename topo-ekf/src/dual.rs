//! Rows of the projection and their small dense dual.
//!
//! ```text
//! min ½ λᵀ G λ − gᵀ λ   s.t. λ ≥ 0              λ: forces, g: how far each row is violated without them
//! optimal:  λ ≥ 0,  Gλ ≥ g,  λᵀ(Gλ − g) = 0
//! ```
//!
//! Solved by block principal pivoting: every wrong row changes sides at once, and when that stops making progress, the last
//! wrong one alone (Júdice and Pires 1994, after Kostreva): fast where it is easy, and it does not cycle where two sheets
//! watch each other and their rows nearly repeat. What it cannot settle in the steps allowed, clarabel's interior point does.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettingsBuilder, DefaultSolver, IPSolver, SupportedConeT};
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::{
    LltRegularization, cholesky_in_place, cholesky_in_place_scratch,
};
use faer::linalg::cholesky::llt::solve::solve_in_place;
use faer::{MatMut, Par, Spec};
use nalgebra::{DMatrix, DVector, Point3, Vector3};

use crate::Error;

/// Pivots before clarabel is asked.
const STEPS: usize = 40;
/// Most rows for which clarabel is asked: a dense dual of this size takes it a fifth of a second, of twice the size, eight times that.
const DENSE: usize = 300;
/// Block pivots without progress before single ones.
const PATIENCE: usize = 3;
/// Softness relative to the largest diagonal entry: rows that nearly repeat each other would make `G` singular. A row that
/// is 1 mm violated keeps about 1e-8 m of it.
const SOFT: f64 = 1e-5;
/// A row lacking less than this is left alone, m: below [`crate::project`]'s own threshold, so the two never disagree.
const SLACK: f64 = 1e-9;

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
        let sum: Vector3<f64> = self
            .terms
            .iter()
            .map(|&(v, c)| positions[v as usize].coords * c)
            .sum();
        self.bound - self.direction.dot(&sum)
    }

    /// `cᵀ v`.
    pub fn dot(&self, v: &[f64]) -> f64 {
        self.terms.iter().map(|&(i, c)| v[i as usize] * c).sum()
    }
}

/// Forces of the rows.
pub(crate) struct Dual {
    pub forces: Vec<f64>,
    /// Whether they are optimal; if not, they are those of the last pivot.
    pub exact: bool,
}

/// Solves the dual; `start` says which rows probably push.
pub(crate) fn solve_dual(gram: &DMatrix<f64>, gaps: &[f64], start: &[bool]) -> Result<Dual, Error> {
    if gaps.is_empty() {
        return Ok(Dual {
            forces: vec![],
            exact: true,
        });
    }
    let soft = SOFT * gram.diagonal().max().max(f64::MIN_POSITIVE);
    let dual = block_pivots(gram, gaps, start, soft)?;
    if dual.exact || gaps.len() > DENSE {
        Ok(dual)
    } else {
        interior_point(gram, gaps, soft)
    }
}

fn block_pivots(
    gram: &DMatrix<f64>,
    gaps: &[f64],
    start: &[bool],
    soft: f64,
) -> Result<Dual, Error> {
    let mut active = start.to_vec();
    let (mut fewest, mut patience) = (usize::MAX, PATIENCE);
    let mut steps = 0;
    loop {
        steps += 1;
        let forces =
            DVector::from_vec(forces_of(gram, gaps, &active, soft).ok_or(Error::Factorisation)?);
        let reached = gram * &forces;
        // Rounding of the largest force decides what counts as a pull.
        let pull = -1e-9 * forces.amax();
        let wrong: Vec<usize> = (0..gaps.len())
            .filter(|&k| {
                if active[k] {
                    forces[k] < pull
                } else {
                    reached[k] < gaps[k] - SLACK
                }
            })
            .collect();
        let clipped = || forces.iter().map(|f| f.max(0.0)).collect();
        let Some(&last) = wrong.last() else {
            return Ok(Dual {
                forces: clipped(),
                exact: true,
            });
        };
        if steps == STEPS {
            return Ok(Dual {
                forces: clipped(),
                exact: false,
            });
        }
        if wrong.len() < fewest {
            (fewest, patience) = (wrong.len(), PATIENCE);
        } else {
            patience = patience.saturating_sub(1);
        }
        if patience > 0 {
            for &k in &wrong {
                active[k] = !active[k];
            }
        } else {
            active[last] = !active[last];
        }
    }
}

/// Forces that close the gaps of the active rows exactly.
fn forces_of(gram: &DMatrix<f64>, gaps: &[f64], active: &[bool], soft: f64) -> Option<Vec<f64>> {
    let chosen: Vec<usize> = (0..gaps.len()).filter(|&k| active[k]).collect();
    let count = chosen.len();
    let mut part = Vec::with_capacity(count * count);
    for &l in &chosen {
        part.extend(
            chosen
                .iter()
                .map(|&k| gram[(k, l)] + if k == l { soft } else { 0.0 }),
        );
    }
    let mut solved: Vec<f64> = chosen.iter().map(|&k| gaps[k]).collect();
    let mut memory = MemBuffer::try_new(cholesky_in_place_scratch::<f64>(
        count,
        Par::Seq,
        Spec::default(),
    ))
    .ok()?;
    let stack = MemStack::new(&mut memory);
    let mut square = MatMut::from_column_major_slice_mut(&mut part, count, count);
    cholesky_in_place(
        square.as_mut(),
        LltRegularization::default(),
        Par::Seq,
        stack,
        Spec::default(),
    )
    .ok()?;
    let rhs = MatMut::from_column_major_slice_mut(&mut solved, count, 1);
    solve_in_place(square.as_ref(), rhs, Par::Seq, stack);
    let mut forces = vec![0.0; gaps.len()];
    for (&k, force) in chosen.iter().zip(solved) {
        forces[k] = force;
    }
    Some(forces)
}

fn interior_point(gram: &DMatrix<f64>, gaps: &[f64], soft: f64) -> Result<Dual, Error> {
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
    let minus: CscMatrix = CscMatrix::new(
        count,
        count,
        (0..=count).collect(),
        (0..count).collect(),
        vec![-1.0; count],
    );
    let settings = DefaultSettingsBuilder::default()
        .verbose(false)
        .max_threads(1)
        .tol_gap_abs(1e-10)
        .tol_gap_rel(1e-10)
        .tol_feas(1e-10)
        .build()
        .map_err(|_| Error::Factorisation)?;
    let cone = [SupportedConeT::NonnegativeConeT(count)];
    let mut solver = DefaultSolver::new(
        &quadratic,
        &linear,
        &minus,
        &vec![0.0; count],
        &cone,
        settings,
    )
    .map_err(|_| Error::Factorisation)?;
    solver.solve();
    let forces: Vec<f64> = solver
        .solution
        .x
        .iter()
        .map(|f| f.max(0.0) * depth / scale)
        .collect();
    if forces.iter().all(|f| f.is_finite()) {
        Ok(Dual {
            forces,
            exact: true,
        })
    } else {
        Err(Error::Factorisation)
    }
}
