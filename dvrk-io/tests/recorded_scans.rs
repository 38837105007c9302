//! Recordings of what a camera sent as it is, written by the `mcap` crate: each scan is that of its message, with the arms next to it in time.
#![allow(missing_docs, clippy::unwrap_used, reason = "tests")]

use std::collections::BTreeMap;
use std::io::Cursor;

use dvrk_io::Error;
use dvrk_io::cdr::{
    self, CameraInfo, Endian, Header, Image, JointState, Message, PointCloud2, PoseStamped, Time,
};
use dvrk_io::depth::Scan;
use dvrk_io::session::{RecordedScan, Role, SessionReader};
use nalgebra::{Isometry3, Point3};

const IMAGE: &str = "/camera/camera/depth/image_rect_raw";
const INFO: &str = "/camera/camera/depth/camera_info";
const CLOUD: &str = "/camera/camera/depth/color/points";

struct Recorder {
    writer: mcap::Writer<Cursor<Vec<u8>>>,
}

impl Recorder {
    fn new() -> Self {
        let options = mcap::WriteOptions::new().compression(None);
        let writer = options.create(Cursor::new(Vec::new())).unwrap();
        Self { writer }
    }

    fn bytes(&mut self, topic: &str, kind: &str, time: f64, data: &[u8]) {
        let schema = self.writer.add_schema(kind, "ros2msg", b"x").unwrap();
        let nothing = BTreeMap::new();
        let channel = self.writer.add_channel(schema, topic, "cdr", &nothing);
        let log_time = (time * 1e9) as u64;
        let header = mcap::records::MessageHeader {
            channel_id: channel.unwrap(),
            sequence: 0,
            log_time,
            publish_time: log_time,
        };
        self.writer.write_to_known_channel(&header, data).unwrap();
    }

    fn add<M: Message>(&mut self, topic: &str, time: f64, message: &M) {
        let data = cdr::encode(message, Endian::Little).unwrap();
        self.bytes(topic, M::TYPE, time, &data);
    }

    fn finish(mut self) -> Vec<u8> {
        self.writer.finish().unwrap();
        self.writer.into_inner().into_inner()
    }
}

fn header(time: f64) -> Header {
    Header {
        stamp: Time::from_seconds(time).unwrap(),
        frame_id: "camera_depth_optical_frame".into(),
    }
}

/// Three pixels by two.
fn image(time: f64) -> Image {
    let data = [500_u16, 505, 510, 520, 530, 540].map(u16::to_le_bytes);
    Image {
        header: header(time),
        height: 2,
        width: 3,
        encoding: "16UC1".into(),
        step: 6,
        data: data.concat(),
        ..Image::default()
    }
}

fn lens(time: f64, focal: f64) -> CameraInfo {
    CameraInfo {
        header: header(time),
        height: 2,
        width: 3,
        k: [focal, 0.0, 1.0, 0.0, focal, 0.5, 0.0, 0.0, 1.0],
        ..CameraInfo::default()
    }
}

fn joints(time: f64, names: &[&str], position: &[f64]) -> JointState {
    JointState {
        header: header(time),
        name: names.iter().map(ToString::to_string).collect(),
        position: position.to_vec(),
        ..JointState::default()
    }
}

fn scans(reader: &SessionReader, file: &[u8]) -> Vec<RecordedScan> {
    let scans = reader.scans_of_bytes(file).unwrap();
    scans.map(Result::unwrap).collect()
}

/// Three pixels by two, each of another colour, in an encoding with blue first.
fn colours(time: f64) -> Image {
    let data = (0..6).flat_map(|i| [i, 10 + i, 20 + i]).collect();
    Image {
        header: header(time),
        height: 2,
        width: 3,
        encoding: "bgr8".into(),
        step: 9,
        data,
        ..Image::default()
    }
}

/// A scan has the colours of the image that was taken with it, from the same point of view and of the same size.
#[test]
fn images_with_their_colours() {
    const COLOUR: &str = "/camera/camera/color/image_raw";
    let recorded = |topic: &str, change: &dyn Fn(&mut Image)| {
        let mut file = Recorder::new();
        file.add(INFO, 1.0, &lens(1.0, 100.0));
        for time in [1.0, 2.0] {
            file.add(IMAGE, time, &image(time));
        }
        let mut colour = colours(2.01);
        change(&mut colour);
        file.add(topic, 2.01, &colour);
        file.finish()
    };
    let usual = SessionReader::default();
    let found = scans(&usual, &recorded(COLOUR, &|_| {}));
    assert_eq!(found[0].scan.colours(), None);
    let expected: Vec<[u8; 3]> = (0..6).map(|i| [20 + i, 10 + i, i]).collect();
    assert_eq!(found[1].scan.colours(), Some(&expected[..]));
    // The usual topic of another point of view is not used; one that was named must be of the same.
    let aside = |image: &mut Image| image.header.frame_id = "camera_color_optical_frame".into();
    let found = scans(&usual, &recorded(COLOUR, &aside));
    assert!(found.iter().all(|scan| scan.scan.colours().is_none()));
    let named = SessionReader::default().with_topic(Role::Colour, "/rgb");
    assert_eq!(
        scans(&named, &recorded("/rgb", &|_| {}))[1].scan.colours(),
        Some(&expected[..])
    );
    assert!(matches!(
        named.scans_of_bytes(&recorded("/rgb", &aside)),
        Err(Error::FrameMismatch { .. })
    ));
    // Images that do not fit are skipped and reported, the scans stay.
    let changes: [&dyn Fn(&mut Image); 3] = [
        &|image| image.encoding = "yuv422".into(),
        &|image| (image.width, image.step) = (2, 6),
        &|image| image.data.truncate(5),
    ];
    for change in changes {
        let file = recorded("/rgb", change);
        let mut scans = named.scans_of_bytes(&file).unwrap();
        let found: Vec<_> = scans.by_ref().map(Result::unwrap).collect();
        assert!(found.len() == 2 && found[1].scan.colours().is_none());
        assert_eq!(scans.skipped().messages, 1);
    }
}

#[test]
fn images_with_the_lens_and_the_arms_of_their_time() {
    let mut file = Recorder::new();
    // Another lens from the third image on; the first is said only after the first image.
    file.add(IMAGE, 1.0, &image(1.0));
    for (time, focal) in [(1.05, 100.0), (2.0, 100.0), (2.9, 200.0), (3.5, 200.0)] {
        file.add(INFO, time, &lens(time, focal));
    }
    file.add(IMAGE, 2.0, &image(2.0));
    file.add(IMAGE, 3.0, &image(3.0));
    let names = [
        "roll",
        "yaw",
        "pitch",
        "insertion",
        "wrist_yaw",
        "wrist_pitch",
    ];
    let shuffled = [4.0, 1.0, 2.0, 3.0, 6.0, 5.0];
    file.add(
        "/PSM1/measured_js",
        1.995,
        &joints(1.995, &names, &shuffled),
    );
    file.add("/PSM1/jaw/measured_js", 2.0, &joints(2.0, &["jaw"], &[0.2]));
    file.add(
        "/PSM1/jaw/setpoint_js",
        2.0,
        &joints(2.0, &["jaw"], &[-0.2]),
    );
    // A robot's pose is in a frame of its own: in a session of objects that would be an error.
    let pose = PoseStamped {
        header: Header {
            frame_id: "PSM1_base".into(),
            ..header(2.0)
        },
        pose: (&Isometry3::identity()).into(),
    };
    file.add("/PSM1/measured_cp", 2.0, &pose);
    file.add("/ECM/measured_js", 2.0, &joints(2.0, &[], &[0.0; 4]));
    // Nothing of an arm that is not measured, or has another number of joints.
    file.add("/PSM2/measured_js", 2.0, &joints(0.0, &[], &[0.0; 6]));
    file.add("/PSM2/measured_js", 2.0, &joints(2.0, &[], &[0.0; 7]));
    let file = file.finish();

    let found = scans(&SessionReader::default(), &file);
    let expected = [(1.0, 100.0), (2.0, 100.0), (3.0, 200.0)];
    assert_eq!(found.len(), 3);
    for (scan, (time, focal)) in found.iter().zip(expected) {
        let whole = Scan::from_depth(&image(time), &lens(time, focal), None).unwrap();
        assert_eq!((scan.stamp, &scan.scan), (time, &whole));
        let names: Vec<_> = scan.arms.iter().map(|arm| arm.name.as_str()).collect();
        assert_eq!(names, ["PSM1", "PSM2"]);
        assert_eq!(scan.arms[1].joints, None);
    }
    let arm = &found[1].arms[0];
    assert_eq!(arm.joints, Some([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]));
    assert_eq!(
        (arm.jaw, arm.jaw_setpoint, arm.pose),
        (Some(0.2), Some(-0.2), None)
    );
    assert_eq!(
        (found[0].arms[0].joints, found[2].arms[0].joints),
        (None, None)
    );
    // A session of objects has nothing of this.
    let objects = SessionReader::default().read_bytes(&file).unwrap();
    assert!(objects.frames.is_empty());
}

#[test]
fn clouds_where_there_are_no_images() {
    let points: Vec<_> = (0..20)
        .map(|k| Point3::new(f64::from(k), 2.0, 500.0))
        .collect();
    let cloud = PointCloud2::from_points(header(1.0), &points).unwrap();
    let mut file = Recorder::new();
    file.add(CLOUD, 1.0, &cloud);
    let mut cut = cdr::encode(&cloud, Endian::Little).unwrap();
    cut.truncate(120);
    file.bytes(CLOUD, PointCloud2::TYPE, 2.0, &cut);
    let file = file.finish();
    let reader = SessionReader::default().with_topic(Role::Points, CLOUD);
    let mut scans = reader.scans_of_bytes(&file).unwrap();
    assert_eq!(
        (scans.stamps().len(), scans.camera_frame()),
        (2, "camera_depth_optical_frame")
    );
    let first = scans.next().unwrap().unwrap();
    // Half a metre in millimetres.
    assert_eq!(first.scan, Scan::from_cloud(&cloud, None).unwrap());
    assert!((first.scan.points()[3].z - 0.5).abs() < 1e-9);
    assert!(scans.next().is_none());
    assert_eq!(scans.skipped().messages, 1);
}

#[test]
fn images_without_a_lens_are_no_scans() {
    let mut file = Recorder::new();
    file.add(IMAGE, 1.0, &image(1.0));
    let file = file.finish();
    let refused = SessionReader::default().scans_of_bytes(&file).map(drop);
    assert!(matches!(refused, Err(Error::NoSuchTopic { topic, .. }) if topic == INFO));
    // A lens of another size.
    let mut file = Recorder::new();
    file.add(IMAGE, 1.0, &image(1.0));
    let wide = CameraInfo {
        width: 4,
        ..lens(1.0, 100.0)
    };
    file.add(INFO, 1.0, &wide);
    let file = file.finish();
    let mut scans = SessionReader::default().scans_of_bytes(&file).unwrap();
    assert!(scans.next().is_none());
    assert_eq!(scans.skipped().messages, 1);
}
