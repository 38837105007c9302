//! The vertices of the model: points of the canonical surface that keep their identity while the surface is refined.
//!
//! A level set is extracted anew after every frame. To follow material points, points about one spacing apart are kept: each is projected along its
//! normal onto the new surface and removed when there is no surface near it; new points are added where none is near.

use super::solve::SurfacePoint;
use super::warp::Warp;
use crate::canonical::{CanonicalModel, NewVertex, graph};
use crate::reconstruct::RestSurface;
use nalgebra::{Point3, UnitVector3};

/// Least distance between added vertices, in spacings.
const APART: f64 = 0.85;
/// Farthest distance of the surface from one of its vertices, in spacings.
const GONE: f64 = 0.8;
/// Least cosine between normals of the same sheet.
const ALIKE: f64 = 0.3;

/// Updates the rest positions of `model` to the surface; returns how many vertices were added.
pub(super) fn follow_surface(
    model: &mut CanonicalModel,
    surface: &RestSurface,
    spacing: f64,
    frame: u32,
) -> usize {
    let Some(tree) = graph::tree(&surface.vertices) else {
        return 0;
    };
    let mut stays = vec![false; model.len()];
    for i in 0..model.len() {
        let normal = model.rest_normals()[i];
        let alike = graph::near(&tree, &model.rest()[i], GONE * spacing, 16)
            .into_iter()
            .find(|(v, _)| surface.normals[*v].dot(&normal) > ALIKE);
        if let Some((v, _)) = alike {
            let onto = surface.normals[v];
            let off = onto.dot(&(surface.vertices[v] - model.rest()[i]));
            let place = model.rest()[i] + onto.into_inner() * off;
            model.move_at_rest(i, place, onto);
            stays[i] = true;
        }
    }
    if stays.contains(&false) {
        model.retain(&stays);
    }
    let fresh = missing(model, surface, spacing);
    let added = fresh.len();
    for vertex in fresh {
        model.push(vertex, frame);
    }
    added
}

/// Points of the surface with no vertex of their sheet near them, spaced apart.
fn missing(model: &CanonicalModel, surface: &RestSurface, spacing: f64) -> Vec<NewVertex> {
    let known = graph::tree(model.rest());
    let taken = |p: &Point3<f64>, n: &UnitVector3<f64>| {
        known.as_ref().is_some_and(|tree| {
            graph::near(tree, p, APART * spacing, 12)
                .iter()
                .any(|(i, _)| model.rest_normals()[*i].dot(n) > ALIKE)
        })
    };
    let mut fresh: Vec<NewVertex> = Vec::new();
    for (p, n) in surface.vertices.iter().zip(&surface.normals) {
        let beside =
            |f: &NewVertex| (f.rest - p).norm() < APART * spacing && f.rest_normal.dot(n) > ALIKE;
        if !taken(p, n) && !fresh.iter().any(beside) {
            fresh.push(NewVertex::new(*p, *n));
        }
    }
    fresh
}

/// Moves the vertices with the warp.
pub(super) fn pose(model: &mut CanonicalModel, warp: &Warp) {
    for i in 0..model.len() {
        if let Some(skin) = warp.skin(&model.rest()[i]) {
            let blend = warp.blend(&skin);
            model.live_mut()[i] = blend.apply(&model.rest()[i]);
            model.rotations_mut()[i] = *blend.rotation().to_rotation_matrix().matrix();
        }
    }
}

/// Points of a surface with the nodes that move them.
pub(super) fn skinned(
    points: &[Point3<f64>],
    normals: &[UnitVector3<f64>],
    warp: &Warp,
) -> Vec<SurfacePoint> {
    let both = points.iter().zip(normals);
    both.filter_map(|(rest, normal)| {
        Some(SurfacePoint {
            rest: *rest,
            normal: *normal,
            skin: warp.skin(rest)?,
        })
    })
    .collect()
}
