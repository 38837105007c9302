//! Meshes and tables read by serde are checked as those from files are.

use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Deserializer, Serialize};

use crate::{Error, Mesh, Property, Table};

#[derive(Deserialize)]
#[serde(rename = "Property")]
struct WrittenProperty {
    name: String,
    values: Vec<f64>,
}

impl<'de> Deserialize<'de> for Property {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let written = WrittenProperty::deserialize(deserializer)?;
        Ok(Self::new(&written.name, written.values))
    }
}

#[derive(Deserialize)]
#[serde(rename = "Mesh")]
struct WrittenMesh {
    points: Vec<Point3<f64>>,
    normals: Vec<Vector3<f64>>,
    colours: Vec<[u8; 3]>,
    properties: Vec<Property>,
    triangles: Vec<[u32; 3]>,
    left_out: usize,
}

impl TryFrom<WrittenMesh> for Mesh {
    type Error = Error;

    fn try_from(written: WrittenMesh) -> Result<Self, Error> {
        let mut mesh = Self::new(written.points)?.with_triangles(written.triangles)?;
        if !written.normals.is_empty() {
            mesh = mesh.with_normals(written.normals)?;
        }
        if !written.colours.is_empty() {
            mesh = mesh.with_colours(written.colours)?;
        }
        for property in written.properties {
            mesh = mesh.with_property(property)?;
        }
        mesh.left_out = written.left_out;
        Ok(mesh)
    }
}

impl<'de> Deserialize<'de> for Mesh {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let written = WrittenMesh::deserialize(deserializer)?;
        written.try_into().map_err(serde::de::Error::custom)
    }
}

/// A table whose rows may have any length: serde knows arrays of lengths that are known beforehand.
#[derive(Serialize, Deserialize)]
pub(crate) struct Written {
    rows: Vec<Vec<f64>>,
    lines: Vec<usize>,
    headed: bool,
}

impl<const N: usize> From<Table<N>> for Written {
    fn from(table: Table<N>) -> Self {
        Self {
            rows: table.rows.iter().map(|row| row.to_vec()).collect(),
            lines: table.lines,
            headed: table.headed,
        }
    }
}

impl<const N: usize> TryFrom<Written> for Table<N> {
    type Error = String;

    fn try_from(written: Written) -> Result<Self, String> {
        let row = |(index, row): (usize, Vec<f64>)| {
            let found = row.len();
            row.try_into()
                .map_err(|_| format!("row {index} has {found} numbers, but {N} are needed"))
        };
        Ok(Self {
            rows: written
                .rows
                .into_iter()
                .enumerate()
                .map(row)
                .collect::<Result<_, _>>()?,
            lines: written.lines,
            headed: written.headed,
        })
    }
}
