//! Topology of the canonical model, and whether its surface is closed.
//!
//! ```text
//! points ─► closed surface ─► even sample of what of it was seen ─► cylinder-Čech complex ─► persistent Betti numbers
//! closed  ⇔  (1, 2g, 1)  and  g handles  and  wholly seen  and  no strays  and  no vector area  and  no boundary
//! ```
//! The points themselves are uneven, and crowd or gape at sharp margins; the closed surface through them is even. It is always
//! closed, so it proves nothing alone: only what lies within reach of a point that faces alike enters the complex. *Bare* is the share of
//! its area that does not, *wholly seen* that what is bare is chance gaps between points, nowhere farther
//! from them than 1.75 spacings; *strays* are points that lie off it: a second sheet. The complex is oriented: sheets that face away from each
//! other are not joined. The genus `g` is that of the object unless one is asked for ([`super::genus`]).

use super::closed_surface::{ClosedSurface, ClosedSurfaceOptions, Unseen, closed_surface};
use super::genus::{CONTACT, Genus, Handles};
use super::{CanonicalModel, graph};
use cech_complex::{Bar, Complex, Cylinder, Options, Orientation, VertexKind};
use nalgebra::{Point3, UnitVector3, Vector3};

/// Cylinder radius, in spacings of the complex: discs of neighbours overlap well beyond the largest gap a maximal net of the
/// spacing leaves.
const RADIUS: f64 = 1.45;
/// Cylinder height, in spacings of the complex: the bulge of the surface over a disc, plus what registration left.
const HEIGHT: f64 = 2.0;
/// Classes must live from scale 1 to this one.
const PERSISTS: f64 = 1.25;
/// Normals that differ more than 107 degrees are two sheets.
const SHEET_COSINE: f64 = -0.3;

/// What the surface and the complex say of the model.
#[derive(Debug, Clone, PartialEq)]
pub struct Topology {
    /// Betti numbers of the complex at scale 1.
    pub betti: [usize; 3],
    /// Persistent Betti numbers from scale 1 to the larger one.
    pub persistent: [usize; 3],
    /// The genus that was asked for.
    pub genus: Genus,
    /// Handles of the closed surface that was drawn.
    pub handles: Handles,
    /// Which vertices of the model lie on the boundary of what was seen.
    pub boundary: Vec<bool>,
    /// Share of the sample of the surface that lies on its boundary.
    pub boundary_share: f64,
    /// Vector area of the surface that was seen as a share of its area: a lower bound on what is missing.
    pub missing: f64,
    /// Share of the closed surface that no point supports; 1 when no surface could be drawn.
    pub bare: f64,
    /// The pieces of it that no point supports.
    pub hidden: Vec<Hidden>,
    /// The places that were never seen, at rest, the largest first; none when it was wholly seen, or when no surface could be drawn.
    pub unseen: Vec<Unseen>,
    /// Distance of the innermost of those from anything that was seen, m; infinite when no surface could be drawn.
    pub farthest: f64,
    /// Whether what no point supports is chance gaps alone ([`ClosedSurface::is_wholly_seen`]).
    pub wholly_seen: bool,
    /// Share of the points that lie off the surface: a second sheet, or strays.
    pub strays: f64,
    /// Bars of the persistent homology of the complex, by dimension, then birth: the longest [`MOST_BARS`] of each dimension. Scales are those of
    /// [`cech_complex`]: at 1 the cylinders have the radius and the height that the spacing gives; the complex ends at scale 1.25.
    pub bars: Vec<Bar>,
    /// How many bars of each dimension are shorter than those.
    pub shorter_bars: [usize; 3],
    /// Boundary loops, vertices of the model in order.
    pub loops: Vec<Vec<u32>>,
    /// Simplices that the cuts removed: vertices, edges, triangles.
    pub cut: [usize; 3],
    /// Number of non-manifold points in the sample of the surface.
    pub non_manifold: usize,
    /// Simplices of each dimension.
    pub simplices: [usize; 4],
    /// Points of the sample that were left out because the complex would have become too large: what remains is a subset whose points are
    /// farther apart.
    pub thinned: usize,
    /// The surface: closed when the object is, otherwise open where nothing was seen; `None` when none could be drawn.
    pub surface: Option<ClosedSurface>,
}

/// A triangle of the closed surface that no point supports.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hidden {
    /// Nearest vertex of the model.
    pub vertex: u32,
    /// Vector area at rest, m².
    pub area: Vector3<f64>,
}

impl Topology {
    /// Whether the surface is that of a solid body, wholly seen, with as many handles as were asked for.
    ///
    /// The Betti numbers alone would be fooled by a blister: a doubled patch encloses a cavity of its own while the rest of the surface is
    /// still open. A closed surface has no vector area (`Σ area·n = 0`), next to no boundary, no bare part and nothing beside it; the
    /// bounds leave room for what noise does to single points.
    pub fn is_closed(&self) -> bool {
        self.obstacle().is_none()
    }

    /// Whether the Betti numbers at the scale of the complex, (1, 2g, 1), are those of a closed surface of the genus asked for. Necessary, and alone
    /// easily fooled: see [`Self::is_closed`].
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
        } else if self.handles.crease > CONTACT {
            Some(Obstacle::Contact(self.handles.crease))
        } else if !self.wholly_seen {
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

    /// At how many contacts parts that touch were parted.
    pub fn contacts(&self) -> usize {
        self.surface.as_ref().map_or(0, |s| s.contacts.len())
    }

    /// Share of the sample of the surface that lies on its boundary.
    pub fn boundary_share(&self) -> f64 {
        self.boundary_share
    }
}

/// What keeps a surface from counting as closed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Obstacle {
    /// Its persistent Betti numbers are not those of a closed surface, or not of the genus asked for.
    Betti([usize; 3]),
    /// The complex of the points has another genus than the surface that was drawn through them.
    Handles {
        /// Handles of the complex.
        complex: usize,
        /// Handles of the surface.
        mesh: usize,
    },
    /// Two parts touch, and have not been parted: the surface is creased by this angle, rad, all around where they do.
    Contact(f64),
    /// Some of it was never seen.
    Bare {
        /// Share of the area.
        share: f64,
        /// Distance of its innermost place from anything that was seen, m.
        farthest: f64,
    },
    /// So many points lie off it.
    Strays(f64),
    /// So much of it lies on a boundary.
    Boundary(f64),
    /// So much vector area is missing.
    Missing(f64),
}

impl std::fmt::Display for Obstacle {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let percent = |share: f64| 100.0 * share;
        match self {
            Self::Betti([b0, b1, b2]) => write!(f, "Betti numbers ({b0}, {b1}, {b2})"),
            Self::Handles { complex, mesh } => write!(
                f,
                "handles of the points ({complex}) and of the surface through them ({mesh}) differ"
            ),
            Self::Contact(angle) => write!(
                f,
                "parts that touch are not parted: a crease of {:.0}° around a handle",
                angle.to_degrees()
            ),
            Self::Bare { share, farthest } => write!(
                f,
                "{:.2} % never seen, up to {:.1} mm from what was",
                percent(*share),
                1e3 * farthest
            ),
            Self::Strays(share) => {
                write!(f, "{:.1} % of the points off the surface", percent(*share))
            }
            Self::Boundary(share) => write!(f, "{:.1} % on a boundary", percent(*share)),
            Self::Missing(share) => write!(f, "{:.1} % of vector area missing", percent(*share)),
        }
    }
}

/// Largest vector area of a surface taken for closed, as a share of its area.
const MOST_MISSING: f64 = 0.03;
/// Largest share of boundary points of a surface taken for closed.
const MOST_BOUNDARY: f64 = 0.01;
/// Largest share of points off a surface taken for closed.
const MOST_STRAYS: f64 = 0.03;

/// Draws the surface of the rest positions, builds the complex of what of it was seen, and reads it.
///
/// # Errors
/// Non-finite positions.
pub fn analyse(model: &CanonicalModel, spacing: f64) -> Result<Topology, cech_complex::Error> {
    analyse_as(model, spacing, Genus::Any)
}

/// As [`analyse`], for a surface that is closed only with this genus.
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

/// As [`analyse`], with a complex of at most `most` simplices: with more, the sample is thinned ([`Topology::thinned`]) and read at a coarser
/// scale, in which holes of less than two of its spacings do not show.
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
    let options = ClosedSurfaceOptions::new(spacing).with_genus(genus);
    let drawn = closed_surface(&model.rest, &model.rest_normals, &weights, &options).ok();
    let (points, normals) = drawn.as_ref().map_or_else(
        || (model.rest.clone(), model.rest_normals.clone()),
        |surface| surface.resample(SAMPLE * FINE * spacing),
    );
    let sampled = points.len();
    let (points, normals, complex) =
        read(model, drawn.as_ref(), points, normals, FINE * spacing, most)?;
    let thinned = sampled - points.len();
    let (boundary, loops) = complex.on_model(model, &points, &normals, spacing);
    let count = points.len().max(1) as f64;
    let mut topology = Topology {
        betti: complex.betti,
        persistent: complex.persistent,
        genus,
        handles: drawn.as_ref().map_or(Handles::default(), |s| s.handles),
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

/// The longest bars of each dimension, and how many are left out.
fn longest_bars(complex: &Complex) -> (Vec<Bar>, [usize; 3]) {
    let (mut kept, mut shorter) = (Vec::new(), [0; 3]);
    for (dimension, left_out) in shorter.iter_mut().enumerate() {
        let all = complex.barcode().of_dimension(dimension);
        let mut bars: Vec<(usize, Bar)> = all.copied().enumerate().collect();
        bars.sort_by(|(_, a), (_, b)| b.persistence().total_cmp(&a.persistence()));
        *left_out = bars.len().saturating_sub(MOST_BARS);
        bars.truncate(MOST_BARS);
        bars.sort_by_key(|(place, _)| *place);
        kept.extend(bars.into_iter().map(|(_, bar)| bar));
    }
    (kept, shorter)
}

/// Most simplices of a complex: about 2 GB.
const MOST_SIMPLICES: usize = 20_000_000;
/// How much farther apart the points of the next subset are when there were too many simplices.
const SPARSER: f64 = 1.2;
/// Distance of the points, in spacings, from which on they are halved whatever they show.
const FARTHEST_APART: f64 = 1e3;

/// The complex of as many of the points as it can be built on. Where too many lie close together a Poisson-disc subset takes their place, its
/// radius growing until the complex is small enough (in the end a single point is), and its cylinders with it once the points lie farther apart
/// than those of a sample.
#[allow(
    clippy::type_complexity,
    reason = "the points that were kept belong to the complex"
)]
fn read(
    model: &CanonicalModel,
    drawn: Option<&ClosedSurface>,
    mut points: Vec<Point3<f64>>,
    mut normals: Vec<UnitVector3<f64>>,
    spacing: f64,
    most: usize,
) -> Result<(Vec<Point3<f64>>, Vec<UnitVector3<f64>>, Read), cech_complex::Error> {
    let (mut apart, mut sparse) = (0.5 * spacing, spacing);
    loop {
        let mut cuts = cuts(model, &points);
        // As far as cylinders that face alike share a point at the largest scale.
        let reach = 2.0 * RADIUS * PERSISTS * sparse;
        cuts.extend(drawn.iter().flat_map(|s| s.glue(&points, &normals, reach)));
        match Read::new(&points, &normals, &cuts, sparse, most) {
            Err(cech_complex::Error::TooManySimplices { .. }) if points.len() > 1 => {
                let mut kept = spread(&points, &normals, apart);
                // Sheets that face away from each other are never thinned into one.
                if apart > FARTHEST_APART * spacing {
                    kept.truncate(kept.len() / 2);
                }
                points = kept.iter().map(|&i| points[i]).collect();
                normals = kept.iter().map(|&i| normals[i]).collect();
                sparse = sparse.max(apart / SAMPLE);
                apart *= SPARSER;
            }
            other => return Ok((points, normals, other?)),
        }
    }
}

/// A maximal subset of points that are at least `apart` from each other, or belong to sheets that face away from each other.
// Not `cech_complex::epsilon_net`, which knows no normals and would thin two sheets into one.
fn spread(points: &[Point3<f64>], normals: &[UnitVector3<f64>], apart: f64) -> Vec<usize> {
    let place = |p: &Point3<f64>| [p.x, p.y, p.z].map(|c| (c / apart).floor() as i64);
    let mut kept = Vec::new();
    let mut at = std::collections::BTreeMap::<[i64; 3], Vec<usize>>::new();
    for (i, p) in points.iter().enumerate() {
        let [x, y, z] = place(p);
        let mut around =
            (-1..=1).flat_map(|a| (-1..=1).flat_map(move |b| (-1..=1).map(move |c| [a, b, c])));
        let taken = around.any(|[a, b, c]| {
            let there = at.get(&[x + a, y + b, z + c]).into_iter().flatten();
            there.into_iter().any(|&k: &usize| {
                (points[k] - p).norm() < apart && normals[k].dot(&normals[i]) > SHEET_COSINE
            })
        });
        if !taken {
            kept.push(i);
            at.entry([x, y, z]).or_default().push(i);
        }
    }
    kept
}

/// The complex is built as for points of a spacing so many times finer than that of the model: the surface is known everywhere, and at the model's
/// own scale the crotch of a thumb is glued.
const FINE: f64 = 0.6;

/// Spacing of the sample that the complex is built on, in those finer spacings.
const SAMPLE: f64 = 0.8;

/// Length of the vector area of the supported surface as a share of its area: a lower bound on the share that is missing.
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

/// The triangles that no point supports, each with the vertex of the model next to it.
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

/// The cut edges of the model between the nearest points of the sample.
fn cuts(model: &CanonicalModel, points: &[Point3<f64>]) -> Vec<[u32; 2]> {
    let Some(tree) = graph::tree(points) else {
        return Vec::new();
    };
    let nearest = |v: u32| graph::nearest(&tree, &model.rest[v as usize]).0 as u32;
    let edges = model.cut_edges();
    let moved = edges.iter().map(|[a, b]| [nearest(*a), nearest(*b)]);
    moved.filter(|[a, b]| a != b).collect()
}

/// What the complex of some points says.
struct Read {
    betti: [usize; 3],
    persistent: [usize; 3],
    bars: Vec<Bar>,
    shorter_bars: [usize; 3],
    boundary: Vec<bool>,
    loops: Vec<Vec<u32>>,
    cut: [usize; 3],
    non_manifold: usize,
    simplices: [usize; 4],
}

impl Read {
    fn new(
        points: &[Point3<f64>],
        normals: &[UnitVector3<f64>],
        cuts: &[[u32; 2]],
        spacing: f64,
        most: usize,
    ) -> Result<Self, cech_complex::Error> {
        let cylinder = Cylinder::new(RADIUS * spacing, HEIGHT * spacing)?;
        let options = Options::default()
            .with_max_scale(PERSISTS)
            .with_orientation(Orientation::Separate {
                min_cosine: SHEET_COSINE,
            })
            .with_max_simplices(most);
        let mut complex = Complex::build(points, normals, cylinder, &options)?;
        let removed = complex.cut(cuts)?;
        let kinds = complex.classify(spacing)?;
        let count = |kind| kinds.iter().filter(|k| **k == kind).count();
        let loops = complex.boundary_loops(&kinds)?;
        let (bars, shorter_bars) = longest_bars(&complex);
        Ok(Self {
            bars,
            shorter_bars,
            betti: complex.betti(1.0),
            persistent: complex.persistent_betti(1.0, PERSISTS),
            boundary: kinds.iter().map(|k| *k == VertexKind::Boundary).collect(),
            loops: loops.into_iter().map(|l| l.vertices).collect(),
            non_manifold: count(VertexKind::NonManifold),
            cut: [removed.vertices.len(), removed.edges, removed.triangles],
            simplices: complex.counts(),
        })
    }

    /// Boundary and loops in terms of the vertices of the model.
    fn on_model(
        &self,
        model: &CanonicalModel,
        points: &[Point3<f64>],
        normals: &[UnitVector3<f64>],
        spacing: f64,
    ) -> (Vec<bool>, Vec<Vec<u32>>) {
        let mut boundary = vec![false; model.len()];
        let Some(tree) = graph::tree(&model.rest) else {
            return (boundary, Vec::new());
        };
        // As far from the rim as the discs of a complex of the model's own spacing would reach: what can be gripped there is not one row of vertices.
        let reach = (1.0 + (1.0 - FINE) * RADIUS) * spacing;
        for i in (0..points.len()).filter(|&i| self.boundary[i]) {
            for (v, _) in graph::near(&tree, &points[i], reach, 24) {
                boundary[v] |= model.rest_normals[v].dot(&normals[i]) > 0.0;
            }
        }
        let nearest = |i: &u32| graph::nearest(&tree, &points[*i as usize]).0 as u32;
        let loops = self.loops.iter().map(|l| {
            let mut vertices: Vec<u32> = l.iter().map(nearest).collect();
            vertices.dedup();
            vertices
        });
        (boundary, loops.collect())
    }
}
