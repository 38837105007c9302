//! The part of a mesh that is known: what the camera sees of a closed one, all of an open one.

use std::collections::HashMap;

use grip_planner::nalgebra::{Point3, UnitVector3, Vector3};
use grip_planner::{Model, Plane};
use parry3d_f64::math::Vector;
use parry3d_f64::query::{Ray, RayCast};
use parry3d_f64::shape::{TriMesh, TriMeshFlags};

/// Vertices and triangles as a file has them.
pub struct Mesh {
    pub points: Vec<Point3<f64>>,
    pub triangles: Vec<[u32; 3]>,
}

impl From<mesh_io::Mesh> for Mesh {
    fn from(mesh: mesh_io::Mesh) -> Self {
        let (points, triangles) = mesh.into_parts();
        Self { points, triangles }
    }
}

/// Data behind a [`Model`], with its triangles.
pub struct Surface {
    pub points: Vec<Point3<f64>>,
    pub triangles: Vec<[u32; 3]>,
    pub closed: bool,
    /// Area of the mesh, seen or not, m².
    pub whole_area: f64,
    normals: Vec<UnitVector3<f64>>,
    areas: Vec<f64>,
    edges: Vec<[u32; 2]>,
    boundary: Vec<bool>,
    visible: Vec<bool>,
}

impl Surface {
    /// The known part of `mesh`.
    pub fn new(mut mesh: Mesh, camera: &Point3<f64>) -> Result<Self, String> {
        let closed = rims(&mesh.triangles).is_empty();
        let free = unhidden(&mesh, camera)?;
        face_outward(&mut mesh, &free, camera);
        let whole_area = mesh
            .triangles
            .iter()
            .map(|t| cross(&mesh.points, t).norm() / 2.0)
            .sum();
        let seen = visible(&mesh, &free, camera);
        if closed {
            mesh.triangles
                .retain(|t| t.iter().all(|&v| seen[v as usize]));
        }
        let mut surface = Self {
            closed,
            whole_area,
            points: Vec::new(),
            triangles: Vec::new(),
            normals: Vec::new(),
            areas: Vec::new(),
            edges: Vec::new(),
            boundary: Vec::new(),
            visible: Vec::new(),
        };
        surface.take(&mesh, &seen);
        if surface.points.is_empty() {
            return Err("the camera sees nothing of it".into());
        }
        Ok(surface)
    }

    pub fn model(&self) -> Model<'_> {
        Model {
            points: &self.points,
            normals: &self.normals,
            areas: &self.areas,
            edges: &self.edges,
            boundary: &self.boundary,
            visible: &self.visible,
            hidden: &[],
        }
    }

    pub fn area(&self) -> f64 {
        self.areas.iter().sum()
    }

    pub fn seen(&self) -> usize {
        self.visible.iter().filter(|v| **v).count()
    }

    /// Keeps the vertices of the triangles that are left.
    fn take(&mut self, mesh: &Mesh, seen: &[bool]) {
        let mut place: Vec<Option<u32>> = vec![None; mesh.points.len()];
        for &v in mesh.triangles.iter().flatten() {
            place[v as usize].get_or_insert_with(|| {
                self.points.push(mesh.points[v as usize]);
                self.visible.push(seen[v as usize]);
                self.points.len() as u32 - 1
            });
        }
        self.triangles = mesh
            .triangles
            .iter()
            .map(|t| t.map(|v| place[v as usize].unwrap_or(0)))
            .collect();
        let mut sums = vec![Vector3::zeros(); self.points.len()];
        self.areas = vec![0.0; self.points.len()];
        for t in &self.triangles {
            let twice = cross(&self.points, t);
            for &v in t {
                sums[v as usize] += twice;
                self.areas[v as usize] += twice.norm() / 6.0;
            }
        }
        self.normals = sums
            .iter()
            .map(|n| UnitVector3::try_new(*n, 0.0).unwrap_or(Vector3::z_axis()))
            .collect();
        self.boundary = vec![false; self.points.len()];
        for v in rims(&self.triangles).into_iter().flatten() {
            self.boundary[v as usize] = true;
        }
        self.edges = sides(&self.triangles).into_keys().collect();
        self.edges.sort_unstable();
    }
}

/// Edges with the number of their triangles.
fn sides(triangles: &[[u32; 3]]) -> HashMap<[u32; 2], usize> {
    let mut count = HashMap::new();
    for t in triangles {
        for k in 0..3 {
            let (a, b) = (t[k], t[(k + 1) % 3]);
            *count.entry([a.min(b), a.max(b)]).or_insert(0) += 1;
        }
    }
    count
}

/// Edges of one triangle only.
fn rims(triangles: &[[u32; 3]]) -> Vec<[u32; 2]> {
    let once = |(edge, count): ([u32; 2], usize)| (count == 1).then_some(edge);
    sides(triangles).into_iter().filter_map(once).collect()
}

/// Twice the vector area.
fn cross(points: &[Point3<f64>], t: &[u32; 3]) -> Vector3<f64> {
    let [a, b, c] = t.map(|v| points[v as usize]);
    (b - a).cross(&(c - a))
}

/// Turns the triangles so that their normals point outward: what is seen first faces the camera.
fn face_outward(mesh: &mut Mesh, free: &[bool], camera: &Point3<f64>) {
    let seen = mesh
        .triangles
        .iter()
        .filter(|t| t.iter().all(|&v| free[v as usize]));
    let toward: f64 = seen
        .map(|t| cross(&mesh.points, t).dot(&(camera - mesh.points[t[0] as usize])))
        .sum();
    if toward < 0.0 {
        mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    }
}

/// Vertices with nothing between them and the camera.
fn unhidden(mesh: &Mesh, camera: &Point3<f64>) -> Result<Vec<bool>, String> {
    let points: Vec<Vector> = mesh.points.iter().map(|p| p.coords.into()).collect();
    let solid = TriMesh::with_flags(points, mesh.triangles.clone(), TriMeshFlags::empty())
        .map_err(|error| format!("the mesh: {error}"))?;
    let origin: Vector = camera.coords.into();
    let free = |p: &Point3<f64>| {
        let ray = Ray::new(origin, (p - camera).into());
        // What is hit just before the vertex is its own neighbourhood.
        solid.cast_local_ray(&ray, 1.0 - 1e-3, true).is_none()
    };
    Ok(mesh.points.iter().map(free).collect())
}

/// Of these the ones with a triangle that faces the camera.
fn visible(mesh: &Mesh, free: &[bool], camera: &Point3<f64>) -> Vec<bool> {
    let mut seen = vec![false; mesh.points.len()];
    for t in &mesh.triangles {
        if cross(&mesh.points, t).dot(&(camera - mesh.points[t[0] as usize])) > 0.0 {
            for v in t.map(|v| v as usize) {
                seen[v] = free[v];
            }
        }
    }
    seen
}

/// The table through the lowest vertex, z up.
pub fn floor(mesh: &Mesh) -> Plane {
    let lowest = mesh
        .points
        .iter()
        .map(|p| p.z)
        .fold(f64::INFINITY, f64::min);
    Plane {
        normal: Vector3::z_axis(),
        offset: -lowest,
    }
}

/// Middle and diagonal of the bounding box.
pub fn extent(points: &[Point3<f64>]) -> (Point3<f64>, f64) {
    let low = points.iter().fold(points[0], |a, p| a.inf(p));
    let high = points.iter().fold(points[0], |a, p| a.sup(p));
    (
        grip_planner::nalgebra::center(&low, &high),
        (high - low).norm(),
    )
}
