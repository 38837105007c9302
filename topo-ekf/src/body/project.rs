//! The constrained estimate nearest to the unconstrained one, in the metric of its information.
//!
//! ```text
//! min ½ (x − x̂)ᵀ H (x − x̂)      s.t.   D x ≥ b            H: information of the last step, x̂: its estimate
//! x = x̂ + H⁻¹ Dᵀ λ,    λ = argmin ½ λᵀ (D H⁻¹ Dᵀ + ς I) λ − gᵀ λ  s.t. λ ≥ 0            g = b − D x̂
//! ```
//!
//! The rows of `D` are points of the surface against the table, and the caller's inequalities. Contact rows in the steps already support most points
//! on the table, to half a millimetre or better; the remaining penetration is removed here, so that no point of the estimate is more than a micrometre
//! below. Of the violated rows of a cell the worst becomes active, then the worst of the rest, because most rows of a cell are nearly equal.
//! `D H⁻¹ Dᵀ` of the active rows is small and dense, from entries of `H⁻¹` by the factor at hand ([`crate::selected_inverse`]), and the active set is found
//! in it by descent; clarabel is used where that does not converge. The softness `ς` keeps nearly equal rows independent, and the gap that it
//! leaves is added again (method of multipliers), so that infeasible rows end at the least sum of squares.
//!
//! The projected mean is kept; the active set is not used as information.

use clarabel::algebra::CscMatrix;
use nalgebra::{DMatrix, DVector, Matrix3, Point3};

use super::elastic::{Elastic, Solved, corners};
use super::lattice::{Embedding, Lattice};
use super::pose::Pose;
use super::row::BodyInequality;
use crate::quadratic_program::minimise;
use crate::{Error, Plane};

/// A row violated by more than this is projected, m: a tenth of the guarantee.
pub(crate) const DEPTH: f64 = 1e-7;
/// Largest remaining violation, m.
pub(crate) const FEASIBLE: f64 = 1e-6;
/// Softness of a row relative to the mean compliance of the rows in play.
const SOFT: f64 = 1e-5;
/// Coefficients smaller than this share of the largest are rounding.
const ZERO: f64 = 1e-12;
/// Rounds in which each cell adds its worst row; after them all violated rows are added at once.
const ROUNDS: usize = 12;
/// Sweeps of the relaxation that predicts the active set, and its over-relaxation.
const SWEEPS: usize = 60;
const OVER: f64 = 1.5;
/// Steps of the active set, and how many rows are added in the first of them; half as many in each later one.
const STEPS: usize = 100;
const JOINING: usize = 32;
/// How often the gap left by softness is added again.
const PASSES: usize = 20;
/// Tolerance of feasibility in clarabel, relative to the largest gap.
const FEASIBILITY: f64 = 1e-10;
/// What is left of the gaps has come to rest when it changes by less than this, m.
const STILL: f64 = 1e-2 * DEPTH;

/// `Σ a x ≥ b` over a few unknowns, in metres.
pub(crate) struct Half {
    /// Rows of one group are nearly equal.
    group: u32,
    terms: Vec<(u32, f64)>,
    /// Violation by the estimate, m.
    pub gap: f64,
}

impl Half {
    /// A point stays above the table, whose normal is the third axis of the unknowns.
    pub fn above(lattice: &Lattice, pose: &Pose, at: &Embedding, table: &Plane) -> Self {
        let terms = corners(lattice, at).filter(|(_, w)| w.abs() > ZERO);
        Self {
            group: at.cell,
            terms: terms.map(|(node, w)| (3 * node + 2, w)).collect(),
            gap: -table.height(&pose.position(lattice, at)),
        }
    }

    /// The caller's inequality, divided by its largest coefficient; each forms a group of its own.
    pub fn of(
        lattice: &Lattice,
        pose: &Pose,
        inequality: &BodyInequality,
        frame: &Matrix3<f64>,
        group: u32,
    ) -> Self {
        let unit = 1.0 / inequality.largest();
        let mut sums = std::collections::BTreeMap::<u32, f64>::new();
        let mut gap = inequality.bound * unit;
        for (at, a) in &inequality.terms {
            gap -= unit * a.dot(&pose.position(lattice, at).coords);
            let turned = frame * a * unit;
            for (node, w) in corners(lattice, at) {
                for axis in 0..3 {
                    *sums.entry(3 * node + axis).or_default() += w * turned[axis as usize];
                }
            }
        }
        sums.retain(|_, a| a.abs() > ZERO);
        Self {
            group,
            terms: sums.into_iter().collect(),
            gap,
        }
    }

    fn reach(&self, moves: &[f64]) -> f64 {
        self.terms.iter().map(|&(u, a)| a * moves[u as usize]).sum()
    }
}

/// The displacement to the projected estimate.
pub(crate) struct Projected {
    /// Displacement of all unknowns.
    pub moves: Vec<f64>,
    /// Number of active rows.
    pub pushing: usize,
}

/// Largest gap, 0 if nothing is violated.
pub(crate) fn deepest(halves: &[Half]) -> f64 {
    halves.iter().map(|h| h.gap).fold(0.0, f64::max)
}

/// Projects in the metric of `solved`.
pub(crate) fn project(
    elastic: &mut Elastic,
    solved: &Solved,
    halves: &[Half],
) -> Result<Projected, Error> {
    let mut moves = vec![0.0; elastic.system().pattern.size()];
    let mut left: Vec<f64> = halves.iter().map(|h| h.gap).collect();
    let mut model = Model::new(moves.len());
    for round in 0.. {
        let new = newcomers(halves, &left, &model.rows, round < ROUNDS);
        if new.is_empty() {
            break;
        }
        model.admit(&new, halves, elastic, solved)?;
        model.push(halves)?;
        moves.fill(0.0);
        for (&k, force) in model.rows.iter().zip(&model.forces) {
            for &(u, a) in &halves[k].terms {
                moves[u as usize] += a * force;
            }
        }
        elastic.system_mut().solve(&solved.factor, &mut moves);
        for (l, half) in left.iter_mut().zip(halves) {
            *l = half.gap - half.reach(&moves);
        }
    }
    if let Some(at) = moves.iter().position(|m| !m.is_finite()) {
        return Err(Error::Overflow { vertex: at / 3 });
    }
    Ok(Projected {
        moves,
        pushing: model.forces.iter().filter(|f| **f > 0.0).count(),
    })
}

/// Violated rows that are not yet included: the worst of each group, or all.
fn newcomers(halves: &[Half], left: &[f64], known: &[usize], worst: bool) -> Vec<usize> {
    let mut plays = vec![false; halves.len()];
    for &k in known {
        plays[k] = true;
    }
    let mut lacking: Vec<usize> = (0..halves.len())
        .filter(|&k| left[k] > DEPTH && !plays[k] && !halves[k].terms.is_empty())
        .collect();
    if worst {
        lacking.sort_by(|&a, &b| {
            let groups = halves[a].group.cmp(&halves[b].group);
            groups.then(left[b].total_cmp(&left[a])).then(a.cmp(&b))
        });
        lacking.dedup_by_key(|k| halves[*k].group);
    }
    lacking
}

/// `D H⁻¹ Dᵀ` of the included rows, and their forces.
struct Model {
    rows: Vec<usize>,
    gram: DMatrix<f64>,
    forces: Vec<f64>,
    /// Unknowns whose entries of `H⁻¹` are known, and their indices.
    unknowns: Vec<u32>,
    places: Vec<u32>,
    inverse: DMatrix<f64>,
}

impl Model {
    fn new(size: usize) -> Self {
        Self {
            rows: Vec::new(),
            gram: DMatrix::zeros(0, 0),
            forces: Vec::new(),
            unknowns: Vec::new(),
            places: vec![u32::MAX; size],
            inverse: DMatrix::zeros(0, 0),
        }
    }

    /// Includes rows.
    fn admit(
        &mut self,
        new: &[usize],
        halves: &[Half],
        elastic: &Elastic,
        solved: &Solved,
    ) -> Result<(), Error> {
        let known = self.unknowns.len();
        for &k in new {
            for &(u, _) in &halves[k].terms {
                if self.places[u as usize] == u32::MAX {
                    self.places[u as usize] = self.unknowns.len() as u32;
                    self.unknowns.push(u);
                }
            }
        }
        if self.unknowns.len() > known {
            let system = elastic.system();
            self.inverse = system.selected_inverse(&solved.factor, &self.unknowns)?;
        }
        self.drop_idle();
        let old = self.rows.len();
        self.rows.extend_from_slice(new);
        self.forces.resize(self.rows.len(), 0.0);
        let count = self.rows.len();
        self.gram = std::mem::take(&mut self.gram).resize(count, count, 0.0);
        let mut column = vec![0.0; self.unknowns.len()];
        for l in old..count {
            column.fill(0.0);
            for &(u, a) in &halves[self.rows[l]].terms {
                let entries = self.inverse.column(self.places[u as usize] as usize);
                for (c, z) in column.iter_mut().zip(entries.iter()) {
                    *c += a * z;
                }
            }
            for k in 0..=l {
                let terms = halves[self.rows[k]].terms.iter();
                let entry: f64 = terms
                    .map(|&(u, a)| a * column[self.places[u as usize] as usize])
                    .sum();
                self.gram[(k, l)] = entry;
                self.gram[(l, k)] = entry;
            }
        }
        Ok(())
    }

    /// Drops included rows without force: the optimum is the same without them. The objective only grows, so no row returns for ever.
    fn drop_idle(&mut self) {
        let kept: Vec<usize> = (0..self.rows.len())
            .filter(|&k| self.forces[k] > 0.0)
            .collect();
        self.gram = self.gram.select_rows(&kept).select_columns(&kept);
        self.rows = kept.iter().map(|&k| self.rows[k]).collect();
        self.forces = kept.iter().map(|&k| self.forces[k]).collect();
    }

    /// Computes the forces of the included rows.
    fn push(&mut self, halves: &[Half]) -> Result<(), Error> {
        let gaps: Vec<f64> = self.rows.iter().map(|&k| halves[k].gap).collect();
        let soft = SOFT * self.gram.trace() / gaps.len() as f64;
        let mut asked = gaps.clone();
        let mut left = vec![f64::INFINITY; gaps.len()];
        for _ in 0..PASSES {
            self.forces = self.minimum(&asked, soft)?;
            let before = std::mem::replace(&mut left, self.left(&gaps));
            let kept = left.iter().all(|l| *l <= 0.5 * DEPTH);
            let mut pairs = left.iter().zip(&before);
            if kept || pairs.all(|(l, b)| (l - b).abs() <= STILL) {
                break;
            }
            for ((a, g), f) in asked.iter_mut().zip(&gaps).zip(&self.forces) {
                *a = g + soft * f;
            }
        }
        Ok(())
    }

    fn minimum(&self, asked: &[f64], soft: f64) -> Result<Vec<f64>, Error> {
        let deepest = asked.iter().copied().fold(0.0, f64::max);
        let slack = 1e-9_f64.min(1e-6 * deepest);
        let start = self.relaxed(asked, soft);
        match descend(&self.gram, asked, soft, start, slack) {
            Some(forces) => Ok(forces),
            None => interior_point(&self.gram, asked, soft),
        }
    }

    /// Forces after a few sweeps of projected over-relaxation (Cryer 1971): almost the active set, for less than a factorisation of it.
    fn relaxed(&self, asked: &[f64], soft: f64) -> Vec<f64> {
        let mut forces = self.forces.clone();
        let mut lacking = left(&self.gram, asked, &forces);
        for _ in 0..SWEEPS {
            for k in 0..forces.len() {
                let column = self.gram.column(k);
                let step = (lacking[k] - soft * forces[k]) / (column[k] + soft);
                let next = (forces[k] + OVER * step).max(0.0);
                let change = next - forces[k];
                if change != 0.0 {
                    forces[k] = next;
                    for (l, g) in lacking.iter_mut().zip(column.iter()) {
                        *l -= g * change;
                    }
                }
            }
        }
        forces
    }

    /// The gaps that remain under the forces.
    fn left(&self, gaps: &[f64]) -> Vec<f64> {
        left(&self.gram, gaps, &self.forces)
    }
}

/// The minimum by an active set that only descends (Lawson and Hanson 1974): the forces of the active rows are solved for, as far as all of them
/// stay positive, and rows that are still violated are added, the worst first. `None` if it has not converged after the allowed steps.
fn descend(
    gram: &DMatrix<f64>,
    asked: &[f64],
    soft: f64,
    start: Vec<f64>,
    slack: f64,
) -> Option<Vec<f64>> {
    let mut forces = start;
    let mut active: Vec<usize> = (0..asked.len()).filter(|&k| forces[k] > 0.0).collect();
    let mut joining = JOINING;
    for _ in 0..STEPS {
        while !active.is_empty() {
            let square = DMatrix::from_fn(active.len(), active.len(), |k, l| {
                gram[(active[k], active[l])] + if k == l { soft } else { 0.0 }
            });
            let right = DVector::from_iterator(active.len(), active.iter().map(|&k| asked[k]));
            let target = square.cholesky()?.solve(&right);
            let room = |(&k, t): (&usize, &f64)| (*t <= 0.0).then(|| forces[k] / (forces[k] - t));
            let pairs = active.iter().zip(target.iter());
            let length = pairs.filter_map(room).fold(1.0, f64::min);
            for (&k, t) in active.iter().zip(target.iter()) {
                forces[k] += length * (t - forces[k]);
                if *t <= 0.0 && forces[k] <= 1e-14 * t.abs() {
                    forces[k] = 0.0;
                }
            }
            if length >= 1.0 {
                break;
            }
            active.retain(|&k| forces[k] > 0.0);
        }
        let lacking = left(gram, asked, &forces);
        let mut new: Vec<usize> = (0..asked.len())
            .filter(|&k| forces[k] == 0.0 && lacking[k] > slack)
            .collect();
        if new.is_empty() {
            return Some(forces);
        }
        new.sort_by(|&a, &b| lacking[b].total_cmp(&lacking[a]).then(a.cmp(&b)));
        new.truncate(joining);
        // Several at once may block each other; a single one always descends.
        joining = (joining / 2).max(1);
        active.extend(new);
    }
    None
}

fn left(gram: &DMatrix<f64>, gaps: &[f64], forces: &[f64]) -> Vec<f64> {
    let mut left = gaps.to_vec();
    for (l, &force) in forces.iter().enumerate().filter(|(_, f)| **f != 0.0) {
        for (g, m) in left.iter_mut().zip(gram.column(l).iter()) {
            *g -= m * force;
        }
    }
    left
}

/// The same minimum by clarabel, in units of the largest gap and of the mean compliance.
fn interior_point(gram: &DMatrix<f64>, asked: &[f64], soft: f64) -> Result<Vec<f64>, Error> {
    let count = asked.len();
    let unit = soft / SOFT;
    let deepest = asked.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
    let (mut starts, mut at, mut entries) = (vec![0], vec![], vec![]);
    for l in 0..count {
        for k in 0..=l {
            at.push(k);
            entries.push((gram[(k, l)] + if k == l { soft } else { 0.0 }) / unit);
        }
        starts.push(at.len());
    }
    let quadratic = CscMatrix::new(count, count, starts, at, entries);
    let linear: Vec<f64> = asked.iter().map(|g| -g / deepest).collect();
    let diagonal = (0..=count).collect();
    let bounds = CscMatrix::new(
        count,
        count,
        diagonal,
        (0..count).collect(),
        vec![-1.0; count],
    );
    let zero = vec![0.0; count];
    let found = minimise(&quadratic, &linear, &bounds, &zero, FEASIBILITY)?;
    // Strict complementarity: a row pushes where its force exceeds its multiplier.
    let forces = found.x.iter().zip(&found.z);
    Ok(forces
        .map(|(y, z)| if y > z { y * deepest / unit } else { 0.0 })
        .collect())
}

/// Adds a displacement of the unknowns to the nodes.
pub(crate) fn shift(live: &mut [Point3<f64>], moves: &[f64], frame: &Matrix3<f64>) {
    for (p, m) in live.iter_mut().zip(moves.chunks_exact(3)) {
        *p += frame.tr_mul(&nalgebra::Vector3::from_column_slice(m));
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests")]

    use super::*;

    /// Both ways to the forces give the same, on rows that nearly repeat each other.
    #[test]
    fn the_active_set_and_the_interior_point_agree() {
        let count = 12;
        let base = DMatrix::from_fn(count, 7, |k, c| ((k * 7 + c * 3 + 1) as f64).sin());
        let gram = &base * base.transpose();
        let gaps: Vec<f64> = (0..count)
            .map(|k| 1e-3 * ((5 * k + 2) as f64).sin())
            .collect();
        let soft = SOFT * gram.trace() / count as f64;
        let inside = interior_point(&gram, &gaps, soft).unwrap();
        let mut model = Model::new(0);
        model.forces = vec![0.0; count];
        model.gram = gram.clone();
        let active = model.minimum(&gaps, soft).unwrap();
        let (a, b) = (left(&gram, &gaps, &inside), left(&gram, &gaps, &active));
        for k in 0..count {
            // Softness makes the forces unique but hardly so; what they leave of the gaps of millimetres is to 1e-6 of them.
            assert!((a[k] - b[k]).abs() < 1e-9, "{k}: {} {}", a[k], b[k]);
        }
    }
}
