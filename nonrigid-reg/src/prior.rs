//! The prior on motions: gradients of neighbours agree, and strain is small. Both are measured in the frame that turns with the
//! node, so that a rotation by any angle costs nothing.
//!
//! ```text
//! ê_ij = R_iᵀ (d_ij + u_j − u_i) − d_ij           d_ij = x_j − x_i, R_i the local rotation so far
//! Ĝ_i  = argmin_G Σ_j w_ij |ê_ij − G d_ij|² + κ τ_i |sym G|²
//! E    = (λ_b/N) Σ_i Σ_j w_ij |ê_ij − Ĝ_i d_ij|² + (λ_s r²/N) Σ_i |sym Ĝ_i|²
//! R_i ← R_i polar(I + Ĝ_i)                          after every solve
//! ```
//!
//! With `ĉ_i = vec Σ_j w_ij ê_ij d_ijᵀ` and `S_i = M_i ⊗ I + κ τ_i P`, `P` the projection on symmetric matrices, `Ĝ_i` is `S_i⁻¹ ĉ_i`, and
//!
//! ```text
//! Σ_j w |ê − Ĝ d|² = Σ_j w |ê|² − ĉᵀ (2 S⁻¹ − S⁻¹ (M ⊗ I) S⁻¹) ĉ         |sym Ĝ|² = ĉᵀ S⁻¹ P S⁻¹ ĉ
//! ĉ = (I ⊗ R)ᵀ c + vec((R − I)ᵀ M),      c = vec Σ_j w_ij (u_j − u_i) d_ijᵀ
//! ```
//!
//! so that one 9 × 9 form per node, made once, holds its whole contribution; per iteration it is only rotated.

use gpwrm::nearest_rotation;
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use crate::nodes::Nodes;
use crate::system::{Structure, System};

type Matrix9 = SMatrix<f64, 9, 9>;
type Vector9 = SVector<f64, 9>;

/// `κ`: ties the gradient across the surface, which no neighbour determines, to that of a rotation.
const SHEAR: f64 = 0.05;
/// Keeps `S` invertible for nodes on a line, whose rotation about the line is not determined.
const LINE: f64 = 1e-6;

/// The prior of one node.
struct NodePrior {
    /// Coefficient of each node's displacement in `c`: `c = Σ_k γ_k ⊗ u_k`.
    terms: Vec<(usize, Vector3<f64>)>,
    /// The same, later nodes first, so that each node is followed by those whose blocks with it lie in the lower triangle.
    descending: Vec<(usize, Vector3<f64>)>,
    /// `M`.
    scatter: Matrix3<f64>,
    /// `S⁻¹`.
    inverse: Matrix9,
    /// Both energies as a form in `ĉ`, weights included, except for `Σ w |ê|²`.
    form: Matrix9,
}

/// The prior over all nodes.
#[derive(Default)]
pub(crate) struct Prior {
    nodes: Vec<NodePrior>,
    bending_weight: f64,
}

impl Prior {
    /// `bending` = `λ_b`, `strain` = `λ_s r²`.
    pub fn new(nodes: &Nodes, bending: f64, strain: f64) -> Self {
        let count = nodes.len() as f64;
        let weights = (bending / count, strain / count);
        Self {
            nodes: (0..nodes.len())
                .map(|i| NodePrior::new(i, nodes, weights))
                .collect(),
            bending_weight: weights.0,
        }
    }

    /// The nodes that the energy of each node couples.
    pub fn terms(&self) -> impl Iterator<Item = &[(usize, Vector3<f64>)]> {
        self.nodes.iter().map(|prior| prior.terms.as_slice())
    }

    /// Adds the part that does not depend on the rotations: `Σ w |u_j − u_i|²`.
    pub fn add_membrane(&self, nodes: &Nodes, structure: &Structure, system: &mut System) {
        for (i, links) in nodes.links.iter().enumerate() {
            for link in links {
                let w = self.bending_weight * link.weight;
                system.add_scalar(structure, i, i, w);
                system.add_scalar(structure, link.node, link.node, w);
                system.add_scalar(structure, i, link.node, -w);
            }
        }
    }

    /// Adds the rest, at the given rotations.
    pub fn add_forms(
        &self,
        rotations: &[Matrix3<f64>],
        structure: &Structure,
        system: &mut System,
    ) {
        for (prior, r) in self.nodes.iter().zip(rotations) {
            let turned = r.transpose() - Matrix3::identity();
            let offset = prior.form * vector(&(turned * prior.scatter));
            // The gradient of Σ w |ê|²: every neighbour is pulled to where the rotation alone takes it.
            let rigid = vector(&turned.transpose()) * self.bending_weight;
            let pull = rotate(r, &offset) - rigid;
            prior.add(&conjugate(r, &prior.form), &pull, structure, system);
        }
    }

    /// The local rotations under `displacements`, starting from the previous ones.
    pub fn rotations(
        &self,
        displacements: &[Vector3<f64>],
        rotations: &[Matrix3<f64>],
    ) -> Vec<Matrix3<f64>> {
        let turn = |(prior, r): (&NodePrior, &Matrix3<f64>)| {
            let g = prior.gradient(displacements, r);
            r * nearest_rotation(&(Matrix3::identity() + g)).into_inner()
        };
        self.nodes.iter().zip(rotations).map(turn).collect()
    }
}

impl NodePrior {
    fn new(i: usize, nodes: &Nodes, (bending, strain): (f64, f64)) -> Self {
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
        let mut descending = terms.clone();
        descending.sort_unstable_by_key(|&(k, _)| std::cmp::Reverse(k));
        let trace = scatter.trace();
        let data = kronecker(&scatter);
        let s =
            data + symmetric_projection() * (SHEAR * trace) + Matrix9::identity() * (LINE * trace);
        // A single node has no scatter: its gradient and its energy are zero.
        let inverse = s
            .cholesky()
            .map_or_else(Matrix9::zeros, |factor| factor.inverse());
        let strained = inverse * symmetric_projection() * inverse;
        Self {
            form: strained * strain - (2.0 * inverse - inverse * data * inverse) * bending,
            scatter,
            inverse,
            terms,
            descending,
        }
    }

    /// `Ĝ` in the frame turned by `r`.
    fn gradient(&self, displacements: &[Vector3<f64>], r: &Matrix3<f64>) -> Matrix3<f64> {
        let mut cross = self.scatter;
        for (k, gamma) in &self.terms {
            cross += displacements[*k] * gamma.transpose();
        }
        let c = vector(&(r.transpose() * cross - self.scatter));
        Matrix3::from_column_slice((self.inverse * c).as_slice())
    }

    /// Adds `cᵀ form c + 2 pullᵀ c`.
    fn add(&self, form: &Matrix9, pull: &Vector9, structure: &Structure, system: &mut System) {
        for (at, (k, gamma_k)) in self.descending.iter().enumerate() {
            // (γ_kᵀ ⊗ I) form: three rows, in three 3 × 3 blocks.
            let rows: SMatrix<f64, 3, 9> = form.fixed_rows::<3>(0) * gamma_k.x
                + form.fixed_rows::<3>(3) * gamma_k.y
                + form.fixed_rows::<3>(6) * gamma_k.z;
            let [x, y, z] = [0, 3, 6].map(|column| rows.fixed_columns::<3>(column).into_owned());
            for (l, gamma_l) in &self.descending[at..] {
                let block = x * gamma_l.x + y * gamma_l.y + z * gamma_l.z;
                system.add_block(structure, *k, *l, &block);
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
    Matrix9::from_fn(|row, column| {
        let straight = if row == column { 0.5 } else { 0.0 };
        let transposed = if (row % 3, row / 3) == (column / 3, column % 3) {
            0.5
        } else {
            0.0
        };
        straight + transposed
    })
}

fn vector(m: &Matrix3<f64>) -> Vector9 {
    Vector9::from_column_slice(m.as_slice())
}

/// `(I ⊗ R) v`.
fn rotate(r: &Matrix3<f64>, v: &Vector9) -> Vector9 {
    vector(&(r * Matrix3::from_column_slice(v.as_slice())))
}

/// `(I ⊗ R) F (I ⊗ R)ᵀ`.
fn conjugate(r: &Matrix3<f64>, form: &Matrix9) -> Matrix9 {
    let mut turned = Matrix9::zeros();
    for a in [0, 3, 6] {
        for b in [0, 3, 6] {
            let block = r * form.fixed_view::<3, 3>(a, b) * r.transpose();
            turned.fixed_view_mut::<3, 3>(a, b).copy_from(&block);
        }
    }
    turned
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::system::Solver;
    use nalgebra::{Point3, Rotation3};

    const WEIGHTS: (f64, f64) = (1.3, 0.4);

    fn nodes() -> Nodes {
        let points: Vec<Point3<f64>> = (0..60)
            .map(|k| {
                let (x, y) = (f64::from(k % 10), f64::from(k / 10));
                Point3::new(x, y, (0.7 * x).sin() + (0.9 * y).cos())
            })
            .collect();
        Nodes::new(&points, std::iter::empty(), 1.0).unwrap()
    }

    /// The energy as the head of this file defines it, with the smallest value over `G` found by elimination, not by the form.
    fn energy(nodes: &Nodes, u: &[Vector3<f64>], rotations: &[Matrix3<f64>]) -> f64 {
        let mut total = 0.0;
        for (i, links) in nodes.links.iter().enumerate() {
            let r = rotations[i];
            let local =
                |l: &crate::nodes::Link| r.transpose() * (l.offset + u[l.node] - u[i]) - l.offset;
            let trace: f64 = links
                .iter()
                .map(|l| l.weight * l.offset.norm_squared())
                .sum();
            // Normal equations of the nine entries of G, row by row of the residuals.
            let (mut h, mut f) = (Matrix9::identity() * (LINE * trace), Vector9::zeros());
            let mut add = |row: Vector9, value: f64, weight: f64| {
                h += row * row.transpose() * weight;
                f += row * (value * weight);
            };
            for l in links {
                let e = local(l);
                for a in 0..3 {
                    let row =
                        Vector9::from_fn(|k, _| if k % 3 == a { l.offset[k / 3] } else { 0.0 });
                    add(row, e[a], l.weight);
                }
            }
            for a in 0..3 {
                for b in 0..3 {
                    let row = Vector9::from_fn(|k, _| {
                        let on = |x: usize, y: usize| f64::from(u8::from((k % 3, k / 3) == (x, y)));
                        0.5 * (on(a, b) + on(b, a))
                    });
                    add(row, 0.0, SHEAR * trace);
                }
            }
            let g = h.cholesky().unwrap().solve(&f);
            let g = Matrix3::from_column_slice(g.as_slice());
            let bent: f64 = links
                .iter()
                .map(|l| l.weight * (local(l) - g * l.offset).norm_squared())
                .sum();
            let strain = ((g + g.transpose()) / 2.0).norm_squared();
            total += (WEIGHTS.0 * bent + WEIGHTS.1 * strain) / nodes.len() as f64;
        }
        total
    }

    fn wild(count: usize, size: f64) -> Vec<Vector3<f64>> {
        let wave = |k: usize, a: f64| size * (1.7 * k as f64 + a).sin();
        (0..count)
            .map(|k| Vector3::new(wave(k, 0.0), wave(k, 1.0), wave(k, 2.5)))
            .collect()
    }

    /// The assembled equations are the slope of the energy, by central differences: `H u − f = ½ ∇E`.
    #[test]
    fn the_equations_are_the_slope_of_the_energy() {
        let nodes = nodes();
        let prior = Prior::new(&nodes, WEIGHTS.0, WEIGHTS.1);
        let none: [&[(usize, f64)]; 0] = [];
        let structure = Structure::new(nodes.len(), none.into_iter(), prior.terms()).unwrap();
        let turned =
            |k: usize| Rotation3::from_euler_angles(0.4 + 0.01 * k as f64, -0.9, 1.3).into_inner();
        let rotations: Vec<_> = (0..nodes.len()).map(turned).collect();
        let u = wild(nodes.len(), 0.3);
        let mut system = System::default();
        system.reset(&structure);
        prior.add_membrane(&nodes, &structure, &mut system);
        prior.add_forms(&rotations, &structure, &mut system);
        let slope = system.residual(&structure, &u);
        for (k, a) in [(0, 0), (7, 1), (23, 2), (59, 0)] {
            let h = 1e-4;
            let at = |step: f64| {
                let mut moved = u.clone();
                moved[k][a] += step;
                energy(&nodes, &moved, &rotations)
            };
            let difference = (at(h) - at(-h)) / (4.0 * h);
            assert!((slope[k][a] - difference).abs() < 1e-9, "{k} {a}");
        }
    }

    /// A rigid motion by any angle is free of energy and of force, and is recognised as what it is.
    #[test]
    fn rotations_cost_nothing() {
        let nodes = nodes();
        let prior = Prior::new(&nodes, WEIGHTS.0, WEIGHTS.1);
        let none: [&[(usize, f64)]; 0] = [];
        let structure = Structure::new(nodes.len(), none.into_iter(), prior.terms()).unwrap();
        for angle in [0.2, 1.0, 2.0, 3.0] {
            let r = Rotation3::from_euler_angles(angle, 0.3, -0.5 * angle).into_inner();
            let shift = Vector3::new(4.0, -2.0, 1.0);
            let u: Vec<_> = nodes
                .positions
                .iter()
                .map(|p| r * p.coords + shift - p.coords)
                .collect();
            let rotations = prior.rotations(&u, &vec![r; nodes.len()]);
            assert!(rotations.iter().all(|found| (found - r).norm() < 1e-9));
            let mut system = System::default();
            system.reset(&structure);
            prior.add_membrane(&nodes, &structure, &mut system);
            prior.add_forms(&rotations, &structure, &mut system);
            let force = system.residual(&structure, &u);
            assert!(force.iter().all(|f| f.norm() < 1e-9), "{angle}");
            // Held at three nodes, everything else follows.
            for k in [0, 9, 55] {
                system.add_scalar(&structure, k, k, 1.0);
                system.add_right(k, &u[k]);
            }
            let solved = Solver::default().solve(&structure, &system).unwrap();
            let worst = solved
                .iter()
                .zip(&u)
                .map(|(a, b)| (a - b).norm())
                .fold(0.0, f64::max);
            assert!(worst < 1e-6, "{angle} {worst}");
        }
    }
}
