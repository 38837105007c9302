//! Where the hidden side is: the missing vector area of partly seen bodies.
#![allow(missing_docs, clippy::unwrap_used, reason = "tests")]

use std::f64::consts::{PI, TAU};

use grip_planner::nalgebra::{Point3, UnitQuaternion, UnitVector3, Vector3};
use grip_planner::{Model, missing_vector_area};
use parry3d_f64::math::Vector;
use parry3d_f64::query::{Ray, RayCast};
use parry3d_f64::shape::{TriMesh, TriMeshFlags};
use parry3d_f64::transformation::convex_hull;
use proptest::prelude::*;
use rand_noise::Noise;

/// What the docs of `missing_vector_area` promise with normals off by 10° and areas off by 20 %, degrees.
const PROMISED: f64 = 5.0;
/// The same for spheres, whose samples are even.
const ON_SPHERES: f64 = 3.0;

/// A closed surface as triangles; each is a sample with its own area and normal.
#[derive(Clone)]
struct Mesh {
    points: Vec<Point3<f64>>,
    triangles: Vec<[u32; 3]>,
}

impl std::fmt::Debug for Mesh {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Mesh of {} triangles", self.triangles.len())
    }
}

impl Mesh {
    /// A grid of `u` × `v` that closes in both directions, mapped by `at`.
    fn wrapped(u: u32, v: u32, at: impl Fn(f64, f64) -> Point3<f64>) -> Self {
        let index = |i: u32, j: u32| (i % u) * v + j % v;
        let angle = |k: u32, of: u32| TAU * f64::from(k) / f64::from(of);
        let mut mesh = Self {
            points: Vec::new(),
            triangles: Vec::new(),
        };
        for i in 0..u {
            for j in 0..v {
                mesh.points.push(at(angle(i, u), angle(j, v)));
                mesh.triangles
                    .push([index(i, j), index(i + 1, j), index(i + 1, j + 1)]);
                mesh.triangles
                    .push([index(i, j), index(i + 1, j + 1), index(i, j + 1)]);
            }
        }
        mesh
    }

    fn torus(large: f64, small: f64) -> Self {
        Self::wrapped(60, 30, |a, b| {
            let r = large + small * b.cos();
            Point3::new(r * a.cos(), r * a.sin(), small * b.sin())
        })
    }

    fn hull(points: &[Point3<f64>]) -> Self {
        let points: Vec<Vector> = points.iter().map(|p| p.coords.into()).collect();
        let (points, triangles) = convex_hull(&points);
        let points = points.iter().map(|p| Point3::new(p.x, p.y, p.z)).collect();
        Self { points, triangles }
    }

    /// Even points on a ball, stretched.
    fn ellipsoid(half: [f64; 3]) -> Self {
        let golden = PI * (3.0 - 5f64.sqrt());
        let point = |i: u32| {
            let z = 1.0 - (2.0 * f64::from(i) + 1.0) / 900.0;
            let (sin, cos) = (golden * f64::from(i)).sin_cos();
            let r = (1.0 - z * z).sqrt();
            Point3::new(r * cos * half[0], r * sin * half[1], z * half[2])
        };
        Self::hull(&(0..900).map(point).collect::<Vec<_>>())
    }

    /// The hull of two stretched balls: convex, and like neither.
    fn lump(first: [f64; 3], second: [f64; 3], apart: [f64; 3]) -> Self {
        let mut points = Self::ellipsoid(first).points;
        let shift = Vector3::from(apart);
        points.extend(Self::ellipsoid(second).points.iter().map(|p| p + shift));
        Self::hull(&points)
    }

    fn vector_area(&self, t: &[u32; 3]) -> Vector3<f64> {
        let [a, b, c] = t.map(|v| self.points[v as usize]);
        (b - a).cross(&(c - a)) / 2.0
    }

    fn middle(&self, t: &[u32; 3]) -> Point3<f64> {
        Point3::from(
            t.iter()
                .map(|&v| self.points[v as usize].coords)
                .sum::<Vector3<f64>>()
                / 3.0,
        )
    }

    /// Whether a camera in this direction, far away, sees each triangle: it faces the camera and nothing lies before it.
    fn seen(&self, toward_camera: &UnitVector3<f64>) -> Vec<bool> {
        let points: Vec<Vector> = self.points.iter().map(|p| p.coords.into()).collect();
        let solid =
            TriMesh::with_flags(points, self.triangles.clone(), TriMeshFlags::empty()).unwrap();
        let free = |t: &[u32; 3]| {
            let start = self.middle(t) + toward_camera.as_ref() * 1e-6;
            let ray = Ray::new(start.coords.into(), toward_camera.into_inner().into());
            solid.cast_local_ray(&ray, 100.0, true).is_none()
        };
        let sees = |t: &[u32; 3]| self.vector_area(t).dot(toward_camera) > 0.0 && free(t);
        self.triangles.iter().map(sees).collect()
    }

    fn missing(&self, seen: &[bool], noise: Option<u64>) -> Vector3<f64> {
        let mut noise = noise.map(Noise::new);
        let (mut points, mut normals, mut areas) = (vec![], vec![], vec![]);
        for (t, _) in self.triangles.iter().zip(seen).filter(|(_, seen)| **seen) {
            let area = self.vector_area(t);
            let off = noise
                .as_mut()
                .map_or(Vector3::zeros(), |n| n.vector(10f64.to_radians()));
            points.push(self.middle(t));
            normals.push(UnitQuaternion::new(off) * UnitVector3::new_normalize(area));
            areas.push(area.norm() * noise.as_mut().map_or(1.0, |n| 1.0 + n.number(0.2)));
        }
        let no = vec![false; points.len()];
        missing_vector_area(&Model {
            points: &points,
            normals: &normals,
            areas: &areas,
            edges: &[],
            boundary: &no,
            visible: &no,
            hidden: &[],
        })
    }

    /// Area-weighted sum of the normals of what is not seen: where the hidden side faces.
    fn hidden(&self, seen: &[bool]) -> Vector3<f64> {
        let hidden = self.triangles.iter().zip(seen).filter(|(_, seen)| !**seen);
        hidden.map(|(t, _)| self.vector_area(t)).sum()
    }

    fn area(&self) -> f64 {
        self.triangles
            .iter()
            .map(|t| self.vector_area(t).norm())
            .sum()
    }
}

/// Noise with a seed, without a dependency (Steele, Lea and Flood 2014, SplitMix64).
mod rand_noise {
    use grip_planner::nalgebra::Vector3;

    pub struct Noise(u64);

    impl Noise {
        pub fn new(seed: u64) -> Self {
            Self(seed)
        }

        /// Uniform in ±`size`.
        pub fn number(&mut self, size: f64) -> f64 {
            self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let mut z = self.0;
            z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            z ^= z >> 31;
            size * (2.0 * (z >> 11) as f64 / (1u64 << 53) as f64 - 1.0)
        }

        /// Uniform in a cube of half side `size`.
        pub fn vector(&mut self, size: f64) -> Vector3<f64> {
            Vector3::new(self.number(size), self.number(size), self.number(size))
        }
    }
}

fn direction() -> impl Strategy<Value = UnitVector3<f64>> {
    prop::array::uniform3(-1.0..1.0).prop_filter_map("a direction", |d| {
        UnitVector3::try_new(Vector3::from(d), 0.2)
    })
}

/// Spheres, tori, stretched spheres, hulls of random points and of two stretched spheres.
fn mesh() -> impl Strategy<Value = Mesh> {
    let corners = prop::collection::vec(
        prop::array::uniform3(-1.0..1.0).prop_map(Point3::from),
        12..60,
    );
    prop_oneof![
        (0.5..2.0).prop_map(|r| Mesh::ellipsoid([r; 3])),
        (0.5..1.0, 0.1..0.4).prop_map(|(large, small)| Mesh::torus(large, small)),
        prop::array::uniform3(0.3..1.0).prop_map(Mesh::ellipsoid),
        corners.prop_map(|points| Mesh::hull(&points)),
        (
            prop::array::uniform3(0.3..1.0),
            prop::array::uniform3(0.2..0.8),
            prop::array::uniform3(-0.8..0.8)
        )
            .prop_map(|(first, second, apart)| Mesh::lump(first, second, apart)),
    ]
}

fn degrees(a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
    a.angle(b).to_degrees()
}

proptest! {
    #[test]
    fn nothing_is_missing_from_a_closed_surface(mesh in mesh()) {
        let all = vec![true; mesh.triangles.len()];
        prop_assert!(mesh.missing(&all, None).norm() < 1e-12 * mesh.area());
    }

    #[test]
    fn it_is_the_vector_area_of_what_is_hidden(mesh in mesh(), camera in direction()) {
        let seen = mesh.seen(&camera);
        let (missing, hidden) = (mesh.missing(&seen, None), mesh.hidden(&seen));
        prop_assert!((missing - hidden).norm() < 1e-12 * mesh.area());
        // Its length is at most the hidden area.
        let area: f64 = mesh.triangles.iter().zip(&seen).filter(|(_, s)| !**s).map(|(t, _)| mesh.vector_area(t).norm()).sum();
        prop_assert!(missing.norm() <= area * (1.0 + 1e-12));
    }

    #[test]
    fn it_points_away_from_the_camera(mesh in mesh(), camera in direction()) {
        // Its component along the view is the area of the shadow of what is seen.
        let seen = mesh.seen(&camera);
        prop_assert!(mesh.missing(&seen, None).dot(&camera) < 0.0);
    }

    #[test]
    fn noise_of_normals_and_areas_turns_it_little(mesh in mesh(), camera in direction(), seed in 0u64..1000) {
        let seen = mesh.seen(&camera);
        // The promise is for models, which have hundreds of vertices; hulls of a few dozen points have not.
        prop_assume!(seen.iter().filter(|s| **s).count() >= 300);
        let angle = degrees(&mesh.missing(&seen, Some(seed)), &mesh.hidden(&seen));
        prop_assert!(angle < PROMISED, "{angle}");
    }

    #[test]
    fn half_seen_spheres_hide_what_is_opposite(radius in 0.2..3.0, camera in direction(), seed in 0u64..1000) {
        let mesh = Mesh::ellipsoid([radius; 3]);
        let seen = mesh.seen(&camera);
        let opposite = -camera.into_inner();
        prop_assert!(degrees(&mesh.missing(&seen, Some(seed)), &opposite) < ON_SPHERES);
        // As much as the shadow, a disc; the quadrature of 1,800 triangles is good to a few per cent at the rim.
        let disc = PI * radius * radius;
        prop_assert!((mesh.missing(&seen, None).norm() / disc - 1.0).abs() < 0.05);
    }
}
