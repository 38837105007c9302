//! The lattice of cubes that carries the body: nodes at rest, cells, and embedded points.
//!
//! ```text
//! X(c, ξ) = origin + A (ijk_c + ξ) h             rest, local coordinates ξ
//! x(c, ξ) = Σ_k N_k(ξ) x_{c,k}                   live: trilinear in the corners of the cell
//! F(c, ξ) = Σ_k x_{c,k} ∇N_k(ξ)ᵀ Aᵀ / h          gradient of the deformation
//! ```
//! Cells are created where material is; the lattice grows as surface appears.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Point3, Rotation3, Vector3};

use super::cube::{CORNERS, Occupancy, shape, shape_gradients};
use crate::Error;
use crate::graph::usable_point;

/// Largest coordinate of a place in the lattice; a cell of a millimetre is then a kilometre away.
const FARTHEST_PLACE: i32 = 1_000_000;
/// Largest weight of a corner: an embedded point lies in its cell or slightly outside.
const LARGEST_WEIGHT: f64 = 1e3;
/// Largest fill of a cell, relative to a full one.
const LARGEST_FILL: f64 = 1e3;

/// A cube of material. Its fill scales stiffness and mass where the cell is only partly in the body.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Cell {
    /// Its corners, as indices of nodes; the first local coordinate fastest.
    pub nodes: [u32; 8],
    /// Its place (integer coordinates) in the lattice.
    pub place: [i32; 3],
    /// Stiffness relative to that of its material; the filter accepts 0 to 1e3.
    pub stiffness: f64,
    /// Mass relative to that of its material; the filter accepts 0 to 1e3.
    pub mass: f64,
    /// Which parts of the cell hold material; all if `None`.
    #[cfg_attr(feature = "serde", serde(with = "super::saved::occupancy"))]
    pub occupancy: Option<std::sync::Arc<Occupancy>>,
}

/// A point in the material: a cell, and weights of its corners that sum to one.
///
/// It moves with the body, `x(e) = Σ_k w_k x_{c,k}`, and stays valid when the lattice grows.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Embedding {
    /// Index of the cell.
    pub cell: u32,
    /// Local coordinates, 0 to 1 inside the cell.
    pub xi: [f64; 3],
    /// Weights of the cell's corners, the first local coordinate fastest.
    pub weights: [f64; 8],
}

impl Embedding {
    /// A point in a cell by its local coordinates; slightly outside of 0 to 1 it extrapolates.
    pub fn new(cell: u32, xi: [f64; 3]) -> Self {
        Self {
            cell,
            xi,
            weights: shape(&xi),
        }
    }
}

/// Cubes of one size, and their nodes at rest.
///
/// Cells and nodes keep their indices: the lattice only grows, unless the filter is told to remove cells
/// ([`BodyFilter::retain_cells`](super::BodyFilter::retain_cells)). Methods that take an index of a cell panic if there is no such
/// cell, as slices do; [`BodyFilter`](super::BodyFilter) checks every index that it is given.
///
/// ```
/// use topo_ekf::body::Lattice;
/// use topo_ekf::nalgebra::{Point3, Rotation3};
/// let mut lattice = Lattice::new(0.016, Point3::origin(), Rotation3::identity());
/// lattice.ensure([0, 0, 0]);
/// lattice.ensure([1, 0, 0]);
/// assert_eq!((lattice.cells().len(), lattice.rest().len()), (2, 12));
/// let at = lattice.embed(&Point3::new(0.020, 0.004, 0.008)).ok_or("no cell there")?;
/// assert_eq!(at.cell, 1);
/// assert!((lattice.warp(lattice.rest(), &at).x - 0.020).abs() < 1e-12);
/// # Ok::<(), &str>(())
/// ```
#[derive(Clone, Debug)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Lattice {
    size: f64,
    origin: Point3<f64>,
    axes: Rotation3<f64>,
    pub(super) rest: Vec<Point3<f64>>,
    /// The node that a node was split from.
    pub(super) parents: Vec<Option<u32>>,
    pub(super) cells: Vec<Cell>,
    /// The copies of the cell at a place.
    pub(super) cell_at: BTreeMap<[i32; 3], Vec<u32>>,
    /// Nodes at a corner.
    pub(super) node_at: BTreeMap<[i32; 3], Vec<u32>>,
    /// Whether a corner of a cell has more than one node.
    pub(super) parted: Vec<bool>,
    /// How often cells were given other nodes.
    pub(super) wiring: u32,
}

impl Lattice {
    /// An empty lattice: `size` is the edge of a cell, m; `axes` rotates lattice axes into the frame of the points. The third axis points away
    /// from the table, on which `origin` lies.
    pub fn new(size: f64, origin: Point3<f64>, axes: Rotation3<f64>) -> Self {
        Self {
            size,
            origin,
            axes,
            rest: Vec::new(),
            parents: Vec::new(),
            cells: Vec::new(),
            cell_at: BTreeMap::new(),
            node_at: BTreeMap::new(),
            parted: Vec::new(),
            wiring: 0,
        }
    }

    /// Edge of a cell, m.
    pub fn size(&self) -> f64 {
        self.size
    }

    /// Rotation from lattice axes to the frame of the points.
    pub fn axes(&self) -> &Rotation3<f64> {
        &self.axes
    }

    /// Nodes at rest, in the frame of the points.
    pub fn rest(&self) -> &[Point3<f64>] {
        &self.rest
    }

    /// All cells.
    pub fn cells(&self) -> &[Cell] {
        &self.cells
    }

    /// The cell at a place; the first copy if there are several.
    pub fn cell_at(&self, place: [i32; 3]) -> Option<u32> {
        self.copies(place).first().copied()
    }

    /// The cells at a place: several if it contains pieces of material that are not connected there ([`Self::set_pieces`]).
    pub fn copies(&self, place: [i32; 3]) -> &[u32] {
        self.cell_at.get(&place).map_or(&[], Vec::as_slice)
    }

    /// The node that a node was split from ([`Self::set_pieces`]), if it was.
    pub fn parent(&self, node: u32) -> Option<u32> {
        self.parents.get(node as usize).copied().flatten()
    }

    /// Mass of a cell, in full cells; 0 if there is no such cell.
    pub fn mass(&self, cell: u32) -> f64 {
        self.cells.get(cell as usize).map_or(0.0, |cell| {
            let share = cell
                .occupancy
                .as_ref()
                .map_or(1.0, |o| o.iter().sum::<f64>() / o.len() as f64);
            cell.mass * share
        })
    }

    /// Sets which parts of a cell hold material; nothing changes if there is no such cell. The filter accepts shares from 0 to 1.
    pub fn set_occupancy(&mut self, cell: u32, occupancy: Option<Occupancy>) {
        if let Some(cell) = self.cells.get_mut(cell as usize) {
            cell.occupancy = occupancy.map(std::sync::Arc::new);
        }
    }

    /// Sets stiffness and mass of a cell relative to those of its material. Returns the changed cell, or `None` (and nothing changes) if there is no
    /// such cell.
    pub fn set_fill(&mut self, cell: u32, stiffness: f64, mass: f64) -> Option<&Cell> {
        let cell = self.cells.get_mut(cell as usize)?;
        (cell.stiffness, cell.mass) = (stiffness, mass);
        Some(cell)
    }

    /// Place and local coordinates of a point at rest; the cell need not exist.
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

    /// Centre of a cell at rest.
    pub fn rest_centre(&self, cell: u32) -> Point3<f64> {
        self.rest_at(self.cells[cell as usize].place, [0.5; 3])
    }

    /// Embeds a point at rest, if there is a cell at its place.
    pub fn embed(&self, rest: &Point3<f64>) -> Option<Embedding> {
        let (place, xi) = self.locate(rest);
        self.cell_at(place).map(|cell| Embedding::new(cell, xi))
    }

    /// The cell at `place`; if there is none a full one is created. Places are clamped to a million cells from the origin.
    ///
    /// # Complexity
    /// Logarithmic in the number of nodes.
    pub fn ensure(&mut self, place: [i32; 3]) -> u32 {
        let place = place.map(|p| p.clamp(-FARTHEST_PLACE, FARTHEST_PLACE));
        if let Some(cell) = self.cell_at(place) {
            return cell;
        }
        let nodes = CORNERS.map(|c| {
            let corner = [place[0] + c[0], place[1] + c[1], place[2] + c[2]];
            if let Some(&node) = self.node_at.get(&corner).and_then(|n| n.first()) {
                return node;
            }
            let node = self.rest.len() as u32;
            self.rest.push(self.rest_at(corner, [0.0; 3]));
            self.parents.push(None);
            self.node_at.insert(corner, vec![node]);
            node
        });
        self.push_cell(place, nodes)
    }

    /// Adds a full cell at a place, on given nodes.
    pub(super) fn push_cell(&mut self, place: [i32; 3], nodes: [u32; 8]) -> u32 {
        let cell = self.cells.len() as u32;
        self.cells.push(Cell {
            nodes,
            place,
            stiffness: 1.0,
            mass: 1.0,
            occupancy: None,
        });
        self.cell_at.entry(place).or_default().push(cell);
        self.parted.push(self.is_parted(place));
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

    /// Gradient of the deformation, rest to live, at local coordinates of a cell, given the nodes.
    pub fn gradient(&self, live: &[Point3<f64>], cell: u32, xi: &[f64; 3]) -> Matrix3<f64> {
        let nodes = &self.cells[cell as usize].nodes;
        let gradients = shape_gradients(xi);
        let local: Matrix3<f64> = (0..8)
            .map(|k| live[nodes[k] as usize].coords * gradients[k].transpose())
            .sum();
        local * self.axes.inverse().matrix() / self.size
    }

    /// [`Self::gradient`] at the centre of a cell: differences of the means of opposite faces.
    pub(crate) fn central_gradient(&self, live: &[Point3<f64>], cell: u32) -> Matrix3<f64> {
        let at = self.cells[cell as usize]
            .nodes
            .map(|n| live[n as usize].coords);
        let low = [at[0] + at[2], at[4] + at[6], at[1] + at[3], at[5] + at[7]];
        let x = low[2] + low[3] - low[0] - low[1];
        let y = at[2] + at[3] + at[6] + at[7] - at[0] - at[1] - at[4] - at[5];
        let z = low[1] + low[3] - low[0] - low[2];
        let local = Matrix3::from_columns(&[x, y, z]) * (0.25 / self.size);
        local * self.axes.matrix().transpose()
    }

    /// Present centre of a cell.
    pub fn centre(&self, live: &[Point3<f64>], cell: u32) -> Point3<f64> {
        let nodes = &self.cells[cell as usize].nodes;
        let sum: Vector3<f64> = nodes.iter().map(|&n| live[n as usize].coords).sum();
        Point3::from(sum / 8.0)
    }

    /// Rejects an embedded point that is invalid for this lattice.
    pub(crate) fn check_embedding(
        &self,
        what: &'static str,
        index: usize,
        at: &Embedding,
    ) -> Result<(), Error> {
        if at.cell as usize >= self.cells.len() {
            return Err(Error::CellOutOfRange {
                what,
                index,
                cell: at.cell,
                cells: self.cells.len(),
            });
        }
        let sum: f64 = at.weights.iter().sum();
        // Written so that NaN is rejected too. The sum of large weights is rounded.
        let usable =
            at.weights.iter().all(|w| w.abs() <= LARGEST_WEIGHT) && (sum - 1.0).abs() < 1e-6;
        if !usable {
            let weights = at.weights;
            return Err(Error::Embedding {
                what,
                index,
                weights,
            });
        }
        Ok(())
    }

    /// Checks a deserialised lattice for consistency.
    #[cfg(feature = "serde")]
    pub(crate) fn check_read(&self) -> Result<(), Error> {
        let (nodes, cells) = (self.rest.len(), self.cells.len());
        for (what, found, expected) in [
            ("parents of nodes", self.parents.len(), nodes),
            ("parted cells", self.parted.len(), cells),
            (
                "cells at places",
                self.cell_at.values().map(Vec::len).sum(),
                cells,
            ),
        ] {
            if found != expected {
                return Err(Error::Length {
                    what,
                    found,
                    expected,
                });
            }
        }
        let refused = |what, index: usize, must| {
            Err(Error::Value {
                what,
                index,
                value: index as f64,
                must,
            })
        };
        let corners = self.cells.iter().flat_map(|c| c.nodes);
        let mut at = corners.chain(self.node_at.values().flatten().copied());
        if let Some(node) = at.find(|&n| n as usize >= nodes) {
            return refused("node of a cell", node as usize, "an existing node");
        }
        let mut placed = self.cell_at.values().flatten();
        if let Some(&cell) = placed.find(|&&c| c as usize >= cells) {
            return refused("cell at a place", cell as usize, "an existing cell");
        }
        // A node is split from an earlier one, so that poses can be extended in order.
        let mut parents = self.parents.iter().enumerate();
        match parents.find(|(node, parent)| parent.is_some_and(|p| p as usize >= *node)) {
            Some((node, _)) => refused("split node", node, "later than the node it was split from"),
            None => Ok(()),
        }
    }

    /// Rejects a lattice that is invalid for a body.
    pub(crate) fn check(&self) -> Result<(), Error> {
        if !(1e-6..=1e3).contains(&self.size) {
            return Err(Error::Value {
                what: "size of lattice",
                index: 0,
                value: self.size,
                must: "between 1e-6 and 1e3",
            });
        }
        if !usable_point(&self.origin) {
            return Err(Error::NonFinitePoint {
                what: "origin of lattice",
                index: 0,
                value: self.origin.coords.into(),
            });
        }
        let axes = self.axes.matrix();
        let off = (axes.tr_mul(axes) - Matrix3::identity()).norm();
        let proper = off < 1e-6 && axes.determinant() > 0.0;
        if !proper {
            return Err(Error::NotARotation { index: 0 });
        }
        if self.cells.is_empty() {
            return Err(Error::NoVertices);
        }
        for (index, cell) in self.cells.iter().enumerate() {
            let shares = cell.occupancy.iter().flat_map(|o| o.iter());
            if let Some(&value) = shares.into_iter().find(|o| !(0.0..=1.0).contains(*o)) {
                return Err(Error::Value {
                    what: "occupancy of cell",
                    index,
                    value,
                    must: "between 0 and 1",
                });
            }
            let fills = [
                ("stiffness of cell", cell.stiffness),
                ("mass of cell", cell.mass),
            ];
            for (what, value) in fills {
                if !(0.0..=LARGEST_FILL).contains(&value) {
                    let must = "between 0 and 1e3";
                    return Err(Error::Value {
                        what,
                        index,
                        value,
                        must,
                    });
                }
            }
        }
        Ok(())
    }

    /// Rejects a lattice unless it has all cells of `old` in the same places.
    pub(crate) fn check_grown_from(&self, old: &Self) -> Result<(), Error> {
        // Compared to the bit: a lattice that only grew has these values unchanged.
        let same = self.size.to_bits() == old.size.to_bits()
            && self.origin == old.origin
            && self.axes == old.axes;
        let kept = old.cells.iter().zip(&self.cells);
        let first_lost = kept.take_while(|(a, b)| a.place == b.place).count();
        if same && first_lost == old.cells.len() && self.rest.starts_with(&old.rest) {
            return Ok(());
        }
        let cell = if same && first_lost < old.cells.len() {
            first_lost
        } else {
            0
        };
        Err(Error::CellsLost { cell })
    }
}
