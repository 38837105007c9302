//! A camera on the in-process bus.
#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::float_cmp,
    reason = "tests; the ends of motions are met to the last bit"
)]

mod bus;

use std::sync::Arc;

use bus::seconds;
use dvrk_io::Error;
use dvrk_io::arm::Absence;
use dvrk_io::camera::{Camera, CameraOptions, CameraTopics};
use dvrk_io::cdr::{CameraInfo, Header, Image, Text, Time};
use dvrk_io::depth::{LengthUnit, ObjectOptions, UnitSource, find_object};
use dvrk_io::nalgebra::{Point3, Vector3};
use dvrk_io::serve::CloudServer;
use dvrk_io::transport::{Bus, Qos, Transport, Writer};

const TOPIC: &str = "/camera/depth/color/points";

fn camera(bus: &Bus) -> Camera {
    let topics = CameraTopics::Cloud(TOPIC.into());
    Camera::open(Arc::new(bus.node()), &topics, CameraOptions::default()).unwrap()
}

#[test]
fn the_newest_cloud_of_reliable_and_best_effort_cameras() {
    for reliable in [true, false] {
        let bus = Bus::new();
        let mut server = CloudServer::new(&bus.node(), TOPIC, "optical", reliable).unwrap();
        let mut camera = camera(&bus);
        let node = bus.node();
        for k in 0..5 {
            bus.advance(seconds(0.6));
            // Nobody asks for these frames but the last.
            for _ in 0..3 {
                let depth = 0.5 + f64::from(k);
                server
                    .publish(node.now(), &[Point3::new(0.0, 0.25, depth)])
                    .unwrap();
                if let Ok(Some(frame)) = camera.try_frame() {
                    assert_eq!(frame.scan.points(), [Point3::new(0.0, 0.25, depth)]);
                    assert_eq!((frame.stamp, frame.frame.as_str()), (node.now(), "optical"));
                }
            }
        }
        server
            .publish(node.now(), &[Point3::new(0.0, 0.0, 9.0)])
            .unwrap();
        assert_eq!(
            camera.next_frame(seconds(1.0)).unwrap().scan.points()[0].z,
            9.0
        );
        assert!(camera.try_frame().unwrap().is_none());
        // The camera is replaced by one of the other kind.
        drop(server);
        let mut other = CloudServer::new(&node, TOPIC, "optical", !reliable).unwrap();
        let clock = bus.node();
        bus.every(seconds(0.1), move |_| {
            other
                .publish(clock.now(), &[Point3::new(0.0, 0.0, 7.0)])
                .unwrap();
        });
        let frame = camera.next_frame(seconds(3.0)).unwrap();
        assert_eq!(frame.scan.points()[0].z, 7.0);
    }
}

#[test]
fn why_there_is_no_frame() {
    let bus = Bus::new();
    let mut camera = camera(&bus);
    let why = |camera: &mut Camera| match camera.next_frame(seconds(2.0)) {
        Err(Error::StreamsMissing { streams, .. }) => {
            assert_eq!((streams.len(), streams[0].topic.as_str()), (1, TOPIC));
            streams[0].reason.clone()
        }
        other => panic!("{other:?}"),
    };
    assert_eq!(why(&mut camera), Absence::NobodyPublishes);
    let text: Writer<Text> = Writer::new(&bus.node(), TOPIC, Qos::PERIODIC).unwrap();
    assert!(
        matches!(why(&mut camera), Absence::OtherType { found } if found == "std_msgs/msg/String")
    );
    drop(text);
    let mut server = CloudServer::new(&bus.node(), TOPIC, "optical", true).unwrap();
    assert_eq!(why(&mut camera), Absence::Silent);
    server
        .publish(seconds(3.0), &[Point3::new(0.0, 0.0, 1.0)])
        .unwrap();
    assert!(matches!(why(&mut camera), Absence::Old(age) if age > 900.0));
}

#[test]
fn a_depth_image_leads_to_the_object() {
    let bus = Bus::new();
    let node = bus.node();
    let topics = CameraTopics::Depth {
        image: "/camera/depth/image_rect_raw".into(),
        info: "/camera/depth/camera_info".into(),
        colour: None,
    };
    let options = CameraOptions::default();
    let mut camera = Camera::open(Arc::new(bus.node()), &topics, options.clone()).unwrap();
    let mut images: Writer<Image> =
        Writer::new(&node, "/camera/depth/image_rect_raw", Qos::PERIODIC).unwrap();
    let mut infos: Writer<CameraInfo> =
        Writer::new(&node, "/camera/depth/camera_info", Qos::PERIODIC).unwrap();
    let (width, height) = (160_u32, 120);
    let is_box = |i: u32| (60..100).contains(&(i % width)) && (40..80).contains(&(i / width));
    let depth = |i| if is_box(i) { 470_u16 } else { 500 };
    let data: Vec<u8> = (0..width * height)
        .flat_map(|i| depth(i).to_le_bytes())
        .collect();
    let header = Header {
        stamp: Time::from_seconds(node.now().as_secs_f64()).unwrap(),
        frame_id: "optical".into(),
    };
    let image = Image {
        header,
        width,
        height,
        encoding: "16UC1".into(),
        step: 2 * width,
        data,
        ..Image::default()
    };
    images.publish(&image).unwrap();
    // Without its camera an image says nothing.
    let Err(Error::StreamsMissing { streams, .. }) = camera.next_frame(seconds(0.5)) else {
        panic!("no camera");
    };
    assert_eq!(streams[0].topic, "/camera/depth/camera_info");
    let k = [150.0, 0.0, 79.5, 0.0, 150.0, 59.5, 0.0, 0.0, 1.0];
    infos
        .publish(&CameraInfo {
            width,
            height,
            k,
            ..CameraInfo::default()
        })
        .unwrap();
    let frame = camera.next_frame(seconds(0.5)).unwrap();
    assert_eq!(
        frame.scan.unit(),
        (LengthUnit::Millimetres, UnitSource::Encoding)
    );
    let object = find_object(&frame.scan, &[], &ObjectOptions::default()).unwrap();
    assert!(
        object
            .points
            .iter()
            .all(|point| (point.z - 0.47).abs() < 1e-6)
    );
    assert!((object.table.normal.into_inner() + Vector3::z()).norm() < 1e-6);
    // An image of another size than its camera is an error, and the next one is read.
    images
        .publish(&Image {
            width: 10,
            step: 20,
            ..image.clone()
        })
        .unwrap();
    assert!(matches!(camera.try_frame(), Err(Error::BadImage { .. })));
    images.publish(&image).unwrap();
    assert!(camera.try_frame().unwrap().is_some());
}

/// A depth image waits for its colour image, but not long, and takes no other.
#[test]
fn a_depth_image_comes_with_its_colours() {
    let bus = Bus::new();
    let node = bus.node();
    let topics = CameraTopics::Depth {
        image: "/depth".into(),
        info: "/info".into(),
        colour: Some("/colour".into()),
    };
    let options = CameraOptions::default();
    let mut camera = Camera::open(Arc::new(bus.node()), &topics, options).unwrap();
    let mut depths: Writer<Image> = Writer::new(&node, "/depth", Qos::PERIODIC).unwrap();
    let mut infos: Writer<CameraInfo> = Writer::new(&node, "/info", Qos::PERIODIC).unwrap();
    let mut colours: Writer<Image> = Writer::new(&node, "/colour", Qos::PERIODIC).unwrap();
    let (width, height) = (3, 2);
    infos
        .publish(&CameraInfo {
            width,
            height,
            k: [100.0, 0.0, 1.0, 0.0, 100.0, 0.5, 0.0, 0.0, 1.0],
            ..CameraInfo::default()
        })
        .unwrap();
    let image = |time: f64, encoding: &str, bytes: u32, data: Vec<u8>| Image {
        header: Header {
            stamp: Time::from_seconds(time).unwrap(),
            frame_id: "optical".into(),
        },
        width,
        height,
        encoding: encoding.into(),
        step: bytes * width,
        data,
        ..Image::default()
    };
    let depth = |time: f64| {
        image(
            time,
            "16UC1",
            2,
            [500_u16; 6].map(u16::to_le_bytes).concat(),
        )
    };
    let grey = |time: f64, level: u8| image(time, "mono8", 1, vec![level; 6]);
    let now = || node.now().as_secs_f64();

    // The colours come later.
    let taken = now();
    depths.publish(&depth(taken)).unwrap();
    assert!(camera.try_frame().unwrap().is_none());
    bus.advance(seconds(0.02));
    colours.publish(&grey(taken + 0.01, 7)).unwrap();
    let frame = camera.try_frame().unwrap().unwrap();
    assert_eq!(frame.scan.colours(), Some(&[[7; 3]; 6][..]));
    // Those of another moment are not waited for any longer than 50 ms, also if depth images keep coming.
    let mut plain = 0;
    for _ in 0..10 {
        bus.advance(seconds(0.03));
        depths.publish(&depth(now())).unwrap();
        colours.publish(&grey(taken, 9)).unwrap();
        if let Some(frame) = camera.try_frame().unwrap() {
            assert_eq!(frame.scan.colours(), None);
            plain += 1;
        }
    }
    assert!((3..=5).contains(&plain), "{plain}");
    // From another point of view they are not the colours of these points.
    let mut aside = grey(now(), 8);
    aside.header.frame_id = "elsewhere".into();
    depths.publish(&depth(now())).unwrap();
    colours.publish(&aside).unwrap();
    assert!(matches!(camera.try_frame(), Err(Error::BadImage { .. })));
}
