//! Merging a frame: which of its points extend the model, and where they lie at rest.
//!
//! ```text
//! new:      ‖p − x_i‖ > ε_min  for every vertex i of the same sheet (live), and none that is not measured before or behind p
//! anchored: some vertex measured in this frame lies within 2ε of p and faces the same way
//! rest:     X = p + v(p),  v the inverse field (live → rest) on the measured vertices around p
//! ```
//! Growth is from the measured surface outward, a spacing or two a frame: a point without an anchor waits until
//! the front has come near. The inverse field is GP-WRM's, whose unobserved direction turns with the
//! local rotation, so a strip a spacing beyond the last vertex stays attached while the object turns.

use super::{CanonicalModel, NewVertex, graph};
use gpwrm::{Field, FieldOptions, Support};
use kiddo::ImmutableKdTree;
use nalgebra::{Matrix3, Point3, UnitVector3, Vector3};

/// Least cosine between normals of one sheet, where it lies apart.
const SAME_SHEET: f64 = 0.5;
/// Vertices within three spacings on two sheets, with some to spare.
const MOST_AROUND: usize = 80;

/// How points of a frame enter the model.
#[derive(Debug, Clone, PartialEq)]
pub struct MergeOptions {
    /// Spacing ε of the model, metres.
    pub spacing: f64,
    /// A point nearer than this share of ε to the model is not new.
    pub apart: f64,
    /// The same where the model already surrounds the point.
    pub within: f64,
    /// Points seen at a grazing angle have poor normals: least cosine to the camera.
    pub min_facing: f64,
    /// Farthest anchor, in spacings.
    pub anchor: f64,
    /// A point is not new either where the model has the same sheet, not measured, this many spacings before or behind it: the sheet is
    /// known, only misplaced. Without this rule what comes back into view a little off is laid over the model a second time.
    pub misplaced: f64,
}

impl MergeOptions {
    /// Defaults at a spacing.
    pub fn new(spacing: f64) -> Self {
        Self {
            spacing,
            apart: 0.85,
            within: 1.4,
            min_facing: 0.3,
            anchor: 1.9,
            misplaced: 3.0,
        }
    }
}

/// A frame's cloud, ready to merge.
#[derive(Debug, Clone, Copy)]
pub struct FrameCloud<'a> {
    /// Points, camera frame.
    pub points: &'a [Point3<f64>],
    /// Their normals, toward the camera.
    pub normals: &'a [UnitVector3<f64>],
}

/// The vertices of `frame` that extend `model`; `measured[i]` says which vertices this frame measured.
///
/// # Errors
/// The field cannot be built (non-finite positions).
///
/// # Complexity
/// `O(n log n)` in the points of the frame.
pub fn extension(
    model: &CanonicalModel,
    frame: FrameCloud<'_>,
    measured: &[bool],
    options: &MergeOptions,
) -> Result<Vec<NewVertex>, gpwrm::Error> {
    let spacing = options.spacing;
    let live_normals = model.live_normals();
    let frontier = graph::frontier(model);
    let Some(tree) = graph::tree(&model.live) else {
        return Ok(Vec::new());
    };
    let mut chosen: Vec<usize> = Vec::new();
    for (k, point) in frame.points.iter().enumerate() {
        let normal = &frame.normals[k];
        if crate::visibility::facing(point, normal) < options.min_facing {
            continue;
        }
        let around = graph::near(&tree, point, options.anchor * spacing, 24);
        let sheet: Vec<(usize, f64)> = around
            .iter()
            .filter(|(i, _)| live_normals[*i].dot(normal) > 0.0)
            .copied()
            .collect();
        // Within the surface the net is there already, if stretched; only the frontier takes points at the full density.
        let room = if surrounded(point, normal, &sheet, model) {
            options.within
        } else {
            options.apart
        };
        let taken = sheet.first().is_some_and(|&(_, d)| d < room * spacing);
        let known = taken
            || is_known(
                (point, normal),
                &tree,
                model,
                (measured, &live_normals),
                options,
            );
        let anchored = around
            .iter()
            .any(|&(i, _)| frontier[i] && measured[i] && live_normals[i].dot(normal) > 0.4);
        let crowded = chosen
            .iter()
            .any(|&c| (frame.points[c] - point).norm() < options.apart * spacing);
        if !known && anchored && !crowded {
            chosen.push(k);
        }
    }
    if chosen.is_empty() {
        return Ok(Vec::new());
    }
    let field = inverse_field(model, measured, &chosen, frame, spacing)?;
    Ok(chosen
        .iter()
        .map(|&k| at_rest(&field, &frame.points[k], &frame.normals[k]))
        .collect())
}

/// Whether a vertex that was not measured and faces the same way lies before or behind `point`, seen along its normal.
fn is_known(
    (point, normal): (&Point3<f64>, &UnitVector3<f64>),
    tree: &ImmutableKdTree<f64, 3>,
    model: &CanonicalModel,
    (measured, live_normals): (&[bool], &[UnitVector3<f64>]),
    options: &MergeOptions,
) -> bool {
    let (reach, aside) = (
        options.misplaced * options.spacing,
        options.apart * options.spacing,
    );
    graph::near(tree, point, reach, MOST_AROUND)
        .iter()
        .filter(|(i, _)| !measured[*i] && live_normals[*i].dot(normal) > SAME_SHEET)
        .any(|(i, _)| super::surface::aside(normal, &(model.live[*i] - point)) < aside)
}

/// Whether neighbours lie all around `point` in its tangent plane.
fn surrounded(
    point: &Point3<f64>,
    normal: &UnitVector3<f64>,
    sheet: &[(usize, f64)],
    model: &CanonicalModel,
) -> bool {
    let directions = sheet.iter().map(|(i, _)| model.live[*i] - point);
    graph::widest_gap(normal, directions) < 140f64.to_radians()
}

/// The field live → rest on the measured vertices within reach of the new points.
fn inverse_field(
    model: &CanonicalModel,
    measured: &[bool],
    chosen: &[usize],
    frame: FrameCloud<'_>,
    spacing: f64,
) -> Result<Field, gpwrm::Error> {
    let targets: Vec<Point3<f64>> = chosen.iter().map(|&k| frame.points[k]).collect();
    let near_targets = graph::tree(&targets);
    let nodes: Vec<usize> = (0..model.len())
        .filter(|&i| measured[i])
        .filter(|&i| {
            near_targets
                .as_ref()
                .is_some_and(|t| graph::nearest(t, &model.live[i]).1 < 8.0 * spacing)
        })
        .collect();
    let positions: Vec<Point3<f64>> = nodes.iter().map(|&i| model.live[i]).collect();
    let displacements: Vec<Vector3<f64>> = nodes
        .iter()
        .map(|&i| model.rest[i] - model.live[i])
        .collect();
    let options = FieldOptions {
        support: Support::Radius(3.0 * spacing),
        shrinkage: 0.01,
        ..FieldOptions::default()
    };
    Field::new(&positions, &displacements, &options)
}

/// Carries one live point and its normal to the rest frame.
fn at_rest(field: &Field, point: &Point3<f64>, normal: &UnitVector3<f64>) -> NewVertex {
    let sample = field.evaluate(point);
    let turn = nearest_rotation(&(Matrix3::identity() + sample.gradient));
    NewVertex {
        rest: point + sample.displacement,
        rest_normal: UnitVector3::new_normalize(turn * normal.into_inner()),
        live: *point,
        rotation: turn.transpose(),
    }
}

/// The rotation nearest to a matrix (polar factor, determinant +1); the identity for a matrix without one.
pub fn nearest_rotation(matrix: &Matrix3<f64>) -> Matrix3<f64> {
    let svd = matrix.svd(true, true);
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else {
        return Matrix3::identity();
    };
    let sign = (u * v_t).determinant().signum();
    if !sign.is_finite() {
        return Matrix3::identity();
    }
    u * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, sign)) * v_t
}
