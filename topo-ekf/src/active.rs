//! One round of the two nested active sets.
//!
//! ```text
//! struck vertices   h_i = 0,  force of the table  (S δh)_i − Σ_k λ_k m_kn c_ki ≥ 0     else they are freed
//! other vertices    h_i ≥ 0                                                            else they are struck
//! rows              λ from the dual over G, itself an active set                       rows violated are added
//! ```

use nalgebra::{DMatrix, Vector3};

use crate::Error;
use crate::dual::{Row, solve_dual};
use crate::project::Projection;
use crate::system::{Factor, System};

/// A vertex lower than this is struck, m; it is then put exactly on the plane.
const DEPTH: f64 = 1e-9;

/// Working state of the rounds.
pub(crate) struct Active<'a> {
    problem: &'a Projection<'a>,
    /// Heights of the unconstrained estimate over the plane.
    heights: Vec<f64>,
    normal: Vector3<f64>,
    struck: Vec<bool>,
    /// Rows that were violated at some round; the dual decides which of them push.
    rows: Vec<usize>,
    pushing: Vec<bool>,
    /// `S⁻¹ c_k` of those rows, one column each.
    full: Vec<f64>,
    /// `S_free⁻¹ c_k` for the vertices struck in `factored`; unused while nothing is struck.
    over: Vec<f64>,
    factored: Vec<bool>,
    free: Option<Factor>,
    pub factorisations: usize,
}

/// Outcome of the two solves of a round.
pub(crate) struct Push {
    /// Displacement of every vertex.
    pub shift: Vec<Vector3<f64>>,
    /// Its part along the normal that comes from heights.
    lift: Vec<f64>,
    /// Forces of the rows.
    forces: Vec<f64>,
    /// Whether the dual was solved to the end.
    pub exact: bool,
}

impl<'a> Active<'a> {
    pub fn new(problem: &'a Projection<'a>, heights: Vec<f64>, struck: Vec<bool>) -> Self {
        let normal = problem
            .plane
            .map_or(Vector3::zeros(), |p| p.normal.into_inner());
        let factored = vec![false; struck.len()];
        Self {
            problem,
            heights,
            normal,
            struck,
            rows: vec![],
            pushing: vec![],
            full: vec![],
            over: vec![],
            factored,
            free: None,
            factorisations: 0,
        }
    }

    /// Vertices on the plane.
    pub fn resting(&self) -> Vec<u32> {
        (0..self.struck.len() as u32)
            .filter(|&i| self.struck[i as usize])
            .collect()
    }

    /// Rows that push.
    pub fn pushing(&self) -> Vec<usize> {
        self.rows
            .iter()
            .zip(&self.pushing)
            .filter(|(_, p)| **p)
            .map(|(&k, _)| k)
            .collect()
    }

    /// Whether any row has been violated so far.
    pub fn has_rows(&self) -> bool {
        !self.rows.is_empty()
    }

    fn row(&self, at: usize) -> &'a Row {
        &self.problem.rows[self.rows[at]]
    }

    /// Right-hand sides `c_k` of the rows from `first` on, without the entries of `without`.
    fn columns(&self, first: usize, without: &[bool]) -> Vec<f64> {
        let size = self.struck.len();
        let mut block = vec![0.0; size * (self.rows.len() - first)];
        for (column, at) in block.chunks_exact_mut(size).zip(first..) {
            for &(v, c) in &self.row(at).terms {
                if !without[v as usize] {
                    column[v as usize] += c;
                }
            }
        }
        block
    }

    /// Adds rows to the dual.
    pub fn admit(&mut self, rows: &[usize], system: &mut System) {
        let first = self.rows.len();
        self.rows.extend_from_slice(rows);
        self.pushing.resize(self.rows.len(), true);
        let mut block = self.columns(first, &vec![false; self.struck.len()]);
        system.solve(self.problem.factor, &mut block);
        self.full.extend_from_slice(&block);
    }

    /// Brings factor and columns of the free vertices up to date; what did not change is kept.
    pub fn refactor(&mut self, system: &mut System) -> Result<(), Error> {
        if self.factored != self.struck {
            self.factored.clone_from(&self.struck);
            self.over.clear();
            self.free = None;
            if self.struck.contains(&true) {
                self.factorisations += 1;
                self.free = Some(
                    system.factorise(&system.pattern.strike(self.problem.values, &self.struck))?,
                );
            }
        }
        if let Some(free) = &self.free {
            let mut block = self.columns(self.over.len() / self.struck.len(), &self.struck);
            system.solve(free, &mut block);
            self.over.extend_from_slice(&block);
        }
        Ok(())
    }

    /// Height changes with the struck vertices on the plane and nothing else pushing.
    fn lift(&self, system: &mut System) -> Vec<f64> {
        let Some(free) = &self.free else {
            return vec![0.0; self.struck.len()];
        };
        let held: Vec<f64> = self
            .struck
            .iter()
            .zip(&self.heights)
            .map(|(&s, &h)| if s { -h } else { 0.0 })
            .collect();
        let pull = system.pattern.multiply(self.problem.values, &held);
        let mut lift: Vec<f64> = self
            .struck
            .iter()
            .zip(&pull)
            .map(|(&s, &p)| if s { 0.0 } else { -p })
            .collect();
        system.solve(free, &mut lift);
        for (l, h) in lift.iter_mut().zip(&held) {
            *l += h;
        }
        lift
    }

    /// Schur complement of the rows.
    fn gram(&self, along: &[f64]) -> DMatrix<f64> {
        let size = self.struck.len();
        let over = if self.free.is_some() {
            &self.over
        } else {
            &self.full
        };
        let mut gram = DMatrix::zeros(along.len(), along.len());
        for l in 0..along.len() {
            let column = l * size..(l + 1) * size;
            let (flat, high) = (&self.full[column.clone()], &over[column]);
            for k in 0..=l {
                let tall = along[k] * along[l];
                let wide = self.row(k).direction.dot(&self.row(l).direction) - tall;
                let g = wide * self.row(k).dot(flat) + tall * self.row(k).dot(high);
                gram[(k, l)] = g;
                gram[(l, k)] = g;
            }
        }
        gram
    }

    /// Solves for the heights, then for the forces of the rows; returns the displacement both make.
    pub fn push(&mut self, system: &mut System) -> Result<Push, Error> {
        let size = self.struck.len();
        let mut lift = self.lift(system);
        let along: Vec<f64> = (0..self.rows.len())
            .map(|k| self.row(k).direction.dot(&self.normal))
            .collect();
        let gap =
            |k: usize| self.row(k).gap(self.problem.estimate) - along[k] * self.row(k).dot(&lift);
        let gaps: Vec<f64> = (0..self.rows.len()).map(gap).collect();
        let dual = solve_dual(&self.gram(&along), &gaps, &self.pushing)?;
        let over = if self.free.is_some() {
            &self.over
        } else {
            &self.full
        };
        let mut shift = vec![Vector3::zeros(); size];
        for (k, &force) in dual.forces.iter().enumerate().filter(|(_, f)| **f > 0.0) {
            let flat = (self.row(k).direction - self.normal * along[k]) * force;
            let tall = along[k] * force;
            for i in 0..size {
                shift[i] += flat * self.full[k * size + i];
                lift[i] += tall * over[k * size + i];
            }
        }
        for (s, l) in shift.iter_mut().zip(&lift) {
            *s += self.normal * *l;
        }
        self.pushing = dual.forces.iter().map(|f| *f > 0.0).collect();
        Ok(Push {
            shift,
            lift,
            forces: dual.forces,
            exact: dual.exact,
        })
    }

    /// Next sets; `true` if something changed.
    pub fn update(&mut self, push: &Push, system: &mut System) -> bool {
        let mut changed = false;
        if self.problem.plane.is_some() {
            // Force of the table on a struck vertex: what S says of the lift, less what the rows give.
            let mut table = system.pattern.multiply(self.problem.values, &push.lift);
            for (k, &force) in push.forces.iter().enumerate() {
                let row = self.row(k);
                for &(v, c) in &row.terms {
                    table[v as usize] -= force * c * row.direction.dot(&self.normal);
                }
            }
            for i in 0..table.len() {
                let below = self.heights[i] + push.lift[i] < -DEPTH;
                let next = if self.struck[i] {
                    table[i] > 0.0
                } else {
                    below
                };
                changed |= next != self.struck[i];
                self.struck[i] = next;
            }
        }
        let positions: Vec<_> = self
            .problem
            .estimate
            .iter()
            .zip(&push.shift)
            .map(|(p, d)| p + d)
            .collect();
        let mut new = self.problem.violated(&positions);
        new.retain(|k| !self.rows.contains(k));
        self.admit(&new, system);
        changed || !new.is_empty()
    }
}
