//! Recordings as users of other tools reported them: `explore replay` rebuilds the same as from the plain one, or says what is wrong.
//!
//! The plain recording is planted: a camera half a metre above a table looks at an ellipsoid that lies still, with an open arm beside it. What
//! is seen is a patch with a boundary: Betti numbers (1, 0, 0).
#![allow(missing_docs, clippy::unwrap_used, reason = "tests")]

#[path = "sessions/mcap.rs"]
mod mcap;

use std::path::PathBuf;
use std::process::Command;

use dvrk_io::cdr::{self, Endian, Plane};
use explore_loop::nalgebra::Point3;
use mcap::{Layout, PLAIN, POINTS, POSE, TABLE};
use serde_json::Value;

const FRAMES: u64 = 6;
/// Nanoseconds between frames.
const STEP: u64 = 100_000_000;

/// What the camera sees of an ellipsoid of 100 × 70 × 50 mm on a table 0.55 m away: points 4 mm apart in its image, with noise of 0.3 mm
/// that differs from frame to frame.
fn seen(frame: u64) -> Vec<Point3<f64>> {
    let mut noise = 0x9E37_79B9_7F4A_7C15u64.wrapping_mul(frame + 1);
    let mut points = Vec::new();
    for k in 0..40 * 40 {
        let (x, y) = (
            0.004 * f64::from(k % 40) - 0.078,
            0.004 * f64::from(k / 40) - 0.078,
        );
        let rest = 1.0 - (x / 0.05).powi(2) - (y / 0.035).powi(2);
        if rest > 0.02 {
            noise = noise
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            let off = 6e-4 * ((noise >> 40) as f64 / (1u64 << 24) as f64 - 0.5);
            points.push(Point3::new(x, y, 0.525 - 0.025 * rest.sqrt() + off));
        }
    }
    // As single floats, which is what is recorded.
    let single = |p: Point3<f64>| p.map(|x| f64::from(x as f32));
    points.into_iter().map(single).collect()
}

/// Makes the message of a cloud from its stamp, ns, and its points.
type MakeCloud = Box<dyn Fn(u64, Vec<Point3<f64>>) -> Vec<u8>>;

/// The messages of the plain recording, with these clouds and what else is asked for.
struct Recording {
    cloud: MakeCloud,
    log: fn(u64) -> u64,
    arms: bool,
    table: bool,
}

impl Default for Recording {
    fn default() -> Self {
        Self {
            cloud: Box::new(|stamp, points| mcap::cloud(stamp, &points, &PLAIN)),
            log: |frame| frame * STEP,
            arms: true,
            table: true,
        }
    }
}

fn laid_out(layout: Layout) -> Recording {
    let cloud = move |stamp, points: Vec<_>| mcap::cloud(stamp, &points, &layout);
    Recording {
        cloud: Box::new(cloud),
        ..Recording::default()
    }
}

fn with_points(change: impl Fn(u64, Vec<Point3<f64>>) -> Vec<Point3<f64>> + 'static) -> Recording {
    let cloud = move |stamp, points| mcap::cloud(stamp, &change(stamp / STEP, points), &PLAIN);
    Recording {
        cloud: Box::new(cloud),
        ..Recording::default()
    }
}

impl Recording {
    /// One list of messages for each frame, the table in front.
    fn frames(&self) -> Vec<Vec<u8>> {
        let frame = |k: u64| {
            let (stamp, log) = (k * STEP, (self.log)(k));
            let mut messages = Vec::new();
            if self.table && k == 0 {
                let coef = [0.0, 0.0, -1.0, 0.55];
                let plane = cdr::encode(&Plane { coef }, Endian::Little).unwrap();
                messages.extend(mcap::message(TABLE, log, &plane));
            }
            messages.extend(mcap::message(POINTS, log, &(self.cloud)(stamp, seen(k))));
            if self.arms {
                let pose = mcap::pose(stamp, "camera", |_| {});
                messages.extend(mcap::message(POSE, log, &pose));
                messages.extend(mcap::message(mcap::JAW, log, &mcap::jaw(stamp, &[0.8])));
            }
            messages
        };
        (0..FRAMES).map(frame).collect()
    }

    /// The records of a file, without chunks.
    fn records(&self) -> Vec<u8> {
        [declared(), self.frames().concat()].concat()
    }

    fn file(&self) -> Vec<u8> {
        mcap::file(&self.records(), "ros2")
    }
}

/// Schemas and channels.
fn declared() -> Vec<u8> {
    [mcap::schemas("ros2msg"), mcap::channels()].concat()
}

/// What a replay made of a recording.
#[derive(Debug)]
struct Answer {
    code: Option<i32>,
    /// The metrics; null if there are none.
    metrics: Value,
    said: String,
}

fn replay(name: &str, bytes: &[u8], more: &[&str]) -> Answer {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(format!("{name}.mcap"));
    std::fs::write(&path, bytes).unwrap();
    let out: PathBuf = folder.path().join("out");
    let output = Command::new(env!("CARGO_BIN_EXE_explore"))
        .arg("replay")
        .arg(&path)
        .args(["--json", "--out", out.to_str().unwrap()])
        .args(more)
        .output()
        .unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(!said.contains("panicked"), "{name}: {said}");
    if output.status.code() == Some(1) {
        assert_eq!(said.lines().count(), 1, "{name}: {said}");
        assert!(said.contains(path.to_str().unwrap()), "{name}: {said}");
    }
    Answer {
        code: output.status.code(),
        metrics: serde_json::from_slice(&output.stdout).unwrap_or(Value::Null),
        said,
    }
}

/// The figures by which two replays of the same clouds are the same.
fn figures(answer: &Answer) -> Value {
    let keys = [
        "frames",
        "failed_frames",
        "vertices",
        "betti",
        "unsupported",
        "mesh",
    ];
    keys.iter().map(|key| answer.metrics[key].clone()).collect()
}

fn plain() -> Answer {
    let answer = replay("plain", &Recording::default().file(), &[]);
    assert_eq!((answer.code, answer.said.as_str()), (Some(0), ""));
    let metrics = &answer.metrics;
    assert_eq!(metrics["betti"], serde_json::json!([1, 0, 0]));
    assert_eq!(
        (&metrics["frames"], &metrics["failed_frames"]),
        (&FRAMES.into(), &0.into())
    );
    answer
}

/// The same figures to the last digit, and nothing said but these words.
#[track_caller]
fn is_the_same(plain: &Answer, name: &str, file: &[u8], words: &[&str]) {
    let answer = replay(name, file, &[]);
    assert_eq!(answer.code, Some(0), "{name}: {}", answer.said);
    assert_eq!(figures(&answer), figures(plain), "{name}: {}", answer.said);
    assert_eq!(
        words.is_empty(),
        answer.said.is_empty(),
        "{name}: {}",
        answer.said
    );
    for word in words {
        assert!(answer.said.contains(word), "{name}: {}", answer.said);
    }
}

/// A patch with a boundary again, from as many registered frames.
#[track_caller]
fn is_alike(name: &str, file: &[u8], frames: u64, words: &[&str]) {
    let answer = replay(name, file, &[]);
    let said = &answer.said;
    assert_eq!(answer.code, Some(0), "{name}: {said}");
    let (metrics, betti) = (&answer.metrics, serde_json::json!([1, 0, 0]));
    assert_eq!(metrics["betti"], betti, "{name}: {metrics} {said}");
    let taken = metrics["frames"].as_u64().unwrap() - metrics["failed_frames"].as_u64().unwrap();
    assert_eq!(taken, frames, "{name}: {metrics} {said}");
    for word in words {
        assert!(said.contains(word), "{name}: {said}");
    }
}

#[track_caller]
fn is_refused(name: &str, file: &[u8], words: &[&str]) {
    let answer = replay(name, file, &[]);
    assert_eq!(answer.code, Some(1), "{name}: {}", answer.metrics);
    for word in words {
        assert!(
            answer.said.contains(word),
            "{name}: no {word} in {}",
            answer.said
        );
    }
}

/// Noise of a seed is the same noise every time; another seed, and none, are other recordings. The table over seeds replays each once.
#[test]
fn a_recording_can_be_replayed_with_seeded_noise() {
    let file = Recording::default().file();
    let with = |more: &[&str]| {
        let answer = replay("noisy", &file, more);
        assert_eq!(answer.code, Some(0), "{}", answer.said);
        (
            answer.metrics["seed"].clone(),
            figures(&answer),
            answer.metrics["vertices"].clone(),
        )
    };
    let first = with(&["--noise", "0.5", "--seed", "1"]);
    assert_eq!(first, with(&["--noise", "0.5", "--seed", "1"]));
    assert_eq!(first.0, 1);
    assert_ne!(first.1, with(&["--noise", "0.5", "--seed", "2"]).1);
    assert_eq!(with(&["--seed", "2"]).1, figures(&plain()));

    let folder = tempfile::tempdir().unwrap();
    let (path, out) = (folder.path().join("noisy.mcap"), folder.path().join("out"));
    std::fs::write(&path, &file).unwrap();
    let tables = |more: &[&str]| {
        Command::new(env!("CARGO_BIN_EXE_explore"))
            .args(["tables", "--only", "seeds", "--seeds", "1-2", "--json"])
            .args(["--out", out.to_str().unwrap()])
            .args(more)
            .output()
            .unwrap()
    };
    let session = ["--session", path.to_str().unwrap(), "--noise", "0.5"];
    let output = tables(&session);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    let table: Value = serde_json::from_slice(&output.stdout).unwrap();
    let runs = table["runs"].as_array().unwrap();
    assert_eq!((runs.len(), &table["arms"]), (2, &Value::Null));
    assert_eq!(
        (&runs[0]["seed"], &runs[0]["vertices"]),
        (&first.0, &first.2)
    );
    for wrong in [["--arms", "2"], ["--scene", "box"]] {
        let output = tables(&[&session[..], &wrong[..]].concat());
        assert_eq!(output.status.code(), Some(2), "{wrong:?}");
    }
    let output = tables(&["--noise", "0.5"]);
    assert_eq!(output.status.code(), Some(2), "noise without a recording");
}

#[test]
fn containers_of_every_kind_hold_the_same_recording() {
    let plain = plain();
    let records = Recording::default().records();
    let frames = Recording::default().frames().concat();
    let chunk = |compression: &str, stored: &[u8]| {
        mcap::file(&mcap::chunk(&records, compression, stored), "ros2")
    };
    let stored = mcap::zstd(&records);
    let idl = [mcap::schemas("ros2idl"), mcap::channels(), frames.clone()].concat();
    let empty = mcap::chunk(b"", "zstd", &mcap::zstd(b""));
    for (name, file) in [
        ("chunked", chunk("", &records)),
        ("zstd", chunk("zstd", &stored)),
        (
            "empty_zstd_last",
            mcap::file(&[records.clone(), empty].concat(), "ros2"),
        ),
        ("ros2idl", mcap::file(&idl, "ros2")),
        ("no_profile", mcap::file(&records, "")),
    ] {
        is_the_same(&plain, name, &file, &[]);
    }
    // A second channel of the same topic.
    let second = mcap::channel(9, POINTS, "/cell/points", "cdr");
    let from = mcap::message(POINTS, STEP, b"").split_off(9);
    let mut two = [declared(), second, frames].concat();
    let at = two.windows(from.len()).position(|w| w == from).unwrap();
    two[at] = 9;
    is_the_same(&plain, "two_channels", &mcap::file(&two, "ros2"), &[]);
    is_refused("lz4_label", &chunk("lz4", &records), &["lz4_label.mcap"]);
    is_refused(
        "not_mcap",
        b"SQLite format 3\0 and more of it",
        &["not an MCAP file"],
    );
    is_refused("empty", b"", &["empty.mcap"]);
    is_refused("bag", b"#ROSBAG V2.0\n", &["not an MCAP file"]);
}

#[test]
fn damage_costs_no_more_than_it_hits() {
    let plain = plain();
    let chunked = |frames: Vec<Vec<u8>>| -> Vec<Vec<u8>> {
        let first = [declared(), frames[0].clone()].concat();
        let all = std::iter::once(first).chain(frames.into_iter().skip(1));
        all.map(|content| mcap::chunk(&content, "", &content))
            .collect()
    };
    let chunks = chunked(Recording::default().frames());
    let whole = mcap::file(&chunks.concat(), "ros2");
    let without_end = whole.len() - 8 - 29 - 13;
    is_the_same(&plain, "no_footer", &whole[..without_end], &[]);
    // In the fifth of six chunks.
    let head = whole.len() - without_end;
    let cut = whole.len() - head - chunks[5].len() - chunks[4].len() / 2;
    is_alike("cut", &whole[..cut], 4, &[]);
    let zeros = [&whole[..cut], &[0; 4096]].concat();
    is_alike("zeros", &zeros, 4, &[]);
    let mut flipped = whole.clone();
    flipped[cut] ^= 0xFF;
    is_alike("flipped", &flipped, 5, &["could not be read"]);
    let nothing = mcap::message(POINTS, 7 * STEP, b"");
    let file = mcap::file(&[Recording::default().records(), nothing].concat(), "ros2");
    is_the_same(
        &plain,
        "zero_length",
        &file,
        &["1 messages of the recording could not be read"],
    );
}

#[test]
fn clouds_of_every_layout_are_the_same_points() {
    let plain = plain();
    let fields = |names: [(&'static str, u32); 3], kind: u8| names.map(|(n, at)| (n, at, kind));
    for (name, layout) in [
        ("padded", Layout { step: 32, ..PLAIN }),
        (
            "order",
            Layout {
                fields: fields([("x", 13), ("y", 5), ("z", 1)], 7),
                step: 17,
                ..PLAIN
            },
        ),
        (
            "double_big",
            Layout {
                fields: fields([("x", 8), ("y", 16), ("z", 24)], 8),
                step: 32,
                big: true,
                ..PLAIN
            },
        ),
        ("organised", Layout { width: 64, ..PLAIN }),
        (
            "row_step_zero",
            Layout {
                width: 64,
                row_step: Some(0),
                ..PLAIN
            },
        ),
    ] {
        is_the_same(&plain, name, &laid_out(layout).file(), &[]);
    }
    let integers = Layout {
        fields: fields([("x", 0), ("y", 2), ("z", 4)], 3),
        step: 6,
        ..PLAIN
    };
    is_refused(
        "int16",
        &laid_out(integers).file(),
        &["/cell/points", "field x has data type 3"],
    );
    let xyz = Layout {
        fields: [("xyz", 0, 7), ("intensity", 4, 7), ("ring", 8, 7)],
        ..PLAIN
    };
    is_refused("xyz", &laid_out(xyz).file(), &["field x is missing"]);
}

#[test]
fn frames_without_a_body_are_passed_over() {
    for (name, empty) in [("empty_first", 0), ("empty_middle", 2)] {
        let recording = with_points(move |k, points| if k == empty { Vec::new() } else { points });
        is_alike(name, &recording.file(), FRAMES - 1, &[]);
    }
    let three = with_points(|_, points| points[..3].to_vec());
    is_refused("three_points", &three.file(), &["points of the object"]);
    let none = with_points(|_, _| Vec::new());
    is_refused("all_empty", &none.file(), &["points of the object"]);
}

#[test]
fn time_need_not_run_straight() {
    let plain = plain();
    let shuffled = Recording {
        log: |frame| [5, 3, 1, 4, 0, 2][frame as usize] * STEP,
        ..Recording::default()
    };
    let mut frames = shuffled.frames();
    frames.reverse();
    let file = mcap::file(&[declared(), frames.concat()].concat(), "ros2");
    is_the_same(&plain, "unordered", &file, &[]);
    let rolled = Recording {
        log: |frame| u64::MAX - frame,
        ..Recording::default()
    };
    is_the_same(&plain, "rolled_over", &rolled.file(), &[]);
    let twice = [shuffled.records(), Recording::default().frames().concat()].concat();
    is_alike("loop", &mcap::file(&twice, "ros2"), 2 * FRAMES, &[]);
    let at = |change: fn(u64) -> u64| Recording {
        cloud: Box::new(move |stamp, points| mcap::cloud(change(stamp), &points, &PLAIN)),
        arms: false,
        ..Recording::default()
    };
    is_alike("stamp_zero", &at(|_| 0).file(), FRAMES, &["no arm"]);
    let epoch = at(|stamp| stamp + 1_700_000_000_000_000_000);
    is_alike("epoch", &epoch.file(), FRAMES, &["no arm"]);
}

#[test]
fn bad_samples_of_arms_are_left_out_and_said_once() {
    let plain = plain();
    let records = Recording::default().records();
    let with = |more: Vec<u8>| mcap::file(&[records.clone(), more].concat(), "ros2");
    let stamp = 3 * STEP + STEP / 2;
    let pose = |change: fn(&mut dvrk_io::cdr::Pose)| {
        with(mcap::message(
            POSE,
            stamp,
            &mcap::pose(stamp, "camera", change),
        ))
    };
    for (name, file) in [
        ("nan_pose", pose(|pose| pose.position[0] = f64::NAN)),
        ("zero_quaternion", pose(|pose| pose.orientation = [0.0; 4])),
        (
            "nan_quaternion",
            pose(|pose| pose.orientation = [f64::NAN; 4]),
        ),
    ] {
        is_the_same(
            &plain,
            name,
            &file,
            &["1 messages of the recording", "/PSM1/measured_cp"],
        );
    }
    let empty = with(mcap::message(mcap::JAW, stamp, &mcap::jaw(stamp, &[])));
    is_the_same(&plain, "empty_jaw", &empty, &[]);
    let other = with(mcap::message(
        POSE,
        stamp,
        &mcap::pose(stamp, "PSM1_base", |_| {}),
    ));
    is_refused(
        "other_frame",
        &other,
        &["PSM1_base", "camera", "/PSM1/measured_cp"],
    );
}

#[test]
fn what_a_recording_lacks_is_said() {
    let bare = Recording {
        table: false,
        ..Recording::default()
    };
    is_alike("no_table", &bare.file(), FRAMES, &["no table"]);
    let idle = Recording {
        arms: false,
        ..Recording::default()
    };
    is_alike("no_arms", &idle.file(), FRAMES, &["no arm was recorded"]);
    let records = Recording::default().records();
    let other = String::from_utf8_lossy(b"/cell/points").into_owned();
    let renamed = records
        .windows(other.len())
        .position(|w| w == other.as_bytes())
        .unwrap();
    let mut driver = records.clone();
    driver[renamed..][..other.len()].copy_from_slice(b"/depth/cloud");
    let file = mcap::file(&driver, "ros2");
    is_refused("driver", &file, &["/depth/cloud", "--topic"]);
    let named = replay("driver", &file, &["--topic", "points=/depth/cloud"]);
    assert_eq!(figures(&named), figures(&plain()), "{}", named.said);
    let ros1 = [
        mcap::schema(1, "sensor_msgs/PointCloud2", "ros1msg"),
        mcap::channel(1, 1, "/cell/points", "ros1"),
        mcap::message(POINTS, 0, &mcap::cloud(0, &seen(0), &PLAIN)[4..]),
    ];
    is_refused(
        "ros1",
        &mcap::file(&ros1.concat(), "ros1"),
        &["/cell/points", "ros1"],
    );
}

#[test]
fn units_and_points_that_cannot_be_are_told() {
    let plain = plain();
    let millimetres = with_points(|_, points| points.iter().map(|p| p * 1e3).collect());
    is_refused("mm", &millimetres.file(), &["metres", "median distance"]);
    // What a camera writes where it measured nothing.
    let origins = with_points(|_, points| [points, vec![Point3::origin(); 400]].concat());
    is_the_same(&plain, "origins", &origins.file(), &[]);
    let wild = with_points(|_, points| [points, vec![Point3::new(1e6, 0.0, 1e6)]].concat());
    is_alike("wild_point", &wild.file(), FRAMES, &[]);
    let speckles = with_points(|k, points| {
        let flying = points.iter().skip(k as usize).step_by(23);
        let flying = flying
            .enumerate()
            .map(|(i, p)| p * (0.3 + 0.03 * (i % 20) as f64));
        [points.clone(), flying.collect()].concat()
    });
    is_alike("speckles", &speckles.file(), FRAMES, &[]);
    let one = with_points(|k, points| {
        let speckle = points[(k as usize * 397) % points.len()] * 0.8;
        [points, vec![speckle]].concat()
    });
    is_alike("one_speckle", &one.file(), FRAMES, &[]);
}
