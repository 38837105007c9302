//! Time of a frame of reconstruction while a body is held and turned, and of its parts, at three sizes of the model: about 500, 2,000 and 8,000
//! vertices; and of a re-fusion.
//!
//! An ellipsoid is looked at, taken, and turned by 60 degrees; then two neighbouring frames alternate, so that every frame moves. Parts are summed over
//! the steps of a frame. Variances, projection and self-contact have their own bench in topo-ekf. Two versions are compared by
//! `-- --save-baseline before` on the one and `-- --baseline before` on the other, with one target folder.
#![allow(missing_docs, clippy::unwrap_used)]

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use explore_loop::cell::{ArmState, Observation, Plane};
use explore_loop::reconstruct::{FrameParts, ReconstructOptions, Reconstructor};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use std::time::{Duration, Instant};

/// Half axes at size 1, distance of the table, metres; spacing of the model.
const AXES: [f64; 3] = [0.06, 0.045, 0.03];
const TABLE: f64 = 1.0;
const SPACING: f64 = 0.005;
/// Turn in a frame, degrees.
const STEP_DEG: f64 = 2.0;

fn table() -> Plane {
    Plane {
        normal: -Vector3::z_axis(),
        offset: TABLE,
    }
}

/// The body turned about its long axis, always just touching the table.
fn motion(size: f64, turned: u32) -> Isometry3<f64> {
    let angle = (f64::from(turned) * STEP_DEG).to_radians();
    let height = size * (AXES[2] * angle.cos()).hypot(AXES[1] * angle.sin());
    Isometry3::from_parts(
        Translation3::new(0.0, 0.0, TABLE - height),
        UnitQuaternion::from_axis_angle(&Vector3::x_axis(), angle),
    )
}

/// What a pinhole at the origin sees of the body, a point every 2.5 mm on the table.
fn render(size: f64, camera_from_body: &Isometry3<f64>) -> Vec<Point3<f64>> {
    let axes = Vector3::from(AXES) * size;
    let inverse = camera_from_body.inverse();
    let eye = (inverse * Point3::origin()).coords.component_div(&axes);
    let half = (axes.x / TABLE / 0.0025 * 1.2) as i32;
    let mut points = Vec::new();
    for u in -half..half {
        for v in -half..half {
            let ray = Vector3::new(f64::from(u), f64::from(v), 0.0) * 0.0025 + Vector3::z();
            let way = (inverse * ray).component_div(&axes);
            let (a, b, c) = (way.norm_squared(), way.dot(&eye), eye.norm_squared() - 1.0);
            if b * b >= a * c {
                points.push(Point3::from(ray * ((-b - (b * b - a * c).sqrt()) / a)));
            }
        }
    }
    points
}

fn frame(size: f64, turned: u32, holding: bool) -> Observation {
    let at = motion(size, turned);
    let arms = [1.0, -1.0].map(|side| ArmState {
        camera_from_tip: at * Isometry3::translation(side * 0.93 * AXES[0] * size, 0.0, 0.0),
        jaw: if holding { 0.0 } else { 0.8 },
        holding,
        moving: holding,
    });
    Observation {
        stamp: 0.0,
        camera: None,
        points: render(size, &at),
        colours: None,
        features: None,
        arms: arms.into(),
    }
}

type Part = fn(&FrameParts) -> f64;

const PARTS: [(&str, Part); 5] = [
    ("prepare", |p| p.prepare),
    ("match", |p| p.matching),
    ("assemble", |p| p.assemble),
    ("factor", |p| p.factor),
    ("grow", |p| p.grow),
];

fn frames(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("frame");
    group.sample_size(20);
    for size in [1.0, 2.06, 4.25] {
        let mut reconstructor = Reconstructor::new(ReconstructOptions::new(SPACING)).unwrap();
        for number in 0..36_u32 {
            let observation = frame(size, number.saturating_sub(6).min(30), number >= 4);
            reconstructor.process(&observation, &table()).unwrap();
        }
        let pair = [frame(size, 31, true), frame(size, 30, true)];
        let mut next = 0;
        let vertices = reconstructor.model().len();
        let mut process = |reconstructor: &mut Reconstructor| {
            next = 1 - next;
            reconstructor.process(&pair[1 - next], &table()).unwrap()
        };
        group.bench_function(BenchmarkId::new("whole", vertices), |bencher| {
            bencher.iter(|| process(&mut reconstructor));
        });
        for (name, part) in PARTS {
            group.bench_function(BenchmarkId::new(name, vertices), |bencher| {
                bencher.iter_custom(|frames| {
                    let ms: f64 = (0..frames)
                        .map(|_| part(&process(&mut reconstructor).parts))
                        .sum();
                    Duration::from_secs_f64(1e-3 * ms)
                });
            });
        }
        group.bench_function(BenchmarkId::new("fuse", vertices), |bencher| {
            bencher.iter_custom(|times| {
                let mut spent = Duration::ZERO;
                for _ in 0..times {
                    process(&mut reconstructor);
                    let began = Instant::now();
                    reconstructor.consolidate(&table());
                    spent += began.elapsed();
                }
                spent
            });
        });
    }
    group.finish();
}

criterion_group!(benches, frames);
criterion_main!(benches);
