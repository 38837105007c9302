//! The bars of a frame: the linear update and whole steps (free, with 30 % of the vertices on the table), on the edges of a mesh and on a
//! graph with half as many again; steps with 200 separations and the same without; marginals, a new graph, and a dense
//! Cholesky factor of the same information matrix to compare with.
#![allow(missing_docs, clippy::unwrap_used, reason = "a benchmark")]

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use nalgebra::{DMatrix, Point3, Rotation3, UnitVector3, Vector3};
use topo_ekf::{Filter, Frame, Motion, Observation, Options, Plane};

#[path = "../tests/common/mod.rs"]
mod common;
use common::{Noise, ellipsoid, fold, sheet};

const SIZES: [usize; 3] = [500, 2000, 8000];
const FRAMES: usize = 20;
/// Each vertex is joined to this many nearest ones. Nearness is mostly mutual: 6 make 6.1 to 6.3 neighbours a vertex, as many as on
/// the edges of a closed mesh, and 9 make 9.5 to 9.7.
const NEAREST: [(&str, usize); 2] = [("mesh", 6), ("graph", 9)];

/// Ellipsoid of spacing about 4.5 mm, flattened below so that 30 % of its vertices lie on a plane.
fn body(count: usize, nearest: usize) -> (Vec<Point3<f64>>, Vec<[u32; 2]>, Plane) {
    let scale = (count as f64 / 1000.0).sqrt();
    let (mut points, edges) =
        ellipsoid(count, [0.055 * scale, 0.045 * scale, 0.03 * scale], nearest);
    let floor = -0.4 * 0.03 * scale;
    for p in &mut points {
        p.z = p.z.max(floor);
    }
    // The table is 2 mm higher: it is pressed against the whole bottom in every frame.
    let normal = UnitVector3::new_unchecked(Vector3::z());
    (
        points,
        edges,
        Plane {
            normal,
            offset: -(floor + 2e-3),
        },
    )
}

/// The upper side, while the body turns on the table by 1.5° a frame and back.
fn frames(rest: &[Point3<f64>], turning: bool) -> Vec<Vec<Observation>> {
    (0..FRAMES)
        .map(|frame| {
            let angle = if turning { 1.5 * frame as f64 } else { 0.0 };
            let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), angle.to_radians());
            let mut noise = Noise(frame as u64);
            (0..rest.len())
                .filter(|&i| rest[i].z > 0.0)
                .map(|i| Observation {
                    vertex: i as u32,
                    position: turn * rest[i] + noise.vector(5e-4),
                    sigma: 5e-4,
                })
                .collect()
        })
        .collect()
}

/// Back and forth, so that every frame is a small motion from the last.
fn at(k: usize) -> usize {
    let period = 2 * (FRAMES - 1);
    (k % period).min(period - k % period)
}

fn steps(c: &mut Criterion) {
    for (group, motion) in [("update", Motion::Still), ("step", Motion::Spread)] {
        let mut group = c.benchmark_group(group);
        for (edges_of, nearest) in NEAREST {
            for count in SIZES {
                let (rest, edges, table) = body(count, nearest);
                let frames = frames(&rest, motion == Motion::Spread);
                let options = Options::default().with_motion(motion);
                for (name, planes) in [("free", &[][..]), ("table_30_percent", &[table][..])] {
                    let mut filter = Filter::new(&rest, &edges, &options).unwrap();
                    let mut k = 0;
                    let id = BenchmarkId::new(format!("{edges_of}_{name}"), count);
                    group.bench_function(id, |b| {
                        b.iter(|| {
                            let frame = Frame::new(&frames[at(k)]).with_planes(planes);
                            k += 1;
                            filter.step(&frame).unwrap()
                        });
                    });
                }
            }
        }
        group.finish();
    }
}

fn contacts(c: &mut Criterion) {
    let mut group = c.benchmark_group("contact");
    for side in [22, 45, 90] {
        let (_, edges, triangles) = sheet(side, 4e-3);
        let fold = fold(side, 4e-3, if side == 22 { 4 } else { 5 });
        let plane = [Plane {
            normal: UnitVector3::new_unchecked(Vector3::z()),
            offset: 0.0,
        }];
        let frames: Vec<_> = (0..FRAMES)
            .map(|k| fold.pressed(4.5e-3 + 0.05e-3 * k as f64, k as u64))
            .collect();
        let mut filter = Filter::new(&fold.live, &edges, &Options::default()).unwrap();
        let mut k = 0;
        group.bench_function(BenchmarkId::new("free", side * side), |b| {
            b.iter(|| {
                k += 1;
                filter.step(&Frame::new(&frames[at(k)])).unwrap()
            });
        });
        let mut filter = Filter::new(&fold.live, &edges, &Options::default()).unwrap();
        let (mut k, mut pushing, mut solves) = (0, 0, 0);
        group.bench_function(
            BenchmarkId::new("table_and_separations", side * side),
            |b| {
                b.iter(|| {
                    let frame = Frame::new(&frames[at(k)])
                        .with_planes(&plane)
                        .with_triangles(&triangles);
                    k += 1;
                    let report = filter.step(&frame).unwrap();
                    (pushing, solves) = (pushing + report.pushing, solves + report.solves);
                });
            },
        );
        eprintln!(
            "{} pushing, {} solves a frame",
            pushing / k.max(1),
            solves / k.max(1)
        );
    }
    group.finish();
}

fn graphs(c: &mut Criterion) {
    let mut group = c.benchmark_group("graph");
    for (edges_of, nearest) in NEAREST {
        for count in SIZES {
            let (rest, edges, _) = body(count, nearest);
            let mut filter = Filter::new(&rest, &edges, &Options::default()).unwrap();
            filter.step(&Frame::new(&frames(&rest, true)[1])).unwrap();
            let id = |name| BenchmarkId::new(format!("{edges_of}_{name}"), count);
            group.bench_function(id("marginal_sigmas"), |b| {
                b.iter(|| filter.marginal_sigmas().unwrap());
            });
            let keep: Vec<_> = (0..rest.len() as u32).map(Some).collect();
            group.bench_function(id("set_graph"), |b| {
                b.iter(|| filter.set_graph(&rest, &rest, None, &edges, &keep).unwrap());
            });
        }
    }
    group.finish();
}

/// What the update costs without sparsity: the dense factor and three columns.
fn reference(c: &mut Criterion) {
    let mut group = c.benchmark_group("dense_reference");
    for count in [500, 2000] {
        let (rest, edges, _) = body(count, 9);
        let mut s = DMatrix::from_diagonal_element(count, count, 4e6);
        for e in &edges {
            let (i, j) = (e[0] as usize, e[1] as usize);
            s[(i, i)] += 4e6;
            s[(j, j)] += 4e6;
            s[(i, j)] -= 4e6;
            s[(j, i)] -= 4e6;
        }
        let rhs = DMatrix::from_fn(count, 3, |i, axis| rest[i][axis]);
        group.bench_function(BenchmarkId::new("factor_and_solve", count), |b| {
            b.iter(|| {
                use faer::linalg::solvers::Solve;
                let view = faer::MatRef::from_column_major_slice(s.as_slice(), count, count);
                let llt = view.llt(faer::Side::Lower).unwrap();
                llt.solve(faer::MatRef::from_column_major_slice(
                    rhs.as_slice(),
                    count,
                    3,
                ))
            });
        });
    }
    group.finish();
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .sample_size(15)
        .measurement_time(std::time::Duration::from_millis(800))
        .warm_up_time(std::time::Duration::from_millis(200));
    targets = steps, contacts, graphs, reference
}
criterion_main!(benches);
