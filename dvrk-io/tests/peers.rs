//! Sessions against two implementations that share no code with this one: the `mcap` and `rosbags` packages of PyPI,
//! both directions, every compression.
//!
//! They need a Python with both packages: `$DVRK_IO_PEERS` names one, else a virtual environment is made in the
//! `target` folder (once; it needs a network). Without Python the test says so and passes, unless
//! `$DVRK_IO_PEERS` is set: then it must work.
#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::float_cmp,
    clippy::print_stdout,
    reason = "tests; copied values must be the same bits"
)]

use std::path::{Path, PathBuf};
use std::process::Command;

use dvrk_io::Error;
use dvrk_io::session::{Compression, SessionReader, SessionWriter, WriterOptions};
use nalgebra::{Isometry3, Point3, Vector3};

/// A Python that has the peers, or why there is none.
fn python() -> Result<PathBuf, String> {
    if let Ok(path) = std::env::var("DVRK_IO_PEERS") {
        return Ok(PathBuf::from(path));
    }
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("peers");
    let python = folder.join("bin/python");
    let works = |python: &Path| {
        let imported = Command::new(python)
            .args(["-c", "import mcap, rosbags"])
            .output();
        imported.is_ok_and(|output| output.status.success())
    };
    if works(&python) {
        return Ok(python);
    }
    run(Command::new("python3").args(["-m", "venv"]).arg(&folder))?;
    run(Command::new(&python)
        .args([
            "-m",
            "pip",
            "install",
            "--quiet",
            "--disable-pip-version-check",
        ])
        .args(["mcap==1.6.0", "rosbags==0.11.9"]))?;
    Ok(python)
}

fn run(command: &mut Command) -> Result<String, String> {
    let output = command
        .output()
        .map_err(|error| format!("{command:?}: {error}"))?;
    if output.status.success() {
        return Ok(String::from_utf8_lossy(&output.stdout).into_owned());
    }
    Err(format!(
        "{command:?}: {}",
        String::from_utf8_lossy(&output.stderr)
    ))
}

fn script(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/peers")
        .join(name)
}

fn with_peers(check: impl FnOnce(&Path)) {
    // One of the two tests makes the environment, the other waits.
    static ONE: std::sync::Mutex<()> = std::sync::Mutex::new(());
    let python = ONE.lock().map(|_guard| python()).unwrap();
    match python {
        Ok(python) => check(&python),
        Err(reason) => println!("skipped: no Python with the packages mcap and rosbags: {reason}"),
    }
}

#[test]
fn what_they_write_is_read() {
    with_peers(|python| {
        let folder = tempfile::tempdir().unwrap();
        run(Command::new(python)
            .arg(script("write.py"))
            .arg(folder.path()))
        .unwrap();
        let mut sizes = Vec::new();
        for name in [
            "mcap_none.mcap",
            "mcap_lz4.mcap",
            "mcap_zstd.mcap",
            "bag_none",
            "bag_zstd",
        ] {
            let path = folder.path().join(name);
            let session =
                SessionReader::open(&path).unwrap_or_else(|error| panic!("{name}: {error}"));
            assert!(
                session.complete && session.skipped.is_empty(),
                "{name}: {:?}",
                session.skipped
            );
            assert_eq!(session.table, Some((-Vector3::z_axis(), 1.5)));
            assert_eq!(session.frames.len(), 20);
            for (k, frame) in (0_u32..).zip(&session.frames) {
                let k = f64::from(k);
                assert_eq!(frame.stamp, k / 10.0);
                let points: Vec<_> = (0..500 + k as u32)
                    .map(|i| Point3::new(f64::from(i) / 8.0, k, 1.0))
                    .collect();
                assert_eq!(frame.points, points);
                assert_eq!(
                    frame.arms[0].pose,
                    Some(Isometry3::translation(0.5, k, 0.25))
                );
            }
            let counts: Vec<_> = session.topics.iter().map(|topic| topic.count).collect();
            assert_eq!(counts, [20, 20, 1]);
            sizes.push(std::fs::metadata(&path).unwrap().len());
        }
        assert!(
            sizes[1] < sizes[0] / 2 && sizes[2] < sizes[0] / 2,
            "not compressed: {sizes:?}"
        );
        let refused = SessionReader::open(folder.path().join("bag_message"));
        assert!(
            matches!(&refused, Err(Error::BadBag { reason, .. }) if reason.contains("message")),
            "{refused:?}"
        );
    });
}

#[test]
fn what_is_written_they_read() {
    with_peers(|python| {
        let folder = tempfile::tempdir().unwrap();
        for compression in Compression::ALL {
            let path = folder.path().join("session.mcap");
            let expected = write(&path, compression);
            let mut command = Command::new(python);
            command
                .arg(script("read.py"))
                .arg(&path)
                .arg(compression.name());
            let printed = run(&mut command).unwrap();
            let parts: Vec<Vec<_>> = printed
                .split("rosbags\n")
                .map(|part| part.lines().collect())
                .collect();
            assert_eq!(parts.len(), 2);
            for part in parts {
                assert_eq!(part.len(), expected.len(), "{compression:?}");
                for (line, (topic, time, number)) in part.iter().zip(&expected) {
                    let words: Vec<_> = line.split(' ').collect();
                    assert_eq!(
                        (words[0], words[1].parse()),
                        (topic.as_str(), Ok(*time)),
                        "{line}"
                    );
                    let read: f64 = words[2].parse().unwrap();
                    // Sums of a few thousand terms in another order.
                    assert!(
                        (read - number).abs() <= 1e-9 * number.abs().max(1.0),
                        "{line}: {number}"
                    );
                }
            }
        }
    });
}

/// Writes a session, and returns topic, time and number of each message, sorted as their lines are.
fn write(path: &Path, compression: Compression) -> Vec<(String, u64, f64)> {
    let options = WriterOptions::default().with_compression(compression);
    let mut writer = SessionWriter::create_with(path, options).unwrap();
    let mut expected = Vec::new();
    let mut expect = |topic: &str, time, values: &[f64]| {
        let number = (1_u32..)
            .zip(values)
            .map(|(i, value)| f64::from(i) * value)
            .sum();
        expected.push((topic.to_owned(), time, number));
    };
    writer.table(0.0, &-Vector3::z_axis(), 1.5).unwrap();
    expect("/cell/table", 0, &[0.0, 0.0, -1.0, 1.5]);
    for k in 0_u32..20 {
        let (stamp, time) = (f64::from(k) * 0.5, u64::from(k) * 500_000_000);
        let value = |i: u32| f64::from(i * i % 1009) / 64.0;
        let points: Vec<_> = (0..1000 + k)
            .map(|i| Point3::new(value(i), -value(i + k), 1.0))
            .collect();
        writer.points(stamp, &points).unwrap();
        let values: Vec<f64> = points
            .iter()
            .flat_map(|point| [point.x, point.y, point.z])
            .collect();
        expect("/cell/points", time, &values);
        writer
            .pose(
                stamp,
                "PSM1",
                &Isometry3::translation(0.5, f64::from(k), 0.25),
            )
            .unwrap();
        expect(
            "/PSM1/measured_cp",
            time,
            &[0.5, f64::from(k), 0.25, 0.0, 0.0, 0.0, 1.0],
        );
        writer.jaw(stamp, "PSM1", 0.125).unwrap();
        expect("/PSM1/jaw/measured_js", time, &[0.125]);
    }
    writer.finish().unwrap();
    // As text, as the lines are sorted.
    expected.sort_by_key(|(topic, time, number)| format!("{topic} {time} {number}"));
    expected
}
