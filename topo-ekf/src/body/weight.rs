//! Effect of gravity and the table on a body whose rest shape is already loaded by both.
//!
//! ```text
//! at rest      internal + m g + r₀ = 0                     the rest shape is loaded by its weight and the table's reaction r₀
//! rotated      internal forces rotate with the material: R(−m g − r₀)
//! load         f = m g − R m g − R r₀                      on cells:  m (g − R_c g),   at the feet:  R_c M g   (r₀ = −M g)
//! ```
//! `M` is the mass that a foot supports. As the feet support all of it, `Σ f = Σ m g` as long as a foot rotates with what stands on it: a body in
//! its rest pose is supported at its feet, where the table holds it, and a lifted one at its grips. The present reaction of the table is the force of
//! the contact rows. Forces are in units of the energy: `stiffness · h³ · γ` is the weight of a full cell, `γ = ρ g / E` in 1/m.
//!
//! ```text
//! sag of the seen points relative to a pose by grips, table and weight alone      a + s γ,   linear in γ
//! γ ← argmin  Σ_estimates 0.95^age (a + s γ)² / σ²  +  (γ − γ₀)² / σ₀²
//! ```

use nalgebra::Vector3;

use super::cube::mass_shares;
use super::lattice::{Embedding, Lattice};
use super::pose::Pose;
use crate::Error;

/// A point of the body that stands on the table at rest.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Foot {
    /// Its position in the material.
    pub at: Embedding,
    /// The mass that it supports at rest, in masses of a full cell.
    pub load: f64,
}

impl Foot {
    /// Default feet: the centre of the lower face of every cell that stands on the table, supporting the column above it. The
    /// weight of other columns is distributed over them in proportion. Empty if no cell stands on the table (place 0 along
    /// the third axis).
    pub fn under_columns(lattice: &Lattice) -> Vec<Self> {
        let mut columns = std::collections::BTreeMap::<[i32; 2], (i32, u32, f64)>::new();
        for (c, cell) in lattice.cells().iter().enumerate() {
            let key = [cell.place[0], cell.place[1]];
            let column = columns.entry(key).or_insert((cell.place[2], c as u32, 0.0));
            if cell.place[2] < column.0 {
                (column.0, column.1) = (cell.place[2], c as u32);
            }
            column.2 += lattice.mass(c as u32);
        }
        let feet = columns.values().filter(|c| c.0 == 0).map(|c| Self {
            at: Embedding::new(c.1, [0.5, 0.5, 0.0]),
            load: c.2,
        });
        Self::bearing_all(feet.collect(), lattice)
    }

    /// Scales the loads so that their sum is the mass of the lattice; loads with sum zero stay unchanged.
    pub fn bearing_all(mut feet: Vec<Self>, lattice: &Lattice) -> Vec<Self> {
        let total: f64 = (0..lattice.cells().len() as u32)
            .map(|c| lattice.mass(c))
            .sum();
        let under: f64 = feet.iter().map(|f| f.load).sum();
        if under > 0.0 {
            for foot in &mut feet {
                foot.load *= total / under;
            }
        }
        feet
    }

    /// Rejects a foot that is invalid for this lattice.
    pub(crate) fn check(&self, index: usize, lattice: &Lattice) -> Result<(), Error> {
        lattice.check_embedding("foot", index, &self.at)?;
        if !(0.0..=1e9).contains(&self.load) {
            return Err(Error::Value {
                what: "load of foot",
                index,
                value: self.load,
                must: "between 0 and 1e9",
            });
        }
        Ok(())
    }
}

/// Loads on the nodes in a pose; `cell_weight` is the weight of a full cell and `down` the direction of gravity.
pub(crate) fn loads(
    lattice: &Lattice,
    pose: &Pose,
    feet: &[Foot],
    cell_weight: f64,
    down: &Vector3<f64>,
) -> Vec<Vector3<f64>> {
    let mut forces = vec![Vector3::zeros(); lattice.rest().len()];
    for (cell, turn) in lattice.cells().iter().zip(&pose.turns) {
        let lost = (down - turn * down) * (cell.mass * cell_weight);
        let shares = cell
            .occupancy
            .as_ref()
            .map_or([0.125; 8], |o| mass_shares(o));
        for (&node, share) in cell.nodes.iter().zip(shares) {
            forces[node as usize] += lost * share;
        }
    }
    for foot in feet {
        let cell = foot.at.cell as usize;
        let push = pose.turns[cell] * down * (foot.load * cell_weight);
        for (&node, weight) in lattice.cells()[cell].nodes.iter().zip(foot.at.weights) {
            forces[node as usize] += push * weight;
        }
    }
    forces
}

/// Recursive least squares with forgetting for `γ`: the mean sag of the seen surface is `a + s γ` and should vanish.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(crate) struct WeightEstimate {
    information: f64,
    pull: f64,
    initial: f64,
    initial_information: f64,
}

/// Share of the earlier information kept at each update.
const KEPT: f64 = 0.95;
/// Largest plausible weight over stiffness, 1/m: beyond it a body of a decimetre would lie flat.
const HEAVIEST: f64 = 6.0;

impl WeightEstimate {
    /// The estimate before any update.
    pub fn new(initial: f64, sigma: f64) -> Self {
        Self {
            information: 0.0,
            pull: 0.0,
            initial,
            initial_information: sigma.powi(-2),
        }
    }

    /// Updates with a sag `a + s γ` of standard deviation `sigma`.
    pub fn weigh(&mut self, constant: f64, slope: f64, sigma: f64) {
        self.information = KEPT * self.information + slope * slope / (sigma * sigma);
        self.pull = KEPT * self.pull - slope * constant / (sigma * sigma);
    }

    /// The estimate, 1/m, clamped between 0.02 and the largest plausible value.
    pub fn value(&self) -> f64 {
        let pull = self.pull + self.initial_information * self.initial;
        (pull / (self.information + self.initial_information)).clamp(0.02, HEAVIEST)
    }

    /// Standard deviation of the value.
    pub fn sigma(&self) -> f64 {
        (self.information + self.initial_information).powf(-0.5)
    }
}
