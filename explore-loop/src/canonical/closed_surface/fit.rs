//! Moves vertices onto the surface that the samples around them define.
//!
//! The grid gives the right topology but loses details finer than its step. Each vertex `x` with normal `n` moves along `n` by
//!
//! ```text
//! s = Σ_i w_i ½(n + n_i)·(x − p_i) / Σ_i w_i,    w_i = weight · exp(−‖x − p_i‖²/2σ²) · max(0, n·n_i)²
//! ```
//! over samples that face the same way. The distance along `n` alone would put the vertex inside a convex surface, the distance to the planes of the
//! samples would put it equally far outside; their mean has no second-order error, so round bodies neither shrink nor swell.

use super::corners::Corners;
use super::samples::Samples;
use nalgebra::{Point3, Vector3};

/// Standard deviation of the weights, in spacings: about seven samples contribute, which reduces noise to a third.
const WIDTH: f64 = 0.7;
/// Samples whose normals have a smaller cosine belong to another sheet or to the other side of an edge.
const ALIKE: f64 = 0.3;
/// Above this cosine the surface between a vertex and a sample counts as round; below it, as an edge.
const SMOOTH: f64 = 0.85;
const EDGE: f64 = 0.55;
/// A vertex with this total weight around it moves half of the computed distance.
const FAINT: f64 = 0.05;
/// How far a vertex may lie beyond the outermost sample around it, in spacings: the tip of an edge lies within this, a spike does not.
const BEYOND: f64 = 0.3;
/// A vertex moves at most this far in one step, in spacings.
const FURTHEST: f64 = 0.4;

/// The displacement that brings a vertex at `place` with unit `normal` onto the samples.
pub(super) fn onto_samples(
    place: &Point3<f64>,
    normal: &Vector3<f64>,
    samples: &Samples,
    spacing: f64,
) -> Vector3<f64> {
    let sigma = WIDTH * spacing;
    let (mut sum, mut total, mut outermost) = (0.0, 0.0, f64::NEG_INFINITY);
    samples.cells.visit(place, 2.2 * sigma, |i| {
        let alike = normal.dot(&samples.normals[i]);
        let offset = place - samples.points[i];
        let far = offset.norm_squared() / (sigma * sigma);
        if far < 4.84 {
            outermost = f64::max(outermost, -normal.dot(&offset));
        }
        if alike > ALIKE && far < 4.84 {
            let weight = samples.weights[i] * (-0.5 * far).exp() * (alike - ALIKE);
            let (plane, along) = (samples.normals[i].dot(&offset), normal.dot(&offset));
            let smooth = ((alike - EDGE) / (SMOOTH - EDGE)).clamp(0.0, 1.0);
            sum += weight
                * (smooth * 0.5 * (plane + along) + (1.0 - smooth) * plane / alike.max(EDGE));
            total += weight;
        }
    });
    let step = (-sum / (total + FAINT)).clamp(-FURTHEST * spacing, FURTHEST * spacing);
    if outermost.is_finite() {
        normal * step.min(outermost + BEYOND * spacing)
    } else {
        normal * step
    }
}

/// Moves every vertex onto the samples.
pub(super) fn all_onto_samples(mesh: &mut Corners, samples: &Samples, spacing: f64) {
    let moved: Vec<(usize, Vector3<f64>)> = mesh
        .vertices()
        .filter_map(|v| {
            let normal = mesh.outward(v).try_normalize(0.0)?;
            let step = onto_samples(&mesh.place(v), &normal, samples, spacing);
            Some((v as usize, step))
        })
        .collect();
    for (v, step) in moved {
        mesh.places[v] += step;
    }
}
