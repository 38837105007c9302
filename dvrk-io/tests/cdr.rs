//! CDR against bytes that another implementation wrote, against itself, and against nonsense.
#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::float_cmp,
    reason = "tests; copied values must be the same bits"
)]

use dvrk_io::Error;
use dvrk_io::cdr::{
    Endian, Header, JointState, Message, Plane, PointCloud2, PointField, Pose, PoseStamped, Time,
    decode, encode,
};
use nalgebra::Point3;
use proptest::prelude::*;

fn header() -> Header {
    Header {
        stamp: Time {
            sec: 12,
            nanosec: 345_678_901,
        },
        frame_id: "camera".into(),
    }
}

fn pose() -> PoseStamped {
    let pose = Pose {
        position: [0.125, -2.5, 1e-3],
        orientation: [0.5, -0.5, 0.5, 0.5],
    };
    PoseStamped {
        header: header(),
        pose,
    }
}

fn joints() -> JointState {
    JointState {
        header: header(),
        name: vec!["jaw".into(), "é".into()],
        position: vec![0.8, -0.25],
        velocity: vec![],
        effort: vec![0.0625],
    }
}

fn cloud() -> PointCloud2 {
    let field = |name: &str, offset| PointField {
        name: name.into(),
        offset,
        datatype: 7,
        count: 1,
    };
    let values: [f32; 10] = [1.0, 2.0, 3.0, 0.0, 5.0, -1.0, -2.0, 0.5, 0.0, 7.0];
    PointCloud2 {
        header: header(),
        height: 1,
        width: 2,
        fields: vec![
            field("x", 0),
            field("y", 4),
            field("z", 8),
            field("rgb", 16),
        ],
        is_bigendian: false,
        point_step: 20,
        row_step: 40,
        data: values
            .iter()
            .flat_map(|value| value.to_le_bytes())
            .collect(),
        is_dense: false,
    }
}

fn bytes(hex: &str) -> Vec<u8> {
    let digits = |index| u8::from_str_radix(&hex[index..index + 2], 16).unwrap();
    (0..hex.len()).step_by(2).map(digits).collect()
}

fn same_bytes<M: Message + PartialEq + std::fmt::Debug>(message: &M, little: &str, big: &str) {
    for (endian, hex) in [(Endian::Little, little), (Endian::Big, big)] {
        assert_eq!(encode(message, endian).unwrap(), bytes(hex), "{endian:?}");
        assert_eq!(&decode::<M>(&bytes(hex)).unwrap(), message, "{endian:?}");
    }
}

// Known: serialised by rosbags 0.11.9 (pure Python, shares no code) from the definitions of ROS 2 Kilted.

#[test]
fn pose_as_rosbags_writes_it() {
    same_bytes(
        &pose(),
        "000100000c00000035a49a140700000063616d657261000000000000000000000000c03f00000000000004c0\
         fca9f1d24d62503f000000000000e03f000000000000e0bf000000000000e03f000000000000e03f",
        "000000000000000c149aa4350000000763616d6572610000000000003fc0000000000000c004000000000000\
         3f50624dd2f1a9fc3fe0000000000000bfe00000000000003fe00000000000003fe0000000000000",
    );
}

#[test]
fn joints_as_rosbags_writes_them() {
    same_bytes(
        &joints(),
        "000100000c00000035a49a140700000063616d657261000002000000040000006a61770003000000c3a90000\
         02000000000000009a9999999999e93f000000000000d0bf0000000001000000000000000000b03f",
        "000000000000000c149aa4350000000763616d657261000000000002000000046a61770000000003c3a90000\
         00000002000000003fe999999999999abfd000000000000000000000000000013fb0000000000000",
    );
}

#[test]
fn plane_as_rosbags_writes_it() {
    same_bytes(
        &Plane {
            coef: [0.0, 0.0, -1.0, 1.0],
        },
        "0001000000000000000000000000000000000000000000000000f0bf000000000000f03f",
        "0000000000000000000000000000000000000000bff00000000000003ff0000000000000",
    );
}

#[test]
fn cloud_as_rosbags_writes_it() {
    same_bytes(
        &cloud(),
        "000100000c00000035a49a140700000063616d6572610000010000000200000004000000020000007800000000000000\
         0700000001000000020000007900000004000000070000000100000002000000\
         7a0000000800000007000000010000000400000072676200100000000700000001000000000000001400000028000000\
         280000000000803f0000004000004040000000000000a040000080bf000000c00000003f000000000000e04000",
        "000000000000000c149aa4350000000763616d6572610000000000010000000200000004000000027800000000000000\
         0700000000000001000000027900000000000004070000000000000100000002\
         7a0000000000000807000000000000010000000472676200000000100700000000000001000000000000001400000028\
         000000280000803f0000004000004040000000000000a040000080bf000000c00000003f000000000000e04000",
    );
    let expected = [Point3::new(1.0, 2.0, 3.0), Point3::new(-1.0, -2.0, 0.5)];
    assert_eq!(cloud().points().unwrap(), expected);
}

/// Every way to cut a message short is an error that names a place inside the message.
fn cut_short<M: Message + std::fmt::Debug>(message: &M) {
    for endian in [Endian::Little, Endian::Big] {
        let whole = encode(message, endian).unwrap();
        for length in 0..whole.len() {
            match decode::<M>(&whole[..length]) {
                Err(Error::Truncated {
                    offset,
                    needed,
                    available,
                    ..
                }) => {
                    assert!(offset <= length && available < needed && offset + available == length);
                }
                other => panic!("{length} of {} bytes: {other:?}", whole.len()),
            }
        }
    }
}

#[test]
fn cut_anywhere() {
    cut_short(&pose());
    cut_short(&joints());
    cut_short(&Plane { coef: [1.0; 4] });
    cut_short(&cloud());
}

#[test]
fn errors_name_the_place() {
    let error = decode::<PoseStamped>(&[0, 3, 0, 0, 1]).unwrap_err();
    assert!(
        matches!(error, Error::Encapsulation { found: 3 }),
        "{error}"
    );

    let mut unterminated = encode(&pose(), Endian::Little).unwrap();
    unterminated[22] = b'!';
    let error = decode::<PoseStamped>(&unterminated).unwrap_err();
    assert!(
        matches!(
            error,
            Error::BadString {
                field: "header.frame_id",
                offset: 16,
                ..
            }
        ),
        "{error}"
    );

    // A count of 2³² − 1 doubles must not be believed, let alone allocated.
    let mut greedy = encode(&JointState::default(), Endian::Little).unwrap();
    let length = greedy.len();
    greedy[length - 4..].fill(0xff);
    let error = decode::<JointState>(&greedy).unwrap_err();
    assert!(
        matches!(
            error,
            Error::Truncated {
                field: "effort",
                ..
            }
        ),
        "{error}"
    );
}

#[test]
fn clouds_that_contradict_themselves() {
    let is_bad = |change: fn(&mut PointCloud2)| {
        let mut cloud = cloud();
        change(&mut cloud);
        assert!(
            matches!(cloud.points(), Err(Error::BadCloud { .. })),
            "{cloud:?}"
        );
    };
    is_bad(|cloud| cloud.fields.truncate(2));
    is_bad(|cloud| cloud.fields[1].datatype = 2);
    is_bad(|cloud| cloud.fields[2].offset = 17);
    is_bad(|cloud| cloud.fields[2].offset = u32::MAX);
    is_bad(|cloud| cloud.point_step = 0);
    is_bad(|cloud| cloud.width = 3);
    is_bad(|cloud| cloud.width = u32::MAX);
    is_bad(|cloud| cloud.height = 2);
    is_bad(|cloud| (cloud.height, cloud.row_step) = (2, 0));
    is_bad(|cloud| (cloud.height, cloud.width) = (u32::MAX, 0));
    is_bad(|cloud| cloud.data.truncate(39));
}

#[test]
fn organised_clouds_and_other_columns() {
    // Two rows of one point, rows padded, doubles, most significant byte first.
    let field = |name: &str, offset| PointField {
        name: name.into(),
        offset,
        datatype: 8,
        count: 1,
    };
    let row = |values: [f64; 3]| values.into_iter().flat_map(f64::to_be_bytes).chain([0; 5]);
    let mut data: Vec<u8> = row([0.1, 0.2, 0.3])
        .chain(row([f64::NAN, 0.5, 0.6]))
        .collect();
    data.truncate(29 + 24);
    let cloud = PointCloud2 {
        height: 2,
        width: 1,
        fields: vec![field("z", 16), field("x", 0), field("y", 8)],
        is_bigendian: true,
        point_step: 24,
        row_step: 29,
        data,
        ..PointCloud2::default()
    };
    let points = cloud.points().unwrap();
    assert_eq!(points[0], Point3::new(0.1, 0.2, 0.3));
    assert!(points[1].x.is_nan() && points[1].z == 0.6);
    assert_eq!(points.len(), 2);
}

#[test]
fn poses_and_planes_that_mean_nothing() {
    let mut pose = pose().pose;
    pose.orientation = [0.0; 4];
    assert!(matches!(
        pose.isometry(),
        Err(Error::OutOfRange {
            what: "pose.orientation",
            ..
        })
    ));
    pose.orientation = [f64::NAN; 4];
    assert!(pose.isometry().is_err());
    pose.orientation = [0.0, 0.0, 0.0, 1.0];
    pose.position[1] = f64::INFINITY;
    assert!(matches!(
        pose.isometry(),
        Err(Error::OutOfRange {
            what: "pose.position",
            ..
        })
    ));
    for coef in [
        [0.0, 0.0, 0.0, 1.0],
        [f64::NAN, 0.0, 1.0, 0.0],
        [0.0, 0.0, 1.0, f64::INFINITY],
        [1e-320, 0.0, 0.0, 1.0],
    ] {
        assert!(Plane { coef }.normalized().is_err(), "{coef:?}");
    }
    let (normal, offset) = Plane {
        coef: [0.0, 3.0, 4.0, 10.0],
    }
    .normalized()
    .unwrap();
    assert!(
        (normal.into_inner() - nalgebra::Vector3::new(0.0, 0.6, 0.8)).norm() < 1e-15
            && offset == 2.0
    );
}

fn any_header() -> impl Strategy<Value = Header> {
    (any::<i32>(), any::<u32>(), ".{0,9}").prop_map(|(sec, nanosec, frame_id)| Header {
        stamp: Time { sec, nanosec },
        frame_id,
    })
}

fn any_cloud() -> impl Strategy<Value = PointCloud2> {
    let field = (".{0,5}", any::<u32>(), any::<u8>(), any::<u32>()).prop_map(
        |(name, offset, datatype, count)| PointField {
            name,
            offset,
            datatype,
            count,
        },
    );
    let sizes = any::<[u32; 4]>();
    let parts = (
        any_header(),
        sizes,
        prop::collection::vec(field, 0..4),
        any::<Vec<u8>>(),
        any::<[bool; 2]>(),
    );
    parts.prop_map(
        |(
            header,
            [height, width, point_step, row_step],
            fields,
            data,
            [is_bigendian, is_dense],
        )| {
            PointCloud2 {
                header,
                height,
                width,
                fields,
                is_bigendian,
                point_step,
                row_step,
                data,
                is_dense,
            }
        },
    )
}

fn any_joints() -> impl Strategy<Value = JointState> {
    let values = || prop::collection::vec(-1e9..1e9, 0..4);
    (
        any_header(),
        prop::collection::vec(".{0,5}", 0..4),
        values(),
        values(),
        values(),
    )
        .prop_map(|(header, name, position, velocity, effort)| JointState {
            header,
            name,
            position,
            velocity,
            effort,
        })
}

proptest! {
    #[test]
    fn what_is_written_is_read(cloud in any_cloud(), joints in any_joints(), numbers in prop::array::uniform7(-1e9..1e9)) {
        let [x, y, z, i, j, k, w] = numbers;
        let pose = PoseStamped {
            header: joints.header.clone(),
            pose: Pose { position: [x, y, z], orientation: [i, j, k, w] },
        };
        let plane = Plane { coef: [x, y, z, w] };
        for endian in [Endian::Little, Endian::Big] {
            prop_assert_eq!(&decode::<PointCloud2>(&encode(&cloud, endian)?)?, &cloud);
            prop_assert_eq!(&decode::<JointState>(&encode(&joints, endian)?)?, &joints);
            prop_assert_eq!(&decode::<PoseStamped>(&encode(&pose, endian)?)?, &pose);
            prop_assert_eq!(&decode::<Plane>(&encode(&plane, endian)?)?, &plane);
        }
    }

    #[test]
    fn random_bytes_do_not_panic(mut bytes: Vec<u8>, plain: bool) {
        // Half of the cases get past the encapsulation header.
        if plain && bytes.len() >= 4 {
            bytes[0] = 0;
            bytes[1] &= 1;
        }
        let _ = decode::<PoseStamped>(&bytes);
        let _ = decode::<JointState>(&bytes);
        let _ = decode::<Plane>(&bytes);
        let _ = decode::<PointCloud2>(&bytes).map(|cloud| cloud.points());
    }

    #[test]
    fn damaged_messages_do_not_panic(place: prop::sample::Index, value: u8, width in 1_usize..5) {
        let mut bytes = encode(&cloud(), Endian::Little)?;
        let start = place.index(bytes.len());
        let end = bytes.len().min(start + width);
        bytes[start..end].fill(value);
        let _ = decode::<PointCloud2>(&bytes).map(|cloud| cloud.points());
    }

    #[test]
    fn points_keep_32_bits(points in prop::collection::vec(prop::array::uniform3(-1e3..1e3), 0..20)) {
        let points: Vec<Point3<f64>> = points.into_iter().map(Point3::from).collect();
        let cloud = PointCloud2::from_points(header(), &points)?;
        let single = |point: &Point3<f64>| point.map(|value| f64::from(value as f32));
        prop_assert_eq!(cloud.points()?, points.iter().map(single).collect::<Vec<_>>());
    }

    #[test]
    fn colours_come_back_with_their_points(
        rows in prop::collection::vec((prop::array::uniform3(-1e3..1e3), any::<[u8; 3]>()), 0..20),
    ) {
        let (points, colours): (Vec<[f64; 3]>, Vec<_>) = rows.into_iter().unzip();
        let points: Vec<Point3<f64>> = points.into_iter().map(Point3::from).collect();
        let cloud = PointCloud2::from_coloured_points(header(), &points, &colours)?;
        prop_assert_eq!(cloud.points()?, PointCloud2::from_points(header(), &points)?.points()?);
        prop_assert_eq!(cloud.colours()?, Some(colours.clone()));
        prop_assert!(PointCloud2::from_coloured_points(header(), &points, &[&colours[..], &[[0; 3]]].concat()).is_err());
    }

    #[test]
    fn stamps_round_to_nanoseconds(nanoseconds in 0_u64..(1 << 30) * 1_000_000_000) {
        let time = Time::from_nanoseconds(nanoseconds);
        prop_assert_eq!(time.nanoseconds(), nanoseconds);
        // Half a unit in the last place of 2³⁰ s is 0.06 µs; rounding to nanoseconds adds little.
        let back = Time::from_seconds(time.seconds())?;
        prop_assert!(back.nanoseconds().abs_diff(nanoseconds) <= 121, "{} {}", nanoseconds, back.nanoseconds());
    }
}

#[test]
fn stamps_at_the_edges() {
    assert_eq!(
        Time::from_seconds(0.999_999_999_9).unwrap(),
        Time { sec: 1, nanosec: 0 }
    );
    assert_eq!(
        Time::from_seconds(0.1).unwrap(),
        Time {
            sec: 0,
            nanosec: 100_000_000
        }
    );
    for bad in [-1e-9, f64::NAN, f64::INFINITY, 3e9] {
        assert!(Time::from_seconds(bad).is_err(), "{bad}");
    }
    assert_eq!(
        Time {
            sec: -5,
            nanosec: 3
        }
        .nanoseconds(),
        3
    );
}
