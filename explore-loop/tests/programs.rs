//! Every program of the workspace as a user runs it: help, wrong command lines, JSON, closed pipes, missing and invalid files.
//!
//! The programs are `explore` and all examples of the crates beside this one; an example that is not in the table below fails the first test.
#![allow(missing_docs, clippy::unwrap_used, reason = "tests")]

#[path = "programs/files.rs"]
mod files;

use std::io::PipeReader;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use files::Files;
use serde_json::Value;

/// What the word FILE, OUT or FOLDER of a call stands for is made by [`Files`].
struct Program {
    name: &'static str,
    /// A call that succeeds.
    call: &'static [&'static str],
    /// The argument of `call` that names a file which must be there.
    input: Option<usize>,
    /// Whether the whole call takes minutes: then only its beginning is tried, with a reader that goes away.
    long: bool,
    /// A feature that `cargo test` does not build it with.
    feature: Option<&'static str>,
}

/// One that makes something of nothing, within seconds.
const fn program(name: &'static str, call: &'static [&'static str]) -> Program {
    Program {
        name,
        call,
        input: None,
        long: false,
        feature: None,
    }
}

impl Program {
    /// Its first argument names a file that must be there.
    const fn reads(self) -> Self {
        Self {
            input: Some(0),
            ..self
        }
    }

    const fn takes_long(self) -> Self {
        Self { long: true, ..self }
    }

    const fn with_feature(self, feature: &'static str) -> Self {
        Self {
            feature: Some(feature),
            ..self
        }
    }
}

const PROGRAMS: &[Program] = &[
    program("arm", &[]).takes_long().with_feature("ros2"),
    program("bent_sheet", &["OUT.svg"]),
    program(
        "betti",
        &["ball.ply", "--radius", "0.00905", "--height", "0.007"],
    )
    .reads(),
    program("close_surface", &["ball.ply", "OUT.ply", "0.00724"]).reads(),
    program("compare_baseline", &["session.mcap"]).takes_long(),
    program("custom_pipeline", &[]),
    program("draw", &["OUT"]),
    program("drift", &["1"]).takes_long(),
    program("faulty_cell", &["slip"]).takes_long(),
    program("grips", &["cushion.obj", "--out", "OUT.svg"]).reads(),
    program("kinds", &["1"]).takes_long(),
    program("landmarks", &[]),
    program("long_run", &["2000"]).takes_long(),
    program("meshes", &["tube", "OUT.obj"]),
    program("nets", &["sphere", "200", "1", "OUT"]),
    program("off_surface", &[]),
    program("overturn", &[]),
    program("own_robot", &["1"]).takes_long(),
    program("pairs", &["pairs", "none"]).reads(),
    program("partly_seen", &[]),
    program("projections", &[]).takes_long(),
    program("proposals", &["1"]).takes_long(),
    program("psm_reach", &[]),
    program("register", &["before.ply", "after.ply", "--out", "OUT.ply"]).reads(),
    program("serve_arm", &[]).takes_long().with_feature("ros2"),
    program("session_info", &["session.mcap"]).reads(),
    program("turn_once", &["ellipsoid", "OUT.mcap"]).takes_long(),
    program("turn_over", &[]).takes_long(),
    program(
        "track",
        &[
            "sheet.ply",
            "seen.csv",
            "--plane",
            "0,0,1,0",
            "--out",
            "OUT.csv",
        ],
    )
    .reads(),
    program("tracking_error", &["session.mcap"]).reads(),
    program("warp", &["nodes.csv", "points.csv", "--out", "OUT.csv"]).reads(),
];

/// Cargo builds the examples of all packages that it tests beside the tests; those of a package that it does not test may be missing.
fn built(program: &Program) -> Option<PathBuf> {
    let here = Path::new(env!("CARGO_BIN_EXE_explore")).parent().unwrap();
    let name = format!("{}{}", program.name, std::env::consts::EXE_SUFFIX);
    let path = here.join("examples").join(name);
    (path.exists() && program.feature.is_none()).then_some(path)
}

fn run(path: &Path, arguments: &[String]) -> Output {
    Command::new(path).args(arguments).output().unwrap()
}

/// Exit code and what is said on the standard error, which no panic writes to.
#[track_caller]
fn ended(output: &Output) -> (Option<i32>, String) {
    let said = String::from_utf8(output.stderr.clone()).unwrap();
    assert!(!said.contains("panicked"), "{said}");
    (output.status.code(), said)
}

#[test]
fn the_table_has_every_example() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let mut missing = Vec::new();
    let folders = std::fs::read_dir(root).unwrap();
    for folder in folders.map(|entry| entry.unwrap().path().join("examples")) {
        let Ok(examples) = std::fs::read_dir(folder) else {
            continue;
        };
        for path in examples.map(|entry| entry.unwrap().path()) {
            let main = path.extension().is_some_and(|e| e == "rs") || path.join("main.rs").exists();
            let name = path.file_stem().unwrap().to_str().unwrap().to_owned();
            if main && !PROGRAMS.iter().any(|program| program.name == name) {
                missing.push(name);
            }
        }
    }
    assert!(missing.is_empty(), "{missing:?}");
}

#[test]
fn help_shows_an_example_and_wrong_options_are_named() {
    let explore = [
        &[][..],
        &["run"],
        &["replay"],
        &["tables"],
        &["view"],
        &["robot"],
        &["serve"],
    ];
    let explore = explore.map(|words| (PathBuf::from(env!("CARGO_BIN_EXE_explore")), words));
    let examples = PROGRAMS.iter().filter_map(|p| Some((built(p)?, &[][..])));
    for (path, words) in explore.into_iter().chain(examples) {
        let call = |option: &str| {
            let words = words.iter().map(|w| (*w).to_owned());
            run(&path, &words.chain([option.to_owned()]).collect::<Vec<_>>())
        };
        let help = call("--help");
        assert_eq!(ended(&help), (Some(0), String::new()));
        let text = String::from_utf8(help.stdout).unwrap();
        // What `explore` itself takes are commands.
        let words = if text.contains("Commands:") {
            &["Example"][..]
        } else {
            &["Example", "--json", "--quiet"]
        };
        for word in words {
            assert!(
                text.contains(word),
                "{}: no {word} in {text}",
                path.display()
            );
        }
        let (code, said) = ended(&call("--no-such-option"));
        assert_eq!(code, Some(2), "{said}");
        assert!(
            said.contains("--no-such-option") && said.contains("--help"),
            "{said}"
        );
        assert_eq!(said.lines().count(), 1, "{said}");
    }
}

#[test]
fn answers_come_in_words_or_as_one_json_object() {
    let files = Files::make();
    for program in PROGRAMS.iter().filter(|p| !p.long) {
        let Some(path) = built(program) else {
            continue;
        };
        let call = |more: &str| {
            let mut words = files.call(program.call);
            words.push(more.to_owned());
            run(&path, &words)
        };
        let words = call("--quiet");
        let (code, said) = ended(&words);
        assert_eq!((code, said.as_str()), (Some(0), ""), "{}", program.name);
        assert!(!words.stdout.is_empty(), "{}", program.name);
        let json = call("--json");
        let (code, said) = ended(&json);
        assert_eq!(code, Some(0), "{}: {said}", program.name);
        let answer: Value = serde_json::from_slice(&json.stdout).unwrap();
        assert!(answer.is_object(), "{answer}");
    }
}

#[test]
fn a_reader_may_go_away() {
    let files = Files::make();
    for program in PROGRAMS {
        let Some(path) = built(program) else {
            continue;
        };
        for option in [None, Some("--help")] {
            let words = files.call(program.call);
            let output = Command::new(&path)
                .args(words)
                .args(option)
                .stdout(nobody_reads())
                .stderr(Stdio::piped())
                .output();
            let (code, said) = ended(&output.unwrap());
            assert_eq!(code, Some(0), "{} {option:?}: {said}", program.name);
        }
    }
}

/// The writing end of a pipe whose reader has closed it, as `head` does.
fn nobody_reads() -> Stdio {
    let (reader, writer): (PipeReader, _) = std::io::pipe().unwrap();
    drop(reader);
    writer.into()
}

#[test]
fn missing_files_and_files_of_something_else_are_named() {
    let files = Files::make();
    for program in PROGRAMS {
        let (Some(path), Some(input)) = (built(program), program.input) else {
            continue;
        };
        for content in [
            None,
            Some(&b""[..]),
            Some(b"\x89nothing that \x00 anybody reads\n"),
        ] {
            let mut words = files.call(program.call);
            // The ending says what it should be.
            let ending = Path::new(&words[input])
                .extension()
                .map(std::ffi::OsStr::to_owned);
            let mut wrong = files.path("wrong");
            ending.map(|ending| wrong.set_extension(ending));
            let _none_yet = std::fs::remove_file(&wrong);
            if let Some(content) = content {
                std::fs::write(&wrong, content).unwrap();
            }
            words[input] = wrong.to_str().unwrap().to_owned();
            let (code, said) = ended(&run(&path, &words));
            let what = format!("{} {content:?}: {code:?} {said}", program.name);
            assert_eq!(code, Some(1), "{what}");
            assert!(
                said.starts_with("error: ") && said.lines().count() == 1,
                "{what}"
            );
            assert!(said.contains(wrong.to_str().unwrap()), "{what}");
        }
    }
}
