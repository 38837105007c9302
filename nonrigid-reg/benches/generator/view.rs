//! What a camera half a metre above sees of a surface, and how it samples it.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Point3, UnitVector3, Vector3};
use nonrigid_reg::{Cloud, estimate_normals};
use rand::Rng;
use rand_chacha::ChaCha8Rng;

/// The camera.
pub const EYE: Point3<f64> = Point3::new(0.0, 0.0, 0.5);

/// A sampled view with estimated normals.
#[derive(Debug, Clone)]
pub struct View {
    pub points: Vec<Point3<f64>>,
    pub normals: Vec<UnitVector3<f64>>,
}

impl View {
    pub fn new(points: Vec<Point3<f64>>) -> Self {
        let normals = estimate_normals(&points, 16, &EYE).unwrap_or_default();
        Self { points, normals }
    }

    pub fn cloud(&self) -> Cloud<'_> {
        Cloud {
            points: &self.points,
            normals: &self.normals,
        }
    }
}

/// Pixel of a point in an image plane at the distance of the object, with pixels of `side` m.
fn pixel(p: &Point3<f64>, side: f64) -> (i64, i64) {
    let scale = EYE.z / (EYE.z - p.z) / side;
    ((p.x * scale).floor() as i64, (p.y * scale).floor() as i64)
}

/// Points that face the camera with nothing else 4 mm in front.
pub fn visible(points: &[Point3<f64>], normals: &[UnitVector3<f64>]) -> Vec<bool> {
    let depth = |p: &Point3<f64>| (EYE - p).norm();
    let mut front: BTreeMap<(i64, i64), f64> = BTreeMap::new();
    for p in points {
        let nearest = front.entry(pixel(p, 0.002)).or_insert(f64::MAX);
        *nearest = nearest.min(depth(p));
    }
    let faces = |i: usize| normals[i].dot(&(EYE - points[i]).normalize()) > 0.15;
    let open = |p: &Point3<f64>| depth(p) < front[&pixel(p, 0.002)] + 0.004;
    (0..points.len())
        .map(|i| faces(i) && open(&points[i]))
        .collect()
}

/// About `count` of the visible points, one at random in every cell of the image, with noise along the ray.
pub fn sample(
    points: &[Point3<f64>],
    seen: &[bool],
    count: usize,
    noise: f64,
    rng: &mut ChaCha8Rng,
) -> View {
    let cells = |side: f64| {
        let mut cells: BTreeMap<(i64, i64), Vec<usize>> = BTreeMap::new();
        for i in (0..points.len()).filter(|&i| seen[i]) {
            cells.entry(pixel(&points[i], side)).or_default().push(i);
        }
        cells
    };
    let (mut fine, mut coarse) = (0.0003, 0.02);
    for _ in 0..20 {
        let middle = 0.5 * (fine + coarse);
        if cells(middle).len() > count {
            fine = middle;
        } else {
            coarse = middle;
        }
    }
    let chosen = cells(coarse).into_values().map(|cell| {
        let p = points[cell[rng.random_range(0..cell.len())]];
        p + (p - EYE).normalize() * (noise * normal_vector(rng).x)
    });
    View::new(chosen.collect())
}

/// Three independent standard normal numbers.
pub fn normal_vector(rng: &mut ChaCha8Rng) -> Vector3<f64> {
    Vector3::from_fn(|_, _| {
        // Box and Muller.
        let (a, b): (f64, f64) = (
            rng.random_range(f64::MIN_POSITIVE..1.0),
            rng.random_range(0.0..1.0),
        );
        (-2.0 * a.ln()).sqrt() * (std::f64::consts::TAU * b).cos()
    })
}

/// Normals after a motion, `F⁻ᵀ n` with `F` by central differences.
pub fn carry(
    points: &[Point3<f64>],
    normals: &[UnitVector3<f64>],
    map: impl Fn(&Point3<f64>) -> Point3<f64>,
) -> Vec<UnitVector3<f64>> {
    let h = 1e-6;
    let turned = |(p, n): (&Point3<f64>, &UnitVector3<f64>)| {
        let f = Matrix3::from_columns(
            &[Vector3::x(), Vector3::y(), Vector3::z()]
                .map(|e| (map(&(p + e * h)) - map(&(p - e * h))) / (2.0 * h)),
        );
        let inverse = f.try_inverse().unwrap_or_else(Matrix3::identity);
        UnitVector3::new_normalize(inverse.transpose() * n.as_ref())
    };
    points.iter().zip(normals).map(turned).collect()
}

/// Takes the given share of the points, those nearest to `centre`, out of the view.
pub fn shadow(view: &mut View, centre: &Point3<f64>, share: f64) {
    let mut order: Vec<usize> = (0..view.points.len()).collect();
    let gap = |i: usize| (view.points[i] - centre).norm();
    order.sort_by(|&a, &b| gap(a).total_cmp(&gap(b)));
    let mut kept = order.split_off((share * view.points.len() as f64) as usize);
    kept.sort_unstable();
    view.points = kept.iter().map(|&i| view.points[i]).collect();
    view.normals = kept.iter().map(|&i| view.normals[i]).collect();
}

/// Adds stray points 5 to 30 mm off the surface.
pub fn strays(view: &mut View, share: f64, rng: &mut ChaCha8Rng) {
    for _ in 0..(share * view.points.len() as f64) as usize {
        let from = view.points[rng.random_range(0..view.points.len())];
        view.points
            .push(from + normal_vector(rng).normalize() * rng.random_range(0.005..0.03));
    }
    *view = View::new(std::mem::take(&mut view.points));
}
