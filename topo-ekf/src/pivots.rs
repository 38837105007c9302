//! The dense quadratic programme `min ½ μᵀ M μ − gᵀ μ, μ ≥ 0` by block principal pivoting.
//!
//! ```text
//! optimal:  μ ≥ 0,  Mμ ≥ g,  μᵀ(Mμ − g) = 0
//! ```
//!
//! All wrong rows are swapped at once, and when that makes no progress, only the last wrong one (Júdice and Pires
//! 1994, after Kostreva): this is fast in easy cases, and does not cycle where two sheets constrain each other and their rows are
//! nearly equal.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::{
    LltRegularization, cholesky_in_place, cholesky_in_place_scratch,
};
use faer::linalg::cholesky::llt::solve::solve_in_place;
use faer::{MatMut, Par, Spec};
use nalgebra::DMatrix;

/// Most pivots. The result is a direction of descent even if they do not suffice.
const STEPS: usize = 40;
/// Block pivots without progress before single ones are used.
const PATIENCE: usize = 3;

/// Forces `μ` for the matrix with `soft` added to its diagonal, from a guess of the active rows; violations below `slack` are ignored. `None` if the
/// matrix is not positive.
pub(crate) fn minimise(
    gram: &DMatrix<f64>,
    gaps: &[f64],
    mut active: Vec<bool>,
    soft: &[f64],
    slack: f64,
) -> Option<Vec<f64>> {
    let (mut fewest, mut patience) = (usize::MAX, PATIENCE);
    let mut steps = 0;
    loop {
        steps += 1;
        let forces = forces_of(gram, gaps, &active, soft)?;
        let wrong = wrong_rows(gram, gaps, &active, &forces, slack);
        let Some(&last) = wrong.last() else {
            return Some(clipped(forces));
        };
        if steps == STEPS {
            return Some(clipped(forces));
        }
        if wrong.len() < fewest {
            (fewest, patience) = (wrong.len(), PATIENCE);
        } else {
            patience = patience.saturating_sub(1);
        }
        let turned = if patience > 0 { &wrong[..] } else { &[last] };
        for &k in turned {
            active[k] = !active[k];
        }
    }
}

/// A column as a slice, which is read several entries at a time.
pub(crate) fn column(gram: &DMatrix<f64>, l: usize) -> &[f64] {
    &gram.as_slice()[gram.nrows() * l..][..gram.nrows()]
}

/// Active rows with negative forces, and inactive rows that are violated.
fn wrong_rows(
    gram: &DMatrix<f64>,
    gaps: &[f64],
    active: &[bool],
    forces: &[f64],
    slack: f64,
) -> Vec<usize> {
    // Relative to the largest force, so that rounding does not count as a negative force.
    let pull = -1e-12 * forces.iter().fold(0.0, |a: f64, f| a.max(f.abs()));
    // By columns, which are added without waiting for one another. An inactive row has no force, so its softness has no effect.
    let mut reached = vec![0.0; gaps.len()];
    for (l, f) in forces.iter().enumerate().filter(|(_, f)| **f != 0.0) {
        for (r, g) in reached.iter_mut().zip(column(gram, l)) {
            *r += g * f;
        }
    }
    (0..gaps.len())
        .filter(|&k| {
            if active[k] {
                forces[k] < pull
            } else {
                reached[k] < gaps[k] - slack
            }
        })
        .collect()
}

fn clipped(forces: Vec<f64>) -> Vec<f64> {
    forces.into_iter().map(|f| f.max(0.0)).collect()
}

/// Forces that close the gaps of the active rows exactly.
fn forces_of(gram: &DMatrix<f64>, gaps: &[f64], active: &[bool], soft: &[f64]) -> Option<Vec<f64>> {
    let chosen: Vec<usize> = (0..gaps.len()).filter(|&k| active[k]).collect();
    let count = chosen.len();
    // The factor reads the lower triangle only.
    let mut part = vec![0.0; count * count];
    for (c, &l) in chosen.iter().enumerate() {
        let column = column(gram, l);
        let lower = &mut part[count * c + c..count * (c + 1)];
        for (p, &k) in lower.iter_mut().zip(&chosen[c..]) {
            *p = column[k];
        }
        lower[0] += soft[l];
    }
    let mut solved: Vec<f64> = chosen.iter().map(|&k| gaps[k]).collect();
    let scratch = cholesky_in_place_scratch::<f64>(count, Par::Seq, Spec::default());
    let mut memory = MemBuffer::try_new(scratch).ok()?;
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
