//! Areas, boundaries, junctions and distances of the surfaces.
//!
//! Areas of revolution follow from Pappus's theorem: a half-circle of radius `t` has its centroid at `2t/π`, so turned around an axis at distance `R` from its
//! diameter it sweeps `πt·2π(R ± 2t/π) = 2π²Rt ± 4πt²`, outward or inward.

use super::Manifold;
use nalgebra::{Point2, Point3, UnitVector3, Vector3};
use std::f64::consts::{PI, SQRT_2, TAU};

/// A circle in space, the boundary of a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Circle {
    /// Centre, m.
    pub centre: Point3<f64>,
    /// Normal of its plane.
    pub axis: UnitVector3<f64>,
    /// Radius, m.
    pub radius: f64,
}

impl Circle {
    /// Circumference, m.
    pub fn length(&self) -> f64 {
        TAU * self.radius
    }

    /// Distance from a point to the circle, m.
    pub fn distance(&self, y: &Point3<f64>) -> f64 {
        let d = y - self.centre;
        let along = self.axis.dot(&d);
        let across = (d - self.axis.scale(along)).norm();
        (across - self.radius).hypot(along)
    }
}

impl Manifold {
    /// Area of the surface, m² (of the ellipsoid by quadrature, to about 1e-6).
    pub fn area(&self) -> f64 {
        match *self {
            Self::Sphere { radius } => 4.0 * PI * radius * radius,
            Self::Ellipsoid { axes } => ellipsoid_area(axes),
            Self::Torus { major, minor } => TAU * major * TAU * minor,
            Self::Genus2 { hole, web, tube } => pretzel_parts(hole, web, tube).iter().sum(),
            Self::Plate { radius, thickness } => {
                TAU * radius * radius + turned_half_circle(radius, 0.5 * thickness)
            }
            Self::TwoSpheres { radius, .. } => 8.0 * PI * radius * radius,
            Self::Disc { radius } => PI * radius * radius,
            Self::Annulus { inner, outer } => PI * (outer * outer - inner * inner),
            Self::Tube { radius, length } => TAU * radius * length,
            Self::Cap { radius, angle } => TAU * radius * radius * (1.0 - angle.cos()),
            // Two cones of slant R ending in circles of radius R/√2, and two caps of 135°.
            Self::PinchedSphere { radius } => PI * radius * radius * (4.0 + 3.0 * SQRT_2),
            Self::CrossingSheets { radius } => TAU * radius * radius,
            Self::TJunction { radius } => 5.0 * PI * radius * radius,
        }
    }

    /// The boundary circles, longest first.
    pub fn boundary_circles(&self) -> Vec<Circle> {
        let circle = |z: f64, axis: UnitVector3<f64>, radius: f64| Circle {
            centre: Point3::new(0.0, 0.0, z),
            axis,
            radius,
        };
        let up = Vector3::z_axis();
        match *self {
            Self::Disc { radius } => vec![circle(0.0, up, radius)],
            Self::Annulus { inner, outer } => {
                vec![circle(0.0, up, outer), circle(0.0, up, inner)]
            }
            Self::Tube { radius, length } => [0.5, -0.5]
                .map(|end| circle(end * length, up, radius))
                .to_vec(),
            Self::Cap { radius, angle } => {
                vec![circle(radius * angle.cos(), up, radius * angle.sin())]
            }
            Self::CrossingSheets { radius } => [up, Vector3::x_axis()]
                .map(|axis| circle(0.0, axis, radius))
                .to_vec(),
            _ => Vec::new(),
        }
    }

    /// Distance (m) from a point to the boundary; infinite for a closed surface.
    pub fn boundary_distance(&self, y: &Point3<f64>) -> f64 {
        self.boundary_circles()
            .iter()
            .map(|rim| rim.distance(y))
            .fold(f64::INFINITY, f64::min)
    }

    /// Distance (m) from a point to the junction of sheets; infinite for a manifold.
    pub fn junction_distance(&self, y: &Point3<f64>) -> f64 {
        match *self {
            Self::PinchedSphere { .. } => y.coords.norm(),
            Self::CrossingSheets { radius } => {
                (y - Point3::new(0.0, y.y.clamp(-radius, radius), 0.0)).norm()
            }
            Self::TJunction { radius } => Circle {
                centre: Point3::origin(),
                axis: Vector3::z_axis(),
                radius,
            }
            .distance(y),
            _ => f64::INFINITY,
        }
    }

    /// Distance (m) from a point to the surface; for the ellipsoid a lower bound, which is 0 on the surface only.
    pub fn distance(&self, y: &Point3<f64>) -> f64 {
        let from_axis = y.x.hypot(y.y);
        match *self {
            Self::Sphere { radius } => (y.coords.norm() - radius).abs(),
            // The gauge ‖D⁻¹y‖ grows by at most 1/c per metre.
            Self::Ellipsoid { axes } => {
                let gauge = y.coords.component_div(&Vector3::from(axes)).norm();
                (gauge - 1.0).abs() * axes.into_iter().fold(f64::INFINITY, f64::min)
            }
            Self::Torus { major, minor } => ((from_axis - major).hypot(y.z) - minor).abs(),
            Self::Genus2 { hole, web, tube } => {
                (outside_strip(y.xy(), hole, web).hypot(y.z) - tube).abs()
            }
            Self::Plate { radius, thickness } => {
                ((from_axis - radius).max(0.0).hypot(y.z) - 0.5 * thickness).abs()
            }
            Self::TwoSpheres { radius, gap } => {
                let centre = Vector3::x() * (radius + 0.5 * gap);
                let mirrored = Vector3::new(y.x.abs(), y.y, y.z);
                ((mirrored - centre).norm() - radius).abs()
            }
            Self::Disc { radius } => (from_axis - radius).max(0.0).hypot(y.z),
            Self::Annulus { inner, outer } => (from_axis - outer)
                .max(inner - from_axis)
                .max(0.0)
                .hypot(y.z),
            Self::Tube { radius, length } => (y.z.abs() - 0.5 * length)
                .max(0.0)
                .hypot(from_axis - radius),
            Self::Cap { radius, angle } => {
                if from_axis.atan2(y.z) <= angle {
                    (y.coords.norm() - radius).abs()
                } else {
                    (from_axis - radius * angle.sin()).hypot(y.z - radius * angle.cos())
                }
            }
            Self::PinchedSphere { radius } => pinched_profile(from_axis, y.z.abs(), radius),
            Self::CrossingSheets { radius } => {
                let lying = (from_axis - radius).max(0.0).hypot(y.z);
                lying.min((y.y.hypot(y.z) - radius).max(0.0).hypot(y.x))
            }
            Self::TJunction { radius } => {
                let wall = (from_axis - radius).max(0.0).hypot(y.z);
                wall.min((y.coords.norm() - radius).abs())
            }
        }
    }
}

impl Manifold {
    /// Radius of a ball around the origin that holds the surface.
    pub(super) fn extent(&self) -> f64 {
        match *self {
            Self::Sphere { radius }
            | Self::Disc { radius }
            | Self::Cap { radius, .. }
            | Self::CrossingSheets { radius }
            | Self::TJunction { radius } => radius,
            Self::Ellipsoid { axes: [a, b, c] } => a.max(b).max(c),
            Self::Torus { major, minor } => major + minor,
            Self::Genus2 { hole, web, tube } => 2.0 * hole + 1.5 * web + tube,
            Self::Plate { radius, thickness } => radius + 0.5 * thickness,
            Self::TwoSpheres { radius, gap } => 2.0 * radius + 0.5 * gap,
            Self::Annulus { outer, .. } => outer,
            Self::Tube { radius, length } => radius.hypot(0.5 * length),
            Self::PinchedSphere { radius } => (1.0 + SQRT_2) * radius,
        }
    }
}

/// Area of the outer half of a torus.
pub(super) fn turned_half_circle(major: f64, minor: f64) -> f64 {
    TAU * PI * major * minor + 4.0 * PI * minor * minor
}

/// Areas of the pretzel: both faces, straight edges, round ends, edges of both holes.
pub(super) fn pretzel_parts(hole: f64, web: f64, tube: f64) -> [f64; 4] {
    let (end, half) = (hole + web, hole + 0.5 * web);
    let strip = PI * end * end + 4.0 * end * half - TAU * hole * hole;
    [
        2.0 * strip,
        4.0 * half * PI * tube,
        turned_half_circle(end, tube),
        2.0 * (TAU * PI * hole * tube - 4.0 * PI * tube * tube),
    ]
}

/// Distance in the plane from a point to the strip: beyond the outer edge, or inside a hole.
fn outside_strip(y: Point2<f64>, hole: f64, web: f64) -> f64 {
    let half = hole + 0.5 * web;
    let beyond = (y.x.abs() - half).max(0.0).hypot(y.y) - (hole + web);
    let inside = hole - (y.x.abs() - half).hypot(y.y);
    beyond.max(inside).max(0.0)
}

/// Distance in the upper half of a meridian plane to the segment from the origin to `(R, R)/√2` and the arc of 135° that it touches.
fn pinched_profile(from_axis: f64, height: f64, radius: f64) -> f64 {
    let along = ((from_axis + height) / SQRT_2).clamp(0.0, radius);
    let to_cone = (from_axis - along / SQRT_2).hypot(height - along / SQRT_2);
    let (across, above) = (from_axis, height - SQRT_2 * radius);
    // Below the cone over the arc the nearest point of the arc is its end, which also belongs to the segment.
    if above < -across {
        return to_cone;
    }
    to_cone.min((across.hypot(above) - radius).abs())
}

/// Midpoint rule over the unit sphere: the area element is `abc·‖D⁻¹u‖`.
fn ellipsoid_area([a, b, c]: [f64; 3]) -> f64 {
    let (rings, sectors) = (600, 600);
    let mut sum = 0.0;
    for i in 0..rings {
        let z = -1.0 + 2.0 * (f64::from(i) + 0.5) / f64::from(rings);
        let ring = (1.0 - z * z).sqrt();
        for j in 0..sectors {
            let (sin, cos) = (TAU * (f64::from(j) + 0.5) / f64::from(sectors)).sin_cos();
            sum += Vector3::new(ring * cos / a, ring * sin / b, z / c).norm();
        }
    }
    4.0 * PI * a * b * c * sum / (f64::from(rings) * f64::from(sectors))
}
