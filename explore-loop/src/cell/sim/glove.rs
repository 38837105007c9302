//! A filled glove with two fingers that touch.
//!
//! It is modelled twice. **Spread**, all fingers are far enough apart for tetrahedra of the usual size to separate them; **at rest**, each finger is
//! bent in the plane of the palm. The contact exists only in the bent shape: the two surfaces meet there without being joined, so the fingers can be
//! separated without tearing.
//!
//! ```text
//! finger, spread      straight axis  b + s·d(φ₀),                          d(φ) = (−sin φ, cos φ)
//! finger, at rest     c(s) = b + ∫₀ˢ d(φ(σ)) dσ,                           φ(σ) = φ₀ + (φ₁ − φ₀) · step((σ − 12 mm)/25 mm)
//! the bend            b + s·d + t·d⊥ + z·e_z   ↦   c(s) + t·d⊥(φ(s)) + z·e_z
//! contact             φ₁ of the first finger by bisection, so that the distance of its axis from the second one is two radii and the clearance
//! ```
//! Up to 12 mm from its base, in the palm and between the fingers, the bend is the identity; beyond, every point moves with its
//! nearest finger.

use nalgebra::{Point3, Vector2};

use super::implicit::{Implicit, round_slab, smooth_min, smooth_step};

/// A finger: base, length and radius of its axis, and its angle from +y toward −x, spread and at rest.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Finger {
    base: Vector2<f64>,
    length: f64,
    radius: f64,
    spread: f64,
    rest: f64,
}

/// Height of the finger axes over the centre plane of the palm, metres, so that fingers and palm both rest on the table.
const AXES: f64 = -0.003;
/// Where the bend of a finger begins, and its length, metres.
const BEND: (f64, f64) = (0.012, 0.025);
/// Gap between the two fingers that touch, metres.
const CLEARANCE: f64 = 0.0004;
/// Radius over which fingers blend into the palm, metres; they do not blend into each other.
const ROOT: f64 = 0.008;
/// Steps of the integral along an axis.
const STEPS: usize = 24;

/// The spread glove, and the bend of its fingers.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Glove {
    fingers: [Finger; 5],
}

impl Glove {
    /// Index, middle, ring and little finger, and the thumb; index and middle finger touch.
    pub fn new() -> Self {
        let finger = |x: f64, y: f64, length: f64, radius: f64, [spread, rest]: [f64; 2]| Finger {
            base: Vector2::new(x, y),
            length,
            radius,
            spread: spread.to_radians(),
            rest: rest.to_radians(),
        };
        let mut glove = Self {
            fingers: [
                finger(-0.033, 0.040, 0.056, 0.0095, [38.0, 0.0]),
                finger(-0.011, 0.040, 0.063, 0.0095, [13.0, 4.0]),
                finger(0.011, 0.040, 0.058, 0.0095, [-13.0, -9.0]),
                finger(0.033, 0.040, 0.047, 0.0090, [-38.0, -26.0]),
                finger(-0.034, -0.012, 0.060, 0.0110, [60.0, 60.0]),
            ],
        };
        glove.fingers[0].rest = glove.touching();
        glove
    }

    /// The angle at which the first finger touches the second.
    fn touching(&self) -> f64 {
        let [first, second, ..] = self.fingers;
        let least = first.radius + second.radius + CLEARANCE;
        let (mut apart, mut across) = (first.spread, (-30_f64).to_radians());
        for _ in 0..60 {
            let middle = 0.5 * (apart + across);
            let bent = Finger {
                rest: middle,
                ..first
            };
            if bent.distance(&second) < least {
                across = middle;
            } else {
                apart = middle;
            }
        }
        apart
    }

    /// Position at rest of a point of the spread glove.
    pub fn at_rest(&self, p: &Point3<f64>) -> Point3<f64> {
        let q = p.xy().coords;
        let nearest = self
            .fingers
            .iter()
            .min_by(|a, b| a.outside(q).total_cmp(&b.outside(q)));
        let bent = nearest.map_or(q, |finger| finger.bend(q));
        Point3::new(bent.x, bent.y, p.z)
    }
}

fn direction(angle: f64) -> Vector2<f64> {
    let (s, c) = angle.sin_cos();
    Vector2::new(-s, c)
}

impl Finger {
    /// Signed distance in the plane of the palm, spread.
    fn outside(&self, p: Vector2<f64>) -> f64 {
        let from_base = p - self.base;
        let along = from_base
            .dot(&direction(self.spread))
            .clamp(0.0, self.length);
        (from_base - direction(self.spread) * along).norm() - self.radius
    }

    /// Signed distance in space, spread.
    fn value(&self, p: &Point3<f64>) -> f64 {
        let flat = self.outside(p.xy().coords) + self.radius;
        flat.hypot(p.z - AXES) - self.radius
    }

    /// Angle of the axis at rest, `s` from its base.
    fn angle(&self, s: f64) -> f64 {
        self.spread + (self.rest - self.spread) * smooth_step((s - BEND.0) / BEND.1)
    }

    /// The axis at rest.
    fn axis(&self, s: f64) -> Vector2<f64> {
        if s <= BEND.0 {
            return self.base + direction(self.spread) * s;
        }
        // Trapezoid rule: the bend is smooth, its ends are flat.
        let step = (s - BEND.0) / STEPS as f64;
        let at = |k: usize| direction(self.angle(BEND.0 + k as f64 * step));
        let inner: Vector2<f64> = (1..STEPS).map(at).sum();
        let ends = (at(0) + at(STEPS)) * 0.5;
        self.base + direction(self.spread) * BEND.0 + (inner + ends) * step
    }

    fn bend(&self, p: Vector2<f64>) -> Vector2<f64> {
        let way = direction(self.spread);
        let aside = Vector2::new(-way.y, way.x);
        let (s, t) = ((p - self.base).dot(&way), (p - self.base).dot(&aside));
        if s <= BEND.0 {
            return p;
        }
        let way = direction(self.angle(s));
        self.axis(s) + Vector2::new(-way.y, way.x) * t
    }

    /// Least distance between the axes of two fingers at rest, beyond the web between them.
    fn distance(&self, other: &Self) -> f64 {
        let points = |finger: &Self| -> Vec<Vector2<f64>> {
            let from = BEND.0 + BEND.1;
            let step = (finger.length - from) / 40.0;
            (0..=40)
                .map(|k| finger.axis(from + f64::from(k) * step))
                .collect()
        };
        let others = points(other);
        points(self)
            .iter()
            .flat_map(|p| others.iter().map(move |q| (p - q).norm()))
            .fold(f64::INFINITY, f64::min)
    }
}

impl Implicit for Glove {
    fn value(&self, p: &Point3<f64>) -> f64 {
        // The palm with its cuff: a rounded square plate.
        let beyond = (p.xy().coords - Vector2::new(0.0, -0.012)).abs() - Vector2::new(0.026, 0.038);
        let outline = beyond.sup(&Vector2::zeros()).norm() + beyond.max().min(0.0) - 0.020;
        let palm = round_slab(outline, p.z, 0.013, 0.012);
        let fingers = self.fingers.iter().map(|finger| finger.value(p));
        let fingers = fingers.fold(f64::INFINITY, f64::min);
        smooth_min(palm, fingers, ROOT)
    }

    fn bounds(&self) -> (Point3<f64>, Point3<f64>) {
        (
            Point3::new(-0.115, -0.075, -0.018),
            Point3::new(0.08, 0.125, 0.018),
        )
    }

    fn thickness(&self) -> f64 {
        // The thickness of a finger: the webs between them need cubes of about 4 mm.
        0.009
    }
}
