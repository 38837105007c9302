//! An editable closed triangle mesh: corner `3f + k` is corner `k` of triangle `f`, and represents the edge from it
//! to the next corner.
//!
//! Every operation first checks that the mesh stays a closed 2-manifold of the same genus, and otherwise does nothing.

use super::isosurface::Soup;
use nalgebra::{Point3, Vector3};

/// Marks a triangle or vertex that was removed.
const GONE: u32 = u32::MAX;

/// A closed, oriented 2-manifold mesh.
#[derive(Debug, Clone)]
pub(super) struct Corners {
    pub(super) places: Vec<Point3<f64>>,
    /// Vertex at each corner.
    vertex: Vec<u32>,
    /// The opposite corner: the same edge in the adjacent triangle.
    twin: Vec<u32>,
    /// One corner at each vertex.
    corner: Vec<u32>,
}

/// The next corner of the same triangle.
pub(super) fn next(c: u32) -> u32 {
    if c % 3 == 2 { c - 2 } else { c + 1 }
}

/// The corner before.
pub(super) fn previous(c: u32) -> u32 {
    if c.is_multiple_of(3) { c + 2 } else { c - 1 }
}

impl Corners {
    /// The mesh of these triangles, or `None` if they are not a closed 2-manifold. Vertices without a triangle are removed.
    pub(super) fn new((places, triangles): &Soup) -> Option<Self> {
        let mut index = vec![GONE; places.len()];
        let mut kept = Vec::new();
        let mut vertex = Vec::with_capacity(3 * triangles.len());
        for &v in triangles.iter().flatten() {
            if index[v as usize] == GONE {
                index[v as usize] = kept.len() as u32;
                kept.push(places[v as usize]);
            }
            vertex.push(index[v as usize]);
        }
        let mut mesh = Self {
            corner: vec![GONE; kept.len()],
            places: kept,
            twin: vec![GONE; vertex.len()],
            vertex,
        };
        mesh.pair_twins()?;
        Some(mesh)
    }

    fn pair_twins(&mut self) -> Option<()> {
        let mut edges: Vec<([u32; 2], u32)> = (0..self.vertex.len() as u32)
            .map(|c| ([self.from(c), self.to(c)], c))
            .collect();
        edges.sort_unstable();
        if edges.windows(2).any(|w| w[0].0 == w[1].0) {
            return None;
        }
        for c in 0..self.vertex.len() as u32 {
            let back = [self.to(c), self.from(c)];
            let at = edges.binary_search_by_key(&back, |e| e.0).ok()?;
            self.twin[c as usize] = edges[at].1;
            let v = self.from(c) as usize;
            self.corner[v] = c;
        }
        // Each vertex has a single fan: walking around it visits all its corners.
        let mut count = vec![0; self.places.len()];
        for &v in &self.vertex {
            count[v as usize] += 1;
        }
        (0..self.places.len() as u32)
            .all(|v| self.around(v).count() == count[v as usize])
            .then_some(())
    }

    /// The remaining vertices and triangles.
    pub(super) fn soup(&self) -> Soup {
        let mut index = vec![GONE; self.places.len()];
        let mut places = Vec::new();
        let mut triangles = Vec::new();
        for c in self.triangles() {
            triangles.push([c, c + 1, c + 2].map(|c| {
                let v = self.from(c) as usize;
                if index[v] == GONE {
                    index[v] = places.len() as u32;
                    places.push(self.places[v]);
                }
                index[v]
            }));
        }
        (places, triangles)
    }

    /// The first corner of every triangle.
    pub(super) fn triangles(&self) -> impl Iterator<Item = u32> + '_ {
        (0..self.vertex.len() as u32)
            .step_by(3)
            .filter(|&c| self.vertex[c as usize] != GONE)
    }

    /// One corner for every edge.
    pub(super) fn edges(&self) -> Vec<u32> {
        self.triangles()
            .flat_map(|c| [c, c + 1, c + 2])
            .filter(|&c| c < self.twin(c))
            .collect()
    }

    /// Every vertex.
    pub(super) fn vertices(&self) -> impl Iterator<Item = u32> + '_ {
        (0..self.corner.len() as u32).filter(|&v| self.corner[v as usize] != GONE)
    }

    /// Number of corners, those of removed triangles included.
    pub(super) fn corner_count(&self) -> usize {
        self.vertex.len()
    }

    /// Whether the triangle of a corner is still there.
    pub(super) fn is_live(&self, c: u32) -> bool {
        self.vertex[c as usize] != GONE
    }

    /// The vertex at which the edge of a corner begins.
    pub(super) fn from(&self, c: u32) -> u32 {
        self.vertex[c as usize]
    }

    /// The vertex at which it ends.
    pub(super) fn to(&self, c: u32) -> u32 {
        self.vertex[next(c) as usize]
    }

    /// The vertex opposite to it.
    pub(super) fn opposite(&self, c: u32) -> u32 {
        self.vertex[previous(c) as usize]
    }

    /// The same edge in the adjacent triangle.
    pub(super) fn twin(&self, c: u32) -> u32 {
        self.twin[c as usize]
    }

    /// The corners at a vertex, counter-clockwise.
    pub(super) fn around(&self, v: u32) -> impl Iterator<Item = u32> + '_ {
        self.around_from(self.corner[v as usize])
    }

    /// The corners at the vertex of `first`, counter-clockwise from there.
    pub(super) fn around_from(&self, first: u32) -> impl Iterator<Item = u32> + '_ {
        std::iter::successors(Some(first), move |&c| {
            let c = self.twin(previous(c));
            (c != first).then_some(c)
        })
    }

    /// The neighbours of a vertex.
    pub(super) fn neighbours(&self, v: u32) -> impl Iterator<Item = u32> + '_ {
        self.around(v).map(|c| self.to(c))
    }

    /// Number of neighbours of a vertex.
    pub(super) fn valence(&self, v: u32) -> usize {
        self.around(v).count()
    }

    /// Number of handles, if the mesh is in one piece: `1 − (vertices − edges + triangles) / 2`.
    pub(super) fn handles(&self) -> usize {
        (self.triangles().count() / 2 + 2).saturating_sub(self.vertices().count()) / 2
    }

    /// Length of the edge of a corner.
    pub(super) fn length(&self, c: u32) -> f64 {
        (self.place(self.to(c)) - self.place(self.from(c))).norm()
    }

    /// Place of a vertex.
    pub(super) fn place(&self, v: u32) -> Point3<f64> {
        self.places[v as usize]
    }

    /// Twice the area of the triangle of a corner, times its normal.
    pub(super) fn face(&self, c: u32) -> Vector3<f64> {
        let [p, q, r] = [c, next(c), previous(c)].map(|c| self.place(self.from(c)));
        (q - p).cross(&(r - p))
    }

    /// Sum of the area vectors of the triangles around a vertex; points outward.
    pub(super) fn outward(&self, v: u32) -> Vector3<f64> {
        self.around(v).map(|c| self.face(c)).sum()
    }

    /// Splits the edge of a corner at its middle; returns the new vertex.
    pub(super) fn split(&mut self, c: u32) -> u32 {
        let t = self.twin(c);
        let middle = self.places.len() as u32;
        self.places.push(nalgebra::center(
            &self.place(self.from(c)),
            &self.place(self.to(c)),
        ));
        let cn = next(c);
        let (cn_twin, tp, tp_twin) = (self.twin(cn), previous(t), self.twin(previous(t)));
        let (b, l, r) = (self.to(c), self.opposite(c), self.opposite(t));
        // c: a→m→l stays, t: (m)→a→r. New: x: m→b→l and y: b→m→r.
        let x = self.vertex.len() as u32;
        let y = x + 3;
        self.vertex.extend([middle, b, l, b, middle, r]);
        self.twin.extend([y, cn_twin, cn, x, tp, tp_twin]);
        self.vertex[cn as usize] = middle;
        self.vertex[t as usize] = middle;
        self.twin[cn as usize] = x + 2;
        self.twin[cn_twin as usize] = x + 1;
        self.twin[tp as usize] = y + 1;
        self.twin[tp_twin as usize] = y + 2;
        self.corner.push(x);
        self.corner[b as usize] = y;
        self.corner[l as usize] = x + 2;
        self.corner[r as usize] = y + 2;
        middle
    }

    /// Whether the edge of a corner may be collapsed: its ends have exactly two common neighbours, and those keep at
    /// least three neighbours.
    pub(super) fn can_collapse(&self, c: u32) -> bool {
        let (a, b) = (self.from(c), self.to(c));
        let common = self
            .neighbours(a)
            .filter(|&v| self.neighbours(b).any(|w| w == v))
            .count();
        common == 2
            && self.valence(self.opposite(c)) > 3
            && self.valence(self.opposite(self.twin(c))) > 3
    }

    /// Merges the start of the edge of a corner into its end. Requires [`Self::can_collapse`].
    pub(super) fn collapse(&mut self, c: u32) {
        let t = self.twin(c);
        let (a, b) = (self.from(c), self.to(c));
        let (l, r) = (self.opposite(c), self.opposite(t));
        let fan: Vec<u32> = self.around(a).collect();
        for corner in fan {
            self.vertex[corner as usize] = b;
        }
        for side in [c, t] {
            let (x, y) = (self.twin(next(side)), self.twin(previous(side)));
            self.twin[x as usize] = y;
            self.twin[y as usize] = x;
            // x and y are the two corners of the edge that remains.
            for corner in [x, y] {
                let v = self.from(corner) as usize;
                self.corner[v] = corner;
            }
        }
        for side in [c, t] {
            for corner in [side, next(side), previous(side)] {
                self.vertex[corner as usize] = GONE;
            }
        }
        self.corner[a as usize] = GONE;
        debug_assert!(
            [b, l, r]
                .iter()
                .all(|&v| self.is_live(self.corner[v as usize]))
        );
    }

    /// Whether the edge of a corner may be flipped to join its opposite vertices.
    pub(super) fn can_flip(&self, c: u32) -> bool {
        let (l, r) = (self.opposite(c), self.opposite(self.twin(c)));
        l != r
            && self.valence(self.from(c)) > 3
            && self.valence(self.to(c)) > 3
            && self.neighbours(l).all(|v| v != r)
    }

    /// Flips the edge of a corner to join its opposite vertices. Requires [`Self::can_flip`].
    pub(super) fn flip(&mut self, c: u32) {
        let t = self.twin(c);
        let (a, b, l, r) = (self.from(c), self.to(c), self.opposite(c), self.opposite(t));
        let [cn, cp, tn, tp] = [next(c), previous(c), next(t), previous(t)];
        let [bl, la, ar, rb] = [cn, cp, tn, tp].map(|x| self.twin(x));
        // c: r→l→a with twins (flipped edge, l→a, a→r); t: l→r→b.
        for (corner, vertex, twin) in [
            (c, r, t),
            (cn, l, la),
            (cp, a, ar),
            (t, l, c),
            (tn, r, rb),
            (tp, b, bl),
        ] {
            self.vertex[corner as usize] = vertex;
            self.twin[corner as usize] = twin;
            self.twin[twin as usize] = corner;
            self.corner[vertex as usize] = corner;
        }
    }
}

/// The connected component that encloses the largest volume, or `None` if none encloses any.
pub(super) fn largest_piece((places, triangles): Soup) -> Option<Soup> {
    let mut parent: Vec<u32> = (0..places.len() as u32).collect();
    for t in &triangles {
        for w in [t[1], t[2]] {
            let (a, b) = (root(&mut parent, t[0]), root(&mut parent, w));
            parent[a.max(b) as usize] = a.min(b);
        }
    }
    let mut volume = vec![0.0; places.len()];
    for t in &triangles {
        let [p, q, r] = t.map(|v| places[v as usize] - places[0]);
        volume[root(&mut parent, t[0]) as usize] += p.dot(&q.cross(&r));
    }
    let best = (0..volume.len()).max_by(|&a, &b| volume[a].total_cmp(&volume[b]))?;
    if volume[best] <= 0.0 {
        return None;
    }
    let triangles = triangles
        .into_iter()
        .filter(|t| root(&mut parent, t[0]) as usize == best)
        .collect();
    Some((places, triangles))
}

fn root(parent: &mut [u32], mut v: u32) -> u32 {
    while parent[v as usize] != v {
        parent[v as usize] = parent[parent[v as usize] as usize];
        v = parent[v as usize];
    }
    v
}
