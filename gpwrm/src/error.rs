use thiserror::Error;

/// An invalid input, with its place.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum Error {
    /// A field or surface needs at least one node.
    #[error("no nodes were given")]
    NoNodes,
    /// Two parallel slices have different lengths.
    #[error("{expected} nodes, but {found} {what}")]
    LengthMismatch {
        /// The content of the second slice.
        what: &'static str,
        /// Number of nodes.
        expected: usize,
        /// Number of entries in the second slice.
        found: usize,
    },
    /// A coordinate is not finite, or beyond 1e60, where its square would overflow.
    #[error("a coordinate of {what} {index} is {value:e}, but must be finite and within ±1e60")]
    BadCoordinate {
        /// Which slice.
        what: &'static str,
        /// Index in that slice.
        index: usize,
        /// The coordinate.
        value: f64,
    },
    /// An option is out of range.
    #[error("{option} is {value}, but must be {bound}")]
    BadOption {
        /// Name of the option.
        option: &'static str,
        /// The value given.
        value: f64,
        /// The admissible range.
        bound: &'static str,
    },
    /// No node lies within the radius of the query point.
    #[error("no point of the cloud within {radius} m of query {index}")]
    Unsupported {
        /// Index of the query point.
        index: usize,
        /// The radius searched, in m.
        radius: f64,
    },
}

/// Largest coordinate whose products up to degree four still fit an `f64`.
const LARGEST: f64 = 1e60;

/// Whether a coordinate is finite and small enough to square.
pub(crate) fn is_sound(coordinate: f64) -> bool {
    coordinate.abs() <= LARGEST
}

/// Rejects coordinates that are not finite or too large to square.
pub(crate) fn check_coordinates<'a>(
    what: &'static str,
    triples: impl Iterator<Item = &'a nalgebra::Vector3<f64>>,
) -> Result<(), Error> {
    for (index, v) in triples.enumerate() {
        if let Some(&value) = v.iter().find(|c| !is_sound(**c)) {
            return Err(Error::BadCoordinate { what, index, value });
        }
    }
    Ok(())
}

/// Rejects slices of different lengths.
pub(crate) fn check_length(what: &'static str, expected: usize, found: usize) -> Result<(), Error> {
    if expected == found {
        Ok(())
    } else {
        Err(Error::LengthMismatch {
            what,
            expected,
            found,
        })
    }
}
