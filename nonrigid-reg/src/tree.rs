//! Neighbour search: a thin face over the k-d tree library, in nalgebra types.

use std::num::NonZero;

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use nalgebra::Point3;

/// A point and its squared distance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Neighbour {
    pub index: usize,
    pub squared: f64,
}

/// k-d tree over points already known to be finite.
pub(crate) struct Tree {
    tree: ImmutableKdTree<f64, 3>,
}

impl Tree {
    /// `None` when there are no points.
    pub fn new(points: &[Point3<f64>]) -> Option<Self> {
        if points.is_empty() {
            return None;
        }
        let coordinates: Vec<[f64; 3]> = points.iter().map(|p| [p.x, p.y, p.z]).collect();
        let tree = ImmutableKdTree::new_from_slice(&coordinates).ok()?;
        Some(Self { tree })
    }

    pub fn nearest(&self, p: &Point3<f64>) -> Neighbour {
        let hit = self
            .tree
            .query(&[p.x, p.y, p.z])
            .nearest_one::<SquaredEuclidean<f64>>()
            .execute();
        Neighbour {
            index: hit.item as usize,
            squared: hit.distance,
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
                squared: hit.distance,
            })
            .collect()
    }
}
