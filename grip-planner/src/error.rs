//! What can be wrong with an input, said with the index and the value.

/// An input that nothing can be computed from. Why something could not be planned is a [`crate::Refusal`].
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
    /// The vector area of a hidden piece is NaN or infinite.
    #[error("the vector area of hidden piece {index} is not finite")]
    NonFiniteHidden {
        /// Index of the piece.
        index: usize,
    },
    /// An area is negative, NaN or infinite.
    #[error("area {index} is {area}, not a finite number of at least 0")]
    BadArea {
        /// Index of the vertex.
        index: usize,
        /// The area.
        area: f64,
    },
    /// An edge names a vertex that does not exist, or joins a vertex to itself.
    #[error(
        "edge {index} joins {vertices:?}: the model has {points} vertices and no loops of one edge"
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
    #[error("vertex {vertex} does not exist: the model has {points}")]
    NoSuchVertex {
        /// The index asked for.
        vertex: u32,
        /// Number of vertices.
        points: usize,
    },
    /// A setting is outside its range.
    #[error("{name} is {value}, it should be {expected}")]
    BadSetting {
        /// Name of the setting.
        name: &'static str,
        /// Its value.
        value: f64,
        /// What it should be.
        expected: &'static str,
    },
    /// Something of an arm is not finite or not positive.
    #[error("arm {arm}: {what} is not usable")]
    BadArm {
        /// Index of the arm.
        arm: usize,
        /// What is wrong.
        what: &'static str,
    },
    /// Turning over takes two arms.
    #[error("{count} arms: turning over takes at least 2")]
    TooFewArms {
        /// Number of arms.
        count: usize,
    },
    /// A grip vertex is not among the candidates whose covariance was solved.
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
        "the stiffness matrix is not positive definite: every piece needs something that holds it"
    )]
    NotPositiveDefinite,
    /// The target weights are all zero.
    #[error("the target weights sum to {total}: nothing to move")]
    NoTarget {
        /// Their weighted prior variance.
        total: f64,
    },
}
