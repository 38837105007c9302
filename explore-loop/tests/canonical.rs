//! The canonical model against surfaces whose answer is known by construction.
#![allow(missing_docs, clippy::unwrap_used)]

use explore_loop::canonical::closure::{meetings, relax};
use explore_loop::canonical::graph::surface_edges;
use explore_loop::canonical::surface::{triangulate, vertex_areas};
use explore_loop::canonical::{CanonicalModel, NewVertex};
use nalgebra::{Matrix3, Point3, Rotation3, UnitVector3, Vector3};
use proptest::prelude::*;
use std::collections::BTreeMap;

/// Fibonacci points on an ellipsoid, with exact normals.
fn ellipsoid(count: usize, axes: [f64; 3]) -> (Vec<Point3<f64>>, Vec<UnitVector3<f64>>) {
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    (0..count)
        .map(|i| {
            let z = 1.0 - 2.0 * (i as f64 + 0.5) / count as f64;
            let r = (1.0 - z * z).sqrt();
            let (s, c) = (golden * i as f64).sin_cos();
            let p = Point3::new(axes[0] * r * c, axes[1] * r * s, axes[2] * z);
            let n = Vector3::new(
                p.x / axes[0].powi(2),
                p.y / axes[1].powi(2),
                p.z / axes[2].powi(2),
            );
            (p, UnitVector3::new_normalize(n))
        })
        .unzip()
}

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

fn at_rest(points: &[Point3<f64>], normals: &[UnitVector3<f64>]) -> CanonicalModel {
    let mut model = CanonicalModel::default();
    for (p, n) in points.iter().zip(normals) {
        model.push(
            NewVertex {
                rest: *p,
                rest_normal: *n,
                live: *p,
                rotation: Matrix3::identity(),
            },
            0,
        );
    }
    model
}

/// A tube seen strip by strip: its live shape is right, its rest shape accumulated a drift around the
/// circumference. Where the last strip meets the first, the closure spreads the mismatch and the tube is round again.
#[test]
fn a_drifted_tube_closes() {
    let (around, along, radius, spacing) = (40usize, 12usize, 0.0318, 5e-3);
    let mut model = CanonicalModel::default();
    let mut truth = Vec::new();
    for a in 0..around {
        let angle = std::f64::consts::TAU * a as f64 / around as f64;
        // Past the half that was seen first, rest drifts: 8 mm of radius and 10 degrees by the last strip.
        let late = (a as f64 / around as f64 - 0.5).max(0.0) * 2.0;
        let drifted = angle - late * 10f64.to_radians();
        for l in 0..along {
            let y = l as f64 * spacing;
            let at = |angle: f64, r: f64| Point3::new(r * angle.cos(), y, r * angle.sin());
            let normal = |angle: f64| {
                UnitVector3::new_normalize(Vector3::new(angle.cos(), 0.0, angle.sin()))
            };
            let turn = Rotation3::from_axis_angle(&Vector3::y_axis(), -(angle - drifted));
            model.push(
                NewVertex {
                    rest: at(drifted, radius + 8e-3 * late),
                    rest_normal: normal(drifted),
                    live: at(angle, radius),
                    rotation: *turn.matrix(),
                },
                if a < around / 2 { 0 } else { a as u32 },
            );
            truth.push(at(angle, radius));
        }
    }
    model.edges = surface_edges(&model, spacing);
    let error = |m: &CanonicalModel| {
        m.rest
            .iter()
            .zip(&truth)
            .map(|(a, b)| (a - b).norm())
            .sum::<f64>()
            / truth.len() as f64
    };
    let before = error(&model);
    let measured = vec![true; model.len()];
    let met = meetings(&model, &measured, spacing);
    assert!(met.len() >= along, "{} meetings", met.len());
    let anchored: Vec<bool> = model.born.iter().map(|b| *b == 0).collect();
    relax(&mut model, &met, &anchored).unwrap();
    let after = error(&model);
    // The drifted strips are also too long by the planted radius, and the relaxation keeps lengths: nearly half of
    // the error is what spreading the gap can take away.
    assert!(
        before > 2e-3 && after < 0.6 * before,
        "mean error {before} before, {after} after"
    );
    let left = meetings(&model, &measured, spacing);
    assert!(
        left.len() < met.len() / 4,
        "{} of {} mismatches left",
        left.len(),
        met.len()
    );
}

/// A model without a mismatch has nothing to close.
#[test]
fn a_consistent_model_has_no_meetings() {
    let (points, normals) = ellipsoid(800, [0.06, 0.04, 0.03]);
    let mut model = at_rest(&points, &normals);
    model.edges = surface_edges(&model, 5e-3);
    let turn = Rotation3::from_euler_angles(0.4, -1.0, 2.0);
    for p in &mut model.live {
        *p = turn * *p + Vector3::new(0.1, 0.2, 0.3);
    }
    model.rotations = vec![*turn.matrix(); model.len()];
    assert!(meetings(&model, &vec![true; model.len()], 5e-3).is_empty());
}
