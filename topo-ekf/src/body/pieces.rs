//! Pieces of material that share a cell of the lattice without being connected there, such as two fingers: each has its own copy of the cell, with
//! separate nodes.
//!
//! ```text
//! (c, k) ~ (c', k')      c and c' joined, and corners k of c and k' of c' have the same position
//! node                   one for every equivalence class of corners
//! ```
//! Two copies of a cell that are connected through surrounding cells share the nodes there, and have separate nodes where the material is
//! divided. (Virtual nodes: Molino, Bao and Fedkiw, A virtual node algorithm for changing mesh topology during simulation, 2004.)

use std::collections::{BTreeMap, BTreeSet};

use super::cube::{CORNERS, Occupancy, PARTS};
use super::lattice::{Cell, Lattice};
use crate::Error;

/// Share of a part of a cell from which on it counts as filled.
const FILLED: f64 = 0.2;

/// A connected piece of the material in a cell.
#[derive(Clone, Debug, PartialEq)]
pub struct Piece {
    /// The place of its cell in the lattice.
    pub place: [i32; 3],
    /// Which parts of the cell it fills; the filter accepts shares from 0 to 1.
    pub occupancy: Occupancy,
}

impl Lattice {
    /// Sets the pieces of material in all cells, and which pieces are joined; returns the cell of every piece.
    ///
    /// Existing copies at a place are kept for the pieces that overlap them most, new ones are created where there are too few, and surplus copies
    /// move with the piece that they overlap most, without material of their own. Nodes keep their indices; a node that is split stays the node of one of the
    /// classes of corners, and the others get new nodes at the same position.
    ///
    /// # Errors
    /// A place with a cell but without a piece, joined pairs that are not two pieces, or whose cells share no corner; the lattice is then unchanged.
    ///
    /// # Complexity
    /// Cells times logarithm of cells.
    ///
    /// ```
    /// use topo_ekf::body::{Lattice, PARTS, Piece};
    /// use topo_ekf::nalgebra::{Point3, Rotation3};
    /// // Two fingers in one cell: each is joined to the palm in the cell before, but not to the other.
    /// let finger = |row: usize| std::array::from_fn::<f64, PARTS, _>(|k| if k / 4 % 4 == row { 1.0 } else { 0.0 });
    /// let palm = Piece { place: [0, 0, 0], occupancy: [1.0; PARTS] };
    /// let fingers = [0, 3].map(|row| Piece { place: [1, 0, 0], occupancy: finger(row) });
    /// let [first, second] = fingers;
    /// let mut lattice = Lattice::new(0.016, Point3::origin(), Rotation3::identity());
    /// let cells = lattice.set_pieces(&[palm, first, second], &[[0, 1], [0, 2]])?;
    /// assert_eq!((cells.len(), lattice.copies([1, 0, 0]).len()), (3, 2));
    /// // Eight nodes of the palm, four of which both fingers share, and four at each tip.
    /// assert_eq!(lattice.rest().len(), 16);
    /// # Ok::<(), topo_ekf::Error>(())
    /// ```
    pub fn set_pieces(
        &mut self,
        pieces: &[Piece],
        joined: &[[usize; 2]],
    ) -> Result<Vec<u32>, Error> {
        let mut at: BTreeMap<[i32; 3], Vec<usize>> = BTreeMap::new();
        for (index, piece) in pieces.iter().enumerate() {
            at.entry(piece.place).or_default().push(index);
        }
        if let Some(place) = self.cell_at.keys().find(|place| !at.contains_key(*place)) {
            return Err(Error::PlaceWithoutPiece { place: *place });
        }
        for (index, pair) in joined.iter().enumerate() {
            let ends = pair.map(|p| pieces.get(p).map(|p| p.place));
            let touch = |a: [i32; 3], b: [i32; 3]| (0..3).all(|k| a[k].abs_diff(b[k]) <= 1);
            if !matches!(ends, [Some(a), Some(b)] if touch(a, b)) {
                return Err(Error::NotJoined { index, pair: *pair });
            }
        }
        let assigned = self.assign(pieces, &at);
        let classes = self.classes(joined, &assigned);
        self.rewire(pieces, &assigned, &classes);
        Ok(assigned.of_piece)
    }

    /// Which copy each piece uses; new cells get the nodes of the copy that they are split from.
    fn assign(&mut self, pieces: &[Piece], at: &BTreeMap<[i32; 3], Vec<usize>>) -> Assigned {
        let mut assigned = Assigned {
            of_piece: vec![u32::MAX; pieces.len()],
            left_over: Vec::new(),
            old: self.cells.len(),
        };
        for (place, here) in at {
            let copies = self.cell_at.get(place).cloned().unwrap_or_default();
            let mut overlaps: Vec<(f64, usize, u32)> = Vec::new();
            for &piece in here {
                for &cell in &copies {
                    let shared = overlap(&pieces[piece].occupancy, &self.cells[cell as usize]);
                    overlaps.push((shared, piece, cell));
                }
            }
            overlaps.sort_by(|a, b| b.0.total_cmp(&a.0).then((a.1, a.2).cmp(&(b.1, b.2))));
            let mut taken = BTreeSet::new();
            for &(_, piece, cell) in &overlaps {
                if assigned.of_piece[piece] == u32::MAX && taken.insert(cell) {
                    assigned.of_piece[piece] = cell;
                }
            }
            for &piece in here {
                if assigned.of_piece[piece] == u32::MAX {
                    let parts_from = overlaps.iter().find(|o| o.1 == piece).map(|o| o.2);
                    assigned.of_piece[piece] = self.copy_cell(*place, parts_from);
                }
            }
            for cell in copies.into_iter().filter(|c| !taken.contains(c)) {
                let with = overlaps.iter().find(|o| o.2 == cell).map(|o| o.1);
                assigned.left_over.extend(with.map(|piece| (cell, piece)));
            }
        }
        assigned
    }

    /// Adds a cell at a place, with the nodes of `from` until it is rewired.
    fn copy_cell(&mut self, place: [i32; 3], from: Option<u32>) -> u32 {
        let nodes = from.map_or([u32::MAX; 8], |c| self.cells[c as usize].nodes);
        self.push_cell(place, nodes)
    }

    /// Classes of corners: the root of corner `k` of cell `c` is at index `8 c + k`.
    fn classes(&self, joined: &[[usize; 2]], assigned: &Assigned) -> Vec<usize> {
        let mut roots = Roots((0..8 * self.cells.len()).collect());
        for pair in joined {
            let [a, b] = pair.map(|p| assigned.of_piece[p] as usize);
            let [from, to] = [a, b].map(|c| self.cells[c].place);
            for (k, corner) in CORNERS.iter().enumerate() {
                let there = [0, 1, 2].map(|x| from[x] + corner[x] - to[x]);
                if let Some(l) = CORNERS.iter().position(|c| *c == there) {
                    roots.join(8 * a + k, 8 * b + l);
                }
            }
        }
        for &(cell, piece) in &assigned.left_over {
            let with = assigned.of_piece[piece] as usize;
            for k in 0..8 {
                roots.join(8 * cell as usize + k, 8 * with + k);
            }
        }
        (0..8 * self.cells.len()).map(|i| roots.find(i)).collect()
    }

    /// Gives every class of corners its node and every cell its material.
    fn rewire(&mut self, pieces: &[Piece], assigned: &Assigned, classes: &[usize]) {
        let known = self.rest.len();
        let mut members: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        for (corner, root) in classes.iter().enumerate() {
            members.entry(*root).or_default().push(corner);
        }
        let stood = |cells: &[Cell], corner: usize| cells[corner / 8].nodes[corner % 8];
        let mut taken = vec![false; known];
        let mut node_of: BTreeMap<usize, u32> = BTreeMap::new();
        for (root, corners) in &members {
            let own = corners.iter().filter(|&&c| c / 8 < assigned.old);
            let nodes: BTreeSet<u32> = own.map(|&c| stood(&self.cells, c)).collect();
            if let Some(node) = nodes.into_iter().find(|&n| !taken[n as usize]) {
                taken[node as usize] = true;
                node_of.insert(*root, node);
            }
        }
        let mut node_at: BTreeMap<[i32; 3], BTreeSet<u32>> = BTreeMap::new();
        let mut nodes = vec![[u32::MAX; 8]; self.cells.len()];
        for (root, corners) in &members {
            let first = corners[0];
            let (place, corner) = (self.cells[first / 8].place, CORNERS[first % 8]);
            let at = [0, 1, 2].map(|a| place[a] + corner[a]);
            let node = node_of.get(root).copied().unwrap_or_else(|| {
                let parts_from = corners.iter().map(|&c| stood(&self.cells, c));
                let parent = parts_from.filter(|&n| n != u32::MAX).min();
                self.rest.push(self.rest_at(at, [0.0; 3]));
                self.parents.push(parent);
                self.rest.len() as u32 - 1
            });
            node_at.entry(at).or_default().insert(node);
            for &c in corners {
                nodes[c / 8][c % 8] = node;
            }
        }
        if self.cells.iter().zip(&nodes).any(|(c, n)| c.nodes != *n) {
            self.wiring += 1;
        }
        for (cell, nodes) in self.cells.iter_mut().zip(nodes) {
            cell.nodes = nodes;
        }
        self.node_at = node_at
            .into_iter()
            .map(|(at, nodes)| (at, nodes.into_iter().collect()))
            .collect();
        let parted = self.cells.iter().map(|cell| self.is_parted(cell.place));
        self.parted = parted.collect();
        for (piece, &cell) in pieces.iter().zip(&assigned.of_piece) {
            let full = piece.occupancy.iter().all(|o| *o >= 1.0 - 1e-9);
            self.set_occupancy(cell, (!full).then_some(piece.occupancy));
        }
        for &(cell, _) in &assigned.left_over {
            self.set_occupancy(cell, Some([0.0; PARTS]));
        }
    }

    /// Whether material is divided at a place: a corner of it has more than one node.
    pub fn is_parted(&self, place: [i32; 3]) -> bool {
        CORNERS.iter().any(|c| {
            let corner = [0, 1, 2].map(|a| place[a] + c[a]);
            self.node_at.get(&corner).is_some_and(|n| n.len() > 1)
        })
    }

    /// Distance of local coordinates of a cell from the material in it, in cells; infinite for a cell without material.
    pub fn away(&self, cell: u32, xi: &[f64; 3]) -> f64 {
        let Some(occupancy) = &self.cells[cell as usize].occupancy else {
            let out = xi.map(|v| (-v).max(v - 1.0).max(0.0));
            return out.iter().map(|v| v * v).sum::<f64>().sqrt();
        };
        let filled = occupancy.iter().enumerate().filter(|(_, o)| **o >= FILLED);
        let squared = |(k, _): (usize, &f64)| {
            let part = [k % 4, k / 4 % 4, k / 16];
            let gap = |a: usize| {
                let low = part[a] as f64 / 4.0;
                (low - xi[a]).max(xi[a] - low - 0.25).max(0.0)
            };
            (0..3).map(|a| gap(a).powi(2)).sum::<f64>()
        };
        filled.map(squared).fold(f64::INFINITY, f64::min).sqrt()
    }
}

/// Pieces and the copies they use.
struct Assigned {
    of_piece: Vec<u32>,
    /// Copies that no piece uses, and the piece they move with.
    left_over: Vec<(u32, usize)>,
    /// Number of cells before the change.
    old: usize,
}

/// Amount of material that a piece and a cell have in common, in parts.
fn overlap(piece: &Occupancy, cell: &Cell) -> f64 {
    match &cell.occupancy {
        None => piece.iter().sum(),
        Some(own) => piece.iter().zip(own.iter()).map(|(a, b)| a.min(*b)).sum(),
    }
}

/// Classes as trees: union by the smaller index, so that roots do not depend on the order.
struct Roots(Vec<usize>);

impl Roots {
    fn find(&mut self, mut i: usize) -> usize {
        while self.0[i] != i {
            self.0[i] = self.0[self.0[i]];
            i = self.0[i];
        }
        i
    }

    fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.find(a), self.find(b));
        self.0[a.max(b)] = a.min(b);
    }
}
