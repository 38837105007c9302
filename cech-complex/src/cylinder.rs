//! The `(r, h)`-cylinder of an oriented point and its gauge.
//!
//! ```text
//! C(s) = { y : |n·(y − p)| ≤ s·h/2,  ‖(I − n nᵀ)(y − p)‖ ≤ s·r }
//! g(y) = max( |n·(y − p)| / (h/2), ‖(I − n nᵀ)(y − p)‖ / r )          the least s with y ∈ C(s)
//! ```
//!
//! ## Lemma 1: which cylinder fits a surface
//! Let `M` be a closed surface of reach `τ`, every point of `M` within `ε` of a sample, normals off by at most `α`.
//! Near a sample `p` the surface lies outside the two balls of radius `τ` that touch it there, so over a disc of radius
//! `r < τ` it stays within `sag(r) = τ − √(τ² − r²)` of the tangent plane, and a normal that is off by `α` adds
//! `r·tan α`. Hence with `e = sag(r) + r·tan α`:
//!
//! * `r ≥ ε` and `h/2 ≥ e`: the cylinders cover `M`, each of them the patch over its own disc;
//! * `h/2 + e < τ`: no cylinder leaves the tube around `M` in which the closest point is unique, so it never reaches
//!   another sheet.
//!
//! Then every normal segment of `M` meets the union of the cylinders in an interval around `M`; the union
//! retracts to `M` along these segments and the nerve theorem gives `CČC ≃ M`. The interval property is defended here by
//! tests on analytic surfaces rather than by proof.

use crate::error::{Error, positive};
use nalgebra::{Point3, UnitVector3, Vector3};

/// Half-width of the disc in spacings: grid points and ε-nets leave gaps of up to about 1.1 spacings (`√(area/n)`),
/// and the sum of two radii has to close the ring around every such gap.
const RADIUS_PER_SPACING: f64 = 1.25;
/// Thinnest cylinder in radii. Flatter ones make the union depend on the last degree of the normals.
const HEIGHT_PER_RADIUS: f64 = 0.5;

/// Radius and full height of the cylinders, in m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cylinder {
    radius: f64,
    height: f64,
}

impl Cylinder {
    /// A cylinder of the given radius and full height.
    ///
    /// # Errors
    /// [`Error::NotPositive`] if one of them is not positive and finite.
    pub fn new(radius: f64, height: f64) -> Result<Self, Error> {
        Ok(Self {
            radius: positive("radius", radius)?,
            height: positive("height", height)?,
        })
    }

    /// The cylinder of Lemma 1 for a surface of the given `reach`, sampled at `spacing` (`√(area/n)` of an even sampling;
    /// no point of the surface farther than 1.25 spacings from a sample), with exact normals.
    ///
    /// # Errors
    /// [`Error::NotPositive`], or [`Error::TooCoarse`] if no cylinder satisfies the lemma.
    ///
    /// ```
    /// let cylinder = cech_complex::Cylinder::from_spacing_and_reach(0.004, 0.03)?;
    /// assert!((cylinder.radius() - 0.005).abs() < 1e-12);
    /// assert!(cech_complex::Cylinder::from_spacing_and_reach(0.03, 0.03).is_err());
    /// # Ok::<(), cech_complex::Error>(())
    /// ```
    pub fn from_spacing_and_reach(spacing: f64, reach: f64) -> Result<Self, Error> {
        Self::from_spacing_reach_and_tilt(spacing, reach, 0.0)
    }

    /// [`from_spacing_and_reach`](Self::from_spacing_and_reach) with normals that are off by at most `tilt` (rad).
    ///
    /// # Errors
    /// [`Error::NotPositive`], [`Error::OutOfRange`] for the tilt, or [`Error::TooCoarse`].
    pub fn from_spacing_reach_and_tilt(spacing: f64, reach: f64, tilt: f64) -> Result<Self, Error> {
        positive("spacing", spacing)?;
        positive("reach", reach)?;
        if !(0.0..std::f64::consts::FRAC_PI_2).contains(&tilt) {
            return Err(Error::OutOfRange {
                what: "tilt",
                value: tilt,
            });
        }
        let radius = RADIUS_PER_SPACING * spacing;
        // NaN when radius > reach: the comparison below then fails as it should.
        let off_plane =
            reach - (reach * reach - radius * radius).max(0.0).sqrt() + radius * tilt.tan();
        let half_height = off_plane.max(0.5 * HEIGHT_PER_RADIUS * radius);
        let extent = half_height + off_plane;
        if radius >= reach || extent >= reach {
            return Err(Error::TooCoarse {
                spacing,
                reach,
                extent,
            });
        }
        Self::new(radius, 2.0 * half_height)
    }

    /// Radius `r` of the disc, m.
    pub fn radius(&self) -> f64 {
        self.radius
    }

    /// Full height `h`, m.
    pub fn height(&self) -> f64 {
        self.height
    }

    /// Gauge `g(y)` of the cylinder at `point` with `normal`: the least scale at which it contains `y`.
    pub fn gauge(&self, point: &Point3<f64>, normal: &UnitVector3<f64>, y: &Point3<f64>) -> f64 {
        gauge(&(y - point), normal, 0.5 * self.height, self.radius)
    }

    /// Radius of the smallest ball around the point that contains the cylinder at scale 1.
    pub(crate) fn circumradius(&self) -> f64 {
        self.radius.hypot(0.5 * self.height)
    }

    pub(crate) fn half_height(&self) -> f64 {
        0.5 * self.height
    }
}

/// Gauge at an offset `d = y − p`.
pub(crate) fn gauge(d: &Vector3<f64>, n: &Vector3<f64>, half_height: f64, radius: f64) -> f64 {
    let along = n.dot(d);
    (along.abs() / half_height).max((d - n * along).norm() / radius)
}

/// Support function `h(w) = max_{y ∈ C(1)} w·(y − p) = (h/2)|n·w| + r‖(I − n nᵀ)w‖`, the dual norm of the gauge.
pub(crate) fn support(w: &Vector3<f64>, n: &Vector3<f64>, half_height: f64, radius: f64) -> f64 {
    let along = n.dot(w);
    half_height * along.abs() + radius * (w - n * along).norm()
}
