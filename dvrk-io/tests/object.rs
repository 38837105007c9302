//! Objects planted on tables, as every kind of message that a depth camera sends.
#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::float_cmp,
    reason = "tests; copied values must be the same bits"
)]

mod scene;

use dvrk_io::Error;
use dvrk_io::cdr::{self, Endian, Header, Image, PointCloud2, PointField};
use dvrk_io::depth::{
    Capsule, LengthUnit, Object, ObjectOptions, Scan, UnitSource, Workspace, find_object,
};
use nalgebra::{Isometry3, Point3, Vector3};
use proptest::prelude::*;
use scene::{HEIGHT, Scene, WIDTH, adds_up, cloud, image, info};

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
        let colours = object.colours.as_ref().unwrap();
        assert!(
            colours.iter().all(|colour| *colour == [121, 81, 41]),
            "{:?}",
            colours[0]
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
    // A given unit is believed, where it can be: a camera sees nothing half a millimetre away.
    let far: Vec<f64> = depths.iter().map(|depth| 100.0 * depth).collect();
    let scan = Scan::from_depth(&image("32FC1", &far, false, 0), &info(), Some(mm)).unwrap();
    assert_eq!(scan.unit(), (mm, UnitSource::Given));
    assert!((scan.points()[0].z - depths[0] / 10.0).abs() < 1e-5);
    let wrong = Scan::from_depth(&image("32FC1", &depths, false, 0), &info(), Some(mm));
    assert!(matches!(wrong, Err(Error::DepthUnit { .. })), "{wrong:?}");
}

#[test]
fn the_same_input_gives_the_same_bits() {
    let mut scene = Scene::new([0.1, -0.3]);
    scene.noise = 0.001;
    let scan = Scan::from_cloud(&cloud(&scene, true, 1.0), None).unwrap();
    assert_eq!(find(&scan).unwrap(), find(&scan).unwrap());
    // Another seed draws other planes; least squares bring them to the same one.
    let options = ObjectOptions::default().with_seed(99);
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
        .with_table((scene.normal, scene.offset))
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
            .all(|point| arm.distance(point) > options.arm_clearance && workspace.contains(point))
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
fn options_out_of_range_are_refused() {
    let scan = Scan::from_cloud(&cloud(&Scene::new([0.0; 2]), true, 1.0), None).unwrap();
    let ok = ObjectOptions::default();
    let down = Vector3::z_axis();
    for options in [
        ok.with_table_tolerance(f64::NAN),
        ok.with_least_table_share(1.1),
        ok.with_table_clearance(-1.0),
        ok.with_arm_clearance(f64::INFINITY),
        ok.with_max_incidence(1.6),
        ok.with_noise(f64::NAN),
        ok.with_voxel(0.0),
        ok.with_voxel(0.1),
        ok.with_gap(f64::NAN),
        ok.with_gap(1e3),
        ok.with_seed_point(Point3::new(f64::NAN, 0.0, 0.0)),
        ok.with_viewpoint(Point3::new(f64::INFINITY, 0.0, 0.0)),
        ok.with_table((down, -0.5)),
        ok.with_table((-down, f64::NAN)),
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
        let options = ObjectOptions::default().with_table_tolerance(0.1).with_least_table_share(share).with_seed(1).with_voxel(0.1).with_gap(1.0).with_support(1);
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
