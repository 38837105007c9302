//! The normal equations `H u = f` of all node displacements: block-sparse assembly, sparse Cholesky by faer.
//!
//! ```text
//! H = Σ Jᵀ W J        3 × 3 blocks, only k ≥ l kept:  a pair (k, l) exists if some term of the energy couples the nodes
//! P H Pᵀ = L Lᵀ       P: approximate minimum degree over the nodes, so that the three rows of a node stay together
//! ```
//!
//! The pattern of blocks depends on the nodes and on which of them influence each point, not on the displacements. So the
//! order `P` and the structure of `L` are computed once and serve all iterations, and the following frames too while
//! the nodes stay. The entries are copied from the blocks straight to their places in that order, so that
//! faer has no matrix to permute in each solve.

use faer::dyn_stack::{MemBuffer, MemStack, StackReq};
use faer::linalg::cholesky::llt::factor::{LltParams, LltRegularization};
use faer::sparse::linalg::{amd, cholesky as sparse};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMat, SymbolicSparseColMatRef};
use faer::{Conj, MatMut, Par, Side, Spec};
use nalgebra::{Matrix3, Vector3};

/// No block here.
const ABSENT: u32 = u32::MAX;

/// The coupled pairs of nodes, the order of elimination, and the resulting pattern of the scalar matrix.
pub(crate) struct Structure {
    count: usize,
    /// Slot of block `(k, l)`, `k ≥ l`, at `k · count + l`.
    slots: Vec<u32>,
    /// Number of blocks.
    blocks: usize,
    /// The nodes in the order of elimination.
    order: Vec<usize>,
    lower: SymbolicSparseColMat<usize>,
    /// Which entry of the blocks each entry of the lower triangle is.
    entries: Vec<u32>,
    factor: sparse::SymbolicCholesky<usize>,
}

/// Rows of the entries of a sparse matrix, column by column.
struct Pattern {
    starts: Vec<usize>,
    rows: Vec<usize>,
}

impl Structure {
    /// The structure in which all nodes of each group are coupled; `None` if it does not fit into memory.
    pub fn new<'a>(
        count: usize,
        groups: impl Iterator<Item = &'a [(usize, f64)]>,
        terms: impl Iterator<Item = &'a [(usize, Vector3<f64>)]>,
    ) -> Option<Self> {
        let mut coupled = Coupled::new(count);
        groups.for_each(|group| coupled.add(group.iter().map(|&(k, _)| k)));
        terms.for_each(|group| coupled.add(group.iter().map(|&(k, _)| k)));
        let (mut slots, mut blocks) = (vec![ABSENT; count * count], Pattern::empty());
        for l in 0..count {
            for k in coupled.of(l).filter(|&k| k >= l) {
                slots[k * count + l] = blocks.rows.len() as u32;
                blocks.rows.push(k);
            }
            blocks.starts.push(blocks.rows.len());
        }
        let (order, places) = elimination_order(&blocks)?;
        let (lower, entries) = lower_triangle(&coupled, &slots, &order, &places);
        let factor = symbolic_factor(&lower)?;
        Some(Self {
            count,
            slots,
            blocks: blocks.rows.len(),
            order,
            lower: lower.checked(),
            entries,
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

/// Which nodes are coupled: a row of bits for each.
struct Coupled {
    words: usize,
    bits: Vec<u64>,
    /// The group that was added last, as bits and as nodes.
    group: Vec<u64>,
    last: Vec<usize>,
}

impl Coupled {
    /// Every node with itself.
    fn new(count: usize) -> Self {
        let words = count.div_ceil(64);
        let mut bits = vec![0; words * count];
        for k in 0..count {
            bits[k * words + k / 64] |= 1 << (k % 64);
        }
        Self {
            words,
            bits,
            group: vec![0; words],
            last: Vec::new(),
        }
    }

    /// All nodes of a group with each other.
    fn add(&mut self, group: impl Iterator<Item = usize> + Clone) {
        // Neighbouring points are often in reach of the same nodes.
        if group.clone().eq(self.last.iter().copied()) {
            return;
        }
        self.last.clear();
        self.last.extend(group);
        self.group.fill(0);
        for &k in &self.last {
            self.group[k / 64] |= 1 << (k % 64);
        }
        for &k in &self.last {
            let row = &mut self.bits[k * self.words..][..self.words];
            row.iter_mut().zip(&self.group).for_each(|(a, b)| *a |= b);
        }
    }

    /// The nodes coupled with `k`, ascending.
    fn of(&self, k: usize) -> impl Iterator<Item = usize> + '_ {
        let row = self.bits[k * self.words..][..self.words].iter();
        row.enumerate().flat_map(|(word, &bits)| {
            let next = |rest: &u64| Some(rest & rest.wrapping_sub(1)).filter(|rest| *rest != 0);
            let left = std::iter::successors(Some(bits).filter(|bits| *bits != 0), next);
            left.map(move |rest| 64 * word + rest.trailing_zeros() as usize)
        })
    }
}

impl Pattern {
    fn empty() -> Self {
        Self {
            starts: vec![0],
            rows: Vec::new(),
        }
    }

    fn view(&self) -> SymbolicSparseColMatRef<'_, usize> {
        let size = self.starts.len() - 1;
        SymbolicSparseColMatRef::new_checked(size, size, &self.starts, None, &self.rows)
    }

    /// For faer, which checks it once.
    fn checked(self) -> SymbolicSparseColMat<usize> {
        let size = self.starts.len() - 1;
        SymbolicSparseColMat::new_checked(size, size, self.starts, None, self.rows)
    }

    /// The other triangle.
    fn transposed(&self) -> Self {
        let mut starts = vec![0; self.starts.len()];
        for row in &self.rows {
            starts[row + 1] += 1;
        }
        for row in 1..starts.len() {
            starts[row] += starts[row - 1];
        }
        let (mut ends, mut rows) = (starts.clone(), vec![0; self.rows.len()]);
        for (column, limits) in self.starts.windows(2).enumerate() {
            for &row in &self.rows[limits[0]..limits[1]] {
                rows[ends[row]] = column;
                ends[row] += 1;
            }
        }
        Self { starts, rows }
    }
}

/// The order of elimination of the nodes, and the place of each node in it.
fn elimination_order(blocks: &Pattern) -> Option<(Vec<usize>, Vec<usize>)> {
    let count = blocks.starts.len() - 1;
    let (mut order, mut places) = (vec![0_usize; count], vec![0_usize; count]);
    let scratch = amd::order_maybe_unsorted_scratch::<usize>(count, blocks.rows.len());
    let mut memory = MemBuffer::try_new(scratch).ok()?;
    let stack = MemStack::new(&mut memory);
    let control = amd::Control::default();
    amd::order_maybe_unsorted(&mut order, &mut places, blocks.view(), control, stack).ok()?;
    Some((order, places))
}

/// The scalar pattern of the lower triangle in the order of elimination, every block as three by three entries, without those above the diagonal; and
/// the entry of the blocks that belongs at each place. A solve then only copies the entries, and has no matrix to permute.
fn lower_triangle(
    coupled: &Coupled,
    slots: &[u32],
    order: &[usize],
    places: &[usize],
) -> (Pattern, Vec<u32>) {
    let count = order.len();
    let (mut lower, mut entries) = (Pattern::empty(), Vec::new());
    let mut below = Vec::new();
    for (column, &l) in order.iter().enumerate() {
        below.clear();
        below.extend(
            coupled
                .of(l)
                .map(|k| places[k])
                .filter(|&row| row >= column),
        );
        below.sort_unstable();
        for b in 0..3 {
            for &row in &below {
                let k = order[row];
                let slot = 9 * slots[k.max(l) * count + k.min(l)];
                for a in if k == l { b } else { 0 }..3 {
                    lower.rows.push(3 * row + a);
                    // Blocks are stored by column, those of a pair that is eliminated in reverse are transposed.
                    let entry = if k < l { 3 * a + b } else { 3 * b + a };
                    entries.push(slot + entry as u32);
                }
            }
            lower.starts.push(lower.rows.len());
        }
    }
    (lower, entries)
}

/// The pattern of the factor.
fn symbolic_factor(lower: &Pattern) -> Option<sparse::SymbolicCholesky<usize>> {
    // Without a permutation, faer reads the upper triangle here and the lower one in the factorisation.
    sparse::factorize_symbolic_cholesky(
        lower.transposed().view(),
        Side::Upper,
        sparse::SymmetricOrdering::Identity,
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
        self.blocks.resize(structure.blocks, [0.0; 9]);
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
        for (pair, &slot) in structure.slots.iter().enumerate() {
            if slot != ABSENT {
                let (k, l) = (pair / structure.count, pair % structure.count);
                let block = Matrix3::from_column_slice(&self.blocks[slot as usize]);
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
    scratch: Option<(StackReq, MemBuffer)>,
}

impl Solver {
    /// Solves `H u = f`; `None` if `H` is not positive definite.
    pub fn solve(&mut self, structure: &Structure, system: &System) -> Option<Vec<Vector3<f64>>> {
        self.fill(structure, system);
        let matrix = SparseColMatRef::new(structure.lower.as_ref(), &self.values);
        let plan = &structure.factor;
        self.factor.resize(plan.len_val(), 0.0);
        let params = Spec::<LltParams, f64>::default();
        let need = plan
            .factorize_numeric_llt_scratch::<f64>(Par::Seq, params)
            .or(plan.solve_in_place_scratch::<f64>(1, Par::Seq));
        let kept = self.scratch.take().filter(|(size, _)| *size == need);
        let kept = kept.or_else(|| Some((need, MemBuffer::try_new(need).ok()?)));
        let (_, memory) = self.scratch.insert(kept?);
        let stack = MemStack::new(memory);
        let factor = plan
            .factorize_numeric_llt(
                &mut self.factor,
                matrix,
                Side::Lower,
                LltRegularization::default(),
                Par::Seq,
                stack,
                params,
            )
            .ok()?;
        let size = self.right.len();
        let right = MatMut::from_column_major_slice_mut(&mut self.right, size, 1);
        factor.solve_in_place_with_conj(Conj::No, right, Par::Seq, stack);
        let finite = self.right.iter().all(|c| c.is_finite());
        finite.then(|| self.solution(structure))
    }

    /// Fills the lower triangle and the right side, both in the order of elimination.
    fn fill(&mut self, structure: &Structure, system: &System) {
        let flat = system.blocks.as_flattened();
        let entries = structure.entries.iter();
        self.values.clear();
        self.values.extend(entries.map(|&at| flat[at as usize]));
        let sides = structure.order.iter().map(|&k| system.right[k]);
        self.right.clear();
        self.right.extend(sides.flat_map(|f| [f.x, f.y, f.z]));
    }

    /// The solution in the order of the nodes.
    fn solution(&self, structure: &Structure) -> Vec<Vector3<f64>> {
        let mut solution = vec![Vector3::zeros(); structure.count];
        for (u, &k) in self.right.chunks_exact(3).zip(&structure.order) {
            solution[k] = Vector3::from_column_slice(u);
        }
        solution
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
        assert!(structure.blocks < count * (count + 1) / 4);
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
