//! Surfaces of about 150 mm as level sets, and dense oriented points on them.

use nalgebra::{Point3, UnitVector3, Vector3};
use rand::Rng;
use rand_chacha::ChaCha8Rng;

/// What is looked at. The camera stands above, on the z axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shape {
    /// Three lobes with bumps.
    Blob,
    /// Body, head, ears and tail.
    Hare,
    /// Two lobes of different size, thinning out to one side.
    Liver,
    /// A ring.
    Torus,
    /// A pipe open at both ends, seen from the side.
    Tube,
    /// A palm and four fingers.
    Glove,
    /// A flat brick with round edges and a relief.
    Slab,
}

impl Shape {
    /// Negative inside, zero on the surface, in m near it.
    pub fn level(self, p: &Point3<f64>) -> f64 {
        let (x, y, z) = (p.x, p.y, p.z);
        match self {
            Self::Blob => {
                let large = ellipsoid(p, [-0.02, -0.005, 0.0], [0.052, 0.045, 0.038]);
                let side = ellipsoid(p, [0.04, 0.015, 0.004], [0.038, 0.03, 0.03]);
                let front = ellipsoid(p, [0.015, -0.035, 0.006], [0.03, 0.028, 0.026]);
                let bumps = (70.0 * x + 1.0).sin() * (60.0 * y).cos() + (65.0 * z - 40.0 * x).sin();
                union(union(large, side, 0.012), front, 0.01) - 0.002 * bumps
            }
            Self::Hare => {
                let body = ellipsoid(p, [-0.025, 0.0, 0.0], [0.048, 0.036, 0.034]);
                let head = ellipsoid(p, [0.035, 0.004, 0.012], [0.027, 0.023, 0.023]);
                let ears = [-1.0, 1.0].map(|s| {
                    capsule(
                        p,
                        [0.038, 0.012 * s, 0.026],
                        [0.07, 0.04 * s, 0.034],
                        0.0075,
                    )
                });
                let tail = ellipsoid(p, [-0.073, 0.0, 0.006], [0.012; 3]);
                let fur = (110.0 * x).sin() * (95.0 * y + 1.0).cos() + (100.0 * z - 50.0 * x).sin();
                let whole = [head, ears[0], ears[1], tail];
                whole
                    .into_iter()
                    .fold(body, |sum, part| union(sum, part, 0.008))
                    - 0.0012 * fur
            }
            Self::Liver => {
                let large = ellipsoid(p, [-0.025, 0.0, 0.0], [0.055, 0.048, 0.032]);
                let small = ellipsoid(p, [0.035, 0.008, -0.004], [0.048, 0.03, 0.018]);
                let relief = (55.0 * x + 20.0 * y).sin() * (40.0 * y - 10.0 * x).cos();
                union(large, small, 0.012) - 0.0015 * relief
            }
            Self::Torus => ((x.hypot(y) - 0.052).hypot(z)) - 0.022,
            Self::Tube => {
                // A wall of 6 mm around a bent axis.
                let (cy, cz) = (0.012 * (20.0 * x).sin(), 0.008 * (25.0 * x).cos());
                let wall = ((y - cy).hypot(z - cz) - 0.03).abs() - 0.003;
                wall.max(x.abs() - 0.075)
            }
            Self::Glove => {
                let palm = ellipsoid(p, [-0.035, 0.0, 0.0], [0.042, 0.042, 0.018]);
                let fingers = [-0.033, -0.011, 0.011, 0.033].map(|tip| {
                    capsule(
                        p,
                        [-0.01, 0.8 * tip, 0.0],
                        [0.068 - 6.0 * tip * tip, 1.35 * tip, 0.004],
                        0.0095,
                    )
                });
                fingers
                    .into_iter()
                    .fold(palm, |sum, finger| union(sum, finger, 0.006))
            }
            Self::Slab => {
                let relief = 0.002 * (70.0 * x).sin() * (60.0 * y).cos();
                let d = Vector3::new(x.abs() - 0.065, y.abs() - 0.045, (z - relief).abs() - 0.008);
                d.map(|c| c.max(0.0)).norm() + d.max().min(0.0) - 0.008
            }
        }
    }

    /// `∇ level`, by central differences.
    fn gradient(self, p: &Point3<f64>) -> Vector3<f64> {
        let h = 1e-6;
        Vector3::from_fn(|a, _| {
            let mut e = Vector3::zeros();
            e[a] = h;
            (self.level(&(p + e)) - self.level(&(p - e))) / (2.0 * h)
        })
    }

    /// `count` points all over the surface with their normals: points thrown into a thin shell, then taken to the level set.
    pub fn surfels(
        self,
        count: usize,
        rng: &mut ChaCha8Rng,
    ) -> (Vec<Point3<f64>>, Vec<UnitVector3<f64>>) {
        let (mut points, mut normals) = (Vec::new(), Vec::new());
        while points.len() < count {
            let mut p = Point3::new(
                rng.random_range(-0.09..0.09),
                rng.random_range(-0.08..0.08),
                rng.random_range(-0.07..0.07),
            );
            if self.level(&p).abs() > 0.002 {
                continue;
            }
            for _ in 0..5 {
                let g = self.gradient(&p);
                p -= g * (self.level(&p) / g.norm_squared().max(1e-12));
            }
            if self.level(&p).abs() < 1e-7 {
                points.push(p);
                normals.push(UnitVector3::new_normalize(self.gradient(&p)));
            }
        }
        (points, normals)
    }
}

/// Distance to an ellipsoid, good near its surface.
fn ellipsoid(p: &Point3<f64>, centre: [f64; 3], half: [f64; 3]) -> f64 {
    let d = p.coords - Vector3::from(centre);
    let half = Vector3::from(half);
    let (inner, outer) = (
        d.component_div(&half),
        d.component_div(&half.component_mul(&half)),
    );
    let slope = outer.norm().max(1e-9);
    inner.norm() * (inner.norm() - 1.0) / slope
}

/// Distance to a segment less a radius.
fn capsule(p: &Point3<f64>, from: [f64; 3], to: [f64; 3], radius: f64) -> f64 {
    let (a, b) = (Vector3::from(from), Vector3::from(to));
    let along = ((p.coords - a).dot(&(b - a)) / (b - a).norm_squared()).clamp(0.0, 1.0);
    (p.coords - a - (b - a) * along).norm() - radius
}

/// Both, with a fillet of size `k`.
fn union(a: f64, b: f64, k: f64) -> f64 {
    let h = (k - (a - b).abs()).max(0.0) / k;
    a.min(b) - h * h * k / 4.0
}
