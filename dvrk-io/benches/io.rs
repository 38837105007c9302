//! Throughput of what runs for every frame or pose: decoding a cloud, reading a session, finding the object in
//! an image, kinematics; and calibration, which does not.
#![allow(missing_docs, clippy::unwrap_used, reason = "benches")]

#[path = "../tests/painted/mod.rs"]
mod painted;

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use dvrk_io::Psm;
use dvrk_io::calibration::{FitOptions, Sighting, Touch, fit_sightings, fit_touches};
use dvrk_io::cdr::{self, Endian, Header, PointCloud2};
use dvrk_io::depth::{Capsule, DepthImage, Intrinsics, ObjectOptions, Scan, find_object};
use dvrk_io::features::{FeatureOptions, Keypoint, Surface, detect, lift, match_features};
use dvrk_io::kinematics::{Kinematics, PsmWorkspace, RcmFromWrist};
use dvrk_io::session::{Compression, SessionReader, SessionWriter, WriterOptions};
use nalgebra::{Isometry3, Point3, Vector3};

fn points(count: usize) -> Vec<Point3<f64>> {
    let at = |index: usize| index as f64 / count as f64;
    (0..count)
        .map(|index| Point3::new(at(index), -at(index), 0.5))
        .collect()
}

fn clouds(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("decode cloud");
    for count in [1_000, 30_000, 300_000] {
        let cloud = PointCloud2::from_points(Header::default(), &points(count)).unwrap();
        let bytes = cdr::encode(&cloud, Endian::Little).unwrap();
        group.throughput(Throughput::Elements(count as u64));
        group.bench_with_input(
            BenchmarkId::from_parameter(count),
            &bytes,
            |bencher, bytes| {
                bencher.iter(|| {
                    cdr::decode::<PointCloud2>(black_box(bytes))
                        .unwrap()
                        .points()
                        .unwrap()
                });
            },
        );
    }
    group.finish();
}

fn sessions(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("read session of 1000-point frames");
    for frames in [10_u32, 100, 1_000] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("session.mcap");
        let mut writer = SessionWriter::create(&path).unwrap();
        for frame in 0..frames {
            let stamp = f64::from(frame) * 0.1;
            writer.points(stamp, &points(1_000)).unwrap();
            writer.pose(stamp, "PSM1", &Isometry3::identity()).unwrap();
        }
        writer.finish().unwrap();
        let bytes = std::fs::read(&path).unwrap();
        group.throughput(Throughput::Elements(u64::from(frames)));
        group.bench_with_input(
            BenchmarkId::from_parameter(frames),
            &bytes,
            |bencher, bytes| {
                bencher.iter(|| {
                    SessionReader::default()
                        .read_bytes(black_box(bytes))
                        .unwrap()
                });
            },
        );
    }
    group.finish();
}

/// A frame of 640 × 480 pixels: found and described, carried to 3-D, and matched with the frame before.
fn features(criterion: &mut Criterion) {
    let options = FeatureOptions::default();
    let seen = [0.0, 0.1].map(|turn| {
        let pose = Isometry3::new(Vector3::z() * 0.5, Vector3::x() * turn);
        painted::picture(painted::Body::Board, &pose, &painted::Paint::default(), 1)
    });
    let lifted = |seen: &painted::Picture, corners: &[Keypoint]| {
        let surface = Surface {
            scan: &seen.scan,
            object: Some(&seen.object),
            arms: &[],
        };
        lift(corners, &seen.image, &surface, &options).unwrap()
    };
    let corners = seen.each_ref().map(|seen| detect(&seen.image, &options));
    let [a, b] = [0, 1].map(|k| lifted(&seen[k], &corners[k]));
    let mut group = criterion.benchmark_group(format!("features of 640 × 480, {}", a.len()));
    group.bench_function("detect and describe", |bencher| {
        bencher.iter(|| detect(black_box(&seen[0].image), &options));
    });
    group.bench_function("carry to 3-D", |bencher| {
        bencher.iter(|| lifted(black_box(&seen[0]), &corners[0]));
    });
    group.bench_function("match two frames", |bencher| {
        bencher.iter(|| match_features(black_box(&a), &b, &options));
    });
    group.finish();
}

fn images(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("image to object, table known, 3 arms of 4 capsules");
    group.sample_size(20);
    for (width, height) in [(160, 120), (640, 480), (1280, 720)] {
        let camera = Intrinsics::new(
            width,
            height,
            [width as f64; 2],
            [width as f64 / 2.0, height as f64 / 2.0],
        )
        .unwrap();
        // A third of the image is a box on the table.
        let is_box = |pixel: usize| (width / 3..2 * width / 3).contains(&(pixel % width));
        let depths: Vec<f32> = (0..width * height)
            .map(|pixel| if is_box(pixel) { 0.45 } else { 0.5 })
            .collect();
        let image = DepthImage::from_metres(width, height, &depths).unwrap();
        let link = |index: i32| {
            let x = f64::from(index) * 0.02;
            Capsule {
                start: Point3::new(x, 0.0, 0.1),
                end: Point3::new(x, 0.1, 0.45),
                radius: 0.005,
            }
        };
        let arms: Vec<_> = (-6..6).map(link).collect();
        let options = ObjectOptions::default().with_table((-Vector3::z_axis(), 0.5));
        group.throughput(Throughput::Elements((width * height) as u64));
        group.bench_function(
            BenchmarkId::from_parameter(format!("{width}x{height}")),
            |bencher| {
                bencher.iter(|| {
                    let scan = Scan::from_image(black_box(&image), &camera).unwrap();
                    find_object(&scan, &arms, &options).unwrap()
                });
            },
        );
    }
    group.finish();
}

fn kinematics(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("kinematics");
    group.throughput(Throughput::Elements(1));
    let arm = Kinematics::new(Psm::Classic);
    let joints = [0.2, -0.3, 0.15, 0.7, -0.4, 0.5];
    let wrist = arm.rcm_from_wrist(&joints).unwrap();
    let tip = arm.tip_of(&wrist).0;
    let workspace = PsmWorkspace::new(arm, &Isometry3::identity()).unwrap();
    let outside = RcmFromWrist(Isometry3::translation(0.0, 0.0, -0.4) * wrist.0);
    group.bench_function("forward", |bencher| {
        bencher.iter(|| arm.rcm_from_wrist(black_box(&joints)).unwrap());
    });
    group.bench_function("inverse", |bencher| {
        bencher.iter(|| arm.inverse(black_box(&wrist)).unwrap());
    });
    group.bench_function("inverse, unreachable", |bencher| {
        bencher.iter(|| arm.inverse(black_box(&outside)).unwrap_err());
    });
    group.bench_function("workspace test", |bencher| {
        bencher.iter(|| workspace.contains(black_box(&tip)));
    });
    group.bench_function("Jacobian", |bencher| {
        bencher.iter(|| arm.wrist_jacobian(black_box(&joints)).unwrap());
    });
    group.finish();
}

fn calibration(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("calibration");
    let planted = Isometry3::new(Vector3::new(0.1, 0.0, 0.4), Vector3::new(0.5, 0.2, 1.0));
    let arm = Kinematics::new(Psm::Classic);
    for count in [8_i32, 32, 128] {
        let sightings: Vec<Sighting> = (0..count)
            .map(|i| {
                // A Lissajous figure of all joints.
                let at = |rate: f64| (rate * f64::from(i)).sin();
                let joints = [
                    0.5 * at(1.0),
                    0.5 * at(2.1),
                    0.15 + 0.04 * at(3.3),
                    at(4.7),
                    at(5.9),
                    at(7.1),
                ];
                let rcm_from_wrist = arm.rcm_from_wrist(&joints).unwrap();
                let camera_from_marker = planted * rcm_from_wrist.0 * planted;
                Sighting {
                    camera_from_marker,
                    rcm_from_wrist,
                }
            })
            .collect();
        let touches: Vec<Touch> = sightings
            .iter()
            .map(|sighting| sighting.rcm_from_wrist.0.translation.vector.into())
            .map(|rcm: Point3<f64>| Touch {
                camera: planted * rcm,
                rcm,
            })
            .collect();
        let options = FitOptions::default();
        group.throughput(Throughput::Elements(touches.len() as u64));
        group.bench_with_input(
            BenchmarkId::new("touches", count),
            &touches,
            |bencher, touches| {
                bencher.iter(|| fit_touches(black_box(touches), &options).unwrap());
            },
        );
        group.bench_with_input(
            BenchmarkId::new("sightings", count),
            &sightings,
            |bencher, sightings| {
                bencher.iter(|| fit_sightings(black_box(sightings), &options).unwrap());
            },
        );
    }
    group.finish();
}

fn objects(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("cloud to object, table found, 3 arms of 4 capsules");
    group.sample_size(20);
    for (width, height) in [(160_u32, 120_u32), (320, 240), (640, 480)] {
        let point = |index: u32| {
            let (u, v) = (f64::from(index % width), f64::from(index / width));
            let (x, y) = (u / f64::from(width) - 0.5, v / f64::from(width) - 0.375);
            // A dome on the table.
            let height = (0.01 - 0.25 * (x * x + y * y)).max(0.0).sqrt();
            let depth = 0.5 - height;
            Point3::new(x * depth, y * depth, depth)
        };
        let points: Vec<_> = (0..width * height).map(point).collect();
        let mut cloud = PointCloud2::from_points(Header::default(), &points).unwrap();
        (cloud.height, cloud.width, cloud.row_step) = (height, width, 12 * width);
        let link = |index: i32| Capsule {
            start: Point3::new(f64::from(index) * 0.02, 0.0, 0.1),
            end: Point3::new(f64::from(index) * 0.02, 0.1, 0.3),
            radius: 0.005,
        };
        let arms: Vec<_> = (-6..6).map(link).collect();
        group.throughput(Throughput::Elements(u64::from(width * height)));
        let name = BenchmarkId::from_parameter(format!("{width}x{height}"));
        group.bench_function(name, |bencher| {
            bencher.iter(|| {
                let scan = Scan::from_cloud(black_box(&cloud), None).unwrap();
                find_object(&scan, &arms, &ObjectOptions::default()).unwrap()
            });
        });
    }
    group.finish();
}

fn compressions(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("read session of 10 frames of 300,000 points");
    group.sample_size(10);
    for compression in Compression::ALL {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("session.mcap");
        let options = WriterOptions::default().with_compression(compression);
        let mut writer = SessionWriter::create_with(&path, options).unwrap();
        for frame in 0..10 {
            writer
                .points(f64::from(frame) * 0.1, &points(300_000))
                .unwrap();
        }
        writer.finish().unwrap();
        group.throughput(Throughput::Elements(10));
        group.bench_function(
            BenchmarkId::from_parameter(format!("{compression:?}")),
            |bencher| {
                bencher.iter(|| {
                    SessionReader::default()
                        .frames(&path)
                        .unwrap()
                        .map(Result::unwrap)
                        .count()
                });
            },
        );
    }
    group.finish();
}

criterion_group!(
    benches,
    clouds,
    sessions,
    compressions,
    features,
    images,
    objects,
    kinematics,
    calibration
);
criterion_main!(benches);
