//! One registration of a bumpy sheet at three cloud sizes, and the parts around it; throughput in frames.
#![allow(missing_docs, clippy::unwrap_used)]

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use nalgebra::Point3;
use nonrigid_reg::{Cloud, Options, Registrar, estimate_normals};
use std::hint::black_box;

/// A sheet of 0.2 m by 0.2 m with bumps, `side²` points.
fn sheet(side: u32, shift: f64, lift: f64) -> Vec<Point3<f64>> {
    let step = 0.2 / f64::from(side);
    (0..side * side)
        .map(|k| {
            let x = f64::from(k % side) * step + shift;
            let y = f64::from(k / side) * step + shift;
            let z = 0.008 * (50.0 * x).sin() * (40.0 * y).cos() + lift * x * x;
            Point3::new(x, y, z)
        })
        .collect()
}

fn frames(criterion: &mut Criterion) {
    let camera = Point3::new(0.1, 0.1, 0.6);
    let mut group = criterion.benchmark_group("frame");
    group.sample_size(20).throughput(Throughput::Elements(1));
    for side in [32, 55, 100] {
        let (before, after) = (sheet(side, 0.0, 0.0), sheet(side, 0.0007, 0.12));
        let normals = estimate_normals(&before, 16, &camera).unwrap();
        let normals_after = estimate_normals(&after, 16, &camera).unwrap();
        let source = Cloud {
            points: &before,
            normals: &normals,
        };
        let target = Cloud {
            points: &after,
            normals: &normals_after,
        };
        let mut registrar = Registrar::new(Options::default());
        group.bench_function(BenchmarkId::new("register", before.len()), |b| {
            b.iter(|| {
                registrar
                    .register(&source, &target, &[], &[], None)
                    .unwrap()
            });
        });
        group.bench_function(BenchmarkId::new("normals", before.len()), |b| {
            b.iter(|| estimate_normals(black_box(&before), 16, &camera).unwrap());
        });
    }
    group.finish();
}

criterion_group!(benches, frames);
criterion_main!(benches);
