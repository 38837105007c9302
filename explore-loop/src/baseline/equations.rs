//! The normal equations of all node twists: blocks of 6 × 6, sparse Cholesky by faer.
//!
//! ```text
//! H ξ = f      H = Σ w Jᵀ J,  f = −Σ w Jᵀ r;   block (i, j) is there if some residual depends on both nodes
//! ```
//! Each block is stored as six columns of a scalar matrix, as in the solver of `nonrigid-reg` (whose 3 × 3 version is private).
//! The structure is computed once a frame and used by all its iterations. Single-threaded: the same input gives the same bits.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::{LltParams, LltRegularization};
use faer::sparse::linalg::cholesky as sparse;
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Conj, MatMut, Par, Side, Spec};
use nalgebra::{Matrix6, Vector6};

/// Unknowns of a node.
const DOF: usize = 6;

/// Which pairs of nodes share a residual, and the sparsity of the scalar matrix.
pub(super) struct Structure {
    /// First block of each block column, and one past the last.
    starts: Vec<usize>,
    /// Block rows, ascending in a column, the diagonal first.
    rows: Vec<u32>,
    scalar_starts: Vec<usize>,
    scalar_rows: Vec<usize>,
    factor: sparse::SymbolicCholesky<usize>,
}

impl Structure {
    /// The structure for `count` nodes and the pairs `(i, j)` that share a residual; `None` if it does not fit in memory.
    pub fn new(count: usize, pairs: impl Iterator<Item = [u32; 2]>) -> Option<Self> {
        let mut blocks: Vec<[u32; 2]> = pairs.map(|[i, j]| [i.min(j), i.max(j)]).collect();
        blocks.extend((0..count as u32).map(|i| [i, i]));
        blocks.sort_unstable();
        blocks.dedup();
        let starts: Vec<usize> = (0..=count)
            .map(|column| blocks.partition_point(|b| (b[0] as usize) < column))
            .collect();
        let rows: Vec<u32> = blocks.iter().map(|b| b[1]).collect();
        let (mut scalar_starts, mut scalar_rows) = (vec![0], Vec::new());
        for (column, ends) in starts.windows(2).enumerate() {
            for b in 0..DOF {
                for row in rows[ends[0]..ends[1]].iter().map(|r| *r as usize) {
                    let first = if row == column { b } else { 0 };
                    scalar_rows.extend((first..DOF).map(|a| DOF * row + a));
                }
                scalar_starts.push(scalar_rows.len());
            }
        }
        let size = DOF * count;
        let scalar =
            SymbolicSparseColMatRef::new_checked(size, size, &scalar_starts, None, &scalar_rows);
        let factor = sparse::factorize_symbolic_cholesky(
            scalar,
            Side::Lower,
            sparse::SymmetricOrdering::Amd,
            sparse::CholeskySymbolicParams::default(),
        )
        .ok()?;
        Some(Self {
            starts,
            rows,
            scalar_starts,
            scalar_rows,
            factor,
        })
    }

    fn count(&self) -> usize {
        self.starts.len() - 1
    }

    /// Slot of block `(i, j)`, `i ≥ j`.
    fn slot(&self, i: u32, j: u32) -> Option<usize> {
        let column = self.starts[j as usize]..self.starts[j as usize + 1];
        let at = self.rows[column.clone()].binary_search(&i).ok()?;
        Some(column.start + at)
    }
}

/// The entries of `H` and `f`.
pub(super) struct Equations<'a> {
    structure: &'a Structure,
    blocks: Vec<Matrix6<f64>>,
    right: Vec<Vector6<f64>>,
}

impl<'a> Equations<'a> {
    /// All zero.
    pub fn new(structure: &'a Structure) -> Self {
        Self {
            structure,
            blocks: vec![Matrix6::zeros(); structure.rows.len()],
            right: vec![Vector6::zeros(); structure.count()],
        }
    }

    /// Adds `block = w J_iᵀ J_j` to `H_ij` if the pair is in the structure and `i ≥ j`; the other half follows by symmetry.
    pub fn add(&mut self, i: u32, j: u32, block: &Matrix6<f64>) {
        if let Some(slot) = self.structure.slot(i, j).filter(|_| i >= j) {
            self.blocks[slot] += block;
        }
    }

    /// Adds `−w J_iᵀ r` to `f_i`.
    pub fn add_right(&mut self, i: u32, force: &Vector6<f64>) {
        self.right[i as usize] += force;
    }

    /// Solves `(H + μ diag H + tiny I) ξ = f`; `None` if the matrix is not positive definite.
    pub fn solve(mut self, damping: f64) -> Option<Vec<Vector6<f64>>> {
        for column in 0..self.structure.count() {
            let diagonal = &mut self.blocks[self.structure.starts[column]];
            for a in 0..DOF {
                diagonal[(a, a)] += damping * diagonal[(a, a)] + 1e-12;
            }
        }
        let structure = self.structure;
        let size = DOF * structure.count();
        let values = self.values();
        let symbolic = SymbolicSparseColMatRef::new_checked(
            size,
            size,
            &structure.scalar_starts,
            None,
            &structure.scalar_rows,
        );
        let params = Spec::<LltParams, f64>::default();
        let plan = &structure.factor;
        let need = plan
            .factorize_numeric_llt_scratch::<f64>(Par::Seq, params)
            .or(plan.solve_in_place_scratch::<f64>(1, Par::Seq));
        let mut memory = MemBuffer::try_new(need).ok()?;
        let stack = MemStack::new(&mut memory);
        let mut storage = vec![0.0; plan.len_val()];
        let factor = plan
            .factorize_numeric_llt(
                &mut storage,
                SparseColMatRef::new(symbolic, &values),
                Side::Lower,
                LltRegularization::default(),
                Par::Seq,
                stack,
                params,
            )
            .ok()?;
        let mut solution: Vec<f64> = self.right.iter().flatten().copied().collect();
        let right = MatMut::from_column_major_slice_mut(&mut solution, size, 1);
        factor.solve_in_place_with_conj(Conj::No, right, Par::Seq, stack);
        let finite = solution.iter().all(|x| x.is_finite());
        let twists = solution.chunks_exact(DOF).map(Vector6::from_column_slice);
        finite.then(|| twists.collect())
    }

    /// Blocks as the columns of the scalar matrix.
    fn values(&self) -> Vec<f64> {
        let structure = self.structure;
        let mut values = Vec::with_capacity(structure.scalar_rows.len());
        for ends in structure.starts.windows(2) {
            for b in 0..DOF {
                for (k, block) in self.blocks[ends[0]..ends[1]].iter().enumerate() {
                    // Only the first block of a column is the diagonal one.
                    let first = if k == 0 { b } else { 0 };
                    values.extend((first..DOF).map(|a| block[(a, b)]));
                }
            }
        }
        values
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_sparse_answer_is_the_dense_one(values in prop::collection::vec(-1.0..1.0_f64, 36 * 40)) {
            let count = 20;
            let pairs: Vec<[u32; 2]> = (0..count).flat_map(|i| [1, 7].map(|d| [i, (i + d) % count])).collect();
            let structure = Structure::new(count as usize, pairs.iter().copied()).unwrap();
            let mut equations = Equations::new(&structure);
            let size = 6 * count as usize;
            let mut dense = DMatrix::<f64>::identity(size, size) * 1e-12;
            let mut right = DVector::<f64>::zeros(size);
            for (pair, block) in pairs.iter().zip(values.chunks_exact(36)) {
                let rows = Matrix6::from_column_slice(block) + Matrix6::identity() * 3.0;
                for i in pair {
                    let force = rows.transpose() * Vector6::repeat(1.0);
                    equations.add_right(*i, &force);
                    let mut part = right.fixed_rows_mut::<6>(6 * *i as usize);
                    part += force;
                    for j in pair {
                        let sign = if i == j { 1.0 } else { 0.3 };
                        let product = rows.transpose() * rows * sign;
                        equations.add(*i, *j, &product);
                        let mut view = dense.fixed_view_mut::<6, 6>(6 * *i as usize, 6 * *j as usize);
                        view += product;
                    }
                }
            }
            let expected = dense.cholesky().unwrap().solve(&right);
            let found = equations.solve(0.0).unwrap();
            for (i, twist) in found.iter().enumerate() {
                prop_assert!((twist - expected.fixed_rows::<6>(6 * i)).norm() < 1e-8 * expected.norm());
            }
        }
    }
}
