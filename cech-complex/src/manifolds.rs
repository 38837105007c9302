//! Surfaces with exact normals and known Betti numbers, sampled with a seed (feature `manifolds`).
//!
//! [`Manifold::uniform`] draws points uniformly by area, with the clumps and gaps of chance: about `√(ln n)` spacings between a
//! point of the surface and its nearest sample. [`Manifold::net`] thins twelve times as many to an ε-net by farthest-point insertion (Gonzalez 1985),
//! which leaves gaps of one spacing or less. The spacing is `√(area/n)` throughout.

use nalgebra::{Point3, Rotation3, UnitVector3, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::{PI, TAU};

/// Uniform samples per point of a net.
const OVERSAMPLING: usize = 12;

/// A surface in space; all lengths in m.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Manifold {
    /// Sphere around the origin.
    Sphere {
        /// Its radius.
        radius: f64,
    },
    /// Ellipsoid around the origin.
    Ellipsoid {
        /// Semi-axes along x, y, z.
        axes: [f64; 3],
    },
    /// Torus around the z axis.
    Torus {
        /// Radius of the core circle.
        major: f64,
        /// Radius of the tube.
        minor: f64,
    },
    /// Flat disc in the plane z = 0.
    Disc {
        /// Its radius.
        radius: f64,
    },
    /// Flat ring in the plane z = 0.
    Annulus {
        /// Inner radius.
        inner: f64,
        /// Outer radius.
        outer: f64,
    },
    /// Cylinder mantle around the z axis, open at both ends.
    Tube {
        /// Its radius.
        radius: f64,
        /// Its length.
        length: f64,
    },
    /// Part of a sphere around its north pole.
    Cap {
        /// Radius of the sphere.
        radius: f64,
        /// Angle from the pole to the rim, rad.
        angle: f64,
    },
    /// Two equal spheres side by side along x.
    TwoSpheres {
        /// Radius of each.
        radius: f64,
        /// Clear distance between them.
        gap: f64,
    },
    /// Closed disc-shaped plate with a rounded edge, normal to z.
    Plate {
        /// Radius of its flat faces.
        radius: f64,
        /// Distance between them.
        thickness: f64,
    },
}

/// A sampled surface.
#[derive(Debug, Clone, PartialEq)]
pub struct OrientedCloud {
    /// Points, m.
    pub points: Vec<Point3<f64>>,
    /// Outward unit normals.
    pub normals: Vec<UnitVector3<f64>>,
    /// `√(area/n)`, m.
    pub spacing: f64,
}

type Sample = (Point3<f64>, UnitVector3<f64>);

impl Manifold {
    /// Area of the surface, m² (of the ellipsoid by quadrature, to about 1e-6).
    pub fn area(&self) -> f64 {
        match *self {
            Self::Sphere { radius } => 4.0 * PI * radius * radius,
            Self::Ellipsoid { axes } => ellipsoid_area(axes),
            Self::Torus { major, minor } => TAU * major * TAU * minor,
            Self::Disc { radius } => PI * radius * radius,
            Self::Annulus { inner, outer } => PI * (outer * outer - inner * inner),
            Self::Tube { radius, length } => TAU * radius * length,
            Self::Cap { radius, angle } => TAU * radius * radius * (1.0 - angle.cos()),
            Self::TwoSpheres { radius, .. } => 8.0 * PI * radius * radius,
            Self::Plate { radius, thickness } => {
                TAU * radius * radius + rim_area(radius, 0.5 * thickness)
            }
        }
    }

    /// Betti numbers `β₀, β₁, β₂`.
    pub fn betti(&self) -> [usize; 3] {
        match self {
            Self::Sphere { .. } | Self::Ellipsoid { .. } | Self::Plate { .. } => [1, 0, 1],
            Self::Torus { .. } => [1, 2, 1],
            Self::Disc { .. } | Self::Cap { .. } => [1, 0, 0],
            Self::Annulus { .. } | Self::Tube { .. } => [1, 1, 0],
            Self::TwoSpheres { .. } => [2, 0, 2],
        }
    }

    /// Number of boundary curves.
    pub fn boundary_components(&self) -> usize {
        match self {
            Self::Disc { .. } | Self::Cap { .. } => 1,
            Self::Annulus { .. } | Self::Tube { .. } => 2,
            _ => 0,
        }
    }

    /// `count` points, independent and uniform by area.
    pub fn uniform(&self, count: usize, seed: u64) -> OrientedCloud {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let (points, normals) = (0..count).map(|_| self.sample(&mut rng)).unzip();
        OrientedCloud {
            points,
            normals,
            spacing: self.spacing(count),
        }
    }

    /// `count` points of an ε-net: each is the point farthest from all before it among twelve times as many uniform ones.
    pub fn net(&self, count: usize, seed: u64) -> OrientedCloud {
        let dense = self.uniform(OVERSAMPLING * count, seed);
        let chosen = farthest_points(&dense.points, count);
        OrientedCloud {
            points: chosen.iter().map(|&i| dense.points[i]).collect(),
            normals: chosen.iter().map(|&i| dense.normals[i]).collect(),
            spacing: self.spacing(count),
        }
    }

    fn spacing(&self, count: usize) -> f64 {
        (self.area() / count.max(1) as f64).sqrt()
    }

    fn sample(&self, rng: &mut ChaCha8Rng) -> Sample {
        match *self {
            Self::Sphere { radius } => on_sphere(rng, radius, -1.0),
            Self::Cap { radius, angle } => on_sphere(rng, radius, angle.cos()),
            Self::Ellipsoid { axes } => on_ellipsoid(rng, axes),
            Self::Torus { major, minor } => on_torus(rng, major, minor, PI),
            Self::Disc { radius } => on_ring(rng, 0.0, radius),
            Self::Annulus { inner, outer } => on_ring(rng, inner, outer),
            Self::Tube { radius, length } => {
                let (sin, cos) = rng.random_range(0.0..TAU).sin_cos();
                let z = (rng.random::<f64>() - 0.5) * length;
                oriented(
                    Point3::new(radius * cos, radius * sin, z),
                    Vector3::new(cos, sin, 0.0),
                )
            }
            Self::TwoSpheres { radius, gap } => {
                let side = if rng.random::<bool>() { 1.0 } else { -1.0 };
                let (point, normal) = on_sphere(rng, radius, -1.0);
                (point + Vector3::x() * (side * (radius + 0.5 * gap)), normal)
            }
            Self::Plate { radius, thickness } => {
                let half = 0.5 * thickness;
                if rng.random::<f64>() * self.area() < rim_area(radius, half) {
                    return on_torus(rng, radius, half, 0.5 * PI);
                }
                let side = if rng.random::<bool>() { 1.0 } else { -1.0 };
                let (point, _) = on_ring(rng, 0.0, radius);
                oriented(point + Vector3::z() * (side * half), Vector3::z() * side)
            }
        }
    }
}

impl OrientedCloud {
    /// The cloud with Gaussian noise: `offset` (m) along the normals, `tilt` (rad) of the normals.
    #[must_use]
    pub fn with_noise(mut self, offset: f64, tilt: f64, seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        for (point, normal) in self.points.iter_mut().zip(&mut self.normals) {
            *point += normal.scale(offset * gaussian(&mut rng));
            let across = Vector3::from_fn(|_, _| gaussian(&mut rng)) * tilt;
            let across = across - normal.scale(normal.dot(&across));
            *normal = Rotation3::new(normal.cross(&across)) * *normal;
        }
        self
    }
}

/// Greedy ε-net: indices of `count` points, the first one first, then always the point farthest from those chosen.
pub fn farthest_points(points: &[Point3<f64>], count: usize) -> Vec<usize> {
    let mut distance = vec![f64::INFINITY; points.len()];
    let mut chosen = Vec::with_capacity(count.min(points.len()));
    let mut next = 0;
    while chosen.len() < count.min(points.len()) {
        chosen.push(next);
        let centre = points[next];
        let mut farthest = (0, -1.0);
        for (i, (point, known)) in points.iter().zip(&mut distance).enumerate() {
            *known = known.min((point - centre).norm_squared());
            if *known > farthest.1 {
                farthest = (i, *known);
            }
        }
        next = farthest.0;
    }
    chosen
}

fn oriented(point: Point3<f64>, normal: Vector3<f64>) -> Sample {
    (point, UnitVector3::new_normalize(normal))
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

/// Uniform on the part of a torus within angle `half_width` of the outermost circle.
fn on_torus(rng: &mut ChaCha8Rng, major: f64, minor: f64, half_width: f64) -> Sample {
    loop {
        let angle = rng.random_range(-half_width..half_width);
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

/// Outer half of a torus: Pappus, with the centroid of a half-circle at `2/π` of its radius.
fn rim_area(major: f64, minor: f64) -> f64 {
    PI * minor * TAU * (major + 2.0 * minor / PI)
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

/// Standard normal (Box and Muller).
fn gaussian(rng: &mut ChaCha8Rng) -> f64 {
    let radius = (-2.0 * (1.0 - rng.random::<f64>()).ln()).sqrt();
    radius * (TAU * rng.random::<f64>()).cos()
}
