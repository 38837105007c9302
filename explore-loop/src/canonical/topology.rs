//! Topology of the canonical model, by the cylinder-Čech complex of its rest positions.
//!
//! The surface is closed when the persistent Betti numbers between two scales are (1, 0, 1): one piece, no hole, one
//! cavity (METHOD §9). The complex is oriented: sheets that face away from each other are not joined.

use super::CanonicalModel;
use cech_complex::{Complex, Cylinder, Options, Orientation, VertexKind};

/// Cylinder radius, in spacings: discs of neighbours overlap well beyond the largest gap a maximal net of the
/// spacing leaves.
const RADIUS: f64 = 1.45;
/// Cylinder height, in spacings: the bulge of the surface over a disc, plus what registration left.
const HEIGHT: f64 = 2.0;
/// Classes must live from scale 1 to this one.
const PERSISTS: f64 = 1.25;
/// Normals that differ more than 107 degrees are two sheets.
const SHEET_COSINE: f64 = -0.3;

/// What the complex says of the model.
#[derive(Debug, Clone, PartialEq)]
pub struct Topology {
    /// Betti numbers of the complex at scale 1.
    pub betti: [usize; 3],
    /// Persistent Betti numbers from scale 1 to the larger one.
    pub persistent: [usize; 3],
    /// Which vertices lie on the boundary of what was seen.
    pub boundary: Vec<bool>,
    /// Vector area of the surface as a share of its area: a lower bound on what is missing.
    pub missing: f64,
    /// Boundary loops, vertices in order.
    pub loops: Vec<Vec<u32>>,
    /// Simplices that the cuts removed: vertices, edges, triangles.
    pub cut: [usize; 3],
    /// Number of non-manifold vertices.
    pub non_manifold: usize,
    /// Simplices of each dimension.
    pub simplices: [usize; 4],
}

impl Topology {
    /// Whether the surface is that of a solid body, wholly seen.
    ///
    /// The Betti numbers alone would be fooled by a blister: a doubled patch encloses a cavity of its own while the rest of
    /// the surface is still open. A closed surface has no vector area either (`Σ area·n = 0`), and next to no boundary; the
    /// bounds leave room for what noise does to single vertices.
    pub fn is_closed(&self) -> bool {
        self.persistent == [1, 0, 1]
            && self.missing <= MOST_MISSING
            && self.boundary_share() <= MOST_BOUNDARY
    }

    /// Share of the vertices that lie on the boundary.
    pub fn boundary_share(&self) -> f64 {
        self.boundary.iter().filter(|b| **b).count() as f64 / self.boundary.len().max(1) as f64
    }
}

/// Largest vector area of a surface taken for closed, as a share of its area.
const MOST_MISSING: f64 = 0.08;
/// Largest share of boundary vertices of a surface taken for closed.
const MOST_BOUNDARY: f64 = 0.08;

/// Length of the vector area of the surface as a share of its area: a lower bound on the share that is missing.
fn missing_share(model: &CanonicalModel, spacing: f64) -> f64 {
    let triangles = super::surface::triangulate(&model.rest, &model.rest_normals, spacing);
    let (mut vector, mut area) = (nalgebra::Vector3::zeros(), 0.0);
    for t in &triangles {
        let [a, b, c] = t.map(|i| model.rest[i as usize]);
        let face = (b - a).cross(&(c - a));
        vector += face;
        area += face.norm();
    }
    if area > 0.0 {
        vector.norm() / area
    } else {
        1.0
    }
}

/// Builds the complex of the rest positions and reads it.
///
/// # Errors
/// Non-finite positions, or a complex larger than memory allows.
pub fn analyse(model: &CanonicalModel, spacing: f64) -> Result<Topology, cech_complex::Error> {
    let cylinder = Cylinder::new(RADIUS * spacing, HEIGHT * spacing)?;
    let options = Options::default()
        .max_scale(PERSISTS)
        .orientation(Orientation::Separate {
            min_cosine: SHEET_COSINE,
        })
        .max_simplices(20_000_000);
    let mut complex = Complex::build(&model.rest, &model.rest_normals, cylinder, &options)?;
    let removed = complex.cut(&model.cut_edges())?;
    let kinds = complex.classify(spacing)?;
    let loops = complex
        .boundary_loops(&kinds)?
        .into_iter()
        .map(|l| l.vertices)
        .collect();
    Ok(Topology {
        betti: complex.betti(1.0),
        persistent: complex.persistent_betti(1.0, PERSISTS),
        missing: missing_share(model, spacing),
        boundary: kinds.iter().map(|k| *k == VertexKind::Boundary).collect(),
        loops,
        non_manifold: kinds
            .iter()
            .filter(|k| **k == VertexKind::NonManifold)
            .count(),
        cut: [removed.vertices.len(), removed.edges, removed.triangles],
        simplices: complex.counts(),
    })
}
