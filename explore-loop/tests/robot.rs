//! `explore serve` and `explore robot` as two processes over DDS, on this machine only. Every test has a domain of its own.
//!
//! `dvrk-io/tests/ros2/install.sh FOLDER` makes the Python of the test that needs rclpy, `$DVRK_IO_ROS` names it; where it is not set, that test
//! says that it was skipped and passes.
#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::print_stdout,
    clippy::float_cmp,
    reason = "tests; a jaw that holds stays at the same bits"
)]

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::Duration;

use dvrk_io::cdr::JointState;
use dvrk_io::transport::{Participant, Qos, Reader, Transport};
use explore_loop::cell::dvrk::CellFile;
use serde_json::Value;

/// Domains of these tests: not those of the tests of dvrk-io, and most likely others in two runs at once.
fn domain(test: u32) -> String {
    (1 + std::process::id() % 5 * 20 + 17 + test % 3).to_string()
}

fn explore() -> Command {
    Command::new(env!("CARGO_BIN_EXE_explore"))
}

/// The served cell, until it is dropped.
struct Served {
    child: Child,
    folder: tempfile::TempDir,
    said: Vec<String>,
}

impl Served {
    fn start(test: u32, more: &[&str]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let mut child = explore()
            .args(["serve", "--loopback", "--domain", &domain(test)])
            .arg("--write-cell")
            .arg(folder.path().join("CELL.toml"))
            .args(more)
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut said = Vec::new();
        for line in BufReader::new(child.stdout.take().unwrap()).lines() {
            said.push(line.unwrap());
            if said.last().unwrap().starts_with("serving") {
                break;
            }
        }
        Self {
            child,
            folder,
            said,
        }
    }

    fn cell(&self) -> PathBuf {
        self.folder.path().join("CELL.toml")
    }

    /// The same for a computer that has other things to do: two frames a second.
    fn slow_cell(&self) -> PathBuf {
        let text = std::fs::read_to_string(self.cell()).unwrap();
        assert!(text.contains("rate = 10.0"));
        let path = self.folder.path().join("slow.toml");
        std::fs::write(&path, text.replace("rate = 10.0", "rate = 2.0")).unwrap();
        path
    }

    /// Ends it as Ctrl-C does.
    fn interrupt(mut self) -> i32 {
        signal(&self.child);
        self.child.wait().unwrap().code().unwrap()
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn signal(child: &Child) {
    let id = child.id().to_string();
    assert!(
        Command::new("kill")
            .args(["-INT", &id])
            .status()
            .unwrap()
            .success()
    );
}

fn text(output: &Output) -> String {
    let both = [output.stdout.as_slice(), &output.stderr].concat();
    String::from_utf8_lossy(&both).into_owned()
}

#[test]
fn a_served_cell_is_found_well_and_commanded_by_nobody() {
    let served = Served::start(0, &["--tetrahedra", "500"]);
    let said = served.said.join("\n");
    for word in [
        "/PSM1",
        "/PSM3",
        "image_rect_raw",
        "camera_depth_optical_frame",
    ] {
        assert!(said.contains(word), "{word} is not in {said}");
    }
    let file = CellFile::load(&served.cell()).unwrap();
    assert_eq!(file.arm.len(), 3);
    // It says of itself what a file can hold, and is read back as it was.
    let again = CellFile::parse(&file.to_toml().unwrap(), Path::new("again.toml")).unwrap();
    assert_eq!(again, file);

    let output = explore()
        .arg("robot")
        .arg(served.cell())
        .arg("--dry-run")
        .output()
        .unwrap();
    let found = text(&output);
    assert!(output.status.success(), "{found}");
    for check in [
        "PSM1, streams",
        "PSM2, clock",
        "PSM3, other commanders",
        "PSM2, jaw",
        "camera",
        "table",
        "PSM1, home",
        "object",
        "reaches the object",
    ] {
        assert!(found.contains(check), "{check} is not in {found}");
    }
    assert!(!found.contains("NOT OK"), "{found}");

    // An arm that is not there, and a camera that speaks of another frame.
    let mut wrong = file.clone();
    wrong.arm[0].name = "PSM9".into();
    wrong.camera.frame = "elsewhere".into();
    // By the address of an interface instead.
    let network = wrong.network.as_mut().unwrap();
    (network.loopback, network.interfaces) = (false, vec![[127, 0, 0, 1].into()]);
    let path = served.folder.path().join("wrong.toml");
    std::fs::write(&path, wrong.to_toml().unwrap()).unwrap();
    let output = explore()
        .arg("robot")
        .arg(&path)
        .arg("--dry-run")
        .output()
        .unwrap();
    let found = text(&output);
    assert_eq!(output.status.code(), Some(1), "{found}");
    for why in [
        "NOT OK   PSM9, streams",
        "nobody publishes it",
        "but the file has elsewhere",
    ] {
        assert!(found.contains(why), "{why} is not in {found}");
    }
    assert_eq!(served.interrupt(), 0);
}

#[test]
fn a_script_with_rclpy_practises_on_the_served_cell() {
    let python = std::env::var("DVRK_IO_ROS")
        .ok()
        .filter(|path| !path.is_empty());
    let Some(python) = python.map(PathBuf::from) else {
        println!("skipped: no rclpy here ($DVRK_IO_ROS)");
        return;
    };
    let _served = Served::start(1, &["--tetrahedra", "500"]);
    let prefix = python.parent().and_then(Path::parent).unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/robot/practise.py");
    let output = Command::new(&python)
        .arg(script)
        .env("ROS_DOMAIN_ID", domain(1))
        .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        .env("AMENT_PREFIX_PATH", prefix)
        .env("LD_LIBRARY_PATH", prefix.join("lib"))
        .output()
        .unwrap();
    let printed = text(&output);
    assert!(output.status.success(), "{printed}");
    for line in [
        "is homed",
        "by servo_cp",
        "by move_cp",
        "closed and opened",
        "320 x 240 16UC1",
    ] {
        assert!(printed.contains(line), "{line} is not in {printed}");
    }
}

#[test]
fn a_file_that_is_not_there_is_named() {
    let output = explore()
        .args(["robot", "/nowhere/CELL.toml"])
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output).contains("/nowhere/CELL.toml"));
}

/// Reads the jaws of arms that another client commands, only by listening: a second client that could command them would stop them.
struct Jaws(Vec<(Reader<JointState>, Option<f64>)>, Participant);

impl Jaws {
    fn of(test: u32, served: &Served) -> Self {
        let network = CellFile::load(&served.cell()).unwrap().network().unwrap();
        assert_eq!(network.domain().to_string(), domain(test));
        let transport = Participant::join(&network).unwrap();
        let reader = |arm: &str| {
            let topic = format!("/{arm}/jaw/measured_js");
            Reader::new(&transport, topic, Qos::NEWEST).unwrap()
        };
        let readers = ["PSM1", "PSM2", "PSM3"].map(|arm| (reader(arm), None));
        Self(readers.into(), transport)
    }

    /// The next angle of each, radians.
    fn angles(&mut self) -> Vec<f64> {
        let end = self.1.now() + Duration::from_secs(20);
        self.0.iter_mut().for_each(|(_, angle)| *angle = None);
        while self.0.iter().any(|(_, angle)| angle.is_none()) {
            assert!(self.1.now() < end, "a jaw is silent");
            for (reader, angle) in &mut self.0 {
                while let Some(message) = reader.take().unwrap() {
                    *angle = message.position.first().copied();
                }
            }
            self.1.wait(self.1.now() + Duration::from_millis(20));
        }
        self.0.iter().filter_map(|(_, angle)| *angle).collect()
    }
}

/// An exploration under way, a jaw that holds something, and its angle. If the machine is too busy for the arms to follow, the
/// exploration ends early with that reason and is started again.
fn until_a_jaw_holds(served: &Served, jaws: &mut Jaws, out: &Path) -> (Child, (usize, f64)) {
    for _ in 0..3 {
        let mut robot = explore()
            .arg("robot")
            .arg(served.slow_cell())
            .arg("--out")
            .arg(out)
            .spawn()
            .unwrap();
        while robot.try_wait().unwrap().is_none() {
            // Neither open nor closed, and at rest for a second: before they are powered, arms say an angle of 0.
            let then = jaws.angles();
            std::thread::sleep(Duration::from_secs(1));
            let now = jaws.angles();
            let rests = |jaw: &usize| (0.1..0.5).contains(&now[*jaw]) && then[*jaw] == now[*jaw];
            if let Some(jaw) = (0..now.len()).find(rests) {
                return (robot, (jaw, now[jaw]));
            }
        }
    }
    panic!("it ended three times before a jaw held anything");
}

/// Three minutes and more: `cargo test --release -p explore-loop --test robot -- --ignored --nocapture`.
#[test]
#[ignore = "minutes"]
fn ctrl_c_opens_nothing_and_drops_nothing() {
    let served = Served::start(2, &["--seed", "1", "--tetrahedra", "800"]);
    let out = served.folder.path().join("out");
    let mut jaws = Jaws::of(2, &served);
    let (mut robot, held) = until_a_jaw_holds(&served, &mut jaws, &out);
    signal(&robot);
    let code = robot.wait().unwrap().code();
    let after = jaws.angles();
    println!("jaws after Ctrl-C: {after:?}");
    // Who comes next is told, and moves nothing.
    let next = explore()
        .arg("robot")
        .arg(served.slow_cell())
        .arg("--out")
        .arg(served.folder.path().join("next"))
        .output()
        .unwrap();
    assert_eq!(next.status.code(), Some(1));
    assert!(
        text(&next).contains("seems to hold something"),
        "{}",
        text(&next)
    );
    assert_eq!(code, Some(1));
    assert_eq!(after[held.0], held.1, "{after:?}");
    let metrics = std::fs::read(out.join("metrics.json")).unwrap();
    let metrics: Value = serde_json::from_slice(&metrics).unwrap();
    assert_eq!(
        metrics["frames"].as_u64().map(|frames| frames > 0),
        Some(true)
    );
}

/// Ten minutes on two cores: `cargo test --release -p explore-loop --test robot -- --ignored --nocapture`.
#[test]
#[ignore = "minutes"]
fn the_liver_is_explored_to_closure_over_dds() {
    let served = Served::start(0, &["--seed", "1", "--tetrahedra", "800"]);
    let out = served.folder.path().join("out");
    let output = explore()
        .arg("robot")
        .arg(served.slow_cell())
        .arg("--out")
        .arg(&out)
        .output()
        .unwrap();
    let said = text(&output);
    println!("{said}");
    assert!(output.status.success(), "{said}");
    let metrics = std::fs::read(out.join("metrics.json")).unwrap();
    let metrics: Value = serde_json::from_slice(&metrics).unwrap();
    assert_eq!(metrics["stop"], "closed");
    assert_eq!(metrics["betti"], serde_json::json!([1, 0, 1]));
    for name in [
        "canonical.ply",
        "report.html",
        "session.mcap",
        "checkpoint.bin",
    ] {
        assert!(out.join(name).is_file(), "{name}");
    }
}
