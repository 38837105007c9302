//! One frame of tracking at three sizes: free, on a table, folded onto itself; all marginals; a new graph.
#![allow(missing_docs, clippy::unwrap_used, reason = "a benchmark")]

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use nalgebra::{Point3, Rotation3, UnitVector3, Vector3};
use topo_ekf::{Filter, Frame, Observation, Options, Plane};

#[path = "../tests/common/mod.rs"]
mod common;
use common::{Noise, ellipsoid, sheet};

/// Half-seen ellipsoid of spacing about 4.5 mm that turns by 1.5° a frame.
fn observations(rest: &[Point3<f64>], frame: usize, sigma: f64) -> Vec<Observation> {
    let turn = Rotation3::from_axis_angle(&Vector3::y_axis(), (1.5 * frame as f64).to_radians());
    let mut noise = Noise(frame as u64);
    rest.iter()
        .enumerate()
        .map(|(i, p)| (i, turn * p))
        .filter(|(_, p)| p.z > 0.0)
        .map(|(i, p)| Observation {
            vertex: i as u32,
            position: p + noise.vector(sigma),
            sigma,
        })
        .collect()
}

fn body(count: usize) -> (Vec<Point3<f64>>, Vec<[u32; 2]>) {
    let scale = (count as f64 / 1000.0).sqrt();
    ellipsoid(count, [0.055 * scale, 0.045 * scale, 0.03 * scale], 8)
}

fn steps(c: &mut Criterion) {
    let mut group = c.benchmark_group("step");
    for count in [500, 1000, 2000] {
        let (rest, edges) = body(count);
        let scale = (count as f64 / 1000.0).sqrt();
        group.throughput(Throughput::Elements(1));
        let plane = [Plane {
            normal: UnitVector3::new_unchecked(Vector3::z()),
            offset: 0.027 * scale,
        }];
        for (name, planes) in [("free", &plane[..0]), ("table", &plane[..])] {
            let frames: Vec<_> = (0..20).map(|k| observations(&rest, k, 5e-4)).collect();
            let mut filter = Filter::new(&rest, &edges, &Options::default()).unwrap();
            let mut k = 0;
            group.bench_function(BenchmarkId::new(name, count), |b| {
                b.iter(|| {
                    // Back and forth, so that every frame is a small motion from the last.
                    let at = if k % 38 < 19 { k % 38 } else { 38 - k % 38 };
                    k += 1;
                    filter
                        .step(&Frame::new(&frames[at]).with_planes(planes))
                        .unwrap()
                });
            });
        }
    }
    group.finish();
}

fn contacts(c: &mut Criterion) {
    let mut group = c.benchmark_group("fold");
    for side in [22, 32, 45] {
        let spacing = 4e-3;
        let (flat, edges, triangles) = sheet(side, spacing);
        // Folded at 60 % of its width: a flap of 40 % lies 5 mm over the rest of the sheet.
        let (start, r) = (0.6 * side as f64 * spacing, 2.5e-3);
        let fold: Vec<_> = flat
            .iter()
            .map(|p| {
                let s = p.x - start;
                let a = (s / r).min(std::f64::consts::PI);
                let beyond = (s - std::f64::consts::PI * r).max(0.0);
                if s <= 0.0 {
                    *p
                } else {
                    Point3::new(start + r * a.sin() - beyond, p.y, r - r * a.cos())
                }
            })
            .collect();
        let plane = [Plane {
            normal: UnitVector3::new_unchecked(Vector3::z()),
            offset: 0.0,
        }];
        let frames: Vec<Vec<_>> = (0..20)
            .map(|k| {
                let mut noise = Noise(k);
                let drop = 4e-3 + 0.05e-3 * k as f64;
                fold.iter()
                    .enumerate()
                    .filter(|(_, p)| p.z > 4.9e-3)
                    .map(|(i, p)| Observation {
                        vertex: i as u32,
                        position: p - Vector3::z() * drop + noise.vector(2e-4),
                        sigma: 1e-3,
                    })
                    .collect()
            })
            .collect();
        let mut filter = Filter::new(&fold, &edges, &Options::default()).unwrap();
        let mut k = 0;
        group.bench_function(BenchmarkId::new("table_and_contacts", side * side), |b| {
            b.iter(|| {
                let at = if k % 38 < 19 { k % 38 } else { 38 - k % 38 };
                k += 1;
                let frame = Frame::new(&frames[at])
                    .with_planes(&plane)
                    .with_triangles(&triangles);
                filter.step(&frame).unwrap()
            });
        });
    }
    group.finish();
}

fn marginals(c: &mut Criterion) {
    let mut group = c.benchmark_group("graph");
    for count in [500, 1000, 2000] {
        let (rest, edges) = body(count);
        let mut filter = Filter::new(&rest, &edges, &Options::default()).unwrap();
        filter
            .step(&Frame::new(&observations(&rest, 1, 5e-4)))
            .unwrap();
        group.bench_function(BenchmarkId::new("marginal_sigmas", count), |b| {
            b.iter(|| filter.marginal_sigmas().unwrap());
        });
        let keep: Vec<_> = (0..rest.len() as u32).map(Some).collect();
        group.bench_function(BenchmarkId::new("set_graph", count), |b| {
            b.iter(|| filter.set_graph(&rest, &rest, None, &edges, &keep).unwrap());
        });
    }
    group.finish();
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(20).measurement_time(std::time::Duration::from_secs(1)).warm_up_time(std::time::Duration::from_millis(200));
    targets = steps, contacts, marginals
}
criterion_main!(benches);
