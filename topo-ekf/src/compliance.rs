//! Compliance of the rows under forces, `G = A S⁻¹ Aᵀ`, as an operator and as a dense model.
//!
//! A product with `G` is one sparse solve with three columns, however many rows there are. A dense model of `G` ([`crate::dual`]) needs
//! the entries of `S⁻¹` among the vertices of the rows:
//!
//! ```text
//! G_kl = Σ_vw (a_kv,t · a_lw,t) (S⁻¹)_vw + a_kv,n a_lw,n (S_free⁻¹)_vw         t: along the plane, n: along its normal
//! ```
//!
//! Those of one factor are computed together ([`crate::selected_inverse`]), a few more by a solve each: sheets in contact share vertices among many
//! rows, resting vertices have no column along the normal, and another linearisation needs no new solve.

use nalgebra::{DMatrix, Vector3};

use crate::Error;
use crate::plane_contact::PlaneContact;
use crate::rows::Stack;
use crate::selected_inverse::Workspace;
use crate::system::{Factor, System};

/// The operator for the present set of vertices on the plane.
pub(crate) struct Compliance<'a> {
    pub stack: &'a Stack,
    pub table: &'a PlaneContact,
    pub factor: &'a Factor,
    pub system: &'a mut System,
}

impl Compliance<'_> {
    /// The displacement under forces of the rows, as a block, and `G λ`.
    pub fn times(&mut self, forces: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let mut block = self.stack.push(forces, self.system.pattern.size());
        self.table.respond(self.factor, self.system, &mut block);
        let reach = self.stack.reach(&block);
        (block, reach)
    }

    /// Entries of `G` in the rows `of` and the columns of the last `new` of them, without those below the diagonal; vertices that are new to `influence` are
    /// added to it.
    pub fn columns(
        &mut self,
        of: &[usize],
        new: usize,
        influence: &mut Influence,
    ) -> Result<DMatrix<f64>, Error> {
        let old = of.len() - new;
        influence.learn(self, &of[old..])?;
        let terms = Terms::new(self.stack, of, influence);
        let mut entries = DMatrix::zeros(of.len(), new);
        // By coordinate, so that neighbouring vertices are added together.
        let mut moved: [Vec<f64>; 3] = Default::default();
        for l in 0..new {
            // Vertices of later rows are mostly later ones.
            for m in &mut moved {
                m.resize(terms.ends[old + l], 0.0);
            }
            influence.move_by(terms.row(old + l), &mut moved);
            let [x, y, z] = &moved;
            let column = &mut entries.as_mut_slice()[of.len() * l..];
            for (k, entry) in column[..=old + l].iter_mut().enumerate() {
                let part = |&(w, a): &(usize, Vector3<f64>)| a.x * x[w] + a.y * y[w] + a.z * z[w];
                *entry = terms.row(k).iter().map(part).sum();
            }
        }
        Ok(entries)
    }
}

/// Rows by the index of their vertices in the model.
struct Terms {
    pairs: Vec<(usize, Vector3<f64>)>,
    /// The first for each row, and one past the last.
    starts: Vec<usize>,
    /// For each row, one past the last vertex in it and in those before.
    ends: Vec<usize>,
}

impl Terms {
    fn new(stack: &Stack, rows: &[usize], influence: &Influence) -> Self {
        let (mut pairs, mut starts, mut ends) = (vec![], vec![0], vec![]);
        let mut end = 0;
        for &row in rows {
            let slot = |v: u32| influence.slots[v as usize] as usize;
            pairs.extend(stack.row(row).iter().map(|&(v, a)| (slot(v), a)));
            let own = pairs[starts[starts.len() - 1]..]
                .iter()
                .map(|t: &(usize, _)| t.0 + 1);
            end = own.fold(end, usize::max);
            starts.push(pairs.len());
            ends.push(end);
        }
        Self {
            pairs,
            starts,
            ends,
        }
    }

    fn row(&self, row: usize) -> &[(usize, Vector3<f64>)] {
        &self.pairs[self.starts[row]..self.starts[row + 1]]
    }
}

/// Entries of `S⁻¹` and `S_free⁻¹` among the vertices of the included rows. The memory is kept from frame to frame.
#[derive(Default)]
pub(crate) struct Influence {
    vertices: Vec<u32>,
    /// Index of each vertex among them, `u32::MAX` for those in no row.
    slots: Vec<u32>,
    full: Square,
    free: Square,
    /// Resting vertices for which `free` was computed.
    resting: Vec<bool>,
    work: Workspace,
}

impl Influence {
    /// Without vertices, for a metric of this size.
    pub fn emptied(mut self, size: usize) -> Self {
        self.vertices.clear();
        self.slots.clear();
        self.slots.resize(size, u32::MAX);
        self
    }

    /// Whether it was computed for another set of resting vertices.
    pub fn outdated(&self, table: &PlaneContact) -> bool {
        !self.vertices.is_empty() && self.resting != table.set()
    }

    /// Renews an outdated model.
    pub fn renew(&mut self, compliance: &Compliance) -> Result<(), Error> {
        if self.outdated(compliance.table) {
            self.fill(compliance, true)?;
            compliance.table.set().clone_into(&mut self.resting);
        }
        Ok(())
    }

    /// Displacements of the vertices under a unit force of a row.
    fn move_by(&self, row: &[(usize, Vector3<f64>)], moved: &mut [Vec<f64>; 3]) {
        for m in &mut *moved {
            m.fill(0.0);
        }
        let [x, y, z] = moved;
        // Two terms in one pass over the vertices.
        for pair in row.chunks(2) {
            let (s, a) = pair[0];
            let (t, b) = pair.get(1).copied().unwrap_or((s, Vector3::zeros()));
            let full = [self.full.column(s), self.full.column(t)];
            add(x, [a.x, b.x], full);
            add(y, [a.y, b.y], full);
            add(z, [a.z, b.z], [self.free.column(s), self.free.column(t)]);
        }
    }

    fn learn(&mut self, compliance: &mut Compliance, rows: &[usize]) -> Result<(), Error> {
        let old = self.vertices.len();
        for &k in rows {
            for &(v, _) in compliance.stack.row(k) {
                if self.slots[v as usize] == u32::MAX {
                    self.slots[v as usize] = self.vertices.len() as u32;
                    self.vertices.push(v);
                }
            }
        }
        if old == self.vertices.len() {
            return Ok(());
        }
        if old == 0 {
            compliance.table.set().clone_into(&mut self.resting);
            self.fill(compliance, false)?;
            return self.fill(compliance, true);
        }
        self.extend(compliance, old, false);
        self.extend(compliance, old, true);
        Ok(())
    }

    /// Computes all entries, of the free vertices along the normal.
    fn fill(&mut self, compliance: &Compliance, normal: bool) -> Result<(), Error> {
        // A resting vertex does not move along the normal under any force.
        let moves = |v: u32| !(normal && compliance.table.rests(v));
        let count = self.vertices.len();
        let moving: Vec<usize> = (0..count).filter(|&k| moves(self.vertices[k])).collect();
        let chosen: Vec<u32> = moving.iter().map(|&k| self.vertices[k]).collect();
        let known = if normal {
            &mut self.free
        } else {
            &mut self.full
        };
        known.resize(count);
        let factor = compliance.table.factor_along(compliance.factor, normal);
        let system = &compliance.system;
        let selected = system.selected(factor, &chosen, &mut self.work)?;
        // Columns of vertices that do not move, and of the room for more, are zero. Each is written once.
        let mut still = vec![true; known.room];
        for (l, &at) in moving.iter().enumerate() {
            still[at] = false;
            let column = known.column_mut(at);
            column.fill(0.0);
            for (&k, value) in moving.iter().zip(selected.column(l)) {
                column[k] = value;
            }
        }
        for at in (0..known.room).filter(|&at| still[at]) {
            known.column_mut(at).fill(0.0);
        }
        Ok(())
    }

    /// Adds the entries of the vertices from index `old` on, by a solve for each.
    fn extend(&mut self, compliance: &mut Compliance, old: usize, normal: bool) {
        let moves = |v: u32| !(normal && compliance.table.rests(v));
        let count = self.vertices.len();
        let moving: Vec<usize> = (old..count).filter(|&k| moves(self.vertices[k])).collect();
        let size = compliance.system.pattern.size();
        let mut block = vec![0.0; size * moving.len()];
        for (column, &l) in block.chunks_exact_mut(size).zip(&moving) {
            column[self.vertices[l] as usize] = 1.0;
        }
        let factor = compliance.table.factor_along(compliance.factor, normal);
        compliance.system.solve(factor, &mut block);
        let known = if normal {
            &mut self.free
        } else {
            &mut self.full
        };
        known.widen(old, count);
        for (column, &l) in block.chunks_exact(size).zip(&moving) {
            for (k, &v) in self.vertices.iter().enumerate() {
                if moves(v) {
                    known.set(k, l, column[v as usize]);
                    known.set(l, k, column[v as usize]);
                }
            }
        }
    }
}

/// Adds multiples of two columns, one after the other.
fn add(sum: &mut [f64], by: [f64; 2], columns: [&[f64]; 2]) {
    let columns = columns[0].iter().zip(columns[1]);
    for (s, (first, second)) in sum.iter_mut().zip(columns) {
        *s = (*s + by[0] * first) + by[1] * second;
    }
}

/// A square matrix with room for more rows and columns: a few are added time and again.
#[derive(Default)]
struct Square {
    room: usize,
    values: Vec<f64>,
}

impl Square {
    /// Makes room for `count` rows and columns, and for some more; the entries are to be written.
    fn resize(&mut self, count: usize) {
        self.room = count + count / 8;
        self.values.resize(self.room * self.room, 0.0);
    }

    /// Makes room for `count` rows and columns, of which the first `old` are in use; the others are zero.
    fn widen(&mut self, old: usize, count: usize) {
        if count > self.room {
            let before = std::mem::take(self);
            self.resize(count);
            for l in 0..old {
                self.values[self.room * l..][..old].copy_from_slice(&before.column(l)[..old]);
            }
        }
    }

    fn set(&mut self, row: usize, column: usize, value: f64) {
        self.values[self.room * column + row] = value;
    }

    fn column_mut(&mut self, column: usize) -> &mut [f64] {
        &mut self.values[self.room * column..self.room * (column + 1)]
    }

    fn column(&self, column: usize) -> &[f64] {
        &self.values[self.room * column..self.room * (column + 1)]
    }
}
