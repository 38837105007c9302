//! The program `register` on real files, run as a user runs it.
#![allow(missing_docs, clippy::unwrap_used)]

#[path = "../benches/generator/mod.rs"]
mod generator;

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

use generator::{Case, Motion, Pair, Shape, error_mm};
use nalgebra::Point3;

/// The program as its source now stands: cargo builds examples for `cargo test`, but not for `cargo test --test program`. With the features of the
/// whole workspace, which its dependencies are built with already when all tests are run.
fn program() -> &'static Path {
    static PROGRAM: OnceLock<PathBuf> = OnceLock::new();
    PROGRAM.get_or_init(|| {
        let test = std::env::current_exe().unwrap();
        let profile = test.parent().unwrap().parent().unwrap();
        let release = profile.ends_with("release").then_some("--release");
        let built = Command::new(env!("CARGO"))
            .current_dir(env!("CARGO_MANIFEST_DIR"))
            .args(["build", "--quiet", "--workspace", "--example", "register"])
            .arg("--target-dir")
            .arg(profile.parent().unwrap())
            .args(release)
            .status();
        assert!(built.unwrap().success());
        let name = format!("register{}", std::env::consts::EXE_SUFFIX);
        profile.join("examples").join(name)
    })
}

fn run(arguments: &[&str]) -> Output {
    Command::new(program()).args(arguments).output().unwrap()
}

/// A folder of this test alone.
fn folder(name: &str) -> PathBuf {
    let path = std::env::temp_dir().join(format!("nonrigid-reg-{}-{name}", std::process::id()));
    std::fs::create_dir_all(&path).unwrap();
    path
}

/// Ascii, coordinates only, with a colour that nobody asked for in between.
fn ascii(path: &Path, points: &[Point3<f64>]) {
    let mut text = format!(
        "ply\nformat ascii 1.0\ncomment made by a test\nelement vertex {}\nproperty double x\nproperty uchar red\nproperty double y\nproperty double z\nend_header\n",
        points.len()
    );
    for p in points {
        writeln!(text, "{} 7 {} {}", p.x, p.y, p.z).unwrap();
    }
    std::fs::write(path, text).unwrap();
}

/// Binary floats with normals.
fn binary(path: &Path, view: &generator::View) {
    let mut header = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\n",
        view.points.len()
    );
    for name in ["x", "y", "z", "nx", "ny", "nz"] {
        writeln!(header, "property float {name}").unwrap();
    }
    header.push_str("end_header\n");
    let mut bytes = header.into_bytes();
    for (p, n) in view.points.iter().zip(&view.normals) {
        for c in p.iter().chain(n.iter()) {
            bytes.extend((*c as f32).to_le_bytes());
        }
    }
    std::fs::write(path, bytes).unwrap();
}

fn read(path: &Path) -> Vec<Point3<f64>> {
    let text = std::fs::read_to_string(path).unwrap();
    let (header, body) = text.split_once("end_header\n").unwrap();
    assert!(header.contains("format ascii 1.0"));
    let rows = body.lines().map(|line| {
        let c: Vec<f64> = line
            .split_whitespace()
            .map(|c| c.parse().unwrap())
            .collect();
        Point3::new(c[0], c[1], c[2])
    });
    rows.collect()
}

/// One line with exactly these keys; returns it.
fn json(output: &Output) -> serde_json::Value {
    let line = String::from_utf8(output.stdout.clone()).unwrap();
    assert_eq!(line.lines().count(), 1, "{line}");
    let answer: serde_json::Value = serde_json::from_str(&line).unwrap();
    let keys: Vec<&String> = answer.as_object().unwrap().keys().collect();
    assert_eq!(
        keys,
        [
            "doubt",
            "iterations",
            "ms",
            "overlap",
            "residual_m",
            "status"
        ]
    );
    answer
}

fn pair() -> Pair {
    Case {
        count: 1500,
        ..Case::new(Shape::Glove, Motion::Pinch, 0.006)
    }
    .make()
}

#[test]
fn source_moves_in_its_own_order() {
    let (at, pair) = (folder("order"), pair());
    let file = |name: &str| at.join(name).to_str().unwrap().to_owned();
    // The camera of clouds without normals is the origin: half a metre above the object.
    let lowered = |p: &Point3<f64>| Point3::new(p.x, p.y, p.z - 0.5);
    let points: Vec<_> = pair.source.points.iter().map(lowered).collect();
    ascii(&at.join("source.ply"), &points);
    let target = generator::View {
        points: pair.target.points.iter().map(lowered).collect(),
        normals: pair.target.normals.clone(),
    };
    binary(&at.join("target.ply"), &target);
    let mut rows = String::from("sx,sy,sz,tx,ty,tz\n");
    for l in &pair.landmarks {
        let (s, t) = (lowered(&l.source), lowered(&l.target));
        writeln!(rows, "{},{},{},{},{},{}", s.x, s.y, s.z, t.x, t.y, t.z).unwrap();
    }
    std::fs::write(at.join("landmarks.csv"), rows).unwrap();
    let truth: Vec<_> = pair.truth.iter().map(lowered).collect();

    let output = run(&[
        &file("source.ply"),
        &file("target.ply"),
        "--landmarks",
        &file("landmarks.csv"),
        "--out",
        &file("held.ply"),
        "--json",
    ]);
    assert!(output.status.success(), "{output:?}");
    let answer = json(&output);
    assert_eq!(
        (&answer["status"], &answer["doubt"]),
        (&"converged".into(), &().into())
    );
    assert!((4..=12).contains(&answer["iterations"].as_u64().unwrap()));
    assert!((0.7..=1.0).contains(&answer["overlap"].as_f64().unwrap()));
    assert!((0.0..0.001).contains(&answer["residual_m"].as_f64().unwrap()));
    assert!(answer["ms"].as_f64().unwrap() > 0.0);
    let held = read(&at.join("held.ply"));
    assert_eq!(held.len(), points.len());
    let (error, still) = (error_mm(&held, &truth).0, error_mm(&points, &truth).0);
    // Vertex k of the file is vertex k of SOURCE: any other order would be off by centimetres.
    assert!(still > 1.0 && error < 0.5 * still, "{error} of {still}");

    // No landmarks, and coarser nodes: another answer.
    let output = run(&[
        &file("source.ply"),
        &file("target.ply"),
        "--spacing",
        "0.03",
        "--out",
        &file("coarse.ply"),
        "--json",
    ]);
    assert!(output.status.success(), "{output:?}");
    json(&output);
    assert_ne!(read(&at.join("coarse.ply")), held);
    std::fs::remove_dir_all(at).unwrap();
}

#[test]
fn failure_is_said_and_leaves_no_file() {
    let (at, pair) = (folder("failure"), pair());
    let file = |name: &str| at.join(name).to_str().unwrap().to_owned();
    ascii(&at.join("source.ply"), &pair.source.points);
    ascii(&at.join("three.ply"), &pair.source.points[..3]);
    let mut broken = pair.source.points.clone();
    broken[5].x = f64::NAN;
    ascii(&at.join("nan.ply"), &broken);
    std::fs::write(at.join("short.csv"), "sx,sy,sz,tx,ty,tz\n1,2,3\n").unwrap();
    let out = file("moved.ply");
    let fails = |arguments: &[&str], word: &str| {
        let output = run(arguments);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(
            !output.status.success() && said.contains(word),
            "{arguments:?}: {said}"
        );
        assert!(output.stdout.is_empty() && !Path::new(&out).exists());
    };
    let (source, missing) = (file("source.ply"), file("missing.ply"));
    fails(&[], "<SOURCE>");
    fails(&[&source, &source], "--out <MOVED>");
    fails(&[&source, &missing, "--out", &out], "missing.ply");
    fails(
        &[&file("nan.ply"), &source, "--out", &out],
        "nan.ply: line 15: vertex 5: x is NaN",
    );
    fails(&[&file("three.ply"), &source, "--out", &out], "at least 4");
    fails(
        &[&source, &source, "--spacing=-1", "--out", &out],
        "'--spacing <METRES>': -1 is not positive",
    );
    fails(
        &[
            &source,
            &source,
            "--landmarks",
            &file("short.csv"),
            "--out",
            &out,
        ],
        "short.csv",
    );
    std::fs::remove_dir_all(at).unwrap();
}

/// A wavy sheet half a metre before the camera, and the same pulled towards it by half the square of the distance from its left edge.
fn sheet(start: u32) -> Vec<Point3<f64>> {
    // Points of low discrepancy (Halton), so that two starts give two samplings.
    let radical = |mut k: u32, base: u32| {
        let (mut value, mut digit) = (0.0, 1.0);
        while k > 0 {
            digit /= f64::from(base);
            value += digit * f64::from(k % base);
            k /= base;
        }
        value
    };
    let point = |k| {
        let (x, y) = (0.1 * radical(k, 2) - 0.05, 0.1 * radical(k, 3) - 0.05);
        Point3::new(x, y, 0.5 + 0.006 * (60.0 * x).sin() * (50.0 * y).cos())
    };
    (start..start + 2000).map(point).collect()
}

fn pulled(p: &Point3<f64>) -> Point3<f64> {
    Point3::new(p.x, p.y, p.z - 0.5 * (p.x + 0.05).powi(2))
}

/// Text of a PLY: what stands behind the format, columns as (type, name), and the rows.
fn ply(head: &str, kind: &str, rows: &[Point3<f64>]) -> String {
    let mut text = format!(
        "ply\nformat ascii 1.0\n{head}element vertex {}\n",
        rows.len()
    );
    for name in ["x", "y", "z"] {
        writeln!(text, "property {kind} {name}").unwrap();
    }
    text.push_str("end_header\n");
    for p in rows {
        writeln!(text, "{} {} {}", p.x, p.y, p.z).unwrap();
    }
    text
}

/// The sheet before and after, in files of a folder.
struct Desk {
    at: PathBuf,
    source: Vec<Point3<f64>>,
    target: Vec<Point3<f64>>,
}

impl Desk {
    fn new(name: &str) -> Self {
        let target = sheet(5000).iter().map(pulled).collect();
        let desk = Self {
            at: folder(name),
            source: sheet(20),
            target,
        };
        desk.put("source.ply", ply("", "double", &desk.source).as_bytes());
        desk.put("target.ply", ply("", "double", &desk.target).as_bytes());
        desk
    }

    fn file(&self, name: &str) -> String {
        self.at.join(name).to_str().unwrap().to_owned()
    }

    fn put(&self, name: &str, bytes: &[u8]) {
        std::fs::write(self.at.join(name), bytes).unwrap();
    }

    fn register(&self, source: &str, target: &str, more: &[&str]) -> Output {
        let [source, target, out] = [source, target, "moved.ply"].map(|name| self.file(name));
        run(&[&[&source[..], &target, "--out", &out], more].concat())
    }

    /// The answer of the plain clouds, in units of so many metres: 0.1 to 0.2 mm off.
    #[track_caller]
    fn good(&self, source: &str, target: &str, more: &[&str], metres: f64) {
        let output = self.register(source, target, more);
        assert!(output.status.success(), "{source} {more:?}: {output:?}");
        let truth: Vec<_> = self.source.iter().map(pulled).collect();
        let off = self.off(&truth, metres);
        assert!(off < 0.25, "{source} {more:?}: {off} mm");
    }

    /// Mean distance of what was written from the truth, mm.
    fn off(&self, truth: &[Point3<f64>], metres: f64) -> f64 {
        let moved = mesh_io::read(&self.at.join("moved.ply")).unwrap();
        error_mm(moved.scaled(metres).points(), truth).0
    }

    /// Code and complaint.
    fn refused(&self, source: &str, target: &str) -> (Option<i32>, String) {
        let output = self.register(source, target, &[]);
        let said = String::from_utf8(output.stderr).unwrap();
        (output.status.code(), said)
    }
}

impl Drop for Desk {
    fn drop(&mut self) {
        // What cannot be removed is left to the system.
        let _ = std::fs::remove_dir_all(&self.at);
    }
}

#[test]
fn clouds_of_every_format_give_the_same_answer() {
    let desk = Desk::new("formats");
    desk.good("source.ply", "target.ply", &[], 1.0);
    let cloud = mesh_io::Mesh::new(desk.source.clone()).unwrap();
    for name in ["s.obj", "s.pcd", "s.xyz", "s.npy", "s.off"] {
        let saved = cloud.save(&desk.at.join(name), mesh_io::Options::default());
        saved.unwrap();
        desk.good(name, "target.ply", &[], 1.0);
    }
    let plain = ply("", "double", &desk.source);
    let camera = "element camera 1\nproperty double px\nproperty double py\nproperty double pz\n";
    let with_camera =
        ply(camera, "double", &desk.source).replace("end_header\n", "end_header\n0 0 0\n");
    let list = plain.replace(
        "property double x",
        "property list uint double descriptor\nproperty double x",
    );
    let (header, body) = list.split_once("end_header\n").unwrap();
    let body = body
        .lines()
        .fold(String::new(), |t, l| t + "2 1 2 " + l + "\n");
    let list = format!("{header}end_header\n{body}");
    let latin = ply("comment M\u{fc}ller\n", "double", &desk.source);
    for (name, bytes) in [
        ("camera.ply", with_camera.into_bytes()),
        ("list.ply", list.into_bytes()),
        ("latin.ply", latin.chars().map(|c| c as u8).collect()),
        (
            "blank.ply",
            plain.replace("end_header\n", "end_header\n\n").into_bytes(),
        ),
        (
            "bom.ply",
            plain
                .replace("end_header\n", "end_header\n\u{feff}")
                .into_bytes(),
        ),
        (
            "comment.ply",
            ply("comment data follow end_header\n", "double", &desk.source).into_bytes(),
        ),
    ] {
        desk.put(name, &bytes);
        desk.good(name, "target.ply", &[], 1.0);
    }
}

#[test]
fn other_units_are_named_and_read() {
    let desk = Desk::new("units");
    for (by, units) in [(1e3, "mm"), (1e4, "1e-4")] {
        // Tenths of a millimetre as whole numbers.
        let whole = |cloud: &[Point3<f64>]| -> Vec<Point3<f64>> {
            let scaled = cloud.iter().map(|p| p * by);
            scaled
                .map(|p| if units == "mm" { p } else { p.map(f64::round) })
                .collect()
        };
        let kind = if units == "mm" { "float" } else { "short" };
        desk.put("s.ply", ply("", kind, &whole(&desk.source)).as_bytes());
        desk.put("t.ply", ply("", kind, &whole(&desk.target)).as_bytes());
        let (code, said) = desk.refused("s.ply", "t.ply");
        assert!(
            code == Some(1) && said.contains("s.ply") && said.contains("--units mm"),
            "{said}"
        );
        desk.good("s.ply", "t.ply", &["--units", units], 1.0 / by);
    }
}

#[test]
fn landmarks_with_a_heading_or_without() {
    let desk = Desk::new("landmarks");
    let [s, t] = [desk.source[7], pulled(&desk.source[7])];
    let row = format!("{},{},{},{},{},{}\n", s.x, s.y, s.z, t.x, t.y, t.z);
    desk.put("bare.csv", row.as_bytes());
    desk.put("headed.csv", format!("sx,sy,sz,tx,ty,tz\n{row}").as_bytes());
    let moved = |more: &[&str]| {
        desk.good("source.ply", "target.ply", more, 1.0);
        std::fs::read(desk.at.join("moved.ply")).unwrap()
    };
    let bare = moved(&["--landmarks", &desk.file("bare.csv")]);
    assert_eq!(bare, moved(&["--landmarks", &desk.file("headed.csv")]));
    assert_ne!(bare, moved(&[]));
}

#[test]
fn what_cannot_be_used_says_why() {
    let desk = Desk::new("refused");
    let zero = mesh_io::Mesh::new(desk.source.clone()).unwrap();
    let zero = zero
        .with_normals(vec![nalgebra::Vector3::zeros(); 2000])
        .unwrap();
    let saved = zero.save(&desk.at.join("zero.ply"), mesh_io::Options::default());
    saved.unwrap();
    let more = ply("", "double", &desk.source).replace("vertex 2000", "vertex 2500");
    desk.put("more.ply", more.as_bytes());
    for (name, words) in [
        (
            "zero.ply",
            "zero.ply: vertex 0: the normal (0, 0, 0) is zero or not finite",
        ),
        (
            "more.ply",
            "the file ends at vertex 2000, the header says 2500",
        ),
    ] {
        let (code, said) = desk.refused(name, "target.ply");
        assert!(code == Some(1) && said.contains(words), "{said}");
    }
}

/// Turned by 45° about the line of sight: a doubtful result, with advice.
#[test]
fn a_turn_is_doubted_and_aligned() {
    let desk = Desk::new("turned");
    let turn = nalgebra::Rotation3::from_axis_angle(
        &nalgebra::Vector3::z_axis(),
        std::f64::consts::FRAC_PI_4,
    );
    let turned: Vec<_> = sheet(5000).iter().map(|p| turn * p).collect();
    desk.put("turned.ply", ply("", "double", &turned).as_bytes());
    let (code, said) = desk.refused("source.ply", "turned.ply");
    assert!(code == Some(3) && said.contains("--align"), "{said}");
    let output = desk.register("source.ply", "turned.ply", &["--align"]);
    assert!(output.status.success(), "{output:?}");
    let truth: Vec<_> = desk.source.iter().map(|p| turn * p).collect();
    let off = desk.off(&truth, 1.0);
    assert!(off < 0.5, "{off} mm");
}

/// Points on a line can rotate about it, however well they match a sheet: the result is doubtful.
#[test]
fn a_line_is_undetermined() {
    let desk = Desk::new("line");
    let at = |i: u32| Point3::new(-0.04 + 8e-4 * f64::from(i), 1e-3, 0.5);
    let line: Vec<Point3<f64>> = (0..100).map(at).collect();
    desk.put("line.ply", ply("", "double", &line).as_bytes());
    let output = desk.register("line.ply", "source.ply", &["--json"]);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(3), "{said}");
    assert_eq!(json(&output)["status"], "undetermined");
    assert!(said.contains("in 4 ways: landmarks"), "{said}");
}
