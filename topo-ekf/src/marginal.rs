//! Marginal variances of all vertices: the selected inverse, block by block.
//!
//! ```text
//! S = L Lᵀ,   Z = S⁻¹ on the pattern of L, last block first.   J: the columns of a block, R: its rows below
//! Y = L_RJ L_JJ⁻¹
//! Z_RJ = −Z_RR Y
//! Z_JJ = L_JJ⁻ᵀ L_JJ⁻¹ − Yᵀ Z_RJ
//! ```
//!
//! `Z_RR` lies on the pattern of `L` again, in later blocks, so nothing outside it is computed: the cost is that of
//! a few factorisations instead of `Q` solves, and consists of dense products. Source: Takahashi, Fagan and Chen (1973); Erisman and
//! Tinney (1975).

use faer::linalg::matmul::matmul;
use faer::linalg::triangular_solve::{
    solve_lower_triangular_in_place, solve_upper_triangular_in_place,
};
use faer::sparse::linalg::cholesky::supernodal::{SupernodalLltRef, SymbolicSupernodalCholesky};
use faer::{Accum, Mat, MatMut, MatRef, Par};

/// Diagonal of `S⁻¹`, in the order of the factor.
pub(crate) fn selected_diagonal(
    symbolic: &SymbolicSupernodalCholesky<usize>,
    factor: &[f64],
) -> Vec<f64> {
    let mut selected = Selected::new(symbolic);
    let llt = SupernodalLltRef::new(symbolic, factor);
    let mut diagonal = vec![0.0; symbolic.nrows()];
    for block in (0..symbolic.n_supernodes()).rev() {
        let node = llt.supernode(block);
        let width = node.val().ncols();
        let (top, below) = node.val().split_at_row(width);
        let corner = selected.corner(node.pattern());
        let mut y = below.to_owned();
        solve_upper_triangular_in_place(top.transpose(), y.transpose_mut(), Par::Seq);
        let mut inverse = Mat::identity(width, width);
        solve_lower_triangular_in_place(top, inverse.as_mut(), Par::Seq);
        let (mut z_top, mut z_below) = selected.block_mut(block).split_at_row_mut(width);
        matmul(
            z_below.as_mut(),
            Accum::Replace,
            &corner,
            &y,
            -1.0,
            Par::Seq,
        );
        matmul(
            z_top.as_mut(),
            Accum::Replace,
            inverse.transpose(),
            &inverse,
            1.0,
            Par::Seq,
        );
        matmul(
            z_top.as_mut(),
            Accum::Add,
            y.transpose(),
            &z_below,
            -1.0,
            Par::Seq,
        );
        for k in 0..width {
            diagonal[node.start() + k] = z_top[(k, k)];
        }
    }
    diagonal
}

/// The index of the block of every column.
pub(crate) fn block_of(symbolic: &SymbolicSupernodalCholesky<usize>) -> Vec<usize> {
    let mut block = vec![0; symbolic.nrows()];
    let ends = symbolic.supernode_end().iter();
    for (s, (&begin, &end)) in symbolic.supernode_begin().iter().zip(ends).enumerate() {
        block[begin..end].fill(s);
    }
    block
}

/// `Z` in the layout of the factor.
struct Selected<'a> {
    symbolic: &'a SymbolicSupernodalCholesky<usize>,
    values: Vec<f64>,
    /// The index of the block of every column.
    block: Vec<usize>,
}

impl<'a> Selected<'a> {
    fn new(symbolic: &'a SymbolicSupernodalCholesky<usize>) -> Self {
        Self {
            symbolic,
            values: vec![0.0; symbolic.len_val()],
            block: block_of(symbolic),
        }
    }

    fn block_mut(&mut self, s: usize) -> MatMut<'_, f64> {
        let (begin, end) = (
            self.symbolic.supernode_begin()[s],
            self.symbolic.supernode_end()[s],
        );
        let range = self.symbolic.col_ptr_for_val()[s]..self.symbolic.col_ptr_for_val()[s + 1];
        let height = range.len() / (end - begin);
        MatMut::from_column_major_slice_mut(&mut self.values[range], height, end - begin)
    }

    /// `Z_RR` for the rows of a block: column by column from the later blocks that contain them.
    fn corner(&self, rows: &[usize]) -> Mat<f64> {
        let mut corner = Mat::zeros(rows.len(), rows.len());
        let mut places = vec![0; rows.len()];
        let mut first = 0;
        while first < rows.len() {
            let s = self.block[rows[first]];
            let node = SupernodalLltRef::new(self.symbolic, &self.values).supernode(s);
            let (begin, width) = (node.start(), node.val().ncols());
            let own = rows[first..].partition_point(|&r| r < begin + width);
            // Both lists ascend, and the rows beyond a block's columns are among its own rows.
            let mut at = 0;
            for (place, &r) in places[first..].iter_mut().zip(&rows[first..]) {
                *place = if r < begin + width {
                    r - begin
                } else {
                    at += node.pattern()[at..].partition_point(|&p| p < r);
                    width + at
                };
            }
            for k in first..first + own {
                let column: MatRef<f64> = node.val().subcols(rows[k] - begin, 1);
                for (i, &place) in places.iter().enumerate().skip(k) {
                    let z = column[(place, 0)];
                    corner[(i, k)] = z;
                    corner[(k, i)] = z;
                }
            }
            first += own;
        }
        corner
    }
}
