//! Two balls on a tilted table, as every kind of message that a depth camera sends.
#![allow(dead_code, reason = "each test program uses a part")]

use dvrk_io::cdr::{CameraInfo, Image, PointCloud2, PointField};
use dvrk_io::depth::Object;
use nalgebra::{Point3, UnitVector3, Vector3};

pub const WIDTH: u32 = 200;
pub const HEIGHT: u32 = 150;

pub fn info() -> CameraInfo {
    CameraInfo {
        width: WIDTH,
        height: HEIGHT,
        k: [250.0, 0.0, 99.5, 0.0, 250.0, 74.5, 0.0, 0.0, 1.0],
        ..CameraInfo::default()
    }
}

/// A ball half sunk into a tilted table, and a smaller one apart from it.
#[derive(Clone, Copy)]
pub struct Scene {
    pub normal: UnitVector3<f64>,
    pub offset: f64,
    pub balls: [(Point3<f64>, f64); 2],
    pub noise: f64,
    pub seed: u64,
}

impl Scene {
    pub fn new(tilt: [f64; 2]) -> Self {
        let normal = UnitVector3::new_normalize(Vector3::new(tilt[0], tilt[1], -1.0));
        let on_table = |x: f64, y: f64| {
            let depth = 0.5;
            // The table goes through (0, 0, 0.5).
            Point3::new(x, y, depth + (normal.x * x + normal.y * y) / -normal.z)
        };
        Self {
            normal,
            offset: -normal.z * 0.5,
            balls: [
                (on_table(0.02, 0.01), 0.045),
                (on_table(-0.11, -0.06), 0.02),
            ],
            noise: 0.0,
            seed: 1,
        }
    }

    /// Depth along the ray through a pixel, and what is hit: 0 the table, 1 and 2 the balls.
    pub fn hit(&self, ray: &Vector3<f64>) -> (f64, usize) {
        let table = (-self.offset / self.normal.dot(ray), 0);
        let ball = |(index, (center, radius)): (usize, &(Point3<f64>, f64))| {
            let (a, b) = (ray.norm_squared(), ray.dot(&center.coords));
            let root = b * b - a * (center.coords.norm_squared() - radius * radius);
            (root >= 0.0).then(|| ((b - root.sqrt()) / a, index + 1))
        };
        let hits = self
            .balls
            .iter()
            .enumerate()
            .filter_map(ball)
            .chain([table]);
        hits.filter(|(depth, _)| *depth > 0.0)
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .unwrap()
    }

    pub fn rays() -> impl Iterator<Item = Vector3<f64>> {
        (0..HEIGHT)
            .flat_map(|v| (0..WIDTH).map(move |u| (u, v)))
            .map(|(u, v)| {
                Vector3::new(
                    (f64::from(u) - 99.5) / 250.0,
                    (f64::from(v) - 74.5) / 250.0,
                    1.0,
                )
            })
    }

    pub fn depths(&self) -> Vec<f64> {
        let mut state = self.seed;
        let mut noise = || {
            let mut sum = 0.0;
            for _ in 0..12 {
                state = state
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1_442_695_040_888_963_407);
                sum += (state >> 33) as f64 / f64::from(1_u32 << 31);
            }
            // Twelve uniform numbers have a variance of one.
            (sum - 6.0) * self.noise
        };
        Self::rays().map(|ray| self.hit(&ray).0 + noise()).collect()
    }

    pub fn height(&self, point: &Point3<f64>) -> f64 {
        self.normal.dot(&point.coords) + self.offset
    }

    pub fn check(&self, object: &Object, ball: usize, tolerance: f64) {
        let table = object.table;
        assert!(
            table.normal.angle(&self.normal) < 0.003 + 0.2 * self.noise,
            "{}",
            table.normal.angle(&self.normal)
        );
        assert!(
            (table.offset - self.offset).abs() < 0.001,
            "{}",
            table.offset - self.offset
        );
        let (center, radius) = self.balls[ball];
        let mut aligned = 0;
        for (point, normal) in object.points.iter().zip(&object.normals) {
            let off = (point - center).norm() - radius;
            assert!(off.abs() < tolerance, "{point} is {off} off");
            assert!(self.height(point) > 0.002);
            assert!(normal.dot(&(-point.coords)) >= 0.0);
            aligned += usize::from(normal.dot(&(point - center).normalize()) > 0.9);
        }
        assert!(
            aligned * 10 > object.points.len() * 9,
            "{aligned} of {}",
            object.points.len()
        );
        adds_up(object);
    }
}

pub fn adds_up(object: &Object) {
    let a = object.account;
    let gone = a.missing
        + a.outside
        + a.arm
        + a.table
        + a.flying
        + a.lone
        + a.other_parts
        + a.without_normal
        + a.merged;
    assert_eq!(gone + a.kept, a.total);
    assert_eq!(a.kept, object.points.len());
    assert_eq!(a.kept, object.normals.len());
    assert!(
        object
            .colours
            .as_ref()
            .is_none_or(|colours| colours.len() == a.kept)
    );
    assert!(
        object
            .points
            .iter()
            .all(|point| point.iter().all(|value| value.is_finite()))
    );
    assert!(
        object
            .normals
            .iter()
            .all(|normal| (normal.norm() - 1.0).abs() < 1e-9)
    );
}

pub fn image(encoding: &str, depths: &[f64], big: bool, padding: usize) -> Image {
    let pixel = |depth: &f64| match (encoding, big) {
        ("16UC1", false) => (depth * 1000.0)
            .round()
            .clamp(0.0, 65535.0)
            .to_le_bytes_u16(false),
        ("16UC1", true) => (depth * 1000.0)
            .round()
            .clamp(0.0, 65535.0)
            .to_le_bytes_u16(true),
        (_, false) => (*depth as f32).to_le_bytes().to_vec(),
        (_, true) => (*depth as f32).to_be_bytes().to_vec(),
    };
    let rows = depths.chunks(WIDTH as usize);
    let row = |row: &[f64]| {
        row.iter()
            .flat_map(pixel)
            .chain(vec![0xAB; padding])
            .collect::<Vec<_>>()
    };
    let data: Vec<u8> = rows.flat_map(row).collect();
    Image {
        height: HEIGHT,
        width: WIDTH,
        encoding: encoding.into(),
        is_bigendian: big,
        step: (data.len() / HEIGHT as usize) as u32,
        data,
        ..Image::default()
    }
}

trait Bytes {
    fn to_le_bytes_u16(self, big: bool) -> Vec<u8>;
}

impl Bytes for f64 {
    fn to_le_bytes_u16(self, big: bool) -> Vec<u8> {
        let value = self as u16;
        if big {
            value.to_be_bytes().to_vec()
        } else {
            value.to_le_bytes().to_vec()
        }
    }
}

/// The cloud of the same depths: x y z in another order, doubles, with a colour that tells what was hit.
pub fn cloud(scene: &Scene, organised: bool, scale: f64) -> PointCloud2 {
    let field = |name: &str, offset, datatype| PointField {
        name: name.into(),
        offset,
        datatype,
        count: 1,
    };
    let mut data = Vec::new();
    let mut count = 0;
    for (ray, depth) in Scene::rays().zip(scene.depths()) {
        if !organised && count % 7 == 0 && depth < 0.0 {
            continue;
        }
        let point = ray * (depth * scale);
        let colour = [40_u8, 80, 120, 0].map(|value| value + scene.hit(&ray).1 as u8);
        data.extend(colour.iter().rev());
        for value in [point.z, point.x, point.y] {
            data.extend(value.to_be_bytes());
        }
        count += 1;
    }
    let (height, width) = if organised {
        (HEIGHT, WIDTH)
    } else {
        (1, count)
    };
    PointCloud2 {
        height,
        width,
        // Most significant byte first: alpha, red, green, blue.
        fields: vec![
            field("rgba", 0, 6),
            field("z", 4, 8),
            field("x", 12, 8),
            field("y", 20, 8),
        ],
        is_bigendian: true,
        point_step: 28,
        row_step: 28 * width,
        data,
        ..PointCloud2::default()
    }
}
