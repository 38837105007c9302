//! From a file to a mesh in metres, z up: what a program does with the file that it is given.

use std::path::Path;

use crate::{Error, Format, Mesh, Units, Up};

/// What to make of the numbers in a file.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Load {
    /// Unit of the coordinates.
    pub units: Units,
    /// Longest extent along an axis, m, instead of a unit.
    pub size: Option<f64>,
    /// The axis that points up.
    pub up: Up,
    /// Which body of several, from 1, the largest first; all of them if not given.
    pub body: Option<usize>,
    /// Diagonals of the bounding box that can be metres.
    pub extent: Option<[f64; 2]>,
    /// Whether vertices keep the numbers that they have in the file, repeated and unused ones too.
    pub vertices: Vertices,
}

/// What becomes of vertices that are repeated or not used by any triangle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Vertices {
    /// One for each place, see [`Mesh::welded`].
    #[default]
    Welded,
    /// As they stand in the file: something else refers to their numbers.
    AsInFile,
}

impl Load {
    /// Sets the unit.
    #[must_use]
    pub fn with_units(mut self, units: Units) -> Self {
        self.units = units;
        self
    }

    /// Sets the longest extent, m.
    #[must_use]
    pub fn with_size(mut self, size: Option<f64>) -> Self {
        self.size = size;
        self
    }

    /// Sets the axis that points up.
    #[must_use]
    pub fn with_up(mut self, up: Up) -> Self {
        self.up = up;
        self
    }

    /// Chooses a body.
    #[must_use]
    pub fn with_body(mut self, body: Option<usize>) -> Self {
        self.body = body;
        self
    }

    /// Sets the diagonals that can be metres.
    #[must_use]
    pub fn with_extent(mut self, range: [f64; 2]) -> Self {
        self.extent = Some(range);
        self
    }

    /// Sets what becomes of repeated vertices.
    #[must_use]
    pub fn with_vertices(mut self, vertices: Vertices) -> Self {
        self.vertices = vertices;
        self
    }

    /// Reads a file.
    ///
    /// # Errors
    /// [`Error::InFile`] with what is wrong and where.
    pub fn read(&self, path: &Path) -> Result<Mesh, Error> {
        let mesh = crate::read(path)?;
        self.apply(mesh).map_err(|error| error.in_file(path))
    }

    /// The mesh in metres, z up.
    ///
    /// # Errors
    /// [`Error::NoSuchBody`] and [`Error::Extent`].
    pub fn apply(&self, mesh: Mesh) -> Result<Mesh, Error> {
        let mut mesh = match self.vertices {
            Vertices::Welded => mesh.welded(),
            Vertices::AsInFile => mesh,
        };
        if let Some(body) = self.body {
            mesh = mesh.body(body)?;
        }
        mesh = match self.size {
            Some(size) => mesh.sized(size),
            None => mesh.scaled(self.units.metres()),
        };
        mesh = mesh.turned_up(self.up);
        let diagonal = mesh.diagonal();
        match self.extent {
            // Points at one place say nothing of units.
            Some(range) if diagonal > 0.0 && !(range[0]..=range[1]).contains(&diagonal) => {
                Err(Error::Extent { diagonal, range })
            }
            _ => Ok(mesh),
        }
    }
}

/// Reads a file as it stands; the ending of its name tells the format.
///
/// # Errors
/// [`Error::InFile`] with what is wrong and where.
pub fn read(path: &Path) -> Result<Mesh, Error> {
    let mesh = Format::of(path).and_then(|format| {
        let bytes = std::fs::read(path).map_err(|error| Error::System {
            reason: error.to_string(),
        })?;
        parse(&bytes, format)
    });
    mesh.map_err(|error| error.in_file(path))
}

/// Reads a mesh from memory.
///
/// # Errors
/// What is wrong and where.
pub fn parse(bytes: &[u8], format: Format) -> Result<Mesh, Error> {
    let raw = match format {
        Format::Ply => crate::ply::read(bytes),
        Format::Obj => crate::obj::read(bytes),
        Format::Stl => crate::stl::read(bytes),
        Format::Off => crate::off::read(bytes),
        Format::Pcd => crate::pcd::read(bytes),
        Format::Xyz => crate::xyz::read(bytes),
        Format::Npy => crate::npy::read(bytes),
        Format::Glb => Err(Error::UnknownEnding {
            ending: "glb".into(),
            writing: false,
        }),
    };
    raw?.finish()
}
