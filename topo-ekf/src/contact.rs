//! Self-contact: which vertices must stay on which side of which triangles.
//!
//! ```text
//! n_T · (x_v − Σ_k b_k x_k) ≥ δ        n_T: unit normal of the triangle, on the side v was on in the last frame
//!                                      b: barycentric coordinates of the projection of v
//! ```
//!
//! A vertex is constrained against triangles that are far along the surface and near in space. Far means: no corner within two rings
//! of it, nor within `π δ` along the edges (the length of a smooth sheet that bends back to itself at a distance `δ`).
//! The side is that of the last live positions, which were feasible: this distinguishes a vertex that has just passed through a
//! sheet from one that belongs on that side.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Point3, Vector3};
use parry3d_f64::bounding_volume::{Aabb, BoundingVolume};
use parry3d_f64::math::Vector as Corner;
use parry3d_f64::partitioning::{Bvh, BvhBuildStrategy};

use crate::rows::{Key, Row};

/// Tolerance in barycentric coordinates for a projection outside a triangle: neighbouring triangles then overlap, and
/// a vertex above their common edge is not missed by both.
const OVERLAP: f64 = 0.1;

/// Share of the reach by which vertices and prisms may move before the candidates are searched again. The linearisations of one frame are usually nearer
/// to each other than that.
const MARGIN: f64 = 0.2;

/// The required separation of a vertex and a triangle, by the side that the vertex is on (±1), m.
pub(crate) type Asked<'a> = dyn Fn(u32, &[u32; 3], f64) -> Option<f64> + 'a;

/// The triangles, and for every vertex the vertices near it along the surface.
#[derive(Clone, Debug, Default)]
pub(crate) struct Surface {
    triangles: Vec<[u32; 3]>,
    corners: Vec<u32>,
    starts: Vec<usize>,
    near: Vec<u32>,
    /// Search tree over the prisms of all triangles; built once and updated before every search.
    tree: Bvh,
    /// Those of the last two searches, the one used last in front: an unconstrained estimate and a projected one alternate in every frame.
    candidates: [Candidates; 2],
}

/// Pairs of a vertex and a triangle far along the surface that were near each other, with a margin; these are all, until something moves farther.
#[derive(Clone, Debug, Default)]
struct Candidates {
    /// Prisms with the margin, by triangle.
    prisms: Vec<Aabb>,
    /// Positions of the vertices of triangles.
    places: Vec<Point3<f64>>,
    /// First triangle of each of these vertices, and one past the last.
    starts: Vec<usize>,
    triangles: Vec<u32>,
}

impl Candidates {
    /// Whether all pairs that are near each other now are among these.
    fn cover(&self, prisms: &[Aabb], places: &[Point3<f64>], margin: f64) -> bool {
        let within = |(a, b): (&Point3<f64>, &Point3<f64>)| (a - b).amax() <= margin;
        self.prisms.len() == prisms.len()
            && self.places.len() == places.len()
            && self.places.iter().zip(places).all(within)
            && self.prisms.iter().zip(prisms).all(|(a, b)| a.contains(b))
    }

    fn of(&self, at: usize) -> &[u32] {
        &self.triangles[self.starts[at]..self.starts[at + 1]]
    }
}

impl Surface {
    /// The same surface if the triangles are unchanged, else a new one; distances along it are those at rest.
    pub fn renewed(self, triangles: &[[u32; 3]], rest: &[Point3<f64>], separation: f64) -> Self {
        if self.triangles == triangles && self.starts.len() == rest.len() + 1 {
            self
        } else {
            Self::new(triangles, rest, std::f64::consts::PI * separation)
        }
    }

    fn new(triangles: &[[u32; 3]], rest: &[Point3<f64>], length: f64) -> Self {
        let mut ring: Vec<Vec<u32>> = vec![vec![]; rest.len()];
        for t in triangles {
            for a in 0..3 {
                ring[t[a] as usize].extend([t[(a + 1) % 3], t[(a + 2) % 3]]);
            }
        }
        for r in &mut ring {
            r.sort_unstable();
            r.dedup();
        }
        let (mut starts, mut near) = (vec![0], vec![]);
        for v in 0..rest.len() as u32 {
            near.extend(around(v, &ring, rest, length));
            starts.push(near.len());
        }
        let corners: BTreeSet<u32> = triangles.iter().flatten().copied().collect();
        Self {
            triangles: triangles.to_vec(),
            corners: corners.into_iter().collect(),
            starts,
            near,
            tree: Bvh::new(),
            candidates: Default::default(),
        }
    }

    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    fn adjoins(&self, vertex: u32, triangle: &[u32; 3]) -> bool {
        let near = &self.near[self.starts[vertex as usize]..self.starts[vertex as usize + 1]];
        triangle.iter().any(|k| near.binary_search(k).is_ok())
    }

    /// Rows for every vertex near a far triangle of `now`, with sides from `before`; at most one row for each vertex, that of the
    /// deepest penetration. `asked` is at most `most`.
    pub fn watch(
        &mut self,
        before: &[Point3<f64>],
        now: &[Point3<f64>],
        asked: &Asked<'_>,
        most: f64,
        reach: f64,
    ) -> Vec<Row> {
        let reach = reach.max(2.0 * most);
        let facets: Vec<_> = self.triangles.iter().map(|t| Facet::new(t, now)).collect();
        self.search(&facets, now, reach);
        let rows = self.corners.iter().enumerate().filter_map(|(at, &v)| {
            let near = self.candidates[0].of(at).iter().filter_map(|&t| {
                let foot = facets[t as usize].as_ref()?.over(&now[v as usize]);
                let triangle = &self.triangles[t as usize];
                Self::pair(v, triangle, before, foot, asked, reach)
            });
            // Ties are broken by the triangle.
            near.max_by(|a, b| {
                a.gap
                    .total_cmp(&b.gap)
                    .then_with(|| b.triangle[0].cmp(&a.triangle[0]))
            })
            .map(|pair| pair.row(v))
        });
        rows.collect()
    }

    /// Searches the candidates again, unless the known ones still cover all.
    fn search(&mut self, facets: &[Option<Facet>], now: &[Point3<f64>], reach: f64) {
        let all = self.triangles.iter().zip(facets);
        let prisms: Vec<Aabb> = all
            .map(|(triangle, facet)| {
                // Slivers get no contacts; any box will do.
                let corner =
                    |k: u32| Corner::new(now[k as usize].x, now[k as usize].y, now[k as usize].z);
                let flat = || Aabb::from_points(triangle.map(corner));
                facet
                    .as_ref()
                    .map_or_else(flat, |f| f.prism(triangle, now, reach))
            })
            .collect();
        let places: Vec<_> = self.corners.iter().map(|&v| now[v as usize]).collect();
        let margin = MARGIN * reach;
        let covers = |c: &Candidates| c.cover(&prisms, &places, margin);
        if covers(&self.candidates[0]) {
            return;
        }
        self.candidates.swap(0, 1);
        if covers(&self.candidates[0]) {
            return;
        }
        let prisms: Vec<Aabb> = prisms.iter().map(|p| p.loosened(margin)).collect();
        self.refresh(&prisms);
        let (mut starts, mut triangles) = (vec![0], vec![]);
        for (&v, p) in self.corners.iter().zip(&places) {
            let here = Corner::new(p.x, p.y, p.z);
            let around = Aabb::new(here, here).loosened(margin);
            let (first, near) = (triangles.len(), self.tree.intersect_aabb(&around));
            triangles.extend(near.filter(|&t| !self.adjoins(v, &self.triangles[t as usize])));
            triangles[first..].sort_unstable();
            starts.push(triangles.len());
        }
        self.candidates[0] = Candidates {
            prisms,
            places,
            starts,
            triangles,
        };
    }

    /// Updates the prisms in the tree.
    fn refresh(&mut self, prisms: &[Aabb]) {
        if self.tree.is_empty() {
            let all = prisms.iter().copied().enumerate();
            self.tree = Bvh::from_iter(BvhBuildStrategy::Binned, all);
        } else {
            for (t, prism) in prisms.iter().enumerate() {
                self.tree.insert_or_update_partially(*prism, t as u32, 0.0);
            }
            self.tree.refit_without_opt();
        }
    }

    fn pair(
        vertex: u32,
        triangle: &[u32; 3],
        before: &[Point3<f64>],
        (height, normal, weights): Foot,
        asked: &Asked<'_>,
        reach: f64,
    ) -> Option<Pair> {
        if height.abs() > reach || weights.iter().any(|b| *b < -OVERLAP) {
            return None;
        }
        let (was, _, _) = Facet::new(triangle, before)?.over(&before[vertex as usize]);
        let side = was.signum();
        let separation = asked(vertex, triangle, side)?;
        let gap = separation - side * height;
        // A reserve of one separation: what is farther away cannot be pushed into contact by the projection.
        (was.abs() > 1e-9 && gap > -separation).then(|| Pair {
            gap,
            triangle: *triangle,
            direction: normal * side,
            weights,
            separation,
        })
    }
}

/// A vertex near a triangle; its row is made only if no other triangle is penetrated deeper.
struct Pair {
    gap: f64,
    triangle: [u32; 3],
    /// Normal on the side of the vertex.
    direction: Vector3<f64>,
    weights: [f64; 3],
    separation: f64,
}

impl Pair {
    fn row(&self, vertex: u32) -> Row {
        let corners = self.triangle.iter().zip(self.weights);
        let corners = corners.map(|(&k, b)| (k, self.direction * -b));
        Row {
            key: Key::Contact(vertex),
            terms: std::iter::once((vertex, self.direction))
                .chain(corners)
                .collect(),
            bound: self.separation,
        }
    }
}

/// Vertices within two rings of `from` or within `length` along the edges, sorted.
fn around(from: u32, ring: &[Vec<u32>], rest: &[Point3<f64>], length: f64) -> Vec<u32> {
    // Path lengths by label correction: for neighbourhoods of a few dozen vertices a heap would be slower.
    let mut reached = BTreeMap::from([(from, (0.0, 0u32))]);
    let mut queue = std::collections::VecDeque::from([from]);
    while let Some(v) = queue.pop_front() {
        let (so_far, rings) = reached[&v];
        for &n in &ring[v as usize] {
            let path = so_far + (rest[n as usize] - rest[v as usize]).norm();
            let old = reached
                .get(&n)
                .copied()
                .unwrap_or((f64::INFINITY, u32::MAX));
            let better = (path.min(old.0), (rings + 1).min(old.1));
            if better != old && (better.0 <= length || better.1 <= 2) {
                reached.insert(n, better);
                queue.push_back(n);
            }
        }
    }
    reached.into_keys().collect()
}

/// Signed height above a triangle's plane, its unit normal and the barycentric weights of the foot.
type Foot = (f64, Vector3<f64>, [f64; 3]);

/// A triangle prepared for tests with many vertices: most candidates are next to it and not above it, which a few products decide.
struct Facet {
    origin: Point3<f64>,
    normal: Vector3<f64>,
    /// Gradients of the second and third barycentric weight.
    slopes: [Vector3<f64>; 2],
}

impl Facet {
    fn new(triangle: &[u32; 3], points: &[Point3<f64>]) -> Option<Self> {
        let [origin, b, c] = triangle.map(|k| points[k as usize]);
        let (u, v) = (b - origin, c - origin);
        let area = u.cross(&v);
        let square = area.norm_squared();
        // A sliver has no side; its neighbours take its place.
        (square > 1e-12 * u.norm_squared() * v.norm_squared()).then(|| Self {
            origin,
            normal: area / square.sqrt(),
            slopes: [v.cross(&area) / square, area.cross(&u) / square],
        })
    }

    /// Bounding box of the points above the triangle, with a margin of [`OVERLAP`], within `reach`: it contains far fewer vertices than there are
    /// triangles in a box of that reach around a vertex.
    fn prism(&self, triangle: &[u32; 3], points: &[Point3<f64>], reach: f64) -> Aabb {
        let corners = triangle.map(|k| points[k as usize].coords);
        let sum: Vector3<f64> = corners.iter().sum();
        let wider = corners.map(|c| c * (1.0 + 3.0 * OVERLAP) - sum * OVERLAP);
        let low = wider[0].inf(&wider[1]).inf(&wider[2]);
        let high = wider[0].sup(&wider[1]).sup(&wider[2]);
        // A nanometre for rounding.
        let margin = (self.normal.abs() * reach).add_scalar(1e-9);
        let corner = |c: Vector3<f64>| Corner::new(c.x, c.y, c.z);
        Aabb::new(corner(low - margin), corner(high + margin))
    }

    fn over(&self, p: &Point3<f64>) -> Foot {
        let w = p - self.origin;
        let [second, third] = self.slopes.map(|s| s.dot(&w));
        let weights = [1.0 - second - third, second, third];
        (self.normal.dot(&w), self.normal, weights)
    }
}
