//! The example `grips` as its users run it: files give a table and a picture, or one line of error.
#![allow(missing_docs, clippy::unwrap_used, reason = "tests")]

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// `cargo test` builds the examples beside the tests.
fn program() -> PathBuf {
    let here = std::env::current_exe().unwrap();
    let name = format!("grips{}", std::env::consts::EXE_SUFFIX);
    let program = here.ancestors().nth(2).unwrap().join("examples").join(name);
    assert!(
        program.exists(),
        "first: cargo build --example grips, with the profile of the tests"
    );
    program
}

/// A separate folder for every test, deleted at its end.
struct Desk(PathBuf);

impl Desk {
    fn new(name: &str) -> Self {
        let folder = std::env::temp_dir().join(format!("grips-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        Self(folder)
    }

    fn put(&self, name: &str, bytes: &[u8]) {
        std::fs::write(self.0.join(name), bytes).unwrap();
    }

    fn run(&self, arguments: &[&str]) -> Output {
        Command::new(program())
            .args(arguments)
            .current_dir(&self.0)
            .output()
            .unwrap()
    }

    /// Exit code and complaint of a run that must fail.
    fn complaint(&self, arguments: &[&str]) -> (i32, String) {
        let output = self.run(arguments);
        (
            output.status.code().unwrap(),
            String::from_utf8(output.stderr).unwrap(),
        )
    }
}

impl Drop for Desk {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

type Mesh = (Vec<[f64; 3]>, Vec<Vec<u32>>);

/// A closed cushion of 0.2 × 0.12 × 0.05 m on z = 0: rings of quads between two fans.
fn cushion() -> Mesh {
    let (rings, around) = (30u32, 48u32);
    let angle = |k: u32, of: u32, turn: f64| turn * f64::from(k) / f64::from(of);
    let mut points = vec![[0.0, 0.0, 0.05]];
    for i in 1..rings {
        let (r, h) = angle(i, rings, std::f64::consts::PI).sin_cos();
        for k in 0..around {
            let (y, x) = angle(k, around, std::f64::consts::TAU).sin_cos();
            points.push([0.1 * r * x, 0.06 * r * y, 0.025 + 0.025 * h]);
        }
    }
    let last = points.len() as u32;
    points.push([0.0; 3]);
    let at = |i: u32, k: u32| 1 + i * around + k % around;
    let mut faces = Vec::new();
    for k in 0..around {
        faces.push(vec![0, at(0, k), at(0, k + 1)]);
        faces.push(vec![last, at(rings - 2, k + 1), at(rings - 2, k)]);
        for i in 0..rings - 2 {
            faces.push(vec![at(i, k), at(i + 1, k), at(i + 1, k + 1), at(i, k + 1)]);
        }
    }
    (points, faces)
}

fn header(format: &str, kind: &str, (points, faces): &Mesh) -> String {
    format!(
        "ply\nformat {format} 1.0\ncomment a cushion\nelement vertex {}\nproperty {kind} x\nproperty {kind} y\nproperty {kind} z\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n",
        points.len(),
        faces.len()
    )
}

fn ascii(mesh: &Mesh) -> String {
    let mut text = header("ascii", "double", mesh);
    for [x, y, z] in &mesh.0 {
        writeln!(text, "{x} {y} {z}").unwrap();
    }
    for face in &mesh.1 {
        let corners: Vec<String> = face.iter().map(ToString::to_string).collect();
        writeln!(text, "{} {}", face.len(), corners.join(" ")).unwrap();
    }
    text
}

fn binary(mesh: &Mesh, little: bool) -> Vec<u8> {
    let format = if little {
        "binary_little_endian"
    } else {
        "binary_big_endian"
    };
    let mut bytes = header(format, "double", mesh).into_bytes();
    for x in mesh.0.iter().flatten() {
        bytes.extend(if little {
            x.to_le_bytes()
        } else {
            x.to_be_bytes()
        });
    }
    for face in &mesh.1 {
        bytes.push(face.len() as u8);
        for v in face {
            bytes.extend(if little {
                v.to_le_bytes()
            } else {
                v.to_be_bytes()
            });
        }
    }
    bytes
}

fn text(output: &Output) -> String {
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    String::from_utf8(output.stdout.clone()).unwrap()
}

/// A number after a word of a line.
fn after(line: &str, word: &str) -> f64 {
    let rest = &line[line.find(word).unwrap() + word.len()..];
    let number = rest.trim_start().split([',', ' ', ';']).next().unwrap();
    number.parse().unwrap()
}

#[test]
fn a_cushion_gets_ranked_sets_and_a_picture() {
    let desk = Desk::new("ranked");
    desk.put("cushion.ply", ascii(&cushion()).as_bytes());
    let out = text(&desk.run(&["cushion.ply", "--arms", "3"]));
    // What is missing faces down.
    assert!(out.contains("toward (") && out.contains("-1.00)"), "{out}");
    let sets: Vec<&str> = out.lines().filter(|l| l.contains("score ")).collect();
    assert!(sets.len() > 3);
    let scores: Vec<f64> = sets.iter().map(|l| after(l, "score")).collect();
    assert!(scores.windows(2).all(|w| w[0] >= w[1]));
    for set in &sets {
        assert!((0.0..=1.0).contains(&after(set, "coverage")));
        assert!(
            set.contains("feasible") || set.contains("refused: "),
            "{set}"
        );
    }
    let poses = out
        .lines()
        .filter(|l| l.contains("approach (") && l.contains("jaws ("))
        .count();
    assert!((2 * sets.len()..=3 * sets.len()).contains(&poses));
    assert!(out.contains("holds vertex"), "a third arm holds somewhere");
    let picture = std::fs::read_to_string(desk.0.join("grips.svg")).unwrap();
    assert!(picture.starts_with("<svg ") && picture.trim_end().ends_with("</svg>"));
    let count = |what: &str| picture.matches(what).count();
    assert!(count("<polygon ") > 500);
    assert_eq!(count("class=\"candidate\""), 100);
    assert!((2..=3).contains(&count("class=\"grip\"")));
    assert_eq!(count("class=\"way\""), count("class=\"grip\""));
    assert!(!picture.contains("NaN") && !picture.contains("inf"));
}

#[test]
fn every_kind_of_ply_gives_the_same_answer() {
    let desk = Desk::new("kinds");
    let mesh = cushion();
    desk.put("m.ply", ascii(&mesh).as_bytes());
    let first = text(&desk.run(&["m.ply"]));
    for little in [true, false] {
        desk.put("m.ply", &binary(&mesh, little));
        assert_eq!(text(&desk.run(&["m.ply"])), first);
    }
}

/// A soup of triangles, a vertex that no face uses, millimetres, another axis up, a second body: the same cushion.
#[test]
fn every_way_to_write_the_cushion_gives_the_same_answer() {
    let desk = Desk::new("ways");
    let (points, faces) = cushion();
    desk.put("m.ply", ascii(&(points.clone(), faces.clone())).as_bytes());
    let seen = |arguments: &[&str]| {
        let out = text(&desk.run(arguments));
        // Without the name of the file, and what depends on the last digit.
        let lines: Vec<_> = out
            .lines()
            .take(2)
            .map(|l| l.split_once(": ").map_or(l, |l| l.1).to_owned())
            .collect();
        lines
    };
    let expected = seen(&["m.ply"]);
    assert!(expected[0].contains("which is closed"), "{expected:?}");
    let point = |v: u32| points[v as usize];
    let soup: Vec<[f64; 3]> = faces.iter().flatten().map(|v| point(*v)).collect();
    let mut next = 0u32;
    let own = |f: &Vec<u32>| {
        let first = next;
        next += f.len() as u32;
        (first..next).collect()
    };
    let soup = (soup, faces.iter().map(own).collect());
    desk.put("soup.ply", ascii(&soup).as_bytes());
    assert_eq!(seen(&["soup.ply"]), expected);
    let mut unused = points.clone();
    unused.push([3.0, 3.0, 3.0]);
    desk.put("unused.ply", ascii(&(unused, faces.clone())).as_bytes());
    assert_eq!(seen(&["unused.ply"]), expected);
    let large = points.iter().map(|p| p.map(|x| 1000.0 * x)).collect();
    desk.put("mm.ply", ascii(&(large, faces.clone())).as_bytes());
    assert_eq!(seen(&["mm.ply", "--units", "mm"]), expected);
    assert_eq!(seen(&["mm.ply", "--size", "0.2"]), expected);
    let turned = points.iter().map(|[x, y, z]| [*y, *z, *x]).collect();
    desk.put("turned.ply", ascii(&(turned, faces.clone())).as_bytes());
    assert_eq!(seen(&["turned.ply", "--up", "y"]), expected);
    let mut two = points.clone();
    two.extend([[0.0, 0.0, 0.2], [0.1, 0.0, 0.2], [0.0, 0.1, 0.2]]);
    let count = points.len() as u32;
    let mut more = faces.clone();
    more.push(vec![count, count + 1, count + 2]);
    desk.put("two.ply", ascii(&(two, more)).as_bytes());
    assert_eq!(seen(&["two.ply", "--body", "1"]), expected);
}

#[test]
fn two_arms_hold_nothing_down() {
    let desk = Desk::new("two");
    desk.put("m.ply", ascii(&cushion()).as_bytes());
    let out = text(&desk.run(&["m.ply", "--arms", "2"]));
    assert!(!out.contains("arm 2") && !out.contains("holds vertex"));
}

#[test]
fn camera_and_plane_say_what_is_seen() {
    let desk = Desk::new("view");
    // The same cushion as a camera frame has it: z away from the camera, the table half a metre down.
    let (points, faces) = cushion();
    let turned = points.iter().map(|[x, y, z]| [*x, -*y, 0.5 - z]).collect();
    desk.put("m.ply", ascii(&(turned, faces)).as_bytes());
    let out = text(&desk.run(&[
        "m.ply", "--plane", "0,0,-2,1", "--camera", "0,0,0", "--out", "seen.svg",
    ]));
    assert!(out.contains(" 1.00)"), "{out}");
    assert!(desk.0.join("seen.svg").exists());
    // From the side another part is seen, and something else is missing.
    let aside = text(&desk.run(&["m.ply", "--plane", "0,0,-2,1", "--camera", "0.5,0,0.3"]));
    assert!(aside.lines().nth(1) != out.lines().nth(1));
}

#[test]
fn an_open_mesh_is_known_as_a_whole() {
    let desk = Desk::new("open");
    let (points, mut faces) = cushion();
    faces.retain(|f| f.iter().all(|&v| points[v as usize][2] > 0.015));
    desk.put("m.ply", ascii(&(points, faces)).as_bytes());
    let out = text(&desk.run(&["m.ply"]));
    assert!(out.contains("100 % of the mesh, which is open"), "{out}");
    // Its lower rim is hidden under the bulge: the reason is said.
    assert!(out.contains("the camera does not see it"), "{out}");
}

#[test]
fn complaints_say_what_is_wrong() {
    let desk = Desk::new("bad");
    let mesh = cushion();
    let good = ascii(&mesh);
    desk.put("good.ply", good.as_bytes());
    desk.put("not.ply", b"solid cushion\nfacet\n");
    let half = good[..good.len() / 2].rfind('\n').unwrap() + 1;
    desk.put("short.ply", &good.as_bytes()[..half]);
    desk.put("faceless.ply", ascii(&(mesh.0.clone(), vec![])).as_bytes());
    desk.put(
        "nan.ply",
        good.replacen("0 0 0.05", "0 NaN 0.05", 1).as_bytes(),
    );
    desk.put(
        "index.ply",
        good.replacen("\n3 0 1 2\n", "\n3 0 1 99999\n", 1)
            .as_bytes(),
    );
    let huge = mesh.0.iter().map(|p| p.map(|x| 1000.0 * x)).collect();
    desk.put("mm.ply", ascii(&(huge, mesh.1.clone())).as_bytes());
    let files = [
        ("missing.ply", "missing.ply:"),
        ("not.ply", "not a PLY file"),
        ("short.ply", "the file ends at"),
        ("faceless.ply", "no faces"),
        ("nan.ply", "vertex 0: y is NaN"),
        ("index.ply", "vertex 99999"),
        ("mm.ply", "metres"),
    ];
    for (file, words) in files {
        let (code, said) = desk.complaint(&[file]);
        assert!(
            code == 1 && said.contains(words) && said.lines().count() == 1,
            "{file}: {code} {said}"
        );
    }
    let usage: [(&[&str], &str); 9] = [
        (&["good.ply", "--units", "inch"], "m, cm, mm or the length"),
        (&[], "<MODEL>"),
        (&["good.ply", "--arms", "4"], "4 is not in 2..=3"),
        (&["good.ply", "--camera", "1,2"], "3 finite numbers"),
        (&["good.ply", "--camera", "1,2,inf"], "3 finite numbers"),
        (&["good.ply", "--plane", "0,0,0,1"], "no direction"),
        (&["good.ply", "--plane"], "a value is required for '--plane"),
        (
            &["good.ply", "--speed", "3"],
            "unexpected argument '--speed'",
        ),
        (
            &["good.ply", "other.ply"],
            "unexpected argument 'other.ply'",
        ),
    ];
    for (arguments, words) in usage {
        let (code, said) = desk.complaint(arguments);
        assert!(
            code == 2 && said.contains(words) && said.lines().count() == 1,
            "{arguments:?}: {code} {said}"
        );
    }
    let (code, said) = desk.complaint(&["good.ply", "--camera", "0,0,-1"]);
    assert!(code == 1 && said.contains("under the table"), "{said}");
    let (code, said) = desk.complaint(&["good.ply", "--plane", "0,0,1,-0.04"]);
    assert!(code == 1 && said.contains("below the table"), "{said}");
    let (code, said) = desk.complaint(&["good.ply", "--out", "no/such/folder.svg"]);
    assert!(code == 1 && said.contains("no/such/folder.svg"), "{said}");
    assert!(!Path::new(&desk.0).join("grips.svg").exists());
}
