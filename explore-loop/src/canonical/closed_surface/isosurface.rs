//! The level set of a field as a mesh, by marching cubes without ambiguous cases.
//!
//! On each face of a cube every run of inside corners is cut off by a segment of its own. This depends only on the four corners of the face,
//! so the cubes on both sides agree, the segments of a cube form closed loops, and the surface is a closed 2-manifold for any values. Loops of
//! more than four corners are filled with a fan around their centre: a diagonal between two corners on one face of the cube could be drawn by
//! the adjacent cube as well.

use super::grid::Field;
use nalgebra::{Point3, Vector3};
use std::collections::HashMap;

/// Least distance of a crossing from a node, as a share of the edge: keeps triangles from degenerating.
const CLOSEST: f64 = 0.08;

/// A triangle mesh: vertices, and triangles counter-clockwise seen from outside.
pub(crate) type Soup = (Vec<Point3<f64>>, Vec<[u32; 3]>);

/// The surface where `field` equals `level`, oriented away from the larger values.
pub(super) fn extract(field: &Field, level: f64) -> Soup {
    extract_where(field, level, |_| true)
}

/// The same for the cubes whose corners are all `known`, by index; the surface is open where other cubes begin.
pub(crate) fn extract_where(field: &Field, level: f64, known: impl Fn(usize) -> bool) -> Soup {
    let table: Vec<Vec<Vec<usize>>> = (0..256).map(loops).collect();
    let grid = &field.grid;
    let strides = grid.strides();
    let mut crossings: HashMap<(usize, usize), u32> = HashMap::new();
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    grid.inner(|node, first| {
        let corner = |c: usize| first + (0..3).map(|a| (c >> a & 1) * strides[a]).sum::<usize>();
        let mask = (0..8).fold(0, |mask, c| {
            mask | usize::from(field.values[corner(c)] > level) << c
        });
        if table[mask].is_empty() || !(0..8).all(|c| known(corner(c))) {
            return;
        }
        for around in &table[mask] {
            let ring: Vec<u32> = around
                .iter()
                .map(|&edge| {
                    let (c, axis) = EDGES[edge];
                    *crossings.entry((corner(c), axis)).or_insert_with(|| {
                        let (a, b) = (
                            field.values[corner(c)],
                            field.values[corner(c) + strides[axis]],
                        );
                        let part = ((level - a) / (b - a)).clamp(CLOSEST, 1.0 - CLOSEST);
                        let mut place = grid.place([0, 1, 2].map(|x| node[x] + (c >> x & 1)));
                        place[axis] += part * grid.step;
                        vertices.push(place);
                        vertices.len() as u32 - 1
                    })
                })
                .collect();
            fill(&ring, &mut vertices, &mut triangles);
        }
    });
    (vertices, triangles)
}

/// Fills a loop with triangles.
fn fill(ring: &[u32], vertices: &mut Vec<Point3<f64>>, triangles: &mut Vec<[u32; 3]>) {
    match *ring {
        [a, b, c] => triangles.push([a, b, c]),
        [a, b, c, d] => {
            let length = |i: u32, j: u32| (vertices[i as usize] - vertices[j as usize]).norm();
            if length(a, c) <= length(b, d) {
                triangles.extend([[a, b, c], [a, c, d]]);
            } else {
                triangles.extend([[a, b, d], [b, c, d]]);
            }
        }
        _ => {
            let sum: Vector3<f64> = ring.iter().map(|&i| vertices[i as usize].coords).sum();
            let middle = vertices.len() as u32;
            vertices.push(Point3::from(sum / ring.len() as f64));
            for k in 0..ring.len() {
                triangles.push([middle, ring[k], ring[(k + 1) % ring.len()]]);
            }
        }
    }
}

/// The edges of a cube: lower corner (bits x, y, z) and axis.
const EDGES: [(usize, usize); 12] = [
    (0, 0),
    (2, 0),
    (4, 0),
    (6, 0),
    (0, 1),
    (1, 1),
    (4, 1),
    (5, 1),
    (0, 2),
    (1, 2),
    (2, 2),
    (3, 2),
];

/// The corners of each face, counter-clockwise seen from outside.
const FACES: [[usize; 4]; 6] = [
    [0, 4, 6, 2],
    [1, 3, 7, 5],
    [0, 1, 5, 4],
    [2, 6, 7, 3],
    [0, 2, 3, 1],
    [4, 5, 7, 6],
];

/// The loops of cube edges that the surface crosses when the corners in `mask` are inside.
fn loops(mask: usize) -> Vec<Vec<usize>> {
    let inside = |corner: usize| mask >> corner & 1 == 1;
    let mut next = [usize::MAX; 12];
    for face in FACES {
        for k in 0..4 {
            // A run of inside corners begins here: the segment joins the edges before its first and after its last corner.
            if inside(face[k]) && !inside(face[(k + 3) % 4]) {
                let begin = edge(face[(k + 3) % 4], face[k]);
                let last = (0..4).take_while(|j| inside(face[(k + j) % 4])).count();
                let end = edge(face[(k + last - 1) % 4], face[(k + last) % 4]);
                next[begin] = end;
            }
        }
    }
    let mut found = Vec::new();
    for start in 0..12 {
        let mut around = Vec::new();
        let mut at = start;
        while next[at] != usize::MAX {
            around.push(at);
            at = std::mem::replace(&mut next[at], usize::MAX);
        }
        if !around.is_empty() {
            found.push(around);
        }
    }
    found
}

/// The edge between two corners.
fn edge(a: usize, b: usize) -> usize {
    let axis = (a ^ b).trailing_zeros() as usize;
    EDGES
        .iter()
        .position(|e| *e == (a.min(b), axis))
        .unwrap_or(0)
}
