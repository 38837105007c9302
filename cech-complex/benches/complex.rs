//! Nerve, reduction, vertex kinds and loops of ε-nets of a torus, three sizes; throughput in simplices.
#![allow(missing_docs, clippy::unwrap_used, reason = "a bench may panic")]

use cech_complex::manifolds::{Manifold, OrientedCloud};
use cech_complex::{Complex, Cylinder, Options, filtration_value};
use criterion::{BatchSize, BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};

const TORUS: Manifold = Manifold::Torus {
    major: 1.0,
    minor: 0.4,
};

fn build(cloud: &OrientedCloud) -> Complex {
    let radius = 1.25 * cloud.spacing;
    let cylinder = Cylinder::new(radius, 0.5 * radius).unwrap();
    Complex::build(&cloud.points, &cloud.normals, cylinder, &Options::default()).unwrap()
}

fn surfaces(c: &mut Criterion) {
    let mut group = c.benchmark_group("torus");
    group.sample_size(10);
    for count in [500, 2000, 8000] {
        let cloud = TORUS.net(count, 1);
        let complex = build(&cloud);
        let simplices: usize = complex.counts().iter().sum();
        group.throughput(Throughput::Elements(simplices as u64));
        group.bench_function(BenchmarkId::new("build", count), |b| {
            b.iter(|| build(&cloud));
        });
        group.bench_function(BenchmarkId::new("reduce", count), |b| {
            // A clone of a complex whose barcode has not been asked for has none either.
            b.iter_batched(
                || complex.clone(),
                |fresh| fresh.betti(1.0),
                BatchSize::LargeInput,
            );
        });
        group.bench_function(BenchmarkId::new("classify", count), |b| {
            b.iter(|| complex.classify(cloud.spacing).unwrap());
        });
        if count <= 2000 {
            group.bench_function(BenchmarkId::new("loops", count), |b| {
                b.iter(|| complex.representative_loops(1.0));
            });
        }
    }
    group.finish();
}

fn values(c: &mut Criterion) {
    let cloud = TORUS.net(2000, 1);
    let complex = build(&cloud);
    let cylinder = complex.cylinder();
    let mut group = c.benchmark_group("filtration_value");
    let mut bench = |name: &str, simplices: Vec<Vec<u32>>| {
        let pick = |simplex: &Vec<u32>| -> (Vec<_>, Vec<_>) {
            simplex
                .iter()
                .map(|&v| (cloud.points[v as usize], cloud.normals[v as usize]))
                .unzip()
        };
        let simplices: Vec<_> = simplices.iter().step_by(50).map(pick).collect();
        group.throughput(Throughput::Elements(simplices.len() as u64));
        group.bench_function(name, |b| {
            b.iter(|| -> f64 {
                simplices
                    .iter()
                    .map(|(p, n)| filtration_value(p, n, cylinder).unwrap().value)
                    .sum()
            });
        });
    };
    bench("pair", complex.edges().iter().map(|s| s.to_vec()).collect());
    bench(
        "triple",
        complex.triangles().iter().map(|s| s.to_vec()).collect(),
    );
    bench(
        "quadruple",
        complex.tetrahedra().iter().map(|s| s.to_vec()).collect(),
    );
    group.finish();
}

criterion_group!(benches, surfaces, values);
criterion_main!(benches);
