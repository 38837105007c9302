//! The stiffness `K` of the surface, and the weights `S` of the targets.
//!
//! ```text
//! E(u) = ½ ∫ |∇u|² dA + ½ ∫ (1 + φ·contact) |u|² / ℓ² dA  ≈  ½ uᵀ K u
//! K = Σ_edges w_ij (e_i − e_j)(e_i − e_j)ᵀ + diag(d_i)
//! w_ij = 2 (a_i/deg_i + a_j/deg_j) / |p_i − p_j|²,     d_i = a_i (1 + φ·[height_i ≤ c]) / ℓ²
//! ```
//!
//! A membrane on a bed of springs. Its weight resists the motion of every part of a body at rest, friction that of the parts on the table `φ` times more; the effect
//! of a pull decays over the length `ℓ`. The weights `w` integrate the gradient
//! of a linear field exactly if the neighbours are evenly distributed around a vertex, so the result does not depend on the density of
//! the samples. The three components of `u` have the same `K`.

use derive_setters::Setters;
use faer::sparse::Triplet;
use nalgebra::Point3;

use crate::model::Adjacency;
use crate::scene::{not_negative, positive};
use crate::{Error, Model, Plane};

/// Options of the stiffness and of the target weights.
#[derive(Debug, Clone, Copy, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct CoverageOptions {
    /// Length over which the effect of a pull decays, `ℓ`, metres. Default 0.08: a soft body of 0.2 m follows a grip with about half its length.
    pub decay_length: f64,
    /// Resistance of friction on the table relative to that of weight, `φ`. Default 4.
    pub friction: f64,
    /// A vertex lower than this touches the table, metres. Default 0.004.
    pub contact_height: f64,
    /// Additional weight of a target at the boundary of the explored part. Default 3.
    pub boundary_weight: f64,
    /// Length over which that additional weight decays, along the surface, metres. Default 0.02.
    pub boundary_length: f64,
}

impl Default for CoverageOptions {
    fn default() -> Self {
        Self {
            decay_length: 0.08,
            friction: 4.0,
            contact_height: 0.004,
            boundary_weight: 3.0,
            boundary_length: 0.02,
        }
    }
}

impl CoverageOptions {
    pub(crate) fn check(&self) -> Result<(), Error> {
        positive("decay_length", self.decay_length)?;
        not_negative("friction", self.friction)?;
        not_negative("boundary_weight", self.boundary_weight)?;
        positive("boundary_length", self.boundary_length)?;
        if self.contact_height.is_finite() {
            return Ok(());
        }
        Err(Error::BadSetting {
            name: "contact_height",
            value: self.contact_height,
            expected: "finite",
        })
    }
}

/// A symmetric positive definite stiffness: springs between vertices, anchors to the ground.
#[derive(Debug, Clone, PartialEq)]
pub struct Stiffness {
    springs: Vec<([u32; 2], f64)>,
    anchors: Vec<f64>,
}

impl Stiffness {
    /// The membrane described at the head of the module.
    ///
    /// # Errors
    /// An invalid model or setting.
    pub fn membrane(
        model: &Model,
        table: &Plane,
        options: &CoverageOptions,
    ) -> Result<Self, Error> {
        model.check()?;
        options.check()?;
        let areas = effective_areas(model)?;
        Ok(Self {
            springs: membrane_springs(model, &areas),
            anchors: anchors(model, table, options, &areas),
        })
    }

    /// Adds a spring, for instance across the body, so that top and bottom move together.
    ///
    /// # Errors
    /// A vertex that does not exist, or a constant that is not positive.
    pub fn couple(&mut self, vertices: [u32; 2], constant: f64) -> Result<(), Error> {
        positive("spring constant", constant)?;
        let points = self.anchors.len();
        if let Some(&vertex) = vertices.iter().find(|&&v| v as usize >= points) {
            return Err(Error::NoSuchVertex { vertex, points });
        }
        self.springs.push((vertices, constant));
        Ok(())
    }

    /// The springs: ends and constant.
    pub fn springs(&self) -> &[([u32; 2], f64)] {
        &self.springs
    }

    /// The constant that anchors each vertex to its position.
    pub fn anchors(&self) -> &[f64] {
        &self.anchors
    }

    /// Lower triangle of `K`; entries at the same index are added.
    pub(crate) fn lower(&self) -> Vec<Triplet<usize, usize, f64>> {
        let mut diagonal = self.anchors.clone();
        let mut lower = Vec::with_capacity(self.springs.len() + diagonal.len());
        for &([a, b], w) in &self.springs {
            let (a, b) = (a as usize, b as usize);
            if a == b {
                continue;
            }
            diagonal[a] += w;
            diagonal[b] += w;
            lower.push(Triplet::new(a.max(b), a.min(b), -w));
        }
        lower.extend(
            diagonal
                .iter()
                .enumerate()
                .map(|(i, &d)| Triplet::new(i, i, d)),
        );
        lower
    }
}

/// Areas with a small floor, so that a vertex without area is still anchored.
fn effective_areas(model: &Model) -> Result<Vec<f64>, Error> {
    let mean = model.areas.iter().sum::<f64>() / model.areas.len() as f64;
    if mean <= 0.0 {
        return Err(Error::NoTarget { total: 0.0 });
    }
    Ok(model.areas.iter().map(|a| a.max(1e-3 * mean)).collect())
}

fn membrane_springs(model: &Model, areas: &[f64]) -> Vec<([u32; 2], f64)> {
    let mut edges: Vec<[u32; 2]> = model
        .edges
        .iter()
        .map(|&[a, b]| [a.min(b), a.max(b)])
        .collect();
    edges.sort_unstable();
    edges.dedup();
    let mut degree = vec![0.0; areas.len()];
    edges
        .iter()
        .flatten()
        .for_each(|&v| degree[v as usize] += 1.0);
    let share = |v: u32| areas[v as usize] / degree[v as usize];
    let squared =
        |[a, b]: [u32; 2]| (model.points[a as usize] - model.points[b as usize]).norm_squared();
    let mean = edges.iter().map(|&e| squared(e)).sum::<f64>() / edges.len().max(1) as f64;
    // Coincident points would give an infinite spring: lengths are at least a tenth of the mean.
    let spring = |e: [u32; 2]| {
        2.0 * (share(e[0]) + share(e[1])) / squared(e).max(1e-2 * mean).max(f64::MIN_POSITIVE)
    };
    edges
        .iter()
        .map(|&e| (e, spring(e)))
        .filter(|(_, w)| w.is_finite())
        .collect()
}

fn anchors(model: &Model, table: &Plane, options: &CoverageOptions, areas: &[f64]) -> Vec<f64> {
    let bed = 1.0 / (options.decay_length * options.decay_length);
    let hold = |p: &Point3<f64>| {
        if table.height(p) <= options.contact_height {
            1.0 + options.friction
        } else {
            1.0
        }
    };
    model
        .points
        .iter()
        .zip(areas)
        .map(|(p, a)| a * bed * hold(p))
        .collect()
}

/// Target weights `S`: the area of a vertex, increased next to the hidden surface,
/// `s_i = a_i (1 + β exp(−d_i/λ))` with `d_i` the distance to the boundary along edges.
///
/// # Errors
/// An invalid model or setting.
pub fn target_weights(model: &Model, options: &CoverageOptions) -> Result<Vec<f64>, Error> {
    model.check()?;
    options.check()?;
    let boundary: Vec<u32> = (0..model.points.len() as u32)
        .filter(|&v| model.boundary[v as usize])
        .collect();
    // Beyond five lengths the additional weight is below one per cent.
    let reach = 5.0 * options.boundary_length;
    let distance =
        Adjacency::new(model.points.len(), model.edges).distances(model.points, &boundary, reach);
    let weight = |(a, d): (&f64, &f64)| {
        a * (1.0 + options.boundary_weight * (-d / options.boundary_length).exp())
    };
    Ok(model.areas.iter().zip(&distance).map(weight).collect())
}
