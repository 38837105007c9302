//! Bodies with folds and hollows: a colon, a beanie; and a ring, which has genus 1.
//!
//! | body | equation |
//! |---|---|
//! | [`Colon`] | distance to an arc of 120° less `r(s) = r₀ (1 − 0.22 · ((1 + cos 2πs/λ)/2)⁴)`, `s` along the arc: a fold every λ = 26 mm |
//! | [`Beanie`] | distance to a surface of revolution about z, a cylinder joined to a half ball, less `t(z)/2`: the wall, 16 mm of wool and lining, with a folded brim of 19 mm |
//! | [`Torus`] | `‖(‖(x, y)‖ − R, z)‖ − r` |

use nalgebra::Point3;

use super::implicit::{Implicit, smooth_step};

/// A bent, filled tube with folds around it, closed by rounded ends.
pub(super) struct Colon {
    bend: f64,
    radius: f64,
}

impl Colon {
    const HALF_ANGLE: f64 = std::f64::consts::FRAC_PI_3;
    /// Radius of the tube between two folds, in radii of the bend.
    const SLENDER: f64 = 0.020 / 0.09;
    /// Depth of a fold, in radii of the tube, and distance between folds, in radii of the bend.
    const FOLD: (f64, f64) = (0.22, 0.026 / 0.09);

    /// The colon whose ends are `size` apart, outside to outside.
    pub fn new(size: f64) -> Self {
        let bend = 0.5 * size / (Self::HALF_ANGLE.sin() + Self::SLENDER);
        Self {
            bend,
            radius: Self::SLENDER * bend,
        }
    }
}

impl Implicit for Colon {
    fn value(&self, p: &Point3<f64>) -> f64 {
        let (x, y) = (p.x, p.y.abs());
        let angle = y.atan2(x).min(Self::HALF_ANGLE);
        let (s, c) = angle.sin_cos();
        let across = (x - self.bend * c).hypot(y - self.bend * s).hypot(p.z);
        // Each end lies between two folds, half of the 26 mm beyond the outermost.
        let (depth, apart) = Self::FOLD;
        let wave = (std::f64::consts::TAU * (Self::HALF_ANGLE - angle) / apart - 2.2).cos();
        let fold = (0.5 * (1.0 + wave)).powi(4) * smooth_step((Self::HALF_ANGLE - angle) / 0.05);
        across - self.radius * (1.0 - depth * fold)
    }

    fn bounds(&self) -> (Point3<f64>, Point3<f64>) {
        let (s, c) = Self::HALF_ANGLE.sin_cos();
        let (b, r) = (self.bend, self.radius);
        (
            Point3::new(b * c - r, -b * s - r, -r),
            Point3::new(b + r, b * s + r, r),
        )
    }
}

/// A thick cap standing on its brim, hollow below; the inner side of the wall is its lining.
pub(super) struct Beanie {
    /// Radius of the centre of the wall, metres.
    radius: f64,
}

impl Beanie {
    const WALL: f64 = 0.016;
    /// Height of the cylinder below the half ball, in radii.
    const DEEP: f64 = 0.5;
    /// Additional thickness of the folded brim, and its height above the rim, metres; over the same height again it tapers off.
    const BRIM: (f64, f64) = (0.003, 0.018);

    /// The beanie that measures `size` across its brim.
    pub fn new(size: f64) -> Self {
        Self {
            radius: 0.5 * (size - Self::WALL) - Self::BRIM.0,
        }
    }
}

impl Implicit for Beanie {
    fn value(&self, p: &Point3<f64>) -> f64 {
        // z = 0 where the cylinder joins the half ball.
        let rim = -Self::DEEP * self.radius;
        let brim = Self::BRIM.0 * (1.0 - smooth_step((p.z - rim) / Self::BRIM.1 - 1.0));
        // The fold lies on the outside.
        let (out, middle) = (p.x.hypot(p.y), self.radius + 0.5 * brim);
        let distance = if p.z >= 0.0 {
            (out.hypot(p.z) - middle).abs()
        } else {
            (out - middle).hypot((rim - p.z).max(0.0))
        };
        distance - 0.5 * (Self::WALL + brim)
    }

    fn bounds(&self) -> (Point3<f64>, Point3<f64>) {
        let wide = self.radius + 0.5 * Self::WALL + Self::BRIM.0;
        let low = Self::DEEP * self.radius + 0.5 * Self::WALL + Self::BRIM.0;
        let high = self.radius + 0.5 * Self::WALL;
        (
            Point3::new(-wide, -wide, -low),
            Point3::new(wide, wide, high),
        )
    }

    fn thickness(&self) -> f64 {
        Self::WALL
    }
}

/// A ring that lies flat.
pub(super) struct Torus {
    ring: f64,
    tube: f64,
}

impl Torus {
    /// The ring that measures `size` across.
    pub fn new(size: f64) -> Self {
        Self {
            ring: 0.35 * size,
            tube: 0.15 * size,
        }
    }
}

impl Implicit for Torus {
    fn value(&self, p: &Point3<f64>) -> f64 {
        (p.x.hypot(p.y) - self.ring).hypot(p.z) - self.tube
    }

    fn bounds(&self) -> (Point3<f64>, Point3<f64>) {
        let wide = self.ring + self.tube;
        let high = Point3::new(wide, wide, self.tube);
        (-high, high)
    }
}
