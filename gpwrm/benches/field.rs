//! Building and evaluating fields at three sizes; throughput in nodes and in evaluations. With `--features rayon` the batches (and
//! `build`) take all cores; the rest is one thread either way.
#![allow(missing_docs, clippy::unwrap_used)]

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use gpwrm::{Field, FieldOptions};
use nalgebra::{Point3, UnitVector3, Vector3};
use std::hint::black_box;

/// A bent sheet of `side²` nodes, 10 mm apart, and how it waves.
fn sheet(side: u32) -> (Vec<Point3<f64>>, Vec<Vector3<f64>>) {
    let nodes: Vec<_> = (0..side * side)
        .map(|k| {
            let (x, y) = (f64::from(k % side) * 0.01, f64::from(k / side) * 0.01);
            Point3::new(x, y, 3.0 * (x * x + y * y))
        })
        .collect();
    let wave = |p: &Point3<f64>| 0.005 * Vector3::new((20.0 * p.y).sin(), p.z, (15.0 * p.x).cos());
    let moved = nodes.iter().map(wave).collect();
    (nodes, moved)
}

fn fields(criterion: &mut Criterion) {
    let options = FieldOptions::default();
    for side in [10, 24, 45] {
        let (nodes, moved) = sheet(side);
        let field = Field::new(&nodes, &moved, &options).unwrap();
        let count = u64::from(side * side);
        let between: Vec<_> = nodes
            .iter()
            .map(|p| p + Vector3::new(0.003, 0.002, 0.004))
            .collect();
        let mut group = criterion.benchmark_group("field");
        group
            .sample_size(20)
            .throughput(Throughput::Elements(count));
        group.bench_function(BenchmarkId::new("build", count), |b| {
            b.iter(|| Field::new(black_box(&nodes), &moved, &options).unwrap());
        });
        group.bench_function(BenchmarkId::new("displacement", count), |b| {
            b.iter(|| {
                between
                    .iter()
                    .map(|p| field.displacement(p))
                    .sum::<Vector3<f64>>()
            });
        });
        group.bench_function(BenchmarkId::new("evaluate", count), |b| {
            b.iter(|| {
                between
                    .iter()
                    .map(|p| field.evaluate(p).gradient.trace())
                    .sum::<f64>()
            });
        });
        group.bench_function(BenchmarkId::new("displacements", count), |b| {
            b.iter(|| field.displacements(black_box(&between)));
        });
        group.bench_function(BenchmarkId::new("evaluate_all", count), |b| {
            b.iter(|| field.evaluate_all(black_box(&between)));
        });
        group.bench_function(BenchmarkId::new("shape", count), |b| {
            b.iter(|| {
                between
                    .iter()
                    .map(|p| field.shape(p).functions.len())
                    .sum::<usize>()
            });
        });
        group.finish();
    }
}

/// Smoothing clouds of the same sizes; throughput in points.
fn surfaces(criterion: &mut Criterion) {
    for side in [10, 24, 45] {
        let (points, _) = sheet(side);
        let normals: Vec<_> = points
            .iter()
            .map(|p| UnitVector3::new_normalize(Vector3::new(-6.0 * p.x, -6.0 * p.y, 1.0)))
            .collect();
        let count = u64::from(side * side);
        let mut group = criterion.benchmark_group("surface");
        group
            .sample_size(20)
            .throughput(Throughput::Elements(count));
        group.bench_function(BenchmarkId::new("smooth", count), |b| {
            b.iter(|| gpwrm::mls::smooth(black_box(&points), &normals, 0.03).unwrap());
        });
        group.finish();
    }
}

criterion_group!(benches, fields, surfaces);
criterion_main!(benches);
