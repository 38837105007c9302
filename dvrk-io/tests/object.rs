//! Objects planted on tables, as every kind of message that a depth camera sends.
#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::float_cmp,
    reason = "tests; copied values must be the same bits"
)]

use dvrk_io::Error;
use dvrk_io::cdr::{self, CameraInfo, Endian, Header, Image, PointCloud2, PointField};
use dvrk_io::depth::{
    Capsule, LengthUnit, Object, ObjectOptions, Scan, UnitSource, Workspace, find_object,
};
use nalgebra::{Isometry3, Point3, UnitVector3, Vector3};
use proptest::prelude::*;

const WIDTH: u32 = 200;
const HEIGHT: u32 = 150;

fn info() -> CameraInfo {
    CameraInfo {
        width: WIDTH,
        height: HEIGHT,
        k: [250.0, 0.0, 99.5, 0.0, 250.0, 74.5, 0.0, 0.0, 1.0],
        ..CameraInfo::default()
    }
}

/// A ball half sunk into a tilted table, and a smaller one apart from it.
#[derive(Clone, Copy)]
struct Scene {
    normal: UnitVector3<f64>,
    offset: f64,
    balls: [(Point3<f64>, f64); 2],
    noise: f64,
    seed: u64,
}

impl Scene {
    fn new(tilt: [f64; 2]) -> Self {
        let normal = UnitVector3::new_normalize(Vector3::new(tilt[0], tilt[1], -1.0));
        let on_table = |x: f64, y: f64| {
            let depth = 0.5;
            // The table goes through (0, 0, 0.5).
            Point3::new(x, y, depth + (normal.x * x + normal.y * y) / -normal.z)
        };
        Self {
            normal,
            offset: -normal.z * 0.5,
            balls: [
                (on_table(0.02, 0.01), 0.045),
                (on_table(-0.11, -0.06), 0.02),
            ],
            noise: 0.0,
            seed: 1,
        }
    }

    /// Depth along the ray through a pixel, and what is hit: 0 the table, 1 and 2 the balls.
    fn hit(&self, ray: &Vector3<f64>) -> (f64, usize) {
        let table = (-self.offset / self.normal.dot(ray), 0);
        let ball = |(index, (center, radius)): (usize, &(Point3<f64>, f64))| {
            let (a, b) = (ray.norm_squared(), ray.dot(&center.coords));
            let root = b * b - a * (center.coords.norm_squared() - radius * radius);
            (root >= 0.0).then(|| ((b - root.sqrt()) / a, index + 1))
        };
        let hits = self
            .balls
            .iter()
            .enumerate()
            .filter_map(ball)
            .chain([table]);
        hits.filter(|(depth, _)| *depth > 0.0)
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .unwrap()
    }

    fn rays() -> impl Iterator<Item = Vector3<f64>> {
        (0..HEIGHT)
            .flat_map(|v| (0..WIDTH).map(move |u| (u, v)))
            .map(|(u, v)| {
                Vector3::new(
                    (f64::from(u) - 99.5) / 250.0,
                    (f64::from(v) - 74.5) / 250.0,
                    1.0,
                )
            })
    }

    fn depths(&self) -> Vec<f64> {
        let mut state = self.seed;
        let mut noise = || {
            let mut sum = 0.0;
            for _ in 0..12 {
                state = state
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1_442_695_040_888_963_407);
                sum += (state >> 33) as f64 / f64::from(1_u32 << 31);
            }
            // Twelve uniform numbers have a variance of one.
            (sum - 6.0) * self.noise
        };
        Self::rays().map(|ray| self.hit(&ray).0 + noise()).collect()
    }

    fn height(&self, point: &Point3<f64>) -> f64 {
        self.normal.dot(&point.coords) + self.offset
    }

    fn check(&self, object: &Object, ball: usize, tolerance: f64) {
        let table = object.table;
        assert!(
            table.normal.angle(&self.normal) < 0.003 + 0.2 * self.noise,
            "{}",
            table.normal.angle(&self.normal)
        );
        assert!(
            (table.offset - self.offset).abs() < 0.001,
            "{}",
            table.offset - self.offset
        );
        let (center, radius) = self.balls[ball];
        let mut aligned = 0;
        for (point, normal) in object.points.iter().zip(&object.normals) {
            let off = (point - center).norm() - radius;
            assert!(off.abs() < tolerance, "{point} is {off} off");
            assert!(self.height(point) > 0.002);
            assert!(normal.dot(&(-point.coords)) >= 0.0);
            aligned += usize::from(normal.dot(&(point - center).normalize()) > 0.9);
        }
        assert!(
            aligned * 10 > object.points.len() * 9,
            "{aligned} of {}",
            object.points.len()
        );
        adds_up(object);
    }
}

fn adds_up(object: &Object) {
    let a = object.account;
    let gone = a.missing
        + a.outside
        + a.arm
        + a.table
        + a.flying
        + a.lone
        + a.other_parts
        + a.without_normal
        + a.merged;
    assert_eq!(gone + a.kept, a.total);
    assert_eq!(a.kept, object.points.len());
    assert_eq!(a.kept, object.normals.len());
    assert!(
        object
            .colors
            .as_ref()
            .is_none_or(|colors| colors.len() == a.kept)
    );
    assert!(
        object
            .points
            .iter()
            .all(|point| point.iter().all(|value| value.is_finite()))
    );
    assert!(
        object
            .normals
            .iter()
            .all(|normal| (normal.norm() - 1.0).abs() < 1e-9)
    );
}

fn image(encoding: &str, depths: &[f64], big: bool, padding: usize) -> Image {
    let pixel = |depth: &f64| match (encoding, big) {
        ("16UC1", false) => (depth * 1000.0)
            .round()
            .clamp(0.0, 65535.0)
            .to_le_bytes_u16(false),
        ("16UC1", true) => (depth * 1000.0)
            .round()
            .clamp(0.0, 65535.0)
            .to_le_bytes_u16(true),
        (_, false) => (*depth as f32).to_le_bytes().to_vec(),
        (_, true) => (*depth as f32).to_be_bytes().to_vec(),
    };
    let rows = depths.chunks(WIDTH as usize);
    let row = |row: &[f64]| {
        row.iter()
            .flat_map(pixel)
            .chain(vec![0xAB; padding])
            .collect::<Vec<_>>()
    };
    let data: Vec<u8> = rows.flat_map(row).collect();
    Image {
        height: HEIGHT,
        width: WIDTH,
        encoding: encoding.into(),
        is_bigendian: big,
        step: (data.len() / HEIGHT as usize) as u32,
        data,
        ..Image::default()
    }
}

trait Bytes {
    fn to_le_bytes_u16(self, big: bool) -> Vec<u8>;
}

impl Bytes for f64 {
    fn to_le_bytes_u16(self, big: bool) -> Vec<u8> {
        let value = self as u16;
        if big {
            value.to_be_bytes().to_vec()
        } else {
            value.to_le_bytes().to_vec()
        }
    }
}

/// The cloud of the same depths: x y z in another order, doubles, with a colour that tells what was hit.
fn cloud(scene: &Scene, organised: bool, scale: f64) -> PointCloud2 {
    let field = |name: &str, offset, datatype| PointField {
        name: name.into(),
        offset,
        datatype,
        count: 1,
    };
    let mut data = Vec::new();
    let mut count = 0;
    for (ray, depth) in Scene::rays().zip(scene.depths()) {
        if !organised && count % 7 == 0 && depth < 0.0 {
            continue;
        }
        let point = ray * (depth * scale);
        let color = [40_u8, 80, 120, 0].map(|value| value + scene.hit(&ray).1 as u8);
        data.extend(color.iter().rev());
        for value in [point.z, point.x, point.y] {
            data.extend(value.to_be_bytes());
        }
        count += 1;
    }
    let (height, width) = if organised {
        (HEIGHT, WIDTH)
    } else {
        (1, count)
    };
    PointCloud2 {
        height,
        width,
        // Most significant byte first: alpha, red, green, blue.
        fields: vec![
            field("rgba", 0, 6),
            field("z", 4, 8),
            field("x", 12, 8),
            field("y", 20, 8),
        ],
        is_bigendian: true,
        point_step: 28,
        row_step: 28 * width,
        data,
        ..PointCloud2::default()
    }
}

fn find(scan: &Scan) -> Result<Object, Error> {
    find_object(scan, &[], &ObjectOptions::default())
}

#[test]
fn every_message_gives_the_same_object() {
    let scene = Scene::new([0.1, -0.3]);
    let depths = scene.depths();
    let millimetres: Vec<f64> = depths.iter().map(|depth| depth * 1000.0).collect();
    let (metres, mm) = (LengthUnit::Metres, LengthUnit::Millimetres);
    let mut objects = Vec::new();
    for (encoding, values, padding, unit) in [
        ("16UC1", &depths, 0, (mm, UnitSource::Encoding)),
        ("16UC1", &depths, 6, (mm, UnitSource::Encoding)),
        ("32FC1", &depths, 0, (metres, UnitSource::Range)),
        ("32FC1", &millimetres, 4, (mm, UnitSource::Range)),
    ] {
        for big in [false, true] {
            let image = image(encoding, values, big, padding);
            let image: Image = cdr::decode(&cdr::encode(&image, Endian::Little).unwrap()).unwrap();
            let scan = Scan::from_depth(&image, &info(), None).unwrap();
            assert_eq!(scan.unit(), unit);
            objects.push(find(&scan).unwrap());
        }
    }
    for (organised, scale, unit) in [
        (true, 1.0, metres),
        (false, 1.0, metres),
        (true, 1000.0, mm),
        (false, 1000.0, mm),
    ] {
        let scan = Scan::from_cloud(&cloud(&scene, organised, scale), None).unwrap();
        assert_eq!(scan.unit(), (unit, UnitSource::Range));
        assert_eq!(scan.columns().is_some(), organised);
        let object = find(&scan).unwrap();
        let colors = object.colors.as_ref().unwrap();
        assert!(
            colors.iter().all(|color| *color == [121, 81, 41]),
            "{:?}",
            colors[0]
        );
        objects.push(object);
    }
    for object in &objects {
        // Whole millimetres are half a millimetre off.
        scene.check(object, 0, 0.0016);
        assert!(object.table.inlier_share > 0.7 && object.table.residual < 0.001);
        assert_eq!(object.unit.0 == mm, object.unit.0.in_metres() < 1.0);
        let first = objects[0].points.len() as f64;
        assert!((object.points.len() as f64 - first).abs() < 0.1 * first);
        assert!(object.account.other_parts > 100);
    }
    // A given unit is believed.
    let scan = Scan::from_depth(&image("32FC1", &depths, false, 0), &info(), Some(mm)).unwrap();
    assert_eq!(scan.unit(), (mm, UnitSource::Given));
    assert!((scan.points()[0].z - depths[0] / 1000.0).abs() < 1e-7);
}

#[test]
fn the_same_input_gives_the_same_bits() {
    let mut scene = Scene::new([0.1, -0.3]);
    scene.noise = 0.001;
    let scan = Scan::from_cloud(&cloud(&scene, true, 1.0), None).unwrap();
    assert_eq!(find(&scan).unwrap(), find(&scan).unwrap());
    // Another seed draws other planes; least squares bring them to the same one.
    let options = ObjectOptions::default().with_table_search(0.004, 0.3, 99);
    let other = find_object(&scan, &[], &options).unwrap().table;
    let table = find(&scan).unwrap().table;
    assert!((table.offset - other.offset).abs() < 1e-4 && table.normal.angle(&other.normal) < 1e-3);
}

#[test]
fn a_seed_point_chooses_the_part() {
    let scene = Scene::new([0.0, 0.2]);
    let scan = Scan::from_cloud(&cloud(&scene, true, 1.0), None).unwrap();
    let (center, radius) = scene.balls[1];
    let top = center + scene.normal.into_inner() * radius;
    let small = find_object(&scan, &[], &ObjectOptions::default().with_seed_point(top)).unwrap();
    scene.check(&small, 1, 0.001);
    let nowhere = ObjectOptions::default().with_seed_point(Point3::new(0.0, 0.0, 0.2));
    let error = find_object(&scan, &[], &nowhere).unwrap_err();
    assert!(
        matches!(error, Error::NoObject { .. }) && error.to_string().contains("seed point"),
        "{error}"
    );
}

#[test]
fn arms_workspace_and_a_known_table() {
    let scene = Scene::new([0.05, -0.1]);
    let scan = Scan::from_cloud(&cloud(&scene, true, 1.0), None).unwrap();
    // An arm that covers the small ball, and a workspace that holds both.
    let arm = Capsule {
        start: scene.balls[1].0,
        end: Point3::new(-0.1, -0.05, 0.1),
        radius: 0.025,
    };
    let workspace = Workspace {
        camera_from_center: Isometry3::translation(0.0, 0.0, 0.5),
        half_extents: Vector3::new(0.15, 0.1, 0.2),
    };
    let options = ObjectOptions::default()
        .with_table(scene.normal, scene.offset)
        .with_workspace(workspace);
    let object = find_object(&scan, &[arm], &options).unwrap();
    scene.check(&object, 0, 0.001);
    assert_eq!(
        (object.table.normal, object.table.offset),
        (scene.normal, scene.offset)
    );
    assert!(object.table.inlier_share > 0.5 && object.table.residual < 5e-4);
    let account = object.account;
    assert!(
        account.arm > 100 && account.outside > 1000 && account.other_parts < 50,
        "{account}"
    );
    assert!(
        object
            .points
            .iter()
            .all(|point| arm.distance(point) > 0.0 && workspace.contains(point))
    );
    assert!(
        account.to_string().contains("arm; ") && account.to_string().starts_with("30000 points"),
        "{account}"
    );
}

#[test]
fn noise_outliers_and_holes() {
    let mut scene = Scene::new([-0.1, 0.25]);
    scene.noise = 0.001;
    let mut depths = scene.depths();
    for (index, depth) in depths.iter_mut().enumerate() {
        match index * 7919 % 100 {
            // Strays anywhere in front of the table, and holes of every kind.
            0..=2 => *depth = 0.2 + 0.25 * (index * 31 % 97) as f64 / 97.0,
            3 => *depth = f64::NAN,
            4 => *depth = 0.0,
            5 => *depth = f64::INFINITY,
            6 => *depth = -1.0,
            _ => (),
        }
    }
    let scan = Scan::from_depth(&image("32FC1", &depths, false, 0), &info(), None).unwrap();
    let object = find(&scan).unwrap();
    assert_eq!(object.account.missing, 1200);
    // Five standard deviations of the noise.
    let (center, radius) = scene.balls[0];
    let far = object
        .points
        .iter()
        .filter(|point| ((*point - center).norm() - radius).abs() > 0.005)
        .count();
    assert!(
        far * 200 < object.points.len(),
        "{far} of {}",
        object.points.len()
    );
    assert!(
        object.table.normal.angle(&scene.normal) < 0.002
            && (object.table.offset - scene.offset).abs() < 5e-4
    );
    assert!(object.points.len() > 400, "{}", object.account);
    adds_up(&object);
}

#[test]
fn edges_blurred_over_two_pixels_go() {
    // A ball that floats: its rim is 10 cm above the table. Two mixed pixels around it.
    let mut scene = Scene::new([0.0, 0.1]);
    scene.balls[0].0 += scene.normal.into_inner() * 0.12;
    let hits: Vec<_> = Scene::rays().map(|ray| scene.hit(&ray)).collect();
    let mut depths: Vec<f64> = hits.iter().map(|(depth, _)| *depth).collect();
    let mut planted = Vec::new();
    for row in 0..HEIGHT as usize {
        // A ramp, or two pixels that support each other.
        let blur = [[1.0 / 3.0, 2.0 / 3.0], [0.5, 0.5]][row / 8 % 2];
        let row = row * WIDTH as usize;
        for column in 3..WIDTH as usize - 3 {
            let at = row + column;
            // Both sides of the ball: the two table pixels next to it are mixed with it.
            for step in [1_isize, -1] {
                let next = |k: isize| at.checked_add_signed(k * step).unwrap();
                if hits[at].1 == 1
                    && hits[next(1)].1 == 0
                    && hits[next(2)].1 == 0
                    && hits[next(3)].1 == 0
                {
                    let (near, far) = (hits[at].0, hits[next(3)].0);
                    depths[next(1)] = near + (far - near) * blur[0];
                    depths[next(2)] = near + (far - near) * blur[1];
                    planted.extend([next(1), next(2)]);
                }
            }
        }
    }
    assert!(planted.len() > 200);
    let scan = Scan::from_depth(&image("32FC1", &depths, false, 0), &info(), None).unwrap();
    let object = find(&scan).unwrap();
    adds_up(&object);
    let (center, radius) = scene.balls[0];
    let off = object
        .points
        .iter()
        .filter(|point| (*point - center).norm() - radius > 0.004)
        .count();
    assert!(
        off * 100 <= object.points.len(),
        "{off} of {}: {}",
        object.points.len(),
        object.account
    );
    assert!(
        object.account.flying >= planted.len() * 9 / 10,
        "{} {}",
        planted.len(),
        object.account
    );
    // Hardly anything else goes: the last pixels of the ball at most.
    assert!(
        object.account.flying <= planted.len() * 13 / 10,
        "{} {}",
        planted.len(),
        object.account
    );
}

#[test]
fn without_a_table_in_view() {
    let cap = |radius: f64| {
        let points: Vec<_> = Scene::rays()
            .filter_map(|ray| {
                let scene = Scene {
                    balls: [(Point3::new(0.0, 0.0, 0.5), radius); 2],
                    ..Scene::new([0.0; 2])
                };
                let (depth, hit) = scene.hit(&ray);
                (hit > 0).then(|| Point3::from(ray * depth))
            })
            .collect();
        PointCloud2::from_points(Header::default(), &points).unwrap()
    };
    for radius in [0.02, 0.03, 0.05, 0.1, 0.2] {
        let error = find(&Scan::from_cloud(&cap(radius), None).unwrap()).unwrap_err();
        assert!(
            matches!(error, Error::NoTable { .. })
                && error.to_string().contains("no table in view"),
            "{radius}: {error}"
        );
    }
    for nothing in [
        PointCloud2::from_points(Header::default(), &[]).unwrap(),
        cloud_of(&[[0.0; 3]; 5]),
        cloud_of(&[[0.1, 0.2, 0.3]; 50]),
    ] {
        let scan = Scan::from_cloud(&nothing, None).unwrap();
        let error = find(&scan).unwrap_err();
        assert!(matches!(error, Error::NoTable { .. }), "{error}");
    }
    // A table alone.
    let mut bare = Scene::new([0.1, 0.1]);
    bare.balls = [(Point3::new(9.0, 9.0, 9.0), 0.01); 2];
    let error = find(&Scan::from_cloud(&cloud(&bare, true, 1.0), None).unwrap()).unwrap_err();
    assert!(
        matches!(error, Error::NoObject { .. }) && error.to_string().contains("30000 table"),
        "{error}"
    );
}

fn cloud_of(points: &[[f64; 3]]) -> PointCloud2 {
    let points: Vec<_> = points.iter().map(|point| Point3::from(*point)).collect();
    PointCloud2::from_points(Header::default(), &points).unwrap()
}

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
fn options_out_of_range_are_refused() {
    let scan = Scan::from_cloud(&cloud(&Scene::new([0.0; 2]), true, 1.0), None).unwrap();
    let ok = ObjectOptions::default();
    let down = Vector3::z_axis();
    for options in [
        ok.with_table_search(f64::NAN, 0.3, 0),
        ok.with_table_search(0.01, 1.1, 0),
        ok.with_clearances(-1.0, 0.0),
        ok.with_clearances(0.0, f64::INFINITY),
        ok.with_edges(1.6, 0.0),
        ok.with_edges(1.0, f64::NAN),
        ok.with_voxel(0.0),
        ok.with_voxel(0.1),
        ok.with_parts(f64::NAN, 1),
        ok.with_parts(1e3, 1),
        ok.with_seed_point(Point3::new(f64::NAN, 0.0, 0.0)),
        ok.with_viewpoint(Point3::new(f64::INFINITY, 0.0, 0.0)),
        ok.with_table(down, -0.5),
        ok.with_table(-down, f64::NAN),
    ] {
        let result = find_object(&scan, &[], &options);
        assert!(
            matches!(
                result,
                Err(Error::OutOfRange { .. } | Error::NonFinitePoint { .. })
            ),
            "{options:?} {result:?}"
        );
    }
    let arm = Capsule {
        start: Point3::origin(),
        end: Point3::origin(),
        radius: f64::NAN,
    };
    assert!(find_object(&scan, &[arm], &ok).is_err());
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

proptest! {
    #[test]
    fn any_tilt_and_noise(tilt in prop::array::uniform2(-0.4..0.4), noise in 0.0..0.001, seed: u64) {
        let scene = Scene { noise, seed, ..Scene::new(tilt) };
        let scan = Scan::from_cloud(&cloud(&scene, true, 1.0), None)?;
        let object = find(&scan)?;
        // Single points are up to six standard deviations off.
        scene.check(&object, 0, 0.001 + 6.0 * noise);
        prop_assert!(object.points.len() > 300);
    }

    #[test]
    fn any_points_are_accounted_for(
        values in prop::collection::vec(prop::array::uniform3(prop_oneof![-1.0..1.0, Just(0.0), Just(f64::NAN), any::<f64>()]), 0..60),
        share in 0.0..0.2, columns in 1_u32..6,
    ) {
        let mut data: Vec<u8> = values.iter().flatten().flat_map(|value: &f64| value.to_le_bytes()).collect();
        let rows = (values.len() as u32 / columns).max(1);
        data.resize((rows * columns * 24) as usize, 0);
        let field = |name: &str, offset| PointField { name: name.into(), offset, datatype: 8, count: 1 };
        let cloud = PointCloud2 {
            height: rows, width: columns, point_step: 24, row_step: 24 * columns, data,
            fields: vec![field("x", 0), field("y", 8), field("z", 16)], ..PointCloud2::default()
        };
        let scan = Scan::from_cloud(&cloud, None)?;
        let options = ObjectOptions::default().with_table_search(0.1, share, 1).with_voxel(0.1).with_parts(1.0, 1);
        if let Ok(object) = find_object(&scan, &[], &options) {
            adds_up(&object);
        }
    }

    /// A turn and a shift of everything, camera included, turn and shift the answer.
    #[test]
    fn the_frame_does_not_matter(shift in prop::array::uniform3(-1.0..1.0), axis in prop::array::uniform3(-2.0..2.0)) {
        let scene = Scene::new([0.1, -0.2]);
        let scan = Scan::from_cloud(&cloud(&scene, false, 1.0), None)?;
        let motion = Isometry3::new(shift.into(), axis.into());
        let moved: Vec<_> = scan.points().iter().map(|point| motion * point).collect();
        let scan = Scan::from_cloud(&PointCloud2::from_points(Header::default(), &moved)?, Some(LengthUnit::Metres))?;
        let options = ObjectOptions::default().with_viewpoint(motion * Point3::origin());
        let object = find_object(&scan, &[], &options)?;
        prop_assert!(object.table.normal.angle(&(motion * scene.normal)) < 0.003);
        let (center, radius) = scene.balls[0];
        for (point, normal) in object.points.iter().zip(&object.normals) {
            let point = motion.inverse() * point;
            prop_assert!(((point - center).norm() - radius).abs() < 0.001);
            prop_assert!((motion.inverse() * normal.into_inner()).dot(&-point.coords) >= -1e-9);
        }
    }
}
