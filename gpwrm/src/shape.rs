//! The field as a function of its nodes: exact shape functions, and the derivative by node.
//!
//! With fixed rotations `R_i`, every nodal gradient is linear in the displacements, and so is the field:
//!
//! ```text
//! v_i = (p − x_i)/2 + (p − x̄)/2,    x̄ = Σ ψ_i x_i,    K_i = (M_i + ε τ_i I)⁻¹
//! u(p) = Σ_i ψ_i (u_i + G_i v_i)
//! G_i v_i = Σ_j w_ij u_j (x_j − x̄_i)ᵀ K_i v_i + (R_i − I) s_i,    s_i = ε τ_i K_i v_i
//! φ_j(p) = ψ_j + Σ_i ψ_i w_ij (x_j − x̄_i)ᵀ K_i v_i
//! u(p) = Σ_j φ_j(p) u_j + turn(p),    turn(p) = Σ_i ψ_i (R_i − I) s_i,    Σ_j φ_j = 1
//! ```
//!
//! `s_i` is the part of the offset from node to point that the neighbours do not determine, so `turn` is the contribution of the local rotations
//! off the surface. It depends on the nodes too. From `A_i = M_i + C_i = R_i S_i`, `S_i` symmetric:
//!
//! ```text
//! ∂R_i/∂u_j = −R_i [s_i]× (tr S_i · I − S_i)⁻¹ [w_ij (x_j − x̄_i)/τ_i]× R_iᵀ        applied to s_i
//! ∂u/∂u_j   = φ_j I + Σ_i ψ_i (∂R_i/∂u_j) s_i
//! ```

use nalgebra::{Matrix3, Point3, Vector3};

use crate::field::Field;
use crate::moments::Moments;
use crate::options::Determinacy;
use crate::partition::Part;

/// The displacement at a point in terms of the nodes: `u(p) = Σ φ_j u_j + turn`.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Shape {
    /// Nodes and their `φ`, by index of the node; `Σ φ = 1`. Sparse: the neighbours of the nodes in reach.
    pub functions: Vec<(usize, f64)>,
    /// Contribution of the local rotations along directions that the nodes do not determine, in m.
    pub turn: Vector3<f64>,
}

impl Shape {
    /// `Σ φ_j u_j + turn`; nodes beyond the end of `displacements` count as not displaced.
    pub fn displacement(&self, displacements: &[Vector3<f64>]) -> Vector3<f64> {
        let moved = |&(j, phi): &(usize, f64)| displacements.get(j).map(|u| phi * u);
        self.turn
            + self
                .functions
                .iter()
                .filter_map(moved)
                .sum::<Vector3<f64>>()
    }
}

/// The contribution of the fit of one node at a point.
struct NodeShare {
    /// `ψ_i w_ij (x_j − x̄_i)ᵀ K_i v_i` by node `j`.
    functions: Vec<(usize, f64)>,
    /// `ψ_i s_i`.
    undetermined: Vector3<f64>,
}

impl Field {
    /// Shape functions of the field at `p`, for fixed rotations: `u(p) = Σ φ_j u_j + turn`, exactly.
    ///
    /// Empty, with zero displacement, if `p` is not finite.
    ///
    /// # Complexity
    /// `O(k²)` with `k` nodes in reach. [`ShapeFunctions`](crate::ShapeFunctions) are faster and purely linear, but shear patches that rotate.
    ///
    /// ```
    /// use gpwrm::{Field, FieldOptions, nalgebra::{Point3, Rotation3, Vector3}};
    /// let nodes: Vec<_> = (0..36).map(|k| Point3::new(f64::from(k % 6), f64::from(k / 6), 0.0) * 0.01).collect();
    /// let turn = Rotation3::from_axis_angle(&Vector3::x_axis(), 0.8);
    /// let moved: Vec<_> = nodes.iter().map(|x| turn * x - x).collect();
    /// let field = Field::new(&nodes, &moved, &FieldOptions::default())?;
    /// let p = Point3::new(0.021, 0.033, 0.01);
    /// let shape = field.shape(&p);
    /// assert!((shape.functions.iter().map(|f| f.1).sum::<f64>() - 1.0).abs() < 1e-12);
    /// assert!((shape.displacement(&moved) - field.displacement(&p)).norm() < 1e-12);
    /// # Ok::<(), gpwrm::Error>(())
    /// ```
    pub fn shape(&self, p: &Point3<f64>) -> Shape {
        let mut shape = Shape {
            functions: Vec::new(),
            turn: Vector3::zeros(),
        };
        for (part, way) in self.ways(p) {
            let share = self.share(&part, &way);
            let turned = self.fits[part.node].rotation.matrix() - Matrix3::identity();
            shape.turn += turned * share.undetermined;
            shape.functions.push((part.node, part.weight));
            shape.functions.extend(share.functions);
        }
        shape.functions = merged(shape.functions, |sum, more| *sum += more);
        shape
    }

    /// Nodes and `φ` at `p`: [`Field::shape`] without its `turn`.
    pub fn shape_functions(&self, p: &Point3<f64>) -> Vec<(usize, f64)> {
        self.shape(p).functions
    }

    /// Nodes and `∂u(p)/∂u_j` at `p`, by index of the node: the derivative of the displacement by each node, rotations included.
    ///
    /// Rotations of nodes whose neighbours do not determine them ([`Determinacy::Undetermined`]) are treated as fixed. Empty if `p` is not finite.
    ///
    /// # Complexity
    /// `O(k²)` with `k` nodes in reach.
    ///
    /// ```
    /// use gpwrm::{Field, FieldOptions, nalgebra::{Point3, Vector3}};
    /// # let nodes: Vec<_> = (0..36).map(|k| Point3::new(f64::from(k % 6), f64::from(k / 6), 0.0) * 0.01).collect();
    /// # let options = FieldOptions::default();
    /// let p = Point3::new(0.021, 0.033, 0.01); // off the sheet of nodes
    /// let still = Field::new(&nodes, &vec![Vector3::zeros(); 36], &options)?;
    /// // A small bend of the nodes: what it does at `p`, by the derivative and by a new field.
    /// let bend: Vec<_> = nodes.iter().map(|x| Vector3::new(0.0, 0.0, 1e-7 * (100.0 * x.x).sin())).collect();
    /// let predicted: Vector3<f64> = still.jacobian(&p).iter().map(|(j, block)| block * bend[*j]).sum();
    /// let found = Field::new(&nodes, &bend, &options)?.displacement(&p);
    /// assert!((found - predicted).norm() < 1e-3 * found.norm());
    /// # Ok::<(), gpwrm::Error>(())
    /// ```
    pub fn jacobian(&self, p: &Point3<f64>) -> Vec<(usize, Matrix3<f64>)> {
        let mut blocks = Vec::new();
        for (part, way) in self.ways(p) {
            let share = self.share(&part, &way);
            blocks.push((part.node, Matrix3::from_diagonal_element(part.weight)));
            blocks.extend(
                share
                    .functions
                    .iter()
                    .map(|&(j, phi)| (j, Matrix3::from_diagonal_element(phi))),
            );
            blocks.extend(self.rotation_blocks(part.node, &share.undetermined));
        }
        merged(blocks, |sum, more| *sum += more)
    }

    /// The nodes in reach of `p` with their `v_i`.
    fn ways(&self, p: &Point3<f64>) -> Vec<(Part, Vector3<f64>)> {
        let mut parts = Vec::new();
        if self.partition.at(p, &mut parts).is_none() {
            return Vec::new();
        }
        let from = |part: &Part| p - self.nodes()[part.node];
        let mean: Vector3<f64> = parts.iter().map(|part| part.weight * from(part)).sum();
        let way = |part: Part| (part, (from(&part) + mean) / 2.0);
        parts.into_iter().map(way).collect()
    }

    /// The contribution of the node of `part` for the offset `v`.
    fn share(&self, part: &Part, v: &Vector3<f64>) -> NodeShare {
        let (indices, samples) = self.neighbourhood(part.node);
        let shrinkage = self.options.shrinkage;
        let solved = Moments::new(&samples)
            .and_then(|moments| Some((moments.damped_inverse(shrinkage)? * v, moments)));
        let Some((solved, moments)) = solved else {
            return NodeShare {
                functions: Vec::new(),
                undetermined: part.weight * v,
            };
        };
        let weigh = |(&j, s): (&usize, &crate::moments::Sample)| {
            let offset = (s.position - moments.centre).dot(&solved);
            (j, part.weight * s.weight / moments.trace * offset)
        };
        NodeShare {
            functions: indices.iter().zip(&samples).map(weigh).collect(),
            undetermined: part.weight * shrinkage * solved,
        }
    }

    /// `(∂R_i/∂u_j) s` by node `j`.
    fn rotation_blocks(&self, i: usize, s: &Vector3<f64>) -> Vec<(usize, Matrix3<f64>)> {
        let fit = &self.fits[i];
        let (indices, samples) = self.neighbourhood(i);
        let known = fit.determinacy > Determinacy::Undetermined;
        let Some(moments) = Moments::new(&samples).filter(|_| known) else {
            return Vec::new();
        };
        let r = fit.rotation.matrix();
        let stretch = r.transpose() * (moments.scatter + moments.cross);
        let symmetric = (stretch + stretch.transpose()) / 2.0;
        let stiffness = Matrix3::from_diagonal_element(symmetric.trace()) - symmetric;
        let Some(inverse) = stiffness.try_inverse() else {
            return Vec::new();
        };
        let left = -r * s.cross_matrix() * inverse;
        let block = |(&j, sample): (&usize, &crate::moments::Sample)| {
            let lever = (sample.position - moments.centre) * (sample.weight / moments.trace);
            (j, left * lever.cross_matrix() * r.transpose())
        };
        indices.iter().zip(&samples).map(block).collect()
    }
}

/// Entries with equal nodes are summed, ordered by index of the node.
fn merged<T>(mut entries: Vec<(usize, T)>, add: impl Fn(&mut T, T)) -> Vec<(usize, T)> {
    // Stable sort, so that the order of summation is the order of the nodes in reach.
    entries.sort_by_key(|entry| entry.0);
    let mut sums: Vec<(usize, T)> = Vec::new();
    for (node, value) in entries {
        match sums.last_mut() {
            Some(last) if last.0 == node => add(&mut last.1, value),
            _ => sums.push((node, value)),
        }
    }
    sums
}
