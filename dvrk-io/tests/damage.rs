//! Files that hold what no recorder should have written: what can be read is, and the rest is reported with its place.
#![allow(missing_docs, clippy::unwrap_used, reason = "tests")]

use dvrk_io::cdr::{self, Endian, Header, PointCloud2, Pose, PoseStamped, Time};
use dvrk_io::session::SessionReader;
use nalgebra::Point3;

fn points() -> Vec<Point3<f64>> {
    (0..50)
        .map(|i| Point3::new(f64::from(i), 0.25, 0.5))
        .collect()
}

/// A file of single messages, without chunks.
fn file(messages: &[(&str, &str, Vec<u8>)]) -> (Vec<u8>, Vec<u64>) {
    let mut bytes = b"\x89MCAP0\r\n".to_vec();
    let mut starts = Vec::new();
    let record = |bytes: &mut Vec<u8>, opcode: u8, body: &[u8]| {
        bytes.push(opcode);
        bytes.extend((body.len() as u64).to_le_bytes());
        bytes.extend(body);
    };
    let text = |text: &str| {
        [
            (text.len() as u32).to_le_bytes().as_slice(),
            text.as_bytes(),
        ]
        .concat()
    };
    for (id, (topic, kind, data)) in (1_u16..).zip(messages) {
        let id = id.to_le_bytes();
        record(
            &mut bytes,
            3,
            &[id.to_vec(), text(kind), text("ros2msg"), text("")].concat(),
        );
        record(
            &mut bytes,
            4,
            &[id.to_vec(), id.to_vec(), text(topic), text("cdr"), text("")].concat(),
        );
        starts.push(bytes.len() as u64);
        record(
            &mut bytes,
            5,
            &[id.to_vec(), vec![0; 20], data.clone()].concat(),
        );
    }
    (bytes, starts)
}

fn header(stamp: f64) -> Header {
    Header {
        stamp: Time::from_seconds(stamp).unwrap(),
        frame_id: "camera".into(),
    }
}

#[test]
fn bad_messages_are_reported_with_their_place() {
    let cloud = |stamp| PointCloud2::from_points(header(stamp), &points()).unwrap();
    let encode = |cloud: &PointCloud2| cdr::encode(cloud, Endian::Little).unwrap();
    let mut nothing = cloud(0.2);
    nothing.fields.clear();
    let pose = PoseStamped {
        header: header(0.1),
        pose: Pose {
            position: [0.0; 3],
            orientation: [0.0; 4],
        },
    };
    let (points, poses) = (
        "sensor_msgs/msg/PointCloud2",
        "geometry_msgs/msg/PoseStamped",
    );
    let (mut bytes, starts) = file(&[
        ("/cell/points", points, encode(&cloud(0.1))),
        ("/cell/points", points, encode(&nothing)),
        (
            "/PSM1/measured_cp",
            poses,
            cdr::encode(&pose, Endian::Little).unwrap(),
        ),
        ("/cell/points", points, encode(&cloud(0.3))),
        ("/cell/points", points, vec![0, 1, 0]),
        ("/cell/table", "shape_msgs/msg/Plane", vec![0; 36]),
        ("/truth/points", points, vec![9; 36]),
    ]);
    // A message of a channel that nobody declared, a message without room for its own header, a topic without a name.
    let undeclared = bytes.len() as u64;
    bytes.extend([vec![5, 22, 0, 0, 0, 0, 0, 0, 0, 99], vec![0; 21]].concat());
    let headless = bytes.len() as u64;
    bytes.extend([5, 3, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0]);
    bytes.extend([4, 1, 0, 0, 0, 0, 0, 0, 0, 7]);
    let session = SessionReader::default().read_bytes(&bytes).unwrap();
    assert_eq!(session.frames.len(), 2);
    assert_eq!(session.table, None);
    let found: Vec<_> = session
        .skipped
        .first
        .iter()
        .map(|skip| (skip.byte, skip.topic.as_str(), skip.messages))
        .collect();
    let data = |index: usize| starts[index];
    let expected = [
        (data(2), "/PSM1/measured_cp", 1),
        (data(4), "/cell/points", 1),
        (data(5), "/cell/table", 1),
        (undeclared, "", 1),
        (headless, "", 1),
        (headless + 12, "", 0),
        // Clouds are decoded when their turn comes.
        (data(1), "/cell/points", 1),
    ];
    assert_eq!(found, expected, "{:#?}", session.skipped);
    assert_eq!((session.skipped.places, session.skipped.messages), (7, 6));
    let reasons: Vec<_> = session
        .skipped
        .first
        .iter()
        .map(ToString::to_string)
        .collect();
    for (reason, word) in reasons.iter().zip([
        "pose.orientation",
        "encapsulation",
        "plane",
        "channel 99",
        "0x05",
        "0x04",
        "field x",
    ]) {
        assert!(
            reason.contains(word) && reason.starts_with("byte "),
            "{reason}"
        );
    }
}

#[test]
fn a_flood_of_bad_messages_is_counted_not_listed() {
    let bad: Vec<_> = (0..5000)
        .map(|_| ("/cell/points", "sensor_msgs/msg/PointCloud2", vec![]))
        .collect();
    let session = SessionReader::default().read_bytes(&file(&bad).0).unwrap();
    assert_eq!(
        (session.skipped.messages, session.skipped.first.len()),
        (5000, 100)
    );
}

#[test]
fn bombs_do_not_fill_the_memory() {
    // A chunk that says it holds little and decompresses to much, and one that says it holds more than is allowed.
    let zeros = vec![0; 64 << 20];
    let packed = ruzstd::encoding::compress_to_vec(
        zeros.as_slice(),
        ruzstd::encoding::CompressionLevel::Fastest,
    );
    assert!(packed.len() < 1 << 20);
    for (size, word) in [
        (10_u64, "at least 11"),
        (1 << 40, "MiB"),
        (100 << 20, "decompresses to"),
    ] {
        let mut body = vec![0; 16];
        body.extend(size.to_le_bytes());
        body.extend(0_u32.to_le_bytes());
        body.extend(4_u32.to_le_bytes());
        body.extend(b"zstd");
        body.extend((packed.len() as u64).to_le_bytes());
        body.extend(&packed);
        let mut bytes = b"\x89MCAP0\r\n\x06".to_vec();
        bytes.extend((body.len() as u64).to_le_bytes());
        bytes.extend(body);
        let session = SessionReader::default().read_bytes(&bytes).unwrap();
        assert!(
            session.skipped.first[0].reason.contains(word),
            "{:?}",
            session.skipped
        );
    }
}
