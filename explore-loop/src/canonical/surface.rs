//! The surface mesh of the model, and its areas.
//!
//! Each vertex triangulates its own neighbourhood: neighbours on its sheet are projected onto its tangent plane, spade computes
//! the Delaunay triangulation there, and each triangle at the vertex gets a vote. On a well-sampled smooth surface the three corners of a
//! triangle agree; where they do not (sliver neighbourhoods), a triangle with two votes is added if its edges are still
//! free, and small remaining gaps are filled. Every edge has at most two triangles, all oriented outward.

use super::graph;
use super::tangent::tangents;
use nalgebra::{Point3, UnitVector3, Vector3};
use spade::{DelaunayTriangulation, HasPosition, Point2, Triangulation};
use std::collections::BTreeMap;

/// Radius of the local triangulations, in spacings.
const REACH: f64 = 2.6;
/// Gaps with up to this many edges are filled.
const GAP: usize = 8;

/// A neighbour projected onto the tangent plane, and its vertex index.
struct Projected {
    position: Point2<f64>,
    vertex: u32,
}

impl HasPosition for Projected {
    type Scalar = f64;
    fn position(&self) -> Point2<f64> {
        self.position
    }
}

/// Triangles over `points` with outward `normals` at the given spacing, counter-clockwise seen from outside.
///
/// # Complexity
/// `O(n log n)`; about 20 µs for each vertex.
///
/// ```
/// use explore_loop::canonical::surface::{triangulate, vertex_areas};
/// use explore_loop::nalgebra::{Point3, Vector3};
///
/// // A regular hexagon with sides of 1 and its centre: six triangles, all around the centre.
/// let angle = |k: i32| f64::from(k) * std::f64::consts::FRAC_PI_3;
/// let mut points = vec![Point3::origin()];
/// points.extend((0..6).map(|k| Point3::new(angle(k).cos(), angle(k).sin(), 0.0)));
/// let triangles = triangulate(&points, &[Vector3::z_axis(); 7], 1.0);
/// assert_eq!(triangles.len(), 6);
/// assert!(triangles.iter().all(|triangle| triangle.contains(&0)));
/// // A third of the area of each belongs to the centre.
/// let areas = vertex_areas(&points, &triangles);
/// assert!((areas[0] - 3_f64.sqrt() / 2.0).abs() < 1e-12);
/// ```
pub fn triangulate(
    points: &[Point3<f64>],
    normals: &[UnitVector3<f64>],
    spacing: f64,
) -> Vec<[u32; 3]> {
    let mut votes: BTreeMap<[u32; 3], u32> = BTreeMap::new();
    if let Some(tree) = graph::tree(points) {
        for i in 0..points.len() {
            let around = graph::near(&tree, &points[i], REACH * spacing, 40);
            for triangle in star(i, &around, points, normals) {
                *votes.entry(triangle).or_default() += 1;
            }
        }
    }
    let mut mesh = Mesh {
        points,
        normals,
        triangles: Vec::new(),
        edges: BTreeMap::new(),
    };
    for wanted in [3, 2] {
        for (triangle, _) in votes.iter().filter(|(_, count)| **count == wanted) {
            mesh.try_add(*triangle);
        }
    }
    mesh.close_gaps();
    mesh.triangles
}

/// Area of each vertex: a third of the area of the triangles around it, m².
pub fn vertex_areas(points: &[Point3<f64>], triangles: &[[u32; 3]]) -> Vec<f64> {
    let mut areas = vec![0.0; points.len()];
    for t in triangles {
        let [a, b, c] = t.map(|i| points[i as usize]);
        let third = (b - a).cross(&(c - a)).norm() / 6.0;
        for i in t {
            areas[*i as usize] += third;
        }
    }
    areas
}

/// The triangles at vertex `i` of the Delaunay triangulation of its neighbours in its tangent plane, corners sorted.
fn star(
    i: usize,
    around: &[(usize, f64)],
    points: &[Point3<f64>],
    normals: &[UnitVector3<f64>],
) -> Vec<[u32; 3]> {
    let (u, v) = tangents(&normals[i]);
    let mut plane = DelaunayTriangulation::<Projected>::new();
    for &(j, _) in around
        .iter()
        .filter(|(j, _)| *j == i || normals[*j].dot(&normals[i]) > 0.2)
    {
        let d = points[j] - points[i];
        let flat = Vector3::new(d.dot(&u), d.dot(&v), 0.0);
        // Projected points keep their true distance from the vertex, so that steep neighbours do not crowd the centre.
        let stretch = if flat.norm() > 1e-12 {
            d.norm() / flat.norm()
        } else {
            1.0
        };
        let position = Point2::new(flat.x * stretch, flat.y * stretch);
        let tiny = |x: f64| if x.abs() < 1e-30 { 0.0 } else { x };
        // A point that cannot be inserted (not finite, or coincident) casts no vote.
        let _ = plane.insert(Projected {
            position: Point2::new(tiny(position.x), tiny(position.y)),
            vertex: j as u32,
        });
    }
    let mut triangles = Vec::new();
    for face in plane.inner_faces() {
        let mut corners = face.vertices().map(|vertex| vertex.data().vertex);
        if corners.contains(&(i as u32)) {
            corners.sort_unstable();
            triangles.push(corners);
        }
    }
    triangles
}

struct Mesh<'a> {
    points: &'a [Point3<f64>],
    normals: &'a [UnitVector3<f64>],
    triangles: Vec<[u32; 3]>,
    /// Directed edges of the triangles, with the opposite corner; each direction of an edge occurs at most once.
    edges: BTreeMap<[u32; 2], u32>,
}

impl Mesh<'_> {
    /// Adds a triangle, oriented outward, unless it is degenerate or an edge is already taken.
    fn try_add(&mut self, triangle: [u32; 3]) -> bool {
        let [a, b, c] = triangle.map(|i| self.points[i as usize]);
        let face = (b - a).cross(&(c - a));
        let outward: Vector3<f64> = triangle
            .iter()
            .map(|&i| self.normals[i as usize].into_inner())
            .sum();
        if face.norm() < 1e-14 {
            return false;
        }
        let t = if face.dot(&outward) >= 0.0 {
            triangle
        } else {
            [triangle[0], triangle[2], triangle[1]]
        };
        let sides = [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]];
        if sides.iter().any(|side| self.edges.contains_key(side)) {
            return false;
        }
        for (k, side) in sides.into_iter().enumerate() {
            self.edges.insert(side, t[(k + 2) % 3]);
        }
        self.triangles.push(t);
        true
    }

    /// Fills gaps bounded by few edges with triangles that cut their sharpest corners one after the other.
    fn close_gaps(&mut self) {
        for mut gap in self.gaps() {
            while gap.len() > 2 {
                let cut = (0..gap.len())
                    .min_by(|&x, &y| self.corner(&gap, x).total_cmp(&self.corner(&gap, y)));
                let Some(k) = cut else { break };
                let n = gap.len();
                if !self.try_add([gap[(k + n - 1) % n], gap[k], gap[(k + 1) % n]]) {
                    break;
                }
                gap.remove(k);
                if gap.len() == 3 {
                    self.try_add([gap[0], gap[1], gap[2]]);
                    break;
                }
            }
        }
    }

    /// Length of the chord that cuts off corner `k` of a gap.
    fn corner(&self, gap: &[u32], k: usize) -> f64 {
        let n = gap.len();
        (self.points[gap[(k + 1) % n] as usize] - self.points[gap[(k + n - 1) % n] as usize]).norm()
    }

    /// Loops of at most [`GAP`] edges along which triangles are missing.
    fn gaps(&self) -> Vec<Vec<u32>> {
        let mut next: BTreeMap<u32, u32> = BTreeMap::new();
        for [a, b] in self.edges.keys() {
            if !self.edges.contains_key(&[*b, *a]) {
                next.insert(*b, *a);
            }
        }
        let mut loops = Vec::new();
        let mut used = std::collections::BTreeSet::new();
        for &start in next.keys() {
            let mut path = vec![start];
            while let Some(&to) = path.last().and_then(|last| next.get(last)) {
                if to == start || path.len() > GAP {
                    break;
                }
                path.push(to);
            }
            let closes = path.last().and_then(|last| next.get(last)) == Some(&start);
            if closes
                && path.len() > 2
                && path.len() <= GAP
                && path.iter().all(|v| !used.contains(v))
            {
                used.extend(path.iter().copied());
                loops.push(path);
            }
        }
        loops
    }
}
