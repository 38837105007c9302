//! The `explore` program as a user meets it: what it refuses and how, and one whole run with what it leaves behind.
#![allow(missing_docs, clippy::unwrap_used)]

use serde_json::Value;
use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::fmt::Write;
use std::path::Path;
use std::process::{Command, Output};
use std::sync::OnceLock;

fn explore<A: AsRef<OsStr>>(arguments: &[A]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_explore"))
        .args(arguments)
        .output()
        .unwrap()
}

/// The program ends with `code` and says why in one line that names the thing at fault.
#[track_caller]
fn refuses<A: AsRef<OsStr>>(arguments: &[A], code: i32, names: &[&str]) {
    let output = explore(arguments);
    let text = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(code), "{text}");
    assert_eq!(text.lines().count(), 1, "{text}");
    assert!(!text.trim().is_empty());
    for name in names {
        assert!(text.contains(name), "'{name}' is not in: {text}");
    }
    for noise in ["panicked", "RUST_BACKTRACE", "Os {"] {
        assert!(!text.contains(noise), "{text}");
    }
    assert!(output.stdout.is_empty(), "nothing is reported as a result");
}

/// A tetrahedron with edges of about `size`; `faces` of its four faces, all outward.
fn tetrahedron(path: &Path, size: f64, faces: usize) {
    let corners = [
        [0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, 0.0, 1.0],
    ];
    let triangles = ["1 3 2", "1 2 4", "1 4 3", "2 3 4"];
    let mut text = String::new();
    for [x, y, z] in corners {
        writeln!(text, "v {} {} {}", size * x, size * y, size * z).unwrap();
    }
    for triangle in &triangles[..faces] {
        writeln!(text, "f {triangle}").unwrap();
    }
    std::fs::write(path, text).unwrap();
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

#[test]
fn help_and_version_are_no_errors() {
    for arguments in [
        &["--help"][..],
        &["run", "--help"],
        &["replay", "--help"],
        &["--version"],
    ] {
        let output = explore(arguments);
        assert_eq!(output.status.code(), Some(0));
        assert!(!output.stdout.is_empty());
        assert!(output.stderr.is_empty());
    }
}

#[test]
fn a_wrong_command_line_is_refused() {
    refuses(&["run", "--fly"], 2, &["--fly"]);
    refuses(&["--fly"], 2, &["--fly"]);
    refuses(&["dance"], 2, &["dance"]);
    refuses(&["run", "--arms", "7"], 2, &["--arms", "7"]);
    refuses(&["run", "--spacing", "0"], 2, &["--spacing", "0"]);
    refuses(&["run", "--speed", "fast"], 2, &["--speed", "fast"]);
    refuses(&["run", "--noise", "nan"], 2, &["--noise"]);
    refuses(&["run", "--grips", "lucky"], 2, &["--grips", "lucky"]);
    refuses(&["run", "--seed"], 2, &["--seed"]);
    refuses(
        &["run", "--scene", "liver", "--mesh", "a.obj"],
        2,
        &["--scene", "--mesh"],
    );
}

#[test]
fn an_unknown_scene_is_refused() {
    refuses(
        &["run", "--scene", "teapot"],
        1,
        &["teapot", "liver", "ellipsoid"],
    );
}

#[test]
fn meshes_that_bound_no_object_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let run = |mesh: &Path, names: &[&str]| {
        refuses(
            &["run", "--mesh", text(mesh), "--out", text(&out)],
            1,
            names,
        );
    };
    let missing = folder.path().join("nowhere.obj");
    run(&missing, &["nowhere.obj"]);
    let open = folder.path().join("open.obj");
    tetrahedron(&open, 0.1, 3);
    run(&open, &["closed"]);
    let millimetres = folder.path().join("millimetres.obj");
    tetrahedron(&millimetres, 200.0, 4);
    run(&millimetres, &["metres"]);
    let unknown = folder.path().join("mesh.docx");
    std::fs::write(&unknown, "mesh").unwrap();
    run(&unknown, &["docx"]);
    // Nothing was begun, so nothing lies about.
    assert!(!out.exists());
}

#[test]
fn sessions_that_cannot_be_read_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let replay = |session: &Path, names: &[&str]| {
        refuses(&["replay", text(session), "--out", text(&out)], 1, names);
    };
    replay(&folder.path().join("nowhere.mcap"), &["nowhere.mcap"]);
    let notes = folder.path().join("notes.mcap");
    std::fs::write(&notes, "These are my notes about the session.\n".repeat(20)).unwrap();
    replay(&notes, &["MCAP"]);
    std::fs::write(&notes, "").unwrap();
    replay(&notes, &["MCAP"]);
    assert!(!out.exists());
}

#[test]
fn a_folder_that_cannot_be_written_is_refused_before_the_run() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("results");
    std::fs::write(&file, "a file, not a folder").unwrap();
    for out in [file.clone(), file.join("below")] {
        refuses(
            &["run", "--scene", "ellipsoid", "--out", text(&out)],
            1,
            &[text(&out)],
        );
    }
}

/// What a run leaves behind.
struct Ran {
    output: Output,
    files: BTreeMap<String, Vec<u8>>,
}

impl Ran {
    fn metrics(&self) -> Value {
        serde_json::from_slice(&self.files["metrics.json"]).unwrap()
    }
}

/// Runs the program with an out folder of its own and keeps the files.
fn ran(arguments: &[&str]) -> Ran {
    let folder = tempfile::tempdir().unwrap();
    let output = explore(&[arguments, &["--out", text(folder.path())]].concat());
    let files = std::fs::read_dir(folder.path())
        .unwrap()
        .map(|entry| {
            let entry = entry.unwrap();
            let name = entry.file_name().into_string().unwrap();
            (name, std::fs::read(entry.path()).unwrap())
        })
        .collect();
    Ran { output, files }
}

/// The same run twice, side by side.
fn twice() -> &'static [Ran; 2] {
    static RUNS: OnceLock<[Ran; 2]> = OnceLock::new();
    RUNS.get_or_init(|| {
        let run = || ran(&["run", "--scene", "ellipsoid", "--seed", "0"]);
        std::thread::scope(|scope| {
            let other = scope.spawn(run);
            [run(), other.join().unwrap()]
        })
    })
}

#[test]
fn the_ellipsoid_closes() {
    let run = &twice()[0];
    let stderr = String::from_utf8_lossy(&run.output.stderr);
    assert_eq!(run.output.status.code(), Some(0), "{stderr}");
    let metrics = run.metrics();
    assert_eq!(metrics["stop"], "closed");
    assert_eq!(metrics["betti"], serde_json::json!([1, 0, 1]));
    let explored: Vec<f64> = serde_json::from_value(metrics["explored"].clone()).unwrap();
    // One value before the first manipulation and one after each.
    assert_eq!(
        explored.len() as u64,
        metrics["manipulations"].as_u64().unwrap() + 1
    );
    // At first only the top is in view: no more than the half above the rim and a band of two spacings below it.
    assert!(explored[0] < 0.8, "{explored:?}");
    assert!(explored[explored.len() - 1] >= 0.95, "{explored:?}");
    assert!(metrics["shape_difference_rel"].as_f64().unwrap() <= 0.03);
    assert_eq!(metrics["scene"], "ellipsoid");
    let stdout = String::from_utf8(run.output.stdout.clone()).unwrap();
    assert!(stdout.contains("closed"));
}

/// Timing apart, a seed fixes every figure and every byte of the model.
#[test]
fn a_seed_fixes_the_run() {
    let [mut a, mut b] = twice().each_ref().map(Ran::metrics);
    for metrics in [&mut a, &mut b] {
        for key in ["registration_ms", "frame_ms", "wall_s"] {
            assert!(metrics.as_object_mut().unwrap().remove(key).is_some());
        }
    }
    assert_eq!(a, b);
    let [first, second] = twice();
    assert_eq!(first.files["canonical.ply"], second.files["canonical.ply"]);
}

/// The lines of an ASCII PLY: what the header counts, then vertices and faces.
struct Ply {
    vertices: Vec<Vec<f64>>,
    faces: Vec<Vec<usize>>,
}

impl Ply {
    fn parse(bytes: &[u8]) -> Self {
        let text = std::str::from_utf8(bytes).unwrap();
        let (header, body) = text.split_once("end_header\n").unwrap();
        assert!(header.starts_with("ply\nformat ascii 1.0\n"));
        let count = |element: &str| -> usize {
            let start = format!("element {element} ");
            let line = header.lines().find_map(|l| l.strip_prefix(&start));
            line.unwrap().parse().unwrap()
        };
        let lines: Vec<&str> = body.lines().collect();
        assert_eq!(lines.len(), count("vertex") + count("face"));
        let (vertices, faces) = lines.split_at(count("vertex"));
        Self {
            vertices: vertices.iter().map(|l| numbers(l)).collect(),
            faces: faces.iter().map(|l| numbers(l)).collect(),
        }
    }
}

fn numbers<T: std::str::FromStr<Err: std::fmt::Debug>>(line: &str) -> Vec<T> {
    line.split(' ').map(|word| word.parse().unwrap()).collect()
}

#[test]
fn the_model_is_a_mesh_with_unit_normals() {
    let run = &twice()[0];
    let ply = Ply::parse(&run.files["canonical.ply"]);
    assert_eq!(
        ply.vertices.len() as u64,
        run.metrics()["vertices"].as_u64().unwrap()
    );
    for vertex in &ply.vertices {
        let [x, y, z, nx, ny, nz] = vertex[..] else {
            panic!("{vertex:?} is not a position and a normal")
        };
        assert!([x, y, z].iter().all(|v| v.is_finite()));
        // Six decimals a component: the length is off by at most √3 · 0.5e-6.
        assert!(((nx * nx + ny * ny + nz * nz).sqrt() - 1.0).abs() < 1e-6);
    }
    for face in &ply.faces {
        let [3, a, b, c] = face[..] else {
            panic!("{face:?} is not a triangle")
        };
        assert!(a != b && b != c && a != c);
        assert!([a, b, c].iter().all(|i| *i < ply.vertices.len()));
    }
    // A closed triangulation has 2 V − 4 faces; a gap that noise left open costs a few.
    let closed = 2 * ply.vertices.len() - 4;
    assert!(ply.faces.len() <= closed);
    assert!(ply.faces.len() as f64 > 0.95 * closed as f64);
}

#[test]
fn the_frames_table_has_a_line_a_frame() {
    let run = &twice()[0];
    let text = std::str::from_utf8(&run.files["frames.csv"]).unwrap();
    let frames = run.metrics()["frames"].as_u64().unwrap();
    assert_eq!(text.lines().count() as u64, frames + 1);
    let columns = text.lines().next().unwrap().split(',').count();
    assert!(text.lines().all(|line| line.split(',').count() == columns));
}

/// The recording holds every frame, and reconstructing from it alone gives the object again.
#[test]
fn the_session_replays() {
    let run = &twice()[0];
    let frames = run.metrics()["frames"].as_u64().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("session.mcap");
    std::fs::write(&path, &run.files["session.mcap"]).unwrap();
    let session = dvrk_io::session::SessionReader::open(&path).unwrap();
    assert_eq!(session.frames.len() as u64, frames);
    assert_eq!(session.arm_names.len(), 3);
    assert!(session.table.is_some());
    let truth = dvrk_io::session::read_truth(&path).unwrap();
    assert_eq!(truth.len() as u64, frames);

    let replay = ran(&["replay", text(&path)]);
    let stderr = String::from_utf8_lossy(&replay.output.stderr);
    assert_eq!(replay.output.status.code(), Some(0), "{stderr}");
    let metrics = replay.metrics();
    assert_eq!(metrics["frames"].as_u64().unwrap(), frames);
    assert_eq!(metrics["grips"], "recorded");
    assert!(metrics["speed_m_s"].is_null());
    let explored = metrics["explored"].as_array().unwrap();
    let last = explored[explored.len() - 1].as_f64().unwrap();
    assert!(last >= 0.9, "explored {last}");
    assert!(metrics["shape_difference_rel"].as_f64().unwrap() <= 0.03);
    let ply = Ply::parse(&replay.files["canonical.ply"]);
    assert_eq!(
        ply.vertices.len() as u64,
        metrics["vertices"].as_u64().unwrap()
    );
}
