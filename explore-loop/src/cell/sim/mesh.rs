//! Triangle meshes that bound a solid.
//!
//! A mesh bounds a solid when every directed edge `(a, b)` and its reverse `(b, a)` occur exactly once: then the surface has no
//! boundary, and all triangles have the same orientation. Its signed volume is
//! `V = ⅙ Σ a·(b×c)`, positive when the triangles are seen counter-clockwise from outside.

use std::collections::HashMap;

use nalgebra::{Point3, Vector3};
use parry3d_f64::query::PointQuery;
use parry3d_f64::shape::{TriMesh, TriMeshFlags};

use super::SimError;
use crate::mesh::Mesh;

/// Above this many triangles the embedding and the camera would dominate the time of a run.
pub const MAX_TRIANGLES: usize = 200_000;

/// Vertices and triangles of a surface.
#[derive(Debug, Clone, PartialEq, Default, serde::Serialize, serde::Deserialize)]
pub struct TriangleMesh {
    /// Positions, metres.
    pub vertices: Vec<Point3<f64>>,
    /// Indices into `vertices`, counter-clockwise seen from outside.
    pub triangles: Vec<[usize; 3]>,
}

impl From<Mesh> for TriangleMesh {
    fn from(mesh: Mesh) -> Self {
        let (vertices, triangles) = mesh.into_parts();
        let triangles = triangles.into_iter().map(|t| t.map(|v| v as usize));
        Self {
            vertices,
            triangles: triangles.collect(),
        }
    }
}

impl TriangleMesh {
    /// The solid that a mesh bounds: checked, and with its triangles reversed if they faced inward.
    ///
    /// # Errors
    /// A mesh that is empty or too large, an index out of range, a vertex that is not finite, a boundary, triangles of opposite
    /// orientations, several pieces, or a size that cannot be in metres.
    pub fn into_solid(mut self) -> Result<Self, SimError> {
        self.check_indices()?;
        self.check_closed()?;
        self.check_size()?;
        let pieces = self.pieces();
        if pieces != 1 {
            return Err(SimError::SeveralPieces { pieces });
        }
        if self.volume() < 0.0 {
            self.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        }
        Ok(self)
    }

    /// Whether every directed edge has exactly one reverse.
    ///
    /// # Errors
    /// The first edge without one, in the order of the triangles.
    pub fn check_closed(&self) -> Result<(), SimError> {
        let mut directed: HashMap<(usize, usize), usize> = HashMap::new();
        for t in &self.triangles {
            for k in 0..3 {
                *directed.entry((t[k], t[(k + 1) % 3])).or_default() += 1;
            }
        }
        for (index, t) in self.triangles.iter().enumerate() {
            for k in 0..3 {
                let (a, b) = (t[k], t[(k + 1) % 3]);
                let along = directed[&(a, b)];
                let against = directed.get(&(b, a)).copied().unwrap_or(0);
                if along + against != 2 {
                    return Err(SimError::NotClosed {
                        a,
                        b,
                        triangles: along + against,
                    });
                }
                if along == 2 {
                    return Err(SimError::NotOriented {
                        a,
                        b,
                        triangle: index,
                    });
                }
            }
        }
        Ok(())
    }

    fn check_indices(&self) -> Result<(), SimError> {
        if self.triangles.is_empty() {
            return Err(SimError::EmptyMesh);
        }
        if self.triangles.len() > MAX_TRIANGLES {
            return Err(SimError::TooManyTriangles {
                count: self.triangles.len(),
                max: MAX_TRIANGLES,
            });
        }
        for (index, point) in self.vertices.iter().enumerate() {
            if !point.iter().all(|c| c.is_finite()) {
                return Err(SimError::NonFiniteVertex {
                    index,
                    point: *point,
                });
            }
        }
        let count = self.vertices.len();
        for (triangle, t) in self.triangles.iter().enumerate() {
            if let Some(&vertex) = t.iter().find(|&&v| v >= count) {
                return Err(SimError::NoSuchVertex {
                    triangle,
                    vertex,
                    count,
                });
            }
        }
        Ok(())
    }

    fn check_size(&self) -> Result<(), SimError> {
        let (low, high) = self.bounds();
        let diagonal = (high - low).norm();
        if (0.02..=1.0).contains(&diagonal) {
            Ok(())
        } else {
            Err(SimError::NotInMetres { diagonal })
        }
    }

    /// The corners of the axis-parallel bounding box.
    pub fn bounds(&self) -> (Point3<f64>, Point3<f64>) {
        let mut low = Point3::from(Vector3::repeat(f64::INFINITY));
        let mut high = Point3::from(Vector3::repeat(f64::NEG_INFINITY));
        for v in &self.vertices {
            low = low.inf(v);
            high = high.sup(v);
        }
        (low, high)
    }

    /// Signed volume, m³.
    pub fn volume(&self) -> f64 {
        // Computed about one of its vertices, so that a mesh far from the origin does not lose precision.
        let origin = self
            .vertices
            .first()
            .copied()
            .unwrap_or_else(Point3::origin);
        let corner = |v: usize| self.vertices[v] - origin;
        self.triangles
            .iter()
            .map(|t| corner(t[0]).dot(&corner(t[1]).cross(&corner(t[2]))))
            .sum::<f64>()
            / 6.0
    }

    /// Area, m².
    pub fn area(&self) -> f64 {
        let v = &self.vertices;
        self.triangles
            .iter()
            .map(|t| 0.5 * (v[t[1]] - v[t[0]]).cross(&(v[t[2]] - v[t[0]])).norm())
            .sum()
    }

    /// Number of connected pieces.
    pub fn pieces(&self) -> usize {
        let mut parent: Vec<usize> = (0..self.vertices.len()).collect();
        for t in &self.triangles {
            for k in 1..3 {
                let (a, b) = (root(&mut parent, t[0]), root(&mut parent, t[k]));
                parent[a.max(b)] = a.min(b);
            }
        }
        let mut used = vec![false; parent.len()];
        self.triangles.iter().for_each(|t| used[t[0]] = true);
        let mut is_root = vec![false; parent.len()];
        for v in 0..parent.len() {
            if used[v] {
                let r = root(&mut parent, v);
                is_root[r] = true;
            }
        }
        is_root.iter().filter(|&&r| r).count()
    }

    pub(super) fn signed_distance(&self) -> Result<SignedDistance, SimError> {
        SignedDistance::new(self)
    }
}

/// Root of `v` in a union-find forest, halving the path on the way.
pub(super) fn root(parent: &mut [usize], mut v: usize) -> usize {
    while parent[v] != v {
        parent[v] = parent[parent[v]];
        v = parent[v];
    }
    v
}

/// Signed distance to a closed surface, which the tetrahedra are cut with.
pub(super) struct SignedDistance(TriMesh);

impl SignedDistance {
    fn new(mesh: &TriangleMesh) -> Result<Self, SimError> {
        let vertices = mesh.vertices.iter().map(|p| p.coords.into()).collect();
        let triangles = mesh.triangles.iter().map(|t| t.map(|v| v as u32)).collect();
        // ORIENTED computes the angle-weighted pseudo-normals that decide the side also at edges and vertices.
        TriMesh::with_flags(vertices, triangles, TriMeshFlags::ORIENTED)
            .map(Self)
            .map_err(|error| SimError::Engine(format!("the surface has no inside: {error}")))
    }

    /// Depth of `point` below the surface, metres; negative outside.
    pub(super) fn depth(&self, point: &Point3<f64>) -> f64 {
        let p = point.coords.into();
        let projection = self.0.project_local_point(p, false);
        let distance = (projection.point - p).length();
        if projection.is_inside {
            distance
        } else {
            -distance
        }
    }
}
