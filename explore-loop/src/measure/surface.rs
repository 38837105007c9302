//! A validated triangle mesh: area, nearest point, crossings with a line.

use super::{MeasureError, Sampling};
use nalgebra::{Point3, UnitVector3, Vector3};
use parry3d_f64::bounding_volume::Aabb;
use parry3d_f64::math::Vector as ParryVector;
use parry3d_f64::query::{PointQuery, PointQueryWithLocation};
use parry3d_f64::shape::TriMesh;

/// Triangles with less area than this, m², are ignored because they have no normal (edges below a thousandth of a millimetre).
const FLAT: f64 = 1e-14;
/// Crossings closer than this, metres, are the same point on a common edge of two triangles.
const SAME: f64 = 1e-7;
/// Tolerance in barycentric coordinates, so that a line through an edge misses neither side.
const EDGE: f64 = 1e-9;

/// A surface that can be measured: finite, with an area. Triangles without area are dropped.
#[derive(Clone)]
pub struct Surface {
    corners: Vec<[Point3<f64>; 3]>,
    normals: Vec<UnitVector3<f64>>,
    /// Index of each triangle in the input mesh.
    given: Vec<u32>,
    /// Cumulative area up to and including each triangle.
    cumulative: Vec<f64>,
    tree: TriMesh,
}

impl std::fmt::Debug for Surface {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Surface")
            .field("triangles", &self.corners.len())
            .finish_non_exhaustive()
    }
}

/// A point on a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Its position.
    pub point: Point3<f64>,
    /// Normal of its triangle.
    pub normal: UnitVector3<f64>,
}

/// Where a line crosses a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Crossing {
    /// Signed distance along the line, metres.
    pub along: f64,
    /// Cosine between the line's direction and the surface normal there.
    pub facing: f64,
    /// Normal of the surface there.
    pub normal: UnitVector3<f64>,
}

/// The nearest point on a surface.
#[derive(Debug, Clone, Copy)]
pub(super) struct Nearest {
    pub distance: f64,
    /// Triangle in the input mesh.
    pub triangle: u32,
    /// Barycentric coordinates of the point in it.
    pub weights: [f64; 3],
}

impl Surface {
    /// Validates a mesh, counter-clockwise seen from outside, in metres.
    ///
    /// # Errors
    /// An index out of range, a vertex that is not finite, no triangle with an area.
    ///
    /// # Complexity
    /// `O(n log n)` in the number of triangles.
    pub fn new(vertices: &[Point3<f64>], triangles: &[[u32; 3]]) -> Result<Self, MeasureError> {
        let mut corners = Vec::with_capacity(triangles.len());
        let mut normals = Vec::with_capacity(triangles.len());
        let mut given = Vec::with_capacity(triangles.len());
        let mut cumulative = Vec::with_capacity(triangles.len());
        let mut total = 0.0;
        for (index, triangle) in triangles.iter().enumerate() {
            let [a, b, c] = checked(vertices, index, *triangle)?;
            let cross = (b - a).cross(&(c - a));
            let area = 0.5 * cross.norm();
            if area < FLAT {
                continue;
            }
            total += area;
            corners.push([a, b, c]);
            normals.push(UnitVector3::new_normalize(cross));
            given.push(index as u32);
            cumulative.push(total);
        }
        if corners.is_empty() {
            return Err(MeasureError::NoArea);
        }
        let tree = TriMesh::new(
            corners.as_flattened().iter().map(parry).collect(),
            (0..corners.len() as u32)
                .map(|k| [3 * k, 3 * k + 1, 3 * k + 2])
                .collect(),
        )
        .map_err(|error| MeasureError::Tree(error.to_string()))?;
        Ok(Self {
            corners,
            normals,
            given,
            cumulative,
            tree,
        })
    }

    /// Area, m².
    pub fn area(&self) -> f64 {
        self.cumulative.last().copied().unwrap_or(0.0)
    }

    /// Diagonal of the bounding box: the object's size, metres.
    pub fn size(&self) -> f64 {
        let bounds = self.tree.local_aabb();
        (bounds.maxs - bounds.mins).length()
    }

    /// Points sampled evenly by area.
    pub fn samples(&self, sampling: Sampling) -> Vec<Sample> {
        sampling
            .positions()
            .map(|(share, [mut r, mut s])| {
                let reached = share * self.area();
                let k = self
                    .cumulative
                    .partition_point(|area| *area < reached)
                    .min(self.corners.len() - 1);
                if r + s > 1.0 {
                    (r, s) = (1.0 - r, 1.0 - s);
                }
                let [a, b, c] = self.corners[k];
                Sample {
                    point: a + (b - a) * r + (c - a) * s,
                    normal: self.normals[k],
                }
            })
            .collect()
    }

    /// Distance of `point` to the surface, metres.
    pub fn distance(&self, point: &Point3<f64>) -> f64 {
        self.nearest(point).distance
    }

    /// The point of the surface nearest to `point`.
    pub(super) fn nearest(&self, point: &Point3<f64>) -> Nearest {
        let query = parry(point);
        let (projection, (triangle, location)) =
            self.tree.project_local_point_and_get_location(query, false);
        let k = (triangle as usize).min(self.given.len() - 1);
        Nearest {
            distance: (projection.point - query).length(),
            triangle: self.given[k],
            weights: location.barycentric_coordinates().unwrap_or([1.0 / 3.0; 3]),
        }
    }

    /// The point nearest to `point` among the triangles whose normals have a cosine of more than `facing` with `normal`, if there is one
    /// within `reach`.
    pub(super) fn nearest_facing(
        &self,
        point: &Point3<f64>,
        normal: &UnitVector3<f64>,
        facing: f64,
        reach: f64,
    ) -> Option<Point3<f64>> {
        let around = Vector3::repeat(reach);
        let bounds = Aabb::new(parry(&(point - around)), parry(&(point + around)));
        let query = parry(point);
        self.tree
            .bvh()
            .intersect_aabb(&bounds)
            .filter(|k| self.normals[*k as usize].dot(normal) > facing)
            .map(|k| {
                self.tree
                    .triangle(k)
                    .project_local_point(query, false)
                    .point
            })
            .map(|x| (Point3::new(x.x, x.y, x.z), (x - query).length()))
            .filter(|(_, distance)| *distance <= reach)
            .min_by(|a, b| a.1.total_cmp(&b.1))
            .map(|(x, _)| x)
    }

    /// The crossings of the line through `point` along `direction` with the surface within `reach` on either side, in order. A crossing
    /// on a common edge of two triangles that face the same side of the line counts once.
    pub fn crossings(
        &self,
        point: &Point3<f64>,
        direction: &UnitVector3<f64>,
        reach: f64,
    ) -> Vec<Crossing> {
        let (start, end) = (
            point - direction.scale(reach),
            point + direction.scale(reach),
        );
        let slack = Vector3::repeat(SAME);
        let bounds = Aabb::new(
            parry(&(start.inf(&end) - slack)),
            parry(&(start.sup(&end) + slack)),
        );
        let mut found: Vec<Crossing> = self
            .tree
            .bvh()
            .intersect_aabb(&bounds)
            .filter_map(|k| {
                let normal = self.normals[k as usize];
                let along = along(&self.corners[k as usize], point, direction)?;
                (along.abs() <= reach).then_some(Crossing {
                    along,
                    facing: normal.dot(direction),
                    normal,
                })
            })
            .collect();
        found.sort_by(|a, b| {
            (a.facing < 0.0)
                .cmp(&(b.facing < 0.0))
                .then(a.along.total_cmp(&b.along))
        });
        // Of the triangles at an edge, the one most nearly perpendicular to the line is kept.
        found.dedup_by(|next, kept| {
            let same =
                (next.facing < 0.0) == (kept.facing < 0.0) && next.along - kept.along <= SAME;
            if same && next.facing.abs() > kept.facing.abs() {
                (kept.facing, kept.normal) = (next.facing, next.normal);
            }
            same
        });
        found.sort_by(|a, b| a.along.total_cmp(&b.along));
        found
    }
}

/// Position on a line of its crossing with a triangle (Möller and Trumbore 1997), if there is one.
fn along(
    [a, b, c]: &[Point3<f64>; 3],
    point: &Point3<f64>,
    direction: &UnitVector3<f64>,
) -> Option<f64> {
    let (u, v) = (b - a, c - a);
    let across = direction.cross(&v);
    let determinant = u.dot(&across);
    if determinant.abs() < f64::EPSILON * u.norm() * v.norm() {
        return None;
    }
    let from = point - a;
    let r = from.dot(&across) / determinant;
    let turned = from.cross(&u);
    let s = direction.dot(&turned) / determinant;
    (r >= -EDGE && s >= -EDGE && r + s <= 1.0 + EDGE).then(|| v.dot(&turned) / determinant)
}

fn checked(
    vertices: &[Point3<f64>],
    triangle: usize,
    corners: [u32; 3],
) -> Result<[Point3<f64>; 3], MeasureError> {
    for vertex in corners {
        let point = vertices
            .get(vertex as usize)
            .ok_or(MeasureError::NoSuchVertex {
                triangle,
                vertex,
                count: vertices.len(),
            })?;
        if !point.iter().all(|c| c.is_finite()) {
            return Err(MeasureError::NotFinite {
                vertex: vertex as usize,
            });
        }
    }
    Ok(corners.map(|i| vertices[i as usize]))
}

fn parry(point: &Point3<f64>) -> ParryVector {
    ParryVector::new(point.x, point.y, point.z)
}
