//! The depth camera: a z-buffer renderer.
//!
//! The camera frame has its origin in the pinhole, +z along the optical axis. A point `(x, y, z)` falls on the image at
//! `(f x/z + w/2, f y/z + h/2)`; a pixel looks along the ray through its centre. Inside a projected triangle `1/z` is linear
//! in the image, so the nearest surface of every pixel follows from three multiplications.

use dvrk_io::depth::DepthImage;
use nalgebra::{Isometry3, Point2, Point3, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::links::Links;
use super::options::{CameraModel, CameraOptions};
use super::realsense::TrueImage;
use crate::cell::Plane;
use crate::cell::noise::normal;

/// Near plane, metres.
const NEAR: f64 = 0.01;

/// Number of sides of the prism that approximates a round shaft.
const SHAFT_SIDES: usize = 10;

/// What a pixel shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Thing {
    Nothing,
    Object,
    /// A body that is not explored.
    Beside,
    Arm,
}

/// An image of inverse depths.
pub(super) struct DepthCamera {
    options: CameraOptions,
    inverse_depth: Vec<f64>,
    thing: Vec<Thing>,
    /// Cosine of the angle between the normal of the visible surface and the ray.
    cosine: Vec<f64>,
    /// The visible triangle, in the mesh that was drawn last.
    triangle: Vec<u32>,
}

impl DepthCamera {
    pub fn new(options: CameraOptions) -> Self {
        let pixels = options.width * options.height;
        Self {
            options,
            inverse_depth: vec![0.0; pixels],
            thing: vec![Thing::Nothing; pixels],
            cosine: vec![1.0; pixels],
            triangle: vec![0; pixels],
        }
    }

    pub fn clear(&mut self) {
        self.inverse_depth.fill(0.0);
        self.thing.fill(Thing::Nothing);
    }

    /// Draws triangles given in the camera frame.
    pub fn draw(&mut self, vertices: &[Point3<f64>], triangles: &[[usize; 3]], thing: Thing) {
        for (index, t) in (0..).zip(triangles) {
            let corners = t.map(|v| vertices[v]);
            if corners.iter().all(|p| p.z >= NEAR) {
                self.fill(corners, thing, index);
            } else {
                let polygon = clip(&corners);
                for k in 2..polygon.len() {
                    self.fill([polygon[0], polygon[k - 1], polygon[k]], thing, index);
                }
            }
        }
    }

    fn project(&self, p: &Point3<f64>) -> Point2<f64> {
        let c = &self.options;
        Point2::new(
            c.focal * p.x / p.z + 0.5 * c.width as f64,
            c.focal * p.y / p.z + 0.5 * c.height as f64,
        )
    }

    fn fill(&mut self, corners: [Point3<f64>; 3], thing: Thing, index: u32) {
        let [a, b, c] = corners.map(|p| self.project(&p));
        let double_area = (b - a).perp(&(c - a));
        if double_area == 0.0 || !double_area.is_finite() {
            return;
        }
        let inverse = corners.map(|p| 1.0 / p.z);
        let normal = (corners[1] - corners[0])
            .cross(&(corners[2] - corners[0]))
            .try_normalize(0.0)
            .unwrap_or_default();
        let range = |low: f64, high: f64, size: usize| {
            let first = (low - 0.5).ceil().max(0.0) as usize;
            let end = ((high - 0.5).floor() + 1.0).clamp(0.0, size as f64) as usize;
            first..end
        };
        for v in range(
            a.y.min(b.y).min(c.y),
            a.y.max(b.y).max(c.y),
            self.options.height,
        ) {
            for u in range(
                a.x.min(b.x).min(c.x),
                a.x.max(b.x).max(c.x),
                self.options.width,
            ) {
                let p = Point2::new(u as f64 + 0.5, v as f64 + 0.5);
                let weights = [
                    (c - b).perp(&(p - b)),
                    (a - c).perp(&(p - c)),
                    (b - a).perp(&(p - a)),
                ]
                .map(|w| w / double_area);
                // Both neighbours of an edge draw a pixel on it; the z-buffer keeps one, so there are no cracks.
                if weights.iter().all(|&w| w >= 0.0) {
                    let depth =
                        weights[0] * inverse[0] + weights[1] * inverse[1] + weights[2] * inverse[2];
                    let at = v * self.options.width + u;
                    if depth > self.inverse_depth[at] {
                        self.inverse_depth[at] = depth;
                        self.thing[at] = thing;
                        self.triangle[at] = index;
                        let ray = self.ray(u, v);
                        self.cosine[at] = (normal.dot(&ray) / ray.norm()).abs();
                    }
                }
            }
        }
    }

    /// The points of the object that the camera sees, with the noise of frame `frame`.
    pub fn points(&self, seed: u64, frame: u64) -> Vec<Point3<f64>> {
        let c = &self.options;
        let mut noise = ChaCha8Rng::seed_from_u64(seed);
        noise.set_stream(frame);
        let pixels = self.object_pixels().map(|at| {
            let ray = self.ray(at % c.width, at / c.width);
            Point3::from(ray * self.noisy_depth(at, &ray, &mut noise))
        });
        pixels.collect()
    }

    /// Depth of a pixel with the noise of an ideal camera.
    fn noisy_depth(&self, at: usize, ray: &Vector3<f64>, noise: &mut impl Rng) -> f64 {
        let depth = 1.0 / self.inverse_depth[at];
        if self.options.noise > 0.0 {
            depth + self.options.noise * normal(noise) / ray.norm()
        } else {
            depth
        }
    }

    /// Pixels of the object, in the order of [`Self::points`].
    pub fn object_pixels(&self) -> impl Iterator<Item = usize> + '_ {
        let c = &self.options;
        let rows = (0..c.height).step_by(c.pixel_stride);
        rows.flat_map(move |v| {
            (0..c.width)
                .step_by(c.pixel_stride)
                .map(move |u| v * c.width + u)
        })
        .filter(|&at| self.thing[at] == Thing::Object)
    }

    /// What a pixel shows, its triangle, and the barycentric weights there; `vertices` must be those it was drawn with.
    pub fn hit(
        &self,
        at: usize,
        vertices: &[Point3<f64>],
        triangles: &[[usize; 3]],
    ) -> Option<([usize; 3], [f64; 3])> {
        let t = triangles.get(self.triangle[at] as usize)?;
        let ray = self.ray(at % self.options.width, at / self.options.width);
        let p = ray / self.inverse_depth[at];
        let [a, b, c] = t.map(|v| vertices[v].coords);
        let normal = (b - a).cross(&(c - a));
        let area = normal.norm_squared();
        if area <= 0.0 {
            return None;
        }
        let of = |q: Vector3<f64>, r: Vector3<f64>| (q - p).cross(&(r - p)).dot(&normal) / area;
        Some((*t, [of(b, c), of(c, a), of(a, b)]))
    }

    /// Cosine of the angle between the normal of the surface at a pixel and its ray.
    pub fn facing(&self, at: usize) -> f64 {
        self.cosine[at]
    }

    /// What a pixel shows.
    pub fn thing(&self, at: usize) -> Thing {
        self.thing[at]
    }

    /// The depth image that the camera sends in frame `frame`, table and arms included.
    ///
    /// # Errors
    /// None in practice: the image has the size of the camera.
    pub fn image(
        &self,
        table: &Plane,
        seed: u64,
        frame: u64,
    ) -> Result<DepthImage, dvrk_io::Error> {
        let c = &self.options;
        let (mut depth, mut cosine) = (Vec::new(), Vec::new());
        for v in 0..c.height {
            for u in 0..c.width {
                let at = v * c.width + u;
                let seen = self.thing[at] != Thing::Nothing;
                let (z, facing) = if seen {
                    (1.0 / self.inverse_depth[at], self.cosine[at])
                } else {
                    on_table(table, &self.ray(u, v))
                };
                depth.push(z);
                cosine.push(facing);
            }
        }
        match &c.model {
            CameraModel::Stereo(stereo) => {
                let image = TrueImage {
                    width: c.width,
                    focal: c.focal,
                    depth: &depth,
                    cosine: &cosine,
                };
                let units = stereo.measure(image, seed, frame);
                DepthImage::from_units(c.width, c.height, &units, stereo.unit)
            }
            CameraModel::Ideal => {
                let mut noise = ChaCha8Rng::seed_from_u64(seed);
                noise.set_stream(frame);
                let metres: Vec<f32> = depth
                    .iter()
                    .map(|z| (z + c.noise * normal(&mut noise)) as f32)
                    .collect();
                DepthImage::from_metres(c.width, c.height, &metres)
            }
        }
    }

    /// Direction of pixel `(u, v)`, scaled to depth 1.
    fn ray(&self, u: usize, v: usize) -> Vector3<f64> {
        let c = &self.options;
        Vector3::new(
            (u as f64 + 0.5 - 0.5 * c.width as f64) / c.focal,
            (v as f64 + 0.5 - 0.5 * c.height as f64) / c.focal,
            1.0,
        )
    }
}

/// Depth at which a ray of depth 1 meets the table, and the cosine there; infinite for a ray that misses it.
fn on_table(table: &Plane, ray: &Vector3<f64>) -> (f64, f64) {
    let down = -table.normal.dot(ray);
    if down > 0.0 {
        (table.offset / down, down / ray.norm())
    } else {
        (0.0, 0.0)
    }
}

/// The part of a triangle beyond the near plane.
fn clip(corners: &[Point3<f64>; 3]) -> Vec<Point3<f64>> {
    let mut polygon = Vec::with_capacity(4);
    for k in 0..3 {
        let (a, b) = (corners[k], corners[(k + 1) % 3]);
        if a.z >= NEAR {
            polygon.push(a);
        }
        if (a.z >= NEAR) != (b.z >= NEAR) {
            polygon.push(a.lerp(&b, (NEAR - a.z) / (b.z - a.z)));
        }
    }
    polygon
}

/// The visible part of an arm: its shaft, and two fingers at a distance of `opening` from the centre plane along ±y.
pub(super) fn gripper(
    camera_from_tip: &Isometry3<f64>,
    opening: f64,
    links: &Links,
) -> (Vec<Point3<f64>>, Vec<[usize; 3]>) {
    const RADIUS: f64 = 0.004;
    const LENGTH: f64 = 0.25;
    let (mut vertices, mut triangles) = (Vec::<Point3<f64>>::new(), Vec::new());
    // In the tip frame, along −z.
    let sides = if links.straight { SHAFT_SIDES } else { 0 };
    for k in 0..sides {
        let angle = std::f64::consts::TAU * k as f64 / SHAFT_SIDES as f64;
        let (x, y) = (RADIUS * angle.cos(), RADIUS * angle.sin());
        vertices.extend([Point3::new(x, y, -LENGTH), Point3::new(x, y, -0.012)]);
        let (a, b) = (2 * k, 2 * ((k + 1) % SHAFT_SIDES));
        triangles.extend([[a, b, b + 1], [a, b + 1, a + 1]]);
    }
    for side in [-1.0, 1.0] {
        // A finger: from the end of the shaft to the tip, 4 mm wide and 2 mm thick, its end `opening` away from the centre plane.
        let first = vertices.len();
        for (z, y) in [(-0.014, 0.002), (0.006, opening + 0.001)] {
            for (dx, dy) in [
                (-0.002, -0.001),
                (0.002, -0.001),
                (0.002, 0.001),
                (-0.002, 0.001),
            ] {
                vertices.push(Point3::new(dx, side * y + dy, z));
            }
        }
        for k in 0..4 {
            let (a, b) = (first + k, first + (k + 1) % 4);
            triangles.extend([[a, b, b + 4], [a, b + 4, a + 4]]);
        }
        triangles.extend([
            [first + 4, first + 5, first + 6],
            [first + 4, first + 6, first + 7],
        ]);
    }
    for p in &mut vertices {
        *p = camera_from_tip * *p;
    }
    if !links.straight {
        for ends in links.points.windows(2) {
            prism(&ends[0], &ends[1], &mut vertices, &mut triangles);
        }
    }
    (vertices, triangles)
}

/// A round link between two points.
fn prism(
    start: &Point3<f64>,
    end: &Point3<f64>,
    vertices: &mut Vec<Point3<f64>>,
    triangles: &mut Vec<[usize; 3]>,
) {
    const RADIUS: f64 = 0.004;
    let axis = (end - start).try_normalize(0.0).unwrap_or_default();
    // The coordinate axis that is most nearly perpendicular to it.
    let beside = Vector3::ith(axis.iamin(), 1.0);
    let x = axis.cross(&beside).try_normalize(0.0).unwrap_or_default();
    let y = axis.cross(&x);
    let first = vertices.len();
    for k in 0..SHAFT_SIDES {
        let angle = std::f64::consts::TAU * k as f64 / SHAFT_SIDES as f64;
        let off = x * (RADIUS * angle.cos()) + y * (RADIUS * angle.sin());
        vertices.extend([start + off, end + off]);
        let (a, b) = (first + 2 * k, first + 2 * ((k + 1) % SHAFT_SIDES));
        triangles.extend([[a, b, b + 1], [a, b + 1, a + 1]]);
    }
}
