//! Assigns arms to grips.
//!
//! The total length of the lines from base to grip, seen along the table normal, is minimised over all arms in reach. Without limits of
//! reach such lines never cross (swapping the ends of two that cross would shorten both, by the triangle
//! inequality); with limits they may, and then the assignment is rejected.
//!
//! A turn moves the grips to the other side of the body, so the lines are counted at its beginning and at its end; otherwise an arm that
//! stands behind the lifted side would be chosen for being near, and reach across the body at the end.

use nalgebra::Point3;

use crate::{Candidate, Scene};

/// The arms for two grips that move through the given positions (both at a time): least length, no crossing, in reach.
pub(crate) fn assign(
    scene: &Scene,
    grips: [&Candidate; 2],
    passed: &[[Point3<f64>; 2]],
) -> Option<[usize; 2]> {
    let base = |arm: usize| &scene.arms[arm].base;
    let way = |arm: usize, to: &Point3<f64>| scene.table.along(&(to - base(arm))).norm();
    let mut best: Option<(f64, [usize; 2])> = None;
    for &a in &grips[0].arms {
        for &b in grips[1].arms.iter().filter(|&&b| b != a) {
            if passed
                .iter()
                .any(|[p, q]| cross(scene, [base(a), p], [base(b), q]))
            {
                continue;
            }
            let sum: f64 = passed.iter().map(|[p, q]| way(a, p) + way(b, q)).sum();
            if best.is_none_or(|(least, _)| sum < least) {
                best = Some((sum, [a, b]));
            }
        }
    }
    best.map(|(_, arms)| arms)
}

/// Whether two lines, each from a base to a grip, cross when seen along the table normal.
pub(crate) fn cross(scene: &Scene, [a, p]: [&Point3<f64>; 2], [b, q]: [&Point3<f64>; 2]) -> bool {
    let n = scene.table.normal;
    let side = |from: &Point3<f64>, to: &Point3<f64>, x: &Point3<f64>| {
        n.dot(&(to - from).cross(&(x - from)))
    };
    side(a, p, b) * side(a, p, q) < 0.0 && side(b, q, a) * side(b, q, p) < 0.0
}
