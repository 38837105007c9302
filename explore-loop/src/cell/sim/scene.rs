//! What lies on the table.

use std::path::Path;

use nalgebra::{Point3, Rotation3, Vector3};

use super::SimError;
use super::implicit::{Ellipsoid, Implicit, Liver};
use super::mesh::TriangleMesh;
use super::surface_nets::triangulate;
use crate::cell::mesh_io;

/// Names of the built-in scenes.
pub const SCENES: [&str; 2] = ["liver", "ellipsoid"];

/// Vertices a built-in scene has, about: the paper's liver has 2,194.
const VERTICES: f64 = 2000.0;

/// A closed surface, standing on the table as its own z axis points up.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    name: String,
    mesh: TriangleMesh,
}

impl Scene {
    /// A built-in scene.
    ///
    /// # Errors
    /// [`SimError::NoSuchScene`] with the names there are.
    pub fn named(name: &str) -> Result<Self, SimError> {
        match name {
            "liver" => Self::implicit(name, &Liver),
            "ellipsoid" => Self::ellipsoid([0.06, 0.045, 0.03]),
            _ => Err(SimError::NoSuchScene {
                name: name.to_owned(),
                known: SCENES.join(", "),
            }),
        }
    }

    /// A liver-like blob of about 0.20 × 0.13 × 0.055 m: thick right lobe, thin left lobe, notch between them.
    ///
    /// # Errors
    /// None in practice; the generated mesh goes through the same checks as one from a file.
    pub fn liver() -> Result<Self, SimError> {
        Self::named("liver")
    }

    /// An ellipsoid with the given half axes in metres.
    ///
    /// # Errors
    /// [`SimError::NotInMetres`] for half axes no object has.
    pub fn ellipsoid(half_axes: [f64; 3]) -> Result<Self, SimError> {
        for value in half_axes {
            if !(0.005..=0.5).contains(&value) {
                return Err(SimError::BadOption {
                    option: "half axis",
                    value,
                    range: "0.005 m to 0.5 m",
                });
            }
        }
        Self::implicit("ellipsoid", &Ellipsoid { half_axes })
    }

    /// The solid bounded by `mesh`.
    ///
    /// # Errors
    /// The mesh is empty, too large, open, not oriented, in pieces, or not in metres.
    pub fn from_mesh(name: &str, mesh: TriangleMesh) -> Result<Self, SimError> {
        Ok(Self {
            name: name.to_owned(),
            mesh: mesh.into_solid()?,
        })
    }

    /// The solid bounded by the mesh in a file (OBJ, PLY, STL), named after it.
    ///
    /// # Errors
    /// The file cannot be read, or what [`Scene::from_mesh`] refuses.
    pub fn from_file(path: &Path) -> Result<Self, SimError> {
        let name = path.file_stem().map_or_else(
            || "mesh".to_owned(),
            |stem| stem.to_string_lossy().into_owned(),
        );
        Self::from_mesh(&name, mesh_io::read(path)?)
    }

    /// The scene's name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The scene's surface.
    pub fn mesh(&self) -> &TriangleMesh {
        &self.mesh
    }

    fn implicit(name: &str, solid: &dyn Implicit) -> Result<Self, SimError> {
        // A first coarse mesh measures the area; a vertex then covers about one face of a cube.
        let (low, high) = solid.bounds();
        let coarse = triangulate(solid, (high - low).norm() / 60.0);
        let cell = (coarse.area() / VERTICES).sqrt() * 1.13;
        Self::from_mesh(name, triangulate(solid, cell))
    }

    /// The surface turned about the vertical by `yaw`, its bounding box centred on `(x, y)`, its lowest vertex at
    /// height `z`.
    pub(super) fn placed(&self, yaw: f64, at: Point3<f64>) -> TriangleMesh {
        let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), yaw);
        let mut mesh = self.mesh.clone();
        mesh.vertices.iter_mut().for_each(|p| *p = turn * *p);
        let (low, high) = mesh.bounds();
        let shift = at - Point3::new(0.5 * (low.x + high.x), 0.5 * (low.y + high.y), low.z);
        mesh.vertices.iter_mut().for_each(|p| *p += shift);
        mesh
    }
}
