//! Shape prior: every edge keeps its rest vector up to the rotation of its ends (as rigid as possible).
//!
//! ```text
//! min over x, R   Σ_i d_i ‖x_i − y_i‖² + Σ_i r_i ‖x_i − z_i‖² + Σ_e w_e ‖x_i − x_j − ½(R_i + R_j) E_e‖²
//! global   S x = d y + r z + Σ_e w_e ½(R_i + R_j) E_e         S = diag(d + r) + Σ_e w_e (e_i − e_j)(e_i − e_j)ᵀ
//! local    R_i = argmax tr(Rᵀ M_i),   M_i = Σ_{e∋i} w_e (x_i − x_j) E_eᵀ + δ tr · R⁻_i
//! ```
//!
//! `S` is constant over the alternations, so each costs three back-substitutions. Because the rotations are those at the linearisation
//! point, the iteration is the iterated form of an extended Kalman filter's update. Source: Sorkine and Alexa,
//! *As-rigid-as-possible surface modeling* (SGP 2007), section 3, with uniform weights; the pull to the predicted rotation is
//! an addition and matters only where the edges do not determine the rotation.

use nalgebra::{Matrix3, Point3, Rotation3, Vector3};

use crate::graph::Graph;
use crate::options::{Motion, Options};
use crate::rotation::nearest_rotation;
use crate::system::{Factor, System};
use crate::{Error, columns};

/// Result of the alternations.
pub(crate) struct Relaxed {
    pub positions: Vec<Point3<f64>>,
    pub rotations: Vec<Rotation3<f64>>,
    pub iterations: usize,
    pub last_move: f64,
    /// Right-hand side of the last global step, for displacements from the origin.
    pub pull: Vec<f64>,
}

/// Data that are constant over the alternations.
pub(crate) struct ShapePrior<'a> {
    pub graph: &'a Graph,
    /// Weight of every edge, `s_e/σ_e²`.
    pub weights: &'a [f64],
    /// Predicted rotations `R⁻`.
    pub predicted: &'a [Rotation3<f64>],
    /// Predicted positions `x⁻`; the unknowns are displacements from them.
    pub origin: &'a [Point3<f64>],
    /// Data part of the right-hand side, `r (z − x⁻) + d (y − x⁻)`, column-major.
    pub data: &'a [f64],
}

impl ShapePrior<'_> {
    /// Alternates until nothing moves or the largest number of iterations is reached.
    pub fn relax(
        &self,
        system: &mut System,
        factor: &Factor,
        options: &Options,
    ) -> Result<Relaxed, Error> {
        let mut positions = self.origin.to_vec();
        let mut rotations = self.predicted.to_vec();
        let (mut iterations, mut last_move) = (0, f64::INFINITY);
        let mut pull = vec![];
        while iterations < options.rotation_iterations && last_move > options.tolerance {
            pull = self.pull(&rotations);
            let next = self.solve(system, factor, &pull)?;
            last_move = positions
                .iter()
                .zip(&next)
                .map(|(a, b)| (a - b).norm())
                .fold(0.0, f64::max);
            positions = next;
            iterations += 1;
            match options.motion {
                Motion::Still => break,
                Motion::Spread => {
                    rotations = fit_rotations(
                        self.graph,
                        self.weights,
                        &positions,
                        self.predicted,
                        &rotations,
                        options.rotation_memory,
                    );
                }
            }
        }
        Ok(Relaxed {
            positions,
            rotations,
            iterations,
            last_move,
            pull,
        })
    }

    /// Right-hand side of the global step: data and rotated rest edges.
    fn pull(&self, rotations: &[Rotation3<f64>]) -> Vec<f64> {
        let mut pull = self.data.to_vec();
        for (e, &[i, j]) in self.graph.edges.iter().enumerate() {
            let (i, j) = (i as usize, j as usize);
            let rest = self.graph.vectors[e];
            let turned = (rotations[i] * rest + rotations[j] * rest) * 0.5;
            let force = (turned - (self.origin[i] - self.origin[j])) * self.weights[e];
            columns::add(&mut pull, i, &force);
            columns::add(&mut pull, j, &-force);
        }
        pull
    }

    /// Global step.
    fn solve(
        &self,
        system: &mut System,
        factor: &Factor,
        pull: &[f64],
    ) -> Result<Vec<Point3<f64>>, Error> {
        let mut shift = pull.to_vec();
        system.solve(factor, &mut shift);
        if let Some(at) = shift.iter().position(|v| !v.is_finite()) {
            return Err(Error::Overflow {
                vertex: at % self.origin.len(),
            });
        }
        Ok(self
            .origin
            .iter()
            .zip(columns::read(&shift))
            .map(|(p, d)| p + d)
            .collect())
    }
}

/// Local step: rotation of every vertex from its edges, pulled by `memory` (relative) to `prior`.
pub(crate) fn fit_rotations(
    graph: &Graph,
    weights: &[f64],
    positions: &[Point3<f64>],
    prior: &[Rotation3<f64>],
    guess: &[Rotation3<f64>],
    memory: f64,
) -> Vec<Rotation3<f64>> {
    let mut moments = vec![Matrix3::zeros(); positions.len()];
    let mut sizes = vec![0.0; positions.len()];
    for (e, &[i, j]) in graph.edges.iter().enumerate() {
        let (i, j) = (i as usize, j as usize);
        let rest: Vector3<f64> = graph.vectors[e];
        let moment = (positions[i] - positions[j]) * (rest * weights[e]).transpose();
        let size = weights[e] * rest.norm_squared();
        for k in [i, j] {
            moments[k] += moment;
            sizes[k] += size;
        }
    }
    (0..positions.len())
        .map(|i| {
            nearest_rotation(
                &(moments[i] + prior[i].matrix() * (memory * sizes[i])),
                &guess[i],
            )
        })
        .collect()
}
