//! A session larger than the memory it may take: `cargo test --release -p dvrk-io --test big_session -- --ignored
//! --nocapture`. Size in GB: `$DVRK_IO_BIG_GB`, 4 unless given.
#![cfg(target_os = "linux")]
#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "tests"
)]

use std::path::Path;
use std::time::Instant;

use dvrk_io::session::{Compression, SessionReader, SessionWriter, WriterOptions};
use nalgebra::{Isometry3, Point3};

/// A camera of 640 × 480 pixels.
const POINTS: u32 = 307_200;

/// Most memory that this process ever had, MB.
fn peak() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status
        .lines()
        .find(|line| line.starts_with("VmHWM"))
        .unwrap();
    line.split_whitespace()
        .nth(1)
        .unwrap()
        .parse::<u64>()
        .unwrap()
        / 1024
}

fn record(path: &Path, gigabytes: f64, compression: Compression) -> u32 {
    let options = WriterOptions::default().with_compression(compression);
    let mut writer = SessionWriter::create_with(path, options).unwrap();
    let mut frames = 0;
    while f64::from(frames) * f64::from(POINTS) * 12.0 < gigabytes * 1e9 {
        let stamp = f64::from(frames) / 30.0;
        // Last bits that do not compress.
        let value =
            |i: u32| f64::from(i.wrapping_mul(2_654_435_761).wrapping_add(frames) >> 16) / 65536.0;
        let points: Vec<_> = (0..POINTS)
            .map(|i| Point3::new(value(i), f64::from(i / 640) / 480.0, 0.5))
            .collect();
        writer.points(stamp, &points).unwrap();
        for arm in ["PSM1", "PSM2"] {
            writer.pose(stamp, arm, &Isometry3::identity()).unwrap();
            writer.jaw(stamp, arm, 0.0).unwrap();
        }
        frames += 1;
    }
    writer.finish().unwrap();
    frames
}

#[test]
#[ignore = "writes 4 GB"]
fn a_big_session_takes_little_memory() {
    let gigabytes = std::env::var("DVRK_IO_BIG_GB").map_or(4.0, |text| text.parse().unwrap());
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    let path = folder.path().join("big.mcap");
    for (compression, gigabytes) in [
        (Compression::None, gigabytes),
        (Compression::Lz4, gigabytes / 4.0),
        (Compression::Zstd, gigabytes / 4.0),
    ] {
        let started = Instant::now();
        let written = record(&path, gigabytes, compression);
        let size = std::fs::metadata(&path).unwrap().len() as f64 * 1e-9;
        let (wrote, started) = (started.elapsed().as_secs_f64(), Instant::now());
        let (mut count, mut sum) = (0, 0.0);
        for frame in SessionReader::default().frames(&path).unwrap() {
            let frame = frame.unwrap();
            assert_eq!(frame.points.len(), POINTS as usize);
            sum += frame.points[7].x;
            count += 1;
        }
        assert_eq!(count, written);
        println!(
            "{compression:?}: {gigabytes} GB of clouds in a file of {size:.2} GB, {count} frames, written in {wrote:.1} s, read in {:.1} s, \
             peak of this process {} MB (sum {sum:.3})",
            started.elapsed().as_secs_f64(),
            peak()
        );
        assert!(peak() <= 200, "{} MB", peak());
    }
}
