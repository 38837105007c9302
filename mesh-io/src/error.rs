//! Errors in files of points and meshes.

use std::fmt;
use std::path::PathBuf;

use crate::Format;

/// A place in a file, counted as in an editor or a hex viewer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Place {
    /// A line of text, from 1.
    Line(usize),
    /// A byte, from 0.
    Byte(usize),
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Line(line) => write!(f, "line {line}"),
            Self::Byte(byte) => write!(f, "byte {byte}"),
        }
    }
}

/// Why a file could not be read or written, or an option is invalid.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// An error in this file.
    #[error("{}: {error}", path.display())]
    InFile {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        error: Box<Error>,
    },
    /// The operating system reported an error.
    #[error("{reason}")]
    System {
        /// The message of the system.
        reason: String,
    },
    /// The file extension belongs to no known format.
    #[error("the ending {ending:?} is none of {}", Format::endings(*writing))]
    UnknownEnding {
        /// The extension, without the dot.
        ending: String,
        /// Whether a file was to be written.
        writing: bool,
    },
    /// The file does not follow its format.
    #[error("{place}: {reason}")]
    Syntax {
        /// The format it was read as.
        format: Format,
        /// Where.
        place: Place,
        /// What is wrong there, and what was expected.
        reason: String,
    },
    /// A coordinate is NaN or infinite.
    #[error("{place}: vertex {vertex}: {coordinate} is {value}")]
    NotFinite {
        /// Where.
        place: Place,
        /// Index of the vertex, from 0.
        vertex: usize,
        /// `x`, `y` or `z`.
        coordinate: char,
        /// The value.
        value: f64,
    },
    /// A face uses a vertex that does not exist.
    #[error("face {face} uses vertex {vertex}, but there are only {count} (counted from 0)")]
    NoSuchVertex {
        /// Index of the face.
        face: usize,
        /// Index it uses.
        vertex: u64,
        /// Number of vertices.
        count: usize,
    },
    /// A list and the vertices differ in number.
    #[error("{found} {what} for {expected} vertices")]
    Length {
        /// What the list holds.
        what: &'static str,
        /// How many there are.
        found: usize,
        /// Number of vertices.
        expected: usize,
    },
    /// A normal is zero or not finite, where a direction is needed.
    #[error("vertex {vertex}: the normal ({}, {}, {}) is zero or not finite", normal[0], normal[1], normal[2])]
    NoDirection {
        /// Index of the vertex.
        vertex: usize,
        /// The normal.
        normal: [f64; 3],
    },
    /// There are no vertices.
    #[error("no vertices")]
    NoVertices,
    /// There are no faces where a surface is needed.
    #[error("no faces: a surface is needed, not a cloud of points")]
    NoFaces,
    /// The size is implausible for metres.
    #[error(
        "{} across, outside {} to {}: if the coordinates are not in metres, give --units mm or --units cm, or the size with --size",
        metres(*diagonal), metres(range[0]), metres(range[1])
    )]
    Extent {
        /// Diagonal of the bounding box, m.
        diagonal: f64,
        /// Accepted range, m.
        range: [f64; 2],
    },
    /// A body that does not exist was asked for.
    #[error(
        "there is no body {wanted}: the number of bodies in the mesh is {found} (the largest is --body 1)"
    )]
    NoSuchBody {
        /// The body asked for, from 1.
        wanted: usize,
        /// How many there are.
        found: usize,
    },
    /// An invalid value of a command-line option.
    #[error("{option} {value}: expected {expected}")]
    BadOption {
        /// Name of the option.
        option: &'static str,
        /// The value.
        value: String,
        /// Description of valid values.
        expected: &'static str,
    },
    /// The mesh cannot be written in the format.
    #[error("{format} cannot hold this: {reason}")]
    Unwritable {
        /// The format.
        format: Format,
        /// Why not.
        reason: &'static str,
    },
}

/// A length with three significant digits.
fn metres(length: f64) -> String {
    crate::digits::three(length) + " m"
}

impl Error {
    /// The same error, with the file named.
    #[must_use]
    pub fn in_file(self, path: &std::path::Path) -> Self {
        match self {
            named @ Self::InFile { .. } => named,
            error => Self::InFile {
                path: path.to_owned(),
                error: Box::new(error),
            },
        }
    }
}
