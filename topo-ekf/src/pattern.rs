//! The sparsity pattern of the information matrix, and the matrix as an operator.
//!
//! ```text
//! S = diag(d) + Σ_e w_e (e_i − e_j)(e_i − e_j)ᵀ          one entry per vertex and one per edge of the lower triangle
//! ```
//!
//! Values are stored separately from the pattern, which the posterior, the motion and the metrics of the projection share.

/// Lower triangle of `S` in compressed columns.
#[derive(Clone, Debug)]
pub(crate) struct Pattern {
    pub starts: Vec<usize>,
    pub rows: Vec<usize>,
    /// Index of each diagonal entry, always the first in its column.
    pub diagonal: Vec<usize>,
    /// Index of each edge's entry.
    pub edge: Vec<usize>,
    /// Both triangles by rows, without the diagonal: the other vertex and the index of the entry.
    around: Vec<(u32, u32)>,
    around_starts: Vec<usize>,
}

impl Pattern {
    pub fn new(vertices: usize, edges: &[[u32; 2]]) -> Self {
        let mut columns: Vec<Vec<usize>> = (0..vertices).map(|i| vec![i]).collect();
        for &[i, j] in edges {
            columns[i.min(j) as usize].push(i.max(j) as usize);
        }
        let mut starts = vec![0];
        let mut rows = Vec::with_capacity(vertices + edges.len());
        for column in &mut columns {
            column.sort_unstable();
            column.dedup();
            rows.extend_from_slice(column);
            starts.push(rows.len());
        }
        let edge = edges
            .iter()
            .map(|&[i, j]| {
                let (column, row) = (i.min(j) as usize, i.max(j) as usize);
                starts[column]
                    + rows[starts[column]..starts[column + 1]].partition_point(|&r| r < row)
            })
            .collect();
        let diagonal = starts[..vertices].to_vec();
        let (around_starts, around) = by_rows(&starts, &rows);
        Self {
            starts,
            rows,
            diagonal,
            edge,
            around,
            around_starts,
        }
    }

    /// Vertices that share an edge with vertex `i`.
    pub fn neighbours(&self, i: usize) -> impl Iterator<Item = usize> + '_ {
        let around = &self.around[self.around_starts[i]..self.around_starts[i + 1]];
        around.iter().map(|&(j, _)| j as usize)
    }

    /// `(S v)_i` without the diagonal term.
    pub fn pull(&self, values: &[f64], v: &[f64], i: usize) -> f64 {
        self.around[self.around_starts[i]..self.around_starts[i + 1]]
            .iter()
            .map(|&(j, at)| values[at as usize] * v[j as usize])
            .sum()
    }

    pub fn size(&self) -> usize {
        self.diagonal.len()
    }

    /// `diag(d) + Σ w_e (e_i − e_j)(e_i − e_j)ᵀ`.
    pub fn assemble(
        &self,
        diagonal: &[f64],
        edges: &[[u32; 2]],
        weight: impl Fn(usize) -> f64,
    ) -> Vec<f64> {
        let mut values = vec![0.0; self.rows.len()];
        for (&at, &d) in self.diagonal.iter().zip(diagonal) {
            values[at] = d;
        }
        for (e, &[i, j]) in edges.iter().enumerate() {
            let w = weight(e);
            values[self.edge[e]] -= w;
            values[self.diagonal[i as usize]] += w;
            values[self.diagonal[j as usize]] += w;
        }
        values
    }

    /// `S v`.
    pub fn multiply(&self, values: &[f64], v: &[f64]) -> Vec<f64> {
        let mut product = vec![0.0; v.len()];
        for column in 0..self.size() {
            let first = self.starts[column];
            product[column] += values[first] * v[column];
            for at in first + 1..self.starts[column + 1] {
                let row = self.rows[at];
                product[row] += values[at] * v[column];
                product[column] += values[at] * v[row];
            }
        }
        product
    }

    /// `S` with the rows and columns of `struck` vertices replaced by those of a diagonal matrix: the system of the
    /// others when the struck ones are fixed. The pattern and therefore the symbolic factor stay the same.
    pub fn strike(&self, values: &[f64], struck: &[bool]) -> Vec<f64> {
        let mut kept = values.to_vec();
        for column in 0..self.size() {
            for at in self.starts[column] + 1..self.starts[column + 1] {
                if struck[column] || struck[self.rows[at]] {
                    kept[at] = 0.0;
                }
            }
        }
        kept
    }
}

/// Off-diagonal entries of both triangles, row after row, from the columns of the lower one; in every row those of later vertices first. A sweep in
/// ascending order then needs the vertex that it has just moved last, and need not wait for it.
fn by_rows(starts: &[usize], rows: &[usize]) -> (Vec<usize>, Vec<(u32, u32)>) {
    let size = starts.len() - 1;
    let mut lists: Vec<Vec<(u32, u32)>> = vec![vec![]; size];
    for column in 0..size {
        for at in starts[column] + 1..starts[column + 1] {
            lists[column].push((rows[at] as u32, at as u32));
        }
    }
    for column in 0..size {
        for at in starts[column] + 1..starts[column + 1] {
            lists[rows[at]].push((column as u32, at as u32));
        }
    }
    let mut ends = vec![0];
    ends.extend(lists.iter().scan(0, |end, list| {
        *end += list.len();
        Some(*end)
    }));
    (ends, lists.concat())
}
