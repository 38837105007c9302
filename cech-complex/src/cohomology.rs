//! Reduction of coboundary matrices over Z/2.
//!
//! Columns are simplices of dimension `d`, rows those of dimension `d + 1`, both numbered in filtration order. Columns are
//! taken from the last to the first; the pivot of a column is its earliest row. A column whose pivot is still free takes it without
//! reduction and is never copied: on surfaces this holds for more than nine columns in ten (the *apparent pairs* of
//! Bauer 2021, §3.5, and some more). The others are reduced with a heap. Rows that became pivots are no columns in the next dimension
//! (*clearing*, Chen and Kerber 2011).
//!
//! With cohomology in ascending dimension rather than homology in descending dimension, only the essential classes are columns that reduce to zero,
//! and the tetrahedra need no columns at all.

use crate::persistence::Order;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// No index.
pub(crate) const NONE: u32 = u32::MAX;

/// Coboundary matrix by columns; the rows of each column ascend.
pub(crate) struct Coboundary {
    offsets: Vec<u32>,
    rows: Vec<u32>,
    row_count: usize,
}

impl Coboundary {
    /// From the facets of every row, in row order; [`NONE`] stands for a facet that is not a column (relative chains).
    pub(crate) fn new<const N: usize>(columns: usize, facets: &[[u32; N]]) -> Self {
        let present = || {
            facets
                .iter()
                .flatten()
                .copied()
                .filter(|&column| column != NONE)
        };
        let offsets = crate::skeleton::runs(present(), columns);
        let mut rows = vec![0; offsets[columns] as usize];
        let mut next = offsets.clone();
        for (row, facets) in facets.iter().enumerate() {
            for &column in facets.iter().filter(|&&column| column != NONE) {
                let slot = &mut next[column as usize];
                rows[*slot as usize] = row as u32;
                *slot += 1;
            }
        }
        Self {
            offsets,
            rows,
            row_count: facets.len(),
        }
    }

    /// From the facets of every row in any order, and the ranks of both: needs no sorted copy of the facets.
    pub(crate) fn ranked<const N: usize>(
        columns: &Order,
        rows: &Order,
        facets: &[[u32; N]],
    ) -> Self {
        let by_simplex = crate::skeleton::runs(facets.iter().flatten().copied(), columns.at.len());
        let size = |&simplex: &u32| crate::skeleton::run(&by_simplex, simplex).len() as u32;
        let mut offsets = Vec::with_capacity(columns.at.len() + 1);
        let mut next = vec![0; columns.at.len()];
        let mut end = 0;
        offsets.push(end);
        for simplex in &columns.at {
            next[*simplex as usize] = end;
            end += size(simplex);
            offsets.push(end);
        }
        let mut entries = vec![0; end as usize];
        for (rank, &row) in rows.at.iter().enumerate() {
            for facet in facets[row as usize] {
                let slot = &mut next[facet as usize];
                entries[*slot as usize] = rank as u32;
                *slot += 1;
            }
        }
        Self {
            offsets,
            rows: entries,
            row_count: facets.len(),
        }
    }

    pub(crate) fn column(&self, column: u32) -> &[u32] {
        &self.rows[crate::skeleton::run(&self.offsets, column)]
    }

    fn columns(&self) -> u32 {
        self.offsets.len() as u32 - 1
    }
}

/// Result of a reduction.
pub(crate) struct Pairing {
    /// Column that holds each row as pivot, or [`NONE`].
    pub(crate) column_of_row: Vec<u32>,
    /// For every column that reduced to zero, a cocycle: the columns whose coboundaries cancel, the column itself first.
    pub(crate) essential: Vec<(u32, Vec<u32>)>,
}

/// A reduced column: what is left of it and which columns were added to it.
struct Reduced {
    rows: Vec<u32>,
    sum: Vec<u32>,
}

/// Reduces all columns except those for which `skip` is true.
pub(crate) fn reduce(matrix: &Coboundary, skip: impl Fn(u32) -> bool) -> Pairing {
    let mut pairing = Pairing {
        column_of_row: vec![NONE; matrix.row_count],
        essential: Vec::new(),
    };
    let mut reduced: Vec<Reduced> = Vec::new();
    // Index in `reduced` of the column that holds a row; NONE if that column is unreduced.
    let mut slot_of_row = vec![NONE; matrix.row_count];
    let mut heap = BinaryHeap::new();
    for column in (0..matrix.columns()).rev().filter(|&column| !skip(column)) {
        let entries = matrix.column(column);
        let Some(&first) = entries.first() else {
            pairing.essential.push((column, vec![column]));
            continue;
        };
        if pairing.column_of_row[first as usize] == NONE {
            pairing.column_of_row[first as usize] = column;
            continue;
        }
        heap.clear();
        heap.extend(entries.iter().map(|&row| Reverse(row)));
        let mut sum = vec![column];
        loop {
            let Some(pivot) = pop_pivot(&mut heap) else {
                pairing.essential.push((column, cancel(sum)));
                break;
            };
            let holder = pairing.column_of_row[pivot as usize];
            if holder == NONE {
                pairing.column_of_row[pivot as usize] = column;
                slot_of_row[pivot as usize] = reduced.len() as u32;
                reduced.push(Reduced {
                    rows: drain(pivot, &mut heap),
                    sum: cancel(sum),
                });
                break;
            }
            // The column that holds this pivot has the same first row, which has just left the heap: add its other rows.
            if let Some(addend) = reduced.get(slot_of_row[pivot as usize] as usize) {
                heap.extend(addend.rows[1..].iter().map(|&row| Reverse(row)));
                sum.extend_from_slice(&addend.sum);
            } else {
                heap.extend(matrix.column(holder)[1..].iter().map(|&row| Reverse(row)));
                sum.push(holder);
            }
        }
    }
    pairing
}

/// Smallest row that occurs an odd number of times.
pub(crate) fn pop_pivot<T: Ord>(heap: &mut BinaryHeap<Reverse<T>>) -> Option<T> {
    while let Some(top) = heap.pop() {
        if heap.peek() == Some(&top) {
            heap.pop();
        } else {
            return Some(top.0);
        }
    }
    None
}

/// The pivot and all later rows, ascending.
pub(crate) fn drain<T: Ord>(pivot: T, heap: &mut BinaryHeap<Reverse<T>>) -> Vec<T> {
    let mut rows = vec![pivot];
    while let Some(row) = pop_pivot(heap) {
        rows.push(row);
    }
    rows
}

/// Sum over Z/2: the terms that occur an odd number of times, ascending.
fn cancel(mut terms: Vec<u32>) -> Vec<u32> {
    terms.sort_unstable();
    let mut odd: Vec<u32> = Vec::with_capacity(terms.len());
    for term in terms {
        if odd.last() == Some(&term) {
            odd.pop();
        } else {
            odd.push(term);
        }
    }
    odd
}
