//! Neighbour search: a thin face over the k-d tree library, in nalgebra types.

use std::num::NonZero;
use std::sync::Arc;

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use nalgebra::Point3;

/// A node and how far it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Neighbour {
    pub index: usize,
    pub distance: f64,
}

/// k-d tree over points already known to be finite.
#[derive(Debug, Clone)]
pub(crate) struct Tree {
    /// Shared, so that a clone of a field costs no new tree.
    tree: Arc<ImmutableKdTree<f64, 3>>,
}

impl Tree {
    /// `None` when there are no points.
    pub fn new(points: &[Point3<f64>]) -> Option<Self> {
        if points.is_empty() {
            return None;
        }
        let coordinates: Vec<[f64; 3]> = points.iter().map(|p| [p.x, p.y, p.z]).collect();
        let tree = ImmutableKdTree::new_from_slice(&coordinates).ok()?;
        Some(Self {
            tree: Arc::new(tree),
        })
    }

    pub fn nearest(&self, p: &Point3<f64>) -> Neighbour {
        let hit = self
            .tree
            .query(&[p.x, p.y, p.z])
            .nearest_one::<SquaredEuclidean<f64>>()
            .execute();
        Neighbour {
            index: hit.item as usize,
            distance: hit.distance.sqrt(),
        }
    }

    /// The `count` nearest, nearest first.
    pub fn nearest_n(&self, p: &Point3<f64>, count: usize) -> Vec<Neighbour> {
        let Some(count) = NonZero::new(count) else {
            return Vec::new();
        };
        let hits = self
            .tree
            .query(&[p.x, p.y, p.z])
            .nearest_n::<SquaredEuclidean<f64>>(count)
            .execute();
        hits.iter()
            .map(|hit| Neighbour {
                index: hit.item as usize,
                distance: hit.distance.sqrt(),
            })
            .collect()
    }

    /// All within `radius`, in the order of the tree.
    pub fn within(&self, p: &Point3<f64>, radius: f64) -> Vec<Neighbour> {
        let hits = self
            .tree
            .query(&[p.x, p.y, p.z])
            .within::<SquaredEuclidean<f64>>(radius * radius)
            .unsorted()
            .execute();
        hits.iter()
            .map(|hit| Neighbour {
                index: hit.item as usize,
                distance: hit.distance.sqrt(),
            })
            .collect()
    }
}
