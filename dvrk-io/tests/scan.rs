//! Messages of depth cameras: against bytes that another implementation wrote, and against nonsense.
#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::float_cmp,
    reason = "tests; copied values must be the same bits"
)]

mod scene;

use dvrk_io::cdr::{self, CameraInfo, Endian, Header, Image, PointField};
use dvrk_io::depth::Scan;
use nalgebra::Point3;
use scene::{HEIGHT, Scene, WIDTH, cloud, image, info};

#[test]
fn messages_that_contradict_themselves_are_refused() {
    let ok = image("16UC1", &vec![0.5; (WIDTH * HEIGHT) as usize], false, 0);
    let refused = |image: Image, info: CameraInfo, word: &str| {
        let error = Scan::from_depth(&image, &info, None)
            .unwrap_err()
            .to_string();
        assert!(error.contains(word), "{error}");
    };
    refused(
        Image {
            encoding: "rgb8".into(),
            ..ok.clone()
        },
        info(),
        "rgb8",
    );
    refused(
        Image {
            step: 10,
            ..ok.clone()
        },
        info(),
        "10 bytes a row",
    );
    refused(
        Image {
            data: vec![0; 10],
            ..ok.clone()
        },
        info(),
        "data has 10",
    );
    refused(
        Image {
            height: u32::MAX,
            ..ok.clone()
        },
        info(),
        "need",
    );
    refused(
        Image {
            width: 0,
            ..ok.clone()
        },
        info(),
        "0 × 150",
    );
    refused(
        ok.clone(),
        CameraInfo {
            width: 100,
            ..info()
        },
        "its camera 100 × 150",
    );
    refused(
        ok,
        CameraInfo {
            k: [0.0; 9],
            ..info()
        },
        "focal length",
    );
    let mut bad = cloud(&Scene::new([0.0; 2]), true, 1.0);
    bad.fields[0].datatype = 8;
    assert!(
        Scan::from_cloud(&bad, None)
            .unwrap_err()
            .to_string()
            .contains("rgba")
    );
    bad.fields[0] = PointField {
        datatype: 6,
        offset: 26,
        ..bad.fields[0].clone()
    };
    assert!(
        Scan::from_cloud(&bad, None)
            .unwrap_err()
            .to_string()
            .contains("rgba")
    );
}

#[test]
fn a_rectified_image_is_projected_by_p() {
    let depths = vec![0.5; (WIDTH * HEIGHT) as usize];
    let p = [
        100.0, 0.0, 50.0, 0.0, 0.0, 200.0, 40.0, 0.0, 0.0, 0.0, 1.0, 0.0,
    ];
    let scan = Scan::from_depth(
        &image("32FC1", &depths, false, 0),
        &CameraInfo { p, ..info() },
        None,
    )
    .unwrap();
    assert_eq!(scan.points()[0], Point3::new(-0.25, -0.1, 0.5));
}

#[test]
fn images_and_cameras_as_rosbags_writes_them() {
    let header = Header {
        stamp: cdr::Time {
            sec: 12,
            nanosec: 345_678_901,
        },
        frame_id: "camera".into(),
    };
    let image = Image {
        header: header.clone(),
        height: 2,
        width: 1,
        encoding: "16UC1".into(),
        is_bigendian: false,
        step: 4,
        data: vec![1, 2, 3, 4, 5, 6, 7, 8],
    };
    let info = CameraInfo {
        header,
        height: 480,
        width: 640,
        distortion_model: "plumb_bob".into(),
        d: vec![0.5, -0.25],
        k: [600.0, 0.0, 320.0, 0.0, 601.0, 240.0, 0.0, 0.0, 1.0],
        r: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p: [
            600.0, 0.0, 320.0, 0.0, 0.0, 601.0, 240.0, 0.0, 0.0, 0.0, 1.0, 0.0,
        ],
        binning_x: 1,
        binning_y: 2,
        roi: [3, 4, 5, 6],
        roi_do_rectify: true,
    };
    let bytes = |hex: &str| -> Vec<u8> {
        (0..hex.len())
            .step_by(2)
            .map(|at| u8::from_str_radix(&hex[at..at + 2], 16).unwrap())
            .collect()
    };
    for (endian, hexes) in [
        (Endian::Little, include_str!("data/camera_little.hex")),
        (Endian::Big, include_str!("data/camera_big.hex")),
    ] {
        let [image_hex, info_hex] = hexes.lines().collect::<Vec<_>>()[..] else {
            panic!("two lines")
        };
        assert_eq!(cdr::encode(&image, endian).unwrap(), bytes(image_hex));
        assert_eq!(cdr::decode::<Image>(&bytes(image_hex)).unwrap(), image);
        assert_eq!(cdr::encode(&info, endian).unwrap(), bytes(info_hex));
        assert_eq!(cdr::decode::<CameraInfo>(&bytes(info_hex)).unwrap(), info);
    }
}
