//! Deformation nodes and their neighbours.
//!
//! Landmarks are nodes, and every cube of the voxel grid over the source adds one unless a node already stands within half
//! a spacing. Neighbours of a node are all nodes within 2.35 spacings, and always the nearest eight: a grip on the hidden side has no nodes
//! within reach and would otherwise move alone.

use gpwrm::{Neighbour, Tree};
use nalgebra::{Point3, Vector3};

use crate::cloud::representatives;
use crate::error::Error;

/// Reach of a node in spacings: about 17 neighbours on a surface.
const REACH: f64 = 2.35;
/// Smallest number of neighbours of a node.
const LEAST: usize = 8;
/// Landmarks closer than this share of the spacing are one node.
const SAME: f64 = 0.05;
/// Largest number of nodes solved for.
pub(crate) const MOST: usize = 1500;

/// A neighbour of a node.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Link {
    pub node: usize,
    /// `w_ij`, summing to one over the neighbours.
    pub weight: f64,
    /// `x_j − x_i`.
    pub offset: Vector3<f64>,
}

/// The nodes of one registration.
#[derive(Debug, Default)]
pub(crate) struct Nodes {
    pub positions: Vec<Point3<f64>>,
    /// Neighbours of each node.
    pub links: Vec<Vec<Link>>,
    /// Node of each landmark.
    pub of_landmark: Vec<usize>,
}

impl Nodes {
    pub fn new(
        source: &[Point3<f64>],
        landmarks: impl Iterator<Item = Point3<f64>>,
        spacing: f64,
    ) -> Result<Self, Error> {
        let mut positions: Vec<Point3<f64>> = Vec::new();
        let near = |positions: &[Point3<f64>], p: &Point3<f64>, distance: f64| {
            positions.iter().position(|x| (x - p).norm() < distance)
        };
        let mut of_landmark = Vec::new();
        for p in landmarks {
            let node = near(&positions, &p, SAME * spacing).unwrap_or_else(|| {
                positions.push(p);
                positions.len() - 1
            });
            of_landmark.push(node);
        }
        let cells = representatives(source, spacing)?;
        // Nodes are at least half a spacing apart, so at most eight cells share one.
        if cells.len() > 8 * MOST {
            return Err(too_many(cells.len(), source));
        }
        for kept in cells {
            let p = source[kept.index];
            if near(&positions, &p, spacing / 2.0).is_none() {
                positions.push(p);
            }
        }
        if positions.len() > MOST {
            return Err(too_many(positions.len(), source));
        }
        let links = links(&positions, spacing);
        Ok(Self {
            positions,
            links,
            of_landmark,
        })
    }

    pub fn len(&self) -> usize {
        self.positions.len()
    }
}

pub(crate) fn too_many(nodes: usize, source: &[Point3<f64>]) -> Error {
    let side = |axis: usize| {
        let values = source.iter().map(|p| p[axis]);
        let [least, most] = [f64::min, f64::max].map(|pick| values.clone().reduce(pick));
        most.unwrap_or(0.0) - least.unwrap_or(0.0)
    };
    Error::TooManyNodes {
        nodes,
        limit: MOST,
        extent: side(0).max(side(1)).max(side(2)),
    }
}

fn links(positions: &[Point3<f64>], spacing: f64) -> Vec<Vec<Link>> {
    let Ok(tree) = Tree::new(positions) else {
        return Vec::new();
    };
    positions
        .iter()
        .enumerate()
        .map(|(i, x)| {
            // On a surface, no more than 32 nodes lie within 2.35 spacings.
            let mut near = tree.nearest_n(x, 33.min(positions.len()));
            near.retain(|n| n.index != i);
            node_links(x, positions, &near, spacing)
        })
        .collect()
}

/// Wendland weights of the neighbours within reach, nearest first.
fn node_links(
    x: &Point3<f64>,
    positions: &[Point3<f64>],
    near: &[Neighbour],
    spacing: f64,
) -> Vec<Link> {
    // The support ends a little beyond the eighth neighbour, so that its weight is not zero.
    let eighth = near.get(LEAST - 1).or(near.last());
    let radius = eighth
        .map_or(0.0, |n| 1.2 * n.squared.sqrt())
        .max(REACH * spacing);
    let weight = |n: &Neighbour| gpwrm::Weight::WendlandC2.value(n.squared.sqrt() / radius);
    let reached: Vec<&Neighbour> = near.iter().filter(|n| weight(n) > 0.0).collect();
    let total: f64 = reached.iter().map(|n| weight(n)).sum();
    reached
        .iter()
        .map(|n| Link {
            node: n.index,
            weight: weight(n) / total,
            offset: positions[n.index] - x,
        })
        .collect()
}
