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

use nalgebra::DMatrix;

use crate::Error;
use crate::plane_contact::PlaneContact;
use crate::rows::Stack;
use crate::system::{Factor, System};

/// Sine of the angle to the normal below which the model treats a row as parallel to the normal.
const TILT: f64 = 0.3;

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
        let count = influence.vertices.len();
        let terms = Terms::new(self.stack, of, influence);
        let mut entries = DMatrix::zeros(of.len(), new);
        let (mut normal, mut along) = (vec![0.0; count], vec![[0.0; 2]; count]);
        for l in 0..new {
            normal.fill(0.0);
            for &(slot, a) in terms.normal(old + l) {
                for (sum, s) in normal.iter_mut().zip(column_of(&influence.free, slot)) {
                    *sum += a * s;
                }
            }
            along.fill([0.0; 2]);
            for &(slot, [x, y]) in terms.along(old + l) {
                for (sum, s) in along.iter_mut().zip(column_of(&influence.full, slot)) {
                    sum[0] += x * s;
                    sum[1] += y * s;
                }
            }
            let column = &mut entries.as_mut_slice()[of.len() * l..];
            for (k, entry) in column[..=old + l].iter_mut().enumerate() {
                let tilted = terms.along(k).iter();
                let level = tilted.map(|&(w, [x, y])| x * along[w][0] + y * along[w][1]);
                let upright = terms.normal(k).iter().map(|&(w, a)| a * normal[w]);
                *entry = level.sum::<f64>() + upright.sum::<f64>();
            }
        }
        Ok(entries)
    }

    /// Entries of `S⁻¹` (of the free vertices, along the normal) in the rows `of` and the columns `new`, which are a subset of them.
    fn inverse(&mut self, of: &[u32], new: &[u32], normal: bool) -> Result<DMatrix<f64>, Error> {
        // A resting vertex does not move along the normal under any force.
        let moves = |v: u32| !(normal && self.table.rests(v));
        let moving: Vec<usize> = (0..new.len()).filter(|&l| moves(new[l])).collect();
        let chosen: Vec<u32> = moving.iter().map(|&l| new[l]).collect();
        let factor = self.table.factor_along(self.factor, normal);
        let mut entries = DMatrix::zeros(of.len(), new.len());
        if of.len() == new.len() {
            let found = self.system.selected_inverse(factor, &chosen)?;
            for (column, &l) in found.column_iter().zip(&moving) {
                for (value, &k) in column.iter().zip(&moving) {
                    entries[(k, l)] = *value;
                }
            }
            return Ok(entries);
        }
        let size = self.system.pattern.size();
        let mut block = vec![0.0; size * chosen.len()];
        for (column, &v) in block.chunks_exact_mut(size).zip(&chosen) {
            column[v as usize] = 1.0;
        }
        self.system.solve(factor, &mut block);
        for (column, &l) in block.chunks_exact(size).zip(&moving) {
            for (k, &v) in of.iter().enumerate() {
                entries[(k, l)] = column[v as usize];
            }
        }
        Ok(entries)
    }
}

/// A column as a slice: iterators of matrices are several times slower.
fn column_of(matrix: &DMatrix<f64>, column: usize) -> &[f64] {
    let height = matrix.nrows();
    &matrix.as_slice()[height * column..height * (column + 1)]
}

/// Rows by the index of their vertices in the model: components along the normal, and those along the plane that the model does not omit.
struct Terms {
    normal: Vec<(usize, f64)>,
    along: Vec<(usize, [f64; 2])>,
    /// The first of both for each row, and one past the last.
    starts: Vec<[usize; 2]>,
}

impl Terms {
    fn new(stack: &Stack, rows: &[usize], influence: &Influence) -> Self {
        let mut terms = Self {
            normal: vec![],
            along: vec![],
            starts: vec![[0; 2]],
        };
        for &row in rows {
            for &(v, a) in stack.row(row) {
                let slot = influence.slots[v as usize] as usize;
                terms.normal.push((slot, a.z));
                if influence.tilted[slot] {
                    terms.along.push((slot, [a.x, a.y]));
                }
            }
            terms.starts.push([terms.normal.len(), terms.along.len()]);
        }
        terms
    }

    fn normal(&self, row: usize) -> &[(usize, f64)] {
        &self.normal[self.starts[row][0]..self.starts[row + 1][0]]
    }

    fn along(&self, row: usize) -> &[(usize, [f64; 2])] {
        &self.along[self.starts[row][1]..self.starts[row + 1][1]]
    }
}

/// Entries of `S⁻¹` and `S_free⁻¹` among the vertices of the included rows.
pub(crate) struct Influence {
    vertices: Vec<u32>,
    /// Index of each vertex among them, `u32::MAX` for those in no row.
    slots: Vec<u32>,
    /// Both with room for more vertices.
    full: DMatrix<f64>,
    free: DMatrix<f64>,
    /// Vertices on which a row has a component along the plane of more than [`TILT`]; for the others the model omits `full`.
    tilted: Vec<bool>,
    /// Resting vertices for which `free` was computed.
    resting: Vec<bool>,
}

impl Influence {
    pub fn new(size: usize) -> Self {
        Self {
            vertices: vec![],
            slots: vec![u32::MAX; size],
            full: DMatrix::zeros(0, 0),
            free: DMatrix::zeros(0, 0),
            tilted: vec![],
            resting: vec![],
        }
    }

    /// Renews a model that no longer helps: for the present set of the plane, or, if it was made for that, with the omitted components along the plane.
    pub fn renew(&mut self, compliance: &mut Compliance) -> Result<(), Error> {
        if self.resting != compliance.table.set() {
            self.free = compliance.inverse(&self.vertices, &self.vertices, true)?;
            self.resting = compliance.table.set().to_vec();
        } else if self.tilted.contains(&false) {
            self.tilted.fill(true);
            self.full = compliance.inverse(&self.vertices, &self.vertices, false)?;
        }
        Ok(())
    }

    fn learn(&mut self, compliance: &mut Compliance, rows: &[usize]) -> Result<(), Error> {
        let old = self.vertices.len();
        for &k in rows {
            for &(v, a) in compliance.stack.row(k) {
                let tilted = a.xy().norm() > TILT * a.norm();
                let slot = self.slots[v as usize] as usize;
                if slot >= self.vertices.len() {
                    self.slots[v as usize] = self.vertices.len() as u32;
                    self.vertices.push(v);
                    self.tilted.push(tilted);
                } else if slot >= old {
                    self.tilted[slot] |= tilted;
                }
            }
        }
        if old == self.vertices.len() {
            return Ok(());
        }
        if old == 0 {
            self.resting = compliance.table.set().to_vec();
        }
        let all: Vec<usize> = (0..self.vertices.len()).collect();
        self.extend(compliance, &all, old, true)?;
        // Omitted on both sides or on none: the model stays symmetric and positive.
        let tilted: Vec<usize> = all.into_iter().filter(|&k| self.tilted[k]).collect();
        self.extend(compliance, &tilted, old, false)
    }

    /// Adds entries among the vertices `of` for those from index `old` on.
    fn extend(
        &mut self,
        compliance: &mut Compliance,
        of: &[usize],
        old: usize,
        normal: bool,
    ) -> Result<(), Error> {
        let new = &of[of.partition_point(|&k| k < old)..];
        let named = |at: &[usize]| at.iter().map(|&k| self.vertices[k]).collect::<Vec<_>>();
        let columns = compliance.inverse(&named(of), &named(new), normal)?;
        let count = self.vertices.len();
        let known = if normal {
            &mut self.free
        } else {
            &mut self.full
        };
        if known.ncols() < count {
            // A few vertices are added time and again: with room for them the model is copied once or twice.
            let room = count + count / 8;
            *known = std::mem::take(known).resize(room, room, 0.0);
        }
        let all_new = of.len() == new.len();
        for (column, &l) in columns.column_iter().zip(new) {
            for (value, &k) in column.iter().zip(of) {
                known[(k, l)] = *value;
                if !all_new {
                    known[(l, k)] = *value;
                }
            }
        }
        Ok(())
    }
}
