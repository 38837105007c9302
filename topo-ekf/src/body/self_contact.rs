//! Self-contact: inequalities where the surface of a body comes near itself.
//!
//! ```text
//! n_T · (x(e_v) − Σ_k b_k x(e_k)) ≥ δ      vertex v on the outer side of triangle T, whose outer sides face each other
//! ```
//!
//! Parts of the surface that face each other through the inside of a body are kept apart by its material; parts that face each other through the
//! air are not constrained by the elastic energy. Vertices closer than `δ` to a triangle at rest, such as those of fingers that touch, only keep
//! their distance at rest.

use nalgebra::{Point3, Vector3};

use super::lattice::Embedding;
use super::row::BodyInequality;
use crate::Error;
use crate::contact::Surface;
use crate::graph::{check_points, check_vertex};

/// The surface of a body, prepared for finding where it comes near itself.
///
/// ```
/// use topo_ekf::body::{Embedding, SelfContact};
/// use topo_ekf::nalgebra::Point3;
/// # fn main() -> Result<(), topo_ekf::Error> {
/// // Two triangles of one surface, 30 mm apart at rest, whose outer sides face each other.
/// let rest = [[0.0, 0.0, 0.0], [0.01, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, 0.03], [0.0, 0.01, 0.03], [0.01, 0.0, 0.03]].map(Point3::from);
/// let places: Vec<Embedding> = (0..6).map(|k| Embedding::new(k, [0.5; 3])).collect();
/// let mut contact = SelfContact::new(&[[0, 1, 2], [3, 4, 5]], &rest, 0.001)?;
/// assert!(contact.inequalities(&rest, &places)?.is_empty());
/// // Folded together, until they are 1.5 mm apart: every corner has to stay before the other triangle.
/// let live: Vec<Point3<f64>> = rest.iter().map(|p| Point3::new(p.x, p.y, 0.05 * p.z)).collect();
/// assert_eq!(contact.inequalities(&live, &places)?.len(), 6);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone)]
pub struct SelfContact {
    surface: Surface,
    rest: Vec<Point3<f64>>,
    separation: f64,
}

/// Distance from a triangle, in separations, within which vertices are constrained.
const REACH: f64 = 8.0;

impl SelfContact {
    /// Triangles, counter-clockwise seen from outside, over vertices at `rest`, which must stay `separation` metres apart.
    ///
    /// # Errors
    /// A triangle with an index out of range, a vertex that is not finite, a separation that is not positive.
    ///
    /// # Complexity
    /// Linear in the vertices; see the README for times.
    pub fn new(
        triangles: &[[u32; 3]],
        rest: &[Point3<f64>],
        separation: f64,
    ) -> Result<Self, Error> {
        if !(separation > 0.0 && separation <= 1.0) {
            return Err(Error::Value {
                what: "separation",
                index: 0,
                value: separation,
                must: "above 0 and at most 1 m",
            });
        }
        check_points("vertex at rest", rest)?;
        for (index, triangle) in triangles.iter().enumerate() {
            let corners = triangle.iter();
            let mut corners = corners.map(|k| check_vertex("triangle", index, *k, rest.len()));
            corners.try_for_each(|known| known)?;
        }
        Ok(Self {
            surface: Surface::default().renewed(triangles, rest, separation),
            rest: rest.to_vec(),
            separation,
        })
    }

    /// The triangles.
    pub fn triangles(&self) -> &[[u32; 3]] {
        self.surface.triangles()
    }

    /// Number of vertices.
    pub fn vertices(&self) -> usize {
        self.rest.len()
    }

    /// An inequality for every vertex that now faces another part of the surface, for the next frame. `live` are the positions of the vertices,
    /// `places` their embeddings in the lattice; both may be longer than the vertices known here.
    ///
    /// # Errors
    /// Fewer embeddings or positions than vertices, or positions that are not finite.
    ///
    /// # Complexity
    /// `O(n log n)` if few parts are near each other; see the README for times.
    pub fn inequalities(
        &mut self,
        live: &[Point3<f64>],
        places: &[Embedding],
    ) -> Result<Vec<BodyInequality>, Error> {
        let expected = self.rest.len();
        for (what, found) in [
            ("positions", live.len()),
            ("places in the lattice", places.len()),
        ] {
            if found < expected {
                return Err(Error::Length {
                    what,
                    found,
                    expected,
                });
            }
        }
        let live = &live[..expected];
        check_points("position", live)?;
        let normals = vertex_normals(self.triangles(), live);
        let (rest, separation) = (&self.rest, self.separation);
        let asked = |v: u32, triangle: &[u32; 3], side: f64| {
            let [a, b, c] = triangle.map(|k| live[k as usize]);
            let outward = (b - a).cross(&(c - a));
            let faces = side > 0.0 && normals[v as usize].dot(&outward) < 0.0;
            faces.then(|| at_rest(rest, v, triangle).map_or(separation, |h| h.min(separation)))
        };
        let rows = self
            .surface
            .watch(live, live, &asked, separation, REACH * separation);
        Ok(rows
            .into_iter()
            .map(|row| BodyInequality {
                terms: row
                    .terms
                    .iter()
                    .map(|(v, a)| (places[*v as usize], *a))
                    .collect(),
                bound: row.bound,
            })
            .collect())
    }
}

/// Height of a vertex above a triangle at rest, if it faces it there.
fn at_rest(rest: &[Point3<f64>], vertex: u32, triangle: &[u32; 3]) -> Option<f64> {
    let [a, b, c] = triangle.map(|k| rest[k as usize]);
    let normal = (b - a).cross(&(c - a)).try_normalize(0.0)?;
    let p = rest[vertex as usize];
    let height = normal.dot(&(p - a));
    // To the side of the triangle by more than its size, the height is meaningless.
    let size = (b - a).norm().max((c - a).norm());
    let middle = Point3::from((a.coords + b.coords + c.coords) / 3.0);
    let beside = (p - middle) - normal * height;
    (beside.norm() < size).then_some(height)
}

/// Sums of the area vectors around every vertex.
fn vertex_normals(triangles: &[[u32; 3]], points: &[Point3<f64>]) -> Vec<Vector3<f64>> {
    let mut normals = vec![Vector3::zeros(); points.len()];
    for t in triangles {
        let [a, b, c] = t.map(|k| points[k as usize]);
        let area = (b - a).cross(&(c - a));
        for k in t {
            normals[*k as usize] += area;
        }
    }
    normals
}
