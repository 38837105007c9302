//! What the camera sees and hides, against a plane and a sphere.
#![allow(missing_docs, clippy::unwrap_used)]

mod common;

use common::ellipsoid;
use explore_loop::visibility::{DepthGrid, Sight, facing};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use proptest::prelude::*;

/// Depth of the plane and half its width, metres; the cloud's pitch and the bin's.
const DEPTH: f64 = 0.5;
const HALF: f64 = 0.05;
const BIN: f64 = 3e-3;

/// Where the camera is: nothing depends on the frame in which everything is given.
fn camera() -> Isometry3<f64> {
    let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.4, -1.1, 0.7));
    Isometry3::from_parts(Translation3::new(0.3, -0.2, 0.1), turn)
}

/// What lies there in the frame of the camera.
fn at(own: Point3<f64>) -> Point3<f64> {
    camera() * own
}

fn eye() -> Point3<f64> {
    at(Point3::origin())
}

fn plane(scale: f64) -> DepthGrid {
    let points: Vec<_> = (-50..=50)
        .flat_map(|i| (-50..=50).map(move |j| (f64::from(i), f64::from(j))))
        .map(|(x, y)| at(Point3::new(x * 1e-3, y * 1e-3, DEPTH) * scale))
        .collect();
    DepthGrid::new(&points, BIN * scale, &camera()).unwrap()
}

proptest! {
    /// Before a plane a point is contradicted, behind it occluded, near it supported by just its distance; and the
    /// same in a world twice as large.
    #[test]
    fn a_plane_tells_before_from_behind(
        x in -0.04..0.04f64, y in -0.04..0.04f64, off in -0.05..0.05f64, scale in 0.5..2.0f64,
    ) {
        let (front, back) = (0.010, 0.006);
        // Neither verdict is asked for within rounding of its bound.
        prop_assume!((off + front).abs() > 1e-9 && (off - back).abs() > 1e-9);
        // On the ray through (x, y) of the plane.
        let point = Point3::from(Vector3::new(x, y, DEPTH) * ((DEPTH + off) / DEPTH) * scale);
        match plane(scale).sight(&at(point), front * scale, back * scale) {
            Sight::Contradicted => prop_assert!(off < -front),
            Sight::Occluded => prop_assert!(off > back),
            Sight::Supported { behind } => {
                prop_assert!((-front..=back).contains(&off));
                prop_assert!((behind - off * scale).abs() < 1e-12);
            }
            Sight::NoData => prop_assert!(false, "the plane covers this ray"),
        }
    }

    /// Beside the plane there is no data, and its nearest edge is found in the image, at the depth of the point.
    #[test]
    fn beside_a_plane_its_edge_is_nearest(
        side in 0usize..4, along in -0.03..0.03f64, beyond in 0.008..0.05f64,
    ) {
        let grid = plane(1.0);
        let turned = |x: f64, y: f64| match side {
            0 => Point3::new(x, y, DEPTH),
            1 => Point3::new(-x, y, DEPTH),
            2 => Point3::new(y, x, DEPTH),
            _ => Point3::new(y, -x, DEPTH),
        };
        let point = at(turned(HALF + beyond, along));
        prop_assert_eq!(grid.sight(&point, 1.0, 1.0), Sight::NoData);
        let found = grid.nearest_seen(&point, beyond + 2.0 * BIN).unwrap();
        // The middle of the outermost bin, which reaches at most a bin beyond the edge.
        prop_assert!((found - at(turned(HALF, along))).norm() < 1.5 * BIN);
        prop_assert!(((camera().inverse() * found).z - DEPTH).abs() < 1e-12);
        let supported = matches!(grid.sight(&found, 1e-9, 1e-9), Sight::Supported { .. });
        prop_assert!(supported);
        // Rings are whole bins: from two bins short of the edge on it is out of reach.
        prop_assert_eq!(grid.nearest_seen(&point, beyond - 2.5 * BIN), None);
    }

    /// Within the outline the nearest seen place is the point's own bin.
    #[test]
    fn within_the_outline_a_point_is_its_own_nearest(x in -0.04..0.04f64, y in -0.04..0.04f64) {
        let point = at(Point3::new(x, y, DEPTH));
        let found = plane(1.0).nearest_seen(&point, 0.0).unwrap();
        prop_assert!((found - point).norm() <= 0.5 * BIN * 2f64.sqrt() + 1e-12);
    }
}

/// The near side of a sphere is supported, its far side occluded, its middle too; before it the camera looks through.
#[test]
fn a_sphere_hides_its_far_side() {
    let (radius, centre, bin) = (0.04, Vector3::new(0.02, -0.01, 0.5), 1e-3);
    let (points, normals) = ellipsoid(40_000, [radius; 3]);
    let points: Vec<_> = points.iter().map(|p| at(p + centre)).collect();
    let normals: Vec<_> = normals.iter().map(|n| camera().rotation * n).collect();
    let near: Vec<_> = points
        .iter()
        .zip(&normals)
        .filter(|(p, n)| facing(p, n, &eye()) > 0.0)
        .map(|(p, _)| *p)
        .collect();
    let grid = DepthGrid::new(&near, bin, &camera()).unwrap();
    // A bin's depth is that of its nearest point: off by the slope, tan 60° = 1.73 at a facing of 0.5, over the
    // diagonal of two bins.
    let tolerance = 1.73 * 2.0 * bin * 2f64.sqrt();
    for (p, n) in points.iter().zip(&normals) {
        let sight = grid.sight(p, tolerance, tolerance);
        if facing(p, n, &eye()) > 0.5 {
            assert!(matches!(sight, Sight::Supported { .. }), "{p} {sight:?}");
        } else if facing(p, n, &eye()) < -0.5 {
            assert_eq!(sight, Sight::Occluded, "{p}");
        }
    }
    let middle = at(Point3::from(centre));
    assert_eq!(grid.sight(&middle, tolerance, tolerance), Sight::Occluded);
    let before = at(Point3::from(centre * 0.85));
    assert_eq!(
        grid.sight(&before, tolerance, tolerance),
        Sight::Contradicted
    );
}

#[test]
fn behind_the_camera_there_is_nothing() {
    let grid = plane(1.0);
    let behind = at(Point3::new(0.0, 0.0, -DEPTH));
    assert_eq!(grid.sight(&behind, 1.0, 1.0), Sight::NoData);
    assert_eq!(grid.nearest_seen(&behind, 1.0), None);
    assert!(DepthGrid::new(&[], BIN, &camera()).is_none());
    assert!(DepthGrid::new(&[behind], BIN, &camera()).is_none());
}
