//! How sharply a surface is creased around its handles.
//!
//! Where two round parts touch and are reconstructed as one, a crease runs around the neck that joins them. At a vertex `v` of a loop with
//! tangent `t`, normal `n` and `b = n × t`, let `n₊` and `n₋` be the mean normals at 0.6 to 1.5 spacings on the sides of `b` and of `−b`:
//!
//! ```text
//! fold(v) = ± ∠(n₊, n₋),   positive where they point toward each other,  (n₊ − n₋)·b < 0
//! crease  = max over loops of the mean of fold over the loop
//! ```
//! Around a real handle of the object the folds of its inner and its outer side cancel: around the tube of a ring of radii `R` and `r` their mean
//! is about `w r/(R² − r²)` for a width `w`, which is small.

use super::corners::Corners;
use super::handles::{Paths, around_handles};
use crate::canonical::genus::Handles;
use nalgebra::{UnitVector3, Vector3};

/// Range of distances to the side of a loop in which normals are averaged, in spacings.
const BESIDE: (f64, f64) = (0.6, 1.5);

/// Loops around the handles, as corners head to tail, each with the mean angle by which the surface is folded along it, rad; the most creased first.
pub(super) fn creased_loops(mesh: &Corners, spacing: f64) -> Vec<(f64, Vec<u32>)> {
    let loops = around_handles(mesh).into_iter();
    let mut creased: Vec<_> = loops
        .map(|around| (crease(mesh, &around, spacing), around))
        .collect();
    // Stable: loops with the same crease stay in the order in which they were found.
    creased.sort_by(|a, b| b.0.total_cmp(&a.0));
    creased
}

/// The handles of a mesh, with the largest mean fold along a loop around one of them.
pub(super) fn handles(mesh: &Corners, spacing: f64) -> Handles {
    let creased = creased_loops(mesh, spacing);
    let most = creased.first();
    let place = |c: &u32| mesh.place(mesh.from(*c));
    Handles {
        count: mesh.handles(),
        crease: most.map_or(0.0, |(angle, _)| angle.max(0.0)),
        creased_along: most.map_or_else(Vec::new, |(_, around)| around.iter().map(place).collect()),
    }
}

/// Mean fold over a loop, rad.
fn crease(mesh: &Corners, around: &[u32], spacing: f64) -> f64 {
    let count = around.len();
    let vertex = |k: usize| mesh.from(around[k % count]);
    let folds = (0..count).map(|k| {
        let tangent = mesh.place(vertex(k + 1)) - mesh.place(vertex(k + count - 1));
        fold(mesh, vertex(k), &tangent, spacing)
    });
    folds.sum::<f64>() / count.max(1) as f64
}

fn fold(mesh: &Corners, v: u32, tangent: &Vector3<f64>, spacing: f64) -> f64 {
    let beside = mesh.outward(v).cross(tangent);
    let Some(beside) = UnitVector3::try_new(beside, 0.0) else {
        return 0.0;
    };
    let near = Paths::new(mesh, v, 1.2 * BESIDE.1 * spacing);
    let mut sides = [Vector3::zeros(), Vector3::zeros()];
    for &w in near.reached.keys() {
        let aside = (mesh.place(w) - mesh.place(v)).dot(&beside) / spacing;
        if (BESIDE.0..=BESIDE.1).contains(&aside.abs()) {
            sides[usize::from(aside < 0.0)] += mesh.outward(w);
        }
    }
    let [plus, minus] = sides.map(|n| n.try_normalize(0.0).unwrap_or_default());
    let angle = plus.dot(&minus).clamp(-1.0, 1.0).acos();
    if (plus - minus).dot(&beside) < 0.0 {
        angle
    } else {
        -angle
    }
}
