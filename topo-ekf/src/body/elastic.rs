//! The elastic energy of the body, its forces, and one Gauss–Newton step of everything that acts on it.
//!
//! ```text
//! E(x) = ½ k Σ_c s_c (R_cᵀ x_c − X_c)ᵀ K̂ (R_cᵀ x_c − X_c)                      k = stiffness · h: corotational cubes
//!      + ½ Σ_r w_r (d_r · (x(e_r) − q_r))²                                      rows: what was measured, held, touched
//!      + ½ w_stay Σ_i m_i ‖x_i − y_i‖²  −  Σ_i f_i · x_i                        where the nodes were expected; weight
//! H δ = −∇E,  rotations R_c held, then fitted anew                              sparse Cholesky of 3N unknowns
//! ```
//! The energy is counted in units of the data: a stiffness of `κ/m³` makes a strain of one in a cube of a cubic metre cost `κ/2`, where a row
//! of standard deviation `σ` costs `1/2` when it is off by `σ`. Source of the corotational form: Müller and Gross (2004).

use nalgebra::{Matrix3, Point3, UnitVector3, Vector3};

use super::cube::{CORNERS, PARTS, Stiffness, stiffness};
use super::lattice::{Embedding, Lattice};
use super::pose::Pose;
use crate::Error;
use crate::system::{Factor, System};

/// Pairs of corners of a cube, `k ≤ l`.
const PAIRS: usize = 36;
/// Longest move of a node in one step, in cells: beyond it the linearisation means nothing.
const LONGEST: f64 = 1.25;

/// A linear equation on an embedded point: `direction · (x(at) − target) = 0`, or all three coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// The point.
    pub at: Embedding,
    /// Where it should be.
    pub target: Point3<f64>,
    /// Along which direction; all when `None`.
    pub direction: Option<UnitVector3<f64>>,
    /// One over its variance, 1/m².
    pub weight: f64,
}

impl Row {
    /// The point is at `target`.
    pub fn point(at: Embedding, target: Point3<f64>, weight: f64) -> Self {
        Self {
            at,
            target,
            direction: None,
            weight,
        }
    }

    /// The point lies on the plane through `target` across `direction`.
    pub fn along(
        at: Embedding,
        target: Point3<f64>,
        direction: UnitVector3<f64>,
        weight: f64,
    ) -> Self {
        Self {
            at,
            target,
            direction: Some(direction),
            weight,
        }
    }
}

/// What acts on the body in a step besides its elasticity.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Acting<'a> {
    /// Elastic energy of unit strain per volume, 1/m³.
    pub stiffness: f64,
    pub rows: &'a [Row],
    /// Where every node is expected, and how strongly, 1/m².
    pub expected: &'a [Point3<f64>],
    pub expected_weight: f64,
    /// Forces on the nodes, in units of the energy per metre; may be empty.
    pub forces: &'a [Vector3<f64>],
}

/// Pattern and storage of the normal equations of a lattice.
pub(crate) struct Elastic {
    /// Stiffness of a full cube, and of the cells that are not full.
    full: Stiffness,
    partly: Vec<Option<Box<Stiffness>>>,
    system: System,
    nodes: usize,
    /// Pair of each two corners of each cell, and whether the first corner is the later node.
    cells: Vec<[(u32, bool); PAIRS]>,
    /// Slots of the nine entries of each pair.
    slots: Vec<[usize; 9]>,
    blocks: Vec<[f64; 9]>,
    right: Vec<f64>,
}

/// Normal equations after a step, for variances and projections.
pub(crate) struct Solved {
    pub values: Vec<f64>,
    pub factor: Factor,
}

impl Elastic {
    /// For all cells of a lattice.
    pub fn new(lattice: &Lattice, poisson_ratio: f64) -> Result<Self, Error> {
        let nodes = lattice.rest().len();
        let (pairs, cells) = pairs(lattice);
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
        let mut next = system.pattern.edge.iter().copied();
        let mut slots = Vec::with_capacity(pairs.len());
        for &[i, j] in &pairs {
            let mut own = [usize::MAX; 9];
            for a in 0..3 {
                for b in 0..3 {
                    if i != j || a < b {
                        own[3 * a + b] = next.next().unwrap_or(usize::MAX);
                    } else if a == b {
                        own[3 * a + b] = system.pattern.diagonal[3 * i as usize + a as usize];
                    }
                }
            }
            slots.push(own.map(|s| s));
        }
        Ok(Self {
            full: stiffness(&[1.0; PARTS], poisson_ratio),
            partly: lattice
                .cells()
                .iter()
                .map(|cell| Some(Box::new(stiffness(cell.occupancy.as_deref()?, poisson_ratio))))
                .collect(),
            system,
            nodes,
            cells,
            slots,
            blocks: Vec::new(),
            right: Vec::new(),
        })
    }

    /// Whether this was made for the lattice as it is.
    pub fn fits(&self, lattice: &Lattice) -> bool {
        self.nodes == lattice.rest().len() && self.cells.len() == lattice.cells().len()
    }

    /// The system, for solves with a factor.
    pub fn system_mut(&mut self) -> &mut System {
        &mut self.system
    }

    /// The system.
    pub fn system(&self) -> &System {
        &self.system
    }

    /// Stiffness of a cell.
    fn unit(&self, cell: usize) -> &Stiffness {
        self.partly[cell].as_deref().unwrap_or(&self.full)
    }

    /// Elastic energy of a pose whose rotations are fitted.
    pub fn energy(&self, lattice: &Lattice, pose: &Pose, stiffness: f64) -> f64 {
        let scale = stiffness * lattice.size();
        let of_cell = |c: usize| {
            let cell = &lattice.cells()[c];
            let unit = self.unit(c);
            let strained = displacements(lattice, pose, c);
            let mut energy = 0.0;
            for i in 0..8 {
                let force: Vector3<f64> = (0..8).map(|j| unit[i][j] * strained[j]).sum();
                energy += 0.5 * strained[i].dot(&force);
            }
            scale * cell.stiffness * energy
        };
        (0..lattice.cells().len()).map(of_cell).sum()
    }

    /// Elastic forces on the nodes of a pose whose rotations are fitted: minus the gradient of the energy.
    pub fn forces(&self, lattice: &Lattice, pose: &Pose, stiffness: f64) -> Vec<Vector3<f64>> {
        let scale = stiffness * lattice.size();
        let mut forces = vec![Vector3::zeros(); lattice.rest().len()];
        for (c, cell) in lattice.cells().iter().enumerate() {
            let unit = self.unit(c);
            let strained = displacements(lattice, pose, c);
            let axes = pose.turns[c] * lattice.axes();
            for i in 0..8 {
                let force: Vector3<f64> = (0..8).map(|j| unit[i][j] * strained[j]).sum();
                forces[cell.nodes[i] as usize] -= axes * (force * (scale * cell.stiffness));
            }
        }
        forces
    }

    /// One Gauss–Newton step from `pose`; returns the longest move of a node, m. The pose keeps its length limits.
    pub fn step(
        &mut self,
        lattice: &Lattice,
        pose: &mut Pose,
        acting: &Acting<'_>,
    ) -> Result<f64, Error> {
        let solved = self.assemble(lattice, pose, acting)?;
        let mut moves = std::mem::take(&mut self.right);
        self.system.solve(&solved.factor, &mut moves);
        let bound = LONGEST * lattice.size();
        let mut longest = 0.0_f64;
        for (live, step) in pose.live.iter_mut().zip(moves.chunks_exact(3)) {
            let step = Vector3::from_column_slice(step);
            let length = step.norm();
            if !length.is_finite() {
                return Err(Error::Overflow { vertex: 0 });
            }
            *live += step * if length > bound { bound / length } else { 1.0 };
            longest = longest.max(length);
        }
        self.right = moves;
        pose.fit_turns(lattice);
        Ok(longest)
    }

    /// The normal equations at `pose`, factorised; the right-hand side stays in `self.right`.
    pub fn assemble(
        &mut self,
        lattice: &Lattice,
        pose: &Pose,
        acting: &Acting<'_>,
    ) -> Result<Solved, Error> {
        self.blocks.clear();
        self.blocks.resize(self.slots.len(), [0.0; 9]);
        self.right.clear();
        self.right.resize(3 * self.nodes, 0.0);
        self.add_elasticity(lattice, pose, acting.stiffness);
        for row in acting.rows {
            self.add_row(lattice, pose, row);
        }
        for i in 0..self.nodes {
            let mut force = (acting.expected[i] - pose.live[i]) * acting.expected_weight;
            if let Some(own) = acting.forces.get(i) {
                force += own;
            }
            add(&mut self.right, i, &force);
        }
        let mut values = vec![0.0; self.system.pattern.rows.len()];
        for (block, slots) in self.blocks.iter().zip(&self.slots) {
            for (entry, &slot) in block.iter().zip(slots) {
                if let Some(value) = values.get_mut(slot) {
                    *value += entry;
                }
            }
        }
        for &at in &self.system.pattern.diagonal {
            values[at] += acting.expected_weight;
        }
        let factor = self.system.factorise(&values)?;
        Ok(Solved { values, factor })
    }

    fn add_elasticity(&mut self, lattice: &Lattice, pose: &Pose, stiffness: f64) {
        let scale = stiffness * lattice.size();
        for (c, cell) in lattice.cells().iter().enumerate() {
            let axes = *(pose.turns[c] * lattice.axes()).matrix();
            let back = axes.transpose();
            let strained = displacements(lattice, pose, c);
            let unit = *self.unit(c);
            let ks = scale * cell.stiffness;
            let mut pair = 0;
            for i in 0..8 {
                let force: Vector3<f64> = (0..8).map(|j| unit[i][j] * strained[j]).sum();
                add(&mut self.right, cell.nodes[i] as usize, &(axes * force * -ks));
                for j in i..8 {
                    let block = axes * (unit[i][j] * ks) * back;
                    self.add_block(c, pair, &block, 1.0);
                    pair += 1;
                }
            }
        }
    }

    fn add_row(&mut self, lattice: &Lattice, pose: &Pose, row: &Row) {
        let c = row.at.cell as usize;
        let nodes = &lattice.cells()[c].nodes;
        let miss = pose.position(lattice, &row.at) - row.target;
        let (square, pull) = match &row.direction {
            None => (Matrix3::identity(), miss),
            Some(d) => (d.into_inner() * d.transpose(), d.into_inner() * d.dot(&miss)),
        };
        let mut pair = 0;
        for i in 0..8 {
            let wi = row.weight * row.at.weights[i];
            add(&mut self.right, nodes[i] as usize, &(pull * -wi));
            for j in i..8 {
                self.add_block(c, pair, &square, wi * row.at.weights[j]);
                pair += 1;
            }
        }
    }

    /// Adds `scale · block` for the pair of corners `(i, j)` of a cell, in the order of the loops above.
    fn add_block(&mut self, cell: usize, pair: usize, block: &Matrix3<f64>, scale: f64) {
        if scale == 0.0 {
            return;
        }
        let (at, flipped) = self.cells[cell][pair];
        let own = &mut self.blocks[at as usize];
        for a in 0..3 {
            for b in 0..3 {
                own[3 * a + b] += scale * if flipped { block[(b, a)] } else { block[(a, b)] };
            }
        }
    }
}

/// Corners of a cell, turned back, less where they are at rest: in lattice axes.
fn displacements(lattice: &Lattice, pose: &Pose, c: usize) -> [Vector3<f64>; 8] {
    let cell = &lattice.cells()[c];
    let back = (pose.turns[c] * lattice.axes()).inverse();
    let origin = pose.live[cell.nodes[0] as usize];
    std::array::from_fn(|k| {
        let rest = Vector3::from(CORNERS[k].map(f64::from)) * lattice.size();
        back * (pose.live[cell.nodes[k] as usize] - origin) - rest
    })
}

fn add(vector: &mut [f64], node: usize, value: &Vector3<f64>) {
    for a in 0..3 {
        vector[3 * node + a] += value[a];
    }
}

/// The pairs of nodes that meet in a cell, the earlier node first, and for each cell where its pairs stand.
fn pairs(lattice: &Lattice) -> (Vec<[u32; 2]>, Vec<[(u32, bool); PAIRS]>) {
    let mut index = std::collections::BTreeMap::new();
    let mut list = Vec::new();
    let mut cells = Vec::with_capacity(lattice.cells().len());
    for cell in lattice.cells() {
        let mut own = [(0, false); PAIRS];
        let mut pair = 0;
        for i in 0..8 {
            for j in i..8 {
                let (a, b) = (cell.nodes[i], cell.nodes[j]);
                let key = [a.min(b), a.max(b)];
                let at = *index.entry(key).or_insert_with(|| {
                    list.push(key);
                    list.len() as u32 - 1
                });
                own[pair] = (at, a > b);
                pair += 1;
            }
        }
        cells.push(own);
    }
    (list, cells)
}
