//! Nerve, values, barcode, Betti numbers with and without the complex, vertex kinds, loops and updates of ε-nets of a torus, three sizes; throughput in simplices.
#![allow(missing_docs, clippy::unwrap_used, reason = "a bench may panic")]

use cech_complex::manifolds::{Manifold, OrientedCloud};
use cech_complex::{Change, Complex, Cylinder, Options, betti_numbers, filtration_value};
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
        // A clone of a complex that has not been asked knows neither values nor barcode.
        group.bench_function(BenchmarkId::new("betti", count), |b| {
            b.iter_batched_ref(
                || complex.clone(),
                |fresh| fresh.betti(1.0),
                BatchSize::LargeInput,
            );
        });
        group.bench_function(BenchmarkId::new("values", count), |b| {
            b.iter_batched_ref(
                || complex.clone(),
                |fresh| fresh.tetrahedron_values().len(),
                BatchSize::LargeInput,
            );
        });
        complex.tetrahedron_values();
        group.bench_function(BenchmarkId::new("barcode", count), |b| {
            b.iter_batched_ref(
                || complex.clone(),
                |fresh| fresh.barcode().bars().len(),
                BatchSize::LargeInput,
            );
        });
        group.bench_function(BenchmarkId::new("betti_numbers", count), |b| {
            let (cylinder, options) = (complex.cylinder(), Options::default());
            b.iter(|| betti_numbers(&cloud.points, &cloud.normals, cylinder, &options));
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

/// Five points in a hundred are added: the last ones of the net, scattered evenly, or the last ones by angle, a patch such as a camera
/// uncovers. Values of the others are known before. Throughput in added points.
fn updates(c: &mut Criterion) {
    let mut group = c.benchmark_group("torus_update");
    group.sample_size(10);
    for count in [500, 2000, 8000] {
        let cloud = TORUS.net(count, 1);
        let mut order: Vec<usize> = (0..count).collect();
        for name in ["scattered", "patch"] {
            if name == "patch" {
                let angle = |i: usize| cloud.points[i].y.atan2(cloud.points[i].x);
                order.sort_by(|&a, &b| angle(a).total_cmp(&angle(b)));
            }
            let (old, new) = order.split_at(count - count / 20);
            let mut before = cloud.clone();
            before.points = old.iter().map(|&i| cloud.points[i]).collect();
            before.normals = old.iter().map(|&i| cloud.normals[i]).collect();
            let complex = build(&before);
            complex.tetrahedron_values();
            let add = |&i: &usize| Change::Add {
                point: cloud.points[i],
                normal: cloud.normals[i],
            };
            let changes: Vec<Change> = new.iter().map(add).collect();
            group.throughput(Throughput::Elements(changes.len() as u64));
            group.bench_function(BenchmarkId::new(name, count), |b| {
                b.iter_batched_ref(
                    || complex.clone(),
                    |complex| complex.update(&changes).unwrap(),
                    BatchSize::LargeInput,
                );
            });
            group.bench_function(BenchmarkId::new(format!("{name}, betti"), count), |b| {
                b.iter_batched_ref(
                    || complex.clone(),
                    |complex| {
                        complex.update(&changes).unwrap();
                        complex.betti(1.0)
                    },
                    BatchSize::LargeInput,
                );
            });
            group.bench_function(BenchmarkId::new(format!("{name}, values"), count), |b| {
                b.iter_batched_ref(
                    || complex.clone(),
                    |complex| {
                        complex.update(&changes).unwrap();
                        complex.tetrahedron_values().len()
                    },
                    BatchSize::LargeInput,
                );
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

criterion_group!(benches, surfaces, updates, values);
criterion_main!(benches);
