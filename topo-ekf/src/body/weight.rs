//! What gravity and the table do to a body whose rest shape is already loaded by both.
//!
//! ```text
//! at rest      internal + m g + r₀ = 0                     the rest shape carries its weight and the table's reaction r₀
//! turned       internal turns with the material: R(−m g − r₀)
//! load         f = m g − R m g − R r₀                      on cells:  m (g − R_c g),   on the feet:  R_c M g   (r₀ = −M g)
//! ```
//! `M` is the mass of the column above a foot, so that over the whole body `Σ f = Σ m g`: a lifted body bears its full weight, one that lies as
//! it lay bears none. The table's reaction now is what the contact rows push. Forces are in units of the energy:
//! `stiffness · h³ · γ` is the weight of a full cell, `γ = ρ g / E` in 1/m.

use nalgebra::Vector3;

use super::lattice::Lattice;
use super::pose::Pose;

/// Cells that stand on the table, each with the mass of what it carries in full cells.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Feet {
    pub columns: Vec<(u32, f64)>,
    /// Nodes at the table at rest: the lower corners of the feet, each with the cell and corner that embeds it.
    pub nodes: Vec<(u32, u32, usize)>,
}

/// Lower corners of a cell.
const LOWER: [usize; 4] = [0, 1, 2, 3];

impl Feet {
    /// Columns whose lowest cell with mass stands on the table and that `stands` admits; every column's mass is spread over them in
    /// proportion to what they carry.
    pub fn new(lattice: &Lattice, stands: impl Fn(u32) -> bool) -> Self {
        let mut columns = std::collections::BTreeMap::<[i32; 2], (i32, u32, f64)>::new();
        for (c, cell) in lattice.cells().iter().enumerate() {
            if cell.mass <= 0.0 || cell.place[2] < 0 {
                continue;
            }
            let key = [cell.place[0], cell.place[1]];
            let column = columns.entry(key).or_insert((cell.place[2], c as u32, 0.0));
            if cell.place[2] < column.0 {
                (column.0, column.1) = (cell.place[2], c as u32);
            }
            column.2 += cell.mass;
        }
        let total: f64 = columns.values().map(|c| c.2).sum();
        let stand = |c: &&(i32, u32, f64)| c.0 == 0 && stands(c.1);
        let under: f64 = columns.values().filter(stand).map(|c| c.2).sum();
        let feet: Vec<(u32, f64)> = columns
            .values()
            .filter(stand)
            .map(|c| (c.1, c.2 * total / under.max(f64::MIN_POSITIVE)))
            .collect();
        let mut nodes = std::collections::BTreeMap::new();
        for &(c, _) in &feet {
            for k in LOWER {
                let node = lattice.cells()[c as usize].nodes[k];
                nodes.entry(node).or_insert((node, c, k));
            }
        }
        Self {
            columns: feet,
            nodes: nodes.into_values().collect(),
        }
    }
}

/// Loads on the nodes in a pose; `cell_weight` is the weight of a full cell and `down` the direction of gravity.
pub(crate) fn loads(
    lattice: &Lattice,
    pose: &Pose,
    feet: &Feet,
    cell_weight: f64,
    down: &Vector3<f64>,
) -> Vec<Vector3<f64>> {
    let mut forces = vec![Vector3::zeros(); lattice.rest().len()];
    for (cell, turn) in lattice.cells().iter().zip(&pose.turns) {
        let share = (down - turn * down) * (cell.mass * cell_weight / 8.0);
        for &node in &cell.nodes {
            forces[node as usize] += share;
        }
    }
    for &(c, mass) in &feet.columns {
        let share = pose.turns[c as usize] * down * (mass * cell_weight / 4.0);
        for k in LOWER {
            forces[lattice.cells()[c as usize].nodes[k] as usize] += share;
        }
    }
    forces
}

/// Least squares with forgetting for `γ`: the mean sag of the seen surface is `a + s γ` and should vanish.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct WeightEstimate {
    information: f64,
    pull: f64,
    initial: f64,
    initial_information: f64,
}

/// Share of the earlier information kept at each look.
const KEPT: f64 = 0.95;
/// Largest weight over stiffness believed, 1/m: beyond it a body of a decimetre lies flat.
const HEAVIEST: f64 = 6.0;

impl WeightEstimate {
    pub fn new(initial: f64, sigma: f64) -> Self {
        Self {
            information: 0.0,
            pull: 0.0,
            initial,
            initial_information: sigma.powi(-2),
        }
    }

    /// A look at sag `a + s γ` with standard deviation `sigma`.
    pub fn weigh(&mut self, constant: f64, slope: f64, sigma: f64) {
        self.information = KEPT * self.information + slope * slope / (sigma * sigma);
        self.pull = KEPT * self.pull - slope * constant / (sigma * sigma);
    }

    pub fn value(&self) -> f64 {
        let pull = self.pull + self.initial_information * self.initial;
        (pull / (self.information + self.initial_information)).clamp(0.02, HEAVIEST)
    }

    /// Standard deviation of the value.
    pub fn sigma(&self) -> f64 {
        (self.information + self.initial_information).powf(-0.5)
    }
}
