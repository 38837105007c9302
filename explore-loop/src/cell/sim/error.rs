//! Errors in the set-up of a simulated cell.

use nalgebra::Point3;

use crate::mesh::{self, three_digits};

/// Why a simulated cell could not be created.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SimError {
    /// The mesh has no triangles.
    #[error("the mesh has no triangles")]
    EmptyMesh,
    /// The mesh is too large to simulate.
    #[error("the mesh has {count} triangles: at most {max} can be simulated, simplify it first")]
    TooManyTriangles {
        /// Number of triangles.
        count: usize,
        /// Largest number accepted.
        max: usize,
    },
    /// A vertex is not finite.
    #[error("vertex {index} is not finite: {point}")]
    NonFiniteVertex {
        /// Index of the vertex.
        index: usize,
        /// Its coordinates.
        point: Point3<f64>,
    },
    /// A triangle refers to a vertex that does not exist.
    #[error("triangle {triangle} uses vertex {vertex}, but there are only {count}")]
    NoSuchVertex {
        /// Index of the triangle.
        triangle: usize,
        /// The index.
        vertex: usize,
        /// Number of vertices.
        count: usize,
    },
    /// The surface has a boundary, or more than two triangles meet in an edge.
    #[error("the mesh is not closed: edge {a}-{b} belongs to {triangles} triangle(s) instead of 2")]
    NotClosed {
        /// First vertex of the edge.
        a: usize,
        /// Second vertex of the edge.
        b: usize,
        /// Number of triangles at the edge.
        triangles: usize,
    },
    /// Neighbouring triangles have opposite orientations.
    #[error(
        "the mesh is not oriented: triangle {triangle} and its neighbour across edge {a}-{b} have opposite orientations"
    )]
    NotOriented {
        /// First vertex of the edge.
        a: usize,
        /// Second vertex of the edge.
        b: usize,
        /// Index of one of the two triangles.
        triangle: usize,
    },
    /// The mesh consists of several connected surfaces.
    #[error(
        "the mesh consists of {pieces} pieces, but only one can be simulated: choose one with --body (1 is the largest)"
    )]
    SeveralPieces {
        /// Number of pieces.
        pieces: usize,
    },
    /// The size is not plausible for an object on the table.
    #[error(
        "{} m across, outside 0.02 m to 1 m: if the coordinates are not in metres, give --units mm or --units cm, or the size with --size", three_digits(*diagonal)
    )]
    NotInMetres {
        /// Diagonal as read, in metres.
        diagonal: f64,
    },
    /// The surface is too thin for the allowed number of tetrahedra.
    #[error(
        "{tetrahedra} tetrahedra of {} m are too coarse: parts of the surface are {} m away from them; allow more tetrahedra", three_digits(*cell), three_digits(*gap)
    )]
    TooCoarse {
        /// Number of tetrahedra.
        tetrahedra: usize,
        /// Lattice spacing, metres.
        cell: f64,
        /// Largest distance of a surface vertex from the tetrahedra, metres.
        gap: f64,
    },
    /// A file cannot be read.
    #[error(transparent)]
    Mesh(#[from] mesh::Error),
    /// There is no built-in scene of that name.
    #[error("there is no scene {name:?}: choose one of {known}")]
    NoSuchScene {
        /// The requested name.
        name: String,
        /// The available names.
        known: String,
    },
    /// An option is out of range.
    #[error("{option} is {value}, but must be {range}")]
    BadOption {
        /// Name of the option.
        option: &'static str,
        /// Value given.
        value: f64,
        /// The allowed range.
        range: &'static str,
    },
    /// The object cannot be found in the images of this camera.
    #[error("camera: {0}")]
    Camera(String),
    /// The physics engine failed.
    #[error("the physics engine failed: {0}")]
    Engine(String),
}
