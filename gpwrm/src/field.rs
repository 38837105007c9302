//! The field: a partition of unity of nodal fits, in trapezoid form.
//!
//! ```text
//! ψ_i(p) = W(‖p − x_i‖ / ρ_i(p)) / Σ_j W(‖p − x_j‖ / ρ_j(p)),      ρ_i(p) = ρ_i + min_j ‖p − x_j‖
//! Ḡ(p)   = Σ ψ_i G_i
//! u(p)   = Σ ψ_i [ u_i + (G_i + Ḡ)(p − x_i)/2 ]
//! ```
//!
//! The bracket integrates the gradient from node to point by the trapezoid rule, which cancels the second-order error
//! that a linear extrapolation `u_i + G_i (p − x_i)` has on a bent surface. The support grows with the distance
//! to the nearest node, so that a point off the surface uses a wider patch of it and every point of space has nodes in reach.
//!
//! The gradient is exact, `ψ` included:
//!
//! ```text
//! ∇u = Ḡ + Σ_i [ u_i + (G_i + Ḡ)(p − x_i)/2 + G_i (p − x̄)/2 ] ⊗ ∇ψ_i,      x̄ = Σ ψ_i x_i
//! ```

use nalgebra::{Matrix3, Point3, Rotation3, Vector3};

use crate::batch::map_indexed;
use crate::error::{Error, check_coordinates, check_length};
use crate::moments;
use crate::nodal::{NodalFit, weight_at};
use crate::options::{Determinacy, FieldOptions, Sample};
use crate::partition::{Part, Partition};
use crate::reach::node_radii;
use crate::rotation::nearest_rotation;
use crate::tree::Tree;

/// A deformation field on scattered nodes.
///
/// # Guarantees
/// Rigid motions, including half turns, are reproduced to rounding on and off the surface if three nodes are not collinear: a node whose own
/// neighbours are collinear, or missing, takes the undetermined part of its rotation from the nearest node that has it. Affine
/// motions are reproduced up to the share `ε/(λ + ε)` of their strain along an axis of the neighbourhood with the
/// share `λ` of its spread, which vanishes with the shrinkage `ε` wherever [`Determinacy::Determined`]. The field is continuous, and differentiable
/// except where the nearest node changes. Results depend only on the input, to the bit, with and without threads.
///
/// # Limits
/// The strain across a surface is not determined by nodes on it ([`Determinacy::Partly`]); the local rotation is used instead.
/// A node value is reproduced to a few hundredths of the local bending, not exactly: this is a fit.
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
    pub(crate) partition: Partition,
    pub(crate) displacements: Vec<Vector3<f64>>,
    pub(crate) fits: Vec<NodalFit>,
    pub(crate) options: FieldOptions,
    /// How well each node's displacement is known; empty if all were given.
    pub(crate) inherited: Vec<Inherited>,
}

/// Uncertainty of a node's displacement that was evaluated from other fields: the worst of them.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Inherited {
    pub determinacy: Determinacy,
    pub extrapolation: f64,
    pub extrapolated: bool,
}

impl Inherited {
    /// As certain as a given displacement.
    pub const GIVEN: Self = Self {
        determinacy: Determinacy::Determined,
        extrapolation: 0.0,
        extrapolated: false,
    };

    /// The worse of both.
    pub fn and(self, other: &Self) -> Self {
        Self {
            determinacy: self.determinacy.min(other.determinacy),
            extrapolation: self.extrapolation.max(other.extrapolation),
            extrapolated: self.extrapolated || other.extrapolated,
        }
    }
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
        let tree = Tree::over(nodes).ok_or(Error::NoNodes)?;
        let radii = node_radii(nodes, &tree, options.support);
        let mut field = Self {
            partition: Partition::new(nodes, radii, tree, options.weight),
            displacements: displacements.to_vec(),
            fits: Vec::new(),
            options: options.clone(),
            inherited: Vec::new(),
        };
        field.fits = map_indexed(nodes.len(), |i| field.fit(i, &Rotation3::identity()));
        field.spread_rotations();
        Ok(field)
    }

    /// Displacement, gradient, and how well they are determined.
    ///
    /// At a point that is not finite (or beyond 1e60) the sample is zero, undetermined, and infinitely far.
    pub fn evaluate(&self, p: &Point3<f64>) -> Sample {
        self.evaluate_with(p, &mut Vec::with_capacity(32))
    }

    /// Displacement at `p`, in m; zero if `p` is not finite (or beyond 1e60).
    pub fn displacement(&self, p: &Point3<f64>) -> Vector3<f64> {
        self.displacement_with(p, &mut Vec::with_capacity(32))
    }

    /// [`Field::evaluate`] with a buffer for the parts.
    pub(crate) fn evaluate_with(&self, p: &Point3<f64>, parts: &mut Vec<Part>) -> Sample {
        let Some(place) = self.partition.at(p, parts) else {
            return Sample {
                displacement: Vector3::zeros(),
                gradient: Matrix3::zeros(),
                determinacy: Determinacy::Undetermined,
                extrapolation: f64::INFINITY,
                extrapolated: true,
            };
        };
        let mean = self.mean_gradient(parts);
        let centre: Vector3<f64> = parts
            .iter()
            .map(|part| part.weight * (p - self.partition.nodes[part.node]))
            .sum();
        let mut displacement = Vector3::zeros();
        let mut gradient = mean;
        for part in parts.iter() {
            let value = self.value_from(part.node, p, &mean);
            displacement += part.weight * value;
            let bracket = value + self.fits[part.node].gradient * centre / 2.0;
            gradient += bracket * part.slope.transpose();
        }
        let extrapolation = |h: &Inherited| h.extrapolation;
        Sample {
            displacement,
            gradient,
            determinacy: self.determinacy(parts),
            extrapolation: place.distance.max(self.inherited(parts, extrapolation)),
            extrapolated: !place.reached
                || self.inherited(parts, |h| f64::from(u8::from(h.extrapolated))) >= 0.5,
        }
    }

    /// Mean over the parts of a quantity of nodes whose displacement was evaluated from other fields.
    fn inherited(&self, parts: &[Part], what: impl Fn(&Inherited) -> f64) -> f64 {
        let of = |part: &Part| Some(part.weight * what(self.inherited.get(part.node)?));
        parts.iter().filter_map(of).sum()
    }

    /// [`Field::displacement`] with a buffer for the parts.
    pub(crate) fn displacement_with(&self, p: &Point3<f64>, parts: &mut Vec<Part>) -> Vector3<f64> {
        if self.partition.at(p, parts).is_none() {
            return Vector3::zeros();
        }
        let mean = self.mean_gradient(parts);
        parts
            .iter()
            .map(|part| part.weight * self.value_from(part.node, p, &mean))
            .sum()
    }

    /// The rotation in the deformation gradient at `p`.
    pub fn rotation(&self, p: &Point3<f64>) -> Rotation3<f64> {
        nearest_rotation(&(Matrix3::identity() + self.evaluate(p).gradient))
    }

    /// The rest positions of the nodes, in the given order.
    pub fn nodes(&self) -> &[Point3<f64>] {
        &self.partition.nodes
    }

    /// The displacements of the nodes, in the given order.
    pub fn node_displacements(&self) -> &[Vector3<f64>] {
        &self.displacements
    }

    /// How well its neighbours alone determine the gradient at each node, in the order of the nodes.
    pub fn node_determinacy(&self) -> Vec<Determinacy> {
        (0..self.fits.len()).map(|i| self.known(i)).collect()
    }

    /// How well the gradient at node `i` is determined, by its neighbours and by the fields from which its displacement was evaluated.
    fn known(&self, i: usize) -> Determinacy {
        let inherited = self.inherited.get(i).map(|h| h.determinacy);
        let own = self.fits[i].determinacy;
        inherited.map_or(own, |level| own.min(level))
    }

    /// `u_i + (G_i + Ḡ)(p − x_i)/2`.
    fn value_from(&self, i: usize, p: &Point3<f64>, mean: &Matrix3<f64>) -> Vector3<f64> {
        let step = (p - self.partition.nodes[i]) / 2.0;
        self.displacements[i] + (self.fits[i].gradient + mean) * step
    }

    fn mean_gradient(&self, parts: &[Part]) -> Matrix3<f64> {
        parts
            .iter()
            .map(|part| part.weight * self.fits[part.node].gradient)
            .sum()
    }

    /// The level that nodes with at least half of the weight have.
    fn determinacy(&self, parts: &[Part]) -> Determinacy {
        let share = |level: Determinacy| -> f64 {
            parts
                .iter()
                .filter(|part| self.known(part.node) >= level)
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

    /// The nodes within the radius of node `i`, in the form of its fit.
    pub(crate) fn neighbourhood(&self, i: usize) -> (Vec<usize>, Vec<moments::Sample<'_>>) {
        let (nodes, radius) = (&self.partition.nodes, self.partition.radii[i]);
        self.partition
            .tree
            .within(&nodes[i], radius)
            .iter()
            .map(|near| {
                let sample = moments::Sample {
                    weight: weight_at(self.options.weight, near.distance(), radius),
                    position: &nodes[near.index],
                    displacement: &self.displacements[near.index],
                };
                (near.index, sample)
            })
            .unzip()
    }

    fn fit(&self, i: usize, base: &Rotation3<f64>) -> NodalFit {
        NodalFit::new(&self.neighbourhood(i).1, self.options.shrinkage, base)
    }

    /// Nodes with an undetermined rotation take the undetermined part from the nearest node with a determined one;
    /// if there is none, from the fit of all nodes together.
    fn spread_rotations(&mut self) {
        let knows = |i: &usize| self.fits[*i].determinacy > Determinacy::Undetermined;
        let (known, unknown): (Vec<usize>, Vec<usize>) = (0..self.fits.len()).partition(knows);
        if unknown.is_empty() {
            return;
        }
        let nodes = &self.partition.nodes;
        let positions: Vec<Point3<f64>> = known.iter().map(|&i| nodes[i]).collect();
        let tree = Tree::over(&positions);
        let whole = tree.is_none().then(|| self.whole_rotation());
        let base = |i: usize| {
            let nearest = tree.as_ref().and_then(|tree| tree.nearest(&nodes[i]));
            nearest.map_or(whole.unwrap_or_default(), |n| {
                self.fits[known[n.index]].rotation
            })
        };
        let fits = map_indexed(unknown.len(), |k| self.fit(unknown[k], &base(unknown[k])));
        for (i, fit) in unknown.into_iter().zip(fits) {
            self.fits[i] = fit;
        }
    }

    /// The rotation of all nodes together.
    fn whole_rotation(&self) -> Rotation3<f64> {
        let samples: Vec<moments::Sample> = self
            .partition
            .nodes
            .iter()
            .zip(&self.displacements)
            .map(|(position, displacement)| moments::Sample {
                weight: 1.0,
                position,
                displacement,
            })
            .collect();
        NodalFit::new(&samples, self.options.shrinkage, &Rotation3::identity()).rotation
    }
}
