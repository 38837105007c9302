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

/// The program as its source now stands: cargo builds examples for `cargo test`, but not for `cargo test --test program`.
fn program() -> &'static Path {
    static PROGRAM: OnceLock<PathBuf> = OnceLock::new();
    PROGRAM.get_or_init(|| {
        let test = std::env::current_exe().unwrap();
        let profile = test.parent().unwrap().parent().unwrap();
        let release = profile.ends_with("release").then_some("--release");
        let built = Command::new(env!("CARGO"))
            .current_dir(env!("CARGO_MANIFEST_DIR"))
            .args(["build", "--quiet", "--example", "register", "--target-dir"])
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

/// One line with exactly these keys in this order; returns their values.
fn json(output: &Output) -> Vec<String> {
    let line = String::from_utf8(output.stdout.clone()).unwrap();
    assert_eq!(line.lines().count(), 1, "{line}");
    let inner = line
        .trim()
        .strip_prefix('{')
        .unwrap()
        .strip_suffix('}')
        .unwrap();
    let (keys, values): (Vec<&str>, Vec<&str>) = inner
        .split(',')
        .map(|entry| entry.split_once(':').unwrap())
        .unzip();
    assert_eq!(
        keys,
        [
            "\"status\"",
            "\"iterations\"",
            "\"overlap\"",
            "\"residual_m\"",
            "\"ms\""
        ]
    );
    values
        .iter()
        .map(|v| v.trim_matches('"').to_owned())
        .collect()
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
    ]);
    assert!(output.status.success(), "{output:?}");
    let values = json(&output);
    assert_eq!(values[0], "converged");
    assert!((4..=12).contains(&values[1].parse::<u32>().unwrap()));
    assert!((0.7..=1.0).contains(&values[2].parse::<f64>().unwrap()));
    assert!((0.0..0.001).contains(&values[3].parse::<f64>().unwrap()));
    assert!(values[4].parse::<f64>().unwrap() > 0.0);
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
    fails(&[], "usage");
    fails(&[&source, &source], "usage");
    fails(&[&source, &missing, "--out", &out], "missing.ply");
    fails(
        &[&file("nan.ply"), &source, "--out", &out],
        "nan.ply: line 15: vertex 5: x is NaN",
    );
    fails(&[&file("three.ply"), &source, "--out", &out], "at least 4");
    fails(
        &[&source, &source, "--spacing", "-1", "--out", &out],
        "node_spacing",
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

/// Clouds as people have them: each gives the answer of the plain one, or says what is wrong.
#[test]
fn clouds_as_people_have_them() {
    let at = folder("cases");
    let file = |name: &str| at.join(name).to_str().unwrap().to_owned();
    let put = |name: &str, bytes: &[u8]| std::fs::write(at.join(name), bytes).unwrap();
    let (source, target) = (
        sheet(20),
        sheet(5000).iter().map(pulled).collect::<Vec<_>>(),
    );
    let scaled = |cloud: &[Point3<f64>], by: f64| cloud.iter().map(|p| p * by).collect::<Vec<_>>();
    let plain = ply("", "double", &source);
    put("source.ply", plain.as_bytes());
    put("target.ply", ply("", "double", &target).as_bytes());
    let truth: Vec<_> = source.iter().map(pulled).collect();
    let error = |name: &str, metres: f64| {
        let moved = mesh_io::read(&at.join(name)).unwrap().scaled(metres);
        error_mm(moved.points(), &truth).0
    };
    let register = |source: &str, target: &str, more: &[&str]| {
        let (source, target, out) = (file(source), file(target), file("moved.ply"));
        run(&[&[&source[..], &target, "--out", &out], more].concat())
    };
    let good = |source: &str, target: &str, more: &[&str], metres: f64| {
        let output = register(source, target, more);
        assert!(output.status.success(), "{source} {more:?}: {output:?}");
        let off = error("moved.ply", metres);
        // The plain clouds are off by 0.1 to 0.2 mm.
        assert!(off < 0.25, "{source} {more:?}: {off} mm");
    };
    good("source.ply", "target.ply", &[], 1.0);

    let cloud = mesh_io::Mesh::new(source.clone()).unwrap();
    for name in ["s.obj", "s.pcd", "s.xyz", "s.npy", "s.off"] {
        cloud
            .save(&at.join(name), mesh_io::Options::default())
            .unwrap();
        good(name, "target.ply", &[], 1.0);
    }
    let camera = "element camera 1\nproperty double px\nproperty double py\nproperty double pz\n";
    let with_camera = ply(camera, "double", &source).replace("end_header\n", "end_header\n0 0 0\n");
    let list = plain.replace(
        "property double x",
        "property list uint double descriptor\nproperty double x",
    );
    let (header, body) = list.split_once("end_header\n").unwrap();
    let list = format!(
        "{header}end_header\n{}",
        body.lines()
            .fold(String::new(), |t, l| t + "2 1 2 " + l + "\n")
    );
    let latin: Vec<u8> = ply("comment M\u{fc}ller\n", "double", &source)
        .chars()
        .map(|c| c as u8)
        .collect();
    for (name, bytes) in [
        ("camera.ply", with_camera.into_bytes()),
        ("list.ply", list.into_bytes()),
        ("latin.ply", latin),
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
            ply("comment data follow end_header\n", "double", &source).into_bytes(),
        ),
    ] {
        put(name, &bytes);
        good(name, "target.ply", &[], 1.0);
    }
    // Other units: refused with a word about them, then read.
    for (by, units) in [(1e3, "mm"), (1e4, "1e-4")] {
        let whole = |cloud: &[Point3<f64>]| {
            let scaled = scaled(cloud, by);
            if units == "mm" {
                scaled
            } else {
                scaled.iter().map(|p| p.map(f64::round)).collect()
            }
        };
        let kind = if units == "mm" { "float" } else { "short" };
        put("s_units.ply", ply("", kind, &whole(&source)).as_bytes());
        put("t_units.ply", ply("", kind, &whole(&target)).as_bytes());
        let said = register("s_units.ply", "t_units.ply", &[]);
        let said = String::from_utf8(said.stderr).unwrap();
        assert!(
            said.contains("s_units.ply") && said.contains("--units mm"),
            "{said}"
        );
        good("s_units.ply", "t_units.ply", &["--units", units], 1.0 / by);
    }
    // Landmarks with a heading and without.
    let [s, t] = [source[7], pulled(&source[7])];
    let row = format!("{},{},{},{},{},{}\n", s.x, s.y, s.z, t.x, t.y, t.z);
    put("bare.csv", row.as_bytes());
    put("headed.csv", format!("sx,sy,sz,tx,ty,tz\n{row}").as_bytes());
    let mut answers = Vec::new();
    for name in ["bare.csv", "headed.csv"] {
        good(
            "source.ply",
            "target.ply",
            &["--landmarks", &file(name)],
            1.0,
        );
        answers.push(std::fs::read(at.join("moved.ply")).unwrap());
    }
    assert_eq!(answers[0], answers[1]);
    assert_ne!(answers[0], {
        register("source.ply", "target.ply", &[]);
        std::fs::read(at.join("moved.ply")).unwrap()
    });
    // What cannot be used says why.
    let zero = cloud
        .clone()
        .with_normals(vec![nalgebra::Vector3::zeros(); 2000])
        .unwrap();
    zero.save(&at.join("zero.ply"), mesh_io::Options::default())
        .unwrap();
    put(
        "more.ply",
        plain.replace("vertex 2000", "vertex 2500").as_bytes(),
    );
    for (name, words) in [
        (
            "zero.ply",
            "zero.ply: vertex 0: the normal (0, 0, 0) has no direction",
        ),
        (
            "more.ply",
            "the file ends at vertex 2000, the header promises 2500",
        ),
    ] {
        let output = register(name, "target.ply", &[]);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(
            output.status.code() == Some(1) && said.contains(words),
            "{said}"
        );
    }
    // Turned by 45° about the line of sight: a doubtful answer, which says what would help.
    let turn = nalgebra::Rotation3::from_axis_angle(
        &nalgebra::Vector3::z_axis(),
        std::f64::consts::FRAC_PI_4,
    );
    let turned: Vec<_> = sheet(5000).iter().map(|p| turn * p).collect();
    put("turned.ply", ply("", "double", &turned).as_bytes());
    let output = register("source.ply", "turned.ply", &[]);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(
        output.status.code() == Some(3) && said.contains("--align"),
        "{output:?}"
    );
    let output = register("source.ply", "turned.ply", &["--align"]);
    assert!(output.status.success(), "{output:?}");
    let moved = mesh_io::read(&at.join("moved.ply")).unwrap();
    let truth: Vec<_> = source.iter().map(|p| turn * p).collect();
    let off = error_mm(moved.points(), &truth).0;
    assert!(off < 0.5, "{off} mm");
    std::fs::remove_dir_all(at).unwrap();
}
