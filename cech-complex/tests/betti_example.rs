//! The example `betti` as its users run it: valid files give one line of JSON, invalid ones one line of error.
#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::panic,
    reason = "a test may panic"
)]

use cech_complex::manifolds::{Manifold, OrientedCloud};
use cech_complex::nalgebra::{Point3, Vector3};
use cech_complex::{Complex, Cylinder, Options, VertexKind};
use mesh_io::Mesh;
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

/// The compiled example. Cargo does not name it to tests as it does programs, so it is built here: of the whole workspace, whose features its
/// dependencies are built with already when all tests are run.
fn program() -> &'static Path {
    static PROGRAM: OnceLock<PathBuf> = OnceLock::new();
    PROGRAM.get_or_init(|| {
        // …/target/<profile>/deps/<this test>
        let here = std::env::current_exe().unwrap();
        let profile = here.ancestors().nth(2).unwrap();
        let mut cargo = Command::new(env!("CARGO"));
        cargo.args([
            "build",
            "--quiet",
            "--workspace",
            "--example",
            "betti",
            "--target-dir",
        ]);
        cargo
            .arg(profile.parent().unwrap())
            .current_dir(env!("CARGO_MANIFEST_DIR"));
        if profile.ends_with("release") {
            cargo.arg("--release");
        }
        assert!(cargo.status().unwrap().success());
        profile
            .join("examples")
            .join(format!("betti{}", std::env::consts::EXE_SUFFIX))
    })
}

/// A separate file for every test, deleted at its end.
struct File(PathBuf);

impl File {
    fn new(name: &str, bytes: &[u8]) -> Self {
        let name = format!("betti-{}-{name}.ply", std::process::id());
        let path = std::env::temp_dir().join(name);
        std::fs::write(&path, bytes).unwrap();
        Self(path)
    }

    fn run(&self, options: &[&str]) -> Output {
        Command::new(program())
            .arg(&self.0)
            .args(options)
            .output()
            .unwrap()
    }

    /// The answer without its times.
    fn answer(&self, options: &[&str]) -> Value {
        let output = self.run(&[options, &["--json"]].concat());
        let complaint = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(
            output.status.success() && complaint.is_empty(),
            "{complaint}"
        );
        let line = String::from_utf8(output.stdout).unwrap();
        assert_eq!(line.lines().count(), 1);
        let mut answer: Value = serde_json::from_str(&line).unwrap();
        let times = ["build_ms", "reduce_ms", "betti_ms"];
        for time in times.map(|time| answer.as_object_mut().unwrap().remove(time)) {
            assert!(
                time.is_none_or(|time| time.as_f64().unwrap() >= 0.0),
                "{line}"
            );
        }
        answer
    }

    /// The one line that it ends with, after the name of the file.
    fn complaint(&self, options: &[&str], code: i32) -> String {
        let output = self.run(options);
        assert_eq!(output.status.code(), Some(code));
        assert!(output.stdout.is_empty());
        let line = String::from_utf8(output.stderr).unwrap();
        assert_eq!(line.lines().count(), 1, "{line}");
        let file = format!("error: {}: ", self.0.display());
        line.trim_end()
            .strip_prefix(&file)
            .unwrap_or(line.trim_end())
            .to_owned()
    }
}

impl Drop for File {
    fn drop(&mut self) {
        // A file that cannot be removed is left to the system.
        let _ = std::fs::remove_file(&self.0);
    }
}

const SIZE: [&str; 4] = ["--radius", "1", "--height", "0.5"];
const HEADER: &str = "property double x\nproperty double y\nproperty double z\n\
    property double nx\nproperty double ny\nproperty double nz\nend_header\n";

fn ascii(rows: &[&str]) -> Vec<u8> {
    let count = rows.len();
    format!(
        "ply\nformat ascii 1.0\nelement vertex {count}\n{HEADER}{}\n",
        rows.join("\n")
    )
    .into_bytes()
}

/// Numbers in the shortest form that reads back as the same bits; normals of length 2.5.
fn ascii_of(cloud: &OrientedCloud) -> Vec<u8> {
    let rows = cloud.points.iter().zip(&cloud.normals).map(|(p, n)| {
        let n = n.into_inner() * 2.5;
        format!("{} {} {} {} {} {}", p.x, p.y, p.z, n.x, n.y, n.z)
    });
    let rows: Vec<String> = rows.collect();
    ascii(&rows.iter().map(String::as_str).collect::<Vec<_>>())
}

/// The same with another element and a list ahead, a colour among the properties, and faces behind.
fn binary_of(cloud: &OrientedCloud) -> Vec<u8> {
    let mut header =
        String::from("ply\r\nformat binary_little_endian 1.0\r\ncomment made by a test\r\n");
    header += "element strip 2\r\nproperty uchar kind\r\nproperty list ushort int at\r\n";
    write!(header, "element vertex {}\r\n", cloud.points.len()).unwrap();
    header +=
        "property double nz\r\nproperty double ny\r\nproperty double nx\r\nproperty uchar red\r\n";
    header += "property list uchar short of\r\nproperty double x\r\nproperty double y\r\nproperty double z\r\n";
    header += "element face 1\r\nproperty list uchar int vertex_indices\r\nend_header\r\n";
    let mut bytes = header.into_bytes();
    for length in [0u16, 3] {
        bytes.push(7);
        bytes.extend(length.to_le_bytes());
        bytes.extend(std::iter::repeat_n(9, 4 * usize::from(length)));
    }
    for (i, (p, n)) in cloud.points.iter().zip(&cloud.normals).enumerate() {
        let n = n.into_inner() * 2.5;
        bytes.extend([n.z, n.y, n.x].iter().flat_map(|x| x.to_le_bytes()));
        let length = (i % 3) as u8;
        bytes.extend([200, length]);
        bytes.extend(std::iter::repeat_n(1, 2 * usize::from(length)));
        bytes.extend([p.x, p.y, p.z].iter().flat_map(|x| x.to_le_bytes()));
    }
    bytes.extend([3, 0, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0]);
    bytes
}

#[test]
fn the_answer_is_that_of_the_library() {
    let tube = Manifold::Tube {
        radius: 0.5,
        length: 1.5,
    };
    let cloud = tube.net(500, 3);
    let radius = 1.25 * cloud.spacing;
    let cylinder = Cylinder::new(radius, 0.5 * radius).unwrap();
    let options = Options::default().with_max_scale(1.2);
    let complex = Complex::build(&cloud.points, &cloud.normals, cylinder, &options).unwrap();
    let kinds = complex.classify(radius / 1.25).unwrap();
    let count = |wanted| kinds.iter().filter(|kind| **kind == wanted).count();
    let (rim, junction) = (count(VertexKind::Boundary), count(VertexKind::NonManifold));
    assert!(rim > 50 && junction == 0);
    let expected = json!({
        "points": 500,
        "simplices": complex.counts(),
        "betti": [1, 1, 0],
        "persistent_betti": [1, 1, 0],
        "boundary": rim,
        "non_manifold": 0,
    });
    let (radius, height) = (radius.to_string(), cylinder.height().to_string());
    let options = [
        "--radius", &radius, "--height", &height, "--from", "1", "--to", "1.2",
    ];
    for (name, bytes) in [("ascii", ascii_of(&cloud)), ("binary", binary_of(&cloud))] {
        let answer = File::new(name, &bytes).answer(&options);
        assert_eq!(answer, expected, "{name}");
    }
    let only = File::new("only", &ascii_of(&cloud)).answer(&[&options[..4], &["--only"]].concat());
    assert_eq!(only, json!({ "points": 500, "betti": [1, 1, 0] }));
}

#[test]
fn small_and_degenerate_clouds_are_answered() {
    let of = |points: usize| {
        json!({
            "points": points,
            "simplices": [points, 0, 0, 0],
            "betti": [points, 0, 0],
            "persistent_betti": [points, 0, 0],
            "boundary": 0,
            "non_manifold": 0,
        })
    };
    let empty = File::new("empty-cloud", &ascii(&[])).answer(&SIZE);
    assert_eq!(empty, of(0));
    let one = File::new("one", &ascii(&["1 2 3 0 0 1"])).answer(&SIZE);
    assert_eq!(one, of(1));
    let same = File::new("same", &ascii(&["1 2 3 0 0 1"; 7])).answer(&SIZE);
    // Every subset of up to four of seven: 21, 35, 35.
    assert_eq!(same["simplices"], json!([7, 21, 35, 35]));
    assert_eq!(same["betti"], json!([1, 0, 0]));
    let line: Vec<String> = (0..50).map(|i| format!("{i} 0 0 0 1 0")).collect();
    let line: Vec<&str> = line.iter().map(String::as_str).collect();
    let line = File::new("line", &ascii(&line)).answer(&SIZE);
    assert_eq!(line["betti"], json!([1, 0, 0]));
}

/// Files as other programs write them: the sphere is a sphere in each.
#[test]
fn a_sphere_is_one_in_every_format() {
    // 600 points 7.24 mm apart on a sphere of 50 mm.
    let point = |i: usize| {
        let z = 1.0 - (2 * i + 1) as f64 / 600.0;
        let a = std::f64::consts::PI * (1.0 + 5f64.sqrt()) * i as f64;
        let s = (1.0 - z * z).sqrt();
        Vector3::new(s * a.cos(), s * a.sin(), z)
    };
    let directions: Vec<Vector3<f64>> = (0..600).map(point).collect();
    let points: Vec<Point3<f64>> = directions.iter().map(|d| (0.05 * d).into()).collect();
    let bare = Mesh::new(points.clone()).unwrap();
    let oriented = bare.clone().with_normals(directions.clone()).unwrap();
    let inward = directions.iter().map(|d| -d).collect();
    let inward = bare.clone().with_normals(inward).unwrap();
    let flipped = directions.iter().enumerate();
    let flipped = flipped.map(|(k, d)| if k * k % 7 < 3 { -d } else { *d });
    let flipped = bare.clone().with_normals(flipped.collect()).unwrap();
    let size = ["--radius", "0.00905", "--height", "0.007"];
    let run = |name: &str, cloud: &Mesh, more: &[&str]| {
        let path = std::env::temp_dir().join(format!("betti-{}-{name}", std::process::id()));
        cloud.save(&path, mesh_io::Options::default()).unwrap();
        let output = Command::new(program())
            .arg(&path)
            .arg("--json")
            .args(size)
            .args(more)
            .output();
        std::fs::remove_file(&path).unwrap();
        let output = output.unwrap();
        assert!(output.status.success(), "{name}: {output:?}");
        let [out, said] = [output.stdout, output.stderr].map(|b| String::from_utf8(b).unwrap());
        (out.contains("\"betti\":[1,0,1]"), said)
    };
    for (name, cloud) in [
        ("a.ply", &oriented),
        ("a.pcd", &oriented),
        ("a.xyz", &oriented),
        ("a.npy", &oriented),
        ("inward.off", &inward),
        ("bare.ply", &bare),
        ("bare.xyz", &bare),
        ("bare.pcd", &bare),
        ("bare.obj", &bare),
    ] {
        assert_eq!(run(name, cloud, &[]), (true, String::new()), "{name}");
    }
    let (whole, said) = run("flipped.ply", &flipped, &[]);
    assert!(!whole && said.contains("--orientation free"), "{said}");
    assert_eq!(
        run("flipped.ply", &flipped, &["--orientation", "free"]),
        (true, String::new())
    );
    let millimetres = oriented.clone().scaled(1000.0);
    assert!(run("mm.ply", &millimetres, &["--units", "mm"]).0);
    assert!(run("tenths.ply", &oriented.scaled(10.0), &["--size", "0.09995"]).0);
}

/// A million points in one place give only the error message, within seconds.
#[test]
fn a_million_points_stop_at_the_limit() {
    let mut bytes =
        format!("ply\nformat binary_little_endian 1.0\nelement vertex 1000000\n{HEADER}")
            .into_bytes();
    for i in 0..1_000_000u32 {
        let (x, y) = (f64::from(i % 1000), f64::from(i / 1000));
        bytes.extend(
            [x, y, 0.0, 0.0, 0.0, 1.0]
                .iter()
                .flat_map(|x| x.to_le_bytes()),
        );
    }
    let options = [&SIZE[..], &["--max-simplices", "1000"]].concat();
    let complaint = File::new("million", &bytes).complaint(&options, 1);
    assert!(
        complaint.contains("1000") && complaint.contains("simplices"),
        "{complaint}"
    );
}

#[test]
fn what_is_wrong_with_a_file_is_said_with_line_and_value() {
    let good = "0 0 0 0 0 1";
    let header = |text: &str| text.replace('|', "\n").into_bytes();
    for (name, bytes, expected) in [
        ("empty", Vec::new(), "line 0: the file ends in the header"),
        ("other", header("solid thing|"), "line 1: not a PLY file"),
        (
            "vertex",
            header("ply|format ascii 1.0|end_header|"),
            "no element vertex",
        ),
        (
            "nan",
            ascii(&[good, "0 NaN 0 0 0 1"]),
            "line 12: vertex 1: y is NaN",
        ),
        (
            "infinite",
            ascii(&["0 0 0 0 inf 1"]),
            "vertex 0: the normal (0, inf, 1) is zero or not finite",
        ),
        (
            "zero",
            ascii(&[good, good, "0 0 0 0 0 0"]),
            "vertex 2: the normal (0, 0, 0) is zero or not finite",
        ),
        (
            "letters",
            ascii(&["0 0 zero 0 0 1"]),
            "line 11: vertex 0: z is not a number: \"zero\"",
        ),
        (
            "short",
            format!("ply\nformat ascii 1.0\nelement vertex 2\n{HEADER}{good}\n").into_bytes(),
            "line 11: the file ends at vertex 1, the header says 2",
        ),
    ] {
        let complaint = File::new(name, &bytes).complaint(&SIZE, 1);
        assert!(complaint.contains(expected), "{name}: {complaint}");
    }
}

#[test]
fn what_is_wrong_with_the_command_line_is_said() {
    let file = File::new("options", &ascii(&["0 0 0 0 0 1"]));
    for (options, expected) in [
        (&["--height", "1"][..], "--radius <R>"),
        (&["--radius", "1"], "--height <H>"),
        (
            &["--radius=-1", "--height", "1"],
            "'--radius <R>': -1 is not positive",
        ),
        (
            &["--radius", "NaN", "--height", "1"],
            "'--radius <R>': 'NaN' is not a finite number",
        ),
        (
            &["--radius", "1", "--height"],
            "a value is required for '--height <H>'",
        ),
        (
            &["--radius", "1", "--height", "1", "--max-simplices", "1e6"],
            "'1e6' for '--max-simplices <N>'",
        ),
        (
            &["--radius", "1", "--height", "1", "--from", "2", "--to", "1"],
            "scales must ascend",
        ),
        (
            &[
                "--radius",
                "1",
                "--height",
                "1",
                "--to",
                "2",
                "--max-scale",
                "1",
            ],
            "scales must ascend",
        ),
        (
            &["--radius", "1", "--height", "1", "--only", "--to", "2"],
            "'--only' cannot be used with '--to <S>'",
        ),
        (&["--colour", "red"], "unexpected argument '--colour'"),
        (&["another.ply"], "unexpected argument 'another.ply'"),
        (&["--orientation", "left"], "separate, free"),
        (
            &["--units", "inch"],
            "expected m, cm, mm or the length of a unit in metres",
        ),
    ] {
        let code = if expected.contains("ascend") { 1 } else { 2 };
        let complaint = file.complaint(options, code);
        assert!(complaint.contains(expected), "{options:?}: {complaint}");
    }
    let missing = Command::new(program())
        .args(["no-such.ply"])
        .args(SIZE)
        .output()
        .unwrap();
    assert_eq!(missing.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&missing.stderr).starts_with("error: no-such.ply: "));
}
