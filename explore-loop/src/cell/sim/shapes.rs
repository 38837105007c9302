//! Bodies of everyday shape, from compact to thin-walled, in stable poses on a table.
//!
//! | body | longest extent `s` | difficulty |
//! |---|---|---|
//! | [`Tube`] | the chord of its bend | it hides half of itself in every pose |
//! | [`RoundBox`] | its length | flat sides meet in sharp edges |
//! | [`Peanut`] | its length | a waist that is seen from few sides |
//! | [`Star`] | two of its lobes | a flat side that touches the table everywhere |
//! | [`Cap`] | its rim | a wall with an outer and an inner side, near each other |
//! | [`Sheet`] | its length | two sides 4 mm apart, hardly any bending stiffness |
//!
//! All are exact distances, or smooth unions of them (see [`super::implicit`]).

use nalgebra::{Point3, Vector2, Vector3};

use super::implicit::{Implicit, round_slab, smooth_min};

/// A round tube bent through 120 degrees, with ends of half balls.
pub(super) struct Tube {
    /// Radius of the bend, metres.
    bend: f64,
    /// Radius of the tube, metres.
    radius: f64,
}

impl Tube {
    /// Half the angle of the bend.
    const HALF_ANGLE: f64 = std::f64::consts::FRAC_PI_3;
    /// Radius of the tube, in radii of the bend.
    const SLENDER: f64 = 0.022 / 0.09;

    /// The tube whose ends are `size` apart, outside to outside.
    pub fn new(size: f64) -> Self {
        let bend = 0.5 * size / (Self::HALF_ANGLE.sin() + Self::SLENDER);
        Self {
            bend,
            radius: Self::SLENDER * bend,
        }
    }
}

impl Implicit for Tube {
    fn value(&self, p: &Point3<f64>) -> f64 {
        // Symmetric about the x axis, which bisects the bend.
        let (x, y) = (p.x, p.y.abs());
        let across = if y.atan2(x) <= Self::HALF_ANGLE {
            x.hypot(y) - self.bend
        } else {
            let (s, c) = Self::HALF_ANGLE.sin_cos();
            (x - self.bend * c).hypot(y - self.bend * s)
        };
        across.hypot(p.z) - self.radius
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

/// A box with rounded edges.
pub(super) struct RoundBox {
    half: Vector3<f64>,
    rounding: f64,
}

impl RoundBox {
    /// The box of length `size`.
    pub fn new(size: f64) -> Self {
        Self {
            half: Vector3::new(0.5, 0.35, 0.2) * size,
            rounding: 0.075 * size,
        }
    }
}

impl Implicit for RoundBox {
    fn value(&self, p: &Point3<f64>) -> f64 {
        let beyond = p.coords.abs() - self.half.add_scalar(-self.rounding);
        beyond.sup(&Vector3::zeros()).norm() + beyond.max().min(0.0) - self.rounding
    }

    fn bounds(&self) -> (Point3<f64>, Point3<f64>) {
        ((-self.half).into(), self.half.into())
    }
}

/// Two balls joined smoothly, slightly flattened so that it does not roll.
pub(super) struct Peanut {
    /// Radius of the balls, and distance of their centres from the origin, metres.
    ball: f64,
}

impl Peanut {
    /// Height over width.
    const FLAT: f64 = 0.8;
    /// Blending radius between the balls, in their radii.
    const JOIN: f64 = 0.8;

    /// The peanut of length `size`.
    pub fn new(size: f64) -> Self {
        Self { ball: 0.25 * size }
    }
}

impl Implicit for Peanut {
    fn value(&self, p: &Point3<f64>) -> f64 {
        let round = Point3::new(p.x, p.y, p.z / Self::FLAT);
        let ball = |x: f64| (round - Point3::new(x, 0.0, 0.0)).norm() - self.ball;
        let joined = smooth_min(ball(-self.ball), ball(self.ball), Self::JOIN * self.ball);
        // Flattening shortens distances by at most this factor.
        Self::FLAT * joined
    }

    fn bounds(&self) -> (Point3<f64>, Point3<f64>) {
        let high = Point3::new(2.0, 1.0, Self::FLAT) * self.ball;
        (-high, high)
    }
}

/// A flat star of three round lobes.
pub(super) struct Star {
    /// Distance from the centre to the centre of the end of a lobe, metres.
    lobe: f64,
    /// Half the width of a lobe, metres.
    half_width: f64,
}

impl Star {
    const THICKNESS: f64 = 0.015;

    /// The star that is `size` long over two lobes.
    pub fn new(size: f64) -> Self {
        let half_width = 0.13 * size;
        Self {
            lobe: (size - 2.0 * half_width) / 3_f64.sqrt(),
            half_width,
        }
    }

    /// Signed distance to the outline.
    fn outline(&self, p: Vector2<f64>) -> f64 {
        let lobe = |k: f64| {
            let (s, c) = (k * std::f64::consts::TAU / 3.0).sin_cos();
            let way = Vector2::new(c, s);
            let along = p.dot(&way).clamp(0.0, self.lobe);
            (p - way * along).norm() - self.half_width
        };
        let pair = smooth_min(lobe(0.0), lobe(1.0), self.half_width);
        smooth_min(pair, lobe(2.0), self.half_width)
    }
}

impl Implicit for Star {
    fn value(&self, p: &Point3<f64>) -> f64 {
        let half = 0.5 * Self::THICKNESS;
        round_slab(self.outline(p.xy().coords), p.z, half, half)
    }

    fn bounds(&self) -> (Point3<f64>, Point3<f64>) {
        let reach = self.lobe + self.half_width;
        let high = Point3::new(reach, reach, 0.5 * Self::THICKNESS);
        (-high, high)
    }

    fn thickness(&self) -> f64 {
        Self::THICKNESS
    }
}

/// A dome on its rim: part of a hollow ball, closed around the rim.
pub(super) struct Cap {
    /// Radius of the centre of the wall, metres.
    radius: f64,
}

impl Cap {
    const WALL: f64 = 0.0075;
    /// Angle at the centre of the ball from the crown to the rim.
    const ANGLE: f64 = 75.0 / 180.0 * std::f64::consts::PI;

    /// The cap that measures `size` across its rim.
    pub fn new(size: f64) -> Self {
        Self {
            radius: 0.5 * (size - Self::WALL) / Self::ANGLE.sin(),
        }
    }
}

impl Implicit for Cap {
    fn value(&self, p: &Point3<f64>) -> f64 {
        let (out, up) = (p.x.hypot(p.y), p.z);
        let distance = if out.atan2(up) <= Self::ANGLE {
            (out.hypot(up) - self.radius).abs()
        } else {
            let (s, c) = Self::ANGLE.sin_cos();
            (out - self.radius * s).hypot(up - self.radius * c)
        };
        distance - 0.5 * Self::WALL
    }

    fn bounds(&self) -> (Point3<f64>, Point3<f64>) {
        let (s, c) = Self::ANGLE.sin_cos();
        let (half, reach) = (0.5 * Self::WALL, self.radius * s);
        let wide = reach + half;
        (
            Point3::new(-wide, -wide, self.radius * c - half),
            Point3::new(wide, wide, self.radius + half),
        )
    }

    fn thickness(&self) -> f64 {
        Self::WALL
    }
}

/// A thin sheet with round corners.
pub(super) struct Sheet {
    half: Vector2<f64>,
    corner: f64,
}

impl Sheet {
    const THICKNESS: f64 = 0.004;

    /// The sheet of length `size`.
    pub fn new(size: f64) -> Self {
        Self {
            half: Vector2::new(0.5, 0.4) * size,
            corner: 0.15 * size,
        }
    }
}

impl Implicit for Sheet {
    fn value(&self, p: &Point3<f64>) -> f64 {
        let beyond = p.xy().coords.abs() - self.half.add_scalar(-self.corner);
        let outline = beyond.sup(&Vector2::zeros()).norm() + beyond.max().min(0.0) - self.corner;
        let half = 0.5 * Self::THICKNESS;
        round_slab(outline, p.z, half, half)
    }

    fn bounds(&self) -> (Point3<f64>, Point3<f64>) {
        let high = Point3::new(self.half.x, self.half.y, 0.5 * Self::THICKNESS);
        (-high, high)
    }

    fn thickness(&self) -> f64 {
        Self::THICKNESS
    }
}
