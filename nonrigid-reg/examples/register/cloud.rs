//! Clouds and pairs of points from files.

use std::path::Path;

use mesh_io::program::Failure;
use mesh_io::{Load, Mesh, read_table};
use nalgebra::{Point3, UnitVector3};
use nonrigid_reg::{Cloud, estimate_normals};

/// Number of neighbours from which a normal is estimated.
const NEIGHBOURS: usize = 16;

/// A cloud to register: points and normals.
pub struct Oriented {
    pub mesh: Mesh,
    pub normals: Vec<UnitVector3<f64>>,
}

impl Oriented {
    /// Reads a file. Missing normals are taken from the triangles, or estimated for a cloud and turned to the origin (the camera).
    pub fn read(path: &Path, load: &Load) -> Result<Self, Failure> {
        let mesh = load.read(path)?;
        let normals = if mesh.normals().is_empty() && mesh.triangles().is_empty() {
            estimate_normals(mesh.points(), NEIGHBOURS, &Point3::origin())
                .map_err(|error| format!("{}: {error}", path.display()))?
        } else {
            mesh.unit_normals_or_estimated()
                .map_err(|error| error.in_file(path))?
        };
        Ok(Self { mesh, normals })
    }

    pub fn cloud(&self) -> Cloud<'_> {
        Cloud {
            points: self.mesh.points(),
            normals: &self.normals,
        }
    }
}

/// Position before and after the motion.
pub type PointPair = (Point3<f64>, Point3<f64>);

/// Rows `sx,sy,sz,tx,ty,tz` in a unit of `metres`, with or without a heading.
pub fn read_pairs(path: &Path, metres: f64) -> Result<Vec<PointPair>, Failure> {
    let bytes = std::fs::read(path).map_err(|error| format!("{}: {error}", path.display()))?;
    let table = read_table(&bytes, ["sx", "sy", "sz", "tx", "ty", "tz"]);
    let rows = table.map_err(|error| error.in_file(path))?.rows;
    let pair = |[a, b, c, d, e, f]: [f64; 6]| {
        (Point3::new(a, b, c) * metres, Point3::new(d, e, f) * metres)
    };
    Ok(rows.into_iter().map(pair).collect())
}
