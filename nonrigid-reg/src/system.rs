//! The normal equations `H u = f` of all node displacements: block-sparse assembly, sparse Cholesky by faer.
//!
//! ```text
//! H = Σ Jᵀ W J        3 × 3 blocks, only k ≥ l kept:  a pair (k, l) exists if some term of the energy couples the nodes
//! P H Pᵀ = L Lᵀ       P: approximate minimum degree over the nodes, so that the three rows of a node stay together
//! ```
//!
//! The pattern of blocks depends on the nodes and on which of them influence each point, not on the displacements. So the
//! order `P` and the structure of `L` are computed once and serve all iterations, and the following frames too while
//! the nodes stay.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::{LltParams, LltRegularization};
use faer::perm::PermRef;
use faer::sparse::linalg::{amd, cholesky as sparse};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Conj, MatMut, Par, Side, Spec};
use nalgebra::{Matrix3, Vector3};

/// No block here.
const ABSENT: u32 = u32::MAX;

/// The coupled pairs of nodes, the order of elimination, and the resulting pattern of the scalar matrix.
pub(crate) struct Structure {
    count: usize,
    /// Slot of block `(k, l)`, `k ≥ l`, at `k · count + l`.
    slots: Vec<u32>,
    /// First slot of each block column, and one past the last.
    starts: Vec<usize>,
    /// Block row of each slot; ascending in a column, the diagonal first.
    rows: Vec<u32>,
    scalar_starts: Vec<usize>,
    scalar_rows: Vec<usize>,
    factor: sparse::SymbolicCholesky<usize>,
}

impl Structure {
    /// The structure in which all nodes of each group are coupled; `None` if it does not fit into memory.
    pub fn new<'a>(
        count: usize,
        groups: impl Iterator<Item = &'a [(usize, f64)]>,
        terms: impl Iterator<Item = &'a [(usize, Vector3<f64>)]>,
    ) -> Option<Self> {
        let mut slots = vec![ABSENT; count * count];
        let mut mark = |k: usize, l: usize| {
            if l <= k {
                slots[k * count + l] = 0;
            }
        };
        for group in groups {
            for &(k, _) in group {
                for &(l, _) in group {
                    mark(k, l);
                }
            }
        }
        for group in terms {
            for &(k, _) in group {
                for &(l, _) in group {
                    mark(k, l);
                }
            }
        }
        for k in 0..count {
            mark(k, k);
        }
        let (mut starts, mut rows) = (vec![0], Vec::new());
        for l in 0..count {
            for k in l..count {
                let slot = &mut slots[k * count + l];
                if *slot != ABSENT {
                    *slot = rows.len() as u32;
                    rows.push(k as u32);
                }
            }
            starts.push(rows.len());
        }
        let (scalar_starts, scalar_rows) = scalar_structure(&starts, &rows);
        let factor = symbolic_factor(&starts, &rows, &scalar_starts, &scalar_rows)?;
        Some(Self {
            count,
            slots,
            starts,
            rows,
            scalar_starts,
            scalar_rows,
            factor,
        })
    }

    /// Whether all nodes of a group are coupled.
    pub fn holds(&self, group: &[(usize, f64)]) -> bool {
        let slot = |k: usize, l: usize| self.slots[k.max(l) * self.count + k.min(l)];
        let meets = |&(k, _): &(usize, f64)| group.iter().all(|&(l, _)| slot(k, l) != ABSENT);
        group.iter().all(meets)
    }
}

/// Every block as three by three entries, without those above the diagonal.
fn scalar_structure(starts: &[usize], rows: &[u32]) -> (Vec<usize>, Vec<usize>) {
    let (mut scalar_starts, mut scalar_rows) = (vec![0], Vec::with_capacity(9 * rows.len()));
    for (l, ends) in starts.windows(2).enumerate() {
        for b in 0..3 {
            for &k in &rows[ends[0]..ends[1]] {
                let k = k as usize;
                let first = if k == l { b } else { 0 };
                scalar_rows.extend((first..3).map(|a| 3 * k + a));
            }
            scalar_starts.push(scalar_rows.len());
        }
    }
    (scalar_starts, scalar_rows)
}

/// Orders the nodes and computes the pattern of the factor.
fn symbolic_factor(
    starts: &[usize],
    rows: &[u32],
    scalar_starts: &[usize],
    scalar_rows: &[usize],
) -> Option<sparse::SymbolicCholesky<usize>> {
    let count = starts.len() - 1;
    let block_rows: Vec<usize> = rows.iter().map(|&k| k as usize).collect();
    let blocks = SymbolicSparseColMatRef::new_checked(count, count, starts, None, &block_rows);
    let (mut order, mut inverse) = (vec![0_usize; count], vec![0_usize; count]);
    let scratch = amd::order_maybe_unsorted_scratch::<usize>(count, rows.len());
    let mut memory = MemBuffer::try_new(scratch).ok()?;
    let stack = MemStack::new(&mut memory);
    amd::order_maybe_unsorted(
        &mut order,
        &mut inverse,
        blocks,
        amd::Control::default(),
        stack,
    )
    .ok()?;
    let triple = |order: &[usize]| -> Vec<usize> {
        order
            .iter()
            .flat_map(|&k| [3 * k, 3 * k + 1, 3 * k + 2])
            .collect()
    };
    let (order, inverse) = (triple(&order), triple(&inverse));
    let size = 3 * count;
    let scalar = SymbolicSparseColMatRef::new_checked(size, size, scalar_starts, None, scalar_rows);
    sparse::factorize_symbolic_cholesky(
        scalar,
        Side::Lower,
        sparse::SymmetricOrdering::Custom(PermRef::new_checked(&order, &inverse, size)),
        sparse::CholeskySymbolicParams::default(),
    )
    .ok()
}

/// The entries of `H` and `f`.
#[derive(Default)]
pub(crate) struct System {
    /// Column-major 3 × 3 blocks, by slot.
    blocks: Vec<[f64; 9]>,
    right: Vec<Vector3<f64>>,
}

impl System {
    /// All zero.
    pub fn reset(&mut self, structure: &Structure) {
        self.blocks.clear();
        self.blocks.resize(structure.rows.len(), [0.0; 9]);
        self.right.clear();
        self.right.resize(structure.count, Vector3::zeros());
    }

    /// Copies the content of `other`.
    pub fn copy_from(&mut self, other: &Self) {
        self.blocks.clone_from(&other.blocks);
        self.right.clone_from(&other.right);
    }

    /// `H_kl += block`, for `k ≥ l`. The block of a pair `k > l` stands for both halves.
    pub fn add_block(&mut self, structure: &Structure, k: usize, l: usize, block: &Matrix3<f64>) {
        let slot = structure.slots[k * structure.count + l] as usize;
        for (entry, b) in self.blocks[slot].iter_mut().zip(block.as_slice()) {
            *entry += b;
        }
    }

    /// `H_kl += scale · block`, for `k ≥ l`.
    pub fn add_scaled(
        &mut self,
        structure: &Structure,
        (k, l): (usize, usize),
        scale: f64,
        block: &Matrix3<f64>,
    ) {
        let slot = structure.slots[k * structure.count + l] as usize;
        for (entry, b) in self.blocks[slot].iter_mut().zip(block.as_slice()) {
            *entry += scale * b;
        }
    }

    /// `H_kl += weight · I`, for `k` and `l` in either order.
    pub fn add_scalar(&mut self, structure: &Structure, k: usize, l: usize, weight: f64) {
        let slot = structure.slots[k.max(l) * structure.count + k.min(l)] as usize;
        for a in 0..3 {
            self.blocks[slot][4 * a] += weight;
        }
    }

    /// `H u − f`.
    #[cfg(test)]
    pub fn residual(&self, structure: &Structure, u: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        let mut left: Vec<Vector3<f64>> = self.right.iter().map(|f| -f).collect();
        for (l, ends) in structure.starts.windows(2).enumerate() {
            for slot in ends[0]..ends[1] {
                let k = structure.rows[slot] as usize;
                let block = Matrix3::from_column_slice(&self.blocks[slot]);
                left[k] += block * u[l];
                if k != l {
                    left[l] += block.transpose() * u[k];
                }
            }
        }
        left
    }

    /// `f_k += force`.
    pub fn add_right(&mut self, k: usize, force: &Vector3<f64>) {
        self.right[k] += force;
    }
}

/// Storage of the factor, kept from solve to solve.
#[derive(Default)]
pub(crate) struct Solver {
    values: Vec<f64>,
    factor: Vec<f64>,
    right: Vec<f64>,
}

impl Solver {
    /// Solves `H u = f`; `None` if `H` is not positive definite.
    pub fn solve(&mut self, structure: &Structure, system: &System) -> Option<Vec<Vector3<f64>>> {
        self.fill(structure, system);
        let size = 3 * structure.count;
        let symbolic = SymbolicSparseColMatRef::new_checked(
            size,
            size,
            &structure.scalar_starts,
            None,
            &structure.scalar_rows,
        );
        let matrix = SparseColMatRef::new(symbolic, &self.values);
        let plan = &structure.factor;
        self.factor.resize(plan.len_val(), 0.0);
        let params = Spec::<LltParams, f64>::default();
        let need = plan
            .factorize_numeric_llt_scratch::<f64>(Par::Seq, params)
            .or(plan.solve_in_place_scratch::<f64>(1, Par::Seq));
        let mut memory = MemBuffer::try_new(need).ok()?;
        let stack = MemStack::new(&mut memory);
        let regularization = LltRegularization::default();
        let factor = plan
            .factorize_numeric_llt(
                &mut self.factor,
                matrix,
                Side::Lower,
                regularization,
                Par::Seq,
                stack,
                params,
            )
            .ok()?;
        let right = MatMut::from_column_major_slice_mut(&mut self.right, size, 1);
        factor.solve_in_place_with_conj(Conj::No, right, Par::Seq, stack);
        let finite = self.right.iter().all(|c| c.is_finite());
        let solution = self.right.chunks_exact(3).map(Vector3::from_column_slice);
        finite.then(|| solution.collect())
    }

    /// Fills the columns of the scalar matrix from the blocks.
    fn fill(&mut self, structure: &Structure, system: &System) {
        self.values.clear();
        self.values.reserve(structure.scalar_rows.len());
        for ends in structure.starts.windows(2) {
            for b in 0..3 {
                let mut first = b;
                for block in &system.blocks[ends[0]..ends[1]] {
                    self.values
                        .extend_from_slice(&block[3 * b + first..3 * b + 3]);
                    // Only the first block of a column is the diagonal one.
                    first = 0;
                }
            }
        }
        self.right.clear();
        self.right
            .extend(system.right.iter().flat_map(|f| [f.x, f.y, f.z]));
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};

    /// Against a dense factor of the same matrix, in a structure with holes.
    #[test]
    fn the_sparse_answer_is_the_dense_one() {
        let count = 30;
        let groups: Vec<Vec<(usize, f64)>> = (0..count)
            .map(|k| [0, 1, 5].map(|d| ((k + d) % count, 1.0)).to_vec())
            .collect();
        let none: [&[(usize, Vector3<f64>)]; 0] = [];
        let structure =
            Structure::new(count, groups.iter().map(Vec::as_slice), none.into_iter()).unwrap();
        assert!(structure.rows.len() < count * (count + 1) / 4);
        let mut system = System::default();
        system.reset(&structure);
        let mut dense = DMatrix::<f64>::zeros(3 * count, 3 * count);
        let mut right = DVector::<f64>::zeros(3 * count);
        for (i, group) in groups.iter().enumerate() {
            let metric = Matrix3::from_fn(|a, b| if a == b { 2.0 + i as f64 } else { 0.3 });
            for &(k, _) in group {
                for &(l, _) in group {
                    let scale = 1.0 + if k == l { 1.0 } else { 0.0 };
                    if l <= k {
                        system.add_scaled(&structure, (k, l), scale, &metric);
                    }
                    let mut view = dense.fixed_view_mut::<3, 3>(3 * k, 3 * l);
                    view += scale * metric;
                }
            }
            let force = Vector3::new(1.0, i as f64, -0.5);
            system.add_right(i, &force);
            right.fixed_rows_mut::<3>(3 * i).copy_from(&force);
        }
        let expected = dense.cholesky().unwrap().solve(&right);
        let found = Solver::default().solve(&structure, &system).unwrap();
        for (k, u) in found.iter().enumerate() {
            assert!((u - expected.fixed_rows::<3>(3 * k)).norm() < 1e-10);
        }
        system.add_scalar(&structure, 3, 3, -1e6);
        assert!(Solver::default().solve(&structure, &system).is_none());
    }
}
