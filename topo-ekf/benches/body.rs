//! Frames of the body filter.
#![allow(missing_docs, clippy::unwrap_used, reason = "a benchmark")]

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use nalgebra::{Point3, Rotation3, UnitVector3, Vector3};
use topo_ekf::Plane;
use topo_ekf::body::{BodyFilter, BodyFrame, BodyOptions, Embedding, Lattice, Row};

const SIZE: f64 = 0.016;
/// Cells of a block along each axis: 140, 600 and 2,057 nodes.
const BLOCKS: [[i32; 3]; 3] = [[6, 4, 3], [11, 9, 4], [16, 10, 10]];

fn block([nx, ny, nz]: [i32; 3]) -> (Lattice, Vec<Embedding>) {
    let mut lattice = Lattice::new(SIZE, Point3::origin(), Rotation3::identity());
    let mut surface = vec![];
    for z in 0..nz {
        for y in 0..ny {
            for x in 0..nx {
                let cell = lattice.ensure([x, y, z]);
                let faces = [
                    (x == 0, 0, 0.1),
                    (x == nx - 1, 0, 0.9),
                    (y == 0, 1, 0.1),
                    (y == ny - 1, 1, 0.9),
                    (z == 0, 2, 0.0),
                    (z == nz - 1, 2, 0.9),
                ];
                for (own, axis, at) in faces {
                    if own {
                        for k in 0..4 {
                            let (u, v) =
                                (0.25 + 0.5 * f64::from(k % 2), 0.25 + 0.5 * f64::from(k / 2));
                            let mut xi = [u, v, u];
                            xi[axis] = at;
                            xi[(axis + 1) % 3] = u;
                            xi[(axis + 2) % 3] = v;
                            surface.push(Embedding::new(cell, xi));
                        }
                    }
                }
            }
        }
    }
    (lattice, surface)
}

fn steps(c: &mut Criterion) {
    let mut group = c.benchmark_group("body");
    let table = Plane {
        normal: UnitVector3::new_unchecked(Vector3::z()),
        offset: 0.0,
    };
    for of in BLOCKS {
        let (lattice, surface) = block(of);
        let nodes = lattice.rest().len();
        let up = UnitVector3::new_normalize(Vector3::new(0.3, 0.2, 1.0));
        for (name, steps) in [("one", 1), ("four", 4)] {
            let options = BodyOptions::default()
                .with_steps(steps)
                .with_presteps(0)
                .with_tolerance(0.0);
            let mut filter = BodyFilter::new(lattice.clone(), table, &options).unwrap();
            let grip = Embedding::new(0, [0.5; 3]);
            let mut k = 0;
            group.bench_function(BenchmarkId::new(name, nodes), |b| {
                b.iter(|| {
                    let lift = 1e-3 * f64::from((k % 40) as i32 - 20).abs();
                    k += 1;
                    let held = [(grip, Point3::new(0.008, 0.008, 0.008 + lift))];
                    let frame = BodyFrame::new(&held, &surface);
                    filter
                        .step(
                            &frame,
                            &mut |lattice, pose, _| {
                                surface
                                    .iter()
                                    .map(|at| {
                                        Row::along(
                                            *at,
                                            pose.position(lattice, at)
                                                + Vector3::new(1e-4, 0.0, 1e-4),
                                            up,
                                            1e6,
                                        )
                                    })
                                    .collect()
                            },
                            &mut |_, _| {},
                        )
                        .unwrap()
                });
            });
        }
    }
    group.finish();
}

criterion_group!(benches, steps);
criterion_main!(benches);
