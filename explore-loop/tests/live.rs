//! The live view: the content of `live.rrd`, the data sent to a viewer, and the reaction to a viewer that is absent, hangs or disconnects.
//!
//! The file is read by the Rust reader of Rerun's makers, and checked by their program and their Python package: `$EXPLORE_RERUN` names a Python that
//! has `rerun-sdk`, else a virtual environment is made in the `target` folder (once; it needs a network and 300 MB). Without Python those tests say so
//! and pass, unless `$EXPLORE_RERUN` is set: then it must work.
#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "tests"
)]

mod live {
    pub mod rrd;
}

use dvrk_io::session::SessionWriter;
use explore_loop::nalgebra::{Isometry3, Point3, Vector3};
use live::rrd::{Row, Rows, read, try_read};
use serde_json::Value;
use std::io::Read;
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

/// Frames of the recording that is replayed.
const FRAMES: i32 = 6;

/// Entities that have a row a frame, whatever is explored.
const EVERY_FRAME: [&str; 9] = [
    "/live/cloud",
    "/live/model",
    "/live/grips",
    "/curves/share/measured",
    "/curves/share/overlap",
    "/curves/mm/residual",
    "/curves/mm/moved",
    "/curves/ms/frame",
    "/curves/count/vertices",
];

fn explore(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_explore"))
        .args(arguments)
        .output()
        .unwrap()
}

fn said(output: &Output) -> String {
    let said = String::from_utf8(output.stderr.clone()).unwrap();
    assert!(!said.contains("panicked"), "{said}");
    said
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// A cap of an ellipsoid on a table, and an arm beside it.
fn record(path: &Path) -> usize {
    let point = |k: i32| {
        let (x, y) = (
            0.002 * f64::from(k % 60) - 0.06,
            0.002 * f64::from(k / 60) - 0.06,
        );
        let rest = 1.0 - (x / 0.05).powi(2) - (y / 0.035).powi(2);
        (rest > 0.02).then(|| Point3::new(x, y, 0.525 - 0.025 * rest.sqrt()))
    };
    let points: Vec<Point3<f64>> = (0..3600).filter_map(point).collect();
    let mut session = SessionWriter::create(path).unwrap();
    session.table(0.0, &-Vector3::z_axis(), 0.525).unwrap();
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

/// The recording in a folder of its own, and where its results go.
struct Replay {
    folder: tempfile::TempDir,
    points: usize,
}

impl Replay {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let points = record(&folder.path().join("session.mcap"));
        Self { folder, points }
    }

    fn out(&self) -> PathBuf {
        self.folder.path().join("out")
    }

    fn command(&self, live: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_explore"));
        command
            .arg("replay")
            .arg(self.folder.path().join("session.mcap"))
            .args(["--json", live, "--out"])
            .arg(self.out());
        command
    }
}

/// The frames in which an entity has a row, in their order.
fn frames(rows: &Rows, entity: &str) -> Vec<i64> {
    let rows = rows.get(entity).map_or(&[][..], Vec::as_slice);
    rows.iter()
        .filter_map(|row| row.at)
        .map(|(frame, _)| frame)
        .collect()
}

#[track_caller]
fn is_in_every_frame(rows: &Rows, entity: &str, count: i64) {
    let expected: Vec<i64> = (0..count).collect();
    assert_eq!(frames(rows, entity), expected, "{entity}");
}

fn values(row: &Row, component: &str) -> Option<usize> {
    row.values.get(component).copied()
}

/// The table of the frames without what the clock says.
fn without_times(csv: &str) -> String {
    let header: Vec<&str> = csv.lines().next().unwrap().split(',').collect();
    let kept = |line: &str| -> String {
        let cells = line.split(',').zip(&header);
        let kept = cells.filter(|(_, name)| !name.ends_with("_ms"));
        kept.map(|(cell, _)| cell).collect::<Vec<_>>().join(",")
    };
    csv.lines().map(|line| kept(line) + "\n").collect()
}

fn metrics_without_times(path: &Path) -> Value {
    let mut metrics: Value = serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap();
    for key in ["registration_ms", "frame_ms", "wall_s"] {
        assert!(
            metrics.as_object_mut().unwrap().remove(key).is_some(),
            "{key}"
        );
    }
    metrics
}

/// A whole exploration: every entity has its rows, and nothing else of the results is touched.
#[test]
fn a_run_is_in_its_file_and_does_not_notice() {
    let folder = tempfile::tempdir().unwrap();
    let [plain, live] = ["plain", "live"].map(|name| folder.path().join(name));
    for (out, more) in [(&plain, &[][..]), (&live, &["--live=file"])] {
        let arguments = ["run", "--scene", "ellipsoid", "--quiet", "--out", text(out)];
        let output = explore(&[&arguments[..], more].concat());
        assert_eq!(output.status.code(), Some(0), "{}", said(&output));
        assert_eq!(said(&output), "");
    }
    for file in ["canonical.ply", "truth.ply", "session.mcap"] {
        let [a, b] = [&plain, &live].map(|out| std::fs::read(out.join(file)).unwrap());
        assert!(a == b, "{file} differs");
    }
    let [a, b] =
        [&plain, &live].map(|out| std::fs::read_to_string(out.join("frames.csv")).unwrap());
    assert_eq!(without_times(&a), without_times(&b));
    let [metrics, same] =
        [&plain, &live].map(|out| metrics_without_times(&out.join("metrics.json")));
    assert_eq!(metrics, same);
    assert!(!plain.join("live.rrd").exists());

    let (rows, layout) = read(&live.join("live.rrd"));
    let count = metrics["frames"].as_i64().unwrap();
    for entity in EVERY_FRAME.iter().chain(&[
        "/live/arms/PSM1",
        "/live/arms/PSM2",
        "/live/arms/PSM3",
        "/curves/mm/uncertainty",
        "/curves/ms/registration",
    ]) {
        is_in_every_frame(&rows, entity, count);
    }
    // Times are the stamps of the frames.
    for (row, line) in rows["/live/cloud"].iter().zip(b.lines().skip(1)) {
        let stamp: f64 = line.split(',').nth(1).unwrap().parse().unwrap();
        let (_, time) = row.at.unwrap();
        assert!((1e-9 * time as f64 - stamp).abs() < 1e-3, "{line}");
    }
    is_explored(&rows, &metrics);
    is_drawn_whole(&rows, count);
    for part in ["/viewport", "/view/", "/container/"] {
        assert!(
            layout.iter().any(|path| path.starts_with(part)),
            "{layout:?}"
        );
    }
}

/// The share explored is that of the metrics, a row a decision; so are the surface and the share that is missing.
fn is_explored(rows: &Rows, metrics: &Value) {
    let explored = metrics["explored"].as_array().unwrap();
    let shown: Vec<f64> = rows["/curves/share/explored"]
        .iter()
        .filter_map(|row| row.scalar)
        .collect();
    let expected: Vec<f64> = explored.iter().filter_map(Value::as_f64).collect();
    assert_eq!(shown, expected);
    assert!(expected.len() > 1);
    for entity in ["/rest/surface", "/curves/share/missing"] {
        assert_eq!(rows[entity].len(), expected.len(), "{entity}");
    }
    let manipulations = metrics["manipulations"].as_u64().unwrap() as usize;
    assert_eq!(rows["/live/plan"].len(), manipulations);
    assert!(rows["/events"].len() > expected.len() + manipulations);
    let lasting = &rows["/live/table"];
    assert!(lasting.len() == 1 && lasting[0].at.is_none(), "{lasting:?}");
}

/// Each mesh has a colour and a normal for every vertex, and as many vertices as the curve says; triangles come when they change.
fn is_drawn_whole(rows: &Rows, count: i64) {
    let counts = &rows["/curves/count/vertices"];
    for (row, vertices) in rows["/live/model"].iter().zip(counts) {
        let vertices = vertices.scalar.unwrap() as usize;
        for component in ["vertex_positions", "vertex_normals", "vertex_colors"] {
            let found = values(row, &format!("Mesh3D:{component}"));
            assert_eq!(found, Some(vertices), "{component}: {row:?}");
        }
    }
    let drawn = |row: &&Row| values(row, "Mesh3D:triangle_indices").is_some();
    let anew: Vec<_> = rows["/live/model"]
        .iter()
        .filter(drawn)
        .map(|r| r.at)
        .collect();
    let at_rest: Vec<_> = rows["/rest/model"].iter().map(|r| r.at).collect();
    assert_eq!(anew, at_rest);
    assert_eq!(anew.first(), Some(&rows["/live/model"][0].at));
    assert!(
        i64::try_from(anew.len()).unwrap() < count,
        "some frames only move the mesh"
    );
    // Something was gripped, and let go.
    let held = |row: &Row| values(row, "Points3D:positions").unwrap_or(0);
    let held: Vec<usize> = rows["/live/grips"].iter().map(held).collect();
    assert!(held.iter().any(|n| *n >= 2), "{held:?}");
    assert!(held[0] == 0 && held.last() == Some(&0), "{held:?}");
}

#[test]
fn a_replay_is_in_its_file() {
    let replay = Replay::new();
    let output = replay.command("--live=file").output().unwrap();
    assert!(output.status.success(), "{}", said(&output));
    let (rows, _) = read(&replay.out().join("live.rrd"));
    for entity in EVERY_FRAME.iter().chain(&["/live/arms/PSM1"]) {
        is_in_every_frame(&rows, entity, i64::from(FRAMES));
    }
    for row in &rows["/live/cloud"] {
        assert_eq!(values(row, "Points3D:positions"), Some(replay.points));
    }
    assert_eq!(rows["/live/table"].len(), 1);
    assert_eq!(rows["/curves/share/missing"].len(), 1);
    assert!(
        !rows.contains_key("/curves/share/explored"),
        "nobody knows the truth"
    );
}

/// Fails before anything was done, and says why in one line.
#[track_caller]
fn is_refused(command: &mut Command, words: &[&str]) {
    let output = command.output().unwrap();
    let said = said(&output);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert_eq!(said.lines().count(), 1, "{said}");
    for word in words {
        assert!(said.contains(word), "'{word}' is not in: {said}");
    }
}

#[test]
fn what_cannot_be_opened_is_said_before_the_run() {
    let replay = Replay::new();
    let refused = |live: &str, words: &[&str]| is_refused(&mut replay.command(live), words);
    let free = TcpListener::bind("127.0.0.1:0")
        .unwrap()
        .local_addr()
        .unwrap();
    refused(&format!("--live={free}"), &[&free.to_string(), "no viewer"]);
    refused("--live=nowhere.invalid", &["nowhere.invalid", "no viewer"]);
    refused("--live=not an address", &["not an address"]);
    refused("--live=http://example.com/x", &["http://example.com/x"]);
    if TcpStream::connect("127.0.0.1:9876").is_ok() {
        println!("skipped in part: a viewer is open on this machine");
    } else {
        let mut command = replay.command("--live");
        is_refused(
            command.env("PATH", "/nowhere"),
            &["rerun-sdk==", "file alone"],
        );
    }
    assert!(!replay.out().join("live.rrd").exists());
    std::fs::create_dir_all(replay.out().join("live.rrd")).unwrap();
    refused("--live=file", &["live.rrd"]);
}

/// Runs to its end beside something that listens, but is no viewer; what is left in the file is whole, and one remark tells what became of the other.
fn ends_well_beside(listener: &TcpListener) {
    let replay = Replay::new();
    let address = listener.local_addr().unwrap();
    let began = Instant::now();
    let output = replay
        .command(&format!("--live={address}"))
        .output()
        .unwrap();
    let said = said(&output);
    assert!(output.status.success(), "{said}");
    assert_eq!(said.lines().count(), 1, "{said}");
    assert!(said.contains(&address.to_string()), "{said}");
    assert!(began.elapsed() < Duration::from_secs(120));
    let (rows, _) = read(&replay.out().join("live.rrd"));
    is_in_every_frame(&rows, "/live/model", i64::from(FRAMES));
    assert!(replay.out().join("metrics.json").exists());
}

#[test]
fn a_viewer_that_takes_nothing_holds_nothing_up() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    // Connections are taken by the system, and nobody reads them.
    ends_well_beside(&listener);
}

#[test]
fn a_viewer_that_goes_away_costs_only_itself() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let gone = listener.try_clone().unwrap();
    std::thread::spawn(move || {
        for stream in gone.incoming() {
            let mut begun = [0; 64];
            let _read = stream.unwrap().read(&mut begun);
        }
    });
    ends_well_beside(&listener);
}

/// A Python that has Rerun's package, or why there is none.
fn python() -> Result<PathBuf, String> {
    if let Ok(path) = std::env::var("EXPLORE_RERUN") {
        return Ok(PathBuf::from(path));
    }
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("rerun");
    let python = folder.join("bin/python");
    let version = re_sdk::build_info().version;
    let check = format!("import rerun; assert rerun.__version__ == '{version}'");
    let works = |python: &Path| {
        let imported = Command::new(python).args(["-c", &check]).output();
        imported.is_ok_and(|output| output.status.success())
    };
    if works(&python) {
        return Ok(python);
    }
    done(Command::new("python3").args(["-m", "venv"]).arg(&folder))?;
    let package = format!("rerun-sdk=={version}");
    done(Command::new(&python).args([
        "-m",
        "pip",
        "install",
        "--quiet",
        "--disable-pip-version-check",
        &package,
    ]))?;
    Ok(python)
}

fn done(command: &mut Command) -> Result<String, String> {
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

fn with_python(check: impl FnOnce(&Path)) {
    // One of the tests makes the environment, the others wait.
    static ONE: std::sync::Mutex<()> = std::sync::Mutex::new(());
    let python = ONE.lock().map(|_guard| python()).unwrap();
    match python {
        Ok(python) => check(&python),
        Err(reason) => println!("skipped: no Python with the package rerun-sdk: {reason}"),
    }
}

/// Prints how many rows each entity has in the index `frame`, and how many values its last positions.
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

/// Rerun's own program finds nothing wrong with the file, and its Python package the same rows.
#[test]
fn the_makers_programs_read_the_file() {
    with_python(|python| {
        let replay = Replay::new();
        let output = replay.command("--live=file").output().unwrap();
        assert!(output.status.success(), "{}", said(&output));
        let file = replay.out().join("live.rrd");
        let program = python.with_file_name("rerun");
        done(Command::new(&program).args(["rrd", "verify"]).arg(&file)).unwrap();
        let read = done(Command::new(python).args(["-c", READ]).arg(&file)).unwrap();
        let read: Value = serde_json::from_str(&read).unwrap();
        for entity in EVERY_FRAME.iter().chain(&["/live/arms/PSM1"]) {
            assert_eq!(read["rows"][entity], FRAMES, "{entity}: {read}");
        }
        assert_eq!(read["rows"]["/live/table"], 1, "{read}");
        assert_eq!(read["last"]["/live/cloud"], replay.points, "{read}");
    });
}

/// A viewer without a window, which writes what it is sent to a file.
struct Listening {
    program: Child,
    port: u16,
}

impl Listening {
    fn start(python: &Path, file: &Path) -> Self {
        let port = TcpListener::bind("127.0.0.1:0")
            .unwrap()
            .local_addr()
            .unwrap()
            .port();
        // The script `rerun` is a parent of the program, and would leave it behind.
        let find = "import os, rerun_cli; print(os.path.dirname(rerun_cli.__file__))";
        let found = done(Command::new(python).args(["-c", find])).unwrap();
        let program = Command::new(Path::new(found.trim()).join("rerun"))
            .args(["--port", &port.to_string(), "--save"])
            .arg(file)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let began = Instant::now();
        while TcpStream::connect(("127.0.0.1", port)).is_err() {
            assert!(
                began.elapsed() < Duration::from_secs(60),
                "it does not listen"
            );
            std::thread::sleep(Duration::from_millis(100));
        }
        Self { program, port }
    }
}

impl Drop for Listening {
    fn drop(&mut self) {
        let _gone = self.program.kill();
        let _gone = self.program.wait();
    }
}

/// What a viewer that listens is sent is what the file has.
#[test]
fn a_viewer_that_listens_gets_what_the_file_has() {
    with_python(|python| {
        let replay = Replay::new();
        let sent = replay.folder.path().join("sent.rrd");
        let viewer = Listening::start(python, &sent);
        let output = replay
            .command(&format!("--live=127.0.0.1:{}", viewer.port))
            .output()
            .unwrap();
        assert!(output.status.success(), "{}", said(&output));
        assert_eq!(said(&output), "");
        let (written, _) = read(&replay.out().join("live.rrd"));
        let began = Instant::now();
        // It writes when it finds the time.
        loop {
            let sent = try_read(&sent).map(|(rows, _)| rows);
            if sent.as_ref() == Ok(&written) {
                break;
            }
            assert!(began.elapsed() < Duration::from_secs(30), "{sent:?}");
            std::thread::sleep(Duration::from_millis(300));
        }
    });
}
