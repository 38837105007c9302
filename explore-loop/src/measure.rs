//! The measures of the method (METHOD §10), against a ground truth that only this module sees.
//!
//! ```text
//! explored           share of the true surface's area within 2ε of the canonical model, at rest
//! shape difference   mean distance, canonical point → true surface, at rest
//! prediction error   mean distance, live position of an unseen vertex → where its material point is
//! ```

use crate::canonical::{CanonicalModel, graph};
use nalgebra::Point3;
use parry3d_f64::math::Vector as ParryVector;
use parry3d_f64::query::PointQueryWithLocation;
use parry3d_f64::shape::TriMesh;
use std::collections::BTreeMap;

/// A true surface at one moment: the same vertices in the same order at every moment.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TrueSurface {
    /// Vertices, camera frame, metres.
    pub vertices: Vec<Point3<f64>>,
    /// Triangles, outward.
    pub triangles: Vec<[u32; 3]>,
}

impl TrueSurface {
    /// Diagonal of the bounding box: the object's size, metres.
    pub fn size(&self) -> f64 {
        let low = self
            .vertices
            .iter()
            .fold(Point3::from([f64::INFINITY; 3]), |a, p| a.inf(p));
        let high = self
            .vertices
            .iter()
            .fold(Point3::from([f64::NEG_INFINITY; 3]), |a, p| a.sup(p));
        if self.vertices.is_empty() {
            0.0
        } else {
            (high - low).norm()
        }
    }

    /// Area, m².
    pub fn area(&self) -> f64 {
        crate::canonical::surface::vertex_areas(&self.vertices, &self.triangles)
            .iter()
            .sum()
    }
}

/// A place on a triangle of the true surface: follows the material.
#[derive(Debug, Clone, Copy)]
struct Anchor {
    triangle: usize,
    weights: [f64; 3],
}

/// Keeps the ground truth and compares models with it.
pub struct Measurer {
    rest: TrueSurface,
    areas: Vec<f64>,
    rest_mesh: TriMesh,
    anchors: BTreeMap<u64, Anchor>,
}

/// Shape of a model against the truth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ShapeMeasures {
    /// Share of the true area that is explored, 0 to 1.
    pub explored: f64,
    /// Mean distance from a canonical point to the true surface, metres.
    pub difference: f64,
    /// The same as a share of the object's size.
    pub relative: f64,
}

/// Why a truth cannot be measured against.
#[derive(Debug, thiserror::Error)]
#[error("the true surface cannot be measured against: {0}")]
pub struct MeasureError(String);

fn parry_mesh(surface: &TrueSurface) -> Result<TriMesh, MeasureError> {
    let vertices = surface
        .vertices
        .iter()
        .map(|p| ParryVector::new(p.x, p.y, p.z))
        .collect();
    TriMesh::new(vertices, surface.triangles.clone()).map_err(|e| MeasureError(format!("{e:?}")))
}

fn locate(mesh: &TriMesh, surface: &TrueSurface, point: &Point3<f64>) -> (f64, Anchor) {
    let query = ParryVector::new(point.x, point.y, point.z);
    let (projection, (triangle, location)) =
        mesh.project_local_point_and_get_location(query, false);
    let distance = (projection.point - query).length();
    let weights = location.barycentric_coordinates().unwrap_or([1.0 / 3.0; 3]);
    let triangle = (triangle as usize).min(surface.triangles.len().saturating_sub(1));
    (distance, Anchor { triangle, weights })
}

impl Measurer {
    /// Takes the true surface at the moment of the first observation.
    ///
    /// # Errors
    /// A surface without triangles, or with an index out of range.
    pub fn new(rest: TrueSurface) -> Result<Self, MeasureError> {
        if rest.triangles.is_empty() {
            return Err(MeasureError("it has no triangles".into()));
        }
        let rest_mesh = parry_mesh(&rest)?;
        let areas = crate::canonical::surface::vertex_areas(&rest.vertices, &rest.triangles);
        Ok(Self {
            rest,
            areas,
            rest_mesh,
            anchors: BTreeMap::new(),
        })
    }

    /// The true surface at rest.
    pub fn rest(&self) -> &TrueSurface {
        &self.rest
    }

    /// Explored share and shape difference of a model at `spacing`.
    pub fn shape(&self, model: &CanonicalModel, spacing: f64) -> ShapeMeasures {
        let Some(tree) = graph::tree(&model.rest) else {
            return ShapeMeasures {
                explored: 0.0,
                difference: 0.0,
                relative: 0.0,
            };
        };
        let near = |p: &Point3<f64>| graph::nearest(&tree, p).1 <= 2.0 * spacing;
        let seen: f64 = self
            .rest
            .vertices
            .iter()
            .zip(&self.areas)
            .filter(|(p, _)| near(p))
            .map(|(_, a)| a)
            .sum();
        let total: f64 = self.areas.iter().sum();
        let sum: f64 = model
            .rest
            .iter()
            .map(|p| locate(&self.rest_mesh, &self.rest, p).0)
            .sum();
        let difference = sum / model.len() as f64;
        ShapeMeasures {
            explored: seen / total,
            difference,
            relative: difference / self.rest.size(),
        }
    }

    /// Ties vertices that are new in `model` to the material under them, given the true surface now.
    ///
    /// # Errors
    /// A true surface without triangles, or with an index out of range.
    pub fn anchor(
        &mut self,
        model: &CanonicalModel,
        now: &TrueSurface,
    ) -> Result<(), MeasureError> {
        if model.ids.iter().all(|id| self.anchors.contains_key(id)) {
            return Ok(());
        }
        let mesh = parry_mesh(now)?;
        for (i, id) in model.ids.iter().enumerate() {
            if !self.anchors.contains_key(id) {
                self.anchors
                    .insert(*id, locate(&mesh, now, &model.live[i]).1);
            }
        }
        Ok(())
    }

    /// Distance of each vertex's live position to where its material point is, metres.
    pub fn live_errors(&self, model: &CanonicalModel, now: &TrueSurface) -> Vec<f64> {
        model
            .ids
            .iter()
            .zip(&model.live)
            .map(|(id, live)| self.true_place(*id, now).map_or(0.0, |p| (p - live).norm()))
            .collect()
    }

    /// Mean of [`Self::live_errors`] over the vertices that `seen` does not mark; `None` when all are seen.
    pub fn prediction_error(
        &self,
        model: &CanonicalModel,
        seen: &[bool],
        now: &TrueSurface,
    ) -> Option<f64> {
        let errors = self.live_errors(model, now);
        let hidden: Vec<f64> = errors
            .iter()
            .zip(seen)
            .filter(|(_, s)| !**s)
            .map(|(e, _)| *e)
            .collect();
        (!hidden.is_empty()).then(|| hidden.iter().sum::<f64>() / hidden.len() as f64)
    }

    fn true_place(&self, id: u64, now: &TrueSurface) -> Option<Point3<f64>> {
        let anchor = self.anchors.get(&id)?;
        let corners = self.rest.triangles[anchor.triangle].map(|i| now.vertices.get(i as usize));
        let mut place = nalgebra::Vector3::zeros();
        for (corner, weight) in corners.into_iter().zip(anchor.weights) {
            place += corner?.coords * weight;
        }
        Some(Point3::from(place))
    }
}

impl TrueSurface {
    /// A surface through the points of a true surface whose triangles were not recorded: normals by principal components,
    /// oriented alike over the nearest neighbours from the point nearest to the camera on, then local triangulation.
    ///
    /// # Errors
    /// Fewer than four points, or points no surface can be laid through.
    pub fn from_points(points: &[Point3<f64>]) -> Result<Self, MeasureError> {
        let normals = consistent_normals(points)?;
        let triangles =
            crate::canonical::surface::triangulate(points, &normals, 1.6 * median_spacing(points));
        Ok(Self {
            vertices: points.to_vec(),
            triangles,
        })
    }
}

/// Median distance to the third nearest neighbour: robust where vertices are paired.
fn median_spacing(points: &[Point3<f64>]) -> f64 {
    let Some(tree) = graph::tree(points) else {
        return 0.0;
    };
    let mut distances: Vec<f64> = points
        .iter()
        .filter_map(|p| {
            graph::near(&tree, p, f64::INFINITY, 4)
                .last()
                .map(|(_, d)| *d)
        })
        .collect();
    distances.sort_by(f64::total_cmp);
    distances.get(distances.len() / 2).copied().unwrap_or(0.0)
}

/// Principal-component normals, turned outward from the point nearest to the camera along the strongest links first.
fn consistent_normals(
    points: &[Point3<f64>],
) -> Result<Vec<nalgebra::UnitVector3<f64>>, MeasureError> {
    let mut normals = nonrigid_reg::estimate_normals(points, 9, &Point3::origin())
        .map_err(|e| MeasureError(e.to_string()))?;
    let tree = graph::tree(points).ok_or_else(|| MeasureError("it has no points".into()))?;
    let root = (0..points.len())
        .min_by(|a, b| points[*a].z.total_cmp(&points[*b].z))
        .unwrap_or(0);
    let mut done = vec![false; points.len()];
    done[root] = true;
    // A link is the stronger the more parallel its normals: crossing a rim comes last.
    let mut links = std::collections::BTreeSet::new();
    let leave = |i: usize,
                 done: &[bool],
                 normals: &[nalgebra::UnitVector3<f64>],
                 links: &mut std::collections::BTreeSet<(u64, usize, usize)>| {
        for (j, _) in graph::near(&tree, &points[i], f64::INFINITY, 9) {
            if !done[j] {
                let weakness = 1.0 - normals[i].dot(&normals[j]).abs();
                links.insert(((weakness * 1e9) as u64, i, j));
            }
        }
    };
    leave(root, &done, &normals, &mut links);
    while let Some((_, from, to)) = links.pop_first() {
        if done[to] {
            continue;
        }
        done[to] = true;
        if normals[from].dot(&normals[to]) < 0.0 {
            normals[to] = -normals[to];
        }
        leave(to, &done, &normals, &mut links);
    }
    Ok(normals)
}
