//! The topology of the canonical model, and whether its surface is closed.
//!
//! ```text
//! points ─► closed surface ─► even sample of its seen part ─► cylinder-Čech complex of it ─► persistent Betti numbers
//! closed  ⇔  (1, 2g, 1)  and  g handles  and  wholly seen  and  no strays  and  no vector area  and  no boundary
//! ```
//! The points are unevenly spaced, above all at sharp edges; the closed surface through them is sampled evenly. That surface is always closed and
//! proves nothing by itself: only its parts within reach of a point that faces the same way enter the complex. *Bare* is the share of its area
//! without such a point; *wholly seen* means that the bare area consists of random gaps between points, nowhere farther than 1.75 spacings
//! from them; *strays* are points off the surface, for example of a second sheet. Any genus `g` is accepted unless one is requested
//! ([`super::genus`]).

use super::closed_surface::{ClosedSurface, ClosedSurfaceOptions, Unseen, closed_surface};
use super::genus::{CONTACT, Genus, Handles};
pub use super::obstacle::{Obstacle, Touching};
use super::sample_complex::{MOST_SIMPLICES, Sample};
use super::{CanonicalModel, graph};
use cech_complex::Bar;
use nalgebra::{Point3, Vector3};

/// The topology of the model, from its closed surface and its complex.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Topology {
    /// Betti numbers of the complex at scale 1.
    pub betti: [usize; 3],
    /// Persistent Betti numbers from scale 1 to the larger one.
    pub persistent: [usize; 3],
    /// The requested genus.
    pub genus: Genus,
    /// Handles of the closed surface.
    pub handles: Handles,
    /// Which vertices of the model lie on the boundary of the seen part.
    pub boundary: Vec<bool>,
    /// Share of the sample of the surface that lies on its boundary.
    pub boundary_share: f64,
    /// Length of the vector area of the seen surface as a share of its area: a lower bound on the missing share.
    pub missing: f64,
    /// Share of the closed surface that no point supports; 1 when no surface could be computed.
    pub bare: f64,
    /// The triangles of the closed surface that no point supports.
    pub hidden: Vec<Hidden>,
    /// The patches that were never seen, at rest, the largest first; none when all was seen, or when no surface could be computed.
    pub unseen: Vec<Unseen>,
    /// Greatest distance of a point of those patches from the seen surface, m; infinite when no surface could be computed.
    pub farthest: f64,
    /// Whether the unsupported area consists only of random gaps ([`ClosedSurface::is_wholly_seen`]).
    pub wholly_seen: bool,
    /// Share of the points off the surface: a second sheet, or outliers.
    pub strays: f64,
    /// Bars of the persistent homology of the complex, by dimension, then birth: the longest [`MOST_BARS`] of each dimension. Scales are those of
    /// [`cech_complex`]: at 1 the cylinders have the radius and height derived from the spacing; the complex ends at scale 1.25.
    pub bars: Vec<Bar>,
    /// Number of omitted shorter bars of each dimension.
    pub shorter_bars: [usize; 3],
    /// Boundary loops: vertices of the model in order.
    pub loops: Vec<Vec<u32>>,
    /// Around a neck where parts touch that were never seen apart: vertices of the model in order; otherwise empty.
    pub neck: Vec<u32>,
    /// Simplices that cuts of edges of the model removed, where there is no closed surface: vertices, edges, triangles.
    pub cut: [usize; 3],
    /// Number of non-manifold points in the sample of the surface.
    pub non_manifold: usize,
    /// Simplices of each dimension.
    pub simplices: [usize; 4],
    /// Number of sample points dropped because the complex would have become too large; the remaining points are farther apart.
    pub thinned: usize,
    /// The surface: closed when the object is, otherwise open where nothing was seen; `None` when none could be computed.
    pub surface: Option<ClosedSurface>,
}

/// A triangle of the closed surface that no point supports.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Hidden {
    /// Nearest vertex of the model.
    pub vertex: u32,
    /// Vector area at rest, m².
    pub area: Vector3<f64>,
}

impl Topology {
    /// Whether the surface is that of a wholly seen solid body with an accepted number of handles.
    ///
    /// Betti numbers alone are not enough: a doubled patch encloses a cavity of its own while the rest of the surface is still open. A closed
    /// surface has no vector area (`Σ area·n = 0`), almost no boundary, no bare part and no points off it; the bounds allow for the noise of
    /// single points.
    pub fn is_closed(&self) -> bool {
        self.obstacle().is_none()
    }

    /// Whether the Betti numbers at scale 1 are (1, 2g, 1), those of a closed surface of an accepted genus. This is necessary but not
    /// sufficient: see [`Self::is_closed`].
    pub fn has_betti_numbers_of_closed(&self) -> bool {
        Genus::of_betti(self.betti).is_some_and(|genus| self.genus.allows(genus))
    }

    /// What keeps the surface from counting as closed, if anything.
    pub fn obstacle(&self) -> Option<Obstacle> {
        let found = Genus::of_betti(self.persistent).filter(|genus| self.genus.allows(*genus));
        let Some(genus) = found else {
            return Some(Obstacle::Betti(self.persistent));
        };
        if genus != self.handles.count {
            Some(Obstacle::Handles {
                complex: genus,
                mesh: self.handles.count,
            })
        } else if self.genus == Genus::Any && self.handles.crease > CONTACT {
            // Handles that were asked for are handles, however sharply they have grown on.
            Some(Obstacle::Contact(self.handles.crease))
        } else {
            self.gap()
        }
    }

    /// The parts that touch and were not seen apart, if nothing else keeps the surface from counting as closed; whatever genus is requested.
    pub fn touching(&self) -> Option<Touching> {
        let agree = Genus::of_betti(self.persistent) == Some(self.handles.count);
        let alone = agree && self.handles.crease > CONTACT && self.gap().is_none();
        let at = self.handles.creased_at().filter(|_| alone)?;
        Some(Touching {
            at,
            crease: self.handles.crease,
        })
    }

    /// What keeps the surface from counting as closed beside its Betti numbers and handles.
    fn gap(&self) -> Option<Obstacle> {
        if !self.wholly_seen {
            Some(Obstacle::Bare {
                share: self.bare,
                farthest: self.farthest,
            })
        } else if self.strays > MOST_STRAYS {
            Some(Obstacle::Strays(self.strays))
        } else if self.boundary_share > MOST_BOUNDARY {
            Some(Obstacle::Boundary(self.boundary_share))
        } else if self.missing > MOST_MISSING {
            Some(Obstacle::Missing(self.missing))
        } else {
            None
        }
    }

    /// At how many contacts parts that touch were separated.
    pub fn contacts(&self) -> usize {
        self.surface.as_ref().map_or(0, |s| s.contacts.len())
    }

    /// Share of the sample of the surface that lies on its boundary.
    pub fn boundary_share(&self) -> f64 {
        self.boundary_share
    }
}

/// Largest vector area of a surface that counts as closed, as a share of its area.
const MOST_MISSING: f64 = 0.03;
/// Largest share of boundary points of a surface that counts as closed.
const MOST_BOUNDARY: f64 = 0.01;
/// Largest share of points off a surface that counts as closed.
const MOST_STRAYS: f64 = 0.03;

/// Computes the closed surface of the rest positions, the complex of its seen part, and their topology.
///
/// # Errors
/// Non-finite positions.
pub fn analyse(model: &CanonicalModel, spacing: f64) -> Result<Topology, cech_complex::Error> {
    analyse_as(model, spacing, Genus::Any)
}

/// As [`analyse`]; the surface counts as closed only with this genus.
///
/// # Errors
/// Non-finite positions.
pub fn analyse_as(
    model: &CanonicalModel,
    spacing: f64,
    genus: Genus,
) -> Result<Topology, cech_complex::Error> {
    analyse_limited(model, spacing, genus, MOST_SIMPLICES)
}

/// As [`analyse_as`], with a complex of at most `most` simplices: if there are more, the sample is thinned ([`Topology::thinned`]) and the scale
/// enlarged, so that holes of less than two of the larger spacings are not detected.
///
/// # Errors
/// Non-finite positions.
pub fn analyse_within(
    model: &CanonicalModel,
    spacing: f64,
    most: usize,
) -> Result<Topology, cech_complex::Error> {
    analyse_limited(model, spacing, Genus::Any, most)
}

fn analyse_limited(
    model: &CanonicalModel,
    spacing: f64,
    genus: Genus,
    most: usize,
) -> Result<Topology, cech_complex::Error> {
    let weights: Vec<f64> = model
        .times_seen
        .iter()
        .map(|t| f64::from(*t).min(10.0))
        .collect();
    let options = ClosedSurfaceOptions::new(spacing)
        .with_genus(genus)
        .with_parted(model.parted());
    let drawn = closed_surface(&model.rest, &model.rest_normals, &weights, &options).ok();
    let sample = Sample::of(model, drawn.as_ref(), spacing);
    let sampled = sample.points.len();
    let (sample, complex) = sample.read(model, drawn.as_ref(), most)?;
    let thinned = sampled - sample.points.len();
    let (boundary, loops) = complex.on_model(model, &sample, spacing);
    let count = sample.points.len().max(1) as f64;
    let mut topology = Topology {
        betti: complex.betti,
        persistent: complex.persistent,
        genus,
        handles: drawn
            .as_ref()
            .map_or(Handles::default(), |s| s.handles.clone()),
        boundary_share: complex.boundary.iter().filter(|b| **b).count() as f64 / count,
        boundary,
        missing: drawn.as_ref().map_or(1.0, missing_share),
        bare: drawn.as_ref().map_or(1.0, |s| s.bare),
        hidden: drawn.as_ref().map_or_else(Vec::new, |s| hidden(s, model)),
        unseen: drawn.as_ref().map_or_else(Vec::new, ClosedSurface::unseen),
        farthest: drawn.as_ref().map_or(f64::INFINITY, |s| s.farthest),
        wholly_seen: drawn.as_ref().is_some_and(ClosedSurface::is_wholly_seen),
        strays: drawn.as_ref().map_or(0.0, |s| s.strays.len() as f64) / model.len().max(1) as f64,
        loops,
        neck: drawn.as_ref().map_or_else(Vec::new, |s| neck(s, model)),
        bars: complex.bars,
        shorter_bars: complex.shorter_bars,
        cut: complex.cut,
        non_manifold: complex.non_manifold,
        simplices: complex.simplices,
        thinned,
        surface: None,
    };
    topology.surface = if topology.is_closed() {
        drawn
    } else {
        drawn.map(|s| s.trimmed())
    };
    Ok(topology)
}

/// Most bars of a dimension in [`Topology::bars`].
pub const MOST_BARS: usize = 100;

/// Length of the vector area of the supported surface as a share of its area: a lower bound on the missing share.
fn missing_share(surface: &ClosedSurface) -> f64 {
    let (mut vector, mut area) = (Vector3::zeros(), 0.0);
    for t in &surface.triangles {
        if !t.iter().all(|v| surface.is_supported(*v as usize)) {
            continue;
        }
        let [a, b, c] = t.map(|i| surface.vertices[i as usize]);
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

/// The vertices of the model along the most creased loop around a handle, if its crease is that of a contact.
fn neck(surface: &ClosedSurface, model: &CanonicalModel) -> Vec<u32> {
    let along = &surface.handles.creased_along;
    let Some(tree) = graph::tree(&model.rest).filter(|_| surface.handles.crease > CONTACT) else {
        return Vec::new();
    };
    let nearest = |p: &Point3<f64>| graph::nearest(&tree, p).0 as u32;
    let mut vertices: Vec<u32> = along.iter().map(nearest).collect();
    vertices.dedup();
    vertices
}

/// The triangles that no point supports, each with the nearest vertex of the model.
fn hidden(surface: &ClosedSurface, model: &CanonicalModel) -> Vec<Hidden> {
    let Some(tree) = graph::tree(&model.rest) else {
        return Vec::new();
    };
    let bare = surface.bare_triangles();
    let triangles = (0..bare.len()).filter(|&t| bare[t]);
    let corners = triangles.map(|t| surface.triangles[t].map(|v| surface.vertices[v as usize]));
    corners
        .map(|[a, b, c]| Hidden {
            vertex: graph::nearest(&tree, &((a + b.coords + c.coords) / 3.0)).0 as u32,
            area: (b - a).cross(&(c - a)) / 2.0,
        })
        .collect()
}
