//! Sparse Cholesky of the stiffness, and the diagonal of its inverse.
//!
//! ```text
//! P K Pᵀ = L Lᵀ,   Z = (L Lᵀ)⁻¹,   Z_ij = δ_ij / L_jj² − Σ_{k>j} (L_kj / L_jj) Z_ik
//! ```
//!
//! The selected inverse costs about as much as the factorisation (Erisman and Tinney 1975). This makes `tr(S K⁻¹)` exact and cheap.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::LltRegularization;
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::cholesky::simplicial::SymbolicSimplicialCholesky;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LltRef, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering,
    factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMat, Triplet};
use faer::{Conj, MatMut, Par, Side, Spec};

use crate::Error;

/// `L` of a symmetric positive definite matrix.
pub(crate) struct Factor {
    symbolic: SymbolicCholesky<usize>,
    values: Vec<f64>,
}

impl Factor {
    /// Factorises the matrix with the given lower triangle (entries at the same index are added).
    pub(crate) fn new(size: usize, lower: &[Triplet<usize, usize, f64>]) -> Result<Self, Error> {
        let matrix = SparseColMat::<usize, f64>::try_new_from_triplets(size, size, lower)
            .map_err(|_| Error::NotPositiveDefinite)?;
        // Takahashi's recursion needs plain columns, hence simplicial.
        let params = CholeskySymbolicParams {
            supernodal_flop_ratio_threshold: SupernodalThreshold::FORCE_SIMPLICIAL,
            ..Default::default()
        };
        let symbolic = factorize_symbolic_cholesky(
            matrix.symbolic(),
            Side::Lower,
            SymmetricOrdering::Amd,
            params,
        )
        .map_err(|_| Error::NotPositiveDefinite)?;
        let mut values = vec![0.0; symbolic.len_val()];
        let mut memory = MemBuffer::new(
            symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, Spec::default()),
        );
        symbolic
            .factorize_numeric_llt(
                &mut values,
                matrix.as_ref(),
                Side::Lower,
                LltRegularization::default(),
                Par::Seq,
                MemStack::new(&mut memory),
                Spec::default(),
            )
            .map_err(|_| Error::NotPositiveDefinite)?;
        Ok(Self { symbolic, values })
    }

    /// Columns of the inverse, concatenated.
    pub(crate) fn inverse_columns(&self, which: &[u32]) -> Vec<f64> {
        let size = self.symbolic.nrows();
        let mut columns = vec![0.0; size * which.len()];
        for (k, &v) in which.iter().enumerate() {
            columns[k * size + v as usize] = 1.0;
        }
        let mut memory = MemBuffer::new(
            self.symbolic
                .solve_in_place_scratch::<f64>(which.len(), Par::Seq),
        );
        LltRef::new(&self.symbolic, &self.values).solve_in_place_with_conj(
            Conj::No,
            MatMut::from_column_major_slice_mut(&mut columns, size, which.len()),
            Par::Seq,
            MemStack::new(&mut memory),
        );
        columns
    }

    /// Diagonal of the inverse.
    pub(crate) fn inverse_diagonal(&self) -> Vec<f64> {
        let SymbolicCholeskyRaw::Simplicial(symbolic) = self.symbolic.raw() else {
            // Unreachable with the forced threshold; the slow computation gives the same numbers.
            return self.diagonal_by_columns();
        };
        let diagonal = takahashi(symbolic, &self.values);
        match self.symbolic.perm() {
            // Column j of L belongs to vertex forward[j].
            Some(perm) => {
                let mut out = vec![0.0; diagonal.len()];
                for (j, &v) in perm.arrays().0.iter().enumerate() {
                    out[v] = diagonal[j];
                }
                out
            }
            None => diagonal,
        }
    }

    fn diagonal_by_columns(&self) -> Vec<f64> {
        (0..self.symbolic.nrows() as u32)
            .map(|v| self.inverse_columns(&[v])[v as usize])
            .collect()
    }
}

/// Diagonal of `(L Lᵀ)⁻¹` for a factor whose columns start with the diagonal.
fn takahashi(symbolic: &SymbolicSimplicialCholesky<usize>, l: &[f64]) -> Vec<f64> {
    let (start, rows) = (symbolic.col_ptr(), symbolic.row_idx());
    let size = start.len() - 1;
    let mut z = vec![0.0; l.len()];
    // Index of a row in the present column, counted from 1; 0 if absent.
    let mut place = vec![0u32; size];
    let mut sums: Vec<f64> = Vec::new();
    for j in (0..size).rev() {
        let (first, end) = (start[j], start[j + 1]);
        let below = &rows[first + 1..end];
        let scale = 1.0 / l[first];
        sums.clear();
        sums.resize(below.len(), 0.0);
        for (p, &i) in below.iter().enumerate() {
            place[i] = p as u32 + 1;
        }
        for (p, &k) in below.iter().enumerate() {
            let l_kj = l[first + 1 + p] * scale;
            sums[p] -= l_kj * z[start[k]];
            for at in start[k] + 1..start[k + 1] {
                let q = place[rows[at]] as usize;
                if q > 0 {
                    sums[q - 1] -= l_kj * z[at];
                    sums[p] -= l[first + q] * scale * z[at];
                }
            }
        }
        let mut diagonal = scale * scale;
        for (p, &i) in below.iter().enumerate() {
            z[first + 1 + p] = sums[p];
            diagonal -= l[first + 1 + p] * scale * sums[p];
            place[i] = 0;
        }
        z[first] = diagonal;
    }
    (0..size).map(|j| z[start[j]]).collect()
}
