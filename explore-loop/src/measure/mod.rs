//! Measures of a finished mesh and of the tracking that led to it, against a ground truth to which only this module has access.
//!
//! ```text
//! accuracy           distance mesh → true surface: mean, 95 %, maximum
//! completeness       distance true surface → mesh: mean, 95 %, maximum
//! F-score at d       harmonic mean of the shares of both that lie within d
//! explored           share of the true area within one spacing of the model's points (within two: explored_2eps)
//! shape difference   mean distance, point of the model → true surface
//! doubled            share of the true area over which the mesh has an additional sheet that faces the same way
//! unsupported        share of the mesh's area farther than one spacing from every observed point
//! mesh report        watertight, Euler number, open and non-manifold edges, components
//! prediction error   mean distance, live position of an unseen vertex → where its material point is
//! slide              mean tangential part of the same distance for seen vertices
//! grip speed         the largest speed of a tip that holds the object
//! ```
//!
//! All shape measures are taken at rest, on points sampled evenly by area. They take plain slices of vertices and triangles, so
//! that any mesh can be compared with any other:
//!
//! ```
//! use explore_loop::measure::{Sampling, Surface, compare};
//! use explore_loop::nalgebra::Point3;
//!
//! let corners = |size: f64| [[0.0; 3], [size, 0.0, 0.0], [0.0, size, 0.0], [0.0, 0.0, size]].map(Point3::from);
//! let triangles = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
//! let truth = Surface::new(&corners(0.1), &triangles)?;
//! let same = compare(&truth, &truth, Sampling::default());
//! assert!(same.accuracy().max < 1e-12 && same.f_score(0.002) == 1.0);
//! # Ok::<(), explore_loop::measure::MeasureError>(())
//! ```
//!
//! | file | question |
//! |---|---|
//! | `surface` | a checked mesh: area, distance, crossings with a line |
//! | `sampling` | points evenly by area |
//! | `shape` | how far is the mesh from the truth, and the truth from the mesh? |
//! | `doubled` | where does the mesh have an additional sheet? |
//! | `support` | which share of its area was never seen? |
//! | `mesh_report` | is it closed, manifold, one piece? |
//! | `tracking` | do the vertices follow the material, according to the truth? |
//! | `grip_speed` | how fast did the grips move? |
//! | `tracks` | do they follow the material, according to a pixel tracker? |
//! | `truth` | the true surface |
//! | `from_points` | a closed surface through the points of a ground truth without triangles |
//! | `gaps` | triangles that fill gaps |

mod doubled;
mod from_points;
mod gaps;
mod grip_speed;
mod mesh_report;
mod sampling;
mod shape;
mod summary;
mod support;
mod surface;
mod tracking;
mod tracks;
mod truth;

pub use doubled::{DoubledOptions, doubled};
pub use grip_speed::GripSpeed;
pub use mesh_report::MeshReport;
pub use sampling::Sampling;
pub use shape::{Comparison, FScore, ShapeMeasures, Spread, compare, explored, shape_difference};
pub use summary::{MeshMeasures, TruthMeasures};
pub use support::unsupported;
pub use surface::{Crossing, Sample, Surface};
pub use tracking::{Measurer, MeasurerState, TrackingMeasures};
pub use tracks::{Pinhole, PixelTracks, TrackComparison, TrackErrors};
pub use truth::TrueSurface;

/// Why a mesh cannot be measured.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MeasureError {
    /// No triangle has an area.
    #[error("a surface cannot be measured: it has no triangle with an area")]
    NoArea,
    /// Pixel tracks that cannot be used.
    #[error("pixel tracks: {reason}")]
    BadTracks {
        /// The reason.
        reason: String,
    },
    /// The saved measures belong to another object.
    #[error("the saved measures belong to another object")]
    OtherObject,
    /// A triangle refers to a vertex that does not exist.
    #[error(
        "a surface cannot be measured: triangle {triangle} refers to vertex {vertex}, but there are {count}"
    )]
    NoSuchVertex {
        /// Index of the triangle.
        triangle: usize,
        /// The vertex it refers to.
        vertex: u32,
        /// Number of vertices.
        count: usize,
    },
    /// A vertex is infinite or not a number.
    #[error("a surface cannot be measured: vertex {vertex} is not finite")]
    NotFinite {
        /// Index of the vertex.
        vertex: usize,
    },
    /// The true surface changed its number of vertices.
    #[error("the true surface has {found} vertices, but had {expected} at first")]
    TruthChanged {
        /// Vertices at first.
        expected: usize,
        /// Vertices now.
        found: usize,
    },
    /// No surface can be computed through the points.
    #[error("no closed surface can be computed through {count} points: {reason}")]
    NoSurface {
        /// Number of points.
        count: usize,
        /// The reason.
        reason: String,
    },
    /// The search tree over the triangles could not be built.
    #[error("a surface cannot be measured: {0}")]
    Tree(String),
}
