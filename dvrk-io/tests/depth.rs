//! Depth images of scenes whose every surface is a formula.
#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::float_cmp,
    reason = "tests; copied values must be the same bits"
)]

mod scene;

use dvrk_io::Error;
use dvrk_io::depth::{
    Capsule, DepthImage, Intrinsics, LengthUnit, Object, ObjectOptions, Scan, UnitSource,
    Workspace, chain, find_object,
};
use nalgebra::{Isometry3, Point3, Unit, UnitQuaternion, UnitVector3, Vector3};
use proptest::prelude::*;
use scene::adds_up;

const WIDTH: usize = 160;
const HEIGHT: usize = 120;
/// Depths are 32-bit floats below 1 m: half a unit in the last place, doubled for the slope of the ray.
const ROUNDING: f64 = 1.2e-7;

fn camera() -> Intrinsics {
    Intrinsics::new(WIDTH, HEIGHT, [200.0, 210.0], [79.5, 60.25]).unwrap()
}

/// A ball on a table that is tilted against the camera, half a metre away.
#[derive(Clone, Copy)]
struct Scene {
    normal: UnitVector3<f64>,
    offset: f64,
    center: Point3<f64>,
    radius: f64,
}

/// Depth of the first hit with a ball on the ray through the origin along `ray` (whose z is 1).
fn ball(ray: &Vector3<f64>, center: &Point3<f64>, radius: f64) -> Option<f64> {
    let (a, b) = (ray.norm_squared(), ray.dot(&center.coords));
    let discriminant = b * b - a * (center.coords.norm_squared() - radius * radius);
    (discriminant >= 0.0).then(|| (b - discriminant.sqrt()) / a)
}

impl Scene {
    fn new() -> Self {
        let normal = Unit::new_normalize(Vector3::new(0.1, -0.5, -1.0));
        let foot = Point3::new(0.01, 0.005, 0.5);
        let (offset, radius) = (-normal.dot(&foot.coords), 0.05);
        Self {
            normal,
            offset,
            center: foot + normal.into_inner() * radius,
            radius,
        }
    }

    fn depth(&self, u: f64, v: f64) -> f64 {
        let ray = camera().back_project(u, v, 1.0).coords;
        let table = -self.offset / self.normal.dot(&ray);
        ball(&ray, &self.center, self.radius).map_or(table, |depth| depth.min(table))
    }

    fn height(&self, point: &Point3<f64>) -> f64 {
        self.normal.dot(&point.coords) + self.offset
    }

    fn options(&self) -> ObjectOptions {
        ObjectOptions::default().with_table((self.normal, self.offset))
    }
}

/// For scenes without a table: it is far behind everything.
fn no_table() -> ObjectOptions {
    ObjectOptions::default().with_table((-Vector3::z_axis(), 100.0))
}

fn render(depth: impl Fn(f64, f64) -> f64) -> DepthImage {
    let pixels =
        (0..HEIGHT).flat_map(|row| (0..WIDTH).map(move |column| (column as f64, row as f64)));
    let depths: Vec<f32> = pixels.map(|(u, v)| depth(u, v) as f32).collect();
    DepthImage::from_metres(WIDTH, HEIGHT, &depths).unwrap()
}

fn scan(image: &DepthImage) -> Scan {
    Scan::from_image(image, &camera()).unwrap()
}

fn find(image: &DepthImage, arms: &[Capsule], options: &ObjectOptions) -> Object {
    let scan = scan(image);
    let object = find_object(&scan, arms, options).unwrap();
    every_pixel_is_accounted_for(&scan, &object);
    object
}

fn every_pixel_is_accounted_for(scan: &Scan, object: &Object) {
    adds_up(object);
    assert_eq!(object.account.total, scan.points().len());
    assert_eq!(object.point_of.len(), scan.points().len());
    // Every point is the mean of its pixels, or, where that is not allowed to be one, the first of them.
    let mut pixels = vec![Vec::new(); object.points.len()];
    for (pixel, point) in object.point_of.iter().enumerate() {
        if let Some(point) = point {
            pixels[*point].push(scan.points()[pixel]);
        }
    }
    for (point, pixels) in object.points.iter().zip(&pixels) {
        let sum: Vector3<f64> = pixels.iter().map(|pixel| pixel.coords).sum();
        let mean = Point3::from(sum / pixels.len() as f64);
        assert!((point - mean).norm() < 1e-12 || *point == pixels[0]);
    }
    let kept = pixels.iter().map(Vec::len).sum::<usize>();
    assert_eq!(kept, object.account.kept + object.account.merged);
}

/// Pixels of the object.
fn kept(object: &Object) -> Vec<usize> {
    (0..object.point_of.len())
        .filter(|&pixel| object.point_of[pixel].is_some())
        .collect()
}

#[test]
fn a_ball_on_a_table() {
    let scene = Scene::new();
    let options = scene.options();
    let image = render(|u, v| scene.depth(u, v));
    let object = find(&image, &[], &options);
    let pixels = kept(&object);
    for &pixel in &pixels {
        let point = scan(&image).points()[pixel];
        assert!(
            ((point - scene.center).norm() - scene.radius).abs() < ROUNDING,
            "{point}"
        );
        assert!(scene.height(&point) > options.table_clearance);
    }
    assert!(
        object
            .points
            .iter()
            .all(|point| scene.height(point) > options.table_clearance)
    );
    // What must stay: the ball above the clearance, where the ray meets it at less than 70°, well under the 80°
    // of the settings, so that the neighbours of the pixel do not reach 80° either.
    let mut expected = 0;
    for row in 0..HEIGHT {
        for column in 0..WIDTH {
            let point =
                camera().back_project(column as f64, row as f64, image.depth(column, row).unwrap());
            let normal = (point - scene.center) / scene.radius;
            let on_ball = (normal.norm() - 1.0).abs() < 1e-5;
            let steep = normal.dot(&point.coords.normalize()).abs() < 70_f64.to_radians().cos();
            if on_ball && !steep && scene.height(&point) > options.table_clearance + ROUNDING {
                assert!(
                    pixels.contains(&(row * WIDTH + column)),
                    "lost {column}, {row}"
                );
                expected += 1;
            }
        }
    }
    assert!(
        expected > 800 && pixels.len() - expected < expected / 3,
        "{expected} {}",
        pixels.len()
    );
}

#[test]
fn averaged_depths_at_the_rim_are_removed() {
    // Sensor pixels are 4 × 4 finer rays averaged, as in a camera that mixes what it sees within a pixel; the ball
    // floats 15 cm above the table to make the mixed depths lie far from both.
    let mut scene = Scene::new();
    scene.center += scene.normal.into_inner() * 0.15;
    let fine = |index: u32| (f64::from(index) - 1.5) / 4.0;
    let rays =
        |u: f64, v: f64| (0..16).map(move |index| (u + fine(index % 4), v + fine(index / 4)));
    let hits = |u: f64, v: f64| {
        let hit = |(u, v)| {
            ball(
                &camera().back_project(u, v, 1.0).coords,
                &scene.center,
                scene.radius,
            )
            .is_some()
        };
        rays(u, v).filter(|&ray| hit(ray)).count()
    };
    let image = render(|u, v| rays(u, v).map(|(u, v)| scene.depth(u, v)).sum::<f64>() / 16.0);
    let options = scene.options();
    let pixels = kept(&find(&image, &[], &options));
    let mixed =
        |pixel: usize| (1..16).contains(&hits((pixel % WIDTH) as f64, (pixel / WIDTH) as f64));
    let whole = |pixel: usize| hits((pixel % WIDTH) as f64, (pixel / WIDTH) as f64) == 16;
    let planted = (0..WIDTH * HEIGHT).filter(|&pixel| mixed(pixel)).count();
    let survivors = pixels.iter().filter(|&&pixel| mixed(pixel)).count();
    let owned = (0..WIDTH * HEIGHT).filter(|&pixel| whole(pixel)).count();
    let whole_kept = pixels.iter().filter(|&&pixel| whole(pixel)).count();
    assert!(planted > 100 && owned > 1500, "{planted} {owned}");
    // A mixed pixel may lie so little behind the rim that it is within noise of it: those alone may stay.
    let off = |point: &Point3<f64>| (point - scene.center).norm() - scene.radius;
    let scan = scan(&image);
    let points = pixels.iter().map(|&pixel| &scan.points()[pixel]);
    let worst = points.map(off).fold(0.0, f64::max);
    assert!(
        survivors * 50 <= planted,
        "{survivors} of {planted} mixed pixels stayed, up to {worst} m off"
    );
    assert!(
        whole_kept * 100 >= owned * 97,
        "{whole_kept} of {owned} good pixels kept"
    );
    // Without the tests for edges and strays nearly all of them stay.
    let blind = options
        .with_max_incidence(1.57)
        .with_noise(1.0)
        .with_voxel(0.02)
        .with_gap(0.15)
        .with_support(0);
    let pixels = kept(&find(&image, &[], &blind));
    assert!(pixels.iter().filter(|&&pixel| mixed(pixel)).count() * 10 >= planted * 9);
}

#[test]
fn a_straight_edge_loses_its_mixed_column_only() {
    // The mixed pixels support each other along the edge; that they hang is what betrays them.
    let image = render(|u, _| match u {
        80.0 => 0.5,
        u if u < 80.0 => 0.4,
        _ => 0.6,
    });
    let lonely_allowed = no_table().with_gap(0.01).with_support(0);
    let mut walls = Vec::new();
    for depth in [0.4, 0.6] {
        let options = lonely_allowed.with_seed_point(Point3::new(0.0, 0.0, depth));
        let object = find(&image, &[], &options);
        assert_eq!(object.account.flying, HEIGHT);
        walls.extend(kept(&object));
    }
    // The walls are two parts; together they are everything else.
    walls.sort_unstable();
    let others: Vec<_> = (0..WIDTH * HEIGHT)
        .filter(|pixel| pixel % WIDTH != 80)
        .collect();
    assert_eq!(walls, others);
}

#[test]
fn pixels_next_to_holes_need_company() {
    // A wall with a lone pixel in front of it, surrounded by pixels without depth.
    let hole = |u: f64, v: f64| (u - 50.0).abs() <= 2.0 && (v - 50.0).abs() <= 2.0;
    let image = render(|u, v| match (u, v) {
        (50.0, 50.0) => 0.3,
        (u, v) if hole(u, v) => f64::NAN,
        _ => 0.5,
    });
    let object = find(&image, &[], &no_table());
    assert_eq!((object.account.missing, object.account.lone), (24, 1));
    assert_eq!(kept(&object).len(), WIDTH * HEIGHT - 25);
}

#[test]
fn an_arm_in_front_of_a_ball() {
    let scene = Scene::new();
    // A chain of two links, as the balls of which its capsules are the hull.
    let joints = [
        Point3::new(0.2, -0.1, 0.3),
        Point3::new(0.05, -0.02, 0.4),
        scene.center,
    ];
    let radii = [0.012, 0.006];
    let arms = chain(&joints, &radii);
    assert_eq!(arms.len(), 2);
    let balls = |link: usize| {
        (0..=400).map(move |step| {
            (
                joints[link] + (joints[link + 1] - joints[link]) * (f64::from(step) / 400.0),
                radii[link],
            )
        })
    };
    let chain_balls: Vec<_> = balls(0).chain(balls(1)).collect();
    let image = render(|u, v| {
        let ray = camera().back_project(u, v, 1.0).coords;
        let arm = chain_balls
            .iter()
            .filter_map(|(center, radius)| ball(&ray, center, *radius));
        arm.fold(scene.depth(u, v), f64::min)
    });
    let options = scene.options();
    let seen = find(&image, &[], &options);
    let object = find(&image, &arms, &options);
    assert!(object.account.arm > 200);
    let scan = scan(&image);
    let outside = |point: &Point3<f64>| {
        arms.iter()
            .all(|arm| arm.distance(point) > options.arm_clearance)
    };
    for pixel in kept(&object) {
        let point = scan.points()[pixel];
        assert!(
            ((point - scene.center).norm() - scene.radius).abs() < ROUNDING,
            "{point}"
        );
        assert!(outside(&point));
    }
    assert!(object.points.iter().all(outside));
    // Nothing else went: what lies outside of the capsules is the same with and without them.
    let mut others = kept(&seen);
    others.retain(|&pixel| outside(&scan.points()[pixel]));
    assert_eq!(others, kept(&object));
}

#[test]
fn no_mean_lies_in_a_thin_arm() {
    // A needle along a wall, and voxels so wide that they hold pixels of both sides of it.
    let image = render(|_, _| 0.5);
    let needle = Capsule {
        start: Point3::new(0.01, -0.1, 0.5),
        end: Point3::new(0.01, 0.1, 0.5),
        radius: 0.001,
    };
    let options = no_table().with_voxel(0.02).with_gap(0.05).with_support(4);
    let object = find(&image, &[needle], &options);
    let clear = |point: &Point3<f64>| needle.distance(point) > options.arm_clearance;
    assert!(object.points.iter().all(clear));
    let scan = scan(&image);
    let pixels = kept(&object);
    assert!(pixels.iter().all(|&pixel| clear(&scan.points()[pixel])));
    assert_eq!(pixels.len() + object.account.arm, WIDTH * HEIGHT);
    // The means of their pixels would not be.
    let is_mean_inside = |index: usize| {
        let pixels = pixels.iter().map(|&pixel| (pixel, scan.points()[pixel]));
        let own = pixels.filter(|(pixel, _)| object.point_of[*pixel] == Some(index));
        let own: Vec<_> = own.map(|(_, point)| point.coords).collect();
        !clear(&Point3::from(
            own.iter().sum::<Vector3<f64>>() / own.len() as f64,
        ))
    };
    assert!((0..object.points.len()).any(is_mean_inside));
}

#[test]
fn the_workspace_is_a_turned_box() {
    let image = render(|_, _| 0.5);
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.5);
    let workspace = Workspace {
        camera_from_center: Isometry3::from_parts(Vector3::new(0.02, 0.0, 0.5).into(), turn),
        half_extents: Vector3::new(0.08, 0.03, 0.01),
    };
    let object = find(&image, &[], &no_table().with_workspace(workspace));
    let pixels = kept(&object);
    // 0.16 m × 0.06 m at f = 200 × 210 pixels and 0.5 m: 1613 pixels, up to half a pixel all round.
    let expected = 0.16 * 0.06 * (200.0 / 0.5) * (210.0 / 0.5);
    let rim = 0.5 * 2.0 * (0.16 + 0.06) * (205.0 / 0.5);
    assert!(
        (pixels.len() as f64 - expected).abs() < rim,
        "{}",
        pixels.len()
    );
    assert!(object.points.iter().all(|point| workspace.contains(point)));
    let scan = scan(&image);
    assert!(
        pixels
            .iter()
            .all(|&pixel| workspace.contains(&scan.points()[pixel]))
    );
    // The first test that fails counts: everything else is outside.
    assert_eq!(pixels.len() + object.account.outside, WIDTH * HEIGHT);
}

#[test]
fn millimetres_and_missing_depths() {
    let units = DepthImage::from_units(2, 2, &[0, 500, 1, u16::MAX], 0.001).unwrap();
    let metres = DepthImage::from_metres(2, 2, &[f32::NAN, 0.5, 0.001, 65.535]).unwrap();
    assert_eq!(units, metres);
    assert_eq!(
        DepthImage::from_metres(1, 3, &[f32::INFINITY, -1.0, 0.0])
            .unwrap()
            .depth(0, 2),
        None
    );
    assert!((units.depth(1, 0).unwrap() - 0.5).abs() < 1e-9);
    assert_eq!(units.depth(2, 0), None);
    let camera = Intrinsics::new(2, 2, [2.0, 4.0], [0.0; 2]).unwrap();
    let scan = Scan::from_image(&metres, &camera).unwrap();
    assert_eq!(scan.unit(), (LengthUnit::Metres, UnitSource::Given));
    assert_eq!((scan.columns(), scan.colours()), (Some(2), None));
    assert!(scan.points()[0].iter().all(|value| value.is_nan()));
    assert_eq!(scan.points()[1], Point3::new(0.25, 0.0, 0.5));
    let far = f64::from(65.535_f32);
    assert_eq!(scan.points()[3], Point3::new(far / 2.0, far / 4.0, far));
}

#[test]
fn what_does_not_fit_is_refused() {
    let image = render(|_, _| 0.5);
    let scan = scan(&image);
    let ok = no_table();
    assert!(find_object(&scan, &[], &ok).is_ok());
    let is_refused = |options: ObjectOptions| {
        let result = find_object(&scan, &[], &options);
        matches!(result, Err(Error::OutOfRange { .. }))
    };
    assert!(
        is_refused(ok.with_table_clearance(f64::NAN).with_arm_clearance(0.0))
            && is_refused(ok.with_table_clearance(0.0).with_arm_clearance(-1.0))
    );
    assert!(
        is_refused(ok.with_max_incidence(1.6).with_noise(0.0))
            && is_refused(ok.with_max_incidence(0.0).with_noise(0.0))
    );
    assert!(is_refused(
        ok.with_max_incidence(1.0).with_noise(f64::INFINITY)
    ));
    assert!(is_refused(ok.with_table((Vector3::z_axis(), f64::NAN))));
    let nan = Capsule {
        start: Point3::origin(),
        end: Point3::new(0.0, f64::NAN, 0.0),
        radius: 0.1,
    };
    let negative = Capsule {
        end: Point3::origin(),
        radius: -0.1,
        ..nan
    };
    let good = Capsule {
        radius: 0.1,
        ..negative
    };
    assert!(matches!(
        find_object(&scan, &[good, nan], &ok),
        Err(Error::NonFinitePoint { index: 1, .. })
    ));
    assert!(matches!(
        find_object(&scan, &[negative], &ok),
        Err(Error::OutOfRange { .. })
    ));
    let other = Intrinsics::new(3, 4, [1.0; 2], [0.0; 2]).unwrap();
    assert!(matches!(
        Scan::from_image(&image, &other),
        Err(Error::ImageSize { .. })
    ));
    assert!(matches!(
        DepthImage::from_metres(3, 3, &[1.0; 8]),
        Err(Error::ImageSize { length: 8, .. })
    ));
    assert!(DepthImage::from_metres(usize::MAX, 2, &[1.0; 8]).is_err());
    assert!(DepthImage::from_units(1, 1, &[1], 0.0).is_err());
    assert!(Intrinsics::new(1, 1, [0.0, 1.0], [0.0; 2]).is_err());
    assert!(Intrinsics::new(1, 1, [1.0; 2], [f64::NAN, 0.0]).is_err());
    assert!(Intrinsics::from_k(1, 1, &[1.0, 0.1, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]).is_err());
}

#[test]
fn camera_matrix_in_the_order_of_camera_info() {
    let k = [200.0, 0.0, 79.5, 0.0, 210.0, 60.25, 0.0, 0.0, 1.0];
    assert_eq!(Intrinsics::from_k(WIDTH, HEIGHT, &k).unwrap(), camera());
}

#[test]
fn a_capsule_without_length_is_a_ball() {
    let center = Point3::new(0.1, 0.2, 0.3);
    let capsule = Capsule {
        start: center,
        end: center,
        radius: 0.5,
    };
    assert!((capsule.distance(&Point3::new(0.1, 0.2, 1.3)) - 0.5).abs() < 1e-15);
    assert!((capsule.distance(&center) + 0.5).abs() < 1e-15);
}

proptest! {
    #[test]
    fn projection_undoes_back_projection(u in -100.0..300.0, v in -100.0..300.0, depth in 0.01..10.0) {
        let point = camera().back_project(u, v, depth);
        let [x, y] = camera().project(&point).unwrap();
        prop_assert!((x - u).abs() < 1e-10 && (y - v).abs() < 1e-10 && point.z == depth);
        prop_assert_eq!(camera().project(&Point3::new(0.0, 0.0, -depth)), None);
    }

    #[test]
    fn distance_to_a_capsule_is_the_least_over_its_axis(
        ends in prop::array::uniform6(-1.0..1.0), at in prop::array::uniform3(-1.0..1.0),
    ) {
        let [a, b, c, d, e, f] = ends;
        let capsule = Capsule { start: Point3::new(a, b, c), end: Point3::new(d, e, f), radius: 0.1 };
        let point = Point3::from(at);
        let on_axis = |step: i32| capsule.start + (capsule.end - capsule.start) * (f64::from(step) / 1000.0);
        let slow = (0..=1000).map(|step| (point - on_axis(step)).norm()).fold(f64::INFINITY, f64::min) - 0.1;
        // Half a step of the slow search is at most √12/2000 along the axis: under 2 mm of distance.
        prop_assert!(capsule.distance(&point) <= slow + 1e-12 && slow - capsule.distance(&point) < 2e-3);
    }

    #[test]
    fn any_image_is_accounted_for(
        depths in prop::collection::vec(prop_oneof![0.5_f32..1.5, 0.5_f32..1.5, any::<f32>()], 35),
        noise in 0.0..1.0,
    ) {
        let image = DepthImage::from_metres(7, 5, &depths)?;
        let camera = Intrinsics::new(7, 5, [5.0, 6.0], [3.0, 2.0])?;
        let scan = Scan::from_image(&image, &camera)?;
        let arm = Capsule { start: Point3::origin(), end: Point3::new(0.0, 0.0, 1.0), radius: 0.1 };
        let options = ObjectOptions::default()
            .with_table((-Vector3::z_axis(), 1e10))
            .with_max_incidence(1.0).with_noise(noise)
            .with_voxel(0.2)
            .with_gap(0.5).with_support(2);
        match find_object(&scan, &[arm], &options) {
            Ok(object) => every_pixel_is_accounted_for(&scan, &object),
            Err(error) => prop_assert!(matches!(error, Error::NoObject { .. }), "{error}"),
        }
    }
}
