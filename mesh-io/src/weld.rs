//! Merges vertices at the same place.
//!
//! Files repeat vertices where textures or normals change (seams), or in every triangle (triangle soups); without merging, such a surface falls apart.
//! Two vertices are the same if they are nearer than a millionth of the diagonal of the bounding box. The first represents all; its normal is the
//! normalised sum of theirs. Triangles that lose their area are left out.
//!
//! Only vertices of open edges (not shared by two triangles) are merged: closed bodies that touch each other stay separate.

use std::collections::HashMap;

use nalgebra::{Point3, Vector3};

use crate::Mesh;

/// Vertices nearer than this share of the diagonal are the same.
const SAME: f64 = 1e-6;

impl Mesh {
    /// The same surface with one vertex per place and without unused vertices. A cloud is unchanged.
    #[must_use]
    pub fn welded(&self) -> Self {
        if self.triangles.is_empty() {
            return self.clone();
        }
        let first = first_at_each_place(&self.points, &self.at_open_edges());
        let mut mesh = self.clone();
        if !mesh.normals.is_empty() {
            mesh.normals = sums(&self.normals, &first);
        }
        mesh.triangles = self
            .triangles
            .iter()
            .map(|t| t.map(|v| first[v as usize]))
            .collect();
        mesh.triangles
            .retain(|[a, b, c]| a != b && b != c && c != a);
        let mut kept = vec![false; self.points.len()];
        let corners = mesh.triangles.iter().flatten();
        corners.for_each(|v| kept[*v as usize] = true);
        let kept: Vec<u32> = (0..self.points.len() as u32)
            .filter(|v| kept[*v as usize])
            .collect();
        mesh.keep(&kept)
    }
}

impl Mesh {
    /// Which vertices belong to an edge that is not shared by two triangles.
    fn at_open_edges(&self) -> Vec<bool> {
        let mut count: HashMap<[u32; 2], u32> = HashMap::new();
        for [a, b, c] in &self.triangles {
            for (v, w) in [(a, b), (b, c), (c, a)] {
                *count.entry([*v.min(w), *v.max(w)]).or_default() += 1;
            }
        }
        let mut open = vec![false; self.points.len()];
        for (edge, _) in count.iter().filter(|(_, count)| **count != 2) {
            for v in edge {
                open[*v as usize] = true;
            }
        }
        open
    }
}

/// The normalised sum of the normals of each group of merged vertices.
fn sums(normals: &[Vector3<f64>], first: &[u32]) -> Vec<Vector3<f64>> {
    let mut sums = vec![Vector3::zeros(); normals.len()];
    let mut alone = vec![true; normals.len()];
    for (v, &at) in first.iter().enumerate() {
        let normal = normals[v];
        sums[at as usize] += normal.try_normalize(0.0).unwrap_or(normal);
        alone[at as usize] &= at as usize == v;
    }
    let one = |v: usize| {
        // A vertex that was not merged keeps its normal.
        if alone[v] {
            normals[v]
        } else {
            sums[v].try_normalize(0.0).unwrap_or(sums[v])
        }
    };
    (0..normals.len()).map(one).collect()
}

/// For every chosen vertex the first chosen one at its place; others represent themselves.
fn first_at_each_place(points: &[Point3<f64>], open: &[bool]) -> Vec<u32> {
    let chosen = || {
        points
            .iter()
            .zip(open)
            .filter(|(_, open)| **open)
            .map(|(p, _)| p)
    };
    let Some(start) = chosen().next() else {
        return (0..points.len() as u32).collect();
    };
    let (low, high) = chosen().fold((*start, *start), |(low, high), p| (low.inf(p), high.sup(p)));
    let same = ((high - low).norm() * SAME).max(f64::MIN_POSITIVE);
    // Cells are twice as wide as the tolerance, so that everything near a point lies in one of eight cells.
    let mut cells: HashMap<[i64; 3], Vec<u32>> = HashMap::new();
    let find = |v: usize, cells: &mut HashMap<[i64; 3], Vec<u32>>| {
        let at = (points[v] - low) / (2.0 * same);
        let cell = [0, 1, 2].map(|k| at[k].floor() as i64);
        let side = [0, 1, 2].map(|k| if at[k].fract() < 0.5 { -1 } else { 1 });
        for corner in 0..8 {
            let near = [0, 1, 2].map(|k| cell[k] + if corner >> k & 1 == 1 { side[k] } else { 0 });
            let close = |w: &&u32| (points[**w as usize] - points[v]).norm() <= same;
            if let Some(w) = cells.get(&near).and_then(|c| c.iter().find(close)) {
                return *w;
            }
        }
        cells.entry(cell).or_default().push(v as u32);
        v as u32
    };
    (0..points.len())
        .map(|v| {
            if open[v] {
                find(v, &mut cells)
            } else {
                v as u32
            }
        })
        .collect()
}
