//! Remeshing to triangles of even size and shape: long edges are split, short ones collapsed, edges flipped toward valence six,
//! and vertices moved toward the centroid of their neighbours within the surface.
//!
//! Botsch and Kobbelt, A remeshing approach to multiresolution modeling, SGP 2004; here vertices are projected onto the samples
//! instead of onto the original mesh.

use super::corners::{Corners, next, previous};
use super::fit;
use super::samples::Samples;
use nalgebra::{Point3, Vector3};

/// Edges longer than this multiple of the target length are split, shorter ones collapsed.
const LONG: f64 = 4.0 / 3.0;
const SHORT: f64 = 4.0 / 5.0;
/// Cosine of the largest rotation of a triangle when an edge is collapsed or flipped: 60 degrees.
const TURN: f64 = 0.5;
/// Rounds of all steps; by then the share of edges outside the bounds no longer changes.
const ROUNDS: usize = 4;
/// Triangles of lower quality (`4√3 area / Σ edges²`, 1 for an equilateral one) are repaired at the end.
const POOR: f64 = 0.15;

/// Collapses edges until none is much shorter than `length`.
pub(super) fn coarsen(mesh: &mut Corners, length: f64) {
    for _ in 0..12 {
        if collapse_short(mesh, length * SHORT, length * LONG) == 0 {
            break;
        }
    }
}

/// Makes the edges of `mesh` about `length` long and moves its vertices onto the samples.
pub(super) fn remesh(mesh: &mut Corners, length: f64, samples: &Samples, spacing: f64) {
    rounds(mesh, length, samples, spacing, ROUNDS);
}

/// The last rounds, and the repair of needle triangles.
pub(super) fn finish(mesh: &mut Corners, length: f64, samples: &Samples, spacing: f64) {
    rounds(mesh, length, samples, spacing, 2);
    fit::all_onto_samples(mesh, samples, spacing);
    mend(mesh, length);
}

fn rounds(mesh: &mut Corners, length: f64, samples: &Samples, spacing: f64, count: usize) {
    for _ in 0..count {
        split_long(mesh, length * LONG);
        collapse_short(mesh, length * SHORT, length * LONG);
        turn_edges(mesh);
        relax(mesh);
        fit::all_onto_samples(mesh, samples, spacing);
    }
}

fn split_long(mesh: &mut Corners, longest: f64) {
    for c in mesh.edges() {
        if mesh.length(c) > longest {
            mesh.split(c);
        }
    }
}

/// Collapses edges shorter than `shortest` unless that makes one longer than `longest`; returns how many.
fn collapse_short(mesh: &mut Corners, shortest: f64, longest: f64) -> usize {
    let mut count = 0;
    for c in 0..mesh.corner_count() as u32 {
        if mesh.is_live(c) && mesh.length(c) < shortest && mesh.can_collapse(c) {
            let middle = nalgebra::center(&mesh.place(mesh.from(c)), &mesh.place(mesh.to(c)));
            if collapse_keeps_shape(mesh, c, &middle, longest) {
                let b = mesh.to(c);
                mesh.collapse(c);
                mesh.places[b as usize] = middle;
                count += 1;
            }
        }
    }
    count
}

/// Whether the triangles around the edge of `c` keep their orientation, and their edges stay short enough, when it is collapsed to `to`.
fn collapse_keeps_shape(mesh: &Corners, c: u32, to: &Point3<f64>, longest: f64) -> bool {
    let (a, b) = (mesh.from(c), mesh.to(c));
    [(a, b), (b, a)].into_iter().all(|(v, other)| {
        mesh.around(v).all(|corner| {
            let (q, r) = (mesh.to(corner), mesh.opposite(corner));
            if q == other || r == other {
                return true;
            }
            let (q, r) = (mesh.place(q), mesh.place(r));
            let (before, after) = (mesh.face(corner), (q - to).cross(&(r - to)));
            (q - to).norm() < longest && keeps_direction(&before, &after)
        })
    })
}

fn keeps_direction(before: &Vector3<f64>, after: &Vector3<f64>) -> bool {
    before.dot(after) > TURN * before.norm() * after.norm()
}

/// Flips edges where that brings the valences nearer to six.
fn turn_edges(mesh: &mut Corners) {
    for c in mesh.edges() {
        if !mesh.can_flip(c) {
            continue;
        }
        let t = mesh.twin(c);
        let excess = |v: u32, change: f64| (mesh.valence(v) as f64 - 6.0 + change).powi(2);
        let [a, b, l, r] = [mesh.from(c), mesh.to(c), mesh.opposite(c), mesh.opposite(t)];
        let before = excess(a, 0.0) + excess(b, 0.0) + excess(l, 0.0) + excess(r, 0.0);
        let after = excess(a, -1.0) + excess(b, -1.0) + excess(l, 1.0) + excess(r, 1.0);
        if after < before && flip_keeps_shape(mesh, c) {
            mesh.flip(c);
        }
    }
}

/// Whether the two triangles at the edge of `c` face the same way after it is flipped, and are not needles.
fn flip_keeps_shape(mesh: &Corners, c: u32) -> bool {
    let t = mesh.twin(c);
    let [a, b, l, r] =
        [mesh.from(c), mesh.to(c), mesh.opposite(c), mesh.opposite(t)].map(|v| mesh.place(v));
    let before = mesh.face(c) + mesh.face(t);
    let flat = mesh.face(c).dot(&mesh.face(t)) > 0.7 * mesh.face(c).norm() * mesh.face(t).norm();
    let (x, y) = ((l - r).cross(&(a - r)), (r - l).cross(&(b - l)));
    flat && keeps_direction(&before, &x)
        && keeps_direction(&before, &y)
        && quality(&r, &l, &a).min(quality(&l, &r, &b)) > POOR
}

/// `4√3 area / Σ edges²`: 1 for an equilateral triangle, 0 for a needle.
fn quality(p: &Point3<f64>, q: &Point3<f64>, r: &Point3<f64>) -> f64 {
    let squares = (q - p).norm_squared() + (r - q).norm_squared() + (p - r).norm_squared();
    let area = (q - p).cross(&(r - p)).norm() / 2.0;
    if squares > 0.0 {
        4.0 * 3.0f64.sqrt() * area / squares
    } else {
        0.0
    }
}

/// Moves vertices toward the centroid of their neighbours, within the surface.
fn relax(mesh: &mut Corners) {
    let moved: Vec<(u32, Point3<f64>)> = mesh
        .vertices()
        .filter_map(|v| {
            let normal = mesh.outward(v).try_normalize(0.0)?;
            let (mut sum, mut total) = (Vector3::zeros(), 0.0);
            for c in mesh.around(v) {
                // Area weights keep the density even where triangle sizes differ.
                let area = mesh.face(c).norm() + mesh.face(mesh.twin(c)).norm();
                sum += (mesh.place(mesh.to(c)) - mesh.place(v)) * area;
                total += area;
            }
            let step = sum / total.max(f64::MIN_POSITIVE);
            Some((v, mesh.place(v) + (step - normal * normal.dot(&step)) * 0.7))
        })
        .collect();
    for (v, to) in moved {
        try_move(mesh, v, to);
    }
}

/// Moves a vertex unless that flips the normal of a triangle at it.
fn try_move(mesh: &mut Corners, v: u32, to: Point3<f64>) {
    let keeps = mesh.around(v).all(|c| {
        let (q, r) = (mesh.place(mesh.to(c)), mesh.place(mesh.opposite(c)));
        keeps_direction(&mesh.face(c), &(q - to).cross(&(r - to)))
    });
    if keeps {
        mesh.places[v as usize] = to;
    }
}

/// Repairs needles: collapses their shortest edge, or flips their longest.
fn mend(mesh: &mut Corners, length: f64) {
    for _ in 0..4 {
        let poor: Vec<u32> = mesh
            .triangles()
            .filter(|&c| triangle_quality(mesh, c) < POOR)
            .collect();
        for c in poor {
            if mesh.is_live(c) && triangle_quality(mesh, c) < POOR {
                mend_triangle(mesh, c, length);
            }
        }
    }
}

fn triangle_quality(mesh: &Corners, c: u32) -> f64 {
    let [p, q, r] = [c, next(c), previous(c)].map(|c| mesh.place(mesh.from(c)));
    quality(&p, &q, &r)
}

fn mend_triangle(mesh: &mut Corners, c: u32, length: f64) {
    let mut sides = [c, next(c), previous(c)];
    sides.sort_by(|x, y| mesh.length(*x).total_cmp(&mesh.length(*y)));
    let [short, _, long] = sides;
    let worst = |mesh: &Corners, c: u32| {
        let t = mesh.twin(c);
        triangle_quality(mesh, c).min(triangle_quality(mesh, t))
    };
    if mesh.length(short) < 0.5 * length && mesh.can_collapse(short) {
        let (b, to) = (mesh.to(short), mesh.place(mesh.to(short)));
        mesh.collapse(short);
        mesh.places[b as usize] = to;
    } else if mesh.can_flip(long) {
        let before = worst(mesh, long);
        mesh.flip(long);
        // Flipped back if it did not help: flipping twice restores the edge.
        if worst(mesh, long) <= before && mesh.can_flip(long) {
            mesh.flip(long);
        }
    }
}
