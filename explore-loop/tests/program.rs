//! The `explore` program as a user runs it: rejected input, and a complete run with its files.
#![allow(missing_docs, clippy::unwrap_used)]

use explore_loop::measure::{MeshReport, Sampling, Surface, TrueSurface, compare};
use explore_loop::mesh::{Format, parse};
use explore_loop::nalgebra::Point3;
use rand::{Rng, SeedableRng};
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

/// The program ends with `code` and one line that names the cause.
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
        &["tables", "--help"],
        &["view", "--help"],
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
    refuses(&["run", "--camera", "pinhole"], 2, &["--camera", "pinhole"]);
    for point in ["here", "0,0", "0,0,0,0", "0,nan,0"] {
        refuses(&["run", "--seed-point", point], 2, &["--seed-point", point]);
    }
    refuses(&["run", "--genus=-1"], 2, &["--genus"]);
    refuses(&["run", "--seed"], 2, &["--seed"]);
    refuses(&["replay", "a.mcap", "--until=-1"], 2, &["--until"]);
    refuses(&["tables", "--only", "horses"], 2, &["--only", "horses"]);
    for seeds in ["", "3-1", "1,x", "0-99999999"] {
        refuses(&["tables", "--seeds", seeds], 2, &["--seeds"]);
    }
    refuses(
        &["run", "--scene", "liver", "--mesh", "a.obj"],
        2,
        &["--scene", "--mesh"],
    );
}

/// Without the feature `rerun` the option is known, and says what is missing; with it see the test `live`.
#[cfg(not(feature = "rerun"))]
#[test]
fn a_live_view_that_was_not_built_says_how_to_build_it() {
    for arguments in [
        &["run", "--live"][..],
        &["run", "--live=file"],
        &["replay", "a.mcap", "--live=127.0.0.1:9876"],
    ] {
        refuses(arguments, 2, &["--live", "--features rerun"]);
    }
}

#[test]
fn an_unknown_scene_is_refused() {
    let names = [&["teapot"][..], &explore_loop::cell::sim::SCENES].concat();
    refuses(&["run", "--scene", "teapot"], 1, &names);
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
    // In three digits, and with what would help.
    run(&millimetres, &["346 m across", "metres", "--units mm"]);
    let with = |options: &[&str], code: i32, names: &[&str]| {
        let mesh = ["run", "--mesh", text(&millimetres), "--out", text(&out)];
        refuses(&[&mesh, options].concat(), code, names);
    };
    with(&["--units", "inch"], 2, &["--units", "inch", "mm"]);
    with(&["--size=-1"], 2, &["--size"]);
    with(&["--size", "3"], 1, &["5.2 m across"]);
    with(&["--up", "w"], 2, &["--up", "x, y or z"]);
    with(&["--body", "2"], 1, &["no body 2", "in the mesh is 1"]);
    with(&["--export", "obj,docx"], 2, &["--export", "docx"]);
    refuses(&["run", "--units", "mm"], 2, &["--mesh"]);
    // The same again beside itself.
    let two = folder.path().join("two.obj");
    tetrahedron(&two, 0.1, 4);
    let one = std::fs::read_to_string(&two).unwrap();
    let beside = one.replace("v 0", "v 0.2").replace("v 0.2.1", "v 0.3");
    let faces = ["1 3 2", "1 2 4", "1 4 3", "2 3 4"]
        .iter()
        .zip(["5 7 6", "5 6 8", "5 8 7", "6 7 8"]);
    let beside = faces.fold(beside, |text, (old, new)| {
        text.replace(&format!("f {old}"), &format!("f {new}"))
    });
    std::fs::write(&two, one + &beside).unwrap();
    run(&two, &["2 pieces", "--body"]);
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

/// The files of a run.
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
        let run = || {
            ran(&[
                "run",
                "--scene",
                "ellipsoid",
                "--seed",
                "0",
                "--export",
                "obj,glb",
            ])
        };
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

/// Quality of the mesh, in the file and in the closing table.
#[test]
fn the_mesh_is_measured() {
    let run = &twice()[0];
    let metrics = run.metrics();
    for measure in ["accuracy_m", "completeness_m"] {
        let at = |key: &str| metrics[measure][key].as_f64().unwrap();
        assert!(at("mean") > 0.0 && at("mean") < at("p95") && at("p95") < at("max"));
        assert!(at("mean") < 0.003, "{measure} {}", at("mean"));
    }
    let share = |value: &Value| {
        let share = value.as_f64().unwrap();
        assert!((0.0..=1.0).contains(&share), "{share}");
        share
    };
    let [near, far] = ["2mm", "5mm"].map(|d| share(&metrics["f_score"][d]));
    assert!(near < far && far > 0.9, "{near} {far}");
    assert!(share(&metrics["doubled"]) < 0.1);
    assert!(share(&metrics["unsupported"]) < 0.1);
    let shares = |key: &str| -> Vec<f64> { serde_json::from_value(metrics[key].clone()).unwrap() };
    let (one, two) = (shares("explored"), shares("explored_2eps"));
    assert_eq!(one.len(), two.len());
    assert!(one.iter().zip(&two).all(|(one, two)| one <= two));
    for key in ["slide_m", "prediction_error_m", "prediction_error_held_m"] {
        assert!(metrics[key].as_f64().unwrap() > 0.0);
    }
    assert!(metrics["stiffness_over_weight"].as_f64().unwrap() > 0.0);
    let mesh = &metrics["mesh"];
    assert!(mesh["watertight"].is_boolean() && mesh["euler"].is_i64());
    for key in ["open_edges", "non_manifold_edges", "components"] {
        assert!(mesh[key].is_u64(), "{key}");
    }
    let stdout = String::from_utf8(run.output.stdout.clone()).unwrap();
    for name in [
        "accuracy",
        "completeness",
        "F-score",
        "doubled",
        "unsupported",
        "mesh",
        "slide",
    ] {
        assert!(stdout.contains(name), "'{name}' is not in: {stdout}");
    }
}

/// The files say the same to whoever compares them: the truth is a closed surface, and the mesh lies on it.
#[test]
fn the_truth_is_written_beside_the_mesh() {
    let run = &twice()[0];
    let surface = |name: &str| parse(&run.files[name], Format::Ply).unwrap().into_parts();
    let (vertices, triangles) = surface("truth.ply");
    let report = MeshReport::of(&vertices, &triangles);
    assert!(report.watertight && report.euler == 2 && report.misoriented_edges == 0);
    let truth = Surface::new(&vertices, &triangles).unwrap();
    let (vertices, triangles) = surface("canonical.ply");
    let mesh = Surface::new(&vertices, &triangles).unwrap();
    let comparison = compare(&mesh, &truth, Sampling::default());
    let metrics = run.metrics();
    for (spread, key) in [
        (comparison.accuracy(), "accuracy_m"),
        (comparison.completeness(), "completeness_m"),
    ] {
        let mean = metrics[key]["mean"].as_f64().unwrap();
        // The files hold every bit; the sampling of the surface depends on nothing else.
        assert!((spread.mean - mean).abs() < 1e-9, "{spread:?} {mean}");
    }
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

#[test]
fn the_model_is_a_watertight_mesh_with_unit_normals() {
    let run = &twice()[0];
    let bytes = &run.files["canonical.ply"];
    assert!(bytes.starts_with(b"ply\nformat binary_little_endian 1.0\n"));
    let mesh = parse(bytes, Format::Ply).unwrap();
    for normal in mesh.normals() {
        assert!((normal.norm() - 1.0).abs() < 1e-12);
    }
    assert_eq!(mesh.normals().len(), mesh.points().len());
    // The ellipsoid is yellow where it is not dark: nothing of it is grey.
    assert_eq!(mesh.colours().len(), mesh.points().len());
    assert!(mesh.colours().iter().all(|[red, _, blue]| red > blue));
    let known = |name: &str| mesh.property(name).unwrap();
    // A closed surface: all of it within reach of a point that was seen.
    assert!(known("support").iter().all(|s| (0.0..0.01).contains(s)));
    assert!(known("first_seen").iter().all(|s| *s >= 0.0));
    assert!(known("confidence").iter().all(|s| (0.0..=1.0).contains(s)));
    // The other formats that were asked for hold the same surface.
    let obj = parse(&run.files["canonical.obj"], Format::Obj).unwrap();
    assert_eq!(
        (obj.points(), obj.triangles()),
        (mesh.points(), mesh.triangles())
    );
    assert!(run.files["canonical.glb"].starts_with(b"glTF"));
    // Every directed edge has its twin: closed, and all triangles turn alike.
    let mut directed = BTreeMap::new();
    let mut volume = 0.0;
    for &[a, b, c] in mesh.triangles() {
        for edge in [(a, b), (b, c), (c, a)] {
            *directed.entry(edge).or_insert(0) += 1;
        }
        let [p, q, r] = [a, b, c].map(|i| mesh.points()[i as usize].coords);
        volume += p.dot(&q.cross(&r)) / 6.0;
    }
    let twin = |(a, b): &(u32, u32)| directed.get(&(*b, *a)) == Some(&1);
    assert!(
        directed
            .iter()
            .all(|(edge, count)| *count == 1 && twin(edge))
    );
    assert_eq!(
        mesh.points().len() + mesh.triangles().len(),
        directed.len() / 2 + 2
    );
    // 120 × 90 × 60 mm make 339 cm³; the weight presses it a little flatter.
    assert!((3.0e-4..3.7e-4).contains(&volume), "{volume} m³");
    let mesh = &run.metrics()["mesh"];
    assert_eq!(mesh["watertight"], true);
    assert_eq!(mesh["euler"], 2);
}

/// The keys that other programs read.
#[test]
fn the_metrics_have_their_keys() {
    let metrics = twice()[0].metrics();
    for key in [
        "scene",
        "arms",
        "grips",
        "seed",
        "speed_m_s",
        "fastest_grip_m_s",
        "spacing_m",
        "manipulations",
        "stop",
        "betti",
        "explored",
        "accuracy_m",
        "completeness_m",
        "f_score",
        "doubled",
        "unsupported",
        "mesh",
        "shape_difference_m",
        "shape_difference_rel",
        "prediction_error_m",
        "slide_m",
        "nm_cut",
        "nm_remaining",
        "frames",
        "registration_ms",
        "frame_ms",
        "vertices",
        "robot_time_s",
        "wall_s",
    ] {
        assert!(!metrics[key].is_null(), "{key} is missing: {metrics}");
    }
    for (whole, parts) in [
        ("accuracy_m", &["mean", "p95", "max"][..]),
        ("completeness_m", &["mean", "p95", "max"]),
        ("f_score", &["2mm", "5mm"]),
        (
            "mesh",
            &[
                "watertight",
                "euler",
                "open_edges",
                "non_manifold_edges",
                "components",
            ],
        ),
        ("nm_cut", &["vertices", "edges", "triangles"]),
        ("registration_ms", &["median", "p95"]),
        ("frame_ms", &["median", "p95"]),
    ] {
        for part in parts {
            assert!(
                !metrics[whole][part].is_null(),
                "{whole}.{part} is missing: {metrics}"
            );
        }
    }
}

/// Grips are as fast as asked for only if what keeps them slower is left out; in no run are they faster.
#[test]
fn grips_reach_the_requested_speed_without_its_limits() {
    let fastest = |run: &Ran| run.metrics()["fastest_grip_m_s"].as_f64().unwrap();
    let limited = &twice()[0];
    let allowed = limited.metrics()["speed_m_s"].as_f64().unwrap();
    assert!((0.005..allowed + 1e-6).contains(&fastest(limited)));
    let arguments = "run --scene ellipsoid --max-manipulations 1 --quiet --speed 150";
    let mut arguments: Vec<&str> = arguments.split(' ').collect();
    let slowed = fastest(&ran(&arguments));
    assert!(slowed < 0.12, "{slowed}");
    arguments.extend(["--without", "speed-limit"]);
    let steady = fastest(&ran(&arguments));
    assert!((0.149..0.15 + 1e-6).contains(&steady), "{steady}");
}

/// A run that may not touch the object sees one side: it ends with code 1, and its mesh is open.
#[test]
fn a_run_that_does_not_close_says_so() {
    let run = ran(&[
        "run",
        "--scene",
        "ellipsoid",
        "--max-manipulations",
        "0",
        "--quiet",
    ]);
    assert_eq!(run.output.status.code(), Some(1));
    assert!(run.output.stdout.is_empty());
    let metrics = run.metrics();
    assert_eq!(metrics["stop"], "too_many_manipulations");
    assert_eq!(metrics["mesh"]["watertight"], false);
    assert_eq!(metrics["manipulations"], 0);
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

/// The table keeps every vertex above it in every frame, and the report says how.
#[test]
fn no_vertex_is_under_the_table_in_any_frame() {
    for run in twice() {
        let metrics = run.metrics();
        let constraints = &metrics["constraints"];
        let text = std::str::from_utf8(&run.files["frames.csv"]).unwrap();
        let mut lines = text.lines().map(|line| line.split(',').collect::<Vec<_>>());
        let header = lines.next().unwrap();
        let column = |name: &str| header.iter().position(|h| *h == name).unwrap();
        let (depth, active) = (column("below_table_um"), column("active"));
        let mut touched = 0;
        for line in lines {
            // Micrometres; a fusion gives the body surface that it did not have, and is no exception.
            assert!(line[depth].parse::<f64>().unwrap() <= 1.0, "{line:?}");
            touched += usize::from(line[active] != "0");
        }
        assert!(touched > 0);
        assert_eq!(constraints["active_frames"], touched);
        assert_eq!(constraints["infeasible_frames"], 0);
        assert!(constraints["below_table_m"].as_f64().unwrap() <= 1e-6);
        assert!(constraints["violation_m"].as_f64().unwrap() <= 1e-6);
    }
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

    let truth = TrueSurface::from_points(&truth[0].points).unwrap();
    let report = MeshReport::of(&truth.vertices, &truth.triangles);
    assert!(report.watertight && report.euler == 2, "{report:?}");

    let short = ran(&["replay", text(&path), "--until", "1", "--quiet"]);
    assert_eq!(short.output.status.code(), Some(0));
    assert!(short.output.stdout.is_empty() && short.output.stderr.is_empty());
    let short = short.metrics();
    assert!(short["frames"].as_u64().unwrap() < frames);
    assert!(short["robot_time_s"].as_f64().unwrap() <= 1.0);

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
    // It is ochre, as what was recorded.
    let mesh = parse(&replay.files["canonical.ply"], Format::Ply).unwrap();
    assert_eq!(mesh.colours().len(), mesh.points().len());
    assert!(mesh.colours().iter().all(|[red, _, blue]| red > blue));
}

/// Pixel tracks that are the truth, of every 20th material point: in the frames from `jump` on they lie 12 pixels aside.
fn true_tracks(session: &Path, jump: usize) -> String {
    let frames = dvrk_io::session::SessionReader::open(session)
        .unwrap()
        .frames;
    let truth = dvrk_io::session::read_truth(session).unwrap();
    let mut table = "frame,track,column,row\n".to_owned();
    for (number, (frame, truth)) in frames.iter().zip(&truth).enumerate() {
        let seen = |p: &Point3<f64>| frame.points.iter().any(|q| (p - q).norm() < 1.5e-3);
        let aside = if number < jump { 0.0 } else { 12.0 };
        for (track, p) in truth
            .points
            .iter()
            .enumerate()
            .step_by(20)
            .filter(|(_, p)| seen(p))
        {
            let [u, v] = [p.x, p.y].map(|x| 320.0 * x / p.z);
            writeln!(
                table,
                "{number},{track},{},{}",
                u + 159.5 + aside,
                v + 119.5
            )
            .unwrap();
        }
    }
    table
}

/// A replay is compared with the pixel tracks of a tracker: true ones agree with the model, and wrong tracks are detected.
#[test]
fn pixel_tracks_are_compared_with_the_model() {
    let run = &twice()[0];
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let session = path("session.mcap");
    std::fs::write(&session, &run.files["session.mcap"]).unwrap();
    let compared = |jump: usize| {
        std::fs::write(path("tracks.csv"), true_tracks(&session, jump)).unwrap();
        let file = path("tracks.csv");
        let camera = ["--intrinsics", "320,320,159.5,119.5", "--until", "12"];
        let replay = ["replay", text(&session), "--tracks", text(&file)];
        let tracks = ran(&[&replay[..], &camera[..]].concat()).metrics()["tracks"].clone();
        let number = |key: &str| tracks[key].as_f64().unwrap();
        let error = tracks["error_m"]["mean"].as_f64().unwrap();
        assert!(
            number("tied") > 0.5 * number("tracks") && number("tied") > 20.0,
            "{tracks}"
        );
        assert!(number("slide_m") <= error, "{tracks}");
        (error, number("compared"))
    };
    let (error, places) = compared(usize::MAX);
    // Smooth surface slides along itself by a few millimetres: what the run itself says of it.
    assert!(
        error < 0.004 && places > 2000.0,
        "{error} m at {places} places"
    );
    // Twelve pixels are 20 mm at the distance of the object.
    let (astray, _) = compared(60);
    assert!(astray > error + 0.004, "{error} m and {astray} m");
    let refused = |content: &str, why: &str| {
        std::fs::write(path("bad.csv"), content).unwrap();
        let file = path("bad.csv");
        let arguments = ["--tracks", text(&file), "--intrinsics", "320,320,160,120"];
        refuses(
            &[&["replay", text(&session)][..], &arguments[..]].concat(),
            1,
            &["bad.csv", why],
        );
    };
    refused("frame,track,column,row\n0,1.5,2,3\n", "line 2");
    refused("0,1,2\n", "4 columns");
}

/// A study reuses finished runs and gives the same result.
#[test]
fn a_study_of_seeds_is_a_table_and_can_be_taken_up_again() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("study");
    let study = |seeds: &str| {
        let output = explore(&[
            "tables",
            "--only",
            "seeds",
            "--scene",
            "ellipsoid",
            "--seeds",
            seeds,
            "--keep",
            "--out",
            text(&out),
        ]);
        assert_eq!(output.status.code(), Some(0));
        String::from_utf8(output.stdout).unwrap()
    };
    // What a run of the program leaves is what a study of it would.
    let seed = out.join("seed_0");
    std::fs::create_dir_all(&seed).unwrap();
    std::fs::write(seed.join("metrics.json"), &twice()[0].files["metrics.json"]).unwrap();
    let table = study("0");
    // A heading, a line below it, the seed, the medians: all of as many cells.
    let lines: Vec<&str> = table.lines().collect();
    assert_eq!(lines.len(), 4, "{table}");
    let cells = |line: &str| line.matches('|').count();
    assert!(lines.iter().all(|l| cells(l) == cells(lines[0])), "{table}");
    assert!(lines[2].starts_with("| 0 | closed |"), "{table}");
    assert!(
        lines[3].starts_with("| median | 1 of 1 closed |"),
        "{table}"
    );
    assert_eq!(
        std::fs::read_to_string(out.join("seeds.md")).unwrap(),
        table
    );
    let json: Value =
        serde_json::from_slice(&std::fs::read(out.join("seeds.json")).unwrap()).unwrap();
    assert_eq!(json["closed"], 1);
    assert_eq!(json["runs"][0], twice()[0].metrics());
    assert_eq!(
        json["median"]["accuracy_mean_m"],
        json["runs"][0]["accuracy_m"]["mean"]
    );
    // Nothing was run: a run would have left its mesh.
    assert!(!seed.join("canonical.ply").exists());
}

/// Everything that a run leaves but for the times that it took.
fn without_times(folder: &Path) -> (Value, Vec<Vec<String>>, Vec<u8>, dvrk_io::session::Session) {
    let read = |name: &str| std::fs::read(folder.join(name)).unwrap();
    let mut metrics: Value = serde_json::from_slice(&read("metrics.json")).unwrap();
    for key in ["registration_ms", "frame_ms", "wall_s"] {
        metrics.as_object_mut().unwrap().remove(key).unwrap();
    }
    let text = String::from_utf8(read("frames.csv")).unwrap();
    let header: Vec<&str> = text.lines().next().unwrap().split(',').collect();
    let lines = text.lines().map(|line| {
        let named = header.iter().zip(line.split(','));
        let kept = named.filter(|(name, _)| !name.ends_with("_ms"));
        kept.map(|(_, value)| value.to_owned()).collect()
    });
    let session = dvrk_io::session::SessionReader::open(folder.join("session.mcap")).unwrap();
    (metrics, lines.collect(), read("canonical.ply"), session)
}

fn run_in(folder: &Path, scene: &str, more: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_explore"));
    command
        .args(["run", "--scene", scene, "--seed", "0", "--quiet", "--out"])
        .arg(folder)
        .args(more)
        .stderr(std::process::Stdio::piped());
    command
}

/// Kills runs at moments drawn between their start and their end and goes on each time; the end is that of the unbroken run, and the recording can be
/// read after every kill.
fn killed(scene: &str, times: u32, seed: u64) {
    let folder = tempfile::tempdir().unwrap();
    let (whole, broken) = (folder.path().join("whole"), folder.path().join("broken"));
    let started = std::time::Instant::now();
    assert!(run_in(&whole, scene, &[]).status().unwrap().success());
    let took = started.elapsed().as_secs_f64();
    let expected = without_times(&whole);
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
    for k in 0..times {
        let resume = broken.join("checkpoint.bin").exists();
        let more: &[&str] = if resume { &["--resume"] } else { &[] };
        let mut running = run_in(&broken, scene, more).spawn().unwrap();
        let wait = random.random_range(0.02..took);
        std::thread::sleep(std::time::Duration::from_secs_f64(wait));
        running.kill().unwrap();
        running.wait().unwrap();
        if broken.join("session.mcap").exists() {
            let session = broken.join("session.mcap");
            // Killed before the first frame there is nothing to read, and the reader says just that.
            match dvrk_io::session::SessionReader::open(session) {
                Ok(session) => assert!(session.frames.len() <= expected.3.frames.len()),
                Err(error) => assert!(wait < 0.5 * took, "kill {k}: {error}"),
            }
        }
    }
    let end = run_in(&broken, scene, &["--resume"]).output().unwrap();
    assert!(
        end.status.success(),
        "{}",
        String::from_utf8_lossy(&end.stderr)
    );
    let found = without_times(&broken);
    assert_eq!(found.0, expected.0);
    assert_eq!(found.1, expected.1);
    assert!(found.2 == expected.2, "another mesh");
    assert!(found.3 == expected.3, "another recording");
}

#[test]
fn a_killed_run_goes_on_to_the_same_end() {
    killed("ellipsoid", 2, 0);
}

/// The tube is turned over twice: some kills come before the first checkpoint after a manipulation, some after it.
#[test]
#[ignore = "twenty minutes"]
fn a_run_killed_fifty_times_goes_on_to_the_same_end() {
    killed("tube", 50, 1);
}

/// A run that was asked to stop closes its recording, prints how to resume, and can be resumed.
#[cfg(unix)]
#[test]
fn an_interrupted_run_says_how_to_go_on() {
    let folder = tempfile::tempdir().unwrap();
    for (signal, more) in [("INT", &[][..]), ("TERM", &["--resume"])] {
        let session = folder.path().join("session.mcap");
        // The recording of the run before is large already.
        let _none_yet = std::fs::remove_file(&session);
        let running = run_in(folder.path(), "ellipsoid", more).spawn().unwrap();
        let enough = || std::fs::metadata(&session).is_ok_and(|m| m.len() > 1_000_000);
        while !enough() {
            std::thread::sleep(std::time::Duration::from_millis(20));
        }
        let id = running.id().to_string();
        let sent = Command::new("kill")
            .args(["-s", signal, &id])
            .status()
            .unwrap();
        assert!(sent.success());
        let output = running.wait_with_output().unwrap();
        let text = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{text}");
        assert!(
            text.contains("interrupted") && text.contains("--resume"),
            "{text}"
        );
        assert_eq!(text.lines().count(), 1, "{text}");
        dvrk_io::session::SessionReader::open(&session).unwrap();
    }
}

/// A file that is no checkpoint, is damaged or belongs to another run is rejected and stays unchanged.
#[test]
fn checkpoints_that_cannot_be_resumed_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint.bin");
    let out = text(folder.path());
    let resume = |more: &[&str], names: &[&str]| {
        let arguments = ["run", "--scene", "ellipsoid", "--resume", "--out", out];
        refuses(&[&arguments, more].concat(), 1, names);
    };
    resume(&[], &["checkpoint.bin"]);
    std::fs::write(&path, "These are my notes about the run, not a checkpoint.").unwrap();
    resume(&[], &["checkpoint.bin", "byte 0", "not a checkpoint"]);
    let whole = &twice()[0].files["checkpoint.bin"];
    std::fs::write(&path, whole).unwrap();
    resume(
        &["--seed", "7"],
        &["checkpoint.bin", "--seed 0", "--seed 7"],
    );
    let mut other = whole.clone();
    other[8] = 77;
    std::fs::write(&path, &other).unwrap();
    resume(&[], &["checkpoint.bin", "byte 8", "version 77"]);
    for length in [0, 19, 20, whole.len() / 2, whole.len() - 1] {
        std::fs::write(&path, &whole[..length]).unwrap();
        resume(&[], &["checkpoint.bin", "byte"]);
    }
    let mut damaged = whole.clone();
    damaged[whole.len() / 2] ^= 1;
    std::fs::write(&path, &damaged).unwrap();
    resume(&[], &["checkpoint.bin", "bytes", "damaged"]);
    assert_eq!(std::fs::read(&path).unwrap(), damaged);
}

/// A full disk is reported, and files saved before are kept.
#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_an_error_and_the_last_checkpoint_stays() {
    let folder = tempfile::tempdir().unwrap();
    let out = text(folder.path());
    let whole = &twice()[0].files["checkpoint.bin"];
    for (name, file) in [
        ("session.mcap.part", "session"),
        ("checkpoint.bin.part", "checkpoint.bin"),
    ] {
        std::fs::write(folder.path().join("checkpoint.bin"), whole).unwrap();
        let full = folder.path().join(name);
        std::os::unix::fs::symlink("/dev/full", &full).unwrap();
        refuses(
            &[
                "run",
                "--scene",
                "ellipsoid",
                "--resume",
                "--quiet",
                "--out",
                out,
            ],
            1,
            &[file, "No space left"],
        );
        std::fs::remove_file(&full).unwrap();
        assert!(&std::fs::read(folder.path().join("checkpoint.bin")).unwrap() == whole);
    }
}

/// A folder that cannot be written is reported before the run.
#[cfg(target_os = "linux")]
#[test]
fn a_read_only_folder_is_an_error() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let closed = folder.path().join("closed");
    std::fs::create_dir(&closed).unwrap();
    std::fs::set_permissions(&closed, std::fs::Permissions::from_mode(0o555)).unwrap();
    // Permissions do not bind root, a file system without files of one's own does.
    let binds = std::fs::write(closed.join("probe"), "").is_err();
    let out = if binds {
        closed
    } else {
        std::path::PathBuf::from("/sys/kernel")
    };
    let run = [
        "run",
        "--scene",
        "ellipsoid",
        "--quiet",
        "--out",
        text(&out),
    ];
    refuses(&run, 1, &[text(&out)]);
}
