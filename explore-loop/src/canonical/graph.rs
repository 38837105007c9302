//! The surface graph: which vertices are neighbours on one sheet.
//!
//! ```text
//! i ~ j  ⇔  ‖X_i − X_j‖ ≤ reach · ε   and   n_i · n_j ≥ cos_min
//! ```
//! at rest, where `ε` is the spacing. The bound on the cosine keeps sheets with opposing normals apart, however thin
//! the body. Each vertex chooses at most `most` neighbours, nearest first, so that a dense cluster of vertices does not
//! stiffen the filter.

use super::CanonicalModel;
use super::tangent::widest_gap;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use nalgebra::Point3;
use std::num::NonZero;

/// Largest distance of a neighbour, in spacings.
const REACH: f64 = 2.1;
/// Neighbours whose normals differ more than this belong to another sheet: 75 degrees.
const COS_MIN: f64 = 0.25;
/// Most neighbours a vertex chooses.
const MOST: usize = 10;

/// A k-d tree over points, for [`near`] and [`nearest`].
#[derive(Debug)]
pub struct Tree(ImmutableKdTree<f64, 3>);

/// A search tree over `points`, or `None` when there are none (the library answers infinity then).
pub fn tree(points: &[Point3<f64>]) -> Option<Tree> {
    if points.is_empty() {
        return None;
    }
    let coordinates: Vec<[f64; 3]> = points.iter().map(|p| [p.x, p.y, p.z]).collect();
    ImmutableKdTree::new_from_slice(&coordinates).ok().map(Tree)
}

/// Indices and distances of the points within `radius` of `query`, nearest first, at most `most`.
pub fn near(tree: &Tree, query: &Point3<f64>, radius: f64, most: usize) -> Vec<(usize, f64)> {
    let Some(most) = NonZero::new(most) else {
        return Vec::new();
    };
    tree.0
        .query(&[query.x, query.y, query.z])
        .nearest_n::<SquaredEuclidean<f64>>(most)
        .execute()
        .into_iter()
        .map(|hit| (hit.item as usize, hit.distance.sqrt()))
        .take_while(|(_, distance)| *distance <= radius)
        .collect()
}

/// Index and distance of the point nearest to `query`.
///
/// ```
/// use explore_loop::canonical::graph::{near, nearest, tree};
/// use explore_loop::nalgebra::Point3;
///
/// let points = [0.0, 1.0, 3.0].map(|x| Point3::new(x, 0.0, 0.0));
/// let tree = tree(&points).ok_or("no points")?;
/// let query = Point3::new(1.25, 0.0, 0.0);
/// assert_eq!(nearest(&tree, &query), (1, 0.25));
/// // Nearest first; the third point is farther than the radius.
/// assert_eq!(near(&tree, &query, 1.5, 10), [(1, 0.25), (0, 1.25)]);
/// # Ok::<(), &str>(())
/// ```
pub fn nearest(tree: &Tree, query: &Point3<f64>) -> (usize, f64) {
    let hit = tree
        .0
        .query(&[query.x, query.y, query.z])
        .nearest_one::<SquaredEuclidean<f64>>()
        .execute();
    (hit.item as usize, hit.distance.sqrt())
}

/// The edges of the surface graph of `model` at `spacing`, sorted, `i < j`.
///
/// # Complexity
/// `O(n log n)`.
pub fn surface_edges(model: &CanonicalModel, spacing: f64) -> Vec<[u32; 2]> {
    let Some(tree) = tree(&model.rest) else {
        return Vec::new();
    };
    let mut edges = Vec::new();
    for i in 0..model.len() {
        let mut chosen = 0;
        for (j, _) in near(&tree, &model.rest[i], REACH * spacing, 3 * MOST) {
            if j == i || model.rest_normals[i].dot(&model.rest_normals[j]) < COS_MIN {
                continue;
            }
            // A cut edge counts as a neighbour; otherwise the next nearest vertex across the cut would replace it.
            chosen += 1;
            let edge = [i.min(j) as u32, i.max(j) as u32];
            if !model.is_cut(edge) {
                edges.push(edge);
            }
            if chosen == MOST {
                break;
            }
        }
    }
    edges.sort_unstable();
    edges.dedup();
    edges
}

/// Adjacency lists of `edges` over `count` vertices.
pub fn adjacency(count: usize, edges: &[[u32; 2]]) -> Vec<Vec<u32>> {
    let mut lists = vec![Vec::new(); count];
    for &[a, b] in edges {
        lists[a as usize].push(b);
        lists[b as usize].push(a);
    }
    lists
}

/// Widest angle between consecutive directions to neighbours, seen along the normal, for a vertex in the interior of the surface; at a
/// straight boundary it is half a turn.
const WIDEST: f64 = 140.0 / 180.0 * std::f64::consts::PI;

/// Which vertices lie at the frontier, the boundary of the known surface from which it may grow.
pub fn frontier(model: &CanonicalModel) -> Vec<bool> {
    let neighbours = adjacency(model.len(), &model.edges);
    (0..model.len())
        .map(|i| {
            let around = neighbours[i]
                .iter()
                .map(|&j| model.rest[j as usize] - model.rest[i]);
            widest_gap(&model.rest_normals[i], around) > WIDEST
        })
        .collect()
}
