//! The estimate nearest to the unconstrained one, in the metric of its information, that keeps the constraints.
//!
//! ```text
//! min ½ (x − x̂)ᵀ (S ⊗ I₃) (x − x̂)      s.t.   n·x_i + c ≥ 0  for every i,      m_k·Σ_v c_kv x_v ≥ b_k  for every row k
//! ```
//!
//! The metric is the same in every direction, so the table touches the heights `n·x` alone: a bound-constrained problem with the
//! scalar matrix `S`, solved by a primal-dual active set (resting vertices are struck from `S`, the pattern and its symbolic
//! factor stay). Rows (self-contact, further planes) go through the Schur complement
//!
//! ```text
//! G_kl = (m_k·m_l − m_kn m_ln) c_kᵀ S⁻¹ c_l  +  m_kn m_ln c_kᵀ S_free⁻¹ c_l
//! ```
//!
//! and the two alternate until neither set changes. The optimum of a strictly convex problem is unique, so the starting
//! set changes the time and not the answer. The projected mean is kept by the filter; the set of active constraints is a
//! property of this estimate and never becomes information (that would make the filter overconfident by an order of
//! magnitude, since the same table would be measured anew in every frame).

use std::collections::HashSet;

use nalgebra::{Point3, Vector3};

use crate::dual::{Row, solve_dual};
use crate::observation::Plane;
use crate::system::{Factor, System};
use crate::Error;

/// Alternations between the two active sets before everything goes into the dual, where rows are only added.
const ROUNDS: usize = 40;
/// A vertex lower than this enters the active set; it is then put exactly on the plane.
const DEPTH: f64 = 1e-9;
/// A row violated by more than this enters the dual. It leaves a hundredfold reserve to the 1e-6 m that is promised.
const ROW_DEPTH: f64 = 1e-8;

/// How the projection ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Status {
    /// Nothing was violated: the estimate is the unconstrained one.
    Free,
    /// Constraints hold and the estimate is the nearest that keeps them.
    Constrained,
    /// The active set or the linearised contacts had not settled: the first plane holds, a contact may lack some separation
    /// (see [`StepReport::contact_depth`](crate::StepReport)).
    Unsettled,
    /// The constraints contradict each other: the first plane holds, the rest is violated as little as possible.
    Infeasible,
}

/// The projected estimate.
pub(crate) struct Projected {
    pub positions: Vec<Point3<f64>>,
    pub status: Status,
    /// Vertices resting on the main plane.
    pub resting: Vec<u32>,
    /// Rows that push.
    pub pushing: Vec<usize>,
    pub rounds: usize,
    pub factorisations: usize,
}

/// The plane handled by striking vertices; everything else is a row.
pub(crate) struct Projection<'a> {
    pub values: &'a [f64],
    pub factor: &'a Factor,
    pub estimate: &'a [Point3<f64>],
    pub plane: Option<Plane>,
    pub rows: &'a [Row],
}

/// Active sets to start from: those of the last frame or of the last linearisation.
#[derive(Clone, Debug, Default)]
pub(crate) struct Warm {
    /// Vertices that rested on the plane.
    pub resting: Vec<u32>,
    /// Vertices whose separation from a triangle pushed.
    pub pushed: HashSet<u32>,
}

impl Warm {
    pub fn of(projected: &Projected, rows: &[Row]) -> Self {
        let pushed = projected.pushing.iter().map(|&k| &rows[k]).filter(|r| r.terms.len() > 1).map(|r| r.terms[0].0);
        Self { resting: projected.resting.clone(), pushed: pushed.collect() }
    }

    fn pushes(&self, row: &Row) -> bool {
        row.terms.len() > 1 && self.pushed.contains(&row.terms[0].0)
    }
}

/// Working state of the two nested active sets.
struct Sets {
    struck: Vec<bool>,
    /// Rows that were violated at some round; the dual decides which of them push.
    rows: Vec<usize>,
    /// `S⁻¹ c_k` of those rows, one column each, kept over the rounds.
    full: Vec<f64>,
    /// Whether each of those rows pushed when it was last solved for.
    pushing: Vec<bool>,
}

impl Projection<'_> {
    /// Solves from the active sets of `warm`.
    pub fn solve(&self, system: &mut System, warm: &Warm) -> Result<Projected, Error> {
        let heights: Vec<f64> =
            self.estimate.iter().map(|p| self.plane.map_or(f64::INFINITY, |plane| plane.height(p))).collect();
        let mut rows = self.violated(self.estimate);
        if rows.is_empty() && heights.iter().all(|&h| h >= 0.0) {
            return Ok(self.unchanged());
        }
        let mut struck: Vec<bool> = heights.iter().map(|&h| h < 0.0).collect();
        for &i in &warm.resting {
            // Only those near the plane: a set left over from another place would cost rounds, not save them.
            struck[i as usize] |= heights[i as usize] < 1e-3;
        }
        rows.extend((0..self.rows.len()).filter(|k| self.rows[*k].gap(self.estimate) <= ROW_DEPTH && warm.pushes(&self.rows[*k])));
        let mut sets = Sets { struck, rows: vec![], full: vec![], pushing: vec![] };
        self.admit(&mut sets, &rows, system);
        let mut projected = self.alternate(system, &mut sets, &heights)?;
        if projected.status == Status::Unsettled && let Some(plane) = self.plane {
            // Vertices that are struck and freed again and again; as rows they are only ever added, which ends.
            let rows: Vec<_> = self.rows.iter().cloned().chain(plane_rows(&plane, self.estimate.len())).collect();
            let all = Projection { plane: None, rows: &rows, ..*self };
            let spent = (projected.rounds, projected.factorisations);
            projected = all.solve(system, &Warm::default())?;
            projected.rounds += spent.0;
            projected.factorisations += spent.1;
            projected.resting = projected.pushing.iter().filter_map(|k| k.checked_sub(self.rows.len())).map(|i| i as u32).collect();
            projected.pushing.retain(|k| *k < self.rows.len());
            lift_above(&mut projected.positions, &plane);
        }
        Ok(projected)
    }

    /// The two nested active sets.
    fn alternate(&self, system: &mut System, sets: &mut Sets, heights: &[f64]) -> Result<Projected, Error> {
        let size = self.estimate.len();
        let normal = self.plane.map_or(Vector3::zeros(), |p| p.normal.into_inner());
        let mut shift = vec![Vector3::zeros(); size];
        let (mut rounds, mut factorisations, mut settled, mut pushing) = (0, 0, false, vec![]);
        while rounds < ROUNDS && !settled {
            rounds += 1;
            let free = if sets.struck.contains(&true) {
                factorisations += 1;
                Some(system.factorise(&system.pattern.strike(self.values, &sets.struck))?)
            } else {
                None
            };
            let free = free.as_ref().unwrap_or(self.factor);
            let mut lift = self.lift(system, free, &sets.struck, heights);
            let forces;
            (shift, forces) = self.push(system, free, sets, &mut lift, &normal)?;
            sets.pushing = forces.iter().map(|f| *f > 0.0).collect();
            pushing = sets.rows.iter().zip(&forces).filter(|(_, f)| **f > 0.0).map(|(&k, _)| k).collect();
            settled = !self.update(sets, &shift, &lift, heights, &normal, &forces, system);
        }
        let mut positions: Vec<_> = self.estimate.iter().zip(&shift).map(|(p, d)| p + d).collect();
        if let Some(plane) = &self.plane {
            lift_above(&mut positions, plane);
        }
        let left = self.rows.iter().map(|r| r.gap(&positions)).fold(0.0, f64::max);
        let status = match (settled, left > 1e-6) {
            (true, true) => Status::Infeasible,
            (true, false) => Status::Constrained,
            (false, _) => Status::Unsettled,
        };
        let resting = (0..size as u32).filter(|&i| sets.struck[i as usize]).collect();
        Ok(Projected { positions, status, resting, pushing, rounds, factorisations })
    }

    fn unchanged(&self) -> Projected {
        Projected {
            positions: self.estimate.to_vec(),
            status: Status::Free,
            resting: vec![],
            pushing: vec![],
            rounds: 0,
            factorisations: 0,
        }
    }

    fn violated(&self, positions: &[Point3<f64>]) -> Vec<usize> {
        (0..self.rows.len()).filter(|&k| self.rows[k].gap(positions) > ROW_DEPTH).collect()
    }

    /// Adds rows to the dual and solves for their columns.
    fn admit(&self, sets: &mut Sets, rows: &[usize], system: &mut System) {
        let size = self.estimate.len();
        let mut block = vec![0.0; size * rows.len()];
        for (column, &k) in block.chunks_exact_mut(size).zip(rows) {
            for &(v, c) in &self.rows[k].terms {
                column[v as usize] += c;
            }
        }
        system.solve(self.factor, &mut block);
        sets.full.extend_from_slice(&block);
        sets.rows.extend_from_slice(rows);
        sets.pushing.resize(sets.rows.len(), true);
    }

    /// Height changes with the struck vertices on the plane and nothing else pushing.
    fn lift(&self, system: &mut System, free: &Factor, struck: &[bool], heights: &[f64]) -> Vec<f64> {
        let held: Vec<f64> = struck.iter().zip(heights).map(|(&s, &h)| if s { -h } else { 0.0 }).collect();
        if !struck.contains(&true) {
            return held;
        }
        let pull = system.pattern.multiply(self.values, &held);
        let mut lift: Vec<f64> = struck.iter().zip(&pull).map(|(&s, &p)| if s { 0.0 } else { -p }).collect();
        system.solve(free, &mut lift);
        for (l, h) in lift.iter_mut().zip(&held) {
            *l += h;
        }
        lift
    }

    /// Adds what the rows push; returns the whole displacement and the forces of the rows.
    fn push(
        &self,
        system: &mut System,
        free: &Factor,
        sets: &Sets,
        lift: &mut [f64],
        normal: &Vector3<f64>,
    ) -> Result<(Vec<Vector3<f64>>, Vec<f64>), Error> {
        let size = lift.len();
        let rows: Vec<&Row> = sets.rows.iter().map(|&k| &self.rows[k]).collect();
        let mut over = vec![0.0; size * rows.len()];
        for (column, row) in over.chunks_exact_mut(size).zip(&rows) {
            for &(v, c) in &row.terms {
                if !sets.struck[v as usize] {
                    column[v as usize] += c;
                }
            }
        }
        if self.plane.is_some() {
            system.solve(free, &mut over);
        }
        let along: Vec<f64> = rows.iter().map(|r| r.direction.dot(normal)).collect();
        let count = rows.len();
        let mut gram = nalgebra::DMatrix::zeros(count, count);
        for l in 0..count {
            let (flat, high) = (&sets.full[l * size..(l + 1) * size], &over[l * size..(l + 1) * size]);
            for k in 0..=l {
                let tall = along[k] * along[l];
                let wide = rows[k].direction.dot(&rows[l].direction) - tall;
                let mut g = wide * rows[k].dot(flat);
                if tall != 0.0 {
                    g += tall * rows[k].dot(high);
                }
                gram[(k, l)] = g;
                gram[(l, k)] = g;
            }
        }
        let gaps = rows.iter().zip(&along).map(|(r, a)| r.gap(self.estimate) - a * r.dot(lift)).collect::<Vec<_>>();
        let forces = solve_dual(&gram, &gaps, &sets.pushing)?;
        let mut shift = vec![Vector3::zeros(); size];
        for (l, row) in rows.iter().enumerate() {
            if forces[l] > 0.0 {
                let flat = (row.direction - normal * along[l]) * forces[l];
                let tall = along[l] * forces[l];
                for i in 0..size {
                    shift[i] += flat * sets.full[l * size + i];
                    lift[i] += tall * over[l * size + i];
                }
            }
        }
        for (s, l) in shift.iter_mut().zip(lift.iter()) {
            *s += normal * *l;
        }
        Ok((shift, forces))
    }

    /// Next sets; `true` if something changed.
    #[allow(clippy::too_many_arguments)] // every argument is a named part of the optimality conditions
    fn update(
        &self,
        sets: &mut Sets,
        shift: &[Vector3<f64>],
        lift: &[f64],
        heights: &[f64],
        normal: &Vector3<f64>,
        forces: &[f64],
        system: &mut System,
    ) -> bool {
        let mut changed = false;
        if self.plane.is_some() {
            // Force of the table on a struck vertex: what S says of the lift, less what the rows give.
            let mut table = system.pattern.multiply(self.values, lift);
            for (&k, &force) in sets.rows.iter().zip(forces) {
                let row = &self.rows[k];
                for &(v, c) in &row.terms {
                    table[v as usize] -= force * c * row.direction.dot(normal);
                }
            }
            for i in 0..lift.len() {
                let next = if sets.struck[i] { table[i] > 0.0 } else { heights[i] + lift[i] < -DEPTH };
                changed |= next != sets.struck[i];
                sets.struck[i] = next;
            }
        }
        let positions: Vec<_> = self.estimate.iter().zip(shift).map(|(p, d)| p + d).collect();
        let mut new = self.violated(&positions);
        new.retain(|k| !sets.rows.contains(k));
        changed |= !new.is_empty();
        self.admit(sets, &new, system);
        changed
    }
}

/// Puts on the plane what rounding left a nanometre below.
fn lift_above(positions: &mut [Point3<f64>], plane: &Plane) {
    for p in positions {
        let height = plane.height(p);
        if height < 0.0 {
            *p -= plane.normal.into_inner() * height;
        }
    }
}

/// Deepest violation of a plane, 0 if none.
pub(crate) fn deepest(planes: &[Plane], positions: &[Point3<f64>]) -> f64 {
    planes.iter().flat_map(|plane| positions.iter().map(|p| -plane.height(p))).fold(0.0, f64::max)
}

/// The plane that is handled by striking (the one most vertices violate, the first of equals) and rows for the others.
pub(crate) fn split_planes(planes: &[Plane], estimate: &[Point3<f64>]) -> (Option<Plane>, Vec<Row>) {
    let below = |plane: &Plane| estimate.iter().filter(|p| plane.height(p) < 0.0).count();
    let Some(main) = (0..planes.len()).max_by_key(|&k| (below(&planes[k]), std::cmp::Reverse(k))) else {
        return (None, vec![]);
    };
    let rows = planes
        .iter()
        .enumerate()
        .filter(|&(k, _)| k != main)
        .flat_map(|(_, plane)| plane_rows(plane, estimate.len()))
        .collect();
    (Some(planes[main]), rows)
}

/// A plane as one row per vertex.
fn plane_rows(plane: &Plane, vertices: usize) -> impl Iterator<Item = Row> + use<> {
    let (direction, bound) = (plane.normal.into_inner(), -plane.offset);
    (0..vertices as u32).map(move |v| Row { terms: vec![(v, 1.0)], direction, bound })
}
