//! Fills gaps in a triangulation.
//!
//! The open edges form loops; each is filled with the triangles over its own vertices that have the least total area (Barequet
//! and Sharir 1995, section 3), by dynamic programming over the ordered vertices:
//!
//! ```text
//! W(i, k) = min over i < j < k of  W(i, j) + W(j, k) + area(i, j, k),      W(i, i+1) = 0
//! ```
//! A diagonal that is already an edge of the mesh has infinite cost, so that no edge gets a third triangle.

use nalgebra::Point3;
use std::collections::{BTreeMap, BTreeSet};

/// Longest loop that is filled: the cost grows with the cube of its length.
const LONGEST: usize = 200;

/// Adds triangles, oriented like those around them, until every loop of open edges that can be filled is filled.
pub(super) fn close(points: &[Point3<f64>], triangles: &mut Vec<[u32; 3]>) {
    let mut edges: BTreeSet<[u32; 2]> = triangles.iter().flat_map(sides).collect();
    for gap in loops(&edges) {
        let fill = filling(points, &gap, &edges);
        edges.extend(fill.iter().flat_map(sides));
        triangles.extend(fill);
    }
}

fn sides(&[a, b, c]: &[u32; 3]) -> [[u32; 2]; 3] {
    [[a, b], [b, c], [c, a]]
}

/// Loops of the open edges, in the direction of the triangles that would fill them; each visits a vertex once.
fn loops(edges: &BTreeSet<[u32; 2]>) -> Vec<Vec<u32>> {
    let mut next: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for [a, b] in edges {
        if !edges.contains(&[*b, *a]) {
            next.entry(*b).or_default().push(*a);
        }
    }
    let mut loops = Vec::new();
    while let Some((&start, _)) = next.iter().find(|(_, to)| !to.is_empty()) {
        let mut path = vec![start];
        while let Some(to) = path
            .last()
            .and_then(|last| next.get_mut(last))
            .and_then(Vec::pop)
        {
            // Where the path meets itself, the part since then is a loop of its own.
            if let Some(at) = path.iter().position(|v| *v == to) {
                let found = path.split_off(at);
                path.push(to);
                loops.push(found);
            } else {
                path.push(to);
            }
        }
    }
    loops
}

/// The triangles of least area over a loop, or none if every choice needs an edge that is taken.
fn filling(points: &[Point3<f64>], gap: &[u32], edges: &BTreeSet<[u32; 2]>) -> Vec<[u32; 3]> {
    let n = gap.len();
    if !(3..=LONGEST).contains(&n) {
        return Vec::new();
    }
    let taken = |i: usize, k: usize| {
        let (a, b) = (gap[i], gap[k]);
        // The side from the last vertex to the first closes the loop: it is open and needs its triangle.
        (i, k) != (0, n - 1) && (edges.contains(&[a, b]) || edges.contains(&[b, a]))
    };
    let mut best = vec![vec![(0.0, 0); n]; n];
    for span in 2..n {
        for i in 0..n - span {
            let k = i + span;
            best[i][k] = (i + 1..k)
                .map(|j| {
                    let [a, b, c] = [i, j, k].map(|v| points[gap[v] as usize]);
                    let area = 0.5 * (b - a).cross(&(c - a)).norm();
                    (best[i][j].0 + best[j][k].0 + area, j)
                })
                .min_by(|a, b| a.0.total_cmp(&b.0))
                .filter(|_| !taken(i, k))
                .unwrap_or((f64::INFINITY, 0));
        }
    }
    let mut fill = Vec::new();
    let mut open = vec![(0, n - 1)];
    if best[0][n - 1].0.is_finite() {
        while let Some((i, k)) = open.pop() {
            if k - i > 1 {
                let j = best[i][k].1;
                fill.push([gap[i], gap[j], gap[k]]);
                open.extend([(i, j), (j, k)]);
            }
        }
    }
    fill
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::MeshReport;

    /// An octahedron: six vertices, eight triangles.
    fn octahedron() -> (Vec<Point3<f64>>, Vec<[u32; 3]>) {
        let points = [
            [1.0, 0.0, 0.0],
            [-1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.0, -1.0, 0.0],
            [0.0, 0.0, 1.0],
            [0.0, 0.0, -1.0],
        ]
        .map(Point3::from);
        let triangles = vec![
            [0, 2, 4],
            [2, 1, 4],
            [1, 3, 4],
            [3, 0, 4],
            [2, 0, 5],
            [1, 2, 5],
            [3, 1, 5],
            [0, 3, 5],
        ];
        (points.to_vec(), triangles)
    }

    /// Whatever subset of the triangles is taken away, what is closed again turns the same way all over.
    #[test]
    fn any_missing_triangles_are_put_back() {
        let (points, all) = octahedron();
        for mask in 1..255_u32 {
            let mut some: Vec<[u32; 3]> = (0..8)
                .filter(|k| mask & (1 << k) != 0)
                .map(|k| all[k])
                .collect();
            close(&points, &mut some);
            let report = MeshReport::of(&points, &some);
            assert_eq!(report.misoriented_edges, 0, "{mask:b}");
            assert_eq!(report.non_manifold_edges, 0, "{mask:b}");
            // One triangle that lacks is a gap of its own.
            if mask.count_ones() == 7 {
                assert!(report.watertight && report.euler == 2, "{mask:b}");
            }
        }
    }

    #[test]
    fn a_closed_mesh_stays() {
        let (points, all) = octahedron();
        let mut same = all.clone();
        close(&points, &mut same);
        assert_eq!(same, all);
    }
}
