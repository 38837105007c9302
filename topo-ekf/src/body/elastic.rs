//! The elastic energy of the body, its forces, and a Gauss–Newton step of everything that acts on it.
//!
//! ```text
//! E(x) = ½ k Σ_c s_c (R_cᵀ x_c − X_c)ᵀ K̂ (R_cᵀ x_c − X_c)                      k = stiffness · h: corotational cubes
//!      + ½ Σ_r w_r (d_r · (x(e_r) − q_r))²                                      rows: measurements, grips, contacts
//!      + ½ w_y Σ_i ‖x_i − y_i‖²  −  Σ_i f_i · x_i                               expected positions of the nodes; weight
//! H δ = −∇E,  rotations R_c fixed, then fitted again                              sparse Cholesky of 3N unknowns
//! ```
//! The energy is in units of the data: a stiffness of `κ/m³` makes a strain of one in a cubic metre cost `κ/2`, and a row
//! of standard deviation `σ` costs `1/2` when its residual is `σ`. `H` is therefore the information matrix of the nodes. With fixed
//! rotations `E` is quadratic and the forces are its exact gradient; the dependence of the rotations on the nodes adds a term of
//! second order in the strain, which is neglected as usual. Source of the corotational form: Müller and Gross, *Interactive virtual materials* (2004).
//!
//! The unknowns are coordinates in a frame whose third axis is the normal of the table, so that a row against the table involves one unknown
//! of a node instead of three ([`super::project`]).

use std::sync::Arc;
use std::time::Instant;

use nalgebra::{Matrix3, Point3, Vector3};

use super::cube::{CORNERS, Occupancy, PARTS, Stiffness, stiffness};
use super::lattice::{Embedding, Lattice};
use super::pose::Pose;
use super::row::Row;
use super::spent::Spent;
use crate::Error;
use crate::system::{Factor, System};

/// Pairs of corners of a cube, `k ≤ l`.
const PAIRS: usize = 36;
/// Longest displacement of a node in one step, in cells: beyond it the linearisation is invalid.
const LONGEST: f64 = 1.25;

/// Everything that acts on the body in a step besides its elasticity.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Acting<'a> {
    /// Elastic energy of unit strain per volume, 1/m³.
    pub stiffness: f64,
    pub rows: &'a [Row],
    /// Expected position of every node, and its weight, 1/m².
    pub expected: &'a [Point3<f64>],
    pub expected_weight: f64,
    /// Forces on the nodes, in units of the energy per metre; may be empty.
    pub forces: &'a [Vector3<f64>],
}

/// Pattern and storage of the normal equations of a lattice.
pub(crate) struct Elastic {
    elements: Elements,
    /// Rotation from the frame of the points to that of the unknowns.
    frame: Matrix3<f64>,
    system: System,
    nodes: usize,
    wiring: u32,
    /// For each cell, the indices among the values of the entries of each pair of corners; one past the end for entries that are not stored.
    slots: Vec<[[u32; 9]; PAIRS]>,
    /// Values of the previous step, whose memory is reused.
    spare: Vec<f64>,
    spent: Spent,
}

/// Normal equations of a step, for variances and projections.
pub(crate) struct Solved {
    /// Lower triangle of `H`.
    pub values: Vec<f64>,
    pub factor: Factor,
}

impl Elastic {
    /// Sets up all cells of a lattice; `frame` rotates points into the frame of the unknowns.
    pub fn new(lattice: &Lattice, poisson_ratio: f64, frame: Matrix3<f64>) -> Result<Self, Error> {
        let pairs = pairs(lattice);
        let mut edges = Vec::with_capacity(9 * pairs.len());
        for &[i, j] in &pairs {
            for a in 0..3 {
                for b in 0..3 {
                    if i != j || a < b {
                        edges.push([3 * i + a, 3 * j + b]);
                    }
                }
            }
        }
        let points: Vec<Point3<f64>> = lattice.rest().iter().flat_map(|p| [*p; 3]).collect();
        let system = System::new(&points, &edges)?;
        let slots = slots(lattice, &pairs, &system);
        Ok(Self {
            elements: Elements::new(lattice, poisson_ratio),
            frame,
            system,
            nodes: lattice.rest().len(),
            wiring: lattice.wiring,
            slots,
            spare: Vec::new(),
            spent: Spent::default(),
        })
    }

    /// Whether this was made for the lattice in its present form.
    pub fn fits(&self, lattice: &Lattice) -> bool {
        self.nodes == lattice.rest().len()
            && self.is_wired_as(lattice)
            && self.elements.fit(lattice)
    }

    /// Whether the cells that this was made for still have the same nodes.
    pub fn is_wired_as(&self, lattice: &Lattice) -> bool {
        self.wiring == lattice.wiring
    }

    /// Cells of the lattice this was made for.
    pub fn cells(&self) -> usize {
        self.slots.len()
    }

    /// Rotation from the frame of the points to that of the unknowns.
    pub fn frame(&self) -> &Matrix3<f64> {
        &self.frame
    }

    /// The linear system, for solves with a factor.
    pub fn system_mut(&mut self) -> &mut System {
        &mut self.system
    }

    /// The linear system.
    pub fn system(&self) -> &System {
        &self.system
    }

    /// One Gauss–Newton step from `pose`, with rotations fitted again: the longest displacement of a node, m, and the normal equations. Displacements
    /// are limited to 1.25 cells.
    pub fn step(
        &mut self,
        lattice: &Lattice,
        pose: &mut Pose,
        acting: &Acting<'_>,
    ) -> Result<(f64, Solved), Error> {
        let (solved, mut moves) = self.assemble(lattice, pose, acting)?;
        self.system.solve(&solved.factor, &mut moves);
        let bound = LONGEST * lattice.size();
        let back = self.frame.transpose();
        let mut longest = 0.0_f64;
        for (vertex, step) in moves.chunks_exact(3).enumerate() {
            let length = Vector3::from_column_slice(step).norm();
            if !length.is_finite() {
                return Err(Error::Overflow { vertex });
            }
            longest = longest.max(length);
        }
        for (live, step) in pose.live.iter_mut().zip(moves.chunks_exact(3)) {
            let step = back * Vector3::from_column_slice(step);
            let length = step.norm();
            *live += step * if length > bound { bound / length } else { 1.0 };
        }
        pose.fit_turns(lattice);
        Ok((longest, solved))
    }

    /// The time spent since the last call.
    pub fn take_spent(&mut self) -> Spent {
        std::mem::take(&mut self.spent)
    }

    /// Reuses the memory of normal equations that are no longer needed.
    pub fn recycle(&mut self, solved: Solved) {
        self.spare = solved.values;
    }

    /// The normal equations at `pose`, factorised, and the right-hand side `−∇E`.
    pub fn assemble(
        &mut self,
        lattice: &Lattice,
        pose: &Pose,
        acting: &Acting<'_>,
    ) -> Result<(Solved, Vec<f64>), Error> {
        let began = Instant::now();
        let mut values = std::mem::take(&mut self.spare);
        values.clear();
        // One more slot for entries that are not stored.
        values.resize(self.system.pattern.rows.len() + 1, 0.0);
        let mut right = Vec::with_capacity(3 * self.nodes);
        for i in 0..self.nodes {
            let mut force = (acting.expected[i] - pose.live[i]) * acting.expected_weight;
            if let Some(own) = acting.forces.get(i) {
                force += own;
            }
            right.extend_from_slice((self.frame * force).as_slice());
        }
        let by_cell = ByCell::new(acting.rows, lattice.cells().len());
        let scale = acting.stiffness * lattice.size();
        for (c, cell) in lattice.cells().iter().enumerate() {
            let mut own = Own::new();
            let axes = self.frame * (pose.turns[c] * lattice.axes()).matrix();
            let strained = displacements(lattice, pose, c);
            own.add_elasticity(
                self.elements.of(c),
                &axes,
                &strained,
                scale * cell.stiffness,
            );
            for &r in by_cell.of(c) {
                let row = &acting.rows[r as usize];
                let miss = row.target - pose.position(lattice, &row.at);
                own.add_row(row, &self.frame, &miss);
            }
            for (slots, block) in self.slots[c].iter().zip(&own.blocks) {
                for (&slot, entry) in slots.iter().zip(block) {
                    values[slot as usize] += entry;
                }
            }
            for (&node, force) in cell.nodes.iter().zip(&own.right) {
                for a in 0..3 {
                    right[3 * node as usize + a] += force[a];
                }
            }
        }
        values.pop();
        for &at in &self.system.pattern.diagonal {
            values[at] += acting.expected_weight;
        }
        let assembled = Instant::now();
        let factor = self.system.factorise(&values)?;
        self.spent += Spent {
            assembling: assembled - began,
            factoring: assembled.elapsed(),
        };
        Ok((Solved { values, factor }, right))
    }
}

/// The part of the normal equations that comes from one cell and the rows in it: dense, in the order of the cell's corners.
struct Own {
    blocks: [[f64; 9]; PAIRS],
    right: [Vector3<f64>; 8],
}

impl Own {
    fn new() -> Self {
        Self {
            blocks: [[0.0; 9]; PAIRS],
            right: [Vector3::zeros(); 8],
        }
    }

    /// `A K̂ Aᵀ` and the forces `−A K̂ u` of a cell with axes `A`, each times `scale`.
    fn add_elasticity(
        &mut self,
        unit: &Stiffness,
        axes: &Matrix3<f64>,
        strained: &[Vector3<f64>; 8],
        scale: f64,
    ) {
        let (turned, back) = (axes * scale, axes.transpose());
        let mut pair = 0;
        for i in 0..8 {
            let force: Vector3<f64> = (0..8).map(|j| unit[i][j] * strained[j]).sum();
            self.right[i] -= turned * force;
            for j in i..8 {
                // Row by row, the order of the entries of `values`.
                let block = (turned * unit[i][j] * back).transpose();
                self.blocks[pair].copy_from_slice(block.as_slice());
                pair += 1;
            }
        }
    }

    /// Adds `w d dᵀ`, distributed over the corners by the weights of the point, and its force.
    fn add_row(&mut self, row: &Row, frame: &Matrix3<f64>, miss: &Vector3<f64>) {
        let (square, pull) = match &row.direction {
            None => (Matrix3::identity(), frame * miss),
            Some(d) => {
                let direction = frame * d.into_inner();
                (direction * direction.transpose(), direction * d.dot(miss))
            }
        };
        let weights = row.at.weights.map(|w| w * row.weight);
        let mut pair = 0;
        for i in 0..8 {
            self.right[i] += pull * weights[i];
            for j in i..8 {
                let scale = weights[i] * row.at.weights[j];
                for (entry, s) in self.blocks[pair].iter_mut().zip(square.as_slice()) {
                    *entry += scale * s;
                }
                pair += 1;
            }
        }
    }
}

/// Rows sorted by cell; within a cell they keep their order.
struct ByCell {
    starts: Vec<u32>,
    rows: Vec<u32>,
}

impl ByCell {
    fn new(rows: &[Row], cells: usize) -> Self {
        let mut starts = vec![0; cells + 1];
        for row in rows {
            starts[row.at.cell as usize + 1] += 1;
        }
        for c in 0..cells {
            starts[c + 1] += starts[c];
        }
        let mut next = starts.clone();
        let mut sorted = vec![0; rows.len()];
        for (r, row) in rows.iter().enumerate() {
            let at = &mut next[row.at.cell as usize];
            sorted[*at as usize] = r as u32;
            *at += 1;
        }
        Self {
            starts,
            rows: sorted,
        }
    }

    fn of(&self, cell: usize) -> &[u32] {
        &self.rows[self.starts[cell] as usize..self.starts[cell + 1] as usize]
    }
}

/// Stiffness of every cell at Young's modulus 1.
pub(crate) struct Elements {
    full: Stiffness,
    /// The stiffness of partly filled cells, with their occupancy.
    partly: Vec<Option<(Arc<Occupancy>, Box<Stiffness>)>>,
}

impl Elements {
    /// Of all cells of a lattice.
    pub fn new(lattice: &Lattice, poisson_ratio: f64) -> Self {
        let partly = lattice.cells().iter().map(|cell| {
            let occupancy = cell.occupancy.as_ref()?;
            let own = Box::new(stiffness(occupancy, poisson_ratio));
            Some((Arc::clone(occupancy), own))
        });
        Self {
            full: stiffness(&[1.0; PARTS], poisson_ratio),
            partly: partly.collect(),
        }
    }

    /// Of a cell.
    pub fn of(&self, cell: usize) -> &Stiffness {
        self.partly[cell].as_ref().map_or(&self.full, |p| &p.1)
    }

    /// Whether the occupancy of the cells is unchanged.
    fn fit(&self, lattice: &Lattice) -> bool {
        let same = |(own, cell): (&Option<(Arc<Occupancy>, _)>, &super::lattice::Cell)| match (
            own,
            &cell.occupancy,
        ) {
            (Some((a, _)), Some(b)) => Arc::ptr_eq(a, b) || a == b,
            (None, None) => true,
            _ => false,
        };
        self.partly.len() == lattice.cells().len()
            && self.partly.iter().zip(lattice.cells()).all(same)
    }
}

/// Elastic energy of a pose with its present rotations.
pub(crate) fn energy(elements: &Elements, lattice: &Lattice, pose: &Pose, stiffness: f64) -> f64 {
    let scale = stiffness * lattice.size();
    let of_cell = |c: usize| {
        let strained = displacements(lattice, pose, c);
        let unit = elements.of(c);
        let twice: f64 = (0..8)
            .map(|i| {
                let force: Vector3<f64> = (0..8).map(|j| unit[i][j] * strained[j]).sum();
                strained[i].dot(&force)
            })
            .sum();
        0.5 * scale * lattice.cells()[c].stiffness * twice
    };
    (0..lattice.cells().len()).map(of_cell).sum()
}

/// Elastic forces on the nodes with fixed rotations: minus the gradient of the energy.
pub(crate) fn forces(
    elements: &Elements,
    lattice: &Lattice,
    pose: &Pose,
    stiffness: f64,
) -> Vec<Vector3<f64>> {
    let scale = stiffness * lattice.size();
    let mut forces = vec![Vector3::zeros(); lattice.rest().len()];
    for (c, cell) in lattice.cells().iter().enumerate() {
        let strained = displacements(lattice, pose, c);
        let unit = elements.of(c);
        let axes = pose.turns[c] * lattice.axes();
        for i in 0..8 {
            let force: Vector3<f64> = (0..8).map(|j| unit[i][j] * strained[j]).sum();
            forces[cell.nodes[i] as usize] -= axes * (force * (scale * cell.stiffness));
        }
    }
    forces
}

/// Displacements of the corners of a cell from rest, rotated back into lattice axes.
fn displacements(lattice: &Lattice, pose: &Pose, c: usize) -> [Vector3<f64>; 8] {
    let cell = &lattice.cells()[c];
    let axes = pose.turns[c] * lattice.axes();
    let origin = pose.live[cell.nodes[0] as usize];
    std::array::from_fn(|k| {
        let rest = Vector3::from(CORNERS[k].map(f64::from)) * lattice.size();
        axes.matrix()
            .tr_mul(&(pose.live[cell.nodes[k] as usize] - origin))
            - rest
    })
}

/// The pairs of nodes that share a cell, sorted, the earlier node first.
fn pairs(lattice: &Lattice) -> Vec<[u32; 2]> {
    let mut pairs = Vec::with_capacity(PAIRS * lattice.cells().len());
    for cell in lattice.cells() {
        for (i, &a) in cell.nodes.iter().enumerate() {
            pairs.extend(cell.nodes[i..].iter().map(|&b| [a.min(b), a.max(b)]));
        }
    }
    pairs.sort_unstable();
    pairs.dedup();
    pairs
}

/// Indices of the entries of each cell's pairs of corners; the edges of `system` were made pair by pair.
fn slots(lattice: &Lattice, pairs: &[[u32; 2]], system: &System) -> Vec<[[u32; 9]; PAIRS]> {
    let nobody = system.pattern.rows.len() as u32;
    let mut next = system.pattern.edge.iter().map(|&at| at as u32);
    let of_pairs: Vec<[u32; 9]> = pairs
        .iter()
        .map(|&[i, j]| {
            std::array::from_fn(|at| {
                let (a, b) = (at / 3, at % 3);
                if i != j || a < b {
                    next.next().unwrap_or(nobody)
                } else if a == b {
                    system.pattern.diagonal[3 * i as usize + a] as u32
                } else {
                    nobody
                }
            })
        })
        .collect();
    let of_cell = |nodes: &[u32; 8]| {
        let mut own = [[nobody; 9]; PAIRS];
        let mut pair = 0;
        for i in 0..8 {
            for j in i..8 {
                let (a, b) = (nodes[i], nodes[j]);
                let at = pairs.partition_point(|p| *p < [a.min(b), a.max(b)]);
                let slots = of_pairs[at];
                own[pair] = if a > b {
                    std::array::from_fn(|k| slots[3 * (k % 3) + k / 3])
                } else {
                    slots
                };
                pair += 1;
            }
        }
        own
    };
    lattice.cells().iter().map(|c| of_cell(&c.nodes)).collect()
}

/// Nodes and weights of an embedded point.
pub(crate) fn corners<'a>(
    lattice: &'a Lattice,
    at: &'a Embedding,
) -> impl Iterator<Item = (u32, f64)> + 'a {
    let nodes = &lattice.cells()[at.cell as usize].nodes;
    nodes.iter().copied().zip(at.weights)
}
