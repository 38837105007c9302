//! Triangulation and surface graph, against surfaces with known results.
#![allow(missing_docs, clippy::unwrap_used)]

mod common;

use common::{at_rest, ellipsoid};
use explore_loop::canonical::graph::surface_edges;
use explore_loop::canonical::surface::{triangulate, vertex_areas};
use nalgebra::{Point3, UnitVector3, Vector3};
use proptest::prelude::*;
use std::collections::BTreeMap;

/// How many triangles lie at each undirected edge.
fn edge_counts(triangles: &[[u32; 3]]) -> BTreeMap<[u32; 2], usize> {
    let mut counts = BTreeMap::new();
    for t in triangles {
        for [a, b] in [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]] {
            *counts.entry([a.min(b), a.max(b)]).or_insert(0) += 1;
        }
    }
    counts
}

proptest! {
    /// The mesh of a sampled closed surface is closed, oriented outward, and has the analytic area of a sphere.
    #[test]
    fn a_sampled_sphere_meshes_closed(count in 300usize..900, radius in 0.02f64..0.2) {
        let (points, normals) = ellipsoid(count, [radius; 3]);
        let area = 4.0 * std::f64::consts::PI * radius * radius;
        let spacing = (area / count as f64).sqrt();
        let triangles = triangulate(&points, &normals, spacing);
        prop_assert!(edge_counts(&triangles).values().all(|c| *c == 2));
        // Euler: V - E + F = 2.
        prop_assert_eq!(triangles.len(), 2 * count - 4);
        let total: f64 = vertex_areas(&points, &triangles).iter().sum();
        // An inscribed polyhedron is smaller; of 300 points by less than 3 %.
        prop_assert!((0.97..1.0).contains(&(total / area)));
        for t in &triangles {
            let [a, b, c] = t.map(|i| points[i as usize]);
            prop_assert!((b - a).cross(&(c - a)).dot(&a.coords) > 0.0);
        }
    }
}

/// Two opposing sheets 2 mm apart at 5 mm spacing share no triangle and no edge.
#[test]
fn opposing_sheets_stay_apart() {
    let mut points = Vec::new();
    let mut normals = Vec::new();
    for side in [1.0, -1.0] {
        for i in 0..12 {
            for j in 0..12 {
                let wobble = 0.3 * (f64::from(i * 7 + j * 3)).sin();
                points.push(
                    Point3::new(
                        f64::from(i) + wobble * 0.3,
                        f64::from(j) + wobble,
                        0.2 * side,
                    ) * 5e-3,
                );
                normals.push(UnitVector3::new_normalize(Vector3::new(0.0, 0.0, side)));
            }
        }
    }
    let triangles = triangulate(&points, &normals, 5e-3);
    assert!(triangles.len() > 300);
    assert!(
        triangles
            .iter()
            .all(|t| t.iter().all(|i| *i < 144) || t.iter().all(|i| *i >= 144))
    );
    let model = at_rest(&points, &normals);
    assert!(
        surface_edges(&model, 5e-3)
            .iter()
            .all(|[a, b]| (*a < 144) == (*b < 144))
    );
}
