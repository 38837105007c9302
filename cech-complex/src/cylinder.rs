//! The `(r, h)`-cylinder of an oriented point and its gauge. See [`Cylinder`] for Lemma 1, which tells which cylinder fits a surface.

use crate::error::{Error, positive};
use nalgebra::{Point3, UnitVector3, Vector3};
use std::f64::consts::FRAC_PI_2;

/// Half-width of the disc in spacings: grid points and ε-nets leave gaps of up to about 1.1 spacings (`√(area/n)`),
/// and the sum of two radii has to close the ring around every such gap.
const RADIUS_PER_SPACING: f64 = 1.25;
/// Smallest height in radii. With flatter cylinders the union depends on small errors of the normals.
const HEIGHT_PER_RADIUS: f64 = 0.5;

/// Radius and full height of the cylinders, in m.
///
/// ```text
/// C(s) = { y : |n·(y − p)| ≤ s·h/2,  ‖(I − n nᵀ)(y − p)‖ ≤ s·r }
/// g(y) = max( |n·(y − p)| / (h/2), ‖(I − n nᵀ)(y − p)‖ / r )          the least s with y ∈ C(s)
/// ```
///
/// ## Lemma 1: which cylinder fits a surface
/// (Paper, Lemma 1, restated and proved.)
///
/// `M`: closed surface of reach `τ`; samples on it, no point of it farther than `ε` from a sample; normals off by at most `α`. Write `H = h/2`,
/// `U(s)` for the union of the cylinders at scale `s`, `M(δ)` for the points within `δ` of `M`, and
///
/// ```text
/// e    = ε²/(2τ) + ε·sin α                       height of M over the tangent plane of a sample, within ε
/// θ    = 2·asin(ε/(2τ))                          turn of the normal within ε
/// δ(s) = s·H + (s·r)²/(2τ) + 2·s·r·sin(α/2)      how far from M a cylinder reaches
/// ```
///
/// **Proved.** Let `a·r ≥ ε`, `a·H ≥ e`, `b·H ≥ δ(a) + e`, `b·r ≥ ε + δ(a)·sin(θ + α)` and `δ(b) < τ`. Then
///
/// ```text
/// M ⊂ U(a) ⊂ M(δ(a)) ⊂ U(b) ⊂ M(δ(b))      and so      β_k^{a,b} = β_k(M),   k = 0, 1, 2.
/// ```
///
/// 1. A point of `M` within `ε` of the sample `p` is at most `ε²/(2τ)` off the tangent plane (Federer 1959, 4.8), so in `C_p(a)`.
/// 2. The geodesic from `p` along a tangent vector `u` ends within `|u|²/(2τ)` of `p + u`, for its curvature is at most `1/τ`. A
///    tilted disc is another `2·s·r·sin(α/2)` off, the axis another `s·H`: hence `U(s) ⊂ M(δ(s))`.
/// 3. Between `m` and a sample within `ε` the normal turns by at most `θ` (Boissonnat, Lieutier and Wintraecken 2019), so
///    `m + t·ν(m)` with `|t| ≤ δ(a)` lies in `C_p(b)`.
/// 4. `M(δ)` retracts to `M` for `δ < τ`. `H(U(a)) → H(U(b))` factors through `H(M(δ(a)))`, which bounds its rank from above, and
///    `H(M) → H(U(a)) → H(U(b)) → H(M(δ(b)))` is an isomorphism, which bounds it from below. Cylinders are convex, so unions and
///    nerves have the same persistent homology (nerve theorem).
///
/// [`Cylinder::proven_scale`] gives the least such `b` for `a = 1`. The proof is about the plain nerve ([`Orientation::Free`](crate::Orientation)).
/// `Separate { min_cosine }` gives the same complex if no two cylinders that meet have normals farther apart than that, for which
/// `2·asin(b·√(r² + H²)/τ) + 2α ≤ acos(min_cosine)` suffices.
///
/// **Only tested.** That one scale is nearly enough: where `s·r ≥ ε`, `s·H ≥ sag(s·r) + s·r·tan α` and `s·H + sag(s·r) + s·r·tan α < τ`, with
/// `sag(x) = τ − √(τ² − x²)`, a cylinder contains the patch of `M` over its disc and reaches no other sheet. If every normal segment of
/// `M` met `U(s)` in an interval, `β_k^{s,s} = β_k(M)` would follow, but corners of cylinders can break that by a sliver of height
/// `r²/τ`. On nets of surfaces of positive curvature plain Betti numbers were right at every such scale; where both signs of curvature
/// meet, pinholes of up to 1 % of scale occur, and `β_k^{s,1.02s}` were right at every scale (tests `lemma`).
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
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
        check_tilt(tilt)?;
        let radius = RADIUS_PER_SPACING * spacing;
        // NaN if radius > reach: the comparison below then fails as intended.
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

    /// The smallest scale `b` for which Lemma 1 proves that `persistent_betti(1, b)` are the Betti numbers of the surface, for any
    /// sampling of a closed surface of the given `reach` with samples on it, none of its points farther than
    /// `covering_radius` from a sample (both m), and normals off by at most `tilt` (rad). Build with a `max_scale` of at least `b`.
    ///
    /// # Errors
    /// [`Error::NotPositive`], [`Error::OutOfRange`] for the tilt, [`Error::NotCovering`] if the cylinders do not cover the surface at
    /// scale 1, [`Error::TooCoarse`] if they would reach another sheet at scale `b`.
    ///
    /// ```
    /// use cech_complex::{Complex, Cylinder, Options, manifolds::Manifold};
    ///
    /// let torus = Manifold::Torus { major: 1.0, minor: 0.4 };
    /// let cloud = torus.net(900, 1);
    /// let covering = 1.25 * cloud.spacing;
    /// let cylinder = Cylinder::new(1.1 * covering, 2.0 * covering)?;
    /// let b = cylinder.proven_scale(covering, torus.reach(), 0.0)?;
    /// let complex = Complex::build(&cloud.points, &cloud.normals, cylinder, &Options::default().with_max_scale(b))?;
    /// assert_eq!(complex.persistent_betti(1.0, b), [1, 2, 1]);
    /// # Ok::<(), cech_complex::Error>(())
    /// ```
    pub fn proven_scale(&self, covering_radius: f64, reach: f64, tilt: f64) -> Result<f64, Error> {
        positive("covering_radius", covering_radius)?;
        positive("reach", reach)?;
        check_tilt(tilt)?;
        let (r, half) = (self.radius, self.half_height());
        let off_plane = covering_radius * (covering_radius / (2.0 * reach) + tilt.sin());
        if r < covering_radius || half < off_plane {
            return Err(Error::NotCovering {
                covering_radius,
                radius: r,
                height: self.height,
                least_height: 2.0 * off_plane,
            });
        }
        let extent =
            |s: f64| s * half + (s * r).powi(2) / (2.0 * reach) + 2.0 * s * r * (0.5 * tilt).sin();
        let turn = 2.0 * (0.5 * covering_radius / reach).min(1.0).asin() + tilt;
        let lateral = covering_radius + extent(1.0) * turn.min(FRAC_PI_2).sin();
        let scale = ((extent(1.0) + off_plane) / half).max(lateral / r);
        if extent(scale) >= reach {
            return Err(Error::TooCoarse {
                spacing: covering_radius,
                reach,
                extent: extent(scale),
            });
        }
        Ok(scale)
    }

    /// Radius `r` of the disc, m.
    pub fn radius(&self) -> f64 {
        self.radius
    }

    /// Full height `h`, m.
    pub fn height(&self) -> f64 {
        self.height
    }

    /// Gauge `g(y)` of the cylinder at `point` with `normal`: the smallest scale at which it contains `y`.
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

/// Checks an angle between given and true normals.
fn check_tilt(tilt: f64) -> Result<(), Error> {
    if (0.0..FRAC_PI_2).contains(&tilt) {
        Ok(())
    } else {
        Err(Error::OutOfRange {
            what: "tilt",
            value: tilt,
            bound: "in [0, π/2)",
        })
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
