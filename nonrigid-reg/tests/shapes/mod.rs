//! A potato with known motion, seen from above: clouds whose every point is known by construction.

// Every test file uses another part of this.
#![allow(dead_code)]

use nalgebra::{Point3, Rotation3, UnitVector3, Vector3};
use nonrigid_reg::Cloud;

/// Points and normals, owned.
#[derive(Debug, Clone)]
pub struct Oriented {
    pub points: Vec<Point3<f64>>,
    pub normals: Vec<UnitVector3<f64>>,
}

impl Oriented {
    pub fn cloud(&self) -> Cloud<'_> {
        Cloud {
            points: &self.points,
            normals: &self.normals,
        }
    }

    pub fn filter(&self, keep: impl Fn(&Point3<f64>, &UnitVector3<f64>) -> bool) -> Self {
        let both = self.points.iter().zip(&self.normals);
        let (points, normals) = both.filter(|(p, n)| keep(p, n)).unzip();
        Self { points, normals }
    }

    pub fn moved(&self, r: &Rotation3<f64>, t: &Vector3<f64>) -> Self {
        Self {
            points: self.points.iter().map(|p| r * p + t).collect(),
            normals: self.normals.iter().map(|n| r * n).collect(),
        }
    }
}

/// Distance of the surface from the centre in direction `d`, 50 to 80 mm, with bumps of about 30 mm.
fn radius(d: &Vector3<f64>) -> f64 {
    0.065
        + 0.006 * (3.0 * d.x + 1.0).sin() * (2.0 * d.y).cos()
        + 0.005 * (4.0 * d.z - 2.0 * d.x).sin()
        + 0.004 * (5.0 * d.y + 2.0 * d.z).cos()
}

/// The whole surface: `count` directions on a spiral that starts at `phase`, so that two samplings share no point.
pub fn potato(count: usize, phase: f64) -> Oriented {
    let golden = std::f64::consts::PI * (3.0 - 5_f64.sqrt());
    let direction = |k: usize| {
        let z = 1.0 - 2.0 * (k as f64 + 0.5) / count as f64;
        let (s, angle) = ((1.0 - z * z).sqrt(), golden * k as f64 + phase);
        Vector3::new(s * angle.cos(), s * angle.sin(), z)
    };
    let (points, normals) = (0..count)
        .map(|k| {
            let d = direction(k);
            (Point3::from(d * radius(&d)), normal(&d))
        })
        .unzip();
    Oriented { points, normals }
}

/// Normal of the star-shaped surface: gradient of `|x| − radius(x/|x|)`, by central differences.
fn normal(d: &Vector3<f64>) -> UnitVector3<f64> {
    let level = |x: Vector3<f64>| x.norm() - radius(&x.normalize());
    let (x, h) = (d * radius(d), 1e-6);
    UnitVector3::new_normalize(Vector3::from_fn(|a, _| {
        let mut e = Vector3::zeros();
        e[a] = h;
        level(x + e) - level(x - e)
    }))
}

/// What a camera far up the z axis sees of it.
pub fn seen(whole: &Oriented) -> Oriented {
    whole.filter(|_, n| n.z > 0.15)
}

/// Bends the potato: a smooth motion of up to `size`, with the deformed normals.
pub fn bent(o: &Oriented, size: f64) -> Oriented {
    let map = |p: &Point3<f64>| p + bend(p, size);
    let h = 1e-6;
    let normals = o.points.iter().zip(&o.normals).map(|(p, n)| {
        let f = nalgebra::Matrix3::from_columns(&[0, 1, 2].map(|a| {
            let mut e = Vector3::zeros();
            e[a] = h;
            (map(&(p + e)) - map(&(p - e))) / (2.0 * h)
        }));
        let carried = f
            .try_inverse()
            .map(|inverse| inverse.transpose() * n.as_ref());
        UnitVector3::new_normalize(carried.unwrap_or(n.into_inner()))
    });
    Oriented {
        normals: normals.collect(),
        points: o.points.iter().map(map).collect(),
    }
}

/// The displacement of that motion.
pub fn bend(p: &Point3<f64>, size: f64) -> Vector3<f64> {
    let s = p.x / 0.08;
    size * Vector3::new(-0.3 * s * p.z / 0.08, 0.2 * s, 0.8 * s * s)
}

/// Mean distance in m.
pub fn mean_error(found: &[Vector3<f64>], truth: impl Fn(usize) -> Vector3<f64>) -> f64 {
    let total: f64 = found
        .iter()
        .enumerate()
        .map(|(i, u)| (u - truth(i)).norm())
        .sum();
    total / found.len() as f64
}
