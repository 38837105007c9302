//! Rows of the projection: half-spaces over a few vertices, in the frame of the main plane.
//!
//! ```text
//! row k      Σ_v a_kv · x_v ≥ b_k                gap   g_k = b_k − Σ_v a_kv · x̂_v
//! forces     f = Aᵀ λ                            reach A d: reduction of the gaps by a displacement d
//! ```
//!
//! Displacements and forces are blocks of three columns: two along the main plane and, last, its normal.

use nalgebra::{Matrix3, Point3, Vector3};

use crate::observation::{Inequality, Plane};

/// Identifies a row, so that its force can be reused in the next linearisation and in the next frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Key {
    /// A vertex against the surface.
    Contact(u32),
    /// A vertex against a plane (position in the list).
    Plane(u32, u32),
    /// An inequality of the caller (position in the list).
    Own(u32),
}

/// Softness of a row relative to its compliance with everything around it fixed. A single row that is violated by 1 mm keeps about
/// 1e-9 m of it; infeasible rows share the remainder by least squares.
const SOFT: f64 = 2e-5;
/// The same for contacts. Two sheets in contact constrain each other from both sides: their rows are nearly equal, and this softness keeps
/// their forces unique. The gap that it leaves is covered by the reserve of contacts ([`crate::constrain`]).
const SOFT_CONTACT: f64 = 3e-3;

/// Separation required of a contact in excess, m: the triangle turns during the projection, and softness leaves a part of the
/// gap; this reserve covers both. Without it every contact would be linearised once or twice more for the last micrometre.
pub(crate) const SPARE: f64 = 2e-5;
/// Largest remaining violation, m.
pub(crate) const FEASIBLE: f64 = 1e-6;

/// `Σ a · x_vertex ≥ bound`.
#[derive(Clone, Debug)]
pub(crate) struct Row {
    pub key: Key,
    pub terms: Vec<(u32, Vector3<f64>)>,
    pub bound: f64,
}

impl Row {
    /// Violation of the row; negative where it holds.
    pub fn gap(&self, positions: &[Point3<f64>]) -> f64 {
        let sum: f64 = self
            .terms
            .iter()
            .map(|&(v, a)| a.dot(&positions[v as usize].coords))
            .sum();
        self.bound - sum
    }

    /// Compliance of the row itself, relative.
    pub fn softness(&self) -> f64 {
        match self.key {
            Key::Contact(_) => SOFT_CONTACT,
            Key::Plane(..) | Key::Own(_) => SOFT,
        }
    }

    /// Tolerance of a gap, m.
    pub fn tolerance(&self) -> f64 {
        match self.key {
            Key::Contact(_) => SPARE + FEASIBLE,
            Key::Plane(..) | Key::Own(_) => FEASIBLE,
        }
    }

    /// The caller's inequality in metres: divided by its largest coefficient.
    pub fn of(inequality: &Inequality, index: usize) -> Self {
        let unit = 1.0 / inequality.largest();
        Self {
            key: Key::Own(index as u32),
            terms: inequality
                .terms
                .iter()
                .map(|&(v, a)| (v, a * unit))
                .collect(),
            bound: inequality.bound * unit,
        }
    }
}

/// A plane as one row per vertex.
pub(crate) fn plane_rows(
    plane: &Plane,
    index: usize,
    vertices: usize,
) -> impl Iterator<Item = Row> + use<> {
    let (direction, bound, index) = (plane.normal.into_inner(), -plane.offset, index as u32);
    (0..vertices as u32).map(move |v| Row {
        key: Key::Plane(index, v),
        terms: vec![(v, direction)],
        bound,
    })
}

/// Largest violation among the rows, 0 if none.
pub(crate) fn deepest_gap(rows: &[Row], positions: &[Point3<f64>]) -> f64 {
    rows.iter().map(|r| r.gap(positions)).fold(0.0, f64::max)
}

/// The concatenated rows, rotated into the frame of the main plane.
pub(crate) struct Stack {
    starts: Vec<usize>,
    terms: Vec<(u32, Vector3<f64>)>,
}

impl Stack {
    /// `basis` rotates into the frame whose third axis is the normal of the main plane.
    pub fn new(rows: &[Row], basis: &Matrix3<f64>) -> Self {
        let (mut starts, mut terms) = (vec![0], vec![]);
        for row in rows {
            terms.extend(row.terms.iter().map(|&(v, a)| (v, basis * a)));
            starts.push(terms.len());
        }
        Self { starts, terms }
    }

    pub fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// Terms of row `k`.
    pub fn row(&self, k: usize) -> &[(u32, Vector3<f64>)] {
        &self.terms[self.starts[k]..self.starts[k + 1]]
    }

    /// `Aᵀ λ` for `size` vertices.
    pub fn push(&self, forces: &[f64], size: usize) -> Vec<f64> {
        let mut block = vec![0.0; 3 * size];
        for (k, &force) in forces.iter().enumerate().filter(|(_, f)| **f != 0.0) {
            for (v, a) in self.row(k) {
                let v = *v as usize;
                block[v] += force * a.x;
                block[size + v] += force * a.y;
                block[2 * size + v] += force * a.z;
            }
        }
        block
    }

    /// `A d`.
    pub fn reach(&self, block: &[f64]) -> Vec<f64> {
        let size = block.len() / 3;
        let dot = |&(v, a): &(u32, Vector3<f64>)| {
            let v = v as usize;
            a.x * block[v] + a.y * block[size + v] + a.z * block[2 * size + v]
        };
        (0..self.len())
            .map(|k| self.row(k).iter().map(dot).sum())
            .collect()
    }
}
