use nalgebra::{Point3, UnitVector3, Vector3};
use thiserror::Error;

/// Invalid input, with its place. The outcome of a registration is not an error but a
/// [`Status`](crate::Status).
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum Error {
    /// A cloud has no points.
    #[error("the {cloud} cloud has no points")]
    EmptyCloud {
        /// Which cloud.
        cloud: &'static str,
    },
    /// A cloud has too few points to register.
    #[error("the {cloud} cloud has {found} points, but at least {needed} are needed")]
    TooFewPoints {
        /// Which cloud.
        cloud: &'static str,
        /// Points found.
        found: usize,
        /// Points needed.
        needed: usize,
    },
    /// Two landmarks contradict each other: their displacements differ by more than a rotation and a stretch to twice the length explain.
    #[error(
        "landmarks {first} and {second} contradict each other: their displacements differ by {:.3} mm", 1e3 * gap
    )]
    ContradictoryLandmarks {
        /// Index of the earlier one.
        first: usize,
        /// Index of the later one.
        second: usize,
        /// Length of the difference of their displacements, in m.
        gap: f64,
    },
    /// Two parallel slices have different lengths.
    #[error("{expected} points, but {found} {what}")]
    LengthMismatch {
        /// Content of the second slice.
        what: &'static str,
        /// Number of points.
        expected: usize,
        /// Number of entries in the second slice.
        found: usize,
    },
    /// A coordinate is not finite, or beyond 1e6 m.
    #[error("a coordinate of {what} {index} is {value}, but must be finite and within ±1e6 m{}", too_far(*value))]
    BadCoordinate {
        /// Name of the slice.
        what: &'static str,
        /// Index in that slice.
        index: usize,
        /// The offending coordinate.
        value: f64,
    },
    /// A normal is not a unit vector: zero, of another length, or not finite.
    #[error("the length of {cloud} normal {index} is {length}, but must be 1 to within 0.001")]
    BadNormal {
        /// Which cloud.
        cloud: &'static str,
        /// Index of the normal.
        index: usize,
        /// Its length; NaN or infinite if the normal is not finite.
        length: f64,
    },
    /// A standard deviation is negative or not finite.
    #[error("the sigma of landmark {index} is {value}, but must be finite and not negative")]
    BadSigma {
        /// Index of the landmark.
        index: usize,
        /// The value given.
        value: f64,
    },
    /// An option lies outside its range.
    #[error("{option} is {value}, but must be {bound}")]
    BadOption {
        /// Name of the option.
        option: &'static str,
        /// The value given.
        value: f64,
        /// The admissible range, in words.
        bound: &'static str,
    },
    /// The node spacing gives more nodes than are solved for.
    #[error(
        "{nodes} nodes at this spacing, at most {limit} are solved: the cloud is {extent:.3} m across; {}",
        too_large(*extent)
    )]
    TooManyNodes {
        /// Nodes at the spacing asked for.
        nodes: usize,
        /// Largest number solved.
        limit: usize,
        /// Longest side of the bounding box of the source, in m.
        extent: f64,
    },
    /// The normal equations could not be factorised: the weights span too many orders of magnitude.
    #[error(
        "the normal equations are not positive definite in iteration {iteration}: weights differ by too many orders of magnitude"
    )]
    Singular {
        /// Iteration in which it happened.
        iteration: usize,
    },
}

/// A cloud wider than this is taken to be in millimetres, m: robots do not hold anything as large.
const SUSPECT: f64 = 5.0;

/// Advice for a cloud with too many nodes.
fn too_large(extent: f64) -> String {
    if extent > SUSPECT {
        format!(
            "if it is in millimetres, {:.3} m, divide its coordinates by 1000",
            1e-3 * extent
        )
    } else {
        "use a larger node spacing, or Options::scaled".into()
    }
}

/// Advice for a finite coordinate that is too large.
fn too_far(coordinate: f64) -> &'static str {
    if coordinate.is_finite() {
        ": if it is in millimetres, divide all coordinates by 1000"
    } else {
        ""
    }
}

/// Larger coordinates are taken for a mistake of units; up to 1e6 m, `f64` still resolves nanometres.
const LARGEST: f64 = 1e6;

fn check_coordinates<'a>(
    what: &'static str,
    triples: impl Iterator<Item = &'a Vector3<f64>>,
) -> Result<(), Error> {
    for (index, v) in triples.enumerate() {
        if let Some(&value) = v.iter().find(|c| c.is_nan() || c.abs() > LARGEST) {
            return Err(Error::BadCoordinate { what, index, value });
        }
    }
    Ok(())
}

pub(crate) fn check_points(what: &'static str, points: &[Point3<f64>]) -> Result<(), Error> {
    check_coordinates(what, points.iter().map(|p| &p.coords))
}

pub(crate) fn check_vectors(what: &'static str, vectors: &[Vector3<f64>]) -> Result<(), Error> {
    check_coordinates(what, vectors.iter())
}

/// Largest difference of the length of a normal from 1. Sources in `f32`, or rounded to a few digits, are not exact.
const LENGTH_TOLERANCE: f64 = 1e-3;

/// Rejects normals that are not unit vectors, which `UnitVector3::new_unchecked` can make.
pub(crate) fn check_normals(
    cloud: &'static str,
    normals: &[UnitVector3<f64>],
) -> Result<(), Error> {
    for (index, normal) in normals.iter().enumerate() {
        let length = normal.norm();
        // The comparison is false for NaN.
        let unit = (length - 1.0).abs() <= LENGTH_TOLERANCE;
        if !unit {
            return Err(Error::BadNormal {
                cloud,
                index,
                length,
            });
        }
    }
    Ok(())
}

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

pub(crate) fn check_range(
    option: &'static str,
    value: f64,
    ok: bool,
    bound: &'static str,
) -> Result<(), Error> {
    if ok {
        Ok(())
    } else {
        Err(Error::BadOption {
            option,
            value,
            bound,
        })
    }
}
