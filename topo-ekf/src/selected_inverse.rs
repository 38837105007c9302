//! Entries of the inverse among selected vertices: half a solve for each, along the elimination tree.
//!
//! ```text
//! S = L Lᵀ,   X = L⁻¹ E_C        E_C: the unit columns of the vertices C
//! (S⁻¹)_CC = Xᵀ X
//! ```
//!
//! Column `c` of `X` is zero outside the path from `c` to the root of the elimination tree. With the vertices in elimination
//! order, those below a block of the factor form an interval, so `X` is a row of dense blocks and both steps are
//! dense products. The backward substitution and the rows that are not needed are never computed.

use faer::linalg::matmul::{matmul, triangular};
use faer::linalg::triangular_solve::solve_lower_triangular_in_place;
use faer::sparse::linalg::cholesky::supernodal::{SupernodalLltRef, SymbolicSupernodalCholesky};
use faer::{Accum, MatMut, Par};

use crate::marginal::block_of;

/// Memory for repeated use: fresh memory of this size would take as long to be mapped as the entries to be computed.
#[derive(Default)]
pub(crate) struct Workspace {
    columns: Vec<f64>,
    update: Vec<f64>,
    product: Vec<f64>,
}

/// Columns and rows that are mirrored together, so that both lie in the nearest memory.
const TILE: usize = 16;

/// `(S⁻¹)_CC` by columns, for ascending indices in the order of the factor.
pub(crate) fn selected_inverse<'a>(
    symbolic: &SymbolicSupernodalCholesky<usize>,
    factor: &[f64],
    places: &[usize],
    work: &'a mut Workspace,
) -> &'a [f64] {
    let count = places.len();
    let Workspace {
        columns,
        update,
        product,
    } = work;
    let llt = SupernodalLltRef::new(symbolic, factor);
    let mut columns = Columns::new(symbolic, &llt, places, columns);
    product.clear();
    product.resize(count * count, 0.0);
    let mut square = MatMut::from_column_major_slice_mut(product, count, count);
    for s in 0..symbolic.n_supernodes() {
        let (first, end) = columns.ranges[s];
        if first >= end {
            continue;
        }
        let node = llt.supernode(s);
        let width = node.val().ncols();
        let (top, below) = node.val().split_at_row(width);
        let (own, mut later) = columns.split(s);
        let mut own = MatMut::from_column_major_slice_mut(own, width, end - first);
        solve_lower_triangular_in_place(top, own.as_mut(), Par::Seq);
        update.resize(below.nrows() * (end - first), 0.0);
        let mut out = MatMut::from_column_major_slice_mut(update, below.nrows(), end - first);
        matmul(
            out.as_mut(),
            Accum::Replace,
            below,
            own.as_ref(),
            -1.0,
            Par::Seq,
        );
        later.add(node.pattern(), update, first);
        triangular::matmul(
            square
                .as_mut()
                .submatrix_mut(first, first, end - first, end - first),
            triangular::BlockStructure::TriangularLower,
            Accum::Add,
            own.as_ref().transpose(),
            triangular::BlockStructure::Rectangular,
            own.as_ref(),
            triangular::BlockStructure::Rectangular,
            1.0,
            Par::Seq,
        );
    }
    mirror(product, count);
    product
}

/// Copies the lower triangle to the upper one.
fn mirror(square: &mut [f64], count: usize) {
    for first in (0..count).step_by(TILE) {
        let end = count.min(first + TILE);
        for top in (first..count).step_by(TILE) {
            for column in first..end {
                for row in top.max(column + 1)..count.min(top + TILE) {
                    square[count * row + column] = square[count * column + row];
                }
            }
        }
    }
}

/// `X`: for every block of the factor the columns below it, column-major.
struct Columns<'a> {
    symbolic: &'a SymbolicSupernodalCholesky<usize>,
    /// The index of the block of every column.
    block: Vec<usize>,
    /// The first and one past the last non-zero column in a block; empty where there is none.
    ranges: Vec<(usize, usize)>,
    starts: Vec<usize>,
    values: &'a mut Vec<f64>,
}

impl<'a> Columns<'a> {
    fn new(
        symbolic: &'a SymbolicSupernodalCholesky<usize>,
        llt: &SupernodalLltRef<usize, f64>,
        places: &[usize],
        values: &'a mut Vec<f64>,
    ) -> Self {
        let block = block_of(symbolic);
        let (begin, end) = (symbolic.supernode_begin(), symbolic.supernode_end());
        let mut ranges = vec![(usize::MAX, 0); begin.len()];
        let widen = |range: &mut (usize, usize), by: (usize, usize)| {
            *range = (range.0.min(by.0), range.1.max(by.1));
        };
        for (k, &place) in places.iter().enumerate() {
            widen(&mut ranges[block[place]], (k, k + 1));
        }
        let mut starts = vec![0];
        for s in 0..begin.len() {
            let range = ranges[s];
            // The first row below belongs to the parent in the tree.
            if let Some(&row) = llt.supernode(s).pattern().first() {
                widen(&mut ranges[block[row]], range);
            }
            starts.push(starts[s] + (end[s] - begin[s]) * range.1.saturating_sub(range.0));
        }
        values.clear();
        values.resize(starts[begin.len()], 0.0);
        for (k, &place) in places.iter().enumerate() {
            let s = block[place];
            values[starts[s] + (k - ranges[s].0) * (end[s] - begin[s]) + place - begin[s]] = 1.0;
        }
        Self {
            symbolic,
            block,
            ranges,
            starts,
            values,
        }
    }

    /// The values of block `s` and those of all later ones.
    fn split(&mut self, s: usize) -> (&mut [f64], Later<'_>) {
        let base = self.starts[s + 1];
        let (before, values) = self.values.split_at_mut(base);
        let later = Later {
            symbolic: self.symbolic,
            block: &self.block,
            ranges: &self.ranges,
            starts: &self.starts,
            base,
            values,
        };
        (&mut before[self.starts[s]..], later)
    }
}

/// Blocks that have not been reached yet.
struct Later<'a> {
    symbolic: &'a SymbolicSupernodalCholesky<usize>,
    block: &'a [usize],
    ranges: &'a [(usize, usize)],
    starts: &'a [usize],
    base: usize,
    values: &'a mut [f64],
}

impl Later<'_> {
    /// Adds the contribution of an earlier block to these rows in the columns from `first` on, column-major.
    fn add(&mut self, rows: &[usize], update: &[f64], first: usize) {
        let mut done = 0;
        while done < rows.len() {
            let s = self.block[rows[done]];
            let (begin, end) = (
                self.symbolic.supernode_begin()[s],
                self.symbolic.supernode_end()[s],
            );
            let count = rows[done..].partition_point(|&r| r < end);
            let start = self.starts[s] - self.base + (first - self.ranges[s].0) * (end - begin);
            let own = self.values[start..].chunks_exact_mut(end - begin);
            for (column, from) in own.zip(update.chunks_exact(rows.len())) {
                for (&row, u) in rows[done..done + count].iter().zip(&from[done..]) {
                    column[row - begin] += u;
                }
            }
            done += count;
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests")]

    use nalgebra::Point3;

    use crate::system::System;

    /// Two sheets and a lone vertex, entries among vertices in any order, against a solve per column.
    #[test]
    fn entries_are_those_of_the_solves() {
        let side = 14_u32;
        let half = side * side;
        let (mut points, mut edges) = (vec![], vec![]);
        for sheet in 0..2 {
            for k in 0..half {
                let (x, y) = (k % side, k / side);
                points.push(Point3::new(f64::from(x), f64::from(y), f64::from(sheet)));
                let at = sheet * half + k;
                edges.extend((x + 1 < side).then_some([at, at + 1]));
                edges.extend((y + 1 < side).then_some([at + side, at]));
            }
        }
        points.push(Point3::origin());
        let size = points.len();
        let mut system = System::new(&points, &edges).unwrap();
        let diagonal: Vec<f64> = (0..size).map(|i| 0.1 + (i % 7) as f64).collect();
        let values = system
            .pattern
            .assemble(&diagonal, &edges, |e| 1.0 + (e % 5) as f64);
        let factor = system.factorise(&values).unwrap();
        let last = size as u32 - 1;
        let few = vec![last, 3, 200, 17];
        let many: Vec<u32> = (0..last).map(|k| k * 101 % last).take(150).collect();
        for vertices in [vec![], vec![5], few, many] {
            let found = system.selected_inverse(&factor, &vertices).unwrap();
            for (l, &v) in vertices.iter().enumerate() {
                let mut column = vec![0.0; size];
                column[v as usize] = 1.0;
                system.solve(&factor, &mut column);
                for (k, &w) in vertices.iter().enumerate() {
                    let error = found[(k, l)] - column[w as usize];
                    assert!(error.abs() < 1e-14, "{w} {v}: {error}");
                }
            }
        }
    }
}
