//! The lattice of cubes that carries the body: nodes at rest, cells, and where a point lies in them.
//!
//! ```text
//! X(c, ξ) = origin + A (ijk_c + ξ) h             rest, local coordinates ξ
//! x(c, ξ) = Σ_k N_k(ξ) x_{c,k}                   live: trilinear in the corners of the cell
//! F(c, ξ) = Σ_k x_{c,k} ∇N_k(ξ)ᵀ Aᵀ / h          gradient of the deformation
//! ```
//! Cells are made where material is; the lattice grows as surface appears.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Point3, Rotation3, Vector3};

use super::cube::{CORNERS, Occupancy, shape, shape_gradients};

/// A cube of material.
#[derive(Clone, Debug, PartialEq)]
pub struct Cell {
    /// Its corners, by index of node; the first local coordinate fastest.
    pub nodes: [u32; 8],
    /// Where it stands in the lattice.
    pub place: [i32; 3],
    /// Stiffness relative to its material.
    pub stiffness: f64,
    /// Mass relative to its material.
    pub mass: f64,
    /// Where in the cell the material is; everywhere if `None`.
    pub occupancy: Option<std::sync::Arc<Occupancy>>,
}

/// A place in the material.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Embedding {
    /// Index of the cell.
    pub cell: u32,
    /// Local coordinates, 0 to 1 inside the cell.
    pub xi: [f64; 3],
    /// Weights of the cell's corners.
    pub weights: [f64; 8],
}

impl Embedding {
    /// A place in a cell.
    pub fn new(cell: u32, xi: [f64; 3]) -> Self {
        Self {
            cell,
            xi,
            weights: shape(&xi),
        }
    }
}

/// Cubes of one size, and their nodes at rest.
#[derive(Clone, Debug)]
pub struct Lattice {
    size: f64,
    origin: Point3<f64>,
    axes: Rotation3<f64>,
    rest: Vec<Point3<f64>>,
    cells: Vec<Cell>,
    cell_at: BTreeMap<[i32; 3], u32>,
    node_at: BTreeMap<[i32; 3], u32>,
}

impl Lattice {
    /// No cells yet. The third axis points away from the table, on which `origin` lies.
    pub fn new(size: f64, origin: Point3<f64>, axes: Rotation3<f64>) -> Self {
        Self {
            size,
            origin,
            axes,
            rest: Vec::new(),
            cells: Vec::new(),
            cell_at: BTreeMap::new(),
            node_at: BTreeMap::new(),
        }
    }

    /// Edge of a cell, m.
    pub fn size(&self) -> f64 {
        self.size
    }

    /// From lattice axes to the frame of the points.
    pub fn axes(&self) -> &Rotation3<f64> {
        &self.axes
    }

    /// Nodes at rest.
    pub fn rest(&self) -> &[Point3<f64>] {
        &self.rest
    }

    /// All cells.
    pub fn cells(&self) -> &[Cell] {
        &self.cells
    }

    /// The cell at a place.
    pub fn cell_at(&self, place: [i32; 3]) -> Option<u32> {
        self.cell_at.get(&place).copied()
    }

    /// Says where in a cell material is. `stiffness` and `mass` of the cell scale what that makes.
    pub fn set_occupancy(&mut self, cell: u32, occupancy: Option<Occupancy>) {
        self.cells[cell as usize].occupancy = occupancy.map(std::sync::Arc::new);
    }

    /// Sets how stiff and how heavy a cell is, relative to its material.
    pub fn set_fill(&mut self, cell: u32, stiffness: f64, mass: f64) {
        let cell = &mut self.cells[cell as usize];
        (cell.stiffness, cell.mass) = (stiffness, mass);
    }

    /// Place and local coordinates of a point at rest.
    pub fn locate(&self, rest: &Point3<f64>) -> ([i32; 3], [f64; 3]) {
        let local = self.axes.inverse() * (rest - self.origin) / self.size;
        let floor = [local.x.floor(), local.y.floor(), local.z.floor()];
        (
            floor.map(|f| f as i32),
            [local.x - floor[0], local.y - floor[1], local.z - floor[2]],
        )
    }

    /// Rest position of local coordinates in the cell at `place`.
    pub fn rest_at(&self, place: [i32; 3], xi: [f64; 3]) -> Point3<f64> {
        let local = Vector3::from_fn(|a, _| f64::from(place[a]) + xi[a]);
        self.origin + self.axes * (local * self.size)
    }

    /// Mass of a cell, in full cells.
    pub fn mass(&self, cell: u32) -> f64 {
        let cell = &self.cells[cell as usize];
        let share = cell
            .occupancy
            .as_ref()
            .map_or(1.0, |o| o.iter().sum::<f64>() / o.len() as f64);
        cell.mass * share
    }

    /// Centre of a cell at rest.
    pub fn rest_centre(&self, cell: u32) -> Point3<f64> {
        self.rest_at(self.cells[cell as usize].place, [0.5; 3])
    }

    /// Where a point at rest lies, if a cell is there.
    pub fn embed(&self, rest: &Point3<f64>) -> Option<Embedding> {
        let (place, xi) = self.locate(rest);
        self.cell_at(place).map(|cell| Embedding::new(cell, xi))
    }

    /// The cell at `place`, made if there is none: a full one.
    pub fn ensure(&mut self, place: [i32; 3]) -> u32 {
        if let Some(cell) = self.cell_at(place) {
            return cell;
        }
        let nodes = CORNERS.map(|c| {
            let corner = [place[0] + c[0], place[1] + c[1], place[2] + c[2]];
            if let Some(&node) = self.node_at.get(&corner) {
                return node;
            }
            let node = self.rest.len() as u32;
            self.rest.push(self.rest_at(corner, [0.0; 3]));
            self.node_at.insert(corner, node);
            node
        });
        let cell = self.cells.len() as u32;
        self.cells.push(Cell {
            nodes,
            place,
            stiffness: 1.0,
            mass: 1.0,
            occupancy: None,
        });
        self.cell_at.insert(place, cell);
        cell
    }

    /// Live position of an embedded point, given the nodes.
    pub fn warp(&self, live: &[Point3<f64>], at: &Embedding) -> Point3<f64> {
        let nodes = &self.cells[at.cell as usize].nodes;
        let sum: Vector3<f64> = nodes
            .iter()
            .zip(at.weights)
            .map(|(&n, w)| live[n as usize].coords * w)
            .sum();
        Point3::from(sum)
    }

    /// Gradient of the deformation at local coordinates of a cell, given the nodes.
    pub fn gradient(&self, live: &[Point3<f64>], cell: u32, xi: &[f64; 3]) -> Matrix3<f64> {
        let nodes = &self.cells[cell as usize].nodes;
        let gradients = shape_gradients(xi);
        let local: Matrix3<f64> = (0..8)
            .map(|k| live[nodes[k] as usize].coords * gradients[k].transpose())
            .sum();
        local * self.axes.inverse().matrix() / self.size
    }

    /// Centre of a cell now.
    pub fn centre(&self, live: &[Point3<f64>], cell: u32) -> Point3<f64> {
        let nodes = &self.cells[cell as usize].nodes;
        let sum: Vector3<f64> = nodes.iter().map(|&n| live[n as usize].coords).sum();
        Point3::from(sum / 8.0)
    }
}
