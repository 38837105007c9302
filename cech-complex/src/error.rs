//! The error type of the crate: what was wrong, where, and the value.

use nalgebra::{Point3, Vector3};

/// Errors of the input.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A length or scale that has to be positive and finite is not.
    #[error("{what} is {value}, but must be positive and finite")]
    NotPositive {
        /// Name of the parameter.
        what: &'static str,
        /// What was given.
        value: f64,
    },
    /// An angle lies outside `[0, π/2)`, or a cosine outside `[−1, 1]`.
    #[error("{what} is {value}, but must be {bound}")]
    OutOfRange {
        /// Name of the parameter.
        what: &'static str,
        /// What was given.
        value: f64,
        /// The admissible range, in words.
        bound: &'static str,
    },
    /// The sampling is too coarse for the reach: any cylinder that covers its patch would meet another sheet.
    #[error(
        "a spacing of {spacing} m is too coarse for a reach of {reach} m: the cylinders would extend {extent} m off the surface"
    )]
    TooCoarse {
        /// Sampling spacing, m.
        spacing: f64,
        /// Reach of the surface, m.
        reach: f64,
        /// How far from the surface the union of the cylinders would extend, m.
        extent: f64,
    },
    /// The cylinders do not cover the surface.
    #[error(
        "cylinders of radius {radius} m and height {height} m do not cover a surface with points {covering_radius} m from the next sample: \
         the radius has to be at least that, the height at least {least_height} m"
    )]
    NotCovering {
        /// Largest distance of a point of the surface to its nearest sample, m.
        covering_radius: f64,
        /// Radius of the cylinders, m.
        radius: f64,
        /// Height of the cylinders, m.
        height: f64,
        /// Smallest height that covers, m.
        least_height: f64,
    },
    /// A coordinate is NaN or infinite.
    #[error("point {index} is not finite: {point}")]
    NonFinitePoint {
        /// Index of the point.
        index: usize,
        /// The point.
        point: Point3<f64>,
    },
    /// A normal is not a unit vector (NaN included).
    #[error("normal {index} is not a unit vector: {normal}")]
    NonUnitNormal {
        /// Index of the normal.
        index: usize,
        /// The normal.
        normal: Vector3<f64>,
    },
    /// Two slices that describe the same points differ in length.
    #[error("{points} points but {others} {what}")]
    LengthMismatch {
        /// Number of points.
        points: usize,
        /// Content of the other slice.
        what: &'static str,
        /// Length of the other slice.
        others: usize,
    },
    /// A filtration value or a cut was requested for no vertex, or for more than four.
    #[error(
        "a simplex of the nerve has 1 to 4 vertices here (by Helly's theorem these determine larger ones), got {count}"
    )]
    SimplexSize {
        /// Number of cylinders given.
        count: usize,
    },
    /// The complex would exceed `Options::max_simplices`.
    #[error(
        "up to scale {max_scale:.3} the complex has {count} simplices or more, the limit is {limit}: {}",
        advice(*fitting_scale, *max_scale)
    )]
    TooManySimplices {
        /// Number of simplices when the limit was passed, or a lower bound by an estimate before counting.
        count: usize,
        /// The limit.
        limit: usize,
        /// Scale up to which the complex was asked for.
        max_scale: f64,
        /// Estimated scale up to which it would fit ([`estimate_size`](crate::estimate_size)); 0 if there is none.
        fitting_scale: f64,
    },
    /// The cloud does not look like a sampled surface: too few points, or none with neighbours on all sides.
    #[error(
        "{points} points, {interior} of them with neighbours on all sides: too few to tell how they sample a surface"
    )]
    NoSurface {
        /// Number of points.
        points: usize,
        /// Points with neighbours of the same sheet on all sides.
        interior: usize,
    },
    /// A vertex that has been removed or cut cannot be moved or removed.
    #[error("vertex {index} has been removed")]
    VertexRemoved {
        /// The index.
        index: usize,
    },
    /// A vertex index is not an index of a point of this complex.
    #[error("vertex {index} does not exist, the complex has {len} points")]
    NoSuchVertex {
        /// The index.
        index: usize,
        /// Number of points.
        len: usize,
    },
}

/// A fitting scale below this share of the one asked for is taken for a cylinder in millimetres around points in metres: it is
/// 1000 times too large, and nobody asks for a scale so far beyond what fits.
const SUSPECT: f64 = 0.05;

/// Advice for too many simplices.
fn advice(fitting_scale: f64, max_scale: f64) -> String {
    if fitting_scale > 0.0 && fitting_scale < SUSPECT * max_scale {
        return "if the cylinder is in millimetres and the points are in metres, divide its radius and height by 1000; \
                otherwise take smaller cylinders"
            .into();
    }
    let scale = if fitting_scale > 0.0 {
        format!("build up to max_scale {fitting_scale:.2}, ")
    } else {
        String::new()
    };
    format!("{scale}thin the points (epsilon_net), take smaller cylinders, or raise max_simplices")
}

/// `value` itself when it is positive and finite.
pub(crate) fn positive(what: &'static str, value: f64) -> Result<f64, Error> {
    if value > 0.0 && value.is_finite() {
        Ok(value)
    } else {
        Err(Error::NotPositive { what, value })
    }
}
