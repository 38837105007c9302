//! What can be wrong with a file of points.

use std::fmt;
use std::path::PathBuf;

use crate::Format;

/// Where in a file, counted as an editor or a hex viewer counts.
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

/// Why there are no points, or not the ones that were asked for.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Whatever it is, in this file.
    #[error("{}: {error}", path.display())]
    InFile {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        error: Box<Error>,
    },
    /// The system refuses the file.
    #[error("{reason}")]
    System {
        /// What the system said.
        reason: String,
    },
    /// The ending of the name is that of no format.
    #[error("the ending {ending:?} is none of {}", Format::endings(*writing))]
    UnknownEnding {
        /// The ending, without the dot.
        ending: String,
        /// Whether a file was to be written.
        writing: bool,
    },
    /// The file is not what its format asks for.
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
    /// A face names a vertex that is not there.
    #[error("face {face} uses vertex {vertex}, but there are only {count} (counted from 0)")]
    NoSuchVertex {
        /// Index of the face.
        face: usize,
        /// Index it uses.
        vertex: u64,
        /// Number of vertices.
        count: usize,
    },
    /// A list has another length than there are vertices.
    #[error("{found} {what} for {expected} vertices")]
    Length {
        /// Of what there are too few or too many.
        what: &'static str,
        /// How many there are.
        found: usize,
        /// Number of vertices.
        expected: usize,
    },
    /// A normal is zero or not finite, where directions are needed.
    #[error("vertex {vertex}: the normal ({}, {}, {}) has no direction", normal[0], normal[1], normal[2])]
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
    /// The size is not one that the program can take for metres.
    #[error(
        "{} across, outside {} to {}: are the coordinates in metres? Else give --units mm or --units cm, or the size with --size",
        metres(*diagonal), metres(range[0]), metres(range[1])
    )]
    Extent {
        /// Diagonal of the bounding box, m.
        diagonal: f64,
        /// What is accepted, m.
        range: [f64; 2],
    },
    /// A body was asked for that is not there.
    #[error("there is no body {wanted}: the mesh consists of {found} (the largest is --body 1)")]
    NoSuchBody {
        /// The body asked for, from 1.
        wanted: usize,
        /// How many there are.
        found: usize,
    },
    /// An option of the command line has a value that it cannot have.
    #[error("{option} {value}: {expected} is wanted")]
    BadOption {
        /// Name of the option.
        option: &'static str,
        /// What was given.
        value: String,
        /// What it may be.
        expected: &'static str,
    },
    /// What is to be written cannot be expressed in the format.
    #[error("{format} cannot hold this: {reason}")]
    Unwritable {
        /// The format.
        format: Format,
        /// Why not.
        reason: &'static str,
    },
}

/// A length with three digits.
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
