//! Surfaces with exact normals and known reach, boundary, junctions and Betti numbers, sampled with a seed (feature `manifolds`).
//!
//! | surface | area | reach | β₀ β₁ β₂ | boundary |
//! |---|---|---|---|---|
//! | sphere `R` | `4πR²` | `R` | 1 0 1 | – |
//! | ellipsoid `a ≥ b ≥ c` | quadrature, 1e-6 | `c²/a` | 1 0 1 | – |
//! | torus `R > r` | `4π²Rr` | `min(r, R − r)` | 1 2 1 | – |
//! | genus 2: `dist(y, K) = t` (below) | `2·area(K) + πt·length(∂K) − 4πt²` | `min(t, a − t)` | 1 4 1 | – |
//! | thin plate `R`, thickness `2t` | `2πR² + 2π²Rt + 4πt²` | `t` | 1 0 1 | – |
//! | two bodies: spheres `R`, gap `g` | `8πR²` | `min(R, g/2)` | 2 0 2 | – |
//! | disc `R` | `πR²` | ∞ | 1 0 0 | circle `R` |
//! | annulus `a < R` | `π(R² − a²)` | `a` | 1 1 0 | circles `R`, `a` |
//! | open tube `R`, `l` | `2πRl` | `R` | 1 1 0 | two circles `R` |
//! | cap `R`, `θ` | `2πR²(1 − cos θ)` | `R`, beyond 90° `R sin θ` | 1 0 0 | circle `R sin θ` |
//! | pinched sphere `R` | `πR²(4 + 3√2)` | 0 | 1 0 2 | – |
//! | crossing sheets `R` | `2πR²` | 0 | 1 0 0 | two circles `R` |
//! | T-junction `R` | `5πR²` | 0 | 1 0 2 | – |
//!
//! The last three are not manifolds: their sheets meet in a point, in a segment, in a circle.
//!
//! **Genus 2.** `K` is a flat strip of width `w` around two round holes of radius `a`, and the surface is everything at distance `t` from it: a
//! pretzel. `K` has reach `a` (its nearest medial points are the middles of the holes), and a parallel surface at distance `t < a` of a set of reach `a`
//! has reach `a − t` outward and `t` inward (Federer, *Curvature measures*, 1959, §4). So the reach is exact and nothing has to be estimated; the
//! surface is `C^{1,1}`: its normal `∇dist(y, K)` is continuous, its curvature jumps where tube meets flat. The plate is the same for a disc.
//!
//! **Sampling.** [`Manifold::uniform`] draws independent points, uniform by area: a point of the surface may be about `√(ln n)` spacings from
//! its nearest sample. [`Manifold::net`] thins twelve times as many to an ε-net by farthest-point insertion
//! (Gonzalez 1985), which leaves gaps of one spacing or less; [`Manifold::covering_radius`] computes their exact size. The spacing is
//! `√(area/n)` throughout.

use std::f64::consts::FRAC_PI_2;

mod cloud;
mod sample;
mod shape;

pub use cloud::OrientedCloud;
pub use shape::Circle;

/// A surface in space; all lengths in m and positive.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Manifold {
    /// Sphere around the origin.
    Sphere {
        /// Its radius.
        radius: f64,
    },
    /// Ellipsoid around the origin.
    Ellipsoid {
        /// Semi-axes along x, y, z.
        axes: [f64; 3],
    },
    /// Torus around the z axis.
    Torus {
        /// Radius of the core circle.
        major: f64,
        /// Radius of the tube, less than `major`.
        minor: f64,
    },
    /// Pretzel with two holes side by side along x: the points at distance `tube` from a flat strip in the plane z = 0.
    Genus2 {
        /// Radius of the two round holes of the strip, more than `tube`.
        hole: f64,
        /// Width of the strip around and between the holes.
        web: f64,
        /// Distance of the surface from the strip.
        tube: f64,
    },
    /// Closed disc-shaped plate with a rounded edge, normal to z.
    Plate {
        /// Radius of its flat faces.
        radius: f64,
        /// Distance between them.
        thickness: f64,
    },
    /// Two equal spheres side by side along x.
    TwoSpheres {
        /// Radius of each.
        radius: f64,
        /// Clear distance between them.
        gap: f64,
    },
    /// Flat disc in the plane z = 0.
    Disc {
        /// Its radius.
        radius: f64,
    },
    /// Flat ring in the plane z = 0.
    Annulus {
        /// Inner radius.
        inner: f64,
        /// Outer radius.
        outer: f64,
    },
    /// Cylinder mantle around the z axis, open at both ends.
    Tube {
        /// Its radius.
        radius: f64,
        /// Its length.
        length: f64,
    },
    /// Part of a sphere around its north pole.
    Cap {
        /// Radius of the sphere.
        radius: f64,
        /// Angle from the pole to the boundary, rad.
        angle: f64,
    },
    /// Sphere constricted at its equator to a point, the origin: two spheres on the z axis, joined by the double cone of 45°
    /// that touches both. Not a manifold at the origin.
    PinchedSphere {
        /// Radius of the two spheres, and length of the cones.
        radius: f64,
    },
    /// Two flat discs that cross along the y axis, one in the plane z = 0, one in x = 0. Not a manifold on that segment.
    CrossingSheets {
        /// Radius of both.
        radius: f64,
    },
    /// Sphere around the origin with a wall across its equator: in every meridian plane the wall meets the sphere in a T.
    /// Not a manifold on the equator.
    TJunction {
        /// Radius of the sphere.
        radius: f64,
    },
}

impl Manifold {
    /// Betti numbers `β₀, β₁, β₂`.
    pub fn betti(&self) -> [usize; 3] {
        match self {
            Self::Sphere { .. } | Self::Ellipsoid { .. } | Self::Plate { .. } => [1, 0, 1],
            Self::Torus { .. } => [1, 2, 1],
            Self::Genus2 { .. } => [1, 4, 1],
            Self::TwoSpheres { .. } => [2, 0, 2],
            Self::Disc { .. } | Self::Cap { .. } | Self::CrossingSheets { .. } => [1, 0, 0],
            Self::Annulus { .. } | Self::Tube { .. } => [1, 1, 0],
            Self::PinchedSphere { .. } | Self::TJunction { .. } => [1, 0, 2],
        }
    }

    /// Reach, m: the largest distance within which every point of space has one closest point on the surface. Infinite for a convex flat
    /// piece, 0 where sheets meet.
    pub fn reach(&self) -> f64 {
        match *self {
            Self::Sphere { radius } | Self::Tube { radius, .. } => radius,
            // Radius of curvature at the end of the longest axis.
            Self::Ellipsoid { axes: [a, b, c] } => a.min(b).min(c).powi(2) / a.max(b).max(c),
            Self::Torus { major, minor } => minor.min(major - minor),
            Self::Genus2 { hole, tube, .. } => tube.min(hole - tube),
            Self::Plate { thickness, .. } => 0.5 * thickness,
            Self::TwoSpheres { radius, gap } => radius.min(0.5 * gap),
            Self::Disc { .. } => f64::INFINITY,
            Self::Annulus { inner, .. } => inner,
            // Beyond the equator the opening is the narrowest part.
            Self::Cap { radius, angle } => radius * angle.max(FRAC_PI_2).sin(),
            Self::PinchedSphere { .. } | Self::CrossingSheets { .. } | Self::TJunction { .. } => {
                0.0
            }
        }
    }
}
