//! What a writer wrote, a reader reads: whole, cut off, damaged, or out of order.
#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::float_cmp,
    reason = "tests; copied values must be the same bits"
)]

use dvrk_io::Error;
use dvrk_io::session::{Session, SessionReader, SessionWriter, read_truth, read_truth_from_bytes};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, UnitVector3, Vector3};
use proptest::prelude::*;

/// Rate of the sessions below, frames a second.
const RATE: f64 = 10.0;
const FRAMES: u32 = 12;

fn stamp(frame: u32) -> f64 {
    f64::from(frame) / RATE
}

fn points(frame: u32) -> Vec<Point3<f64>> {
    let coordinate = |index: u32| f64::from(frame + index) * 0.125;
    (0..20 + frame)
        .map(|index| Point3::new(coordinate(index), -coordinate(2 * index), 1.0))
        .collect()
}

fn pose(frame: u32) -> Isometry3<f64> {
    let axis = Vector3::new(0.1, -0.2, 0.3) * f64::from(frame);
    Isometry3::from_parts(
        Translation3::new(0.1, 0.2, stamp(frame)),
        UnitQuaternion::from_scaled_axis(axis),
    )
}

fn holds(frame: u32) -> bool {
    (3..8).contains(&frame)
}

fn table() -> (UnitVector3<f64>, f64) {
    (
        UnitVector3::new_normalize(Vector3::new(0.1, -0.2, -1.0)),
        0.9,
    )
}

fn record_frame(writer: &mut SessionWriter, frame: u32) {
    let time = stamp(frame);
    writer.points(time, &points(frame)).unwrap();
    for arm in ["PSM2", "PSM1"] {
        writer
            .jaw(time, arm, if holds(frame) { 0.0 } else { 0.8 })
            .unwrap();
        if holds(frame) {
            writer.pose(time, arm, &pose(frame)).unwrap();
        }
    }
    writer.truth(time, &points(0)).unwrap();
}

/// The bytes of a recorded session, and the length of the file after its first flush.
fn recorded() -> (Vec<u8>, usize) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("session.mcap");
    let mut writer = SessionWriter::create(&path).unwrap();
    writer.table(0.0, &table().0, table().1).unwrap();
    record_frame(&mut writer, 0);
    writer.flush().unwrap();
    let flushed = std::fs::metadata(&path).unwrap().len();
    (1..FRAMES).for_each(|frame| record_frame(&mut writer, frame));
    writer.finish().unwrap();
    (
        std::fs::read(&path).unwrap(),
        usize::try_from(flushed).unwrap(),
    )
}

fn read(bytes: &[u8]) -> Session {
    SessionReader::default().read_bytes(bytes).unwrap()
}

fn same_frames(session: &Session, count: u32) {
    assert_eq!(session.frames.len(), count as usize);
    for (index, frame) in (0..count).zip(&session.frames) {
        assert_eq!(frame.stamp, stamp(index));
        assert_eq!(frame.points, points(index));
        assert_eq!(frame.arms.len(), session.arm_names.len());
    }
}

#[test]
fn what_is_written_is_read() {
    let session = read(&recorded().0);
    assert!(session.complete);
    same_frames(&session, FRAMES);
    assert_eq!(session.arm_names, ["PSM1", "PSM2"]);
    assert_eq!(session.camera_frame, "camera");
    let (normal, offset) = session.table.unwrap();
    assert!(
        (normal.into_inner() - table().0.into_inner()).norm() < 1e-15
            && (offset - 0.9).abs() < 1e-15
    );
    for (index, frame) in (0..).zip(&session.frames) {
        for arm in &frame.arms {
            assert_eq!(arm.jaw, Some(if holds(index) { 0.0 } else { 0.8 }));
            match arm.pose {
                Some(read) => assert!(
                    holds(index) && (read.to_matrix() - pose(index).to_matrix()).norm() < 1e-14
                ),
                None => assert!(!holds(index)),
            }
        }
    }
    let counts: Vec<_> = session
        .topics
        .iter()
        .map(|topic| (topic.topic.as_str(), topic.count))
        .collect();
    let expected = [
        ("/PSM1/jaw/measured_js", 12),
        ("/PSM1/measured_cp", 5),
        ("/PSM2/jaw/measured_js", 12),
        ("/PSM2/measured_cp", 5),
        ("/cell/points", 12),
        ("/cell/table", 1),
        ("/truth/points", 12),
    ];
    assert_eq!(counts, expected);
}

#[test]
fn truth_is_a_call_of_its_own() {
    let truth = read_truth_from_bytes(&recorded().0).unwrap();
    assert_eq!(truth.len(), FRAMES as usize);
    assert!(truth.iter().all(|frame| frame.points == points(0)));
    assert_eq!(truth[3].stamp, stamp(3));
}

#[test]
fn readable_wherever_it_is_cut() {
    let (bytes, flushed) = recorded();
    let mut before = 1;
    for length in flushed..bytes.len() {
        let session = read(&bytes[..length]);
        let count = u32::try_from(session.frames.len()).unwrap();
        assert!(count >= before, "frames were lost at {length}");
        same_frames(&session, count);
        if count > before {
            // The cloud is the first message of its chunk: it is found before the truth behind it is whole.
            let truth = read_truth_from_bytes(&bytes[..length]).unwrap();
            assert_eq!(truth.len() + 1, count as usize);
        }
        before = count;
    }
    assert_eq!(before, FRAMES);
    // Even before the first flush there is either nothing or a valid beginning, never a panic.
    for length in 0..flushed {
        match SessionReader::default().read_bytes(&bytes[..length]) {
            Ok(session) => assert!(session.frames.len() <= 1 && !session.complete),
            Err(error) => assert!(
                matches!(error, Error::NotMcap { .. }) && length < 8,
                "{length}: {error}"
            ),
        }
    }
}

#[test]
fn a_killed_recorder_loses_at_most_the_frame_at_hand() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("session.mcap");
    let mut writer = SessionWriter::create(&path).unwrap();
    (0..FRAMES).for_each(|frame| record_frame(&mut writer, frame));
    // A killed process runs no destructors.
    std::mem::forget(writer);
    let session = SessionReader::open(&path).unwrap();
    assert!(!session.complete);
    same_frames(&session, FRAMES - 1);
    assert_eq!(read_truth(&path).unwrap().len(), FRAMES as usize - 1);
}

#[test]
fn arms_alone_are_flushed_every_second() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("arms.mcap");
    let mut writer = SessionWriter::create(&path).unwrap();
    (0..=20).for_each(|frame| writer.jaw(stamp(frame), "PSM1", 0.1).unwrap());
    std::mem::forget(writer);
    let session = SessionReader::open(&path).unwrap();
    // Flushed with the sample at 1.0 s, and again with the one at 2.1 s, which is not there.
    assert_eq!(session.topics[0].count, 11);
}

#[test]
fn a_dropped_writer_closes_its_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("session.mcap");
    let mut writer = SessionWriter::create(&path).unwrap();
    record_frame(&mut writer, 0);
    drop(writer);
    assert!(SessionReader::open(&path).unwrap().complete);
}

#[test]
fn frames_come_in_the_order_of_time_with_the_closest_pose() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("session.mcap");
    let mut writer = SessionWriter::create(&path).unwrap();
    for frame in [2, 0, 1] {
        writer.points(stamp(frame), &points(frame)).unwrap();
    }
    // Poses at 100 Hz with an offset, which stop at 0.15 s.
    for index in 0..15 {
        let time = f64::from(index) * 0.01 + 0.003;
        writer
            .pose(
                time,
                "PSM1",
                &Isometry3::translation(f64::from(index), 0.0, 0.0),
            )
            .unwrap();
    }
    writer.finish().unwrap();
    let session = SessionReader::open(&path).unwrap();
    same_frames(&session, 3);
    let poses = |session: &Session| -> Vec<Option<f64>> {
        session
            .frames
            .iter()
            .map(|frame| frame.arms[0].pose.map(|pose| pose.translation.x))
            .collect()
    };
    assert_eq!(poses(&session), [Some(0.0), Some(10.0), None]);
    // 0.2 s is 57 ms after the last pose, at 0.143 s.
    let lenient = SessionReader::default()
        .with_tolerance(0.06)
        .read(&path)
        .unwrap();
    assert_eq!(poses(&lenient), [Some(0.0), Some(10.0), Some(14.0)]);
    let strict = SessionReader::default()
        .with_tolerance(0.0)
        .read(&path)
        .unwrap();
    assert_eq!(poses(&strict), [None; 3]);
    assert!(
        SessionReader::default()
            .with_tolerance(f64::NAN)
            .read(&path)
            .is_err()
    );
}

#[test]
fn the_writer_refuses_what_cannot_be_read_back() {
    let folder = tempfile::tempdir().unwrap();
    let mut writer = SessionWriter::create(folder.path().join("session.mcap")).unwrap();
    let nan = Point3::new(0.0, f64::NAN, 0.0);
    assert!(matches!(
        writer.points(0.0, &[Point3::origin(), nan]),
        Err(Error::NonFinitePoint { index: 1, .. })
    ));
    assert!(matches!(
        writer.truth(0.0, &[Point3::new(1e300, 0.0, 0.0)]),
        Err(Error::NonFinitePoint { index: 0, .. })
    ));
    assert!(writer.points(f64::NAN, &[]).is_err() && writer.points(-1.0, &[]).is_err());
    assert!(writer.table(0.0, &Vector3::z_axis(), f64::NAN).is_err());
    assert!(writer.jaw(0.0, "PSM1", f64::INFINITY).is_err());
    assert!(
        writer
            .pose(0.0, "PSM1", &Isometry3::translation(f64::NAN, 0.0, 0.0))
            .is_err()
    );
    for name in ["", "PSM 1", "PSM1/jaw", "1PSM", "ECM", "MTML", "é"] {
        assert!(
            matches!(writer.jaw(0.0, name, 0.0), Err(Error::BadArmName { .. })),
            "{name}"
        );
    }
    assert!(matches!(
        SessionWriter::create(folder.path()),
        Err(Error::Io { .. })
    ));
    assert!(matches!(
        SessionReader::open(folder.path().join("none")),
        Err(Error::Io { .. })
    ));
    assert!(matches!(
        SessionReader::default().read_bytes(b"ply\nformat"),
        Err(Error::NotMcap { .. })
    ));
}

#[test]
fn a_flipped_bit_costs_its_chunk_and_is_reported() {
    let (bytes, _) = recorded();
    let mut damaged = bytes.clone();
    // In the middle of a truth, which nothing but the checksum protects.
    damaged[bytes.len() / 4] ^= 0x10;
    let session = read(&damaged);
    assert!(session.complete);
    assert_eq!(session.frames.len(), FRAMES as usize - 1);
    assert_eq!(session.skipped.places, 1);
    let skip = &session.skipped.first[0];
    assert!(
        skip.reason.contains("checksum") && skip.messages >= 4,
        "{skip}"
    );
    assert_eq!(session.skipped.messages, skip.messages);
    assert_eq!(bytes[usize::try_from(skip.byte).unwrap()], 0x06);
    // What is left is the same.
    let whole = read(&bytes);
    let left = |frame: &&dvrk_io::session::Frame| session.frames.contains(frame);
    assert_eq!(
        whole.frames.iter().filter(left).count(),
        FRAMES as usize - 1
    );
    assert_eq!(
        read_truth_from_bytes(&damaged).unwrap().len(),
        FRAMES as usize - 1
    );
}

proptest! {
    #[test]
    fn damaged_files_do_not_panic(place: prop::sample::Index, value: u8, width in 1_usize..9) {
        static SESSION: std::sync::LazyLock<Vec<u8>> = std::sync::LazyLock::new(|| recorded().0);
        let mut bytes = SESSION.clone();
        let start = place.index(bytes.len());
        let end = bytes.len().min(start + width);
        bytes[start..end].fill(value);
        let _ = SessionReader::default().read_bytes(&bytes);
        let _ = read_truth_from_bytes(&bytes);
    }

    #[test]
    fn random_records_do_not_panic(records in prop::collection::vec((0_u8..16, any::<Vec<u8>>()), 0..8)) {
        let mut bytes = b"\x89MCAP0\r\n".to_vec();
        for (opcode, body) in records {
            bytes.push(opcode);
            bytes.extend((body.len() as u64).to_le_bytes());
            bytes.extend(body);
        }
        let _ = SessionReader::default().read_bytes(&bytes);
    }
}

/// Known: three frames written by rosbags 0.11.9, as a dVRK with a RealSense would look: an organised cloud of four
/// points with colour, of which one has no depth (zeros) and one is NaN; an endoscope beside the arm; a pose that the
/// arm could not measure (stamp 0, quaternion 0) in the last frame.
#[test]
fn a_file_that_rosbags_wrote() {
    let bytes = include_bytes!("data/rosbags.mcap");
    let session = read(bytes);
    assert!(session.complete);
    assert_eq!(session.arm_names, ["PSM1"]);
    assert_eq!(session.table, Some((-Vector3::z_axis(), 0.5)));
    assert_eq!(session.topics.len(), 6);
    assert_eq!(session.frames.len(), 3);
    for (index, frame) in (0..3).zip(&session.frames) {
        let k = f64::from(index);
        assert!((frame.stamp - (1.7e9 + 0.1 * k)).abs() < 3e-7);
        let single = |value: f64| f64::from(value as f32);
        let first = Point3::new(single(0.1), single(0.2), 0.5 + k);
        assert_eq!(frame.points, [first, Point3::new(single(-0.1), 0.25, 0.75)]);
        assert_eq!(frame.arms[0].jaw, Some(0.8 - 0.4 * k));
    }
    let poses: Vec<_> = session
        .frames
        .iter()
        .map(|frame| frame.arms[0].pose)
        .collect();
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 2.0 * 0.6_f64.asin());
    let expected = Isometry3::from_parts(Translation3::new(0.01, 0.02, 0.5), turn);
    assert!(poses[0].is_none() && poses[2].is_none());
    assert!((poses[1].unwrap().to_matrix() - expected.to_matrix()).norm() < 1e-15);
    let truth = read_truth_from_bytes(bytes).unwrap();
    assert_eq!(truth.len(), 3);
    assert_eq!(
        truth[1].points,
        [Point3::new(1.0, 2.0, 3.0), Point3::new(4.0, 5.0, 6.0)]
    );
}

/// A camera that moves: clouds in its own frame, arms and truth in the fixed one; one cloud has no pose of the camera near it.
#[test]
fn a_camera_that_moves_has_its_pose_in_every_frame() {
    const LACKS: u32 = 5;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("session.mcap");
    let mut writer = SessionWriter::create(&path).unwrap();
    writer.table(0.0, &table().0, table().1).unwrap();
    for frame in 0..FRAMES {
        if frame != LACKS {
            writer.camera(stamp(frame), &pose(frame)).unwrap();
        }
        record_frame(&mut writer, frame);
    }
    writer.finish().unwrap();
    let session = read(&std::fs::read(&path).unwrap());
    let found: Vec<f64> = session.frames.iter().map(|frame| frame.stamp).collect();
    let expected: Vec<f64> = (0..FRAMES).filter(|f| *f != LACKS).map(stamp).collect();
    assert_eq!(found, expected);
    for frame in &session.frames {
        let number = (0..FRAMES).find(|f| stamp(*f) == frame.stamp).unwrap();
        let near = |found: Option<Isometry3<f64>>| {
            let found = found.unwrap().to_matrix();
            (found - pose(number).to_matrix()).norm() < 1e-12
        };
        assert!(near(frame.camera), "{number}");
        assert_eq!(frame.points.len(), points(number).len());
        let arm = frame.arms[0].pose;
        assert!(if holds(number) {
            near(arm)
        } else {
            arm.is_none()
        });
    }
    let skipped: Vec<String> = session
        .skipped
        .first
        .iter()
        .map(ToString::to_string)
        .collect();
    assert_eq!(skipped.len(), 1, "{skipped:?}");
    assert!(
        skipped[0].contains("no pose of the camera within"),
        "{skipped:?}"
    );
    assert!(skipped[0].contains("0.500 s"), "{skipped:?}");
    let scans = SessionReader::default().scans(&path);
    assert!(matches!(scans, Err(Error::ScansOfMovingCamera)));
    // Poses of arms that were written before the camera was said to move are in another frame.
    let mut writer = SessionWriter::create(&path).unwrap();
    writer.pose(0.0, "PSM1", &pose(1)).unwrap();
    writer.camera(0.0, &pose(0)).unwrap();
    writer.points(0.0, &points(0)).unwrap();
    writer.finish().unwrap();
    let refused = SessionReader::default().read_bytes(&std::fs::read(&path).unwrap());
    assert!(
        matches!(refused, Err(Error::FrameMismatch { .. })),
        "{refused:?}"
    );
}

/// Without poses of the camera it stands still.
#[test]
fn a_camera_that_stands_still_has_no_pose() {
    let (bytes, _) = recorded();
    assert!(
        read(&bytes)
            .frames
            .iter()
            .all(|frame| frame.camera.is_none())
    );
}

#[test]
fn poses_in_another_frame_are_refused() {
    let mut bytes = include_bytes!("data/rosbags.mcap").to_vec();
    // The frame of the one valid pose: rename it in place, and drop the checksum of its chunk with it.
    let pose = bytes
        .windows(6)
        .enumerate()
        .filter(|(_, window)| window == b"camera")
        .map(|(at, _)| at)
        .collect::<Vec<_>>();
    let chunk_checksum = 8 + 9 + record_length(&bytes, 8) + 9 + 24;
    bytes[chunk_checksum..chunk_checksum + 4].fill(0);
    let refused = pose.iter().any(|&at| {
        let mut renamed = bytes.clone();
        renamed[at..at + 6].copy_from_slice(b"PSM1_b");
        matches!(
            SessionReader::default().read_bytes(&renamed),
            Err(Error::FrameMismatch { .. })
        )
    });
    assert!(refused);
}

fn record_length(bytes: &[u8], record: usize) -> usize {
    usize::try_from(u64::from_le_bytes(
        bytes[record + 1..record + 9].try_into().unwrap(),
    ))
    .unwrap()
}
