//! Errors, each with the list and the index of the invalid entry.

use thiserror::Error;

/// Why a call was rejected. The filter is unchanged then.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum Error {
    /// The graph has no vertex.
    #[error("the graph has no vertices")]
    NoVertices,
    /// An option is out of range.
    #[error("{name} is {value}, but must be {must}")]
    Option {
        /// Field of [`Options`](crate::Options).
        name: &'static str,
        /// The rejected value.
        value: f64,
        /// The allowed range.
        must: &'static str,
    },
    /// The frame would move the body beyond one of its [limits](crate::body::Limits).
    #[error("{what} is {value:.3}, more than the limit of {limit:.3}")]
    Beyond {
        /// Which limit: `motion of the surface, m` or `pull of the grips in weights of the body`.
        what: &'static str,
        /// The value.
        value: f64,
        /// The limit.
        limit: f64,
    },
    /// A coordinate is NaN, infinite, or so large that its square loses precision.
    #[error("{what} {index} is not a usable point: {value:?}")]
    NonFinitePoint {
        /// Which list: `rest`, `live`, `truth`, `observation`, `coefficient of inequality`, `grip`, `target of row` or
        /// `origin of lattice`.
        what: &'static str,
        /// Position in that list.
        index: usize,
        /// The rejected coordinates.
        value: [f64; 3],
    },
    /// Two lists that belong together differ in length.
    #[error("{what} has {found} entries, {expected} are needed")]
    Length {
        /// Which list.
        what: &'static str,
        /// Its length.
        found: usize,
        /// The required length.
        expected: usize,
    },
    /// An index of a vertex is out of range.
    #[error("{what} {index} refers to vertex {vertex}, but there are {vertices}")]
    VertexOutOfRange {
        /// Which list: `edge`, `observation`, `triangle`, `inequality` or `keep`.
        what: &'static str,
        /// Position in that list.
        index: usize,
        /// The invalid index.
        vertex: u32,
        /// Number of vertices.
        vertices: usize,
    },
    /// An embedded point is in a cell that does not exist (for variances: did not exist in the last step).
    #[error("{what} {index} is in cell {cell}, but there are {cells}")]
    CellOutOfRange {
        /// Which list: `row`, `grip`, `surface point`, `foot`, `inequality`, `seen point` or `point`.
        what: &'static str,
        /// Position in that list.
        index: usize,
        /// The invalid cell.
        cell: u32,
        /// Number of cells.
        cells: usize,
    },
    /// The weights of an embedded point are invalid: not finite, or their sum is not one.
    #[error("the weights of {what} {index} are {weights:.3?}, but must be finite and sum to one")]
    Embedding {
        /// Which list, as for [`Self::CellOutOfRange`].
        what: &'static str,
        /// Position in that list.
        index: usize,
        /// The rejected weights.
        weights: [f64; 8],
    },
    /// A change of a lattice removes or moves cells; cells may only be added and refilled.
    #[error(
        "the change removes or moves cells (cell {cell}); cells may only be added and refilled"
    )]
    CellsLost {
        /// The first cell that has changed.
        cell: usize,
    },
    /// A place with a cell has no piece.
    #[error("there is no piece for the cell at {place:?}, but every cell needs one")]
    PlaceWithoutPiece {
        /// The place.
        place: [i32; 3],
    },
    /// Joined pieces that do not exist, or whose cells share no corner.
    #[error("joined pair {index}: {pair:?} are not two pieces whose cells share a corner")]
    NotJoined {
        /// Position in the list of pairs.
        index: usize,
        /// The pair.
        pair: [usize; 2],
    },
    /// An edge joins a vertex with itself.
    #[error("edge {index} joins vertex {vertex} with itself")]
    Loop {
        /// Position in the list of edges.
        index: usize,
        /// The vertex at both ends.
        vertex: u32,
    },
    /// A standard deviation, weight or duration is out of range.
    #[error("{what} {index} is {value}, but must be {must}")]
    Value {
        /// Which quantity.
        what: &'static str,
        /// Position in its list (0 for a single value).
        index: usize,
        /// The rejected value.
        value: f64,
        /// The allowed range.
        must: &'static str,
    },
    /// A plane's normal is not a unit vector or its offset is not finite.
    #[error("plane {index} is not usable: normal {normal:?}, offset {offset}")]
    Plane {
        /// Position in the list of planes.
        index: usize,
        /// The rejected normal.
        normal: [f64; 3],
        /// The rejected offset.
        offset: f64,
    },
    /// A matrix given as a rotation is not orthonormal.
    #[error("rotation {index} is not orthonormal")]
    NotARotation {
        /// Position in the list of rotations.
        index: usize,
    },
    /// The information matrix could not be factorised: the ratio of the largest to the smallest information is beyond the
    /// precision of `f64`.
    #[error(
        "the information matrix could not be factorised: the weights differ by too many orders of magnitude"
    )]
    Factorisation,
    /// The estimate overflowed.
    #[error("the estimate of vertex {vertex} is not finite")]
    Overflow {
        /// The first such vertex.
        vertex: usize,
    },
}
