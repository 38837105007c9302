//! What lies on the table.

use std::path::Path;

use nalgebra::{Point3, Rotation3, Vector3};

use super::SimError;
use super::implicit::{Ellipsoid, Implicit, Liver};
use super::mesh::TriangleMesh;
use super::options::Material;
use super::shapes::{Cap, Peanut, RoundBox, Sheet, Star, Tube};
use super::surface_nets::triangulate;
use crate::mesh::Load;

/// Names of the built-in scenes.
pub const SCENES: [&str; 8] = [
    "liver",
    "ellipsoid",
    "tube",
    "box",
    "peanut",
    "star",
    "cap",
    "sheet",
];

/// Vertices a built-in scene has, about: the paper's liver has 2,194. Thin-walled scenes have more.
const VERTICES: f64 = 2000.0;

/// Largest edge of the cubes that a surface is marched with, in wall thicknesses: no cube may see both sides of a wall.
const CUBE: f64 = 0.5;

/// Loose wool, such as a thick cap is knitted from: a dome of it stands.
const WOOL: Material = Material {
    young: 100_000.0,
    poisson: 0.3,
    density: 300.0,
    friction: 0.7,
    damping: 1.0,
};

/// Felt: a sheet of it hangs down over an edge, but does not fold flat.
const FELT: Material = Material {
    young: 500_000.0,
    poisson: 0.3,
    density: 300.0,
    friction: 0.7,
    damping: 1.0,
};

/// Longest extents that [`Scene::sized`] takes, metres.
const SIZES: std::ops::RangeInclusive<f64> = 0.1..=0.25;

/// A closed surface, standing on the table as its own z axis points up, and what it is made of.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    name: String,
    mesh: TriangleMesh,
    material: Material,
}

impl Scene {
    /// A built-in scene ([`SCENES`]) at its usual size.
    ///
    /// # Errors
    /// [`SimError::NoSuchScene`] with the names there are.
    pub fn named(name: &str) -> Result<Self, SimError> {
        let soft = Material::default();
        match name {
            "liver" => Self::implicit(name, &Liver, soft),
            "ellipsoid" => Self::ellipsoid([0.06, 0.045, 0.03]),
            "tube" => Self::implicit(name, &Tube::new(0.2), soft),
            "box" => Self::implicit(name, &RoundBox::new(0.16), soft),
            "peanut" => Self::implicit(name, &Peanut::new(0.18), soft),
            "star" => Self::implicit(name, &Star::new(0.18), soft),
            "cap" => Self::implicit(name, &Cap::new(0.16), WOOL),
            "sheet" => Self::implicit(name, &Sheet::new(0.14), FELT),
            _ => Err(SimError::NoSuchScene {
                name: name.to_owned(),
                known: SCENES.join(", "),
            }),
        }
    }

    /// A built-in scene whose longest extent is `size` metres; star, cap and sheet keep their thickness.
    ///
    /// # Errors
    /// [`SimError::NoSuchScene`] with the names there are; [`SimError::BadOption`] for a size outside 0.1 m to 0.25 m.
    pub fn sized(name: &str, size: f64) -> Result<Self, SimError> {
        if !SIZES.contains(&size) {
            return Err(SimError::BadOption {
                option: "size of the scene",
                value: size,
                range: "0.1 m to 0.25 m",
            });
        }
        match name {
            "star" => Self::implicit(name, &Star::new(size), Material::default()),
            "cap" => Self::implicit(name, &Cap::new(size), WOOL),
            "sheet" => Self::implicit(name, &Sheet::new(size), FELT),
            _ => {
                let mut scene = Self::named(name)?;
                let (low, high) = scene.mesh.bounds();
                let scale = size / (high - low).max();
                scene.mesh.vertices.iter_mut().for_each(|p| *p *= scale);
                Ok(scene)
            }
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
        let soft = Material::default();
        Self::implicit("ellipsoid", &Ellipsoid { half_axes }, soft)
    }

    /// The solid bounded by `mesh`.
    ///
    /// # Errors
    /// The mesh is empty, too large, open, not oriented, in pieces, or not in metres.
    pub fn from_mesh(name: &str, mesh: TriangleMesh) -> Result<Self, SimError> {
        Ok(Self {
            name: name.to_owned(),
            mesh: mesh.into_solid()?,
            material: Material::default(),
        })
    }

    /// The solid bounded by the mesh in a file, named after it; `load` says in which unit it is, and what is up.
    ///
    /// # Errors
    /// The file cannot be read, or what [`Scene::from_mesh`] refuses.
    pub fn from_file(path: &Path, load: &Load) -> Result<Self, SimError> {
        let name = path.file_stem().map_or_else(
            || "mesh".to_owned(),
            |stem| stem.to_string_lossy().into_owned(),
        );
        Self::from_mesh(&name, load.read(path)?.into())
    }

    /// The scene's name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The scene's surface.
    pub fn mesh(&self) -> &TriangleMesh {
        &self.mesh
    }

    /// What the scene is made of, unless [`SimOptions`](super::SimOptions) say otherwise.
    pub fn material(&self) -> &Material {
        &self.material
    }

    fn implicit(name: &str, solid: &dyn Implicit, material: Material) -> Result<Self, SimError> {
        // A first coarse mesh measures the area; a vertex then covers about one face of a cube.
        let (low, high) = solid.bounds();
        let finest = CUBE * solid.thickness();
        let coarse = triangulate(solid, finest.min((high - low).norm() / 60.0));
        let cell = finest.min((coarse.area() / VERTICES).sqrt() * 1.13);
        let mut scene = Self::from_mesh(name, triangulate(solid, cell))?;
        scene.material = material;
        Ok(scene)
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
