//! Removal of cells, so that a body that is refilled again and again stays as large as its material.
//!
//! ```text
//! cell    kept or removed as marked           node    removed with the last of its cells
//! index   number of those kept before it      parent of a node that was split: its nearest ancestor that is kept
//! ```
//! Indices keep their order, so that what is sorted by them stays sorted.

use super::lattice::{Embedding, Lattice};
use super::pose::Pose;
use crate::Error;

/// The new indices of cells and nodes after a removal ([`BodyFilter::retain_cells`](super::BodyFilter::retain_cells)).
///
/// ```
/// use topo_ekf::Plane;
/// use topo_ekf::body::{BodyFilter, BodyOptions, Embedding, Lattice};
/// use topo_ekf::nalgebra::{Point3, Rotation3, UnitVector3, Vector3};
/// # fn main() -> Result<(), topo_ekf::Error> {
/// let mut lattice = Lattice::new(0.016, Point3::origin(), Rotation3::identity());
/// for x in [0, 5, 1] {
///     lattice.ensure([x, 0, 0]);
/// }
/// let table = Plane { normal: UnitVector3::new_normalize(Vector3::z()), offset: 0.0 };
/// let mut body = BodyFilter::new(lattice, table, &BodyOptions::default())?;
/// body.set_feet(Vec::new());
/// let mut at = Embedding::new(2, [0.5; 3]);
/// // The second cell is removed; what was embedded in the third is now in the second.
/// let renumbered = body.retain_cells(&[true, false, true])?;
/// at = renumbered.embedding(&at).ok_or(topo_ekf::Error::NoVertices)?;
/// assert_eq!((at.cell, body.lattice().cells().len()), (1, 2));
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Renumbered {
    cells: Vec<Option<u32>>,
    nodes: Vec<Option<u32>>,
}

impl Renumbered {
    /// The new index of a cell; `None` if it was removed or never existed.
    pub fn cell(&self, old: u32) -> Option<u32> {
        self.cells.get(old as usize).copied().flatten()
    }

    /// The new index of a node; `None` if it was removed or never existed.
    pub fn node(&self, old: u32) -> Option<u32> {
        self.nodes.get(old as usize).copied().flatten()
    }

    /// An embedded point with the new index of its cell; `None` if that was removed.
    pub fn embedding(&self, old: &Embedding) -> Option<Embedding> {
        self.cell(old.cell).map(|cell| Embedding { cell, ..*old })
    }

    /// A pose of the kept cells and nodes. One from before the lattice grew is [extended](Pose::extend) first, because the cells that move its new
    /// nodes may be among those removed.
    pub fn pose(&self, old: &Pose) -> Pose {
        Pose {
            live: kept(&old.live, &self.nodes),
            turns: kept(&old.turns, &self.cells),
        }
    }

    /// The values of the kept nodes.
    pub(super) fn of_nodes<T: Clone>(&self, values: &[T]) -> Vec<T> {
        kept(values, &self.nodes)
    }
}

/// The values whose index is kept.
fn kept<T: Clone>(values: &[T], new: &[Option<u32>]) -> Vec<T> {
    let stays = values.iter().zip(new).filter(|(_, new)| new.is_some());
    stays.map(|(value, _)| value.clone()).collect()
}

/// The number of marked entries before each marked one.
fn numbered(keep: impl Iterator<Item = bool>) -> Vec<Option<u32>> {
    let mut next = 0..;
    keep.map(|keep| keep.then(|| next.next()).flatten())
        .collect()
}

impl Lattice {
    /// Removes the cells that are not marked, and the nodes that no cell has any more.
    ///
    /// # Errors
    /// Not one mark for each cell, or none set; the lattice is then unchanged.
    ///
    /// # Complexity
    /// Cells times logarithm of cells.
    pub(super) fn retain_cells(&mut self, keep: &[bool]) -> Result<Renumbered, Error> {
        if keep.len() != self.cells.len() {
            return Err(Error::Length {
                what: "marks of cells",
                found: keep.len(),
                expected: self.cells.len(),
            });
        }
        let stays = self.cells.iter().zip(keep).filter(|(_, keep)| **keep);
        let mut cells: Vec<_> = stays.map(|(cell, _)| cell.clone()).collect();
        if cells.is_empty() {
            return Err(Error::NoVertices);
        }
        let mut used = vec![false; self.rest.len()];
        for node in cells.iter().flat_map(|c| c.nodes) {
            used[node as usize] = true;
        }
        let new = Renumbered {
            cells: numbered(keep.iter().copied()),
            nodes: numbered(used.into_iter()),
        };
        for node in cells.iter_mut().flat_map(|c| &mut c.nodes) {
            *node = new.node(*node).unwrap_or(*node);
        }
        let parents: Vec<Option<u32>> = (0..self.rest.len() as u32)
            .map(|node| self.kept_ancestor(node, &new))
            .collect();
        self.parents = new.of_nodes(&parents);
        self.rest = new.of_nodes(&self.rest);
        self.cells = cells;
        for (at, index) in [
            (&mut self.cell_at, &new.cells),
            (&mut self.node_at, &new.nodes),
        ] {
            at.retain(|_, here| {
                let there = here.iter().filter_map(|&i| index[i as usize]);
                *here = there.collect();
                !here.is_empty()
            });
        }
        self.parted = self.cells.iter().map(|c| self.is_parted(c.place)).collect();
        self.wiring += 1;
        Ok(new)
    }

    /// The new index of the nearest kept node that a node was split from. Nodes are split from earlier ones, so this ends.
    fn kept_ancestor(&self, node: u32, new: &Renumbered) -> Option<u32> {
        let mut parent = self.parents[node as usize];
        while let Some(node) = parent {
            if let Some(kept) = new.node(node) {
                return Some(kept);
            }
            parent = self.parents[node as usize];
        }
        None
    }
}
