//! Neighbour search: a thin wrapper of the k-d tree library with nalgebra types.

use std::num::NonZero;
use std::sync::Arc;

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use nalgebra::Point3;

use crate::error::{Error, check_coordinates, is_sound};

/// A point of a [`Tree`] and its distance.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Neighbour {
    /// Index of the point in the slice the tree was built from.
    pub index: usize,
    /// Squared distance, in m².
    pub squared: f64,
}

impl Neighbour {
    fn new(item: u32, squared: f64) -> Self {
        Self {
            index: item as usize,
            squared,
        }
    }

    /// Distance, in m.
    pub fn distance(&self) -> f64 {
        self.squared.sqrt()
    }
}

/// The k-d tree used by field, shape functions and surface, public for use by registration, filters and planners on the
/// same nodes.
///
/// A clone shares the tree. The same points give the same results, also in ties.
///
/// ```
/// use gpwrm::{Tree, nalgebra::Point3};
/// let points: Vec<_> = (0..10).map(|k| Point3::new(f64::from(k), 0.0, 0.0)).collect();
/// let tree = Tree::new(&points)?;
/// let near = tree.nearest_n(&Point3::new(4.2, 0.0, 0.0), 2);
/// assert_eq!((near[0].index, near[1].index), (4, 5));
/// assert_eq!(tree.within(&Point3::new(4.2, 0.0, 0.0), 1.5).len(), 3);
/// assert!(tree.nearest(&Point3::new(f64::NAN, 0.0, 0.0)).is_none());
/// # Ok::<(), gpwrm::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Tree {
    tree: Arc<ImmutableKdTree<f64, 3>>,
}

impl Tree {
    /// Tree over `points`.
    ///
    /// # Errors
    /// No points, or a coordinate that is not finite or beyond 1e60.
    ///
    /// # Complexity
    /// `O(n log n)`.
    pub fn new(points: &[Point3<f64>]) -> Result<Self, Error> {
        check_coordinates("point", points.iter().map(|p| &p.coords))?;
        Self::over(points).ok_or(Error::NoNodes)
    }

    /// Tree over points that are known to be finite; `None` if there are none.
    pub(crate) fn over(points: &[Point3<f64>]) -> Option<Self> {
        if points.is_empty() {
            return None;
        }
        let coordinates: Vec<[f64; 3]> = points.iter().map(|p| [p.x, p.y, p.z]).collect();
        let tree = ImmutableKdTree::new_from_slice(&coordinates).ok()?;
        Some(Self {
            tree: Arc::new(tree),
        })
    }

    /// The nearest point, in `O(log n)`; `None` if `p` is not finite.
    pub fn nearest(&self, p: &Point3<f64>) -> Option<Neighbour> {
        let hit = self
            .tree
            .query(&finite(p)?)
            .nearest_one::<SquaredEuclidean<f64>>()
            .execute();
        Some(Neighbour::new(hit.item, hit.distance))
    }

    /// The `count` nearest, nearest first; none if `p` is not finite.
    pub fn nearest_n(&self, p: &Point3<f64>, count: usize) -> Vec<Neighbour> {
        let (Some(count), Some(at)) = (NonZero::new(count), finite(p)) else {
            return Vec::new();
        };
        let hits = self
            .tree
            .query(&at)
            .nearest_n::<SquaredEuclidean<f64>>(count)
            .execute();
        hits.iter()
            .map(|hit| Neighbour::new(hit.item, hit.distance))
            .collect()
    }

    /// All within `radius`, in the order of the tree; none if `p` is not finite.
    pub fn within(&self, p: &Point3<f64>, radius: f64) -> Vec<Neighbour> {
        let Some(at) = finite(p) else {
            return Vec::new();
        };
        let hits = self
            .tree
            .query(&at)
            .within::<SquaredEuclidean<f64>>(radius * radius)
            .unsorted()
            .execute();
        hits.iter()
            .map(|hit| Neighbour::new(hit.item, hit.distance))
            .collect()
    }
}

/// Coordinates for a search; `None` if they are not finite or too large to square.
fn finite(p: &Point3<f64>) -> Option<[f64; 3]> {
    p.iter().all(|&c| is_sound(c)).then_some([p.x, p.y, p.z])
}
