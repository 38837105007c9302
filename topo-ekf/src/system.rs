//! The sparse information matrix and its Cholesky factor.
//!
//! ```text
//! S = diag(d) + Σ_e w_e (e_i − e_j)(e_i − e_j)ᵀ          Q × Q, the same for x, y and z
//! ```
//!
//! The pattern and the fill-reducing order depend only on the graph: they are computed once, and later factorisations
//! are only numeric.

use std::sync::Arc;

use faer::dyn_stack::{MemBuffer, MemStack, StackReq};
use faer::linalg::cholesky::llt::factor::LltRegularization;
use faer::perm::{Perm, PermRef};
use faer::sparse::linalg::cholesky::supernodal::{
    SymbolicSupernodalCholesky, factorize_supernodal_numeric_llt,
    factorize_supernodal_numeric_llt_scratch,
};
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LltRef, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering,
    factorize_symbolic_cholesky,
};
use faer::sparse::linalg::{SupernodalThreshold, SymbolicSupernodalParams};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMat, SymbolicSparseColMatRef};
use faer::{Conj, MatMut, Par, Side};
use nalgebra::{DMatrix, Point3};

use crate::Error;
use crate::marginal::selected_diagonal;
use crate::order::dissect;
use crate::pattern::Pattern;
use crate::selected_inverse::{Workspace, selected_inverse};

/// Most columns of one solve; more are solved in slices of this width.
const WIDTH: usize = 64;

/// Below every ratio, including that of a graph without edges (0), so that all factors are supernodal: [`crate::marginal`] needs the blocks.
const ALWAYS_BLOCKED: SupernodalThreshold = SupernodalThreshold(-1.0);

/// Number of columns and share of zeros up to which neighbouring blocks of the factor are merged. More than faer's defaults: this gives more
/// entries but takes a twentieth less time, since products of a few columns cost little more than their call.
const MERGED: [(usize, f64); 4] = [(8, 1.0), (32, 0.8), (64, 0.3), (usize::MAX, 0.05)];

/// A dissected surface of `Q` vertices has 5 (edges of a mesh) to 9 (ten neighbours) times `Q log₂ Q` entries in its factor. With more,
/// minimum degree is tried too.
const SURFACE: f64 = 12.0;

/// Lower triangle in elimination order, ready to be filled: permuting the pattern each time would cost a tenth of a factorisation.
struct Permuted {
    pattern: SymbolicSparseColMat<usize>,
    /// Index in [`Pattern`] from which each entry is taken.
    from: Vec<usize>,
}

impl Permuted {
    fn new(pattern: &Pattern, place: &[usize]) -> Self {
        let size = pattern.size();
        let mut columns: Vec<Vec<(usize, usize)>> = vec![vec![]; size];
        for column in 0..size {
            for at in pattern.starts[column]..pattern.starts[column + 1] {
                let (i, j) = (place[column], place[pattern.rows[at]]);
                columns[i.min(j)].push((i.max(j), at));
            }
        }
        let (mut starts, mut rows, mut from) = (vec![0], vec![], vec![]);
        for column in &mut columns {
            column.sort_unstable();
            rows.extend(column.iter().map(|e| e.0));
            from.extend(column.iter().map(|e| e.1));
            starts.push(rows.len());
        }
        let pattern = SymbolicSparseColMat::new_checked(size, size, starts, None, rows);
        Self { pattern, from }
    }
}

/// Pattern, order and working memory; a numeric factor is a vector computed by [`System::factorise`].
pub(crate) struct System {
    pub pattern: Arc<Pattern>,
    symbolic: SymbolicCholesky<usize>,
    permuted: Permuted,
    memory: MemBuffer,
    /// Memory of factors that are no longer needed.
    spare: Vec<Vec<f64>>,
}

/// Numeric Cholesky factor belonging to the [`System`] that made it.
pub(crate) struct Factor(Vec<f64>);

/// Entries of the inverse among some vertices.
pub(crate) struct Selected<'a> {
    /// By columns, in the order of the factor.
    entries: &'a [f64],
    /// The place of each vertex in that order.
    rank: Vec<usize>,
}

impl Selected<'_> {
    /// The entries of a column in the order of the vertices.
    pub fn column(&self, column: usize) -> impl Iterator<Item = f64> {
        let values = &self.entries[self.rank.len() * self.rank[column]..][..self.rank.len()];
        self.rank.iter().map(|&r| values[r])
    }
}

impl System {
    /// For a graph whose vertices have about these positions, which affect the cost of a factorisation but not its result.
    pub fn new(points: &[Point3<f64>], edges: &[[u32; 2]]) -> Result<Self, Error> {
        let pattern = Pattern::new(points.len(), edges);
        let symbolic = analyse(&pattern, points)?;
        let (blocks, order) = parts(&symbolic)?;
        let permuted = Permuted::new(&pattern, order.arrays().1);
        let scratch =
            numeric_scratch(blocks).or(symbolic.solve_in_place_scratch::<f64>(WIDTH, Par::Seq));
        let memory = MemBuffer::try_new(scratch).map_err(|_| Error::Factorisation)?;
        Ok(Self {
            pattern: Arc::new(pattern),
            symbolic,
            permuted,
            memory,
            spare: vec![],
        })
    }

    /// Cholesky factor of the matrix with these lower-triangle values.
    pub fn factorise(&mut self, values: &[f64]) -> Result<Factor, Error> {
        let (blocks, _) = parts(&self.symbolic)?;
        numeric(
            blocks,
            &self.permuted,
            values,
            MemStack::new(&mut self.memory),
            self.spare.pop(),
        )
    }

    /// Keeps the memory of a factor for the next one.
    pub fn recycle(&mut self, factor: Factor) {
        self.spare.push(factor.0);
    }

    /// Diagonal of the inverse of the matrix with these lower-triangle values.
    pub fn variances(&self, values: &[f64]) -> Result<Vec<f64>, Error> {
        let (blocks, order) = parts(&self.symbolic)?;
        let mut memory =
            MemBuffer::try_new(numeric_scratch(blocks)).map_err(|_| Error::Factorisation)?;
        let factor = numeric(
            blocks,
            &self.permuted,
            values,
            MemStack::new(&mut memory),
            None,
        )?;
        let mut variances = vec![0.0; self.pattern.size()];
        let diagonal = selected_diagonal(blocks, &factor.0);
        for (&vertex, z) in order.arrays().0.iter().zip(diagonal) {
            variances[vertex] = z;
        }
        Ok(variances)
    }

    /// Entries of `S⁻¹` among some vertices, each of which occurs once.
    pub fn selected_inverse(
        &self,
        factor: &Factor,
        vertices: &[u32],
    ) -> Result<DMatrix<f64>, Error> {
        let mut work = Workspace::default();
        let selected = self.selected(factor, vertices, &mut work)?;
        let count = vertices.len();
        let entries = (0..count).flat_map(|l| selected.column(l));
        Ok(DMatrix::from_iterator(count, count, entries))
    }

    /// [`System::selected_inverse`] in the memory of `work`.
    pub fn selected<'a>(
        &self,
        factor: &Factor,
        vertices: &[u32],
        work: &'a mut Workspace,
    ) -> Result<Selected<'a>, Error> {
        let (blocks, order) = parts(&self.symbolic)?;
        let place = order.arrays().1;
        let mut sorted: Vec<usize> = (0..vertices.len()).collect();
        sorted.sort_unstable_by_key(|&k| place[vertices[k] as usize]);
        let places: Vec<_> = sorted
            .iter()
            .map(|&k| place[vertices[k] as usize])
            .collect();
        let mut rank = vec![0; sorted.len()];
        for (r, &k) in sorted.iter().enumerate() {
            rank[k] = r;
        }
        let entries = selected_inverse(blocks, &factor.0, &places, work);
        Ok(Selected { entries, rank })
    }

    /// [`System::solve`] for the matrix with these lower-triangle values, with its own memory.
    pub fn solve_once(&self, values: &[f64], rhs: &mut [f64]) -> Result<(), Error> {
        let (blocks, _) = parts(&self.symbolic)?;
        let scratch = numeric_scratch(blocks).or(self.solve_scratch());
        let mut memory = MemBuffer::try_new(scratch).map_err(|_| Error::Factorisation)?;
        let stack = MemStack::new(&mut memory);
        let factor = numeric(blocks, &self.permuted, values, stack, None)?;
        self.solve_in(&factor, rhs, stack);
        Ok(())
    }

    /// Replaces the columns of `rhs` (column-major, as many as fit) by `S⁻¹` of them.
    pub fn solve(&mut self, factor: &Factor, rhs: &mut [f64]) {
        let mut memory = std::mem::replace(&mut self.memory, MemBuffer::new(StackReq::EMPTY));
        self.solve_in(factor, rhs, MemStack::new(&mut memory));
        self.memory = memory;
    }

    fn solve_in(&self, factor: &Factor, rhs: &mut [f64], stack: &mut MemStack) {
        let size = self.pattern.size();
        let llt = LltRef::new(&self.symbolic, &factor.0);
        for slice in rhs.chunks_mut(size * WIDTH) {
            let columns = slice.len() / size;
            let view = MatMut::from_column_major_slice_mut(slice, size, columns);
            llt.solve_in_place_with_conj(Conj::No, view, Par::Seq, stack);
        }
    }

    fn solve_scratch(&self) -> StackReq {
        self.symbolic.solve_in_place_scratch::<f64>(WIDTH, Par::Seq)
    }
}

fn numeric(
    blocks: &SymbolicSupernodalCholesky<usize>,
    permuted: &Permuted,
    values: &[f64],
    stack: &mut MemStack,
    spare: Option<Vec<f64>>,
) -> Result<Factor, Error> {
    let ordered: Vec<f64> = permuted.from.iter().map(|&at| values[at]).collect();
    // Old entries are overwritten.
    let mut factor = spare.unwrap_or_else(|| vec![0.0; blocks.len_val()]);
    factorize_supernodal_numeric_llt(
        &mut factor,
        SparseColMatRef::new(permuted.pattern.as_ref(), &ordered),
        LltRegularization::default(),
        blocks,
        Par::Seq,
        stack,
        faer::Spec::default(),
    )
    .map_err(|_| Error::Factorisation)?;
    Ok(Factor(factor))
}

fn numeric_scratch(blocks: &SymbolicSupernodalCholesky<usize>) -> StackReq {
    factorize_supernodal_numeric_llt_scratch::<usize, f64>(blocks, Par::Seq, faer::Spec::default())
}

/// The blocks and the order from [`analyse`], which exist for every graph.
fn parts(
    symbolic: &SymbolicCholesky<usize>,
) -> Result<(&SymbolicSupernodalCholesky<usize>, PermRef<'_, usize>), Error> {
    match (symbolic.raw(), symbolic.perm()) {
        (SymbolicCholeskyRaw::Supernodal(blocks), Some(order)) => Ok((blocks, order)),
        _ => Err(Error::Factorisation),
    }
}

/// Fill-reducing order and pattern of the factor: by dissection, or by minimum degree for a graph that is not like a surface.
fn analyse(pattern: &Pattern, points: &[Point3<f64>]) -> Result<SymbolicCholesky<usize>, Error> {
    let order = dissect(points, pattern);
    let mut place = vec![0; order.len()];
    for (k, &i) in order.iter().enumerate() {
        place[i] = k;
    }
    let order = Perm::new_checked(order.into(), place.into(), points.len());
    let dissected = analyse_in(pattern, SymmetricOrdering::Custom(order.as_ref()))?;
    let size = points.len() as f64;
    if dissected.len_val() as f64 <= SURFACE * size * size.log2() {
        return Ok(dissected);
    }
    let minimum = analyse_in(pattern, SymmetricOrdering::Amd)?;
    let far = 2 * dissected.len_val() > 3 * minimum.len_val();
    Ok(if far { minimum } else { dissected })
}

fn analyse_in(
    pattern: &Pattern,
    order: SymmetricOrdering<'_, usize>,
) -> Result<SymbolicCholesky<usize>, Error> {
    let params = CholeskySymbolicParams {
        supernodal_flop_ratio_threshold: ALWAYS_BLOCKED,
        supernodal_params: SymbolicSupernodalParams {
            relax: Some(&MERGED),
        },
        ..Default::default()
    };
    let (size, starts, rows) = (pattern.size(), &pattern.starts, &pattern.rows);
    let lower = SymbolicSparseColMatRef::new_checked(size, size, starts, None, rows);
    factorize_symbolic_cholesky(lower, Side::Lower, order, params).map_err(|_| Error::Factorisation)
}
