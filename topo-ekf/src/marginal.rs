//! Marginal variances of all vertices at once: the selected inverse.
//!
//! ```text
//! S = L Lᵀ,   Z = S⁻¹ on the pattern of L, last column first:
//! Z_ij = −(1/L_jj) Σ_{k>j} L_kj Z_ik      (i > j)
//! Z_jj = (1/L_jj) (1/L_jj − Σ_{k>j} L_kj Z_kj)
//! ```
//!
//! Every `Z_ik` on the right lies on the pattern of `L` again, so nothing outside it is ever formed: the cost is that of
//! one factorisation, not of `Q` solves. Source: Takahashi, Fagan and Chen (1973); Erisman and Tinney (1975).

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::LltRegularization;
use faer::sparse::linalg::cholesky::{SymbolicCholesky, SymbolicCholeskyRaw};
use faer::{Par, Side};

use crate::Error;
use crate::system::{Pattern, matrix};

/// Diagonal of `S⁻¹`; `symbolic` must be the simplicial analysis of the same pattern.
pub(crate) fn variances(
    pattern: &Pattern,
    symbolic: &SymbolicCholesky<usize>,
    values: &[f64],
) -> Result<Vec<f64>, Error> {
    let mut factor = vec![0.0; symbolic.len_val()];
    let scratch = symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, faer::Spec::default());
    let mut memory = MemBuffer::try_new(scratch).map_err(|_| Error::Factorisation)?;
    symbolic
        .factorize_numeric_llt(
            &mut factor,
            matrix(pattern, values),
            Side::Lower,
            LltRegularization::default(),
            Par::Seq,
            MemStack::new(&mut memory),
            faer::Spec::default(),
        )
        .map_err(|_| Error::Factorisation)?;
    let (SymbolicCholeskyRaw::Simplicial(columns), Some(order)) = (symbolic.raw(), symbolic.perm())
    else {
        return Err(Error::Factorisation);
    };
    let diagonal = selected_diagonal(columns.col_ptr(), columns.row_idx(), &factor);
    let mut variances = vec![0.0; diagonal.len()];
    for (&vertex, z) in order.arrays().0.iter().zip(diagonal) {
        variances[vertex] = z;
    }
    Ok(variances)
}

/// The recursion above; rows of a column are sorted, the diagonal first.
fn selected_diagonal(starts: &[usize], rows: &[usize], l: &[f64]) -> Vec<f64> {
    let size = starts.len() - 1;
    let mut z = vec![0.0; l.len()];
    let mut sum = vec![0.0; size];
    let mut weight = vec![0.0; size];
    let mut owner = vec![usize::MAX; size];
    for j in (0..size).rev() {
        let column = starts[j] + 1..starts[j + 1];
        for at in column.clone() {
            (sum[rows[at]], weight[rows[at]], owner[rows[at]]) = (0.0, l[at], j);
        }
        for at in column.clone() {
            let k = rows[at];
            let lk = l[at];
            let first = starts[k];
            let mut own = lk * z[first];
            for below in first + 1..starts[k + 1] {
                let i = rows[below];
                if owner[i] == j {
                    // Z is symmetric and only its lower half is stored: one entry serves both sums.
                    sum[i] += lk * z[below];
                    own += weight[i] * z[below];
                }
            }
            sum[k] += own;
        }
        let pivot = 1.0 / l[starts[j]];
        let mut tail = 0.0;
        for at in column {
            z[at] = -pivot * sum[rows[at]];
            tail += l[at] * z[at];
        }
        z[starts[j]] = pivot * (pivot - tail);
    }
    (0..size).map(|j| z[starts[j]]).collect()
}
