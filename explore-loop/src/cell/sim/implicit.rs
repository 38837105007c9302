//! Solids as functions: `f < 0` inside, `f = 0` on the surface, `f` approximately a signed distance in metres near it.
//!
//! ```text
//! smooth union    f ∪ₖ g = min(f, g) − h²/(4k),  h = max(k − |f − g|, 0)
//! smooth cut      f ∖ₖ g = −((−f) ∪ₖ g)
//! round slab      f = max(x, y)⁻ + ‖(x⁺, y⁺)‖ − ρ,  x = outline + ρ,  y = |z| − (half thickness − ρ)
//! ```
//! The round slab is a planar outline with a thickness and a rim rounded at radius `ρ`, so that thin lobes do not
//! end in an edge too sharp for tetrahedra.

use nalgebra::{Point3, Vector2};

/// A solid given by a function.
pub(super) trait Implicit {
    /// Negative inside.
    fn value(&self, p: &Point3<f64>) -> f64;
    /// Corners of a box that contains the solid.
    fn bounds(&self) -> (Point3<f64>, Point3<f64>);
    /// The least thickness, metres: sheets closer than a few edge lengths need a finer mesh.
    fn thickness(&self) -> f64 {
        f64::INFINITY
    }
}

/// Ellipsoid about the origin.
pub(super) struct Ellipsoid {
    /// Half axes, metres.
    pub half_axes: [f64; 3],
}

impl Implicit for Ellipsoid {
    fn value(&self, p: &Point3<f64>) -> f64 {
        let [a, b, c] = self.half_axes;
        let unit = Point3::new(p.x / a, p.y / b, p.z / c).coords.norm();
        let slope = Point3::new(p.x / (a * a), p.y / (b * b), p.z / (c * c))
            .coords
            .norm();
        // First-order distance: value of ‖x/a‖ − 1 over the length of its gradient.
        if slope > 0.0 {
            unit * (unit - 1.0) / slope
        } else {
            -a.min(b).min(c)
        }
    }

    fn bounds(&self) -> (Point3<f64>, Point3<f64>) {
        let high = Point3::from(self.half_axes);
        (-high, high)
    }
}

/// A simplified liver: thick right lobe (−x), thin left lobe (+x), a notch in the front rim between them.
pub(super) struct Liver;

/// Radius of the rim of both lobes, metres.
const RIM: f64 = 0.0085;

impl Liver {
    /// Signed distance to the outline seen from above.
    fn outline(p: Vector2<f64>) -> f64 {
        let disc = |x: f64, y: f64, r: f64| (p - Vector2::new(x, y)).norm() - r;
        let right = smooth_min(
            disc(-0.040, 0.004, 0.060),
            disc(-0.014, -0.008, 0.053),
            0.03,
        );
        let left = smooth_min(disc(0.040, 0.006, 0.040), disc(0.066, 0.010, 0.034), 0.03);
        let notch = disc(0.024, -0.058, 0.018);
        -smooth_min(-smooth_min(right, left, 0.04), notch, 0.02)
    }
}

impl Implicit for Liver {
    fn value(&self, p: &Point3<f64>) -> f64 {
        let outline = Self::outline(p.xy().coords);
        // The thickness falls from the right lobe to the left, and from the centre to the rim.
        let right = smooth_step((0.05 - p.x) / 0.10);
        let inward = (-outline / 0.055).clamp(0.0, 1.0);
        let crown = (0.006 + 0.0135 * right) * inward * (2.0 - inward);
        // The upper side bulges more than the lower side.
        let side = if p.z > 0.0 { 1.35 } else { 0.65 };
        round_slab(outline, p.z, RIM + side * crown, RIM)
    }

    fn bounds(&self) -> (Point3<f64>, Point3<f64>) {
        (
            Point3::new(-0.115, -0.075, -0.04),
            Point3::new(0.115, 0.075, 0.06),
        )
    }
}

/// A planar outline, given by its signed distance, with a thickness and a rim rounded at radius `rim`.
pub(super) fn round_slab(outline: f64, z: f64, half_thickness: f64, rim: f64) -> f64 {
    let (x, y) = (outline + rim, z.abs() - (half_thickness - rim));
    x.max(y).min(0.0) + Vector2::new(x.max(0.0), y.max(0.0)).norm() - rim
}

/// The smooth union of two solids: the crease is filled where their values differ by less than `k`.
pub(super) fn smooth_min(f: f64, g: f64, k: f64) -> f64 {
    let h = (k - (f - g).abs()).max(0.0);
    f.min(g) - h * h / (4.0 * k)
}

/// 0 below 0, 1 above 1, `3t² − 2t³` between.
pub(super) fn smooth_step(t: f64) -> f64 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}
