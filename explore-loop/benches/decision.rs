//! Time of what is computed between two manipulations, and at the end: the closed surface through a model, the topology by which the loop decides, and
//! the measures of a mesh; each for models of about 500, 2,000 and 8,000 vertices.
//!
//! The models are ellipsoids of three sizes with vertices 5 mm apart, seen from all sides, with noise of half a millimetre along the normals.
#![allow(missing_docs, clippy::unwrap_used)]

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use explore_loop::canonical::closed_surface::{ClosedSurfaceOptions, closed_surface};
use explore_loop::canonical::topology::analyse;
use explore_loop::canonical::{CanonicalModel, NewVertex};
use explore_loop::measure::{DoubledOptions, Sampling, Surface, compare, doubled};
use nalgebra::{Point3, UnitVector3, Vector3};
use std::f64::consts::PI;

/// Half axes at size 1, metres, and spacing of the vertices.
const AXES: [f64; 3] = [0.06, 0.045, 0.03];
const SPACING: f64 = 0.005;
/// Amplitude of the noise, metres.
const NOISE: f64 = 0.0005;

/// Points of the ellipsoid on a spiral from pole to pole, and its outward normals.
fn ellipsoid(size: f64) -> (Vec<Point3<f64>>, Vec<UnitVector3<f64>>) {
    let axes = Vector3::from(AXES) * size;
    // Knud Thomsen's formula for the area.
    let power = |a: f64, b: f64| (a * b).powf(1.6075);
    let mean = (power(axes.x, axes.y) + power(axes.x, axes.z) + power(axes.y, axes.z)) / 3.0;
    let count = (4.0 * PI * mean.powf(1.0 / 1.6075) / (0.8 * SPACING * SPACING)) as u32;
    let golden = PI * (3.0 - 5_f64.sqrt());
    let mut points = Vec::new();
    let mut normals = Vec::new();
    for k in 0..count {
        let z = 1.0 - (2.0 * f64::from(k) + 1.0) / f64::from(count);
        let (sin, cos) = (golden * f64::from(k)).sin_cos();
        let across = (1.0 - z * z).sqrt();
        let on_ball = Vector3::new(across * cos, across * sin, z);
        let normal = UnitVector3::new_normalize(on_ball.component_div(&axes));
        let noise = NOISE * (f64::from(k) * 12.9898).sin();
        points.push(Point3::from(
            on_ball.component_mul(&axes) + normal.scale(noise),
        ));
        normals.push(normal);
    }
    (points, normals)
}

fn decisions(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("decision");
    group.sample_size(10);
    for size in [0.63, 1.26, 2.52] {
        let (points, normals) = ellipsoid(size);
        let mut model = CanonicalModel::default();
        for (point, normal) in points.iter().zip(&normals) {
            model.push(NewVertex::new(*point, *normal), 0);
        }
        model.join(SPACING);
        let weights = vec![1.0; points.len()];
        let options = ClosedSurfaceOptions::new(SPACING);
        let close = || closed_surface(&points, &normals, &weights, &options).unwrap();
        let closed = close();
        let mesh = Surface::new(&closed.vertices, &closed.triangles).unwrap();
        let vertices = points.len();
        assert!(analyse(&model, SPACING).unwrap().is_closed());

        group.bench_function(BenchmarkId::new("closed_surface", vertices), |bencher| {
            bencher.iter(close);
        });
        group.bench_function(BenchmarkId::new("topology", vertices), |bencher| {
            bencher.iter(|| analyse(&model, SPACING).unwrap());
        });
        group.bench_function(BenchmarkId::new("accuracy", vertices), |bencher| {
            bencher.iter(|| compare(&mesh, &mesh, Sampling::default()));
        });
        group.bench_function(BenchmarkId::new("doubled", vertices), |bencher| {
            let options = DoubledOptions::default();
            bencher.iter(|| doubled(&mesh, &mesh, &options, Sampling::default()));
        });
    }
    group.finish();
}

criterion_group!(benches, decisions);
criterion_main!(benches);
