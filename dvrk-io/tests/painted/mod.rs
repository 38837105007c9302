//! A painted ball or board before a camera: images and depths by casting a ray through every pixel, so that nothing is shared with what is tested.
#![allow(dead_code, reason = "each user needs another part of it")]

use dvrk_io::depth::{DepthImage, Intrinsics, Scan};
use dvrk_io::features::GreyImage;
use nalgebra::{Isometry3, Point3, Vector3};

/// Size and focal length of the depth camera; the colour camera has twice as many pixels each way.
pub const WIDTH: usize = 320;
pub const HEIGHT: usize = 240;
pub const FOCAL: f64 = 320.0;
pub const FINER: usize = 2;

/// What is before the camera.
#[derive(Clone, Copy, PartialEq)]
pub enum Body {
    /// A board of 0.3 m × 0.2 m in the plane z = 0 of its own frame.
    Board,
    /// A ball of 60 mm radius about the origin of its own frame.
    Ball,
}

/// How it is painted and lit.
#[derive(Clone, Copy)]
pub struct Paint {
    /// Grey levels between the darkest and the brightest place.
    pub contrast: f64,
    /// What all grey values are multiplied by.
    pub light: f64,
    /// Standard deviation of the noise of a pixel, grey levels.
    pub noise: f64,
    /// Standard deviation of the noise of a depth, metres.
    pub depth_noise: f64,
}

impl Default for Paint {
    fn default() -> Self {
        Self {
            contrast: 160.0,
            light: 1.0,
            noise: 0.0,
            depth_noise: 0.0,
        }
    }
}

/// What the two cameras take.
pub struct Picture {
    pub image: GreyImage,
    pub scan: Scan,
    /// Pixels of the scan that show the body.
    pub object: Vec<bool>,
}

/// Takes a picture of a body; `frame` tells the noise of one from that of another. Behind it is a plain wall at 0.8 m.
pub fn picture(
    body: Body,
    camera_from_body: &Isometry3<f64>,
    paint: &Paint,
    frame: u64,
) -> Picture {
    let body_from_camera = camera_from_body.inverse();
    let eye = body_from_camera * Point3::origin();
    // Depth and place on the body of the ray through a pixel.
    let cast = |u: f64, v: f64, focal: f64, size: [f64; 2]| {
        let ray = Vector3::new(
            (u + 0.5 - 0.5 * size[0]) / focal,
            (v + 0.5 - 0.5 * size[1]) / focal,
            1.0,
        );
        let along = body_from_camera * ray;
        let depth = match body {
            Body::Board => {
                let t = -eye.z / along.z;
                let p = eye + along * t;
                (t > 0.0 && p.x.abs() < 0.15 && p.y.abs() < 0.10).then_some(t)
            }
            Body::Ball => {
                let (a, b) = (along.norm_squared(), along.dot(&eye.coords));
                let c = eye.coords.norm_squared() - 0.06 * 0.06;
                let square = b * b - a * c;
                (square > 0.0).then(|| (-b - square.sqrt()) / a)
            }
        };
        depth.map(|t| (t, eye + along * t))
    };
    let mut random = Random(frame.wrapping_mul(0x9e37_79b9).wrapping_add(1));
    let (width, height) = (WIDTH * FINER, HEIGHT * FINER);
    let mut pixels = Vec::with_capacity(width * height);
    for at in 0..width * height {
        let size = [width as f64, height as f64];
        let (u, v) = ((at % width) as f64, (at / width) as f64);
        let hit = cast(u, v, FOCAL * FINER as f64, size);
        let grey = hit.map_or(128.0, |(_, p)| 128.0 + paint.contrast * (texture(&p) - 0.5));
        let grey = paint.light * grey + paint.noise * random.normal();
        pixels.push(grey.round().clamp(0.0, 255.0) as u8);
    }
    let (mut depths, mut object) = (Vec::new(), Vec::new());
    for at in 0..WIDTH * HEIGHT {
        let (u, v) = ((at % WIDTH) as f64, (at / WIDTH) as f64);
        let hit = cast(u, v, FOCAL, [WIDTH as f64, HEIGHT as f64]);
        let depth = hit.map_or(0.8, |(t, _)| t) + paint.depth_noise * random.normal();
        depths.push(depth as f32);
        object.push(hit.is_some());
    }
    let center = [WIDTH, HEIGHT].map(|n| 0.5 * n as f64 - 0.5);
    let camera = Intrinsics::new(WIDTH, HEIGHT, [FOCAL; 2], center).unwrap();
    let depth = DepthImage::from_metres(WIDTH, HEIGHT, &depths).unwrap();
    Picture {
        image: GreyImage::new(width, height, pixels).unwrap(),
        scan: Scan::from_image(&depth, &camera).unwrap(),
        object,
    }
}

/// Blotches of 16, 8 and 4 mm, from 0 to 1, as a function of place.
fn texture(p: &Point3<f64>) -> f64 {
    let octave = |size: f64| noise(&(p.coords / size));
    ((octave(0.016) + octave(0.008) + 0.7 * octave(0.004)) / 2.7 - 0.5).mul_add(1.6, 0.5)
}

fn noise(p: &Vector3<f64>) -> f64 {
    let low = p.map(f64::floor);
    let t = p - low;
    let t = t.map(|t| t * t * (3.0 - 2.0 * t));
    let mut sum = 0.0;
    for corner in 0..8_u8 {
        let bit = |axis: u8| f64::from(corner >> axis & 1);
        let along = |axis: u8, t: f64| if bit(axis) > 0.5 { t } else { 1.0 - t };
        let weight = along(0, t.x) * along(1, t.y) * along(2, t.z);
        let place = [low.x + bit(0), low.y + bit(1), low.z + bit(2)];
        sum += weight * hash(place);
    }
    sum
}

fn hash(place: [f64; 3]) -> f64 {
    let mut state = 0x1234_5678_9abc_def0_u64;
    for x in place {
        state = Random(state ^ (x as i64).cast_unsigned()).next();
    }
    (state >> 11) as f64 / (1_u64 << 53) as f64
}

/// SplitMix64.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn normal(&mut self) -> f64 {
        let sum: f64 = (0..12)
            .map(|_| (self.next() >> 11) as f64 / (1_u64 << 53) as f64)
            .sum();
        sum - 6.0
    }
}
