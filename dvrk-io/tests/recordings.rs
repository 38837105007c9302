//! Recordings as others make them: compressed, in directories, under other topics, with bad messages in them.
#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::float_cmp,
    reason = "tests; copied values must be the same bits"
)]

use std::path::Path;

use dvrk_io::Error;
use dvrk_io::cdr::{self, Endian, Header, PointCloud2, Pose, PoseStamped, Time};
use dvrk_io::session::{
    Compression, Frame, Role, Session, SessionReader, SessionWriter, WriterOptions, read_truth,
};
use nalgebra::{Isometry3, Point3, Vector3};

const FRAMES: u32 = 12;

/// Points that neither compress to nothing nor not at all.
fn points(frame: u32) -> Vec<Point3<f64>> {
    let value = |i: u32| f64::from((i * 2_654_435_761_u32.wrapping_mul(frame + 1)) >> 20) / 4096.0;
    (0..3000 + frame)
        .map(|i| Point3::new(value(i), -value(i + 1), 0.5))
        .collect()
}

fn record(path: &Path, frames: std::ops::Range<u32>, compression: Compression) {
    let options = WriterOptions::default().with_compression(compression);
    let mut writer = SessionWriter::create_with(path, options).unwrap();
    writer.table(0.0, &-Vector3::z_axis(), 0.6).unwrap();
    for frame in frames {
        let stamp = f64::from(frame) / 10.0;
        writer.points(stamp, &points(frame)).unwrap();
        writer
            .pose(
                stamp,
                "PSM1",
                &Isometry3::translation(f64::from(frame), 0.0, 0.5),
            )
            .unwrap();
        writer.jaw(stamp, "PSM1", 0.1).unwrap();
        writer.truth(stamp, &points(0)).unwrap();
    }
    writer.finish().unwrap();
}

fn check_frames(frames: &[Frame], first: u32) {
    for (index, frame) in (first..).zip(frames) {
        assert_eq!(frame.stamp, f64::from(index) / 10.0);
        assert!(frame.points == points(index));
        assert_eq!(
            frame.arms[0].pose,
            Some(Isometry3::translation(f64::from(index), 0.0, 0.5))
        );
    }
}

#[test]
fn every_compression_gives_the_same_session() {
    let folder = tempfile::tempdir().unwrap();
    let mut sessions: Vec<(Session, u64)> = Vec::new();
    for compression in Compression::ALL {
        let path = folder.path().join("session.mcap");
        record(&path, 0..FRAMES, compression);
        let session = SessionReader::open(&path).unwrap();
        assert!(session.complete && session.skipped.is_empty());
        check_frames(&session.frames, 0);
        assert_eq!(session.frames.len(), FRAMES as usize);
        assert_eq!(read_truth(&path).unwrap().len(), FRAMES as usize);
        sessions.push((session, std::fs::metadata(&path).unwrap().len()));
    }
    let [(none, plain), (lz4, small), (zstd, smaller)] = &sessions[..] else {
        panic!("{} sessions", sessions.len());
    };
    assert!(none == lz4 && none == zstd);
    assert!(
        small * 10 < plain * 9 && smaller < small,
        "{plain} {small} {smaller}"
    );
}

/// The reader of the `mcap` crate checks the checksums of chunks and finds its way by the summary.
#[test]
fn the_mcap_crate_reads_what_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("session.mcap");
    record(&path, 0..FRAMES, Compression::None);
    let bytes = std::fs::read(&path).unwrap();
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    let statistics = summary.stats.unwrap();
    let expected = u64::from(4 * FRAMES + 1);
    assert_eq!(
        (statistics.message_count, statistics.channel_count),
        (expected, 5)
    );
    assert_eq!(statistics.chunk_count as usize, summary.chunk_indexes.len());
    let messages: Vec<_> = mcap::MessageStream::new(&bytes)
        .unwrap()
        .map(Result::unwrap)
        .collect();
    assert_eq!(messages.len() as u64, expected);
    let mut clouds = 0;
    for message in messages
        .iter()
        .filter(|message| message.channel.topic == "/cell/points")
    {
        let cloud: PointCloud2 = cdr::decode(&message.data).unwrap();
        assert!(cloud.points().unwrap() == points(clouds));
        assert_eq!(
            message.channel.schema.as_ref().unwrap().name,
            "sensor_msgs/msg/PointCloud2"
        );
        assert_eq!(
            (message.sequence, message.log_time),
            (clouds, u64::from(clouds) * 100_000_000)
        );
        clouds += 1;
    }
    assert_eq!(clouds, FRAMES);
}

#[test]
fn a_compressed_file_is_read_wherever_it_is_cut() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("session.mcap");
    for compression in [Compression::Lz4, Compression::Zstd] {
        record(&path, 0..4, compression);
        let bytes = std::fs::read(&path).unwrap();
        let mut before = 0;
        for length in (8..bytes.len()).step_by(101) {
            let session = SessionReader::default()
                .read_bytes(&bytes[..length])
                .unwrap();
            assert!(
                !session.complete && session.skipped.is_empty(),
                "{length}: {:?}",
                session.skipped
            );
            assert!(session.frames.len() >= before);
            before = session.frames.len();
            check_frames(&session.frames, 0);
        }
        assert_eq!(before, 4);
    }
}

#[test]
fn a_cut_chunk_gives_its_whole_messages() {
    // One chunk for the whole file, as a writer without limit makes it.
    let folder = tempfile::tempdir().unwrap();
    for (name, compression) in [
        ("zstd", Compression::Zstd),
        ("lz4", Compression::Lz4),
        ("", Compression::None),
    ] {
        let path = folder.path().join("session.mcap");
        record(&path, 0..FRAMES, Compression::None);
        let chunk = single_chunk(
            &std::fs::read(&path).unwrap(),
            name,
            |content| match compression {
                Compression::Lz4 => {
                    use std::io::Write as _;
                    let mut encoder = lz4_flex::frame::FrameEncoder::new(Vec::new());
                    for block in content.chunks(1 << 16) {
                        encoder.write_all(block).unwrap();
                    }
                    encoder.finish().unwrap()
                }
                Compression::Zstd => ruzstd::encoding::compress_to_vec(
                    content,
                    ruzstd::encoding::CompressionLevel::Fastest,
                ),
                _ => content.to_vec(),
            },
        );
        let whole = SessionReader::default().read_bytes(&chunk).unwrap();
        assert_eq!(whole.frames.len(), FRAMES as usize);
        check_frames(&whole.frames, 0);
        let cut = SessionReader::default()
            .read_bytes(&chunk[..chunk.len() * 3 / 4])
            .unwrap();
        check_frames(&cut.frames, 0);
        // Twelve frames; blocks are of at most 128 KiB, less than two frames.
        assert!(
            (6..=9).contains(&cut.frames.len()),
            "{compression:?}: {}",
            cut.frames.len()
        );
        assert!(!cut.complete && cut.skipped.is_empty(), "{:?}", cut.skipped);
    }
}

/// The records of all chunks of an uncompressed file in one chunk, and nothing behind it.
fn single_chunk(file: &[u8], name: &str, compress: impl Fn(&[u8]) -> Vec<u8>) -> Vec<u8> {
    let (mut at, mut content) = (8, Vec::new());
    while at + 9 < file.len() {
        let length = u64_at(file, at + 1);
        if file[at] == 0x06 {
            content.extend(&file[at + 9 + 40..at + 9 + length]);
        }
        at += 9 + length;
    }
    let mut body = vec![0; 16];
    body.extend((content.len() as u64).to_le_bytes());
    body.extend(0_u32.to_le_bytes());
    body.extend((name.len() as u32).to_le_bytes());
    body.extend(name.as_bytes());
    let packed = compress(&content);
    body.extend((packed.len() as u64).to_le_bytes());
    body.extend(packed);
    let mut bytes = file[..8].to_vec();
    bytes.push(0x06);
    bytes.extend((body.len() as u64).to_le_bytes());
    bytes.extend(body);
    bytes
}

fn u64_at(bytes: &[u8], at: usize) -> usize {
    usize::try_from(u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap())).unwrap()
}

#[test]
fn a_directory_is_one_session() {
    let folder = tempfile::tempdir().unwrap();
    let bag = folder.path().join("bag");
    std::fs::create_dir(&bag).unwrap();
    assert!(matches!(
        SessionReader::open(&bag),
        Err(Error::BadBag { .. })
    ));
    // Out of order on purpose: frames come in the order of time.
    record(&bag.join("bag_0.mcap"), 6..9, Compression::Zstd);
    record(&bag.join("bag_1.mcap"), 0..6, Compression::None);
    record(&bag.join("bag_2.mcap"), 9..12, Compression::Lz4);
    let metadata = |files: &str, storage: &str, mode: &str| {
        let text = format!(
            "rosbag2_bagfile_information:\n  version: 9\n  storage_identifier: {storage}\n  compression_mode: '{mode}'\n  \
             relative_file_paths:\n{files}  duration:\n    nanoseconds: 1\n"
        );
        std::fs::write(bag.join("metadata.yaml"), text).unwrap();
    };
    // A killed recorder leaves no list.
    let check = || {
        let session = SessionReader::open(&bag).unwrap();
        assert!(session.complete && session.skipped.is_empty());
        assert_eq!(session.frames.len(), FRAMES as usize);
        check_frames(&session.frames, 0);
        assert_eq!(read_truth(&bag).unwrap().len(), FRAMES as usize);
        let truth = session
            .topics
            .iter()
            .find(|topic| topic.topic == "/truth/points");
        assert_eq!(truth.unwrap().count, FRAMES as usize);
    };
    check();
    metadata(
        "  - bag_0.mcap\n  - \"bag_1.mcap\"\n  - bag/bag_2.mcap\n",
        "mcap",
        "",
    );
    check();
    metadata("  - bag_1.mcap\n", "mcap", "NONE");
    assert_eq!(SessionReader::open(&bag).unwrap().frames.len(), 6);
    let refused = |word: &str| match SessionReader::open(&bag) {
        Err(error) => assert!(error.to_string().contains(word), "{error}"),
        Ok(_) => panic!("not refused: {word}"),
    };
    metadata("  - bag_1.mcap\n", "sqlite3", "");
    refused("sqlite3");
    metadata("  - bag_1.mcap.zstd\n", "mcap", "file");
    refused("compression mode `file`");
    metadata("", "mcap", "");
    refused("relative_file_paths");
    metadata("  - bag_7.mcap\n", "mcap", "");
    refused("bag_7.mcap");
}

#[test]
fn other_topics() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("session.mcap");
    record(&path, 0..3, Compression::None);
    let with = |role, topic: &str| SessionReader::default().with_topic(role, topic);
    // The truth taken for the cloud, and the arm under another name.
    let session = with(Role::Points, "/truth/points").read(&path).unwrap();
    assert!(session.frames.iter().all(|frame| frame.points == points(0)));
    let session = with(Role::Pose("LEFT".into()), "/PSM1/measured_cp")
        .read(&path)
        .unwrap();
    assert_eq!(session.arm_names, ["LEFT", "PSM1"]);
    assert!(session.frames[1].arms[0].pose.is_some() && session.frames[1].arms[1].pose.is_none());
    match with(Role::Points, "/camera/points").read(&path) {
        Err(Error::NoSuchTopic { topic, available }) => {
            assert!(
                topic == "/camera/points" && available.contains("/cell/points, /cell/table"),
                "{available}"
            );
        }
        other => panic!("{other:?}"),
    }
    let wrong = with(Role::Points, "/cell/table").read(&path);
    assert!(matches!(wrong, Err(Error::WrongType { .. })), "{wrong:?}");
    // Only who reads the truth needs its topic.
    let reader = with(Role::Truth, "/nowhere");
    assert!(reader.read(&path).is_ok() && reader.read_truth(&path).is_err());
    let taken = with(Role::Truth, "/cell/points").read_truth(&path).unwrap();
    assert!(taken.frames[2].points == points(2));
    for role in [
        "points",
        "table",
        "truth",
        "PSM1/measured_cp",
        "arm_2/jaw/measured_js",
    ] {
        assert_eq!(role.parse::<Role>().unwrap().to_string(), role);
    }
    for bad in [
        "",
        "cloud",
        "PSM1",
        "PSM1/jaw",
        "/PSM1/measured_cp",
        "ECM/measured_cp",
        "PSM 1/measured_cp",
    ] {
        assert!(
            matches!(bad.parse::<Role>(), Err(Error::BadRole { .. })),
            "{bad}"
        );
    }
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
    let cloud = |stamp| PointCloud2::from_points(header(stamp), &points(0)).unwrap();
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
fn a_damaged_first_chunk_does_not_hide_the_topics() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("session.mcap");
    for compression in Compression::ALL {
        record(&path, 0..5, compression);
        let mut bytes = std::fs::read(&path).unwrap();
        // Somewhere in the second chunk, the first with a cloud; all topics are declared in it and in the summary.
        let at = bytes.iter().position(|&byte| byte == 0x06).unwrap() + 2000;
        bytes[at] ^= 0x40;
        let session = SessionReader::default().read_bytes(&bytes).unwrap();
        assert_eq!(
            session.skipped.places, 1,
            "{compression:?} {:?}",
            session.skipped
        );
        assert_eq!(session.frames.len(), 4, "{compression:?}");
        check_frames(&session.frames, 1);
    }
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

#[test]
fn frames_come_one_by_one() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("session.mcap");
    record(&path, 0..FRAMES, Compression::Zstd);
    let mut frames = SessionReader::default().frames(&path).unwrap();
    assert_eq!(frames.arm_names(), ["PSM1"]);
    assert_eq!(frames.table().unwrap().1, 0.6);
    assert_eq!(frames.stamps().len(), FRAMES as usize);
    let first: Vec<_> = frames.by_ref().take(5).map(Result::unwrap).collect();
    check_frames(&first, 0);
    assert_eq!(frames.stamps().next(), Some(0.5));
    // The file goes away under the reader: an error, and then the end.
    std::fs::write(&path, []).unwrap();
    let rest: Vec<_> = frames.by_ref().collect();
    assert!(rest.len() <= FRAMES as usize - 5);
    assert!(frames.next().is_none() && frames.stamps().next().is_none());
}
