//! Errors of the input, with the index and the value.

/// Invalid input. Why something could not be planned is a [`crate::Refusal`].
#[derive(Debug, Clone, thiserror::Error)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub enum Error {
    /// The model has no vertices.
    #[error("the model has no vertices")]
    EmptyModel,
    /// The camera sees no triangle of a closed mesh.
    #[error("the camera sees nothing of the mesh")]
    NothingVisible,
    /// The slices of the model differ in length.
    #[error("the model has {points} points but {count} {what}")]
    LengthMismatch {
        /// The slice that differs.
        what: &'static str,
        /// Its length.
        count: usize,
        /// Number of points.
        points: usize,
    },
    /// A point is NaN or infinite.
    #[error("point {index} is not finite: {point:?}")]
    NonFinitePoint {
        /// Index of the point.
        index: usize,
        /// The point.
        point: [f64; 3],
    },
    /// A normal is NaN or infinite.
    #[error("normal {index} is not finite")]
    NonFiniteNormal {
        /// Index of the normal.
        index: usize,
    },
    /// The length of a normal differs from 1 by more than 0.001.
    #[error("length of normal {index} is {length}, but must be 1")]
    BadNormal {
        /// Index of the normal.
        index: usize,
        /// Its length.
        length: f64,
    },
    /// The vector area of a hidden piece is NaN or infinite.
    #[error("the vector area of hidden piece {index} is not finite")]
    NonFiniteHidden {
        /// Index of the piece.
        index: usize,
    },
    /// An area is negative, NaN or infinite.
    #[error("area {index} is {area}, but must be finite and at least 0")]
    BadArea {
        /// Index of the vertex.
        index: usize,
        /// The area.
        area: f64,
    },
    /// An edge refers to a vertex that does not exist, or joins a vertex with itself.
    #[error(
        "edge {index} joins {vertices:?}, but must join two different ones of the {points} vertices"
    )]
    BadEdge {
        /// Index of the edge.
        index: usize,
        /// Its ends.
        vertices: [u32; 2],
        /// Number of vertices.
        points: usize,
    },
    /// A vertex index is out of range.
    #[error("vertex {vertex} does not exist: the model has {points} vertices")]
    NoSuchVertex {
        /// The index.
        vertex: u32,
        /// Number of vertices.
        points: usize,
    },
    /// A setting is out of range.
    #[error("{name} is {value}, but must be {expected}")]
    BadSetting {
        /// Name of the setting.
        name: &'static str,
        /// Its value.
        value: f64,
        /// The range.
        expected: &'static str,
    },
    /// A target weight is negative, NaN or infinite.
    #[error("target weight {index} is {weight}, but must be finite and at least 0")]
    BadTargetWeight {
        /// Index of the vertex.
        index: usize,
        /// The weight.
        weight: f64,
    },
    /// A property of an arm is not finite or not positive.
    #[error("arm {arm}: {what} is invalid")]
    BadArm {
        /// Index of the arm.
        arm: usize,
        /// The property.
        what: &'static str,
    },
    /// Turning over requires two arms.
    #[error("turning over requires at least 2 arms, but there are {count}")]
    TooFewArms {
        /// Number of arms.
        count: usize,
    },
    /// A grip vertex is not among the candidates for which covariances were computed.
    #[error("vertex {vertex} is not among the candidates of this coverage")]
    NotACandidate {
        /// The vertex.
        vertex: u32,
    },
    /// The same vertex is gripped twice.
    #[error("vertex {vertex} is gripped twice")]
    RepeatedGrip {
        /// The vertex.
        vertex: u32,
    },
    /// The stiffness matrix is not positive definite.
    #[error(
        "the stiffness matrix is not positive definite: every connected part needs something that holds it"
    )]
    NotPositiveDefinite,
    /// The target weights are all zero.
    #[error("the target weights sum to {total}: there is no target")]
    NoTarget {
        /// Their sum, weighted by the prior variances.
        total: f64,
    },
}
