//! Bodies with known results, for several test files.
#![allow(missing_docs, dead_code, clippy::unwrap_used)]

use explore_loop::canonical::{CanonicalModel, NewVertex};
use explore_loop::cell::Observation;
use nalgebra::{Matrix3, Point3, Rotation3, UnitVector3, Vector3};
use proptest::prelude::*;

pub type Normal = UnitVector3<f64>;

/// A frame with these points of the object and nothing else.
pub fn observation(points: Vec<Point3<f64>>) -> Observation {
    Observation {
        stamp: 0.0,
        camera: None,
        points,
        colours: None,
        features: None,
        arms: Vec::new(),
    }
}

/// Fibonacci points on an ellipsoid, with exact normals.
pub fn ellipsoid(count: usize, axes: [f64; 3]) -> (Vec<Point3<f64>>, Vec<Normal>) {
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    (0..count)
        .map(|i| {
            let z = 1.0 - 2.0 * (i as f64 + 0.5) / count as f64;
            let r = (1.0 - z * z).sqrt();
            let (s, c) = (golden * i as f64).sin_cos();
            let d = Vector3::new(r * c, r * s, z);
            let axes = Vector3::from(axes);
            let p = Point3::from(d.component_mul(&axes));
            (p, Normal::new_normalize(d.component_div(&axes)))
        })
        .unzip()
}

/// Half axes of the body in most tests, metres, and the spacing of 1,000 points on it.
pub const AXES: [f64; 3] = [0.06, 0.045, 0.03];
pub const COUNT: usize = 1000;
pub const SPACING: f64 = 5e-3;

pub fn at_rest(points: &[Point3<f64>], normals: &[Normal]) -> CanonicalModel {
    let mut model = CanonicalModel::default();
    for (p, n) in points.iter().zip(normals) {
        let vertex = NewVertex {
            rest: *p,
            rest_normal: *n,
            live: *p,
            rotation: Matrix3::identity(),
        };
        model.push(vertex, 0);
    }
    model
}

/// Any rotation: an axis-angle vector no longer than half a turn.
pub fn rotation() -> impl Strategy<Value = Rotation3<f64>> {
    (
        [-1.0..1.0, -1.0..1.0, -1.0..1.0f64],
        0.0..std::f64::consts::PI,
    )
        .prop_filter_map("an axis", |(axis, angle)| {
            let axis = Normal::try_new(Vector3::from(axis), 1e-3)?;
            Some(Rotation3::from_axis_angle(&axis, angle))
        })
}

/// A maximal net of the surface `value = 0` inside a box: points at least `gap` apart within a sheet, with their normals.
pub fn net(
    value: impl Fn(&Point3<f64>) -> f64,
    half: Vector3<f64>,
    gap: f64,
) -> (Vec<Point3<f64>>, Vec<Normal>) {
    let gradient = |p: &Point3<f64>| {
        Vector3::from_fn(|k, _| {
            let e = Vector3::ith(k, 1e-6);
            (value(&(p + e)) - value(&(p - e))) / 2e-6
        })
    };
    // A little off any round number, so that no lattice plane lies in a flat side.
    let pitch = 0.37 * gap;
    let count = half.map(|h| (h / pitch).ceil() as i32 + 2);
    let (mut points, mut normals): (Vec<Point3<f64>>, Vec<Normal>) = (Vec::new(), Vec::new());
    for i in -count.x..=count.x {
        for j in -count.y..=count.y {
            for k in -count.z..=count.z {
                let mut p = Point3::new(f64::from(i), f64::from(j), f64::from(k)) * pitch;
                if value(&p).abs() > pitch {
                    continue;
                }
                for _ in 0..5 {
                    let g = gradient(&p);
                    p -= g * (value(&p) / g.norm_squared().max(1e-9));
                }
                let normal = Normal::new_normalize(gradient(&p));
                let taken =
                    |(q, n): (&Point3<f64>, &Normal)| (p - q).norm() < gap && normal.dot(n) > 0.0;
                if !points.iter().zip(&normals).any(taken) {
                    points.push(p);
                    normals.push(normal);
                }
            }
        }
    }
    (points, normals)
}

pub mod fake;
