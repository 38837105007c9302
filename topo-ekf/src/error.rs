//! What can be wrong with an input, and with which entry of it.

use thiserror::Error;

/// Why a call was refused. The filter is left exactly as it was before the call.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum Error {
    /// The graph has no vertex.
    #[error("the graph has no vertices")]
    NoVertices,
    /// An option lies outside its range.
    #[error("option `{name}` is {value}; it must be {must}")]
    Option {
        /// Field of [`Options`](crate::Options).
        name: &'static str,
        /// The refused value.
        value: f64,
        /// What would be accepted.
        must: &'static str,
    },
    /// What the frame would have done to the body lies beyond a [limit](crate::body::Limits) of it.
    #[error("{what} is {value:.3}, at most {limit:.3} is believed")]
    Beyond {
        /// Which limit: `motion of the surface, m` or `pull of the grips in weights of the body`.
        what: &'static str,
        /// The value.
        value: f64,
        /// The limit.
        limit: f64,
    },
    /// A coordinate is NaN or infinite, or so large that squares overflow.
    #[error("{what} {index} is not a usable point: {value:?}")]
    NonFinitePoint {
        /// Which list: `rest`, `live`, `truth`, `observation`, `coefficient of inequality`, `grip`, `target of row` or
        /// `origin of lattice`.
        what: &'static str,
        /// Position in that list.
        index: usize,
        /// The refused coordinates.
        value: [f64; 3],
    },
    /// Two lists that describe the same thing differ in length.
    #[error("{what} has {found} entries, {expected} are needed")]
    Length {
        /// Which list.
        what: &'static str,
        /// Its length.
        found: usize,
        /// The length that fits.
        expected: usize,
    },
    /// An index points past the end of the vertices.
    #[error("{what} {index} names vertex {vertex}, there are {vertices}")]
    VertexOutOfRange {
        /// Which list: `edge`, `observation`, `triangle`, `inequality` or `keep`.
        what: &'static str,
        /// Position in that list.
        index: usize,
        /// The refused vertex.
        vertex: u32,
        /// Number of vertices.
        vertices: usize,
    },
    /// An embedded point names a cell that the lattice does not have (for variances: did not have in the last step).
    #[error("{what} {index} lies in cell {cell}, there are {cells}")]
    CellOutOfRange {
        /// Which list: `row`, `grip`, `surface point`, `foot`, `inequality`, `seen point` or `point`.
        what: &'static str,
        /// Position in that list.
        index: usize,
        /// The refused cell.
        cell: u32,
        /// Number of cells.
        cells: usize,
    },
    /// The weights of an embedded point are not those of a point: not finite, or their sum is not one.
    #[error("the weights of {what} {index} are {weights:.3?}; they must be finite and sum to one")]
    Embedding {
        /// Which list, as for [`Self::CellOutOfRange`].
        what: &'static str,
        /// Position in that list.
        index: usize,
        /// The refused weights.
        weights: [f64; 8],
    },
    /// A change of a lattice takes cells away or moves them; cells may only be added and refilled.
    #[error(
        "the change takes cells away or moves them (cell {cell}); cells may only be added and refilled"
    )]
    CellsLost {
        /// The first cell that is no longer as it was.
        cell: usize,
    },
    /// A cell of the lattice is at a place for which no piece was given.
    #[error("no piece is given for the cell at {place:?}; every cell needs one")]
    PlaceWithoutPiece {
        /// The place.
        place: [i32; 3],
    },
    /// Joined pieces that are none, or whose cells share no corner.
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
    #[error("{what} {index} is {value}; it must be {must}")]
    Value {
        /// Which quantity.
        what: &'static str,
        /// Position in its list (0 for a single value).
        index: usize,
        /// The refused value.
        value: f64,
        /// What would be accepted.
        must: &'static str,
    },
    /// A plane's normal is not a unit vector or its offset is not finite.
    #[error("plane {index} is not usable: normal {normal:?}, offset {offset}")]
    Plane {
        /// Position in the list of planes.
        index: usize,
        /// The refused normal.
        normal: [f64; 3],
        /// Its offset.
        offset: f64,
    },
    /// A matrix given as a rotation is not orthonormal.
    #[error("rotation {index} is not orthonormal")]
    NotARotation {
        /// Position in the list of rotations.
        index: usize,
    },
    /// The information matrix could not be factorised: the spread between the largest and the smallest
    /// information is beyond what `f64` carries.
    #[error("the information matrix could not be factorised (weights too far apart)")]
    Factorisation,
    /// The estimate overflowed.
    #[error("the estimate of vertex {vertex} is not finite")]
    Overflow {
        /// The first such vertex.
        vertex: usize,
    },
}
