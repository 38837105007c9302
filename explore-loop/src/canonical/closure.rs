//! Loop closure: spreading the mismatch where two parts of the model meet.
//!
//! Going round an object, each strip is attached to the one before it, and small errors add up. When the last strip
//! meets the first part of the model in the live frame, the two are neighbours on the object, but their rest positions
//! disagree. What was measured is local: the vector from a vertex to its neighbour, in the vertex's own frame.
//! The rest positions are therefore relaxed so that all local vectors fit as well as they can,
//!
//! ```text
//! min_{X, Q}  Σ_i Σ_{j∈N(i)} w_ij ‖ Q_i d_ij − (X_j − X_i) ‖²  +  w_a Σ_{i∈A} ‖X_i − X_i⁰‖²
//! ```
//! with a free rotation `Q_i` per vertex (as-rigid-as-possible), `d_ij = X_j − X_i` before the relaxation for old
//! neighbours, `d_ij = R_iᵀ(x_j − x_i)` from the live frame for those that just met, and anchors `A`: what was seen in
//! the first frame is where it was seen. Alternating rotations (3×3 polar factors) and positions (one sparse
//! Cholesky factor, three right-hand sides) decreases the energy at every step.

use super::{CanonicalModel, graph, merge::nearest_rotation};
use faer::Side;
use faer::linalg::solvers::Solve;
use faer::sparse::{SparseColMat, Triplet};
use nalgebra::{Matrix3, Point3, Vector3};

/// Two vertices that are neighbours on the object although the model does not join them yet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Meeting {
    /// The two vertices.
    pub pair: [u32; 2],
    /// How far their rest positions are from fitting, metres.
    pub mismatch: f64,
}

/// How strongly an anchor holds, against 1 for an edge.
const ANCHOR: f64 = 10.0;
/// Alternations: drift is a few spacings over tens of hops; the energy has settled by then.
const ROUNDS: usize = 60;

/// Hops along the surface within which a mismatch is strain, not a loop.
const HOPS: usize = 4;

/// Pairs that are neighbours in the live frame (within `1.6 ε`, same way facing, both measured in this
/// frame) but not at rest (their rest vector is off by more than `0.6 ε`, and there is no short way along the surface).
pub fn meetings(model: &CanonicalModel, measured: &[bool], spacing: f64) -> Vec<Meeting> {
    let Some(tree) = graph::tree(&model.live) else {
        return Vec::new();
    };
    let normals = model.live_normals();
    let neighbours = graph::adjacency(model.len(), &model.edges);
    let mut found = Vec::new();
    for i in (0..model.len()).filter(|&i| measured[i]) {
        for (j, _) in graph::near(&tree, &model.live[i], 1.6 * spacing, 16) {
            if j <= i || !measured[j] || normals[i].dot(&normals[j]) < 0.5 {
                continue;
            }
            let expected = model.rotations[i].transpose() * (model.live[j] - model.live[i]);
            let mismatch = ((model.rest[j] - model.rest[i]) - expected).norm();
            if mismatch > 0.6 * spacing && !connected(&neighbours, i as u32, j as u32, HOPS) {
                found.push(Meeting {
                    pair: [i as u32, j as u32],
                    mismatch,
                });
            }
        }
    }
    found
}

/// Whether a walk of at most `hops` edges leads from `from` to `to`.
fn connected(neighbours: &[Vec<u32>], from: u32, to: u32, hops: usize) -> bool {
    let mut reached = std::collections::BTreeSet::from([from]);
    let mut front = vec![from];
    for _ in 0..hops {
        let mut next = Vec::new();
        for v in front {
            for &n in &neighbours[v as usize] {
                if n == to {
                    return true;
                }
                if reached.insert(n) {
                    next.push(n);
                }
            }
        }
        front = next;
    }
    false
}

/// Relaxes the rest positions of `model` so that the `meetings` fit; `anchored[i]` vertices are held. Returns how far
/// the vertices moved at most, metres.
///
/// # Errors
/// The sparse factorisation fails (non-finite positions).
///
/// # Complexity
/// One sparse Cholesky factorisation and 60 solves: tens of milliseconds at 2,000 vertices.
pub fn relax(
    model: &mut CanonicalModel,
    meetings: &[Meeting],
    anchored: &[bool],
) -> Result<f64, ClosureError> {
    let holds: Vec<f64> = anchored
        .iter()
        .map(|a| if *a { ANCHOR } else { DRIFT })
        .collect();
    settle(model, &springs(model, meetings), &holds)
}

/// How strongly a vertex that is not measured stays where it lies at rest, against 1 for an edge.
const UNMEASURED: f64 = 0.2;
/// A component without anchors stays where it is.
const DRIFT: f64 = 1e-6;
/// Strength of one spring through the body.
const THROUGH: f64 = 0.15;
/// Number of springs through the body at each vertex.
const THROUGH_COUNT: usize = 8;
/// Longest spring through the body, metres: beyond it a soft body bends too much.
const THROUGH_REACH: f64 = 0.07;

/// Brings the later parts of the model into place at rest, from one look at the settled object.
///
/// A strip enters at rest by its neighbours along the surface, row by row, and small errors of rotation add up: the far side opens
/// like a shell. Through the body the way is short. For a measured vertex `j` and the anchored vertices `b` around it in the
/// live frame, whatever side they are on,
///
/// ```text
/// X_j ≈ X_b + R_bᵀ (x_j − x_b)
/// ```
/// enters the relaxation of [`relax`] as springs, beside the edges.
///
/// # Errors
/// As [`relax`].
pub fn refine(
    model: &mut CanonicalModel,
    measured: &[bool],
    anchored: &[bool],
) -> Result<f64, ClosureError> {
    let known: Vec<usize> = (0..model.len()).filter(|&i| anchored[i]).collect();
    let places: Vec<Point3<f64>> = known.iter().map(|&i| model.live[i]).collect();
    let Some(tree) = graph::tree(&places) else {
        return Ok(0.0);
    };
    let mut springs = springs(model, &[]);
    for j in (0..model.len()).filter(|&j| measured[j] && !anchored[j]) {
        for (k, _) in graph::near(&tree, &model.live[j], THROUGH_REACH, THROUGH_COUNT) {
            let b = known[k];
            let d = model.rotations[b].transpose() * (model.live[j] - model.live[b]);
            springs.push(Spring {
                i: b,
                j,
                d,
                weight: THROUGH,
            });
        }
    }
    let hold = |i: usize| match (anchored[i], measured[i]) {
        (true, _) => ANCHOR,
        (false, true) => DRIFT,
        (false, false) => UNMEASURED,
    };
    let holds: Vec<f64> = (0..model.len()).map(hold).collect();
    settle(model, &springs, &holds)
}

/// Minimises the energy of the springs and holds over rest positions and rotations.
fn settle(
    model: &mut CanonicalModel,
    springs: &[Spring],
    holds: &[f64],
) -> Result<f64, ClosureError> {
    let factor = factorise(model.len(), springs, holds)?;
    let start = model.rest.clone();
    let mut turns = vec![Matrix3::identity(); model.len()];
    for _ in 0..ROUNDS {
        fit_rotations(&model.rest, springs, &mut turns);
        solve_positions(&mut model.rest, &start, springs, &turns, holds, &factor)?;
    }
    for (normal, turn) in model.rest_normals.iter_mut().zip(&turns) {
        *normal = nalgebra::UnitVector3::new_normalize(turn * normal.into_inner());
    }
    for (rotation, turn) in model.rotations.iter_mut().zip(&turns) {
        *rotation *= turn.transpose();
    }
    Ok(start
        .iter()
        .zip(&model.rest)
        .map(|(a, b)| (a - b).norm())
        .fold(0.0, f64::max))
}

/// Why a closure could not be computed.
#[derive(Debug, thiserror::Error)]
#[error(
    "loop closure: the relaxation of {vertices} rest positions has no solution (non-finite input?)"
)]
pub struct ClosureError {
    /// Vertices in the model.
    pub vertices: usize,
}

/// A directed spring: from vertex `i`, neighbour `j` should be at `d` in `i`'s frame.
struct Spring {
    i: usize,
    j: usize,
    d: Vector3<f64>,
    weight: f64,
}

fn springs(model: &CanonicalModel, meetings: &[Meeting]) -> Vec<Spring> {
    let mut springs = Vec::with_capacity(2 * (model.edges.len() + meetings.len()));
    let mut both = |i: usize, j: usize, weight: f64, d: &dyn Fn(usize, usize) -> Vector3<f64>| {
        springs.push(Spring {
            i,
            j,
            d: d(i, j),
            weight,
        });
        springs.push(Spring {
            i: j,
            j: i,
            d: d(j, i),
            weight,
        });
    };
    let met: std::collections::BTreeSet<[u32; 2]> = meetings.iter().map(|m| m.pair).collect();
    for edge in model.edges.iter().filter(|e| !met.contains(*e)) {
        both(edge[0] as usize, edge[1] as usize, 1.0, &|i, j| {
            model.rest[j] - model.rest[i]
        });
    }
    for pair in &met {
        both(pair[0] as usize, pair[1] as usize, 1.0, &|i, j| {
            model.rotations[i].transpose() * (model.live[j] - model.live[i])
        });
    }
    springs
}

fn factorise(
    count: usize,
    springs: &[Spring],
    holds: &[f64],
) -> Result<faer::sparse::linalg::solvers::Llt<usize, f64>, ClosureError> {
    let failed = |_| ClosureError { vertices: count };
    let mut entries = Vec::with_capacity(4 * springs.len() + count);
    for s in springs {
        entries.push(Triplet::new(s.i, s.i, s.weight));
        entries.push(Triplet::new(s.j, s.j, s.weight));
        let (row, column) = (s.i.max(s.j), s.i.min(s.j));
        entries.push(Triplet::new(row, column, -s.weight));
    }
    for i in 0..count {
        entries.push(Triplet::new(i, i, holds[i]));
    }
    let matrix = SparseColMat::<usize, f64>::try_new_from_triplets(count, count, &entries)
        .map_err(|_| ClosureError { vertices: count })?;
    matrix
        .sp_cholesky(Side::Lower)
        .map_err(|e| failed(format!("{e:?}")))
}

fn fit_rotations(rest: &[Point3<f64>], springs: &[Spring], turns: &mut [Matrix3<f64>]) {
    let mut moments = vec![Matrix3::zeros(); rest.len()];
    for s in springs {
        moments[s.i] += s.weight * (rest[s.j] - rest[s.i]) * s.d.transpose();
    }
    for (turn, moment) in turns.iter_mut().zip(&moments) {
        *turn = nearest_rotation(moment);
    }
}

fn solve_positions(
    rest: &mut [Point3<f64>],
    start: &[Point3<f64>],
    springs: &[Spring],
    turns: &[Matrix3<f64>],
    holds: &[f64],
    factor: &faer::sparse::linalg::solvers::Llt<usize, f64>,
) -> Result<(), ClosureError> {
    let count = rest.len();
    let mut right = faer::Mat::<f64>::zeros(count, 3);
    for (i, point) in start.iter().enumerate() {
        for k in 0..3 {
            right[(i, k)] += holds[i] * point[k];
        }
    }
    for s in springs {
        let pull = s.weight * (turns[s.i] * s.d);
        for k in 0..3 {
            right[(s.j, k)] += pull[k];
            right[(s.i, k)] -= pull[k];
        }
    }
    factor.solve_in_place(right.as_mut());
    for (i, point) in rest.iter_mut().enumerate() {
        *point = Point3::new(right[(i, 0)], right[(i, 1)], right[(i, 2)]);
        if !point.coords.iter().all(|x| x.is_finite()) {
            return Err(ClosureError { vertices: count });
        }
    }
    Ok(())
}
