//! Shortest loops that generate the first homology.
//!
//! A basis of cocycles `φ_1 … φ_b` of a subcomplex annotates every edge with `b` bits, and the class of a loop is the sum of the
//! annotations along it: two loops with the same sum are homologous (Busaryev, Cabello, Chen, Dey and Wang 2012). A loop of a
//! non-trivial class uses an annotated edge. So a shortest-path tree is grown from one end of each of these; an edge outside the
//! tree closes a loop; and loops are taken by length if their classes are independent (Erickson and Whittlesey 2005).
//! The result is the shortest basis. A loop through the root of a tree lies within half its length, so trees stop at half
//! the longest loop of the best basis so far.

use crate::cohomology::{Coboundary, NONE, reduce};
use crate::complex::Complex;
use crate::geodesic::ShortestPaths;
use crate::persistence::Order;
use crate::union_find::UnionFind;
use std::collections::BTreeMap;

/// Class of a loop or annotation of an edge: one bit per basis cocycle.
type Class = Box<[u64]>;

/// The edges and triangles of a subcomplex, by their index in the complex.
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

/// A loop closed by the tree of `root` and one more `edge`.
#[derive(Clone, Copy)]
struct Closure {
    length: f64,
    root: u32,
    edge: u32,
}

impl Part {
    /// The simplices up to `scale` all of whose vertices are `wanted`, in filtration order.
    pub(crate) fn new(complex: &Complex, scale: f64, wanted: impl Fn(u32) -> bool) -> Self {
        let skeleton = &complex.skeleton;
        let edges: Vec<u32> = Order::new(complex.edge_values())
            .at
            .into_iter()
            .filter(|&e| {
                let [a, b] = skeleton.edges[e as usize];
                complex.edge_values()[e as usize] <= scale && wanted(a) && wanted(b)
            })
            .collect();
        let mut position = vec![NONE; skeleton.edges.len()];
        for (p, &edge) in edges.iter().enumerate() {
            position[edge as usize] = p as u32;
        }
        let triangles = Order::new(complex.triangle_values())
            .at
            .into_iter()
            .filter(|&t| complex.triangle_values()[t as usize] <= scale)
            .map(|t| skeleton.triangle_edges[t as usize].map(|e| position[e as usize]))
            .filter(|facets| !facets.contains(&NONE))
            .collect();
        Self { edges, triangles }
    }

    /// A basis of `H₁` of the part by its shortest loops, with edge lengths given by `weight`.
    pub(crate) fn shortest_basis(
        &self,
        complex: &Complex,
        weight: impl Fn(u32) -> f64,
    ) -> Vec<Cycle> {
        let cocycles = self.cocycles(complex);
        if cocycles.is_empty() {
            return Vec::new();
        }
        let mut search = Search::new(complex, self, &cocycles, weight);
        for (done, root) in search.roots(&cocycles).into_iter().enumerate() {
            search.grow(root);
            search.close(root);
            // Powers of two: rarely enough to cost nothing, and from the first tree on.
            if (done + 1).is_power_of_two() {
                search.tighten_limit();
            }
        }
        let basis = search.basis();
        basis
            .into_iter()
            .map(|closure| search.trace(closure))
            .collect()
    }

    /// A basis of `H¹`, each cocycle as the edges of the complex on which it is 1.
    fn cocycles(&self, complex: &Complex) -> Vec<Vec<u32>> {
        let mut sets = UnionFind::new(complex.points.len());
        let mut join = |&edge: &u32| {
            let [a, b] = complex.skeleton.edges[edge as usize];
            sets.union(a, b).is_some()
        };
        let joins: Vec<bool> = self.edges.iter().map(&mut join).collect();
        let matrix = Coboundary::new(self.edges.len(), &self.triangles);
        let name = |cocycle: Vec<u32>| {
            cocycle
                .into_iter()
                .map(|e| self.edges[e as usize])
                .collect()
        };
        reduce(&matrix, |edge| joins[edge as usize])
            .essential
            .into_iter()
            .map(|(_, cocycle)| name(cocycle))
            .collect()
    }
}

/// State of the search for the shortest basis.
struct Search<'a> {
    complex: &'a Complex,
    part: &'a Part,
    /// Length of every edge of the complex, infinite outside the part.
    length: Vec<f64>,
    rank: usize,
    words: usize,
    /// `words` words per edge of the complex.
    annotation: Vec<u64>,
    /// `words` words per vertex: class of the tree path to it.
    path_class: Vec<u64>,
    paths: ShortestPaths,
    limit: f64,
    best: BTreeMap<Class, Closure>,
}

impl<'a> Search<'a> {
    fn new(
        complex: &'a Complex,
        part: &'a Part,
        cocycles: &[Vec<u32>],
        weight: impl Fn(u32) -> f64,
    ) -> Self {
        let (edges, vertices) = (complex.skeleton.edges.len(), complex.points.len());
        let words = cocycles.len().div_ceil(64);
        let mut length = vec![f64::INFINITY; edges];
        for &edge in &part.edges {
            length[edge as usize] = weight(edge);
        }
        let mut annotation = vec![0; words * edges];
        for (bit, cocycle) in cocycles.iter().enumerate() {
            for &edge in cocycle {
                annotation[words * edge as usize + bit / 64] |= 1 << (bit % 64);
            }
        }
        Self {
            complex,
            part,
            length,
            rank: cocycles.len(),
            words,
            annotation,
            path_class: vec![0; words * vertices],
            paths: ShortestPaths::new(vertices),
            limit: f64::INFINITY,
            best: BTreeMap::new(),
        }
    }

    /// Vertices that cover all annotated edges, chosen greedily: a vertex on many such edges replaces many others.
    fn roots(&self, cocycles: &[Vec<u32>]) -> Vec<u32> {
        let ends = |edge: u32| self.complex.skeleton.edges[edge as usize];
        let mut edges: Vec<u32> = cocycles.iter().flatten().copied().collect();
        edges.sort_unstable();
        edges.dedup();
        let mut degree = vec![0u32; self.complex.points.len()];
        for v in edges.iter().flat_map(|&edge| ends(edge)) {
            degree[v as usize] += 1;
        }
        edges.sort_by_key(|&edge| {
            let [a, b] = ends(edge);
            std::cmp::Reverse(degree[a as usize].max(degree[b as usize]))
        });
        let mut is_root = vec![false; degree.len()];
        let mut roots = Vec::new();
        for [a, b] in edges.into_iter().map(ends) {
            if !is_root[a as usize] && !is_root[b as usize] {
                let root = if degree[b as usize] > degree[a as usize] {
                    b
                } else {
                    a
                };
                is_root[root as usize] = true;
                roots.push(root);
            }
        }
        roots
    }

    fn grow(&mut self, root: u32) {
        let length = &self.length;
        self.paths
            .run(self.complex, &[root], 0.5 * self.limit, |edge| {
                let length = length[edge as usize];
                length.is_finite().then_some(length)
            });
    }

    /// Records the shortest loop of every class that the present tree and one edge close.
    fn close(&mut self, root: u32) {
        let words = self.words;
        self.path_class[words * root as usize..][..words].fill(0);
        // Parents are settled before their children.
        for &vertex in &self.paths.settled[1..] {
            let edge = self.paths.parent[vertex as usize] as usize;
            let parent = self.other_end(edge as u32, vertex) as usize;
            for word in 0..words {
                self.path_class[words * vertex as usize + word] =
                    self.path_class[words * parent + word] ^ self.annotation[words * edge + word];
            }
        }
        let mut class: Class = vec![0; words].into();
        for &edge in &self.part.edges {
            let [a, b] = self.complex.skeleton.edges[edge as usize].map(|v| v as usize);
            let (from, to) = (self.paths.distance[a], self.paths.distance[b]);
            let length = from + to + self.length[edge as usize];
            if length > self.limit || length.is_infinite() {
                continue;
            }
            let mut trivial = true;
            for word in 0..words {
                class[word] = self.path_class[words * a + word]
                    ^ self.path_class[words * b + word]
                    ^ self.annotation[words * edge as usize + word];
                trivial &= class[word] == 0;
            }
            if trivial {
                continue;
            }
            match self.best.get_mut(&class) {
                Some(known) if known.length <= length => {}
                Some(known) => *known = Closure { length, root, edge },
                None => {
                    self.best
                        .insert(class.clone(), Closure { length, root, edge });
                }
            }
        }
    }

    /// The shortest independent loops among those recorded.
    fn basis(&self) -> Vec<Closure> {
        let mut noted: Vec<(&Class, Closure)> = self.best.iter().map(|(c, l)| (c, *l)).collect();
        noted.sort_by(|a, b| {
            a.1.length
                .total_cmp(&b.1.length)
                .then((a.1.root, a.1.edge).cmp(&(b.1.root, b.1.edge)))
        });
        let mut independent = Independent::default();
        noted.retain(|(class, _)| independent.insert((*class).clone()));
        noted.into_iter().map(|(_, closure)| closure).collect()
    }

    fn tighten_limit(&mut self) {
        let basis = self.basis();
        if basis.len() == self.rank
            && let Some(longest) = basis.last()
        {
            // A small margin, so that rounding loses no loop.
            self.limit = self.limit.min(longest.length * (1.0 + 1e-9));
        }
    }

    /// The loop itself, without the path from the root that both branches share.
    fn trace(&mut self, closure: Closure) -> Cycle {
        self.grow(closure.root);
        let [a, b] = self.complex.skeleton.edges[closure.edge as usize];
        let (mut left, mut right) = (self.branch(a), self.branch(b));
        while left.len() > 1 && right.len() > 1 && left[left.len() - 2] == right[right.len() - 2] {
            left.pop();
            right.pop();
        }
        // Both branches end at the vertex where they separate: keep it once.
        right.pop();
        left.extend(right.into_iter().rev());
        Cycle { vertices: left }
    }

    /// From a vertex up to the root.
    fn branch(&self, mut vertex: u32) -> Vec<u32> {
        let mut branch = vec![vertex];
        while self.paths.parent[vertex as usize] != NONE {
            vertex = self.other_end(self.paths.parent[vertex as usize], vertex);
            branch.push(vertex);
        }
        branch
    }

    fn other_end(&self, edge: u32, vertex: u32) -> u32 {
        let [a, b] = self.complex.skeleton.edges[edge as usize];
        if a == vertex { b } else { a }
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
                for (word, more) in class.iter_mut().zip(row) {
                    *word ^= more;
                }
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
