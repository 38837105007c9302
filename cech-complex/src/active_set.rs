//! Newton's method on the active pieces (sequential quadratic programming), quadratically convergent.
//!
//! ```text
//! min_{d,z} z + ½ dᵀ(W + μI)d    s.t.  g_j(y) + ∇g_j(y)·d ≤ z   for every piece j
//! ```
//!
//! `W` is the exact Hessian of the Lagrangian. For a guessed active set the optimality conditions are one small
//! linear system; the piece with the most negative multiplier leaves, otherwise the most violated piece enters. Both diagonal blocks of the system
//! have a proximal shift, which removes the singularities of parallel normals, repeated pieces and flat optima and leaves the
//! fixed point unchanged.

use crate::optimality::{MAX_ACTIVE, PROXIMAL, System};
use crate::problem::{Bracket, Goal, MAX_PIECES, PIECES_PER_CYLINDER, Pieces, Problem};
use nalgebra::{Matrix3, Vector3};

/// Largest number of outer steps: three to five suffice on surfaces; along the rim of nearly parallel, stacked cylinders it may take twenty.
const MAX_STEPS: usize = 30;

/// Largest number of exchanges of a piece within one step.
const MAX_EXCHANGES: usize = 12;
/// Tubes above this share of the maximum start as active.
const NEARLY_ACTIVE: f64 = 0.6;
/// If the model was off by more than this share, its multipliers do not close the bracket yet and the lower bound is not computed: at the
/// next point the error is of the order of its square.
const MODEL_TRUSTED: f64 = 1e-6;
/// Number of steps of the second-order correction.
const CORRECTIONS: usize = 8;
/// Shorter steps are never rejected: the maximum then differs by less than the accuracy of the model.
const SHORT: f64 = 1e-3;
/// All points lie in the unit ball, and so does the minimum.
const LONGEST_STEP: f64 = 1.0;

/// A set of active pieces with the multipliers of all pieces (zero outside the set).
pub(crate) struct ActiveSet {
    pieces: [usize; MAX_ACTIVE],
    len: usize,
    pub(crate) multipliers: [f64; MAX_PIECES],
}

impl ActiveSet {
    /// First guess at a point: every tube near the maximum and the piece that attains it.
    pub(crate) fn at<const N: usize>(pieces: &Pieces<N>) -> Self {
        let top = pieces.max();
        let mut set = Self {
            pieces: [0; MAX_ACTIVE],
            len: 0,
            multipliers: [0.0; MAX_PIECES],
        };
        for j in 0..Pieces::<N>::COUNT {
            let tube = j % PIECES_PER_CYLINDER == 0;
            if pieces.value(j) >= top || (tube && pieces.value(j) > NEARLY_ACTIVE * top) {
                set.push(j);
            }
        }
        set.weigh_evenly();
        set
    }

    /// The pieces that hold more than `share` of the given multipliers.
    pub(crate) fn from_multipliers(multipliers: &[f64; MAX_PIECES], share: f64) -> Self {
        let mut set = Self {
            pieces: [0; MAX_ACTIVE],
            len: 0,
            multipliers: *multipliers,
        };
        for (j, &multiplier) in multipliers.iter().enumerate() {
            if multiplier > share {
                set.push(j);
            }
        }
        set
    }

    fn weigh_evenly(&mut self) {
        for &j in &self.pieces[..self.len] {
            self.multipliers[j] = 1.0 / self.len as f64;
        }
    }

    fn push(&mut self, j: usize) -> bool {
        let room = self.len < MAX_ACTIVE;
        if room {
            self.pieces[self.len] = j;
            self.len += 1;
        }
        room
    }

    fn remove(&mut self, position: usize) {
        self.pieces.copy_within(position + 1..self.len, position);
        self.len -= 1;
    }

    fn contains(&self, j: usize) -> bool {
        self.pieces[..self.len].contains(&j)
    }
}

/// Improves `bracket` from `bracket.y`; returns when it is settled or the method is stuck.
pub(crate) fn refine<const N: usize>(
    problem: &Problem<N>,
    active: &mut ActiveSet,
    bracket: &mut Bracket,
    goal: &Goal,
) {
    let mut y = bracket.y;
    let mut pieces = problem.pieces(&y);
    let mut here = pieces.max();
    let mut damping = PROXIMAL;
    for _ in 0..MAX_STEPS {
        let Some((mut step, level)) = quadratic_step(&pieces, active, damping) else {
            return;
        };
        let length = step.norm();
        if length > LONGEST_STEP {
            step *= LONGEST_STEP / length;
        }
        let (mut next_y, mut next) = (y + step, problem.pieces(&(y + step)));
        let mut there = next.max();
        if there > here && length >= SHORT {
            (next_y, next) = level_off(problem, active, here, next_y, next);
            there = next.max();
        }
        bracket.improve_upper(there, &next_y);
        if there - level <= MODEL_TRUSTED * there || level > goal.cutoff {
            bracket.improve_lower(problem.lower_bound(next.forces(&active.multipliers)));
        }
        if bracket.settled(goal) {
            return;
        }
        if there <= here || length < SHORT {
            (y, pieces, here) = (next_y, next, there);
            damping = (0.1 * damping).max(PROXIMAL);
        } else {
            damping = (10.0 * damping).max(0.1);
        }
    }
}

/// Second-order correction: the shortest steps that bring all active pieces back to one level, until the maximum is below `goal`. A long
/// step along the rim of a tube leaves its circle and would look like a failure where the gain along the rim is small (Maratos
/// effect): stacked cylinders whose normals are nearly parallel.
fn level_off<const N: usize>(
    problem: &Problem<N>,
    active: &ActiveSet,
    goal: f64,
    mut y: Vector3<f64>,
    mut pieces: Pieces<N>,
) -> (Vector3<f64>, Pieces<N>) {
    let round = Matrix3::identity();
    for _ in 0..CORRECTIONS {
        let system = System::new(&pieces, active, &round, &[0.0; MAX_PIECES]);
        let Some((step, _)) = system.and_then(|system| system.unloaded().solve()) else {
            break;
        };
        let corrected = problem.pieces(&(y + step));
        if corrected.max() > pieces.max() {
            break;
        }
        (y, pieces) = (y + step, corrected);
        if pieces.max() <= goal {
            break;
        }
    }
    (y, pieces)
}

/// Solves the quadratic problem at one point, updating the active set and its multipliers; `None` if it is singular or cycles.
fn quadratic_step<const N: usize>(
    pieces: &Pieces<N>,
    active: &mut ActiveSet,
    damping: f64,
) -> Option<(Vector3<f64>, f64)> {
    let mut hessian = pieces.hessian(&active.multipliers);
    for a in 0..3 {
        hessian[(a, a)] += damping;
    }
    let previous = active.multipliers;
    for _ in 0..MAX_EXCHANGES {
        let (step, level, multipliers) = equality_step(pieces, active, &hessian, &previous)?;
        let mut worst = (active.len, -1e-14);
        for (position, &multiplier) in multipliers[..active.len].iter().enumerate() {
            if multiplier < worst.1 {
                worst = (position, multiplier);
            }
        }
        if worst.0 < active.len {
            active.remove(worst.0);
            continue;
        }
        let Some(entering) = pieces.most_violated(&step, level + 1e-14, |j| active.contains(j))
        else {
            active.multipliers = [0.0; MAX_PIECES];
            for (position, &j) in active.pieces[..active.len].iter().enumerate() {
                active.multipliers[j] = multipliers[position].max(0.0);
            }
            return Some((step, level));
        };
        if !active.push(entering) {
            return None;
        }
    }
    None
}

/// Optimality conditions with every active piece held at the common level `z`. The first piece eliminates both `z` and (by
/// `Σ λ = 1`) its own multiplier.
fn equality_step<const N: usize>(
    pieces: &Pieces<N>,
    active: &ActiveSet,
    hessian: &Matrix3<f64>,
    previous: &[f64; MAX_PIECES],
) -> Option<(Vector3<f64>, f64, [f64; MAX_ACTIVE])> {
    let first = *active.pieces[..active.len].first()?;
    let (step, of_others) = System::new(pieces, active, hessian, previous)?.solve()?;
    let mut multipliers = [0.0; MAX_ACTIVE];
    multipliers[1..].copy_from_slice(&of_others);
    multipliers[0] = 1.0 - of_others.iter().sum::<f64>();
    let level = pieces.value(first) + pieces.gradient(first).dot(&step);
    Some((step, level, multipliers))
}

impl<'a> System<'a> {
    /// The system of the active pieces at one point.
    fn new<const N: usize>(
        pieces: &Pieces<N>,
        active: &ActiveSet,
        hessian: &'a Matrix3<f64>,
        previous: &[f64; MAX_PIECES],
    ) -> Option<Self> {
        let (&first, others) = active.pieces[..active.len].split_first()?;
        let mut system = System {
            hessian,
            gradient: pieces.gradient(first),
            rows: [Vector3::zeros(); MAX_ACTIVE - 1],
            gaps: [0.0; MAX_ACTIVE - 1],
            previous: [0.0; MAX_ACTIVE - 1],
            others: others.len(),
        };
        for (row, &j) in others.iter().enumerate() {
            system.rows[row] = pieces.gradient(j) - system.gradient;
            system.gaps[row] = pieces.value(first) - pieces.value(j);
            system.previous[row] = previous[j];
        }
        Some(system)
    }

    /// Without an objective: the shortest step in the metric of the Hessian.
    fn unloaded(mut self) -> Self {
        self.gradient = Vector3::zeros();
        self
    }
}
