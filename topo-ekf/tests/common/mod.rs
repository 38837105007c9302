//! Bodies and small dense tools shared by the tests.
#![allow(
    dead_code,
    missing_docs,
    clippy::unwrap_used,
    reason = "each test file uses its own part"
)]

use std::collections::BTreeSet;

use nalgebra::{DMatrix, DVector, Point3, Rotation3, Vector3};
use topo_ekf::Options;

/// Deterministic noise: the same numbers in every run, on every machine.
pub struct Noise(pub u64);

impl Noise {
    /// Uniform in (0, 1), by splitmix64.
    pub fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64 + 1e-17
    }

    /// Standard normal, by Box and Muller.
    pub fn normal(&mut self) -> f64 {
        (-2.0 * self.uniform().ln()).sqrt() * (std::f64::consts::TAU * self.uniform()).cos()
    }

    pub fn vector(&mut self, sigma: f64) -> Vector3<f64> {
        Vector3::new(self.normal(), self.normal(), self.normal()) * sigma
    }
}

/// Ellipsoid with nearly uniform vertices (golden spiral), edges to the nearest neighbours.
pub fn ellipsoid(
    count: usize,
    half: [f64; 3],
    neighbours: usize,
) -> (Vec<Point3<f64>>, Vec<[u32; 2]>) {
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let points: Vec<_> = (0..count)
        .map(|i| {
            let z = 1.0 - (2.0 * i as f64 + 1.0) / count as f64;
            let (r, a) = ((1.0 - z * z).sqrt(), golden * i as f64);
            Point3::new(half[0] * r * a.cos(), half[1] * r * a.sin(), half[2] * z)
        })
        .collect();
    let edges = nearest_edges(&points, neighbours);
    (points, edges)
}

/// Undirected edges to the nearest neighbours, sorted.
pub fn nearest_edges(points: &[Point3<f64>], neighbours: usize) -> Vec<[u32; 2]> {
    let mut edges = BTreeSet::new();
    for (i, p) in points.iter().enumerate() {
        let mut order: Vec<usize> = (0..points.len()).filter(|&j| j != i).collect();
        order.sort_by(|&a, &b| (points[a] - p).norm().total_cmp(&(points[b] - p).norm()));
        for &j in order.iter().take(neighbours) {
            edges.insert([i.min(j) as u32, i.max(j) as u32]);
        }
    }
    edges.into_iter().collect()
}

/// Vertices, edges, triangles.
pub type Sheet = (Vec<Point3<f64>>, Vec<[u32; 2]>, Vec<[u32; 3]>);

/// Square sheet in the plane z = 0, its lattice edges with diagonals, its triangles.
pub fn sheet(side: usize, spacing: f64) -> Sheet {
    let at = |x: usize, y: usize| (y * side + x) as u32;
    let points = (0..side * side)
        .map(|k| {
            Point3::new(
                (k % side) as f64 * spacing,
                (k / side) as f64 * spacing,
                0.0,
            )
        })
        .collect();
    let (mut edges, mut triangles) = (vec![], vec![]);
    for y in 0..side {
        for x in 0..side {
            if x + 1 < side {
                edges.push([at(x, y), at(x + 1, y)]);
            }
            if y + 1 < side {
                edges.push([at(x, y), at(x, y + 1)]);
            }
            if x + 1 < side && y + 1 < side {
                edges.push([at(x, y), at(x + 1, y + 1)]);
                edges.push([at(x + 1, y), at(x, y + 1)]);
                triangles.push([at(x, y), at(x + 1, y), at(x + 1, y + 1)]);
                triangles.push([at(x, y), at(x + 1, y + 1), at(x, y + 1)]);
            }
        }
    }
    (points, edges, triangles)
}

pub fn turned(points: &[Point3<f64>], r: &Rotation3<f64>, t: &Vector3<f64>) -> Vec<Point3<f64>> {
    points.iter().map(|p| r * p + t).collect()
}

pub fn mean_error(
    found: &[Point3<f64>],
    truth: &[Point3<f64>],
    chosen: impl Fn(usize) -> bool,
) -> f64 {
    let picked: Vec<f64> = (0..truth.len())
        .filter(|&i| chosen(i))
        .map(|i| (found[i] - truth[i]).norm())
        .collect();
    picked.iter().sum::<f64>() / picked.len().max(1) as f64
}

/// A sheet folded onto itself and pressed.
pub struct Fold {
    /// Where it lies before the press: the flap 5 mm over the rest.
    pub live: Vec<Point3<f64>>,
    /// Vertices of the flap.
    pub flap: Vec<usize>,
    /// Vertices that a camera above sees: the flap and what it does not cover.
    pub seen: Vec<usize>,
}

/// A sheet of `side × side` vertices whose last `columns` columns are folded over the others.
pub fn fold(side: usize, spacing: f64, columns: usize) -> Fold {
    let (flat, _, _) = sheet(side, spacing);
    let r = 2.5e-3;
    let arc = std::f64::consts::PI * r;
    let start = (side - 1 - columns) as f64 * spacing - arc + 0.5 * spacing;
    let live: Vec<_> = flat
        .iter()
        .map(|p| {
            let s = p.x - start;
            let a = (s / r).min(std::f64::consts::PI);
            let beyond = (s - arc).max(0.0);
            if s <= 0.0 {
                *p
            } else {
                Point3::new(start + r * a.sin() - beyond, p.y, r - r * a.cos())
            }
        })
        .collect();
    let raised = |i: &usize| live[*i].z > 2.0 * r - 1e-4;
    let flap: Vec<usize> = (0..live.len()).filter(raised).collect();
    let edge = flap
        .iter()
        .map(|&i| live[i].x)
        .fold(f64::INFINITY, f64::min);
    let seen = (0..live.len())
        .filter(|i| raised(i) || live[*i].x < edge)
        .collect();
    Fold { live, flap, seen }
}

impl Fold {
    /// What the camera reports when the flap has come down by `drop`.
    pub fn pressed(&self, drop: f64, seed: u64) -> Vec<topo_ekf::Observation> {
        let mut noise = Noise(seed);
        let down = |i: usize| if self.flap.contains(&i) { drop } else { 0.0 };
        self.seen
            .iter()
            .map(|&i| topo_ekf::Observation {
                vertex: i as u32,
                position: self.live[i] - Vector3::z() * down(i) + noise.vector(2e-4),
                sigma: 1e-3,
            })
            .collect()
    }
}

/// `diag(d + anchor) + Σ w (e_i − e_j)(e_i − e_j)ᵀ`, dense.
pub fn dense_information(
    information: &[f64],
    edges: &[[u32; 2]],
    options: &Options,
) -> DMatrix<f64> {
    let n = information.len();
    let mut s = DMatrix::from_diagonal(&DVector::from_column_slice(information));
    for i in 0..n {
        s[(i, i)] += options.anchor_sigma.powi(-2);
    }
    let w = options.edge_sigma.powi(-2);
    for e in edges {
        let (i, j) = (e[0] as usize, e[1] as usize);
        s[(i, i)] += w;
        s[(j, j)] += w;
        s[(i, j)] -= w;
        s[(j, i)] -= w;
    }
    s
}
