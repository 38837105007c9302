//! Parts of a frame of the body filter at 140, 600 and 2,057 nodes: one step and nothing else, four steps, contact with the table and its
//! projection, fitting of rotations, covariances; self-contact of a sphere.
#![allow(missing_docs, clippy::unwrap_used, reason = "a benchmark")]

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use nalgebra::{Point3, Rotation3, UnitVector3, Vector3};
use topo_ekf::Plane;
use topo_ekf::body::{
    BodyFilter, BodyFrame, BodyOptions, Embedding, Lattice, Pose, Row, SelfContact,
};

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

fn parts(c: &mut Criterion) {
    let mut group = c.benchmark_group("body");
    let up = UnitVector3::new_unchecked(Vector3::z());
    for of in BLOCKS {
        let (lattice, surface) = block(of);
        let nodes = lattice.rest().len();
        let askew = UnitVector3::new_normalize(Vector3::new(0.3, 0.2, 1.0));
        // Under the body there is nothing, or it is pressed onto the table so that a good many points lie lower.
        for (name, steps, offset) in [
            ("one_step", 1, 1.0),
            ("four_steps", 4, 1.0),
            ("four_steps_table_and_projection", 4, 0.0),
        ] {
            let table = Plane { normal: up, offset };
            let options = BodyOptions::default()
                .with_steps(steps)
                .with_presteps(0)
                .with_tolerance(0.0);
            let mut filter = BodyFilter::new(lattice.clone(), table, &options).unwrap();
            if offset > 0.0 {
                filter.set_feet(vec![]);
            }
            let grip = Embedding::new(0, [0.5; 3]);
            let mut k = 0;
            group.bench_function(BenchmarkId::new(name, nodes), |b| {
                b.iter(|| {
                    let lift = 1e-3 * f64::from(k % 40 - 20).abs();
                    k += 1;
                    let held = [(grip, Point3::new(0.008, 0.008, 0.008 + lift))];
                    let observe = |lattice: &Lattice, pose: &Pose| {
                        let seen = |at: &Embedding| {
                            let target = pose.position(lattice, at) + Vector3::new(1e-4, 0.0, 1e-4);
                            Row::along(*at, target, askew, 1e6)
                        };
                        surface.iter().map(seen).collect()
                    };
                    filter
                        .step(
                            &BodyFrame::new(&held, &surface),
                            &mut |lattice, pose, _| observe(lattice, pose),
                            &mut |_, _| {},
                        )
                        .unwrap()
                });
            });
            if steps == 1 {
                let mut pose = filter.pose().clone();
                group.bench_function(BenchmarkId::new("fit_rotations", nodes), |b| {
                    b.iter(|| pose.fit_turns(&lattice));
                });
                let few = &surface[..surface.len().min(20)];
                for (name, points) in [("sigmas_20_points", few), ("sigmas_surface", &surface)] {
                    group.bench_function(BenchmarkId::new(name, nodes), |b| {
                        b.iter(|| filter.marginal_sigmas(points).unwrap());
                    });
                }
            }
        }
    }
    group.finish();
}

/// A sphere of 0.1 m across: nothing is near, everything is looked at.
fn sphere() -> (Vec<Point3<f64>>, Vec<[u32; 3]>) {
    let ball = parry3d_f64::shape::Ball::new(0.05);
    let (points, triangles) = ball.to_trimesh(50, 52);
    let points = points.iter().map(|p| Point3::new(p.x, p.y, p.z)).collect();
    (points, triangles)
}

fn self_contact(c: &mut Criterion) {
    let mut group = c.benchmark_group("body");
    let (rest, triangles) = sphere();
    let places = vec![Embedding::new(0, [0.5; 3]); rest.len()];
    group.bench_function(BenchmarkId::new("self_contact_new", rest.len()), |b| {
        b.iter(|| SelfContact::new(&triangles, &rest, 5e-4).unwrap());
    });
    let mut contact = SelfContact::new(&triangles, &rest, 5e-4).unwrap();
    group.bench_function(BenchmarkId::new("self_contact_frame", rest.len()), |b| {
        b.iter(|| contact.inequalities(&rest, &places).unwrap());
    });
    group.finish();
}

criterion_group!(benches, parts, self_contact);
criterion_main!(benches);
