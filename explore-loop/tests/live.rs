//! What `--rrd` writes is read back by the maintainers' own reader: entities and rows as many as frames.
//!
//! Needs the feature `rerun`, and in `RERUN_PYTHON` a Python with the package rerun-sdk of the same version; without it the last test says that it
//! was skipped.
#![cfg(feature = "rerun")]
#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::print_stderr,
    reason = "tests"
)]

use std::path::Path;
use std::process::Command;

use dvrk_io::session::SessionWriter;
use explore_loop::nalgebra::{Isometry3, Point3, Vector3};
use serde_json::Value;

const FRAMES: i32 = 5;

/// A cap of an ellipsoid on a table, and an arm beside it.
fn record(path: &Path) -> usize {
    let point = |k: i32| {
        let (x, y) = (
            0.004 * f64::from(k % 40) - 0.078,
            0.004 * f64::from(k / 40) - 0.078,
        );
        let rest = 1.0 - (x / 0.05).powi(2) - (y / 0.035).powi(2);
        (rest > 0.02).then(|| Point3::new(x, y, 0.525 - 0.025 * rest.sqrt()))
    };
    let points: Vec<Point3<f64>> = (0..1600).filter_map(point).collect();
    let mut session = SessionWriter::create(path).unwrap();
    session.table(0.0, &-Vector3::z_axis(), 0.55).unwrap();
    for frame in 0..FRAMES {
        let stamp = 0.1 * f64::from(frame);
        session.points(stamp, &points).unwrap();
        let tip = Isometry3::translation(0.3, 0.0, 0.3);
        session.pose(stamp, "PSM1", &tip).unwrap();
        session.jaw(stamp, "PSM1", 0.8).unwrap();
    }
    session.finish().unwrap();
    points.len()
}

fn replay(session: &Path, more: &[&str], path: Option<&str>) -> std::process::Output {
    let out = session.with_file_name("out");
    let mut command = Command::new(env!("CARGO_BIN_EXE_explore"));
    command.arg("replay").arg(session).arg("--out").arg(out);
    if let Some(path) = path {
        command.env("PATH", path);
    }
    command
        .args(["--quiet", "--json"])
        .args(more)
        .output()
        .unwrap()
}

#[test]
fn a_file_that_cannot_be_written_and_a_viewer_that_is_not_there_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let session = folder.path().join("session.mcap");
    record(&session);
    let refused = |more: &[&str], words: &[&str]| {
        let output = replay(&session, more, Some("/nowhere"));
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{said}");
        assert!(
            said.lines().count() == 1 && words.iter().all(|w| said.contains(w)),
            "{said}"
        );
    };
    refused(
        &["--rrd", "no/such/folder/run.rrd"],
        &["no/such/folder/run.rrd"],
    );
    refused(&["--live"], &["rerun-sdk", "--rrd"]);
}

/// Prints how many rows each entity has and how many points the last clouds have.
const READ: &str = "
import json, sys, rerun.dataframe as rr
recording = rr.load_recording(sys.argv[1])
rows, last = {}, {}
for column in recording.schema().component_columns():
    if column.entity_path.startswith('/__'):
        continue
    view = recording.view(index=None if column.is_static else 'frame', contents=column.entity_path)
    table = (view.select_static(column) if column.is_static else view.select(column)).read_all()
    values = [v for v in table.column(table.num_columns - 1).to_pylist() if v is not None]
    name = column.entity_path
    rows[name] = max(rows.get(name, 0), len(values))
    if values and 'positions' in str(column):
        last[name] = len(values[-1])
print(json.dumps({'rows': rows, 'last': last}))
";

#[test]
fn the_maintainers_reader_finds_every_frame() {
    let Ok(python) = std::env::var("RERUN_PYTHON") else {
        eprintln!("skipped: RERUN_PYTHON names no Python with rerun-sdk");
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let session = folder.path().join("session.mcap");
    let points = record(&session);
    let file = folder.path().join("run.rrd");
    let output = replay(&session, &["--rrd", file.to_str().unwrap()], None);
    assert!(output.status.success(), "{output:?}");
    let metrics: Value = serde_json::from_slice(&output.stdout).unwrap();
    let read = Command::new(python)
        .args(["-c", READ])
        .arg(&file)
        .output()
        .unwrap();
    assert!(
        read.status.success(),
        "{}",
        String::from_utf8_lossy(&read.stderr)
    );
    let read: Value = serde_json::from_slice(&read.stdout).unwrap();
    let rows = |entity: &str| read["rows"][entity].as_i64().unwrap_or(0);
    for entity in [
        "/live/cloud",
        "/live/model",
        "/live/arms/PSM1",
        "/curves/vertices",
        "/curves/residual_mm",
        "/curves/frame_ms",
    ] {
        assert_eq!(rows(entity), i64::from(FRAMES), "{entity}: {read}");
    }
    for entity in ["/live/table", "/rest/surface", "/events"] {
        assert!(rows(entity) > 0, "{entity}: {read}");
    }
    assert_eq!(read["last"]["/live/cloud"], points);
    assert_eq!(read["last"]["/live/model"], metrics["vertices"]);
}
