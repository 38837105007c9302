//! The field: a partition of unity of nodal fits, in trapezoid form.
//!
//! ```text
//! ψ_i(p) = W(‖p − x_i‖ / ρ_i(p)) / Σ_j W(‖p − x_j‖ / ρ_j(p)),      ρ_i(p) = ρ_i + min_j ‖p − x_j‖
//! Ḡ(p)   = Σ ψ_i G_i
//! u(p)   = Σ ψ_i [ u_i + (G_i + Ḡ)(p − x_i)/2 ]
//! ```
//!
//! The bracket integrates the gradient from node to point by the trapezoid rule, which cancels the second-order error
//! that a straight extension `u_i + G_i (p − x_i)` makes on a bent surface. The support grows with the distance
//! to the nearest node, so that a point off the surface sees a wider patch of it and no point of space is without nodes.
//!
//! The gradient is exact, `ψ` included:
//!
//! ```text
//! ∇u = Ḡ + Σ_i [ u_i + (G_i + Ḡ)(p − x_i)/2 + G_i (p − x̄)/2 ] ⊗ ∇ψ_i,      x̄ = Σ ψ_i x_i
//! ```

use nalgebra::{Matrix3, Point3, Rotation3, Unit, UnitVector3, Vector3};

use crate::error::{Error, check_coordinates, check_length};
use crate::nodal::{self, NodalFit, weight_at};
use crate::options::{Determinacy, FieldOptions, Sample, Support};
use crate::rotation::nearest_rotation;
use crate::shape;
use crate::tree::Tree;

/// Nodes that the linear shape functions take.
const SHAPE_NODES: usize = 8;

/// A deformation field on scattered nodes.
///
/// # Guarantees
/// Translations are reproduced exactly; rigid motions, half turns included, to rounding, on and off the surface, wherever the nodes
/// within reach are not all on a line. The field is continuous, and differentiable except where the nearest node
/// changes. Results depend on the input alone, to the bit.
///
/// # Limits
/// The strain across a surface cannot be known from nodes on it ([`Determinacy::Partly`]); the local rotation stands in.
/// A node value is met to a few hundredths of the local bending, not exactly: this is a fit.
///
/// # Complexity
/// `O(N k)` to build after an `O(N log N)` tree, `O(log N + k)` an evaluation, with `k` nodes in reach.
///
/// ```
/// use gpwrm::{Field, FieldOptions};
/// use nalgebra::{Point3, Rotation3, Vector3};
///
/// let nodes: Vec<_> = (0..36).map(|k| Point3::new(f64::from(k % 6), f64::from(k / 6), 0.0) * 0.01).collect();
/// let turn = Rotation3::from_axis_angle(&Vector3::x_axis(), 2.5);
/// let motion: Vec<_> = nodes.iter().map(|p| turn * p - p).collect();
/// let field = Field::new(&nodes, &motion, &FieldOptions::default())?;
///
/// let above = Point3::new(0.02, 0.03, 0.015); // off the sheet of nodes
/// assert!((above + field.displacement(&above) - turn * above).norm() < 1e-12);
/// # Ok::<(), gpwrm::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Field {
    nodes: Vec<Point3<f64>>,
    displacements: Vec<Vector3<f64>>,
    fits: Vec<NodalFit>,
    radii: Vec<f64>,
    tree: Tree,
    reach: Reach,
    options: FieldOptions,
}

/// For every node `n`, the nodes that can weigh at a point whose nearest node is `n`, by the distance from which on
/// they do: spares a tree search per evaluation near the surface.
#[derive(Debug, Clone)]
struct Reach {
    /// `lists[starts[n]..starts[n + 1]]` belongs to node `n`, sorted by `gap`.
    starts: Vec<usize>,
    lists: Vec<Candidate>,
    largest_radius: f64,
}

#[derive(Debug, Clone, Copy)]
struct Candidate {
    node: usize,
    /// `‖x_n − x_i‖ − ρ_i`: node `i` weighs only at points farther than half of this from `n`.
    gap: f64,
}

/// One node's part in an evaluation.
struct Part {
    node: usize,
    weight: f64,
    slope: Vector3<f64>,
}

impl Field {
    /// The field through `displacements` of `nodes`.
    ///
    /// # Errors
    /// No nodes, slices of different lengths, coordinates that are not finite, or options out of range.
    pub fn new(
        nodes: &[Point3<f64>],
        displacements: &[Vector3<f64>],
        options: &FieldOptions,
    ) -> Result<Self, Error> {
        options.check()?;
        check_length("displacements", nodes.len(), displacements.len())?;
        check_coordinates("node", nodes.iter().map(|p| &p.coords))?;
        check_coordinates("displacement", displacements.iter())?;
        let tree = Tree::new(nodes).ok_or(Error::NoNodes)?;
        let radii = node_radii(nodes, &tree, options.support);
        let fits = (0..nodes.len())
            .map(|i| fit(i, nodes, displacements, &tree, radii[i], options))
            .collect();
        let reach = Reach::new(nodes, &tree, &radii);
        Ok(Self {
            nodes: nodes.to_vec(),
            displacements: displacements.to_vec(),
            fits,
            radii,
            tree,
            reach,
            options: options.clone(),
        })
    }

    /// Displacement, gradient, and how far either can be believed.
    ///
    /// At a point that is not finite the sample is zero, undetermined, and infinitely far.
    pub fn evaluate(&self, p: &Point3<f64>) -> Sample {
        let Some((parts, distance)) = self.parts(p) else {
            return Sample {
                displacement: Vector3::zeros(),
                gradient: Matrix3::zeros(),
                determinacy: Determinacy::Undetermined,
                extrapolation: f64::INFINITY,
            };
        };
        let mean = self.mean_gradient(&parts);
        let centre: Vector3<f64> = parts
            .iter()
            .map(|part| part.weight * (p - self.nodes[part.node]))
            .sum();
        let mut displacement = Vector3::zeros();
        let mut gradient = mean;
        for part in &parts {
            let value = self.value_from(part.node, p, &mean);
            displacement += part.weight * value;
            let bracket = value + self.fits[part.node].gradient * centre / 2.0;
            gradient += bracket * part.slope.transpose();
        }
        Sample {
            displacement,
            gradient,
            determinacy: self.determinacy(&parts),
            extrapolation: distance,
        }
    }

    /// Displacement at `p`, in m; zero if `p` is not finite.
    pub fn displacement(&self, p: &Point3<f64>) -> Vector3<f64> {
        let Some((parts, _)) = self.parts(p) else {
            return Vector3::zeros();
        };
        let mean = self.mean_gradient(&parts);
        parts
            .iter()
            .map(|part| part.weight * self.value_from(part.node, p, &mean))
            .sum()
    }

    /// `p + u(p)` for every point.
    pub fn warp(&self, points: &[Point3<f64>]) -> Vec<Point3<f64>> {
        let moved = |p: &Point3<f64>| p + self.displacement(p);
        #[cfg(feature = "rayon")]
        {
            use rayon::prelude::*;
            points.par_iter().map(moved).collect()
        }
        #[cfg(not(feature = "rayon"))]
        points.iter().map(moved).collect()
    }

    /// Normals carried by the field: `n' ∝ F⁻ᵀ n`, at the points where they stand before the motion.
    ///
    /// Computed with the cofactor matrix, `det F · F⁻ᵀ`, which exists even where the field folds; where it kills the normal,
    /// the local rotation turns it instead.
    ///
    /// # Errors
    /// Slices of different lengths.
    pub fn warp_normals(
        &self,
        points: &[Point3<f64>],
        normals: &[UnitVector3<f64>],
    ) -> Result<Vec<UnitVector3<f64>>, Error> {
        check_length("normals", points.len(), normals.len())?;
        let turned = |(p, n): (&Point3<f64>, &UnitVector3<f64>)| {
            let f = Matrix3::identity() + self.evaluate(p).gradient;
            let carried = cofactor(&f) * n.as_ref() * f.determinant().signum();
            Unit::try_new(carried, 1e-12).unwrap_or_else(|| nearest_rotation(&f) * n)
        };
        Ok(points.iter().zip(normals).map(turned).collect())
    }

    /// The rotation in the deformation gradient at `p`.
    pub fn rotation(&self, p: &Point3<f64>) -> Rotation3<f64> {
        nearest_rotation(&(Matrix3::identity() + self.evaluate(p).gradient))
    }

    /// The field from live to rest: every node stands at `x + u` and moves by `−u`.
    ///
    /// The two are inverse to each other at the nodes to the accuracy of the fit and between them to that of interpolation; for rigid
    /// motions exactly.
    ///
    /// # Errors
    /// A node whose moved position exceeds the coordinate bound.
    pub fn inverse(&self) -> Result<Self, Error> {
        let moved: Vec<Point3<f64>> = self
            .nodes
            .iter()
            .zip(&self.displacements)
            .map(|(x, u)| x + u)
            .collect();
        let back: Vec<Vector3<f64>> = self.displacements.iter().map(|u| -u).collect();
        Self::new(&moved, &back, &self.options)
    }

    /// Linear scalar shape functions at `p` over its 8 nearest nodes: see [`ShapeFunctions`](crate::ShapeFunctions).
    pub fn shape_functions(&self, p: &Point3<f64>) -> Vec<(usize, f64)> {
        shape::linear(&self.nodes, &self.tree, p, SHAPE_NODES)
    }

    /// The nodes, in the order given.
    pub fn nodes(&self) -> &[Point3<f64>] {
        &self.nodes
    }

    /// The displacements of the nodes, in the order given.
    pub fn node_displacements(&self) -> &[Vector3<f64>] {
        &self.displacements
    }

    /// `u_i + (G_i + Ḡ)(p − x_i)/2`.
    fn value_from(&self, i: usize, p: &Point3<f64>, mean: &Matrix3<f64>) -> Vector3<f64> {
        let step = (p - self.nodes[i]) / 2.0;
        self.displacements[i] + (self.fits[i].gradient + mean) * step
    }

    fn mean_gradient(&self, parts: &[Part]) -> Matrix3<f64> {
        parts
            .iter()
            .map(|part| part.weight * self.fits[part.node].gradient)
            .sum()
    }

    /// The level that nodes with at least half of the weight reach.
    fn determinacy(&self, parts: &[Part]) -> Determinacy {
        let share = |level: Determinacy| -> f64 {
            parts
                .iter()
                .filter(|part| self.fits[part.node].determinacy >= level)
                .map(|part| part.weight)
                .sum()
        };
        if share(Determinacy::Determined) >= 0.5 {
            Determinacy::Determined
        } else if share(Determinacy::Partly) >= 0.5 {
            Determinacy::Partly
        } else {
            Determinacy::Undetermined
        }
    }

    /// `ψ` and `∇ψ` of the nodes in reach, and the distance to the nearest; nothing if `p` is not finite.
    fn parts(&self, p: &Point3<f64>) -> Option<(Vec<Part>, f64)> {
        if !p.coords.amax().is_finite() {
            return None;
        }
        let nearest = self.tree.nearest(p);
        let distance = (p - self.nodes[nearest.index]).norm();
        if !distance.is_finite() {
            return None;
        }
        let outward = if distance > 0.0 {
            (p - self.nodes[nearest.index]) / distance
        } else {
            Vector3::zeros()
        };
        let mut parts = Vec::with_capacity(32);
        self.reach.visit(
            nearest.index,
            self.radii[nearest.index],
            distance,
            p,
            &self.tree,
            |i| {
                parts.extend(self.raw_part(i, p, distance, &outward));
            },
        );
        let total: f64 = parts.iter().map(|part| part.weight).sum();
        if total < 1e-200 {
            // So far away that all weights underflow: the nearest node speaks for all.
            let node = nearest.index;
            let slope = Vector3::zeros();
            let weight = 1.0;
            return Some((
                vec![Part {
                    node,
                    weight,
                    slope,
                }],
                distance,
            ));
        }
        let drift: Vector3<f64> = parts.iter().map(|part| part.slope).sum::<Vector3<f64>>() / total;
        for part in &mut parts {
            part.weight /= total;
            part.slope = part.slope / total - part.weight * drift;
        }
        Some((parts, distance))
    }

    /// `W` and `∇W` before normalisation.
    fn raw_part(
        &self,
        i: usize,
        p: &Point3<f64>,
        distance: f64,
        outward: &Vector3<f64>,
    ) -> Option<Part> {
        let d = p - self.nodes[i];
        let radius = self.radii[i] + distance;
        if radius <= 0.0 {
            // All nodes coincide, and `p` with them.
            let (weight, slope) = (1.0, Vector3::zeros());
            return Some(Part {
                node: i,
                weight,
                slope,
            });
        }
        let t2 = d.norm_squared() / (radius * radius);
        if t2 >= 1.0 {
            return None;
        }
        let (weight, t) = (self.options.weight, t2.sqrt());
        let slope = weight.slope_over_t(t) * (d / (radius * radius) - outward * (t2 / radius));
        Some(Part {
            node: i,
            weight: weight.value(t),
            slope,
        })
    }
}

impl Reach {
    fn new(nodes: &[Point3<f64>], tree: &Tree, radii: &[f64]) -> Self {
        let largest_radius = radii.iter().copied().fold(0.0, f64::max);
        let mut starts = vec![0];
        let mut lists = Vec::new();
        for (n, x) in nodes.iter().enumerate() {
            let begin = lists.len();
            for near in tree.within(x, largest_radius + Self::span(radii[n])) {
                let gap = near.distance - radii[near.index];
                if gap < Self::span(radii[n]) {
                    lists.push(Candidate {
                        node: near.index,
                        gap,
                    });
                }
            }
            lists[begin..].sort_by(|a, b| a.gap.total_cmp(&b.gap).then(a.node.cmp(&b.node)));
            starts.push(lists.len());
        }
        Self {
            starts,
            lists,
            largest_radius,
        }
    }

    /// Lists are complete for points closer to their node than half of this: with the usual reach that is somewhat more than half
    /// a spacing, so that points on the surface need no search and lists stay short.
    fn span(radius: f64) -> f64 {
        0.6 * radius
    }

    /// Calls `take` for every node that can weigh at `p`, whose nearest node `n` is `distance` away.
    fn visit(
        &self,
        n: usize,
        own_radius: f64,
        distance: f64,
        p: &Point3<f64>,
        tree: &Tree,
        mut take: impl FnMut(usize),
    ) {
        let list = &self.lists[self.starts[n]..self.starts[n + 1]];
        let complete = 2.0 * distance < Self::span(own_radius);
        if complete {
            list.iter()
                .take_while(|c| c.gap <= 2.0 * distance)
                .for_each(|c| take(c.node));
        } else {
            for near in tree.within(p, self.largest_radius + distance) {
                take(near.index);
            }
        }
    }
}

/// The cofactor matrix, `det F · F⁻ᵀ`.
fn cofactor(f: &Matrix3<f64>) -> Matrix3<f64> {
    let (a, b, c) = (f.column(0), f.column(1), f.column(2));
    Matrix3::from_columns(&[b.cross(&c), c.cross(&a), a.cross(&b)])
}

/// `ρ_i`.
fn node_radii(nodes: &[Point3<f64>], tree: &Tree, support: Support) -> Vec<f64> {
    match support {
        Support::Radius(radius) => vec![radius; nodes.len()],
        Support::Nearest(count) => nodes
            .iter()
            .map(|x| {
                // The node itself comes first, and one more closes the support: there the weight is zero.
                let wanted = count.saturating_add(2).min(nodes.len());
                let near = tree.nearest_n(x, wanted);
                let last = near.last().map_or(0.0, |n| n.distance);
                if near.len() == count.saturating_add(2) {
                    last
                } else {
                    1.5 * last
                }
            })
            .collect(),
    }
}

/// The fit of node `i` to the nodes within its radius.
fn fit(
    i: usize,
    nodes: &[Point3<f64>],
    displacements: &[Vector3<f64>],
    tree: &Tree,
    radius: f64,
    options: &FieldOptions,
) -> NodalFit {
    let samples: Vec<nodal::Sample> = tree
        .within(&nodes[i], radius)
        .iter()
        .map(|near| nodal::Sample {
            weight: weight_at(options.weight, near.distance, radius),
            position: &nodes[near.index],
            displacement: &displacements[near.index],
        })
        .collect();
    NodalFit::new(&samples, options.shrinkage)
}
