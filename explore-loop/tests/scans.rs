//! Recordings of unsegmented camera data, as written by a camera driver and a robot: `explore replay` finds the object in them.
//!
//! A ball lies on a table, and the tip of an arm is above it, in view. What the camera sees of them is computed ray by ray.
#![allow(missing_docs, clippy::unwrap_used, reason = "tests")]

#[path = "sessions/mcap.rs"]
#[allow(dead_code, reason = "what is not used here is used by another test")]
mod mcap;

use std::path::Path;
use std::process::Command;

use dvrk_io::cdr::{
    self, CameraInfo, Endian, Header, Image, JointState, Message, PointCloud2, PointField,
};
use dvrk_io::depth::{Capsule, Intrinsics};
use dvrk_io::kinematics::{Kinematics, RcmFromTip};
use dvrk_io::session::{Role, SessionReader};
use explore_loop::cell::Cell;
use explore_loop::cell::dvrk::CellFile;
use explore_loop::cell::replay::{ReplayCell, ScanOptions};
use explore_loop::nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use serde_json::Value;

const SIZE: [usize; 2] = [480, 360];
/// Focal length, pixels.
const FOCAL: f64 = 600.0;
const FRAMES: u64 = 4;
const STEP: u64 = 100_000_000;
/// Middle and radius of the ball, and depth of the table, metres, camera frame.
const BALL: Point3<f64> = Point3::new(0.0, 0.0, 0.51);
const RADIUS: f64 = 0.04;
const TABLE: f64 = 0.55;
const IMAGE: &str = "/camera/camera/depth/image_rect_raw";
const INFO: &str = "/camera/camera/depth/camera_info";
const CLOUD: &str = "/camera/camera/depth/color/points";

fn camera() -> Intrinsics {
    let [width, height] = SIZE;
    let centre = SIZE.map(|n| 0.5 * n as f64 - 0.5);
    Intrinsics::new(width, height, [FOCAL; 2], centre).unwrap()
}

/// Depth at which a ray (of unit depth) meets a ball.
fn meets(ray: &Vector3<f64>, middle: &Point3<f64>, radius: f64) -> f64 {
    let (a, b) = (ray.norm_squared(), ray.dot(&middle.coords));
    let root = b * b - a * (middle.coords.norm_squared() - radius * radius);
    if root < 0.0 {
        f64::INFINITY
    } else {
        (b - root.sqrt()) / a
    }
}

/// How far the tip of the arm is above the ball, metres: apart from it, or within it as of an arm that holds it.
const APART: f64 = 0.06;
const WITHIN: f64 = -0.012;

/// The first arm of the example, and joint values with which its tip is so far above the ball.
fn arm(height: f64) -> (Kinematics, Isometry3<f64>, [f64; 6]) {
    let file = cell();
    let entry = &file.arm[0];
    let (kinematics, stands) = (entry.kinematics().unwrap(), entry.camera_from_rcm());
    let above = BALL.coords - Vector3::z() * (RADIUS + height);
    let reached = (0..16).find_map(|k| {
        let about = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), f64::from(k) * 0.4);
        let tip = stands.inverse() * Isometry3::from_parts(above.into(), about);
        kinematics.inverse_of_tip(&RcmFromTip(tip)).ok()
    });
    (kinematics, stands, reached.unwrap().joints)
}

fn cell() -> CellFile {
    CellFile::parse(include_str!("../doc/CELL.toml"), Path::new("CELL.toml")).unwrap()
}

/// Depth of every pixel, metres; one in fifty was not measured and is 0.
fn depths(height: f64) -> Vec<f64> {
    let (kinematics, stands, joints) = arm(height);
    let mut links = kinematics.capsules(&stands, &joints, 0.0).unwrap();
    // The closed jaws.
    let tip = stands * kinematics.rcm_from_tip(&joints).unwrap().0;
    links.push(Capsule {
        start: tip * Point3::new(0.0, 0.0, -0.0102),
        end: tip * Point3::origin(),
        radius: 0.003,
    });
    let along = |link: &Capsule| {
        let (link, way) = (*link, link.end - link.start);
        (0..=100).map(move |k| (link.start + way * (f64::from(k) / 100.0), link.radius))
    };
    // What is near to the camera hides all that is behind it: the links above the image are left out.
    let balls = links.iter().flat_map(along).filter(|(p, _)| p.z > 0.3);
    let balls: Vec<_> = balls.chain([(BALL, RADIUS)]).collect();
    let [width, height] = SIZE;
    let depth = |pixel: usize| {
        if pixel % 50 == 7 {
            return 0.0;
        }
        let at = [pixel % width, pixel / width].map(|n| n as f64);
        let ray = camera().back_project(at[0], at[1], 1.0).coords;
        let depths = balls.iter().map(|(p, radius)| meets(&ray, p, *radius));
        depths.fold(TABLE, f64::min)
    };
    (0..width * height).map(depth).collect()
}

fn header(stamp: u64) -> Header {
    mcap::header(stamp, "camera_depth_optical_frame")
}

fn image(stamp: u64, encoding: &str, depths: &[f64]) -> Vec<u8> {
    let [width, height] = SIZE.map(|n| n as u32);
    let (bytes, data): (u32, Vec<u8>) = if encoding == "16UC1" {
        let millimetres = depths
            .iter()
            .map(|d| ((1e3 * d).round() as u16).to_le_bytes());
        (2, millimetres.flatten().collect())
    } else {
        let metres = depths.iter().map(|d| (*d as f32).to_le_bytes());
        (4, metres.flatten().collect())
    };
    let image = Image {
        header: header(stamp),
        height,
        width,
        encoding: encoding.into(),
        step: width * bytes,
        data,
        ..Image::default()
    };
    cdr::encode(&image, Endian::Little).unwrap()
}

fn info(stamp: u64) -> Vec<u8> {
    let [cx, cy] = SIZE.map(|n| 0.5 * n as f64 - 0.5);
    let [width, height] = SIZE.map(|n| n as u32);
    let info = CameraInfo {
        header: header(stamp),
        height,
        width,
        k: [FOCAL, 0.0, cx, 0.0, FOCAL, cy, 0.0, 0.0, 1.0],
        ..CameraInfo::default()
    };
    cdr::encode(&info, Endian::Little).unwrap()
}

/// Organised as `ordered_pc` of a RealSense is (what was not measured is 0), with a colour for each point; or the measured points alone, in
/// millimetres.
fn cloud(stamp: u64, depths: &[f64], organised: bool) -> Vec<u8> {
    let [width, height] = SIZE;
    let mut data = Vec::new();
    let mut count = 0;
    for (pixel, depth) in depths.iter().enumerate() {
        let at = [pixel % width, pixel / width].map(|n| n as f64);
        let point = camera().back_project(at[0], at[1], *depth);
        let point = if organised { point } else { point * 1e3 };
        if organised || *depth > 0.0 {
            data.extend(point.iter().flat_map(|x| (*x as f32).to_le_bytes()));
            // Dark dots of three pixels, seven apart.
            let [u, v] = [pixel % SIZE[0] % 7, pixel / SIZE[0] % 7];
            let grey = if u < 3 && v < 3 { 20 } else { 200 };
            data.extend([grey, grey, grey, 0]);
            count += 1;
        }
    }
    let field = |(name, offset): (&str, u32)| PointField {
        name: name.into(),
        offset,
        datatype: 7,
        count: 1,
    };
    let [width, height] = if organised {
        [width, height]
    } else {
        [count, 1]
    };
    let cloud = PointCloud2 {
        header: header(stamp),
        height: height as u32,
        width: width as u32,
        fields: [("x", 0), ("y", 4), ("z", 8), ("rgb", 12)]
            .map(field)
            .into(),
        is_bigendian: false,
        point_step: 16,
        row_step: 16 * width as u32,
        data,
        is_dense: !organised,
    };
    cdr::encode(&cloud, Endian::Little).unwrap()
}

fn joints(stamp: u64, position: &[f64]) -> Vec<u8> {
    let state = JointState {
        header: mcap::header(stamp, ""),
        position: position.to_vec(),
        ..JointState::default()
    };
    cdr::encode(&state, Endian::Little).unwrap()
}

/// What is recorded in each frame: topic, type, and the message by its stamp.
type Topic<'a> = (&'a str, &'static str, Box<dyn Fn(u64) -> Vec<u8> + 'a>);

/// Both arms: the first above the ball, the second at home. Their poses are in frames of their own, as those of a robot are.
fn arms<'a>(height: f64) -> Vec<Topic<'a>> {
    let near = arm(height).2;
    let home = cell().arm[1].home;
    let pose = |stamp| mcap::pose(stamp, "PSM1_base", |_| {});
    vec![
        (
            "/PSM1/measured_cp",
            dvrk_io::cdr::PoseStamped::TYPE,
            Box::new(pose),
        ),
        (
            "/PSM1/measured_js",
            JointState::TYPE,
            Box::new(move |t| joints(t, &near)),
        ),
        (
            "/PSM1/jaw/measured_js",
            JointState::TYPE,
            Box::new(|t| joints(t, &[0.2])),
        ),
        (
            "/PSM1/jaw/setpoint_js",
            JointState::TYPE,
            Box::new(|t| joints(t, &[-0.2])),
        ),
        (
            "/PSM2/measured_js",
            JointState::TYPE,
            Box::new(move |t| joints(t, &home)),
        ),
    ]
}

fn images<'a>(depths: &'a [f64], encoding: &'static str) -> Vec<Topic<'a>> {
    vec![
        (
            IMAGE,
            Image::TYPE,
            Box::new(move |t| image(t, encoding, depths)),
        ),
        (INFO, CameraInfo::TYPE, Box::new(info)),
    ]
}

fn clouds(depths: &[f64], organised: bool) -> Vec<Topic<'_>> {
    vec![(
        CLOUD,
        PointCloud2::TYPE,
        Box::new(move |t| cloud(t, depths, organised)),
    )]
}

fn file(topics: &[Topic<'_>]) -> Vec<u8> {
    let mut records = Vec::new();
    for ((name, kind, _), id) in topics.iter().zip(1..) {
        records.extend(mcap::schema(id, kind, "ros2msg"));
        records.extend(mcap::channel(id, id, name, "cdr"));
    }
    for stamp in (1..=FRAMES).map(|k| k * STEP) {
        for ((_, _, make), id) in topics.iter().zip(1..) {
            records.extend(mcap::message(id, stamp, &make(stamp)));
        }
    }
    mcap::file(&records, "ros2")
}

struct Answer {
    code: Option<i32>,
    metrics: Value,
    said: String,
    /// Vertices of the model at rest.
    vertices: Vec<Point3<f64>>,
}

fn replay(bytes: &[u8], more: &[&str]) -> Answer {
    let folder = tempfile::tempdir().unwrap();
    let (path, out) = (folder.path().join("bag.mcap"), folder.path().join("out"));
    std::fs::write(&path, bytes).unwrap();
    std::fs::write(
        folder.path().join("CELL.toml"),
        include_str!("../doc/CELL.toml"),
    )
    .unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_explore"))
        .current_dir(folder.path())
        .args(["replay", "bag.mcap", "--json", "--out", "out"])
        .args(more)
        .output()
        .unwrap();
    let mesh = mesh_io::read(&out.join("canonical.ply"));
    Answer {
        code: output.status.code(),
        metrics: serde_json::from_slice(&output.stdout).unwrap_or(Value::Null),
        said: String::from_utf8(output.stderr).unwrap(),
        vertices: mesh.map_or_else(|_| Vec::new(), |mesh| mesh.points().to_vec()),
    }
}

/// Every frame was taken, and the model is the upper side of the ball: no arm, no table.
#[track_caller]
fn shows_the_ball(answer: &Answer, words: &[&str]) {
    let (metrics, said) = (&answer.metrics, &answer.said);
    assert_eq!(answer.code, Some(0), "{said}");
    assert_eq!(
        (&metrics["frames"], &metrics["failed_frames"]),
        (&FRAMES.into(), &0.into()),
        "{said}"
    );
    assert_eq!(metrics["betti"], serde_json::json!([1, 0, 0]), "{metrics}");
    assert!(answer.vertices.len() > 100, "{}", answer.vertices.len());
    // The lower half is not seen, its rim at a shallow angle: both are guessed. The arm is 60 mm away, most of the table more.
    for vertex in &answer.vertices {
        let off = ((vertex - BALL).norm() - RADIUS).abs();
        let tolerance = if vertex.z < 0.49 { 1.5e-3 } else { 0.01 };
        assert!(off < tolerance, "{vertex}: {off}");
    }
    let seen = answer.vertices.iter().filter(|vertex| vertex.z < 0.49);
    assert!(seen.count() > 100);
    for word in words {
        assert!(said.contains(word), "{word} is not in {said}");
    }
}

/// A cloud with rows and colours is a colour image too.
#[test]
fn features_are_found_where_a_cloud_is_a_colour_image() {
    let depths = depths(APART);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bag.mcap");
    for organised in [true, false] {
        let topics = [clouds(&depths, organised), arms(APART)].concat_topics();
        std::fs::write(&path, file(&topics)).unwrap();
        let reader = SessionReader::default().with_topic(Role::Points, CLOUD);
        let scans = reader.scans(&path).unwrap();
        let mut replay = ReplayCell::of_scans(scans, cell().scan_options().unwrap()).unwrap();
        assert_eq!(replay.remaining() as u64, FRAMES);
        let seen = replay.observe().unwrap();
        assert_eq!(seen.colours.as_ref().map(Vec::len), Some(seen.points.len()));
        // By the jaw's set-point the first arm holds something; of the second jaw nothing was recorded.
        assert!(seen.arms[0].holding && !seen.arms[1].holding);
        let Some(features) = seen.features.filter(|_| organised) else {
            assert!(!organised);
            continue;
        };
        assert!(features.len() > 10, "{}", features.len());
        for feature in features {
            assert!(((feature.point - BALL).norm() - RADIUS).abs() < 1e-3);
        }
    }
}

const CELL: [&str; 2] = ["--cell", "CELL.toml"];

#[test]
fn the_object_is_found_in_images_and_clouds_of_every_kind() {
    let depths = depths(APART);
    let with_arms = |camera: Vec<Topic<'_>>| file(&[camera, arms(APART)].concat_topics());
    let table = "the table 0.550 m before the camera with 9";
    let millimetres = ["millimetres by the encoding", table];
    shows_the_ball(
        &replay(&with_arms(images(&depths, "16UC1")), &CELL),
        &millimetres,
    );
    let metres = ["metres by the range", table];
    shows_the_ball(
        &replay(&with_arms(images(&depths, "32FC1")), &CELL),
        &metres,
    );

    let topic = format!("points={CLOUD}");
    let seed = "--seed-point=0,0,0.47";
    // Without the arms' joint values the arm is another body.
    let bare = ["--find-object", "--topic", &topic, seed];
    shows_the_ball(
        &replay(&file(&clouds(&depths, true)), &bare),
        &["metres by the range"],
    );
    let unorganised = file(&clouds(&depths, false));
    shows_the_ball(
        &replay(&unorganised, &bare),
        &["millimetres by the range", "no arm was recorded"],
    );
}

#[test]
fn what_is_missing_is_named_and_what_is_damaged_is_passed_over() {
    let depths = depths(APART);
    let camera = || images(&depths, "16UC1");
    // Not what replay takes a recording for unless it is told.
    let answer = replay(&file(&camera()), &[]);
    assert_eq!(answer.code, Some(1));
    assert!(
        answer.said.contains("--find-object --topic depth="),
        "{}",
        answer.said
    );
    // A lens is missing, joint values are, the table is.
    let answer = replay(&file(&camera()[..1]), &["--find-object"]);
    assert!(answer.said.contains("camera_info"), "{}", answer.said);
    let answer = replay(&file(&camera()), &CELL);
    assert!(answer.said.contains("/PSM1/measured_js"), "{}", answer.said);
    let ball: Vec<f64> = depths
        .iter()
        .map(|d| if *d < TABLE { *d } else { 0.0 })
        .collect();
    let answer = replay(&file(&images(&ball, "16UC1")), &["--find-object"]);
    assert!(
        answer.said.contains("no table was found"),
        "{}",
        answer.said
    );
    // One image is cut short.
    let mut topics = [camera(), arms(APART)].concat_topics();
    topics[0].2 = Box::new(|stamp| {
        let mut bytes = image(stamp, "16UC1", &depths);
        if stamp == 2 * STEP {
            bytes.truncate(bytes.len() / 2);
        }
        bytes
    });
    let answer = replay(&file(&topics), &CELL);
    assert_eq!(answer.metrics["frames"], FRAMES - 1, "{}", answer.said);
    assert!(
        answer
            .said
            .contains("1 messages of the recording could not be read"),
        "{}",
        answer.said
    );
}

/// Both are connected in the cloud: only its joint values separate the arm from the ball.
#[test]
fn an_arm_that_holds_the_object_is_taken_away() {
    let depths = depths(WITHIN);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bag.mcap");
    let topics = [images(&depths, "16UC1"), arms(WITHIN)].concat_topics();
    std::fs::write(&path, file(&topics)).unwrap();
    let farthest = |options: ScanOptions| {
        let scans = SessionReader::default().scans(&path).unwrap();
        let mut replay = ReplayCell::of_scans(scans, options).unwrap();
        let seen = replay.observe().unwrap().points;
        assert!(seen.len() > 500, "{}", seen.len());
        let off = seen.iter().map(|point| (point - BALL).norm() - RADIUS);
        off.fold(0.0, f64::max)
    };
    let known = farthest(cell().scan_options().unwrap());
    let unknown = farthest(ScanOptions::default());
    assert!(known < 2e-3 && unknown > 0.05, "{known} {unknown}");
}

trait Concat<'a> {
    fn concat_topics(self) -> Vec<Topic<'a>>;
}

impl<'a> Concat<'a> for [Vec<Topic<'a>>; 2] {
    fn concat_topics(self) -> Vec<Topic<'a>> {
        self.into_iter().flatten().collect()
    }
}
