//! The program `warp` as a user runs it.
#![allow(missing_docs, clippy::unwrap_used)]

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

use nalgebra::{Point3, Rotation3, Vector3};

/// `cargo test` builds the examples beside the tests.
fn program() -> PathBuf {
    let test = std::env::current_exe().unwrap();
    let name = format!("warp{}", std::env::consts::EXE_SUFFIX);
    let program = test.ancestors().nth(2).unwrap().join("examples").join(name);
    assert!(
        program.exists(),
        "first: cargo build --example warp with the profile of the tests"
    );
    program
}

/// Its output, or its exit code and error message.
fn call(arguments: &[&str]) -> Result<String, (i32, String)> {
    let output = Command::new(program()).args(arguments).output().unwrap();
    let [said, complaint] = [output.stdout, output.stderr].map(|b| String::from_utf8(b).unwrap());
    match output.status.code().unwrap() {
        0 => Ok(said),
        code => Err((code, complaint)),
    }
}

/// A folder with the files of one call.
struct Desk(tempfile::TempDir);

impl Desk {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn put(&self, name: &str, text: &str) -> PathBuf {
        let path = self.0.path().join(name);
        std::fs::write(&path, text).unwrap();
        path
    }

    /// Runs on `nodes.csv` and `query.csv`; what it says, or its complaint and exit code.
    fn run(&self, more: &[&str]) -> Result<String, (i32, String)> {
        let names = ["nodes.csv", "query.csv", "out.csv"];
        let [nodes, query, out] = names.map(|n| self.0.path().join(n).display().to_string());
        call(&[&[nodes.as_str(), &query, "--out", &out], more].concat())
    }

    fn out(&self) -> String {
        std::fs::read_to_string(self.0.path().join("out.csv")).unwrap()
    }
}

fn sheet(turn: &Rotation3<f64>) -> String {
    let mut text = String::new();
    for k in 0..49 {
        let x = Point3::new(f64::from(k % 7), f64::from(k / 7), 40.0) * 0.01;
        let u = turn * x - x;
        let _ = writeln!(text, "{},{},{},{},{},{}", x.x, x.y, x.z, u.x, u.y, u.z);
    }
    text
}

fn rows(text: &str) -> Vec<[f64; 4]> {
    let columns = ["x", "y", "z", "determined"];
    mesh_io::read_table(text.as_bytes(), columns).unwrap().rows
}

/// A half turn carries points on and off the sheet to 1e-9, in order, and says what is known.
#[test]
fn points_are_carried_and_graded() {
    let half = Rotation3::new(Vector3::new(0.0, std::f64::consts::PI, 0.0));
    for more in [
        &[][..],
        &["--radius", "0.025"][..],
        &["--radius", "0.001"][..],
    ] {
        let desk = Desk::new();
        desk.put("nodes.csv", &sheet(&half));
        desk.put(
            "query.csv",
            "0.031,0.024,0.4\n0.031,0.024,0.412\n0.03,0.02,0.9\n",
        );
        let said = desk.run(more).unwrap();
        assert!(said.starts_with("3 points warped by 49 nodes"), "{said}");
        let found = rows(&desk.out());
        let asked = [
            (0.031, 0.024, 0.4),
            (0.031, 0.024, 0.412),
            (0.03, 0.02, 0.9),
        ];
        for (row, (x, y, z)) in found.iter().zip(asked) {
            let expected = half * Point3::new(x, y, z);
            assert!((Point3::new(row[0], row[1], row[2]) - expected).norm() < 1e-9);
        }
        let grades: Vec<f64> = found.iter().map(|row| row[3]).collect();
        // A reach below the spacing leaves every node alone, and the points between them out of reach.
        let expected = if more.contains(&"0.001") {
            [0.0, 0.0, 0.0]
        } else {
            [1.0, 1.0, 0.0]
        };
        assert_eq!(grades, expected);
    }
}

/// A block of nodes determines everything inside.
#[test]
fn a_block_is_determined() {
    let desk = Desk::new();
    let mut text = String::from("x,y,z,ux,uy,uz\n");
    for k in 0..125 {
        let _ = writeln!(text, "{},{},{},0.1,0,0", k % 5, k / 5 % 5, k / 25);
    }
    desk.put("nodes.csv", &text);
    desk.put("query.csv", "x,y,z\n1.5,2.5,1.5\n");
    desk.run(&[]).unwrap();
    assert!(
        desk.out().starts_with("x,y,z,determined\n1.6"),
        "{}",
        desk.out()
    );
    assert_eq!(rows(&desk.out())[0][3].to_bits(), 2_f64.to_bits());
}

/// Headings, comments, blank lines, Windows line ends and a byte order mark are no trouble; without a heading in, none goes out.
#[test]
fn files_may_be_dressed() {
    let desk = Desk::new();
    let bare = sheet(&Rotation3::identity());
    desk.put(
        "nodes.csv",
        &format!(
            "\u{feff}# nodes\r\n\r\nX, Y, Z, \"ux\", uy, uz\r\n{}",
            bare.replace('\n', "\r\n")
        ),
    );
    desk.put("query.csv", " 0.03 , 0.02,\t4e-1\n");
    desk.run(&[]).unwrap();
    assert_eq!(desk.out(), "0.03,0.02,0.4,1\n");
}

/// Other separators, and clouds in files of their own, whose faces and colours go along.
#[test]
fn tables_and_clouds_of_any_kind() {
    let half = Rotation3::new(Vector3::new(0.0, std::f64::consts::PI, 0.0));
    let desk = Desk::new();
    for separator in [";", "\t", " "] {
        desk.put("nodes.csv", &sheet(&half).replace(',', separator));
        desk.put("query.csv", &"0.031,0.024,0.4\n".replace(',', separator));
        desk.run(&[]).unwrap();
        assert!((rows(&desk.out())[0][0] + 0.031).abs() < 1e-9);
    }
    desk.put(
        "q.obj",
        "v 0.031 0.024 0.4 1 0 0\nv 0.03 0.02 0.4 0 1 0\nv 0.04 0.02 0.4 0 0 1\nf 1 2 3\n",
    );
    let path = |name: &str| desk.0.path().join(name).display().to_string();
    let [nodes, query] = [path("nodes.csv"), path("q.obj")];
    call(&[&nodes, &query, "--out", &path("out.ply"), "--quiet"]).unwrap();
    let out = mesh_io::read(Path::new(&path("out.ply"))).unwrap();
    assert!((out.points()[0] - half * Point3::new(0.031, 0.024, 0.4)).norm() < 1e-9);
    assert_eq!(
        (out.triangles(), out.colours()[2]),
        (&[[0, 1, 2]][..], [0, 0, 255])
    );
    assert!(out.property("determined").is_some());
}

#[test]
fn wrong_files_are_named_with_line_and_value() {
    let good = sheet(&Rotation3::identity());
    let cases = [
        (
            "0,0,0,0,0,0\n0,0,zero,0,0,0\n",
            "nodes.csv: line 2: column z: \"zero\" is not a finite number",
        ),
        (
            "x,y,z,ux,uy,uz\n0,0,0,0,NaN,0\n",
            "nodes.csv: line 2: column uy: \"NaN\" is not a finite number",
        ),
        (
            "0,0,0,0,0,inf\n",
            "nodes.csv: line 1: column uz: \"inf\" is not a finite number",
        ),
        (
            "0,0,0,0,0\n",
            "nodes.csv: line 1: 5 values, but there are 6 columns",
        ),
        (
            "ux,uy,uz,x,y,z\n0,0,0,0,0,0\n",
            "nodes.csv: line 1: column \"ux\" stands where \"x\" belongs",
        ),
        (
            "1e99,0,0,0,0,0\n",
            "nodes.csv: a coordinate of node 0 is 1e99",
        ),
        ("", "nodes.csv: no nodes were given"),
        (
            "0,0,0,0,0,x1\n",
            "nodes.csv: line 1: column uz: \"x1\" is not a finite number",
        ),
        (
            "0,0,,0,0,0\n",
            "nodes.csv: line 1: column z: \"\" is not a finite number",
        ),
    ];
    for (nodes, complaint) in cases {
        let desk = Desk::new();
        desk.put("nodes.csv", nodes);
        desk.put("query.csv", "0,0,0\n");
        let (code, said) = desk.run(&[]).unwrap_err();
        assert_eq!(code, 1);
        assert!(said.contains(complaint), "{said}\nwanted {complaint}");
    }
    let desk = Desk::new();
    desk.put("nodes.csv", &good);
    let (code, said) = desk.run(&[]).unwrap_err();
    assert!(code == 1 && said.contains("query.csv"), "{said}");
    desk.put("query.csv", "0,0,0,0\n");
    let (code, said) = desk.run(&[]).unwrap_err();
    assert!(
        code == 1 && said.contains("line 1: 4 values, but there are 3 columns"),
        "{said}"
    );
    assert!(!Path::new(&desk.0.path().join("out.csv")).exists());
}

#[test]
fn wrong_calls_are_told_apart_from_wrong_files() {
    for arguments in [
        &[][..],
        &["a", "b"],
        &["a", "--out", "c"],
        &["a", "b", "c", "--out", "d"],
        &["a", "b", "--out"],
        &["a", "b", "--out", "c", "--radius", "-1"],
        &["a", "b", "--out", "c", "--radius", "wide"],
        &["a", "b", "--out", "c", "--radius", "NaN"],
        &["a", "b", "--out", "c", "--depth", "1"],
    ] {
        let (code, said) = call(arguments).unwrap_err();
        assert!(
            code == 2 && said.lines().count() == 1,
            "{arguments:?}: {said}"
        );
        assert!(said.contains("see warp --help"), "{said}");
    }
    let (code, said) = call(&["no", "such", "--out", "file"]).unwrap_err();
    assert!(code == 1 && said.starts_with("error: no: "), "{said}");
}
