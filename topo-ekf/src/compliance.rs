//! How far the rows give under forces: `G = A S⁻¹ Aᵀ`, as an operator and as a dense model.
//!
//! A product with `G` is one sparse solve with three columns, however many rows there are. A dense model of `G` ([`crate::dual`]) needs
//! the entries of `S⁻¹` among the vertices that rows touch:
//!
//! ```text
//! G_kl = Σ_vw (a_kv,t · a_lw,t) (S⁻¹)_vw + a_kv,n a_lw,n (S_free⁻¹)_vw         t: along the plane, n: along its normal
//! ```
//!
//! That is one solve per vertex and factor: sheets that lie on each other share vertices among many rows, resting ones have no column
//! along the normal, and another linearisation costs no solve at all.

use nalgebra::DMatrix;

use crate::rows::Stack;
use crate::system::{Factor, System};
use crate::table::Table;

/// Columns that are held at once.
const BATCH: usize = 64;

/// The operator at the table's present set.
pub(crate) struct Compliance<'a> {
    pub stack: &'a Stack,
    pub table: &'a Table,
    pub factor: &'a Factor,
    pub system: &'a mut System,
}

impl Compliance<'_> {
    /// `G λ`.
    pub fn times(&mut self, forces: &[f64]) -> Vec<f64> {
        let mut block = self.stack.push(forces, self.system.pattern.size());
        self.table.respond(self.factor, self.system, &mut block);
        self.stack.reach(&block)
    }

    /// Entries of `G` in the rows `of` and the columns `new`; `influence` learns the vertices it does not know.
    pub fn columns(
        &mut self,
        of: &[usize],
        new: &[usize],
        influence: &mut Influence,
    ) -> DMatrix<f64> {
        influence.learn(self, new);
        let count = influence.vertices.len();
        let mut entries = DMatrix::zeros(of.len(), new.len());
        let mut along = vec![0.0; 3 * count];
        for (l, &row) in new.iter().enumerate() {
            along.fill(0.0);
            for (v, a) in self.stack.row(row) {
                let slot = influence.slots[*v as usize] as usize;
                let (full, free) = (influence.full.column(slot), influence.free.column(slot));
                for w in 0..count {
                    along[w] += a.x * full[w];
                    along[count + w] += a.y * full[w];
                    along[2 * count + w] += a.z * free[w];
                }
            }
            for (k, &row) in of.iter().enumerate() {
                entries[(k, l)] = self
                    .stack
                    .row(row)
                    .iter()
                    .map(|(v, a)| {
                        let w = influence.slots[*v as usize] as usize;
                        a.x * along[w] + a.y * along[count + w] + a.z * along[2 * count + w]
                    })
                    .sum();
            }
        }
        entries
    }

    /// Entries of `S⁻¹` (of the free vertices' along the normal) in the rows `of` and the columns `new`.
    fn inverse(&mut self, of: &[u32], new: &[u32], normal: bool) -> DMatrix<f64> {
        let size = self.system.pattern.size();
        let mut entries = DMatrix::zeros(of.len(), new.len());
        for (batch, first) in new.chunks(BATCH).zip((0..).step_by(BATCH)) {
            // A resting vertex does not move along the normal, whoever pushes it.
            let moving: Vec<usize> = (0..batch.len())
                .filter(|&at| !(normal && self.table.rests(batch[at])))
                .collect();
            let mut block = vec![0.0; size * moving.len()];
            for (column, &at) in block.chunks_exact_mut(size).zip(&moving) {
                column[batch[at] as usize] = 1.0;
            }
            self.table
                .respond_along(self.factor, self.system, normal, &mut block);
            for (column, &at) in block.chunks_exact(size).zip(&moving) {
                for (k, &v) in of.iter().enumerate() {
                    entries[(k, first + at)] = column[v as usize];
                }
            }
        }
        entries
    }
}

/// Entries of `S⁻¹` and `S_free⁻¹` among the vertices that rows in play touch.
pub(crate) struct Influence {
    vertices: Vec<u32>,
    /// Where each vertex stands among them, `u32::MAX` for those that no row has touched.
    slots: Vec<u32>,
    full: DMatrix<f64>,
    free: DMatrix<f64>,
}

impl Influence {
    pub fn new(size: usize) -> Self {
        Self {
            vertices: vec![],
            slots: vec![u32::MAX; size],
            full: DMatrix::zeros(0, 0),
            free: DMatrix::zeros(0, 0),
        }
    }

    /// The table's set has changed too much for the entries along the normal.
    pub fn renew(&mut self, compliance: &mut Compliance) {
        let all = self.vertices.clone();
        self.free = compliance.inverse(&all, &all, true);
    }

    fn learn(&mut self, compliance: &mut Compliance, rows: &[usize]) {
        let old = self.vertices.len();
        for &k in rows {
            for &(v, _) in compliance.stack.row(k) {
                if self.slots[v as usize] == u32::MAX {
                    self.slots[v as usize] = self.vertices.len() as u32;
                    self.vertices.push(v);
                }
            }
        }
        let new = self.vertices[old..].to_vec();
        if new.is_empty() {
            return;
        }
        for (known, normal) in [(&mut self.full, false), (&mut self.free, true)] {
            let columns = compliance.inverse(&self.vertices, &new, normal);
            let count = self.vertices.len();
            *known = std::mem::take(known).resize(count, count, 0.0);
            for l in 0..new.len() {
                for k in 0..count {
                    known[(k, old + l)] = columns[(k, l)];
                    known[(old + l, k)] = columns[(k, l)];
                }
            }
        }
    }
}
