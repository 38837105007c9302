//! From a file to a mesh in metres with z up, as a program needs it.

use std::path::Path;

use crate::{Error, Format, Mesh, Units, Up};

/// How to interpret the numbers of a file.
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
    /// Which body of several, from 1, the largest first; `None` for all.
    pub body: Option<usize>,
    /// Accepted diagonals of the bounding box, m.
    pub extent: Option<[f64; 2]>,
    /// Treatment of repeated and unused vertices.
    pub vertices: Vertices,
}

/// Treatment of repeated vertices and of those that no triangle uses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Vertices {
    /// Merged, see [`Mesh::welded`].
    #[default]
    Welded,
    /// Kept as in the file, because other data refer to their indices.
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

    /// Sets the accepted diagonals.
    #[must_use]
    pub fn with_extent(mut self, range: [f64; 2]) -> Self {
        self.extent = Some(range);
        self
    }

    /// Sets the treatment of repeated vertices.
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
            // Points at a single place tell nothing about the unit.
            Some(range) if diagonal > 0.0 && !(range[0]..=range[1]).contains(&diagonal) => {
                Err(Error::Extent { diagonal, range })
            }
            _ => Ok(mesh),
        }
    }
}

/// Reads a file without changes; the extension tells the format.
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
