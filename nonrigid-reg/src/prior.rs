//! What a plausible motion is: neighbours agree with each other's gradient, and strain is small.
//!
//! ```text
//! g_i = argmin_G Σ_j w_ij |e_ij − G d_ij|² + κ τ_i |sym G|²,        e_ij = u_j − u_i,  d_ij = x_j − x_i
//! E   = (λ_b/N) Σ_i Σ_j w_ij |e_ij − G_i d_ij|² + (λ_s r²/N) Σ_i |sym(R_iᵀ(I + G_i)) − I|²
//! ```
//!
//! `G_i` is linear in the displacements: with `c_i = vec Σ_j w_ij e_ij d_ijᵀ` it is `g_i = S_i⁻¹ c_i`,
//! `S_i = M_i ⊗ I + κ τ_i P`, `P` the projection on symmetric matrices. So both energies are quadratic forms of `c_i`,
//!
//! ```text
//! Σ_j w |e − G d|²  = Σ_j w |e|² − cᵀ (2 S⁻¹ − S⁻¹ (M ⊗ I) S⁻¹) c
//! |sym(Rᵀ(I+G)) − I|² = cᵀ S⁻¹ P_R S⁻¹ c + 2 q_Rᵀ S⁻¹ c + const
//! P_R g = (G + R Gᵀ R)/2        q_R = (I + R²)/2 − R
//! ```
//!
//! and one 9 × 9 matrix per node carries its whole contribution. The first is made once per frame, the second whenever `R_i` changes.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use crate::nodes::Nodes;
use crate::system::System;

type Matrix9 = SMatrix<f64, 9, 9>;
type Vector9 = SVector<f64, 9>;

/// `κ`: ties the gradient across the surface, which no neighbour determines, to a rotation.
const SHEAR: f64 = 0.05;
/// Keeps `S` invertible for nodes on a line, whose rotation about the line nothing determines.
const LINE: f64 = 1e-6;

/// The prior of one node.
struct NodePrior {
    /// Coefficient of each node's displacement in `c`: `c = Σ_k γ_k ⊗ u_k`.
    terms: Vec<(usize, Vector3<f64>)>,
    inverse: Matrix9,
    bending: Matrix9,
}

/// The prior over all nodes.
#[derive(Default)]
pub(crate) struct Prior {
    nodes: Vec<NodePrior>,
    bending_weight: f64,
    strain_weight: f64,
}

impl Prior {
    /// `bending` = `λ_b`, `strain` = `λ_s r²`.
    pub fn new(nodes: &Nodes, bending: f64, strain: f64) -> Self {
        let count = nodes.len() as f64;
        Self {
            nodes: (0..nodes.len()).map(|i| NodePrior::new(i, nodes)).collect(),
            bending_weight: bending / count,
            strain_weight: strain / count,
        }
    }

    /// Adds the part that does not depend on the rotations: `Σ w |e|²`.
    pub fn add_membrane(&self, nodes: &Nodes, system: &mut System) {
        for (i, links) in nodes.links.iter().enumerate() {
            for link in links {
                let w = self.bending_weight * link.weight;
                system.add_scalar(i, i, w);
                system.add_scalar(link.node, link.node, w);
                system.add_scalar(i, link.node, -w);
            }
        }
    }

    /// Adds the quadratic forms of `c`, at the rotations given.
    pub fn add_forms(&self, rotations: &[Matrix3<f64>], system: &mut System) {
        for (prior, rotation) in self.nodes.iter().zip(rotations) {
            let strain = prior.inverse * strain_form(rotation) * prior.inverse;
            let form = self.strain_weight * strain - self.bending_weight * prior.bending;
            let pull = prior.inverse * strain_pull(rotation) * self.strain_weight;
            prior.add(&form, &pull, system);
        }
    }

    /// `G_i` of every node under `displacements`.
    pub fn gradients(&self, displacements: &[Vector3<f64>]) -> Vec<Matrix3<f64>> {
        self.nodes
            .iter()
            .map(|prior| {
                let mut cross = Matrix3::zeros();
                for (k, gamma) in &prior.terms {
                    cross += displacements[*k] * gamma.transpose();
                }
                let g = prior.inverse * Vector9::from_column_slice(cross.as_slice());
                Matrix3::from_column_slice(g.as_slice())
            })
            .collect()
    }
}

impl NodePrior {
    fn new(i: usize, nodes: &Nodes) -> Self {
        let links = &nodes.links[i];
        let mut scatter = Matrix3::zeros();
        let mut own = Vector3::zeros();
        let mut terms = Vec::with_capacity(links.len() + 1);
        for link in links {
            let gamma = link.weight * link.offset;
            scatter += gamma * link.offset.transpose();
            own -= gamma;
            terms.push((link.node, gamma));
        }
        terms.push((i, own));
        let trace = scatter.trace();
        let data = kronecker(&scatter);
        let s =
            data + symmetric_projection() * (SHEAR * trace) + Matrix9::identity() * (LINE * trace);
        // A lone node has no spread: no gradient, and its energy is nothing.
        let inverse = s
            .cholesky()
            .map_or_else(Matrix9::zeros, |factor| factor.inverse());
        Self {
            bending: 2.0 * inverse - inverse * data * inverse,
            inverse,
            terms,
        }
    }

    /// Adds `cᵀ form c + 2 pullᵀ c`.
    fn add(&self, form: &Matrix9, pull: &Vector9, system: &mut System) {
        for (k, gamma_k) in &self.terms {
            // (γ_kᵀ ⊗ I) form: three rows, in three 3 × 3 blocks.
            let rows: SMatrix<f64, 3, 9> = form.fixed_rows::<3>(0) * gamma_k.x
                + form.fixed_rows::<3>(3) * gamma_k.y
                + form.fixed_rows::<3>(6) * gamma_k.z;
            for (l, gamma_l) in &self.terms {
                if l <= k {
                    let block = rows.fixed_columns::<3>(0) * gamma_l.x
                        + rows.fixed_columns::<3>(3) * gamma_l.y
                        + rows.fixed_columns::<3>(6) * gamma_l.z;
                    system.add_block(*k, *l, &block);
                }
            }
            let force = pull.fixed_rows::<3>(0) * gamma_k.x
                + pull.fixed_rows::<3>(3) * gamma_k.y
                + pull.fixed_rows::<3>(6) * gamma_k.z;
            system.add_right(*k, &-force);
        }
    }
}

/// `M ⊗ I`: acts on `vec G` as `G ↦ G M`.
fn kronecker(m: &Matrix3<f64>) -> Matrix9 {
    Matrix9::from_fn(|r, c| {
        if r % 3 == c % 3 {
            m[(r / 3, c / 3)]
        } else {
            0.0
        }
    })
}

/// `vec G ↦ vec sym G`.
fn symmetric_projection() -> Matrix9 {
    strain_form(&Matrix3::identity())
}

/// `vec G ↦ vec (G + R Gᵀ R)/2`.
fn strain_form(r: &Matrix3<f64>) -> Matrix9 {
    // (R Gᵀ R)_{ab} = Σ R_{ad} G_{cd} R_{cb}
    Matrix9::from_fn(|row, column| {
        let (a, b, c, d) = (row % 3, row / 3, column % 3, column / 3);
        let straight = if row == column { 0.5 } else { 0.0 };
        straight + 0.5 * r[(a, d)] * r[(c, b)]
    })
}

/// `vec ((I + R²)/2 − R)`.
fn strain_pull(r: &Matrix3<f64>) -> Vector9 {
    let q = (Matrix3::identity() + r * r) / 2.0 - r;
    Vector9::from_column_slice(q.as_slice())
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;

    #[test]
    fn strain_form_expands_the_strain() {
        let r = Rotation3::from_euler_angles(0.4, -0.9, 1.3).into_inner();
        let g = Matrix3::new(0.1, -0.3, 0.2, 0.5, 0.0, -0.1, 0.05, 0.4, -0.2);
        let direct = |g: &Matrix3<f64>| {
            let f = r.transpose() * (Matrix3::identity() + g);
            ((f + f.transpose()) / 2.0 - Matrix3::identity()).norm_squared()
        };
        let v = Vector9::from_column_slice(g.as_slice());
        let form = v.dot(&(strain_form(&r) * v)) + 2.0 * strain_pull(&r).dot(&v);
        assert!((form - (direct(&g) - direct(&Matrix3::zeros()))).abs() < 1e-12);
    }
}
