//! One point of a surface, uniform by area, with its normal.

use super::Manifold;
use super::shape::{pretzel_parts, turned_half_circle};
use nalgebra::{Point3, UnitVector3, Vector3};
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use std::f64::consts::{FRAC_1_SQRT_2, FRAC_PI_2, PI, SQRT_2, TAU};
use std::ops::Range;

/// A point and its outward unit normal.
pub(super) type Sample = (Point3<f64>, UnitVector3<f64>);

/// Outer half of a tube.
const OUTER: Range<f64> = -FRAC_PI_2..FRAC_PI_2;
/// Inner half of a tube.
const INNER: Range<f64> = FRAC_PI_2..3.0 * FRAC_PI_2;

impl Manifold {
    pub(super) fn sample(&self, rng: &mut ChaCha8Rng) -> Sample {
        match *self {
            Self::Sphere { radius } => on_sphere(rng, radius, -1.0),
            Self::Cap { radius, angle } => on_sphere(rng, radius, angle.cos()),
            Self::Ellipsoid { axes } => on_ellipsoid(rng, axes),
            Self::Torus { major, minor } => on_torus(rng, major, minor, -PI..PI),
            Self::Genus2 { hole, web, tube } => on_pretzel(rng, hole, web, tube),
            Self::Plate { radius, thickness } => {
                let half = 0.5 * thickness;
                if rng.random::<f64>() * self.area() < turned_half_circle(radius, half) {
                    return on_torus(rng, radius, half, OUTER);
                }
                let (point, _) = on_ring(rng, 0.0, radius);
                on_face(rng, point, half)
            }
            Self::TwoSpheres { radius, gap } => {
                let offset = side(rng) * (radius + 0.5 * gap);
                let (point, normal) = on_sphere(rng, radius, -1.0);
                (point + Vector3::x() * offset, normal)
            }
            Self::Disc { radius } => on_ring(rng, 0.0, radius),
            Self::Annulus { inner, outer } => on_ring(rng, inner, outer),
            Self::Tube { radius, length } => {
                let (sin, cos) = rng.random_range(0.0..TAU).sin_cos();
                let z = (rng.random::<f64>() - 0.5) * length;
                let normal = Vector3::new(cos, sin, 0.0);
                oriented(Point3::from(normal * radius + Vector3::z() * z), normal)
            }
            Self::PinchedSphere { radius } => on_pinched(rng, radius),
            Self::CrossingSheets { radius } => {
                let (point, normal) = on_ring(rng, 0.0, radius);
                if rng.random::<bool>() {
                    return (point, normal);
                }
                (Point3::new(0.0, point.y, point.x), Vector3::x_axis())
            }
            Self::TJunction { radius } => {
                // The wall is one fifth of the area.
                if rng.random::<f64>() < 0.2 {
                    return on_ring(rng, 0.0, radius);
                }
                on_sphere(rng, radius, -1.0)
            }
        }
    }
}

fn oriented(point: Point3<f64>, normal: Vector3<f64>) -> Sample {
    (point, UnitVector3::new_normalize(normal))
}

fn side(rng: &mut ChaCha8Rng) -> f64 {
    if rng.random::<bool>() { 1.0 } else { -1.0 }
}

/// A point of the plane z = 0, lifted to one of two faces at ±`half`.
fn on_face(rng: &mut ChaCha8Rng, point: Point3<f64>, half: f64) -> Sample {
    let up = Vector3::z() * side(rng);
    oriented(point + up * half, up)
}

/// Uniform on the part of a sphere with `z/radius` above `lowest` (Archimedes: z is uniform).
fn on_sphere(rng: &mut ChaCha8Rng, radius: f64, lowest: f64) -> Sample {
    let z = lowest + (1.0 - lowest) * rng.random::<f64>();
    let (sin, cos) = rng.random_range(0.0..TAU).sin_cos();
    let ring = (1.0 - z * z).max(0.0).sqrt();
    let normal = Vector3::new(ring * cos, ring * sin, z);
    oriented(Point3::from(normal * radius), normal)
}

/// Uniform on the sphere, kept with the probability by which the stretched area element exceeds its bound.
fn on_ellipsoid(rng: &mut ChaCha8Rng, axes: [f64; 3]) -> Sample {
    let stretch = Vector3::from(axes);
    let shrink = stretch.map(|a| 1.0 / a);
    let bound = shrink.max();
    loop {
        let (_, direction) = on_sphere(rng, 1.0, -1.0);
        let normal = direction.component_mul(&shrink);
        if rng.random::<f64>() * bound < normal.norm() {
            return oriented(Point3::from(direction.component_mul(&stretch)), normal);
        }
    }
}

/// Uniform on the part of a torus whose angle around the tube, from the outermost circle, lies in `angles`.
fn on_torus(rng: &mut ChaCha8Rng, major: f64, minor: f64, angles: Range<f64>) -> Sample {
    loop {
        let angle = rng.random_range(angles.clone());
        let distance = major + minor * angle.cos();
        if rng.random::<f64>() * (major + minor) < distance {
            let (sin, cos) = rng.random_range(0.0..TAU).sin_cos();
            let normal = Vector3::new(angle.cos() * cos, angle.cos() * sin, angle.sin());
            let point = Point3::new(distance * cos, distance * sin, minor * angle.sin());
            return oriented(point, normal);
        }
    }
}

fn on_ring(rng: &mut ChaCha8Rng, inner: f64, outer: f64) -> Sample {
    let squared = inner * inner + (outer * outer - inner * inner) * rng.random::<f64>();
    let (sin, cos) = rng.random_range(0.0..TAU).sin_cos();
    oriented(Point3::new(cos, sin, 0.0) * squared.sqrt(), Vector3::z())
}

/// Picks a part by its area, then a point of it.
fn on_pretzel(rng: &mut ChaCha8Rng, hole: f64, web: f64, tube: f64) -> Sample {
    let [faces, straight, ends, holes] = pretzel_parts(hole, web, tube);
    let (end, half) = (hole + web, hole + 0.5 * web);
    let drawn = rng.random::<f64>() * (faces + straight + ends + holes);
    if drawn < faces {
        let point = in_strip(rng, hole, half, end);
        return on_face(rng, point, tube);
    }
    if drawn < faces + straight {
        let out = side(rng);
        let (sin, cos) = rng.random_range(OUTER).sin_cos();
        let normal = Vector3::new(0.0, out * cos, sin);
        let foot = Point3::new(rng.random_range(-half..half), out * end, 0.0);
        return oriented(foot + normal * tube, normal);
    }
    let (point, normal, right) = if drawn < faces + straight + ends {
        let (point, normal) = on_torus(rng, end, tube, OUTER);
        (point, normal, point.x.signum())
    } else {
        let (point, normal) = on_torus(rng, hole, tube, INNER);
        (point, normal, side(rng))
    };
    (point + Vector3::x() * (right * half), normal)
}

/// Uniform in the strip of the pretzel: drawn in its bounding rectangle until neither outside nor in a hole.
fn in_strip(rng: &mut ChaCha8Rng, hole: f64, half: f64, end: f64) -> Point3<f64> {
    loop {
        let x = rng.random_range(-(half + end)..half + end);
        let y = rng.random_range(-end..end);
        let beyond = (x.abs() - half).max(0.0).hypot(y);
        if beyond <= end && (x.abs() - half).hypot(y) >= hole {
            return Point3::new(x, y, 0.0);
        }
    }
}

/// A cone of the pinched sphere has the area `πR²/√2`, a cap `πR²(2 + √2)`.
fn on_pinched(rng: &mut ChaCha8Rng, radius: f64) -> Sample {
    let up = side(rng);
    let (point, normal) = if rng.random::<f64>() * (4.0 + 3.0 * SQRT_2) < SQRT_2 {
        // On a cone the area within a slant length grows with its square.
        let slant = radius * rng.random::<f64>().sqrt();
        let (sin, cos) = rng.random_range(0.0..TAU).sin_cos();
        let direction = Vector3::new(cos, sin, 1.0) * FRAC_1_SQRT_2;
        let normal = Vector3::new(cos, sin, -1.0);
        oriented(Point3::from(direction * slant), normal)
    } else {
        let (point, normal) = on_sphere(rng, radius, -FRAC_1_SQRT_2);
        (point + Vector3::z() * (SQRT_2 * radius), normal)
    };
    let mirror = Vector3::new(1.0, 1.0, up);
    oriented(
        Point3::from(point.coords.component_mul(&mirror)),
        normal.component_mul(&mirror),
    )
}
