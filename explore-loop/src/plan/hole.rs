//! Holes inside the outline: loops of the boundary that the camera looks into, such as the openings of folds and pockets.
//!
//! ```text
//! hole  ⇔  β₁ persists,  most of the loop is visible,  and the surface next to the loop lies outside of it
//! ```
//!
//! *Outside* is decided in the image, by the rays `(x/z, y/z)` in the frame of the camera: along the outer boundary of the seen part, the surface
//! lies inside the loop. The floor of a pocket, seen through its opening, is not next to the loop, since the surface between is not seen.

use super::PlanInput;
use std::collections::BTreeSet;

/// A hole.
pub(super) struct Hole {
    /// Vertices of the loop, in order.
    pub rim: Vec<u32>,
    /// Whether almost no other boundary is left.
    pub alone: bool,
    /// Area in the image, on the plane `z = 1`.
    area: f64,
}

/// Fewest different vertices of the loop of a hole.
const FEWEST: usize = 6;
/// Least share of the loop that must be visible, and of its neighbours that must lie outside.
const SEEN: f64 = 0.7;
const OUTSIDE: f64 = 0.65;
/// A hole is alone when at most this share of the boundary belongs to other loops.
const OTHERS: f64 = 0.15;

/// The holes, largest first; none unless a class of dimension 1 persists.
pub(super) fn seen_inside(input: &PlanInput<'_>) -> Vec<Hole> {
    if input.topology.persistent[1] == 0 {
        return Vec::new();
    }
    let loops = &input.topology.loops;
    let total: usize = loops.iter().map(Vec::len).sum();
    let mut holes: Vec<Hole> = loops.iter().filter_map(|l| hole(input, l)).collect();
    // The boundary that is left when all holes are opened decides whether a turn is useful.
    let inside: usize = holes.iter().map(|h| h.rim.len()).sum();
    let others = total.saturating_sub(inside) as f64;
    for hole in &mut holes {
        hole.alone = others <= OTHERS * total as f64;
    }
    holes.sort_by(|a, b| b.area.total_cmp(&a.area).then(a.rim.cmp(&b.rim)));
    holes
}

fn hole(input: &PlanInput<'_>, vertices: &[u32]) -> Option<Hole> {
    let count = input.points.len();
    let mut rim: Vec<u32> = Vec::with_capacity(vertices.len());
    for &v in vertices.iter().filter(|&&v| (v as usize) < count) {
        if !rim.contains(&v) {
            rim.push(v);
        }
    }
    let seen = rim.iter().filter(|&&v| input.visible[v as usize]).count();
    if rim.len() < FEWEST || (seen as f64) < SEEN * rim.len() as f64 {
        return None;
    }
    let on_rim: BTreeSet<u32> = rim.iter().copied().collect();
    let camera_from_fixed = input.camera.inverse();
    let ray = |v: u32| {
        let p = camera_from_fixed * input.points[v as usize];
        (p.z > 0.0).then(|| [p.x / p.z, p.y / p.z])
    };
    let polygon: Option<Vec<[f64; 2]>> = rim.iter().map(|&v| ray(v)).collect();
    let polygon = polygon?;
    let beside: BTreeSet<u32> = input
        .edges
        .iter()
        .flat_map(|&[a, b]| [(a, b), (b, a)])
        .filter(|(a, b)| on_rim.contains(a) && !on_rim.contains(b))
        .map(|(_, b)| b)
        .collect();
    let outside = beside
        .iter()
        .filter(|&&v| ray(v).is_none_or(|at| !contains(&polygon, at)))
        .count();
    if beside.is_empty() || (outside as f64) < OUTSIDE * beside.len() as f64 {
        return None;
    }
    let area = area(&polygon);
    Some(Hole {
        rim,
        alone: false,
        area,
    })
}

/// Whether a ray from the point crosses the polygon an odd number of times.
fn contains(polygon: &[[f64; 2]], [x, y]: [f64; 2]) -> bool {
    let mut inside = false;
    for (k, &[ax, ay]) in polygon.iter().enumerate() {
        let [bx, by] = polygon[(k + 1) % polygon.len()];
        if (ay > y) != (by > y) && x < ax + (y - ay) / (by - ay) * (bx - ax) {
            inside = !inside;
        }
    }
    inside
}

/// The shoelace formula.
fn area(polygon: &[[f64; 2]]) -> f64 {
    let twice: f64 = (0..polygon.len())
        .map(|k| {
            let ([ax, ay], [bx, by]) = (polygon[k], polygon[(k + 1) % polygon.len()]);
            ax * by - bx * ay
        })
        .sum();
    0.5 * twice.abs()
}
