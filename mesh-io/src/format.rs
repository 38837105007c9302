//! File formats, by file extension.

use std::fmt;
use std::path::Path;
use std::str::FromStr;

use crate::Error;

/// A file format.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Format {
    /// PLY, the Stanford polygon format: text, or binary of either byte order.
    Ply,
    /// Wavefront OBJ.
    Obj,
    /// STL, text or binary.
    Stl,
    /// OFF, the object file format of Geomview, as text.
    Off,
    /// PCD, the format of the Point Cloud Library: text, binary or compressed.
    Pcd,
    /// Text with a point a line: `.xyz`, `.xyzn`, `.xyzrgb`, `.pts`, `.asc`, `.txt`, `.csv`.
    Xyz,
    /// An array of NumPy with three or six columns.
    Npy,
    /// glTF 2.0 in one binary file (written only).
    Glb,
}

/// Extensions, in lower case. The first of a format is its default.
const ENDINGS: [(&str, Format); 14] = [
    ("ply", Format::Ply),
    ("obj", Format::Obj),
    ("stl", Format::Stl),
    ("off", Format::Off),
    ("pcd", Format::Pcd),
    ("xyz", Format::Xyz),
    ("xyzn", Format::Xyz),
    ("xyzrgb", Format::Xyz),
    ("pts", Format::Xyz),
    ("asc", Format::Xyz),
    ("txt", Format::Xyz),
    ("csv", Format::Xyz),
    ("npy", Format::Npy),
    ("glb", Format::Glb),
];

impl Format {
    /// The format of a file extension, of those that can be read.
    ///
    /// # Errors
    /// [`Error::UnknownEnding`] lists the known extensions.
    pub fn of(path: &Path) -> Result<Self, Error> {
        Self::by_ending(path, false)
    }

    /// The default extension, without the dot.
    pub fn ending(self) -> &'static str {
        let usual = ENDINGS.iter().find(|(_, format)| *format == self);
        usual.map_or("", |(ending, _)| ending)
    }

    pub(crate) fn by_ending(path: &Path, writing: bool) -> Result<Self, Error> {
        let ending = path.extension().unwrap_or_default().to_string_lossy();
        Self::named(&ending, writing)
    }

    fn named(ending: &str, writing: bool) -> Result<Self, Error> {
        let ending = ending.to_ascii_lowercase();
        ENDINGS
            .iter()
            .find(|(known, format)| *known == ending && (writing || *format != Self::Glb))
            .map(|(_, format)| *format)
            .ok_or(Error::UnknownEnding { ending, writing })
    }

    /// The extensions, for a message.
    pub(crate) fn endings(writing: bool) -> String {
        let known: Vec<&str> = ENDINGS
            .iter()
            .filter(|(_, format)| writing || *format != Self::Glb)
            .map(|(ending, _)| *ending)
            .collect();
        known.join(", ")
    }
}

/// The format that is written for an extension.
impl FromStr for Format {
    type Err = Error;

    fn from_str(ending: &str) -> Result<Self, Error> {
        Self::named(ending, true)
    }
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Ply => "PLY",
            Self::Obj => "OBJ",
            Self::Stl => "STL",
            Self::Off => "OFF",
            Self::Pcd => "PCD",
            Self::Xyz => "XYZ",
            Self::Npy => "NPY",
            Self::Glb => "GLB",
        })
    }
}
