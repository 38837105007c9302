//! Errors of the closed surface.

/// Why no closed surface could be computed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ClosedSurfaceError {
    /// The arrays of points, normals and weights differ in length.
    #[error("{points} points need as many normals and weights, not {normals} and {weights}")]
    LengthMismatch {
        /// Number of points.
        points: usize,
        /// Number of normals.
        normals: usize,
        /// Number of weights.
        weights: usize,
    },
    /// A length among the options is not positive and finite.
    #[error("{name} is {value}, but must be positive and finite")]
    BadOption {
        /// Its name.
        name: &'static str,
        /// The value given.
        value: f64,
    },
    /// A point, normal or weight is not finite, or a weight is negative, or a normal is not of unit length.
    #[error(
        "point {index}: its position, normal or weight is invalid (not finite, a negative weight, or a normal that is not of unit length)"
    )]
    BadPoint {
        /// Index of the point.
        index: usize,
    },
    /// Too few points for a surface.
    #[error(
        "{points} distinct points with a positive weight; at least {needed} are needed for a surface"
    )]
    TooFewPoints {
        /// Number of usable points.
        points: usize,
        /// Number of points needed.
        needed: usize,
    },
    /// The object is too large for the grid.
    #[error(
        "an object of {extent:.3} m needs too many nodes at a grid of {grid:.2e} m; use a coarser grid, or check the units"
    )]
    TooLarge {
        /// Longest side of the box around the points, m.
        extent: f64,
        /// Step of the grid, m.
        grid: f64,
    },
    /// The points enclose nothing.
    #[error(
        "the points enclose no volume: they all face one way, lie on a line or plane, or their normals point inward"
    )]
    NothingEnclosed,
}
