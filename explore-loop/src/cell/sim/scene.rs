//! Scenes: the object on the table.

use std::path::Path;

use nalgebra::{Point3, Rotation3, Vector3};

use super::SimError;
use super::clutter::Attachment;
use super::glove::Glove;
use super::hollows::{Beanie, Colon, Torus};
use super::implicit::{Ellipsoid, Implicit, Liver};
use super::mesh::TriangleMesh;
use super::options::Material;
use super::shapes::{Cap, Peanut, RoundBox, Sheet, Star, Tube};
use super::surface_nets::triangulate;
use crate::mesh::Load;

/// Names of the built-in scenes.
pub const SCENES: [&str; 14] = [
    "liver",
    "glove",
    "beanie",
    "colon",
    "sheet",
    "torus",
    "attached",
    "clutter",
    "ellipsoid",
    "tube",
    "box",
    "peanut",
    "star",
    "cap",
];

/// A one-line description of a built-in scene; empty for an unknown name.
pub fn about(name: &str) -> &'static str {
    match name {
        "liver" => "a thick and a thin lobe with a notch between them, 20 cm",
        "glove" => "a filled glove with five fingers, two of which touch, 18 cm",
        "beanie" => "a thick cap standing on its brim, deep and hollow below, 16 cm",
        "colon" => "a bent tube with folds around it, 20 cm",
        "sheet" => "felt, 4 mm thick, 14 cm",
        "torus" => "a ring of genus 1, 15 cm",
        "attached" => "the liver, held to the table at one patch",
        "clutter" => "the liver, and a smaller body that stays where it is",
        "ellipsoid" => "smooth and compact, 12 cm",
        "tube" => "a bent tube, 20 cm",
        "box" => "a box with rounded edges, 16 cm",
        "peanut" => "two balls joined at a waist, 18 cm",
        "star" => "flat, with three lobes, 18 cm",
        "cap" => "a thin dome on its rim, 16 cm",
        _ => "",
    }
}

/// Approximate number of vertices of a built-in scene: the paper's liver has 2,194. Thin-walled scenes have more.
const VERTICES: f64 = 2000.0;

/// Largest edge of the cubes from which a surface is meshed, in wall thicknesses: no cube may contain both sides of a wall.
const CUBE: f64 = 0.5;

/// How often a mesh that touches itself is computed again, and how much finer each time.
const REGRIDS: usize = 6;
const FINER: f64 = 0.96;

/// Loose wool, as in a thick knitted cap: stiff enough for a dome of it to stand.
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

/// A rubber glove filled with a soft substance. Rubber of 0.15 mm and 2 MPa around a finger of 19 mm is as stiff along it as a filling of
/// `2 E t/r`, about 60 kPa.
const FILLED_RUBBER: Material = Material {
    young: 60_000.0,
    poisson: 0.35,
    density: 900.0,
    friction: 0.9,
    damping: 1.5,
};

/// A gut, wet and softer than the liver.
const GUT: Material = Material {
    young: 7_000.0,
    poisson: 0.35,
    density: 950.0,
    friction: 0.5,
    damping: 1.5,
};

/// Longest extents that [`Scene::sized`] accepts, metres.
const SIZES: std::ops::RangeInclusive<f64> = 0.1..=0.25;

/// A closed surface, whose z axis points up on the table, and its material.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    name: String,
    mesh: TriangleMesh,
    material: Material,
    /// The same surface with its touching parts separated, and the bend that maps it to rest.
    spread: Option<Spread>,
    cylinder: Option<[f64; 2]>,
    attachment: Option<Attachment>,
    beside: Option<Box<Scene>>,
}

/// The separated form of a surface that touches itself at rest.
#[derive(Debug, Clone, PartialEq)]
struct Spread {
    vertices: Vec<Point3<f64>>,
    glove: Glove,
    /// Size relative to that of the default glove.
    scale: f64,
}

impl Spread {
    fn at_rest(&self, p: &Point3<f64>) -> Point3<f64> {
        self.glove.at_rest(&(p / self.scale)) * self.scale
    }
}

impl Scene {
    /// A built-in scene ([`SCENES`]) at its usual size.
    ///
    /// # Errors
    /// [`SimError::NoSuchScene`] with the available names.
    pub fn named(name: &str) -> Result<Self, SimError> {
        let soft = Material::default();
        match name {
            "liver" => Self::implicit(name, &Liver, soft),
            "glove" => Self::glove(name),
            "beanie" => {
                Ok(Self::implicit(name, &Beanie::new(0.16), WOOL)?.with_cylinder([0.005, 0.008]))
            }
            "colon" => {
                Ok(Self::implicit(name, &Colon::new(0.2), GUT)?.with_cylinder([0.0035, 0.006]))
            }
            "sheet" => Self::implicit(name, &Sheet::new(0.14), FELT),
            "torus" => Self::implicit(name, &Torus::new(0.15), soft),
            "attached" => {
                let mut scene = Self::implicit(name, &Liver, soft)?;
                scene.attachment = Some(Attachment::default());
                Ok(scene)
            }
            "clutter" => {
                let mut scene = Self::implicit(name, &Liver, soft)?;
                scene.beside = Some(Box::new(Self::ellipsoid([0.035, 0.028, 0.022])?));
                Ok(scene)
            }
            "ellipsoid" => Self::ellipsoid([0.06, 0.045, 0.03]),
            "tube" => Self::implicit(name, &Tube::new(0.2), soft),
            "box" => Self::implicit(name, &RoundBox::new(0.16), soft),
            "peanut" => Self::implicit(name, &Peanut::new(0.18), soft),
            "star" => Self::implicit(name, &Star::new(0.18), soft),
            "cap" => Self::implicit(name, &Cap::new(0.16), WOOL),
            _ => Err(SimError::NoSuchScene {
                name: name.to_owned(),
                known: SCENES.join(", "),
            }),
        }
    }

    /// A built-in scene whose longest extent is `size` metres; star, cap, beanie and sheet keep their thickness.
    ///
    /// # Errors
    /// [`SimError::NoSuchScene`] with the available names; [`SimError::BadOption`] for a size outside 0.1 m to 0.25 m.
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
            "beanie" => Self::implicit(name, &Beanie::new(size), WOOL),
            "sheet" => Self::implicit(name, &Sheet::new(size), FELT),
            _ => {
                let mut scene = Self::named(name)?;
                let (low, high) = scene.mesh.bounds();
                let scale = size / (high - low).max();
                scene.mesh.vertices.iter_mut().for_each(|p| *p *= scale);
                if let Some(spread) = &mut scene.spread {
                    spread.vertices.iter_mut().for_each(|p| *p *= scale);
                    spread.scale = scale;
                }
                Ok(scene)
            }
        }
    }

    /// A filled glove of about 0.13 × 0.18 × 0.026 m: five fingers, the first two of which touch beyond their middle.
    fn glove(name: &str) -> Result<Self, SimError> {
        let glove = Glove::new();
        let mut scene = Self::implicit(name, &glove, FILLED_RUBBER)?;
        let vertices = scene.mesh.vertices.clone();
        for p in &mut scene.mesh.vertices {
            *p = glove.at_rest(p);
        }
        scene.spread = Some(Spread {
            vertices,
            glove,
            scale: 1.0,
        });
        Ok(scene.with_cylinder([0.005, 0.008]))
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
    /// [`SimError::NotInMetres`] for implausible half axes.
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
            spread: None,
            cylinder: None,
            attachment: None,
            beside: None,
        })
    }

    /// Sets radius and height of the cylinders of its complex, metres.
    #[must_use]
    fn with_cylinder(mut self, cylinder: [f64; 2]) -> Self {
        self.cylinder = Some(cylinder);
        self
    }

    /// The solid bounded by the mesh in a file, named after the file; `load` gives its unit and its upward axis.
    ///
    /// # Errors
    /// The file cannot be read, or [`Scene::from_mesh`] rejects the mesh.
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

    /// The material of the scene, unless [`SimOptions`](super::SimOptions) say otherwise.
    pub fn material(&self) -> &Material {
        &self.material
    }

    /// Radius and height of the cylinders that the paper uses for this object, metres, if it has it.
    pub fn cylinder(&self) -> Option<[f64; 2]> {
        self.cylinder
    }

    /// Its attachment to the table, if there is one.
    pub fn attachment(&self) -> Option<Attachment> {
        self.attachment
    }

    /// The body that lies beside it, if there is one.
    pub fn beside(&self) -> Option<&Scene> {
        self.beside.as_deref()
    }

    fn implicit(name: &str, solid: &dyn Implicit, material: Material) -> Result<Self, SimError> {
        // A first coarse mesh gives the area; a vertex then covers about one face of a cube.
        let (low, high) = solid.bounds();
        let finest = CUBE * solid.thickness();
        let coarse = triangulate(solid, finest.min((high - low).norm() / 60.0));
        let mut cell = finest.min((coarse.area() / VERTICES).sqrt() * 1.13);
        // Where the surface just grazes a plane of the grid, the mesh may touch itself; a slightly finer one does not.
        for _ in 0..REGRIDS {
            match Self::from_mesh(name, triangulate(solid, cell)) {
                Err(SimError::NotClosed { .. }) => cell *= FINER,
                scene => return Ok(scene?.made_of(material)),
            }
        }
        Ok(Self::from_mesh(name, triangulate(solid, cell))?.made_of(material))
    }

    fn made_of(self, material: Material) -> Self {
        Self { material, ..self }
    }

    /// The surface rotated about the vertical by `yaw`, its bounding box centred on `(x, y)`, its lowest vertex at
    /// height `z`.
    pub(super) fn placed(&self, yaw: f64, at: Point3<f64>) -> Placed<'_> {
        let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), yaw);
        let mut surface = self.mesh.clone();
        surface.vertices.iter_mut().for_each(|p| *p = turn * *p);
        let (low, high) = surface.bounds();
        let shift = at - Point3::new(0.5 * (low.x + high.x), 0.5 * (low.y + high.y), low.z);
        surface.vertices.iter_mut().for_each(|p| *p += shift);
        Placed {
            surface,
            spread: self.spread.as_ref(),
            turn,
            shift,
        }
    }
}

/// A placed scene.
pub(super) struct Placed<'a> {
    /// Its surface at rest, world frame.
    pub surface: TriangleMesh,
    spread: Option<&'a Spread>,
    turn: Rotation3<f64>,
    shift: Vector3<f64>,
}

impl Placed<'_> {
    /// The surface that is filled with tetrahedra: its parts do not touch.
    pub fn apart(&self) -> TriangleMesh {
        let Some(spread) = self.spread else {
            return self.surface.clone();
        };
        let place = |p: &Point3<f64>| self.turn * p + self.shift;
        TriangleMesh {
            vertices: spread.vertices.iter().map(place).collect(),
            triangles: self.surface.triangles.clone(),
        }
    }

    /// Position at rest of a point of the filled solid.
    pub fn at_rest(&self, p: &Point3<f64>) -> Point3<f64> {
        let Some(spread) = self.spread else { return *p };
        let own = self.turn.inverse() * (p - self.shift);
        self.turn * spread.at_rest(&own) + self.shift
    }

    /// The vertices of the surface in the scene's own frame.
    pub fn own(&self) -> Vec<Point3<f64>> {
        let back = self.turn.inverse();
        let vertices = self.surface.vertices.iter();
        vertices.map(|p| back * (p - self.shift)).collect()
    }

    /// World position of a point of the scene's own frame.
    pub fn of(&self, p: &Point3<f64>) -> Point3<f64> {
        self.turn * p + self.shift
    }
}
