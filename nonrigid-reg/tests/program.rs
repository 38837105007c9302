//! The program `register` on real files, run as a user runs it.
#![allow(missing_docs, clippy::unwrap_used)]

#[path = "../benches/generator/mod.rs"]
mod generator;

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use generator::{Case, Motion, Pair, Shape, error_mm};
use nalgebra::Point3;

/// The program as its source now stands: cargo builds examples for `cargo test`, but not for `cargo test --test program`.
fn program() -> PathBuf {
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
    fails(&[&file("nan.ply"), &source, "--out", &out], "not finite");
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
