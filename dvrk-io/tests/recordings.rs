//! Recordings as others make them: compressed, in directories, under other topics, with bad messages in them.
#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::float_cmp,
    reason = "tests; copied values must be the same bits"
)]

use std::path::Path;

use dvrk_io::Error;
use dvrk_io::cdr::{self, PointCloud2};
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
