//! The cylinder-Čech complex of an even sample of the surface, and what is read off it.
//!
//! ```text
//! joined(p, q)  ⇒  way along the surface from p to q ≤ 2 · 1.25 · radius
//! ```
//! **Points are joined along the surface**, if their cylinders meet. What is near in space alone stays apart (the two sides of a thin body, fingers that
//! touch, parts that were separated), and the sides of a sharp crease or edge are joined, where a limit on the angle between normals would tear them apart. Only
//! where no surface could be computed that limit serves, and edges of the model that were cut are cut in the complex.

use super::closed_surface::ClosedSurface;
use super::topology::MOST_BARS;
use super::{CanonicalModel, graph};
use cech_complex::{Bar, Complex, Cylinder, Options, Orientation, VertexKind};
use nalgebra::{Point3, UnitVector3};

/// Cylinder radius, in spacings of the complex: neighbouring discs overlap well beyond the largest gap in a maximal sample at the
/// spacing.
const RADIUS: f64 = 1.45;
/// Cylinder height, in spacings of the complex: the curvature of the surface over a disc, plus registration errors.
const HEIGHT: f64 = 2.0;
/// Persistent classes live from scale 1 to this scale.
const PERSISTS: f64 = 1.25;
/// Longest way along the surface between two points that can be joined, in spacings of the complex: two radii of the cylinders at the largest scale. Two radii at scale 1
/// are too few, because ways along edges are longer than straight ones: points at the boundary of a patch are then joined to no other (test `sessions`).
const ALONG: f64 = 2.0 * RADIUS * PERSISTS;
/// Points whose normals differ by more than 107 degrees belong to two sheets.
const SHEET_COSINE: f64 = -0.3;

/// Most simplices of a complex: about 2 GB.
pub(super) const MOST_SIMPLICES: usize = 20_000_000;
/// Factor by which the points are spread farther apart when there are too many simplices.
const SPARSER: f64 = 1.2;
/// Spacing of the points, in spacings of the model, from which on they are simply halved.
const FARTHEST_APART: f64 = 1e3;

/// The complex is built for points this much finer than the spacing of the model: the closed surface can be sampled at any density, and at the
/// spacing of the model the web between a thumb and a hand would be bridged.
const FINE: f64 = 0.6;

/// Spacing of the sample that the complex is built on, in those finer spacings.
const SAMPLE: f64 = 0.8;

/// An even sample of the seen part of the surface, or the vertices of the model where there is no surface.
pub(super) struct Sample {
    pub points: Vec<Point3<f64>>,
    pub normals: Vec<UnitVector3<f64>>,
    /// Spacing that the complex is built for, m.
    spacing: f64,
}

impl Sample {
    /// For a model with this spacing, m.
    pub fn of(model: &CanonicalModel, drawn: Option<&ClosedSurface>, spacing: f64) -> Self {
        let (points, normals) = drawn.map_or_else(
            || (model.rest.clone(), model.rest_normals.clone()),
            |surface| surface.resample(SAMPLE * FINE * spacing),
        );
        Self {
            points,
            normals,
            spacing: FINE * spacing,
        }
    }

    /// The complex of as many of the points as possible. Where too many lie close together they are replaced by a Poisson-disc subset, whose
    /// radius grows until the complex is small enough (at worst one point remains); the cylinders grow with it once the points are farther apart
    /// than those of a sample.
    pub fn read(
        mut self,
        model: &CanonicalModel,
        drawn: Option<&ClosedSurface>,
        most: usize,
    ) -> Result<(Self, Read), cech_complex::Error> {
        let finest = self.spacing;
        let mut apart = 0.5 * finest;
        loop {
            match self.complex(model, drawn, most) {
                Err(cech_complex::Error::TooManySimplices { .. }) if self.points.len() > 1 => {
                    let mut kept = spread(&self.points, &self.normals, apart);
                    // Sheets that face away from each other are never merged by thinning.
                    if apart > FARTHEST_APART * finest {
                        kept.truncate(kept.len() / 2);
                    }
                    self.points = kept.iter().map(|&i| self.points[i]).collect();
                    self.normals = kept.iter().map(|&i| self.normals[i]).collect();
                    self.spacing = self.spacing.max(apart / SAMPLE);
                    apart *= SPARSER;
                }
                other => {
                    let (complex, cut) = other?;
                    let read = Read::of(&complex, cut, self.spacing)?;
                    return Ok((self, read));
                }
            }
        }
    }

    /// The complex of at most so many simplices, and what cuts have removed from it: vertices, edges, triangles.
    fn complex(
        &self,
        model: &CanonicalModel,
        drawn: Option<&ClosedSurface>,
        most: usize,
    ) -> Result<(Complex, [usize; 3]), cech_complex::Error> {
        let (points, normals) = (&self.points, &self.normals);
        let cylinder = Cylinder::new(RADIUS * self.spacing, HEIGHT * self.spacing)?;
        let options = Options::default()
            .with_max_scale(PERSISTS)
            .with_max_simplices(most);
        if let Some(surface) = drawn {
            let pairs = surface.pairs_along(points, normals, ALONG * self.spacing);
            let options = options.with_orientation(Orientation::Free);
            let complex = Complex::build_among(points, normals, cylinder, &options, &pairs)?;
            return Ok((complex, [0; 3]));
        }
        let min_cosine = SHEET_COSINE;
        let options = options.with_orientation(Orientation::Separate { min_cosine });
        let mut complex = Complex::build(points, normals, cylinder, &options)?;
        let removed = complex.cut(&cuts(model, points))?;
        let removed = [removed.vertices.len(), removed.edges, removed.triangles];
        Ok((complex, removed))
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

/// The cut edges of the model, as pairs of the nearest points of the sample.
fn cuts(model: &CanonicalModel, points: &[Point3<f64>]) -> Vec<[u32; 2]> {
    let Some(tree) = graph::tree(points) else {
        return Vec::new();
    };
    let nearest = |v: u32| graph::nearest(&tree, &model.rest[v as usize]).0 as u32;
    let edges = model.cut_edges();
    let moved = edges.iter().map(|[a, b]| [nearest(*a), nearest(*b)]);
    moved.filter(|[a, b]| a != b).collect()
}

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

/// The results for the complex of some points.
pub(super) struct Read {
    pub betti: [usize; 3],
    pub persistent: [usize; 3],
    pub bars: Vec<Bar>,
    pub shorter_bars: [usize; 3],
    pub boundary: Vec<bool>,
    pub loops: Vec<Vec<u32>>,
    pub cut: [usize; 3],
    pub non_manifold: usize,
    pub simplices: [usize; 4],
}

impl Read {
    fn of(complex: &Complex, cut: [usize; 3], spacing: f64) -> Result<Self, cech_complex::Error> {
        let kinds = complex.classify(spacing)?;
        let count = |kind| kinds.iter().filter(|k| **k == kind).count();
        let loops = complex.boundary_loops(&kinds)?;
        let (bars, shorter_bars) = longest_bars(complex);
        Ok(Self {
            bars,
            shorter_bars,
            betti: complex.betti(1.0),
            persistent: complex.persistent_betti(1.0, PERSISTS),
            boundary: kinds.iter().map(|k| *k == VertexKind::Boundary).collect(),
            loops: loops.into_iter().map(|l| l.vertices).collect(),
            non_manifold: count(VertexKind::NonManifold),
            cut,
            simplices: complex.counts(),
        })
    }

    /// Boundary and loops as vertices of the model.
    pub fn on_model(
        &self,
        model: &CanonicalModel,
        Sample {
            points, normals, ..
        }: &Sample,
        spacing: f64,
    ) -> (Vec<bool>, Vec<Vec<u32>>) {
        let mut boundary = vec![false; model.len()];
        let Some(tree) = graph::tree(&model.rest) else {
            return (boundary, Vec::new());
        };
        // Vertices within the disc radius of a complex at the model's own spacing count: the part that can be gripped there is wider than one row of vertices.
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
