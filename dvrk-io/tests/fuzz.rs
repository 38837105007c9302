//! 10⁵ hostile inputs a decoder: nothing panics, and nothing takes more memory or time than its input is worth. A million each:
//! `DVRK_IO_FUZZ=1000000 cargo test --release -p dvrk-io --test fuzz -- --nocapture`.
//!
//! Seven of eight inputs are whole files and messages with bytes overwritten, cut out, doubled or inserted, one is random bytes, half of these behind
//! the first bytes of a whole one; all by a seeded generator: the number of a failing input is printed and makes it again.
#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "tests"
)]

use std::collections::BTreeMap;
use std::time::Instant;

use dvrk_io::calibration::Calibration;
use dvrk_io::cdr::{
    self, Bool, CameraInfo, Empty, Endian, Float64, Image, JointState, Joy, Message,
    OperatingState, Plane, PointCloud2, PoseStamped, StringStamped, Text, TwistStamped,
    WrenchStamped,
};
use dvrk_io::depth::{ObjectOptions, Scan, find_object};
use dvrk_io::features::{Descriptor, Feature};
use dvrk_io::session::{
    Compression, SessionReader, SessionWriter, WriterOptions, read_truth_from_bytes,
};
use dvrk_io::transport::Network;
use nalgebra::{Isometry3, Point3, Vector3};

/// `SplitMix64`.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    fn below(&mut self, bound: usize) -> usize {
        (self.next() % bound.max(1) as u64) as usize
    }
}

/// `bytes` with one to four pieces of damage.
fn damaged(bytes: &[u8], seed: u64) -> Vec<u8> {
    const NASTY: [u64; 8] = [0, 1, 0x7F, 0xFF, 0xFFFF, 0x7FFF_FFFF, 0xFFFF_FFFF, u64::MAX];
    let mut random = Random(seed);
    let mut bytes = bytes.to_vec();
    for _ in 0..=random.below(4) {
        let at = random.below(bytes.len());
        let width = 1 + random.below(8);
        let end = bytes.len().min(at + width);
        match random.below(7) {
            0 => bytes.truncate(at),
            1 => drop(bytes.drain(at..end)),
            2 => bytes.extend_from_within(at..end),
            3 => bytes.insert(at, random.next() as u8),
            4 => bytes[at..end].fill(random.next() as u8),
            5 => {
                let value = NASTY[random.below(NASTY.len())].to_le_bytes();
                for (byte, value) in bytes[at..end].iter_mut().zip(value) {
                    *byte = value;
                }
            }
            _ => {
                let bit = 1 << random.below(8);
                if let Some(byte) = bytes.get_mut(at) {
                    *byte ^= bit;
                }
            }
        }
    }
    bytes
}

/// Random bytes, up to 512, behind none or some of the first of `bytes`.
fn random(bytes: &[u8], seed: u64) -> Vec<u8> {
    let mut random = Random(!seed);
    let kept = match random.below(2) {
        0 => 0,
        _ => random.below(bytes.len().min(64)),
    };
    let length = random.below(512);
    let noise = (0..length).map(|_| random.next() as u8);
    bytes[..kept].iter().copied().chain(noise).collect()
}

fn count() -> u64 {
    std::env::var("DVRK_IO_FUZZ").map_or(100_000, |text| text.parse().unwrap())
}

/// Hands hostile inputs made of `bytes` to `check`, which says whether one was taken for a whole one, and prints how many were.
fn every(name: &str, bytes: &[u8], mut check: impl FnMut(&[u8]) -> bool) {
    let (count, start) = (count(), Instant::now());
    let mut taken = 0;
    for seed in 0..count {
        let input = match seed % 8 {
            7 => random(bytes, seed),
            _ => damaged(bytes, seed),
        };
        let outcome = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| check(&input)));
        assert!(outcome.is_ok(), "{name}: input {seed} panics");
        taken += u64::from(outcome.unwrap_or_default());
    }
    let seconds = start.elapsed().as_secs_f64();
    println!("{name}: {count} inputs, {taken} taken for whole ones, no panic, {seconds:.1} s");
    // Else only the first bytes of what is decoded would have been looked at.
    assert!(count < 1000 || taken > 0, "{name}");
}

/// A small session: what costs time are not the bytes but what is tried with them.
fn session(compression: Compression) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("session.mcap");
    let options = WriterOptions::default().with_compression(compression);
    let mut writer = SessionWriter::create_with(&path, options).unwrap();
    writer.table(0.0, &-Vector3::z_axis(), 0.5).unwrap();
    for frame in 0..3 {
        let stamp = f64::from(frame);
        let points: Vec<_> = (0..40)
            .map(|i| Point3::new(f64::from(i), stamp, 0.25))
            .collect();
        writer.points(stamp, &points).unwrap();
        writer.pose(stamp, "PSM1", &Isometry3::identity()).unwrap();
        writer.jaw(stamp, "PSM1", 0.0).unwrap();
        writer.truth(stamp, &points).unwrap();
    }
    writer.finish().unwrap();
    std::fs::read(&path).unwrap()
}

fn read(input: &[u8]) -> bool {
    let _ = read_truth_from_bytes(input);
    let Ok(session) = SessionReader::default().read_bytes(input) else {
        return false;
    };
    let finite = |point: &Point3<f64>| point.coords.norm().is_finite();
    assert!(session.frames.iter().all(|f| f.points.iter().all(finite)));
    true
}

fn fuzz_session(compression: Compression) {
    let name = format!("session, chunks {compression:?}");
    every(&name, &session(compression), read);
}

/// Checksums hide most of the walk from damage; here there are none.
fn without_checksums(mut file: Vec<u8>) -> Vec<u8> {
    let mut at = 8;
    while at + 9 < file.len() {
        if file[at] == 0x06 {
            file[at + 9 + 24..at + 9 + 28].fill(0);
        }
        at += 9 + usize::try_from(u64::from_le_bytes(file[at + 1..at + 9].try_into().unwrap()))
            .unwrap();
    }
    file
}

#[test]
fn sessions() {
    fuzz_session(Compression::None);
}

#[test]
fn sessions_in_lz4() {
    fuzz_session(Compression::Lz4);
}

#[test]
fn sessions_in_zstd() {
    fuzz_session(Compression::Zstd);
}

#[test]
fn sessions_without_checksums() {
    for compression in Compression::ALL {
        let name = format!("session, chunks {compression:?} without checksums");
        every(&name, &without_checksums(session(compression)), read);
    }
}

fn fuzz_message<M: cdr::Message>(message: &M, check: impl Fn(M)) {
    for endian in [Endian::Little, Endian::Big] {
        let name = format!("{}, {endian:?}", M::TYPE);
        every(&name, &cdr::encode(message, endian).unwrap(), |input| {
            let decoded = cdr::decode(input);
            decoded.map(&check).is_ok()
        });
    }
}

#[test]
fn clouds() {
    let points = [
        Point3::new(1.0, 2.0, 3.0),
        Point3::origin(),
        Point3::new(-1.0, 0.5, 4.0),
    ];
    let mut cloud = PointCloud2::from_points(cdr::Header::default(), &points).unwrap();
    let read = |cloud: PointCloud2| {
        let _ = (cloud.points(), cloud.colours(), cloud.features());
    };
    fuzz_message(&cloud, read);
    (
        cloud.height,
        cloud.width,
        cloud.row_step,
        cloud.is_bigendian,
    ) = (3, 1, 12, true);
    fuzz_message(&cloud, read);
    let colours = [[1, 2, 3]; 3];
    let header = cdr::Header::default();
    let coloured = PointCloud2::from_coloured_points(header.clone(), &points, &colours);
    fuzz_message(&coloured.unwrap(), read);
    let feature = |point: &Point3<f64>| Feature {
        point: *point,
        descriptor: Descriptor([7; 8]),
    };
    let features: Vec<_> = points.iter().map(feature).collect();
    fuzz_message(
        &PointCloud2::from_features(header, &features).unwrap(),
        read,
    );
}

#[test]
fn poses_planes_and_joints() {
    let pose = (&Isometry3::translation(1.0, 2.0, 3.0)).into();
    fuzz_message(
        &PoseStamped {
            header: cdr::Header::default(),
            pose,
        },
        |pose: PoseStamped| {
            drop(pose.pose.isometry());
        },
    );
    fuzz_message(
        &Plane {
            coef: [0.0, 0.0, 1.0, 2.0],
        },
        |plane: Plane| drop(plane.normalized()),
    );
    let joints = JointState {
        name: vec!["jaw".into(); 3],
        position: vec![0.1; 3],
        ..JointState::default()
    };
    fuzz_message(&joints, |_: JointState| ());
}

#[test]
fn states_texts_and_buttons() {
    let header = cdr::Header {
        frame_id: "PSM1_base".into(),
        ..cdr::Header::default()
    };
    let state = OperatingState {
        header: header.clone(),
        state: "ENABLED".into(),
        is_homed: true,
        is_busy: false,
    };
    fuzz_message(&state, |_: OperatingState| ());
    let stamped = StringStamped {
        header: header.clone(),
        string: "home".into(),
    };
    fuzz_message(&stamped, |_: StringStamped| ());
    let text = Text {
        data: "PSM1: arm not ready".into(),
    };
    fuzz_message(&text, |_: Text| ());
    let joy = Joy {
        header: header.clone(),
        axes: vec![0.5; 2],
        buttons: vec![1; 3],
    };
    fuzz_message(&joy, |joy: Joy| {
        joy.is_pressed();
    });
    let (linear, angular) = ([1.0, 2.0, 3.0], [4.0, 5.0, 6.0]);
    fuzz_message(
        &TwistStamped {
            header: header.clone(),
            linear,
            angular,
        },
        |_: TwistStamped| (),
    );
    fuzz_message(
        &WrenchStamped {
            header,
            force: linear,
            torque: angular,
        },
        |_: WrenchStamped| (),
    );
    fuzz_message(&Bool { data: true }, |_: Bool| ());
    fuzz_message(&Float64 { data: 0.5 }, |_: Float64| ());
    fuzz_message(&Empty, |_: Empty| ());
}

/// Whatever comes on its topics, an arm neither panics nor leaves its limits.
#[test]
fn an_arm_among_damaged_messages() {
    use dvrk_io::arm::{Arm, ArmOptions, OtherWriters};
    use dvrk_io::serve::{ArmServer, KinematicArm, ServeOptions};
    use dvrk_io::transport::{Bus, Qos, Topic, Transport};
    use std::time::Duration;

    let bus = Bus::new();
    let options = ServeOptions::default();
    let mut server = ArmServer::new(&bus.node(), "PSM1", KinematicArm::default(), options).unwrap();
    bus.every(Duration::from_millis(1), move |now| server.tick(now));
    let patience = Duration::from_secs(6);
    let options = ArmOptions::default().with_other_writers(OtherWriters::Allow);
    let mut arm = Arm::connect(std::sync::Arc::new(bus.node()), "PSM1", options, patience).unwrap();
    arm.enable(patience).unwrap();
    arm.home(patience).unwrap();
    let node = bus.node();
    let pose = PoseStamped {
        header: cdr::Header::default(),
        pose: (&Isometry3::translation(0.0, 0.0, -0.12)).into(),
    };
    let joints = JointState {
        position: vec![0.1; 6],
        ..JointState::default()
    };
    let state = OperatingState {
        state: "ENABLED".into(),
        ..OperatingState::default()
    };
    let command = StringStamped {
        string: "home".into(),
        ..StringStamped::default()
    };
    let little = Endian::Little;
    let pose = cdr::encode(&pose, little).unwrap();
    let joints = cdr::encode(&joints, little).unwrap();
    let state = cdr::encode(&state, little).unwrap();
    let command = cdr::encode(&command, little).unwrap();
    let topic = |name: &str, qos| Topic::new::<PoseStamped>(format!("/PSM1/{name}"), qos);
    let joint_topic = |name: &str, qos| Topic::new::<JointState>(format!("/PSM1/{name}"), qos);
    let mut senders = Vec::new();
    for name in ["measured_cp", "setpoint_cp", "local/measured_cp"] {
        senders.push((node.advertise(&topic(name, Qos::PERIODIC)).unwrap(), &pose));
    }
    for name in ["servo_cp", "move_cp"] {
        senders.push((node.advertise(&topic(name, Qos::COMMAND)).unwrap(), &pose));
    }
    for name in ["measured_js", "jaw/measured_js", "jaw/setpoint_js"] {
        senders.push((
            node.advertise(&joint_topic(name, Qos::PERIODIC)).unwrap(),
            &joints,
        ));
    }
    for name in ["jaw/servo_jp", "jaw/move_jp"] {
        senders.push((
            node.advertise(&joint_topic(name, Qos::COMMAND)).unwrap(),
            &joints,
        ));
    }
    let states = Topic::new::<OperatingState>("/PSM1/operating_state", Qos::EVENT);
    senders.push((node.advertise(&states).unwrap(), &state));
    let commands = Topic::new::<StringStamped>("/PSM1/state_command", Qos::COMMAND);
    senders.push((node.advertise(&commands).unwrap(), &command));
    let goal = arm.rcm_from_tip().unwrap().value;
    for seed in 0..count() / 20 {
        let mut random = Random(seed);
        let pick = random.below(senders.len());
        let (sender, message) = &mut senders[pick];
        sender.publish(damaged(message, seed)).unwrap();
        let _ = arm.start_line(&goal, 0.01);
        bus.advance(Duration::from_millis(5));
        arm.tick();
        assert!(
            arm.joints()
                .is_none_or(|joints| joints.value.iter().all(|x| x.is_finite()))
        );
    }
}

fn camera() -> (Image, CameraInfo) {
    let (width, height) = (12, 10);
    let depth = |i: u16| -> u16 {
        if (i % 12).abs_diff(5) < 3 && i > 40 && i < 90 {
            470
        } else {
            500
        }
    };
    let image = Image {
        height,
        width,
        encoding: "16UC1".into(),
        step: 2 * width,
        data: (0..120).flat_map(|i: u16| depth(i).to_le_bytes()).collect(),
        ..Image::default()
    };
    let k = [100.0, 0.0, 5.5, 0.0, 100.0, 4.5, 0.0, 0.0, 1.0];
    (
        image,
        CameraInfo {
            height,
            width,
            k,
            ..CameraInfo::default()
        },
    )
}

#[test]
fn images_and_cameras() {
    let (image, info) = camera();
    let options = ObjectOptions::default()
        .with_table((-Vector3::z_axis(), 0.5))
        .with_voxel(0.005);
    let look = |image: &Image, info: &CameraInfo| {
        if let Ok(scan) = Scan::from_depth(image, info, None) {
            drop(find_object(&scan, &[], &options));
        }
    };
    fuzz_message(&image, |image: Image| look(&image, &info));
    fuzz_message(&info, |info: CameraInfo| look(&image, &info));
}

#[test]
fn objects() {
    let (image, info) = camera();
    let scan = Scan::from_depth(&image, &info, None).unwrap();
    let options = ObjectOptions::default().with_voxel(0.005);
    assert!(find_object(&scan, &[], &options).is_ok());
    let mut cloud = PointCloud2::from_points(cdr::Header::default(), scan.points()).unwrap();
    (cloud.height, cloud.width, cloud.row_step) = (10, 12, 144);
    every(
        "objects in clouds",
        &cdr::encode(&cloud, Endian::Little).unwrap(),
        |input| {
            let Ok(cloud) = cdr::decode::<PointCloud2>(input) else {
                return false;
            };
            if let Ok(scan) = Scan::from_cloud(&cloud, None)
                && let Ok(object) = find_object(&scan, &[], &options)
            {
                assert!(
                    object
                        .points
                        .iter()
                        .all(|point| point.coords.norm().is_finite())
                );
                assert!(
                    object
                        .normals
                        .iter()
                        .all(|normal| normal.norm().is_finite())
                );
                return true;
            }
            false
        },
    );
}

/// Images and clouds of all that was seen, with joint values, as a driver records them.
#[test]
fn recorded_scans() {
    every("recorded scans", &recorded(), |input| {
        let Ok(scans) = SessionReader::default().scans_of_bytes(input) else {
            return false;
        };
        let mut count = 0;
        for scan in scans.map_while(Result::ok) {
            let mut joints = scan.arms.iter().filter_map(|arm| arm.joints);
            assert!(joints.all(|joints| joints.iter().all(|value| value.is_finite())));
            count += 1;
        }
        count > 0
    });
}

/// Without compression: what is in chunks is decompressed by the same code for all readers.
fn recorded() -> Vec<u8> {
    let mut bytes = Vec::new();
    let options = mcap::WriteOptions::new().compression(None);
    let mut writer = options.create(std::io::Cursor::new(&mut bytes)).unwrap();
    let (image, info) = camera();
    let joints = JointState {
        position: vec![0.1; 6],
        ..JointState::default()
    };
    let little = Endian::Little;
    let topics = [
        (
            "/camera/camera/depth/image_rect_raw",
            Image::TYPE,
            cdr::encode(&image, little),
        ),
        (
            "/camera/camera/depth/camera_info",
            CameraInfo::TYPE,
            cdr::encode(&info, little),
        ),
        (
            "/PSM1/measured_js",
            JointState::TYPE,
            cdr::encode(&joints, little),
        ),
        (
            "/PSM1/jaw/setpoint_js",
            JointState::TYPE,
            cdr::encode(&joints, little),
        ),
    ];
    for (topic, kind, data) in topics {
        let schema = writer.add_schema(kind, "ros2msg", b"x").unwrap();
        let channel = writer.add_channel(schema, topic, "cdr", &BTreeMap::new());
        let header = mcap::records::MessageHeader {
            channel_id: channel.unwrap(),
            sequence: 0,
            log_time: 0,
            publish_time: 0,
        };
        writer
            .write_to_known_channel(&header, &data.unwrap())
            .unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    bytes
}

const CALIBRATION: &str = r#"format = "dvrk-io calibration"
version = 1
arm = "PSM1"
method = "sightings"
[units]
length = "m"
angle = "rad"
[camera_from_rcm]
target = "camera"
source = "PSM1_base"
translation = [0.1, 0, 0.4]
quaternion_xyzw = [0.0, 0.7071, 0.0, 0.7071]
[wrist_from_marker]
target = "wrist"
source = "marker"
translation = [0.0, 0.01, 0.0]
quaternion_xyzw = [0.0, 0.0, 0.0, 1.0]
[residuals]
samples = 12
outliers = [5]
rms = 4e-4
max = 7e-4
rms_angle = 0.01
max_angle = 0.02
"#;

#[test]
fn calibrations() {
    assert!(Calibration::from_toml(CALIBRATION.as_bytes()).is_ok());
    every("calibration", CALIBRATION.as_bytes(), |input| {
        let Ok(read) = Calibration::from_toml(input) else {
            return false;
        };
        let matrix = read.camera_from_rcm.to_homogeneous();
        assert!(matrix.iter().all(|value| value.is_finite()));
        true
    });
}

const METADATA: &str = "rosbag2_bagfile_information:
  version: 9
  storage_identifier: mcap
  duration:
    nanoseconds: 200000000
  relative_file_paths:
    - bag_0.mcap
    - \"bag_1.mcap\"
  compression_format: \"\"
  compression_mode: \"\"
";

/// Its files are not there: what it names is all that counts.
#[test]
fn metadata_of_rosbag2() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("metadata.yaml");
    every("metadata.yaml", METADATA.as_bytes(), |input| {
        std::fs::write(&path, input).unwrap();
        let error = SessionReader::default().frames(folder.path()).unwrap_err();
        // It got as far as to look for a file that is named.
        matches!(error, dvrk_io::Error::Io { path: looked, .. } if looked != path)
    });
}

#[test]
fn variables_of_the_network() {
    let names = [
        "ROS_DOMAIN_ID",
        "ROS_LOCALHOST_ONLY",
        "ROS_AUTOMATIC_DISCOVERY_RANGE",
    ];
    every("network", b"17\n1\nLOCALHOST", |input| {
        let text = String::from_utf8_lossy(input);
        let values: Vec<_> = text.split('\n').collect();
        let value = |name| {
            let index = names.iter().position(|other| *other == name)?;
            values.get(index).map(ToString::to_string)
        };
        Network::from_vars(value).is_ok()
    });
}
