//! The object that a run explores: a built-in scene, or a mesh from a file.

use crate::Failure;
use explore_loop::cell::sim::{self, Scene};
use explore_loop::mesh::{Load, Units, Up};
use mesh_io::program::of_file;
use std::path::PathBuf;

/// The help text of `--scene`.
fn scenes() -> String {
    let line = |name: &&str| format!("\n  {name:<10} {}", sim::about(name));
    let lines: String = sim::SCENES.iter().map(line).collect();
    format!("Built-in object:{lines}\n")
}

/// Where the object comes from.
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct ObjectArgs {
    #[arg(long, default_value = "liver", conflicts_with = "mesh", help = scenes())]
    pub scene: String,
    /// A closed mesh instead of a scene (PLY, OBJ, STL or OFF)
    #[arg(long, value_name = "FILE")]
    pub mesh: Option<PathBuf>,
    /// Unit of the mesh: m, cm or mm
    #[arg(long, value_name = "UNIT", default_value = "m", requires = "mesh")]
    pub units: Units,
    /// Longest extent of the object, m, instead of the unit of the mesh
    #[arg(long, value_name = "METRES", value_parser = crate::positive, requires = "mesh")]
    pub size: Option<f64>,
    /// Axis of the mesh that points up: x, y or z
    #[arg(long, value_name = "AXIS", default_value = "z", requires = "mesh")]
    pub up: Up,
    /// Which body of the mesh to take if there are several: 1 is the largest
    #[arg(long, value_name = "N", requires = "mesh")]
    pub body: Option<usize>,
}

impl Default for ObjectArgs {
    fn default() -> Self {
        Self {
            scene: "liver".into(),
            mesh: None,
            units: Units::default(),
            size: None,
            up: Up::default(),
            body: None,
        }
    }
}

impl ObjectArgs {
    /// Whether an object other than the default was asked for.
    pub fn is_given(&self) -> bool {
        self.mesh.is_some() || self.scene != Self::default().scene
    }

    /// The object.
    pub fn read(&self) -> Result<Scene, Failure> {
        let Some(path) = &self.mesh else {
            return Ok(Scene::named(&self.scene)?);
        };
        let load = Load::default()
            .with_units(self.units)
            .with_size(self.size)
            .with_up(self.up)
            .with_body(self.body);
        Scene::from_file(path, &load).map_err(|error| of_file(path, &error).into())
    }

    /// A text that identifies the object when a run is resumed.
    pub fn identity(&self) -> Result<String, Failure> {
        let Some(path) = &self.mesh else {
            return Ok(format!("--scene {}", self.scene));
        };
        let bytes = std::fs::read(path)?;
        let mut text = format!(
            "--mesh of {} bytes ({:08x})",
            bytes.len(),
            crc32fast::hash(&bytes)
        );
        for (option, given) in [
            (
                "units",
                (self.units != Units::default()).then(|| format!("{:?}", self.units)),
            ),
            ("size", self.size.map(|s| s.to_string())),
            (
                "up",
                (self.up != Up::default()).then(|| format!("{:?}", self.up)),
            ),
            ("body", self.body.map(|b| b.to_string())),
        ] {
            if let Some(given) = given {
                text.extend([" --", option, " ", &given]);
            }
        }
        Ok(text)
    }
}
