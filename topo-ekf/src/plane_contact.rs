//! The main plane as bounds on heights: the active set of vertices that rest on it.
//!
//! ```text
//! vertices held on the plane   h_i = 0,  force of the table  (W δh)_i − f_i ≥ 0      else they are released     f: normal forces of the rows
//! other vertices               h_i ≥ 0                                               else they are held
//! ```
//!
//! All wrong vertices change sides at once: a primal-dual active set, that is, a semismooth Newton method (Hintermüller, Ito, Kunisch
//! 2002), with the next set predicted by relaxation in the first rounds. Vertices held on the plane are removed from `W` by zeroing their rows, so that the
//! pattern and its symbolic factor stay the same. Without rows `W` is an M-matrix and the sets are monotone.

use crate::Error;
use crate::pattern::Pattern;
use crate::system::{Factor, System};

/// A vertex lower than this is held on the plane, m: it is moved exactly onto the plane.
const DEPTH: f64 = 1e-9;

/// Sweeps of the relaxation that predicts the set.
const SWEEPS: usize = 24;
/// Over-relaxation factor: 1 is Gauss–Seidel, and from 2 on it does not converge.
const OVER: f64 = 1.7;

/// Resting vertices, and the factor of the others.
pub(crate) struct PlaneContact {
    /// Heights of the unconstrained estimate above the plane; infinite without a plane.
    heights: Vec<f64>,
    /// Whether each vertex is held on the plane.
    struck: Vec<bool>,
    /// The held vertices for which `free` was computed.
    factored: Vec<bool>,
    free: Option<Factor>,
    pub factorisations: usize,
}

impl PlaneContact {
    pub fn new(heights: Vec<f64>, struck: Vec<bool>) -> Self {
        let factored = vec![false; struck.len()];
        Self {
            heights,
            struck,
            factored,
            free: None,
            factorisations: 0,
        }
    }

    /// Heights of the unconstrained estimate.
    pub fn heights(&self) -> &[f64] {
        &self.heights
    }

    /// Vertices on the plane.
    pub fn resting(&self) -> Vec<u32> {
        (0..self.struck.len() as u32)
            .filter(|&i| self.struck[i as usize])
            .collect()
    }

    /// Starting displacement of the prediction, as a block: held vertices on the plane, the others raised as in the last projection, which is
    /// usually close because the support of a table changes little from frame to frame.
    pub fn start(&self, risen: &[f64]) -> Vec<f64> {
        let size = self.struck.len();
        let mut block = vec![0.0; 3 * size];
        let normal = &mut block[2 * size..];
        if risen.len() == size {
            normal.copy_from_slice(risen);
        }
        for (v, (&s, &h)) in normal.iter_mut().zip(self.struck.iter().zip(&self.heights)) {
            *v = if s { -h } else { v.max(-h) };
        }
        block
    }

    fn held(&self) -> Vec<f64> {
        let marked = self.struck.iter().zip(&self.heights);
        marked.map(|(&s, &h)| if s { -h } else { 0.0 }).collect()
    }

    /// For every vertex, whether it rests on the plane.
    pub fn set(&self) -> &[bool] {
        &self.struck
    }

    /// Whether a vertex rests on the plane.
    pub fn rests(&self, vertex: u32) -> bool {
        self.struck[vertex as usize]
    }

    /// Sets the resting vertices from another method.
    pub fn set_resting(&mut self, struck: Vec<bool>) {
        self.struck = struck;
    }

    /// Updates the factor of the free vertices; returns whether the set had changed.
    pub fn refactor(&mut self, values: &[f64], system: &mut System) -> Result<bool, Error> {
        let changed = self.factored != self.struck;
        if changed {
            self.factored.clone_from(&self.struck);
            self.release(system);
            if self.struck.contains(&true) {
                self.factorisations += 1;
                self.free = Some(system.factorise(&system.pattern.strike(values, &self.struck))?);
            }
        }
        Ok(changed)
    }

    /// Gives the memory of the factor back.
    pub fn release(&mut self, system: &mut System) {
        if let Some(free) = self.free.take() {
            system.recycle(free);
        }
    }

    /// Removes the normal component of resting vertices from a block.
    pub fn hold(&self, block: &mut [f64]) {
        let size = self.struck.len();
        for (v, &s) in block[2 * size..].iter_mut().zip(&self.struck) {
            if s {
                *v = 0.0;
            }
        }
    }

    /// Displacement under a block of forces, with resting vertices fixed along the normal.
    pub fn respond(&self, full: &Factor, system: &mut System, block: &mut [f64]) {
        let size = self.struck.len();
        if let Some(free) = &self.free {
            self.hold(block);
            system.solve(full, &mut block[..2 * size]);
            system.solve(free, &mut block[2 * size..]);
        } else {
            system.solve(full, block);
        }
    }

    /// The factor for forces along the normal (none of them on resting vertices) or along the plane.
    pub fn factor_along<'a>(&'a self, full: &'a Factor, normal: bool) -> &'a Factor {
        match &self.free {
            Some(free) if normal => free,
            _ => full,
        }
    }

    /// Height changes with the held vertices on the plane and no other forces.
    pub fn lift(&self, values: &[f64], system: &mut System) -> Vec<f64> {
        let Some(free) = &self.free else {
            return vec![0.0; self.struck.len()];
        };
        let held = self.held();
        let mut lift = system.pattern.multiply(values, &held);
        for (l, &s) in lift.iter_mut().zip(&self.struck) {
            *l = if s { 0.0 } else { -*l };
        }
        system.solve(free, &mut lift);
        for (l, h) in lift.iter_mut().zip(&held) {
            *l += h;
        }
        lift
    }

    /// Predicts the set by projected over-relaxation of the heights (Cryer 1971), from a displacement and the forces of the rows (blocks).
    /// A sweep costs a fraction of a factorisation and takes interactions of neighbours into account, which [`Self::update`] ignores.
    pub fn predict_set(&mut self, values: &[f64], pattern: &Pattern, shift: &[f64], push: &[f64]) {
        let size = self.struck.len();
        let (mut risen, pushed) = (shift[2 * size..].to_vec(), &push[2 * size..]);
        // A vertex waits for the one before it, and would wait for a division too.
        let softness: Vec<f64> = pattern
            .diagonal
            .iter()
            .map(|&at| 1.0 / values[at])
            .collect();
        for _ in 0..SWEEPS {
            for i in 0..size {
                let rest = pushed[i] - pattern.pull(values, &risen, i);
                let step = rest * softness[i] - risen[i];
                risen[i] = (risen[i] + OVER * step).max(-self.heights[i]);
                self.struck[i] = risen[i] <= -self.heights[i];
            }
        }
    }

    /// The next set, from the displacement and the forces of the rows (blocks); returns `true` if it changed.
    pub fn update(&mut self, values: &[f64], system: &System, shift: &[f64], push: &[f64]) -> bool {
        let size = self.struck.len();
        let (risen, pushed) = (&shift[2 * size..], &push[2 * size..]);
        let needed = system.pattern.multiply(values, risen);
        let mut changed = false;
        for i in 0..size {
            let next = if self.struck[i] {
                needed[i] - pushed[i] > 0.0
            } else {
                self.heights[i] + risen[i] < -DEPTH
            };
            changed |= next != self.struck[i];
            self.struck[i] = next;
        }
        changed
    }
}
