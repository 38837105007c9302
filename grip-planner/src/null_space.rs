//! Null-space coverage: the share of the motion of the targets that a set of grips commands.
//!
//! ```text
//! NSC(g) = 1 − tr(S Z(ZᵀKZ)⁻¹Zᵀ) / tr(S K⁻¹),      Z spans the null space of Φ_g
//! ```
//!
//! Fixing the grips conditions the prior `C = K⁻¹` on the gripped vertices, which needs no basis of the null space:
//! `Z(ZᵀKZ)⁻¹Zᵀ = C − CΦᵀ(ΦCΦᵀ)⁻¹ΦC`. With the columns `c_j = C e_j` of the candidates computed once,
//!
//! ```text
//! NSC(g) = tr(G_gg⁻¹ H_gg) / tr(S C),     G_jk = c_j[k],     H_jk = c_jᵀ S c_k
//! ```
//!
//! so a pair costs a 2×2 block and a triple a 3×3 block. The blocks are processed one grip after the other (Gram–Schmidt
//! in the metric `G`): each adds a term that is never negative, which makes the measure monotone to the last bit, and a
//! grip that repeats another adds nothing.

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use nalgebra::DMatrix;

use crate::factor::Factor;
use crate::stiffness::{Stiffness, target_weights};
use crate::{CoverageOptions, Error, Model, Plane};

/// A grip adds nothing if its variance given the others is less than this share of its prior variance: it is then already determined
/// to six digits.
pub(crate) const REPEATED: f64 = 1e-12;

/// Covariance columns of the candidates.
///
/// ```
/// # use grip_planner::nalgebra::{Point3, Vector3};
/// # use grip_planner::{Coverage, CoverageOptions, Model, Plane, Stiffness};
/// # let points = [0.0, 0.1, 0.2].map(|x| Point3::new(x, 0.0, 0.05));
/// # let up = Vector3::z_axis();
/// # let model = Model {
/// #     points: &points,
/// #     normals: &[up; 3],
/// #     areas: &[1e-4; 3],
/// #     edges: &[],
/// #     boundary: &[false; 3],
/// #     visible: &[true; 3],
/// #     hidden: &[],
/// # };
/// # let table = Plane { normal: up, offset: 0.0 };
/// // Vertices 0 and 1 are joined by a spring as stiff as their anchors; vertex 2 is apart.
/// let mut stiffness = Stiffness::membrane(&model, &table, &CoverageOptions::default())?;
/// let anchor = stiffness.anchors()[0];
/// stiffness.couple([0, 1], anchor)?;
///
/// // In units of 1/anchor, C = K⁻¹ has ⅔ on the diagonal of the joined vertices, ⅓ between them, and 1 for the other.
/// let coverage = Coverage::with_stiffness(&stiffness, &[2.0, 1.0, 1.0], &[0, 1, 2])?;
/// let near = |score: f64, expected: f64| (score - expected).abs() < 1e-12;
/// assert!(near(coverage.score(&[0])?, 1.0 / 2.0));
/// assert!(near(coverage.score(&[0, 1, 2])?, 1.0));
///
/// let expected = [([0, 1], 2.0 / 3.0), ([0, 2], 5.0 / 6.0), ([1, 2], 2.0 / 3.0)];
/// for ((pair, score), (vertices, value)) in coverage.pairs().zip(expected) {
///     assert!(pair == vertices && near(score, value));
/// }
///
/// let (best, score) = coverage.best_set(2).unwrap();
/// assert!(best == [0, 2] && near(score, 5.0 / 6.0));
/// assert!(coverage.best_set(4).is_none());
/// # Ok::<(), grip_planner::Error>(())
/// ```
#[derive(Debug, Clone)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Coverage {
    pub(crate) size: usize,
    pub(crate) candidates: Vec<u32>,
    /// Column of each vertex, or `NONE`.
    column_of: Vec<u32>,
    /// `size` × candidates, column-major.
    pub(crate) columns: Vec<f64>,
    pub(crate) gram: DMatrix<f64>,
    commanded: DMatrix<f64>,
    /// Prior variance of every vertex: the diagonal of `C`.
    pub(crate) variance: Vec<f64>,
    total: f64,
}

const NONE: u32 = u32::MAX;

impl Coverage {
    /// Coverage of the membrane model ([`Stiffness::membrane`], [`target_weights`]).
    ///
    /// # Errors
    /// An invalid model, setting or candidate.
    pub fn new(
        model: &Model,
        table: &Plane,
        candidates: &[u32],
        options: &CoverageOptions,
    ) -> Result<Self, Error> {
        let stiffness = Stiffness::membrane(model, table, options)?;
        Self::with_stiffness(&stiffness, &target_weights(model, options)?, candidates)
    }

    /// Coverage for any stiffness and target weights (one for each vertex, not negative).
    ///
    /// # Errors
    /// Invalid weights, a candidate that does not exist, a stiffness that is not positive definite.
    ///
    /// # Complexity
    /// One sparse factorisation, one solve per candidate `m`, one product of `m² n`.
    pub fn with_stiffness(
        stiffness: &Stiffness,
        targets: &[f64],
        candidates: &[u32],
    ) -> Result<Self, Error> {
        let size = stiffness.anchors().len();
        check(size, targets, candidates)?;
        let mut column_of = vec![NONE; size];
        let mut unique = Vec::with_capacity(candidates.len());
        for &v in candidates {
            if column_of[v as usize] == NONE {
                column_of[v as usize] = unique.len() as u32;
                unique.push(v);
            }
        }
        let factor = Factor::new(size, &stiffness.lower())?;
        let variance = factor.inverse_diagonal();
        let total: f64 = variance.iter().zip(targets).map(|(c, s)| c * s).sum();
        if !(total.is_finite() && total > 0.0) {
            return Err(Error::NoTarget { total });
        }
        let columns = factor.inverse_columns(&unique);
        let gram = DMatrix::from_fn(unique.len(), unique.len(), |i, j| {
            columns[j * size + unique[i] as usize]
        });
        let commanded = weighted_gram(&columns, targets, unique.len());
        Ok(Self {
            size,
            candidates: unique,
            column_of,
            columns,
            gram,
            commanded,
            variance,
            total,
        })
    }

    /// The candidates, in the order they were given.
    pub fn candidates(&self) -> &[u32] {
        &self.candidates
    }

    /// `NSC` of a set of grips, between 0 (nothing is commanded) and 1 (everything is).
    ///
    /// # Errors
    /// A vertex that is not a candidate.
    pub fn score(&self, vertices: &[u32]) -> Result<f64, Error> {
        let columns = vertices
            .iter()
            .map(|&v| self.column(v))
            .collect::<Result<Vec<_>, _>>()?;
        Ok(self.score_columns(&columns, &mut Vec::new()))
    }

    /// Every pair of candidates with its score.
    pub fn pairs(&self) -> impl Iterator<Item = ([u32; 2], f64)> + '_ {
        let count = self.candidates.len();
        (0..count).flat_map(move |i| {
            (i + 1..count).map(move |j| {
                (
                    [self.candidates[i], self.candidates[j]],
                    self.score_pair(i, j),
                )
            })
        })
    }

    pub(crate) fn column(&self, vertex: u32) -> Result<usize, Error> {
        match self.column_of.get(vertex as usize) {
            Some(&c) if c != NONE => Ok(c as usize),
            _ => Err(Error::NotACandidate { vertex }),
        }
    }

    /// The 2×2 block in closed form: all pairs are scored for every plan.
    pub(crate) fn score_pair(&self, i: usize, j: usize) -> f64 {
        let (g, h) = (&self.gram, &self.commanded);
        let first = h[(i, i)] / g[(i, i)];
        let r = g[(i, j)] / g[(i, i)];
        let left = g[(j, j)] - r * g[(i, j)];
        if left <= REPEATED * g[(j, j)] {
            return (first / self.total).clamp(0.0, 1.0);
        }
        let second = (h[(j, j)] - 2.0 * r * h[(i, j)] + r * r * h[(i, i)]).max(0.0) / left;
        ((first + second) / self.total).clamp(0.0, 1.0)
    }

    /// The general block: `w_1, w_2 …` are the unit vectors of the grips, orthonormalised in the metric `G`, and
    /// `tr(G⁻¹H) = Σ w_kᵀ H w_k`. `scratch` stores them.
    pub(crate) fn score_columns(&self, columns: &[usize], scratch: &mut Vec<f64>) -> f64 {
        let count = columns.len();
        scratch.clear();
        scratch.resize(count * count, 0.0);
        let mut sum = 0.0;
        for j in 0..count {
            let (done, rest) = scratch.split_at_mut(j * count);
            let w = &mut rest[..count];
            w[j] = 1.0;
            let own = self.gram[(columns[j], columns[j])];
            let mut left = own;
            for v in done.chunks_exact(count) {
                let overlap: f64 = (0..j)
                    .map(|k| v[k] * self.gram[(columns[k], columns[j])])
                    .sum();
                left -= overlap * overlap;
                (0..j).for_each(|k| w[k] -= overlap * v[k]);
            }
            if left <= REPEATED * own {
                w.fill(0.0);
                continue;
            }
            let scale = 1.0 / left.sqrt();
            for x in w.iter_mut() {
                *x *= scale;
            }
            sum += self.commanded_by(columns, w, j).max(0.0);
        }
        (sum / self.total).clamp(0.0, 1.0)
    }

    /// `wᵀ H w` over the first `last + 1` columns.
    fn commanded_by(&self, columns: &[usize], w: &[f64], last: usize) -> f64 {
        let row = |a: usize| {
            (0..=last)
                .map(|b| self.commanded[(columns[a], columns[b])] * w[b])
                .sum::<f64>()
        };
        (0..=last).map(|a| w[a] * row(a)).sum()
    }
}

fn check(size: usize, targets: &[f64], candidates: &[u32]) -> Result<(), Error> {
    if size == 0 {
        return Err(Error::EmptyModel);
    }
    if targets.len() != size {
        return Err(Error::LengthMismatch {
            what: "target weights",
            count: targets.len(),
            points: size,
        });
    }
    if let Some((index, &weight)) = targets
        .iter()
        .enumerate()
        .find(|(_, s)| !(s.is_finite() && **s >= 0.0))
    {
        return Err(Error::BadTargetWeight { index, weight });
    }
    match candidates.iter().find(|&&v| v as usize >= size) {
        Some(&vertex) => Err(Error::NoSuchVertex {
            vertex,
            points: size,
        }),
        None => Ok(()),
    }
}

/// `H = columnsᵀ S columns`.
fn weighted_gram(columns: &[f64], targets: &[f64], count: usize) -> DMatrix<f64> {
    let size = targets.len();
    let weighted: Vec<f64> = columns
        .iter()
        .zip(targets.iter().cycle())
        .map(|(c, s)| c * s)
        .collect();
    let mut out = DMatrix::zeros(count, count);
    matmul(
        MatMut::from_column_major_slice_mut(out.as_mut_slice(), count, count),
        Accum::Replace,
        MatRef::from_column_major_slice(columns, size, count).transpose(),
        MatRef::from_column_major_slice(&weighted, size, count),
        1.0,
        Par::Seq,
    );
    out
}
