//! Growth of the model at rest, by points that no vertex explains.
//!
//! A point of the cloud is added when no vertex of its sheet is near it but measured surface is, and its position at rest is free: no vertex of
//! the same sheet beside it, and none in front or behind it along its normal (that would be known surface, tracked wrongly). Points below the
//! table, or where the first view saw through, are rejected.

use super::track::Track;
use super::view::FrameView;
use crate::canonical::{NewVertex, graph, tangent};
use crate::cell::Plane;
use crate::visibility::{DepthGrid, facing};
use nalgebra::{Point3, UnitVector3, Vector3};

/// Least facing of an added point.
const FACING: f64 = 0.3;
/// A vertex of the sheet this close explains a point, in spacings.
const EXPLAINS: f64 = 0.7;
/// Least distance between added vertices, in spacings.
const APART: f64 = 0.85;
/// The same where the sheet already surrounds the position.
const APART_WITHIN: f64 = 1.4;
/// Widest angle between neighbours of a position in the interior of the sheet, radians.
const WITHIN: f64 = 140.0 / 180.0 * std::f64::consts::PI;
/// A vertex of the same sheet less than [`BESIDE`] to the side and [`BEFORE`] in front or behind is the same surface, in spacings.
const BESIDE: f64 = 0.7;
const BEFORE: f64 = 3.0;
/// Largest distance of a point outside of the lattice, in cells.
const OUTSIDE: f64 = 0.5;
/// Largest depth below the table from which a point is moved onto it, metres.
const SUNK: f64 = 0.008;

/// The new vertices of a frame.
pub(crate) fn grown(
    track: &Track,
    view: &FrameView,
    seen: &[bool],
    first: &DepthGrid,
    table: &Plane,
    spacing: f64,
) -> Vec<NewVertex> {
    let model = &track.model;
    let (Some(live), Some(rest)) = (graph::tree(model.live()), graph::tree(model.rest())) else {
        return Vec::new();
    };
    let normals = model.live_normals();
    let cells = track.cell_tree();
    let eye = view.eye();
    let mut fresh: Vec<NewVertex> = Vec::new();
    for (point, normal) in view.points.iter().zip(&view.normals) {
        if facing(point, normal, &eye) < FACING {
            continue;
        }
        let around = graph::near(&live, point, 2.2 * spacing, 30);
        let nearest = around.iter().find(|(i, _)| normals[*i].dot(normal) > 0.0);
        if nearest.is_some_and(|(_, d)| *d < EXPLAINS * spacing) {
            continue;
        }
        if !around
            .iter()
            .any(|(i, _)| seen[*i] && normals[*i].dot(normal) > 0.3)
        {
            continue;
        }
        if fresh
            .iter()
            .any(|f| (f.live - point).norm() < APART * spacing)
        {
            continue;
        }
        let Some(at) = track
            .to_rest(point, cells.as_ref())
            .filter(|a| a.outside <= OUTSIDE)
        else {
            continue;
        };
        let rest_normal = UnitVector3::new_normalize(at.gradient.transpose() * normal.into_inner());
        let mut place = at.position;
        if known(track, &rest, &place, &rest_normal, spacing) {
            continue;
        }
        let height = table.height(&place);
        if height < -SUNK {
            continue;
        }
        place -= table.normal.into_inner() * height.min(0.0);
        if first.behind(&place).is_some_and(|d| -d > spacing) {
            continue;
        }
        let taken = |f: &NewVertex| {
            (f.rest - place).norm() < 0.8 * spacing && f.rest_normal.dot(&rest_normal) > 0.3
        };
        if fresh.iter().any(taken) {
            continue;
        }
        fresh.push(NewVertex {
            rest: place,
            rest_normal,
            live: table.above(point),
            rotation: *track.body.pose().turns[at.cell as usize].matrix(),
        });
    }
    fresh
}

/// Whether surface of the same sheet is known at a position at rest, or directly in front or behind.
fn known(
    track: &Track,
    rest: &graph::Tree,
    place: &Point3<f64>,
    normal: &UnitVector3<f64>,
    spacing: f64,
) -> bool {
    let model = &track.model;
    let close = graph::near(rest, place, BEFORE * spacing, 80);
    let directions: Vec<Vector3<f64>> = close
        .iter()
        .filter(|(i, d)| *d < 2.0 * spacing && model.rest_normals()[*i].dot(normal) > 0.0)
        .map(|(i, _)| model.rest()[*i] - place)
        .collect();
    let within = tangent::widest_gap(normal, directions.into_iter()) < WITHIN;
    let room = spacing * if within { APART_WITHIN } else { APART };
    close.iter().any(|(i, d)| {
        let agree = model.rest_normals()[*i].dot(normal);
        let offset = model.rest()[*i] - place;
        agree > 0.3
            && (*d < room
                || (agree > 0.5
                    && tangent::aside(normal, &offset) < BESIDE * spacing
                    && normal.dot(&offset).abs() < BEFORE * spacing))
    })
}
