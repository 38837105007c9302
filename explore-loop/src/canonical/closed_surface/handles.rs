//! Removes handles that are too small to be real.
//!
//! Noise can join two sheets by a bridge, or open a tunnel through a thin one; either adds a handle to the mesh (Euler number
//! `2 − 2 · handles`). Around each handle there is a short loop that does not split the surface in two. The mesh is cut along the shortest
//! such loop and both sides are capped, which breaks a bridge and fills a tunnel. Loops longer than a given length belong to handles of the
//! object, of a ring for example, and are kept.
//!
//! A spanning tree of the vertices, and one of the triangles across the other edges, leave two edges for each handle; the loops that these edges
//! close generate all others (Eppstein, Dynamic generators of topologically embedded graphs, SODA 2003), so every loop that does not split
//! the surface crosses one of them. The shortest loops are therefore searched for only from the vertices of those loops, in a neighbourhood
//! of half the length.

use super::corners::{Corners, next, previous};
use nalgebra::{Point3, Vector3};
use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet, BinaryHeap};

/// Most handles that are cut; a mesh with more does not represent a surface.
const MOST: usize = 200;

/// Cuts handles around which a loop shorter than `longest` runs.
pub(super) fn cut_small(mut mesh: Corners, longest: f64) -> Corners {
    for _ in 0..MOST {
        if mesh.handles() == 0 {
            break;
        }
        let Some(cut) = shortest_loop(&mesh, longest).and_then(|l| cut_along(&mesh, &l)) else {
            break;
        };
        mesh = cut;
    }
    mesh
}

/// Loops around the handles of a mesh, each a list of corners head to tail: for every vertex of the two generating loops of each handle, the shortest.
///
/// None of them splits the surface: edges outside both the tree of shortest paths and the tree of triangles close loops that are independent in homology.
pub(super) fn around_handles(mesh: &Corners) -> Vec<Vec<u32>> {
    let Some(start) = mesh.vertices().next().filter(|_| mesh.handles() > 0) else {
        return Vec::new();
    };
    let everywhere = Paths::new(mesh, start, f64::INFINITY);
    let mut roots = BTreeSet::new();
    for (_, c) in everywhere.leftovers(mesh) {
        roots.extend(everywhere.close(mesh, c).into_iter().map(|c| mesh.from(c)));
    }
    // Loops through neighbouring roots are similar, so only every n-th root is used.
    let apart = roots.len().div_ceil(MOST_ROOTS).max(1);
    let mut loops = Vec::new();
    for &root in roots.iter().step_by(apart) {
        let paths = Paths::new(mesh, root, f64::INFINITY);
        let left = paths.leftovers(mesh);
        loops.extend(left.into_iter().map(|(_, c)| paths.close(mesh, c)));
    }
    loops
}

/// Most vertices from which loops are searched for.
const MOST_ROOTS: usize = 60;

/// A tree of shortest paths: the distance of each reached vertex, and the corner whose edge leads to it.
pub(super) struct Paths {
    pub(super) reached: BTreeMap<u32, (f64, Option<u32>)>,
}

impl Paths {
    /// From `root` to all vertices within `radius`.
    pub(super) fn new(mesh: &Corners, root: u32, radius: f64) -> Self {
        let mut reached: BTreeMap<u32, (f64, Option<u32>)> = BTreeMap::new();
        // Distances are not negative, so their bit patterns are ordered like their values.
        let mut front = BinaryHeap::from([Reverse((0u64, root, None))]);
        while let Some(Reverse((bits, v, by))) = front.pop() {
            if reached.contains_key(&v) {
                continue;
            }
            let distance = f64::from_bits(bits);
            reached.insert(v, (distance, by));
            for c in mesh.around(v) {
                let further = distance + mesh.length(c);
                if further <= radius && !reached.contains_key(&mesh.to(c)) {
                    front.push(Reverse((further.to_bits(), mesh.to(c), Some(c))));
                }
            }
        }
        Self { reached }
    }

    fn has(&self, v: u32) -> bool {
        self.reached.contains_key(&v)
    }

    fn is_tree_edge(&self, mesh: &Corners, c: u32) -> bool {
        let by = |v: u32| self.reached.get(&v).and_then(|r| r.1);
        by(mesh.to(c)) == Some(c) || by(mesh.from(c)) == Some(mesh.twin(c))
    }

    /// Corners from the root to `v`.
    fn to(&self, mesh: &Corners, v: u32) -> Vec<u32> {
        let mut path = Vec::new();
        let mut at = v;
        while let Some((_, Some(c))) = self.reached.get(&at) {
            path.push(*c);
            at = mesh.from(*c);
        }
        path.reverse();
        path
    }

    /// The loop that the edge of `c` closes, without the part that both paths share, as corners head to tail.
    fn close(&self, mesh: &Corners, c: u32) -> Vec<u32> {
        let (out, back) = (self.to(mesh, mesh.from(c)), self.to(mesh, mesh.to(c)));
        let shared = out.iter().zip(&back).take_while(|(a, b)| a == b).count();
        let mut around = out[shared..].to_vec();
        around.push(c);
        around.extend(back[shared..].iter().rev().map(|&b| mesh.twin(b)));
        around
    }

    /// Edges among the reached vertices that are in neither the vertex tree nor the triangle tree, with the length of the loop that each closes,
    /// shortest first.
    fn leftovers(&self, mesh: &Corners) -> Vec<(f64, u32)> {
        let mut edges: Vec<(f64, u32)> = Vec::new();
        for (&v, &(distance, _)) in &self.reached {
            for c in mesh.around(v) {
                if let Some(&(other, _)) = self.reached.get(&mesh.to(c))
                    && c < mesh.twin(c)
                    && !self.is_tree_edge(mesh, c)
                {
                    edges.push((distance + other + mesh.length(c), c));
                }
            }
        }
        // The longest edges enter the triangle tree first, so that the shortest are left over.
        edges.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let mut sets = Sets::default();
        let side = |c: u32| {
            let whole = [c, next(c), previous(c)]
                .iter()
                .all(|&x| self.has(mesh.from(x)));
            // All triangles that are not entirely within reach count as one.
            if whole { c / 3 } else { u32::MAX }
        };
        let mut left: Vec<(f64, u32)> = edges
            .into_iter()
            .filter(|&(_, c)| !sets.join(side(c), side(mesh.twin(c))))
            .collect();
        left.reverse();
        left
    }
}

/// Disjoint sets of triangles.
#[derive(Default)]
struct Sets(BTreeMap<u32, u32>);

impl Sets {
    fn root(&mut self, mut x: u32) -> u32 {
        let mut trail = Vec::new();
        while let Some(&up) = self.0.get(&x) {
            trail.push(x);
            x = up;
        }
        for t in trail {
            self.0.insert(t, x);
        }
        x
    }

    /// Joins the sets of two members; false if they were already in one set.
    fn join(&mut self, a: u32, b: u32) -> bool {
        let (a, b) = (self.root(a), self.root(b));
        if a != b {
            self.0.insert(a.min(b), a.max(b));
        }
        a != b
    }
}

/// The shortest loop of at most `longest` that does not split the surface.
fn shortest_loop(mesh: &Corners, longest: f64) -> Option<Vec<u32>> {
    let start = mesh.vertices().next()?;
    let everywhere = Paths::new(mesh, start, f64::INFINITY);
    let mut roots = BTreeSet::new();
    for (_, c) in everywhere.leftovers(mesh) {
        roots.extend(everywhere.close(mesh, c).into_iter().map(|c| mesh.from(c)));
    }
    let mut best: Option<(f64, Vec<u32>)> = None;
    for root in roots {
        let bound = best.as_ref().map_or(longest, |b| b.0);
        let paths = Paths::new(mesh, root, bound / 2.0);
        for (length, c) in paths.leftovers(mesh) {
            if length >= bound {
                break;
            }
            let around = paths.close(mesh, c);
            if around.len() > 2 && !splits(mesh, &around) {
                best = Some((length, around));
                break;
            }
        }
    }
    best.map(|b| b.1)
}

/// Whether cutting along a loop splits the surface in two.
fn splits(mesh: &Corners, around: &[u32]) -> bool {
    let wall: BTreeSet<u32> = around.iter().flat_map(|&c| [c, mesh.twin(c)]).collect();
    let mut seen = vec![false; mesh.corner_count() / 3];
    let goal = mesh.twin(around[0]) / 3;
    let mut front = vec![around[0] / 3];
    seen[front[0] as usize] = true;
    while let Some(f) = front.pop() {
        if f == goal {
            return false;
        }
        for c in [3 * f, 3 * f + 1, 3 * f + 2] {
            let g = mesh.twin(c) / 3;
            if !wall.contains(&c) && !seen[g as usize] {
                seen[g as usize] = true;
                front.push(g);
            }
        }
    }
    true
}

/// Cuts along a loop, as corners head to tail, and caps both sides with a fan around the middle of the loop.
pub(super) fn cut_along(mesh: &Corners, around: &[u32]) -> Option<Corners> {
    let mut places = mesh.places.clone();
    let mut vertex: BTreeMap<u32, u32> = BTreeMap::new();
    let count = around.len();
    let mut copies = Vec::with_capacity(count);
    for k in 0..count {
        let (out, back) = (around[k], mesh.twin(around[(k + count - 1) % count]));
        copies.push(places.len() as u32);
        // The corners to the left of the loop move to the copy.
        for c in mesh.around_from(out).take_while(|&c| c != back) {
            vertex.insert(c, places.len() as u32);
        }
        places.push(mesh.place(mesh.from(out)));
    }
    let mut triangles: Vec<[u32; 3]> = mesh
        .triangles()
        .map(|c| [c, c + 1, c + 2].map(|c| vertex.get(&c).copied().unwrap_or(mesh.from(c))))
        .collect();
    let sum: Vector3<f64> = around
        .iter()
        .map(|&c| mesh.place(mesh.from(c)).coords)
        .sum();
    let middle = Point3::from(sum / count as f64);
    let (left, right) = (places.len() as u32, places.len() as u32 + 1);
    places.extend([middle, middle]);
    for k in 0..count {
        let after = (k + 1) % count;
        triangles.push([copies[after], copies[k], left]);
        triangles.push([mesh.from(around[k]), mesh.from(around[after]), right]);
    }
    Corners::new(&(places, triangles))
}
