//! Shortest loops that carry the first homology.
//!
//! A basis of cocycles `φ_1 … φ_b` of a subcomplex annotates every edge with `b` bits, and the class of a loop is the sum of the
//! annotations along it: two loops with the same sum are homologous (Busaryev, Cabello, Chen, Dey and Wang 2012). A loop of a
//! non-trivial class uses an annotated edge. So from one end of each of these, shortest-path trees are grown; an edge outside the tree closes a loop;
//! and the loops are taken by length as long as their classes are independent (Erickson and Whittlesey 2005). The basis
//! found is the shortest there is.

use crate::cohomology::{Coboundary, NONE, UnionFind, reduce};
use crate::complex::Complex;
use crate::geodesic::ShortestPaths;
use crate::persistence::Order;
use std::collections::BTreeMap;

/// Class of a loop or annotation of an edge: one bit per basis cocycle.
type Class = Vec<u64>;

/// The edges and triangles of a subcomplex, named by their place in the complex.
pub(crate) struct Part {
    edges: Vec<u32>,
    /// Facets of its triangles as positions in `edges`.
    triangles: Vec<[u32; 3]>,
}

/// A closed path.
pub(crate) struct Cycle {
    /// Vertices in order; the last is joined to the first.
    pub(crate) vertices: Vec<u32>,
}

/// A loop that a tree and one more edge close.
struct Candidate {
    length: f64,
    root: u32,
    edge: u32,
    class: Class,
}

impl Part {
    /// The simplices up to `scale` all of whose vertices are wanted, in filtration order.
    pub(crate) fn new(complex: &Complex, scale: f64, wanted: impl Fn(u32) -> bool) -> Self {
        let skeleton = &complex.skeleton;
        let edges: Vec<u32> = Order::new(&skeleton.edge_values)
            .at
            .into_iter()
            .filter(|&e| {
                let [a, b] = skeleton.edges[e as usize];
                skeleton.edge_values[e as usize] <= scale && wanted(a) && wanted(b)
            })
            .collect();
        let mut position = vec![NONE; skeleton.edges.len()];
        for (p, &edge) in edges.iter().enumerate() {
            position[edge as usize] = p as u32;
        }
        let triangles = Order::new(&skeleton.triangle_values)
            .at
            .into_iter()
            .filter(|&t| skeleton.triangle_values[t as usize] <= scale)
            .map(|t| skeleton.triangle_edges[t as usize].map(|e| position[e as usize]))
            .filter(|facets| !facets.contains(&NONE))
            .collect();
        Self { edges, triangles }
    }

    /// Annotation of every edge of the complex by a basis of `H¹` of the part, and the rank of it.
    fn annotate(&self, complex: &Complex) -> (BTreeMap<u32, Class>, usize) {
        let mut sets = UnionFind::new(complex.points.len());
        let mut join = |&edge: &u32| {
            let [a, b] = complex.skeleton.edges[edge as usize];
            sets.union(a, b).is_some()
        };
        let joins: Vec<bool> = self.edges.iter().map(&mut join).collect();
        let matrix = Coboundary::new(self.edges.len(), &self.triangles);
        let cocycles = reduce(&matrix, |edge| joins[edge as usize]).essential;
        let words = cocycles.len().div_ceil(64);
        let mut annotations = BTreeMap::new();
        for (bit, (_, cocycle)) in cocycles.iter().enumerate() {
            for &edge in cocycle {
                let class = annotations
                    .entry(self.edges[edge as usize])
                    .or_insert_with(|| vec![0; words]);
                class[bit / 64] |= 1 << (bit % 64);
            }
        }
        (annotations, cocycles.len())
    }

    /// A basis of `H₁` of the part by its shortest loops, where an edge is as long as `weight` says.
    pub(crate) fn shortest_basis(
        &self,
        complex: &Complex,
        weight: impl Fn(u32) -> f64,
    ) -> Vec<Cycle> {
        let (annotations, rank) = self.annotate(complex);
        if rank == 0 {
            return Vec::new();
        }
        let mut member = vec![false; complex.skeleton.edges.len()];
        for &edge in &self.edges {
            member[edge as usize] = true;
        }
        let length = |edge: u32| member[edge as usize].then(|| weight(edge));
        let mut roots: Vec<u32> = annotations
            .keys()
            .map(|&edge| complex.skeleton.edges[edge as usize][0])
            .collect();
        roots.sort_unstable();
        roots.dedup();

        let mut paths = ShortestPaths::new(complex.points.len());
        let mut candidates = Vec::new();
        for &root in &roots {
            paths.run(complex, &[root], f64::INFINITY, length);
            self.close(
                complex,
                &paths,
                &annotations,
                &weight,
                root,
                rank,
                &mut candidates,
            );
        }
        candidates.sort_by(|a, b| {
            a.length
                .total_cmp(&b.length)
                .then((a.root, a.edge).cmp(&(b.root, b.edge)))
        });
        let mut independent = Independent::default();
        let mut cycles = Vec::with_capacity(rank);
        for candidate in candidates {
            if cycles.len() < rank && independent.insert(candidate.class) {
                paths.run(complex, &[candidate.root], f64::INFINITY, length);
                cycles.push(trace(complex, &paths, candidate.edge));
            }
        }
        cycles
    }

    /// The shortest loop of every class that one tree and one edge close.
    #[allow(
        clippy::too_many_arguments,
        reason = "the inner loop of `shortest_basis`, with its locals"
    )]
    fn close(
        &self,
        complex: &Complex,
        paths: &ShortestPaths,
        annotations: &BTreeMap<u32, Class>,
        weight: impl Fn(u32) -> f64,
        root: u32,
        rank: usize,
        candidates: &mut Vec<Candidate>,
    ) {
        let zero: Class = vec![0; rank.div_ceil(64)];
        // Class of the tree path to every vertex, parents first.
        let mut class_of: BTreeMap<u32, Class> = BTreeMap::new();
        for &vertex in &paths.settled {
            let edge = paths.parent[vertex as usize];
            if edge == NONE {
                continue;
            }
            let parent = other_end(complex, edge, vertex);
            let mut class = class_of
                .get(&parent)
                .cloned()
                .unwrap_or_else(|| zero.clone());
            add(&mut class, annotations.get(&edge));
            if class != zero {
                class_of.insert(vertex, class);
            }
        }
        let mut best: BTreeMap<Class, (f64, u32)> = BTreeMap::new();
        for &edge in &self.edges {
            let [a, b] = complex.skeleton.edges[edge as usize];
            let (from, to) = (paths.distance[a as usize], paths.distance[b as usize]);
            if from.is_infinite()
                || paths.parent[a as usize] == edge
                || paths.parent[b as usize] == edge
            {
                continue;
            }
            let mut class = class_of.get(&a).cloned().unwrap_or_else(|| zero.clone());
            add(&mut class, class_of.get(&b));
            add(&mut class, annotations.get(&edge));
            if class == zero {
                continue;
            }
            let length = from + to + weight(edge);
            let entry = best.entry(class).or_insert((length, edge));
            if length < entry.0 {
                *entry = (length, edge);
            }
        }
        candidates.extend(best.into_iter().map(|(class, (length, edge))| Candidate {
            length,
            root,
            edge,
            class,
        }));
    }
}

/// Row echelon form over Z/2.
#[derive(Default)]
struct Independent {
    rows: Vec<(usize, Class)>,
}

impl Independent {
    /// Adds a class if it is independent of those before.
    fn insert(&mut self, mut class: Class) -> bool {
        for (bit, row) in &self.rows {
            if class[bit / 64] >> (bit % 64) & 1 == 1 {
                add(&mut class, Some(row));
            }
        }
        let Some(word) = class.iter().position(|&word| word != 0) else {
            return false;
        };
        let bit = 64 * word + class[word].trailing_zeros() as usize;
        self.rows.push((bit, class));
        true
    }
}

fn add(class: &mut Class, other: Option<&Class>) {
    if let Some(other) = other {
        for (word, more) in class.iter_mut().zip(other) {
            *word ^= more;
        }
    }
}

fn other_end(complex: &Complex, edge: u32, vertex: u32) -> u32 {
    let [a, b] = complex.skeleton.edges[edge as usize];
    if a == vertex { b } else { a }
}

/// The loop that `edge` closes with the tree, without the stem that both branches share.
fn trace(complex: &Complex, paths: &ShortestPaths, edge: u32) -> Cycle {
    let branch = |mut vertex: u32| {
        let mut branch = vec![vertex];
        while paths.parent[vertex as usize] != NONE {
            vertex = other_end(complex, paths.parent[vertex as usize], vertex);
            branch.push(vertex);
        }
        branch
    };
    let [a, b] = complex.skeleton.edges[edge as usize];
    let (mut left, mut right) = (branch(a), branch(b));
    while left.len() > 1 && right.len() > 1 && left[left.len() - 2] == right[right.len() - 2] {
        left.pop();
        right.pop();
    }
    // Both branches end at the vertex where they part: keep it once.
    right.pop();
    left.extend(right.into_iter().rev());
    Cycle { vertices: left }
}
