//! Support radii: the radius of every node, and which nodes can have weight at a point.

use nalgebra::Point3;

use crate::options::Support;
use crate::tree::{Neighbour, Tree};

/// `ρ_i`.
pub(crate) fn node_radii(nodes: &[Point3<f64>], tree: &Tree, support: Support) -> Vec<f64> {
    match support {
        Support::Radius(radius) => vec![radius; nodes.len()],
        Support::Nearest(count) => nodes
            .iter()
            .map(|x| nearest_radius(x, nodes.len(), tree, count))
            .collect(),
    }
}

/// The distance to the node after the `count` nearest others, where the weight is zero.
fn nearest_radius(x: &Point3<f64>, nodes: usize, tree: &Tree, count: usize) -> f64 {
    // The node itself comes first, and one more node bounds the support.
    let wanted = count.saturating_add(2);
    let near = tree.nearest_n(x, wanted.min(nodes));
    let last = near.last().map_or(0.0, Neighbour::distance);
    if near.len() == wanted {
        last
    } else {
        // All nodes are used: the support extends beyond the last, so that it counts too.
        1.5 * last
    }
}

/// For every node `n`, the nodes that can have weight at a point whose nearest node is `n`, with the distance from which on
/// they do. This saves a tree search for each evaluation near the surface.
#[derive(Debug, Clone)]
pub(crate) struct Reach {
    /// `lists[starts[n]..starts[n + 1]]` belongs to node `n`, sorted by `gap`.
    starts: Vec<usize>,
    lists: Vec<Candidate>,
    largest_radius: f64,
}

#[derive(Debug, Clone, Copy)]
struct Candidate {
    node: usize,
    /// `‖x_n − x_i‖ − ρ_i`: node `i` has weight only at points farther than half of this from `n`.
    gap: f64,
}

impl Reach {
    pub fn new(nodes: &[Point3<f64>], tree: &Tree, radii: &[f64]) -> Self {
        let largest_radius = radii.iter().copied().fold(0.0, f64::max);
        let mut starts = vec![0];
        let mut lists = Vec::new();
        for (n, x) in nodes.iter().enumerate() {
            let begin = lists.len();
            for near in tree.within(x, largest_radius + Self::span(radii[n])) {
                let gap = near.distance() - radii[near.index];
                if gap < Self::span(radii[n]) {
                    lists.push(Candidate {
                        node: near.index,
                        gap,
                    });
                }
            }
            lists[begin..].sort_by(|a, b| a.gap.total_cmp(&b.gap).then(a.node.cmp(&b.node)));
            starts.push(lists.len());
        }
        Self {
            starts,
            lists,
            largest_radius,
        }
    }

    /// Lists are complete for points closer to their node than half of this: with the usual support this is slightly more than half
    /// a spacing, so that points on the surface need no search and lists stay short.
    fn span(radius: f64) -> f64 {
        0.6 * radius
    }

    /// Calls `take` for every node that can have weight at `p`, whose nearest node `n` is at `distance`.
    pub fn visit(
        &self,
        n: usize,
        own_radius: f64,
        distance: f64,
        p: &Point3<f64>,
        tree: &Tree,
        mut take: impl FnMut(usize),
    ) {
        let list = &self.lists[self.starts[n]..self.starts[n + 1]];
        let complete = 2.0 * distance < Self::span(own_radius);
        if complete {
            list.iter()
                .take_while(|c| c.gap <= 2.0 * distance)
                .for_each(|c| take(c.node));
        } else {
            for near in tree.within(p, self.largest_radius + distance) {
                take(near.index);
            }
        }
    }
}
