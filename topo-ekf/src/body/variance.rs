//! Uncertainty of the positions of embedded points.
//!
//! ```text
//! cov x(e) = W_e (H⁻¹)_cc W_eᵀ               c: the 24 coordinates of the cell's corners, W_e: their weights
//! σ(e) = √(tr cov x(e) / 3)
//! e is determined within τ   ⇔   σ(e) ≤ τ
//! ```
//! Entries of `H⁻¹` are computed by half solves with the factor at hand, for several cells at a time ([`crate::selected_inverse`]).

use std::collections::BTreeSet;

use nalgebra::Matrix3;

use super::elastic::{Elastic, Solved, corners};
use super::lattice::{Embedding, Lattice};
use crate::Error;

/// Number of cells whose entries are computed together: wide enough for dense products, narrow enough to skip most of the square.
const TOGETHER: usize = 8;

/// Which embedded points are determined by the last frame, elasticity and expected positions together.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct BodyObservability {
    /// Standard deviation of every point, m (root mean of the variances of its three coordinates).
    pub sigmas: Vec<f64>,
    /// Whether it is at most [`Self::threshold`].
    pub determined: Vec<bool>,
    /// The given threshold, m.
    pub threshold: f64,
}

impl BodyObservability {
    pub(crate) fn new(sigmas: Vec<f64>, threshold: f64) -> Self {
        Self {
            determined: sigmas.iter().map(|s| *s <= threshold).collect(),
            sigmas,
            threshold,
        }
    }
}

/// Covariances of points that were checked.
pub(crate) fn covariances(
    elastic: &Elastic,
    solved: &Solved,
    lattice: &Lattice,
    points: &[Embedding],
) -> Result<Vec<Matrix3<f64>>, Error> {
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.sort_by_key(|&k| (lattice.cells()[points[k].cell as usize].place, k));
    let mut covariances = vec![Matrix3::zeros(); points.len()];
    let groups: Vec<&[usize]> = order
        .chunk_by(|&a, &b| points[a].cell == points[b].cell)
        .collect();
    for group in groups.chunks(TOGETHER) {
        let members = || group.iter().copied().flatten().map(|&k| (k, &points[k]));
        let nodes: BTreeSet<u32> = members()
            .flat_map(|(_, at)| corners(lattice, at).map(|(node, _)| node))
            .collect();
        let nodes: Vec<u32> = nodes.into_iter().collect();
        let unknowns: Vec<u32> = nodes
            .iter()
            .flat_map(|n| [3 * n, 3 * n + 1, 3 * n + 2])
            .collect();
        let inverse = elastic
            .system()
            .selected_inverse(&solved.factor, &unknowns)?;
        for (k, at) in members() {
            let own: Vec<(usize, f64)> = corners(lattice, at)
                .map(|(node, w)| (3 * nodes.partition_point(|n| *n < node), w))
                .collect();
            let mut sum = Matrix3::zeros();
            for &(i, wi) in &own {
                for &(j, wj) in &own {
                    sum += inverse.fixed_view::<3, 3>(i, j) * (wi * wj);
                }
            }
            covariances[k] = elastic.frame().tr_mul(&sum) * elastic.frame();
        }
    }
    Ok(covariances)
}
