//! Writing of meshes.

use std::io::{self, Write};
use std::path::Path;

use crate::{Error, Format, Mesh, glb, npy, obj, off, pcd, ply, stl, xyz};

/// Text or binary.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Encoding {
    /// Text lines.
    Text,
    /// Binary, little-endian.
    #[default]
    Binary,
}

/// Precision of the numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Precision {
    /// 32 bits: a micrometre in ten metres.
    Single,
    /// 64 bits: lossless.
    #[default]
    Double,
}

impl Precision {
    /// The shortest text that reads back as the same number.
    pub(crate) fn text(self, value: f64) -> String {
        match self {
            Self::Single => (value as f32).to_string(),
            Self::Double => value.to_string(),
        }
    }
}

/// How a mesh is written. Binary STL and GLB always hold 32 bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Options<'a> {
    /// Default binary; OBJ, OFF and XYZ are always text, GLB and NPY binary.
    pub encoding: Encoding,
    /// Default double.
    pub precision: Precision,
    /// A comment for the header, if the format allows one.
    pub comment: Option<&'a str>,
}

impl<'a> Options<'a> {
    /// Sets the encoding.
    #[must_use]
    pub fn with_encoding(mut self, encoding: Encoding) -> Self {
        self.encoding = encoding;
        self
    }

    /// Sets the precision.
    #[must_use]
    pub fn with_precision(mut self, precision: Precision) -> Self {
        self.precision = precision;
        self
    }

    /// Sets the comment.
    #[must_use]
    pub fn with_comment(mut self, comment: &'a str) -> Self {
        self.comment = Some(comment);
        self
    }
}

impl Mesh {
    /// Writes the mesh in a format. What the format cannot hold is left out: STL holds triangles only, OFF and OBJ no further numbers, and NPY neither further numbers
    /// nor colours and triangles.
    ///
    /// # Errors
    /// [`Error::Unwritable`] if nothing of the mesh would be left (a cloud as STL), [`Error::System`] from the writer.
    pub fn write(&self, out: impl Write, format: Format, options: Options) -> Result<(), Error> {
        let mut out = io::BufWriter::new(out);
        if format == Format::Stl && self.triangles.is_empty() && !self.points.is_empty() {
            return Err(Error::Unwritable {
                format,
                reason: "it has triangles only, and this is a cloud of points",
            });
        }
        let out = &mut out as &mut dyn Write;
        match format {
            Format::Ply => ply::write(out, self, options),
            Format::Obj => obj::write(out, self, options),
            Format::Stl => stl::write(out, self, options),
            Format::Off => off::write(out, self, options),
            Format::Pcd => pcd::write(out, self, options),
            Format::Xyz => xyz::write(out, self, options),
            Format::Npy => npy::write(out, self, options),
            Format::Glb => glb::write(out, self),
        }
        .and_then(|()| out.flush())
        .map_err(|error| Error::System {
            reason: error.to_string(),
        })
    }

    /// The mesh as the bytes of a file.
    ///
    /// # Errors
    /// [`Error::Unwritable`] if nothing of the mesh would be left.
    pub fn to_bytes(&self, format: Format, options: Options) -> Result<Vec<u8>, Error> {
        let mut bytes = Vec::new();
        self.write(&mut bytes, format, options)?;
        Ok(bytes)
    }

    /// Writes a file; the extension tells the format.
    ///
    /// # Errors
    /// [`Error::InFile`] with the reason.
    pub fn save(&self, path: &Path, options: Options) -> Result<(), Error> {
        let format = Format::by_ending(path, true).map_err(|e| e.in_file(path))?;
        let written = self.to_bytes(format, options).and_then(|bytes| {
            std::fs::write(path, bytes).map_err(|error| Error::System {
                reason: error.to_string(),
            })
        });
        written.map_err(|error| error.in_file(path))
    }
}
