//! A box of grid nodes with a value at each node.

use nalgebra::{Point3, Vector3};

/// A box of nodes, ordered along x, then y, then z.
#[derive(Debug, Clone)]
pub(crate) struct Grid {
    /// Place of node (0, 0, 0).
    pub(crate) origin: Point3<f64>,
    /// Distance between neighbouring nodes, m.
    pub(crate) step: f64,
    /// Nodes along each axis.
    pub(crate) nodes: [usize; 3],
}

impl Grid {
    /// The grid with twice the step whose nodes are every second node of this one (which has an odd number of them).
    pub(super) fn coarser(&self) -> Self {
        Self {
            origin: self.origin,
            step: 2.0 * self.step,
            nodes: self.nodes.map(|n| n / 2 + 1),
        }
    }

    /// Number of nodes.
    pub(crate) fn len(&self) -> usize {
        self.nodes.iter().product()
    }

    /// The change of the index for one step along each axis.
    pub(crate) fn strides(&self) -> [usize; 3] {
        [1, self.nodes[0], self.nodes[0] * self.nodes[1]]
    }

    /// Index of a node.
    pub(crate) fn index(&self, node: [usize; 3]) -> usize {
        (node[2] * self.nodes[1] + node[1]) * self.nodes[0] + node[0]
    }

    /// Place of a node.
    pub(crate) fn place(&self, node: [usize; 3]) -> Point3<f64> {
        self.origin + Vector3::from(node.map(|n| n as f64)) * self.step
    }

    /// A position in steps from the origin.
    pub(crate) fn local(&self, point: &Point3<f64>) -> Vector3<f64> {
        (point - self.origin) / self.step
    }

    /// The nodes around a position and their trilinear weights.
    pub(super) fn stencil(&self, point: &Point3<f64>) -> [(usize, f64); 8] {
        let local = self.local(point);
        let low = [0, 1, 2].map(|a| (local[a].max(0.0) as usize).min(self.nodes[a] - 2));
        let part = [0, 1, 2].map(|a| (local[a] - low[a] as f64).clamp(0.0, 1.0));
        std::array::from_fn(|corner| {
            let bit = [corner & 1, corner >> 1 & 1, corner >> 2];
            let weight = (0..3)
                .map(|a| if bit[a] == 1 { part[a] } else { 1.0 - part[a] })
                .product();
            (self.index([0, 1, 2].map(|a| low[a] + bit[a])), weight)
        })
    }

    /// Calls `visit` with every node that is not on the boundary of the box, and its index.
    pub(crate) fn inner(&self, mut visit: impl FnMut([usize; 3], usize)) {
        for z in 1..self.nodes[2] - 1 {
            for y in 1..self.nodes[1] - 1 {
                for x in 1..self.nodes[0] - 1 {
                    visit([x, y, z], self.index([x, y, z]));
                }
            }
        }
    }
}

/// Values of a function at the nodes of a grid.
#[derive(Debug, Clone)]
pub(crate) struct Field {
    pub(crate) grid: Grid,
    pub(crate) values: Vec<f64>,
}

impl Field {
    /// Zero everywhere.
    pub(crate) fn zero(grid: Grid) -> Self {
        let values = vec![0.0; grid.len()];
        Self { grid, values }
    }

    /// The value at a place, trilinear between nodes.
    pub(super) fn at(&self, point: &Point3<f64>) -> f64 {
        self.grid
            .stencil(point)
            .iter()
            .map(|(i, w)| self.values[*i] * w)
            .sum()
    }

    /// The field on a grid of half the step, trilinear between the nodes of this one.
    pub(super) fn refined(&self, fine: Grid) -> Self {
        let mut refined = Self::zero(fine);
        let strides = self.grid.strides();
        let nodes = refined.grid.nodes;
        for z in 0..nodes[2] {
            for y in 0..nodes[1] {
                for x in 0..nodes[0] {
                    let node = [x, y, z];
                    let low = self.grid.index(node.map(|n| n / 2));
                    let odd: Vec3 = node.map(|n| n % 2);
                    let mut sum = 0.0;
                    for corner in 0..8 {
                        let bit = [corner & 1, corner >> 1 & 1, corner >> 2];
                        if (0..3).all(|a| bit[a] <= odd[a]) {
                            sum += self.values
                                [low + (0..3).map(|a| bit[a] * strides[a]).sum::<usize>()];
                        }
                    }
                    let i = refined.grid.index(node);
                    refined.values[i] = sum / f64::from(1 << odd.iter().sum::<usize>());
                }
            }
        }
        refined
    }
}

type Vec3 = [usize; 3];
