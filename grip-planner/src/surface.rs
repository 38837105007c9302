//! The known part of a surface, as data for a [`Model`]: from a mesh, a complex, or points and their graph.

use std::collections::BTreeMap;

use nalgebra::{Point3, UnitVector3, Vector3};
use parry3d_f64::math::Vector;
use parry3d_f64::query::{Ray, RayCast};
use parry3d_f64::shape::{TriMesh, TriMeshFlags};

use crate::model::check_points;
use crate::scene::positive;
use crate::{Error, Model};

/// The known part of a surface, owned. [`Surface::model`] borrows it for the planner.
#[derive(Debug, Clone)]
pub struct Surface {
    points: Vec<Point3<f64>>,
    triangles: Vec<[u32; 3]>,
    normals: Vec<UnitVector3<f64>>,
    areas: Vec<f64>,
    edges: Vec<[u32; 2]>,
    boundary: Vec<bool>,
    visible: Vec<bool>,
    closed: bool,
    whole_area: f64,
}

impl Surface {
    /// The part of a closed mesh that the camera sees, or all of an open one. The camera sees a vertex that is not occluded and has a triangle that faces it. Triangles are oriented
    /// such that visible ones face the camera.
    ///
    /// # Errors
    /// No points or no triangles, points that are not finite, triangles of vertices that do not exist, or [`Error::NothingVisible`].
    ///
    /// # Complexity
    /// `O(n log n)`: one ray for each vertex.
    ///
    /// ```
    /// use grip_planner::{Surface, missing_vector_area};
    /// use nalgebra::Point3;
    ///
    /// // An octahedron seen from above: the lower half is missing, and the square across it faces down.
    /// let points = [[1., 0., 0.], [0., 1., 0.], [-1., 0., 0.], [0., -1., 0.], [0., 0., 1.], [0., 0., -1.]].map(Point3::from);
    /// let side = |k: u32| [[k, (k + 1) % 4, 4], [(k + 1) % 4, k, 5]];
    /// let triangles: Vec<_> = (0..4).flat_map(side).collect();
    /// let surface = Surface::from_mesh(&points, &triangles, &Point3::new(0.0, 0.0, 9.0))?;
    /// assert_eq!((surface.model().points.len(), surface.is_closed()), (5, true));
    /// let missing = missing_vector_area(&surface.model());
    /// assert!(missing.z < -2.0 && missing.xy().norm() < 1e-12);
    /// # Ok::<(), grip_planner::Error>(())
    /// ```
    pub fn from_mesh(
        points: &[Point3<f64>],
        triangles: &[[u32; 3]],
        camera: &Point3<f64>,
    ) -> Result<Self, Error> {
        check_points(points)?;
        check_points(&[*camera])?;
        if points.is_empty() || triangles.is_empty() {
            return Err(Error::EmptyModel);
        }
        if let Some(&vertex) = triangles
            .iter()
            .flatten()
            .find(|&&v| v as usize >= points.len())
        {
            let points = points.len();
            return Err(Error::NoSuchVertex { vertex, points });
        }
        let mut mesh = Mesh {
            points,
            triangles: triangles.to_vec(),
        };
        let closed = boundary_edges(triangles).is_empty();
        let free = unhidden(&mesh, camera)?;
        face_outward(&mut mesh, &free, camera);
        let seen = visible(&mesh, &free, camera);
        let areas = mesh.triangles.iter().map(|t| cross(points, t).norm() / 2.0);
        let whole_area = areas.sum();
        if closed {
            mesh.triangles
                .retain(|t| t.iter().all(|&v| seen[v as usize]));
        }
        Self::of_part(&mesh, &seen, closed, whole_area)
    }

    /// The points of a complex of the given `spacing` (m), with its edges up to scale 1; the boundary is where [`classify`](cech_complex::Complex::classify)
    /// finds it. Otherwise as [`Surface::from_graph`].
    ///
    /// # Errors
    /// A `spacing` that is not positive, a camera that is not finite, or a complex with cut vertices: they have no place in a model.
    ///
    /// ```
    /// use cech_complex::manifolds::Manifold;
    /// use cech_complex::{Complex, Cylinder, Options};
    /// use grip_planner::{Surface, missing_vector_area};
    /// use nalgebra::Point3;
    ///
    /// // The upper half of a ball.
    /// let cap = Manifold::Cap { radius: 0.05, angle: 1.57 }.net(600, 1);
    /// let cylinder = Cylinder::from_spacing_and_reach(cap.spacing, 0.05)?;
    /// let complex = Complex::build(&cap.points, &cap.normals, cylinder, &Options::default())?;
    ///
    /// let surface = Surface::from_complex(&complex, cap.spacing, &Point3::new(0.0, 0.0, 0.5))?;
    /// let missing = missing_vector_area(&surface.model());
    /// assert!((missing.z / (-std::f64::consts::PI * 0.05 * 0.05) - 1.0).abs() < 0.03);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[cfg(feature = "cech-complex")]
    pub fn from_complex(
        complex: &cech_complex::Complex,
        spacing: f64,
        camera: &Point3<f64>,
    ) -> Result<Self, Error> {
        let kinds = complex.classify(spacing).map_err(|_| Error::BadSetting {
            name: "spacing",
            value: spacing,
            expected: "finite and above 0",
        })?;
        let points = complex.points();
        if let Some(vertex) = (0..points.len() as u32).find(|&v| !complex.contains_vertex(v)) {
            let points = points.len();
            return Err(Error::NoSuchVertex { vertex, points });
        }
        let within = |(edge, value): (&[u32; 2], &f64)| (*value <= 1.0).then_some(*edge);
        let edges = complex.edges().iter().zip(complex.edge_values());
        let edges: Vec<[u32; 2]> = edges.filter_map(within).collect();
        let boundary: Vec<bool> = kinds
            .iter()
            .map(|kind| *kind == cech_complex::VertexKind::Boundary)
            .collect();
        let normals = complex.normals();
        Self::from_graph(points, normals, &edges, &boundary, spacing, camera)
    }

    /// Points with outward unit `normals`, `edges` between neighbours and the `boundary` of the known part. Each point has
    /// the area `spacing²` (m²); those whose normals face the camera are visible.
    ///
    /// # Errors
    /// As the check of a [`Model`]: slices of different lengths, values that are not finite, normals that are not unit vectors, edges to vertices that do not exist; a `spacing` that is not positive.
    ///
    /// ```
    /// use grip_planner::{Surface, missing_vector_area};
    /// use nalgebra::{Point3, Vector3};
    ///
    /// // Four points of a table top, 1 cm apart.
    /// let points = [[0.0, 0.0], [0.01, 0.0], [0.01, 0.01], [0.0, 0.01]].map(|[x, y]| Point3::new(x, y, 0.0));
    /// let edges = [[0, 1], [1, 2], [2, 3], [0, 3]];
    /// let camera = Point3::new(0.0, 0.0, 0.5);
    /// let surface = Surface::from_graph(&points, &[Vector3::z_axis(); 4], &edges, &[true; 4], 0.01, &camera)?;
    /// assert!((missing_vector_area(&surface.model()).z + 4e-4).abs() < 1e-12);
    /// # Ok::<(), grip_planner::Error>(())
    /// ```
    pub fn from_graph(
        points: &[Point3<f64>],
        normals: &[UnitVector3<f64>],
        edges: &[[u32; 2]],
        boundary: &[bool],
        spacing: f64,
        camera: &Point3<f64>,
    ) -> Result<Self, Error> {
        positive("spacing", spacing)?;
        check_points(&[*camera])?;
        let area = spacing * spacing;
        let faces = |(p, n): (&Point3<f64>, &UnitVector3<f64>)| n.dot(&(camera - p)) > 0.0;
        let surface = Self {
            points: points.to_vec(),
            triangles: Vec::new(),
            normals: normals.to_vec(),
            areas: vec![area; points.len()],
            edges: edges.to_vec(),
            boundary: boundary.to_vec(),
            visible: points.iter().zip(normals).map(faces).collect(),
            closed: !boundary.contains(&true),
            whole_area: area * points.len() as f64,
        };
        surface.model().check()?;
        Ok(surface)
    }

    /// The surface as input of the planner.
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

    /// The vertices of the model, metres.
    pub fn points(&self) -> &[Point3<f64>] {
        &self.points
    }

    /// Area of the known part, m².
    pub fn area(&self) -> f64 {
        self.areas.iter().sum()
    }

    /// The triangles of the known part of a mesh, as vertices of the model; empty for a graph.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Whether the whole mesh, seen or not, has no boundary.
    pub fn is_closed(&self) -> bool {
        self.closed
    }

    /// Area of the whole mesh, seen or not, m².
    pub fn whole_area(&self) -> f64 {
        self.whole_area
    }

    /// The vertices of the triangles of `mesh`.
    fn of_part(mesh: &Mesh, seen: &[bool], closed: bool, whole_area: f64) -> Result<Self, Error> {
        let (mut points, mut visible) = (Vec::new(), Vec::new());
        let mut place: Vec<Option<u32>> = vec![None; mesh.points.len()];
        let mut named = |v: u32| {
            *place[v as usize].get_or_insert_with(|| {
                points.push(mesh.points[v as usize]);
                visible.push(seen[v as usize]);
                points.len() as u32 - 1
            })
        };
        let triangles: Vec<[u32; 3]> = mesh.triangles.iter().map(|t| t.map(&mut named)).collect();
        if points.is_empty() {
            return Err(Error::NothingVisible);
        }
        let mut sums = vec![Vector3::zeros(); points.len()];
        let mut areas = vec![0.0; points.len()];
        for t in &triangles {
            let twice = cross(&points, t);
            for v in t.map(|v| v as usize) {
                sums[v] += twice;
                areas[v] += twice.norm() / 6.0;
            }
        }
        let mut boundary = vec![false; points.len()];
        for v in boundary_edges(&triangles).into_iter().flatten() {
            boundary[v as usize] = true;
        }
        let normal = |n: &Vector3<f64>| UnitVector3::try_new(*n, 0.0).unwrap_or(Vector3::z_axis());
        Ok(Self {
            normals: sums.iter().map(normal).collect(),
            edges: sides(&triangles).into_keys().collect(),
            points,
            triangles,
            areas,
            boundary,
            visible,
            closed,
            whole_area,
        })
    }
}

/// A mesh whose triangles may be reoriented and removed.
struct Mesh<'a> {
    points: &'a [Point3<f64>],
    triangles: Vec<[u32; 3]>,
}

/// Edges with the number of their triangles, in order; a triangle that repeats a vertex has fewer.
fn sides(triangles: &[[u32; 3]]) -> BTreeMap<[u32; 2], usize> {
    let mut count = BTreeMap::new();
    for t in triangles {
        for k in 0..3 {
            let (a, b) = (t[k], t[(k + 1) % 3]);
            if a != b {
                *count.entry([a.min(b), a.max(b)]).or_insert(0) += 1;
            }
        }
    }
    count
}

/// Edges of one triangle only.
fn boundary_edges(triangles: &[[u32; 3]]) -> Vec<[u32; 2]> {
    let once = |(edge, count): ([u32; 2], usize)| (count == 1).then_some(edge);
    sides(triangles).into_iter().filter_map(once).collect()
}

/// Twice the vector area.
fn cross(points: &[Point3<f64>], t: &[u32; 3]) -> Vector3<f64> {
    let [a, b, c] = t.map(|v| points[v as usize]);
    (b - a).cross(&(c - a))
}

/// Orients the triangles outward: the ones seen first face the camera.
fn face_outward(mesh: &mut Mesh, free: &[bool], camera: &Point3<f64>) {
    let seen = mesh
        .triangles
        .iter()
        .filter(|t| t.iter().all(|&v| free[v as usize]));
    let toward: f64 = seen
        .map(|t| cross(mesh.points, t).dot(&(camera - mesh.points[t[0] as usize])))
        .sum();
    if toward < 0.0 {
        mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    }
}

/// Vertices that are not occluded.
fn unhidden(mesh: &Mesh, camera: &Point3<f64>) -> Result<Vec<bool>, Error> {
    let points: Vec<Vector> = mesh.points.iter().map(|p| p.coords.into()).collect();
    let solid = TriMesh::with_flags(points, mesh.triangles.clone(), TriMeshFlags::empty())
        .map_err(|_| Error::EmptyModel)?;
    let origin: Vector = camera.coords.into();
    let free = |p: &Point3<f64>| {
        let ray = Ray::new(origin, (p - camera).into());
        // A hit just before the vertex is its own neighbourhood.
        solid.cast_local_ray(&ray, 1.0 - 1e-3, true).is_none()
    };
    Ok(mesh.points.iter().map(free).collect())
}

/// The ones of these with a triangle that faces the camera.
fn visible(mesh: &Mesh, free: &[bool], camera: &Point3<f64>) -> Vec<bool> {
    let mut seen = vec![false; mesh.points.len()];
    for t in &mesh.triangles {
        if cross(mesh.points, t).dot(&(camera - mesh.points[t[0] as usize])) > 0.0 {
            for v in t.map(|v| v as usize) {
                seen[v] = free[v];
            }
        }
    }
    seen
}
