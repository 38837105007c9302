//! The smooth surface of a cloud (after Alexa et al. 2003): moving least squares with a quadratic local fit.
//!
//! A point `q` lies on the surface when it lies on the height polynomial that the points around it define:
//!
//! ```text
//! θ_i = W(‖p_i − q‖ / radius),   n = normalised Σ θ_i n_i,   (s, t, n) an orthonormal frame at q
//! min_h Σ θ_i (h(s_i, t_i) − n·(p_i − q))²,   h = h₀ + h₁ s + h₂ t + h₃ s² + h₄ st + h₅ t²
//! q ← q + h₀ n                               until |h₀| is negligible
//! ```
//!
//! Where the points do not determine a quadratic (fewer than nine, or collinear) the fit falls back to the weighted mean plane.
//!
//! # Bias on a sphere
//! At a point of a densely and evenly sampled sphere of radius `r`, with `a² = s² + t²`,
//!
//! ```text
//! h(a) = −a²/(2r) − a⁴/(8r³) − …                    m_k = ∫₀¹ W(x) x^{k+1} dx:   1/14, 5/504, 1/396, 1/1144  for k = 0, 2, 4, 6
//! plane        h₀ = ⟨h⟩ = −(m₂/m₀) ρ²/(2r) = −(5/72) ρ²/r
//! quadratic    h₀ = −c/(8r³),   a⁴ ≈ c + c′a² in the weighted least-squares sense:
//!              c = ρ⁴ (m₄² − m₂m₆)/(m₀m₄ − m₂²) = −(917/32747) ρ⁴
//!              h₀ = + (917/261976) ρ⁴/r³ ≈ 0.0035 ρ⁴/r³
//! ```
//!
//! (the weights are Wendland's C2; `c < 0` by the inequality of Cauchy and Schwarz, for every weight). The fixed point of the iteration lies
//! where `h₀ = 0`, which is as far off the sphere. A plane fit therefore shrinks a sphere in every pass, whereas the quadratic one enlarges it only once,
//! by [`sphere_bias`]: 0.6 µm for `r` = 50 mm and `ρ` = 12 mm, 300 times less than the plane fit shrinks it.

use nalgebra::{Matrix6, Point3, Unit, UnitVector3, Vector3, Vector6};

use crate::batch::map_indexed;
use crate::error::{Error, check_coordinates, check_length};
use crate::tree::{Neighbour, Tree};
use crate::weight::Weight;

/// A point on the smooth surface and the normal there.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Projection {
    /// The projected point.
    pub point: Point3<f64>,
    /// Surface normal, on the side of the normals of the cloud.
    pub normal: UnitVector3<f64>,
}

/// A cloud projected onto its own smooth surface.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Smoothed {
    /// The points, in the order of the input.
    pub points: Vec<Point3<f64>>,
    /// Their normals.
    pub normals: Vec<UnitVector3<f64>>,
}

/// A quadratic has six coefficients; a few more points make it a fit instead of an interpolation of noise.
const QUADRATIC_NEEDS: usize = 9;
/// Newton-like steps; smooth clouds converge in three.
const STEPS: usize = 12;
/// A step below this share of the radius is rounding.
const SETTLED: f64 = 1e-10;
/// Damping of the polynomial beyond its constant, relative to its normal matrix in units of the radius.
const DAMPING: f64 = 1e-9;

/// Projects `point` onto the smooth surface of `points`.
///
/// `radius` is the reach of the weights in m; two and a half to four spacings are usual.
///
/// # Errors
/// No points, slices of different lengths, coordinates that are not finite, a radius that is not positive, or no point of the cloud within
/// the radius of `point` ([`Error::Unsupported`]).
///
/// # Complexity
/// `O(n log n)` for the search tree; use [`Surface`] for many points.
///
/// ```
/// use nalgebra::{Point3, Vector3};
/// let plane: Vec<_> = (0..100).map(|k| Point3::new(f64::from(k % 10), f64::from(k / 10), 0.0)).collect();
/// let up = vec![Vector3::z_axis(); 100];
/// let foot = gpwrm::mls::project(&Point3::new(4.2, 5.1, 0.7), &plane, &up, 3.0)?;
/// assert!(foot.point.z.abs() < 1e-12);
/// # Ok::<(), gpwrm::Error>(())
/// ```
pub fn project(
    point: &Point3<f64>,
    points: &[Point3<f64>],
    normals: &[UnitVector3<f64>],
    radius: f64,
) -> Result<Projection, Error> {
    Surface::new(points, normals, radius)?.project(point)
}

/// Projects every point of the cloud onto the smooth surface of the cloud: removes noise, merges overlapping layers.
///
/// # Errors
/// As for [`project`].
///
/// # Complexity
/// `O(n (log n + k))` with `k` points in the radius.
///
/// ```
/// use gpwrm::nalgebra::{Point3, Vector3};
/// // The same patch seen twice, once 0.1 too high.
/// let layers: Vec<_> = (0..200)
///     .map(|k| Point3::new(f64::from(k % 10), f64::from(k / 10 % 10), if k < 100 { 0.0 } else { 0.1 }))
///     .collect();
/// let smoothed = gpwrm::mls::smooth(&layers, &vec![Vector3::z_axis(); 200], 3.0)?;
/// // Both layers end on the sheet half-way between them.
/// assert!(smoothed.points.iter().all(|p| (p.z - 0.05).abs() < 1e-6));
/// # Ok::<(), gpwrm::Error>(())
/// ```
pub fn smooth(
    points: &[Point3<f64>],
    normals: &[UnitVector3<f64>],
    radius: f64,
) -> Result<Smoothed, Error> {
    let surface = Surface::new(points, normals, radius)?;
    // All points are projected before the first error by index is returned, so that threads do not affect which.
    let projected = map_indexed(points.len(), |i| surface.project_indexed(&points[i], i))
        .into_iter()
        .collect::<Result<Vec<Projection>, _>>()?;
    Ok(Smoothed {
        points: projected.iter().map(|s| s.point).collect(),
        normals: projected.iter().map(|s| s.normal).collect(),
    })
}

/// The growth of a sphere of radius `sphere_radius` when densely sampled and projected onto its smooth surface with support `radius`: the
/// leading order, `917/261976 ρ⁴/r³`, in m. The derivation is at the head of this module.
///
/// ```
/// use gpwrm::mls::{smooth, sphere_bias};
/// # use gpwrm::nalgebra::{Point3, UnitVector3, Vector3};
/// # let golden = std::f64::consts::PI * (3.0 - 5_f64.sqrt());
/// # let normals: Vec<UnitVector3<f64>> = (0..2000).map(|k| {
/// #     let (z, a) = (1.0 - (2.0 * f64::from(k) + 1.0) / 2000.0, golden * f64::from(k));
/// #     let s = (1.0 - z * z).sqrt();
/// #     UnitVector3::new_normalize(Vector3::new(s * a.cos(), s * a.sin(), z))
/// # }).collect();
/// # let points: Vec<Point3<f64>> = normals.iter().map(|n| Point3::from(n.into_inner() * 0.05)).collect();
/// // `points`: 2,000, evenly on a sphere of 50 mm.
/// let grown = smooth(&points, &normals, 0.012)?;
/// let mean = grown.points.iter().map(|p| p.coords.norm() - 0.05).sum::<f64>() / 2000.0;
/// let bias = sphere_bias(0.012, 0.05); // 0.6 µm
/// assert!((bias - 0.58e-6).abs() < 0.01e-6);
/// assert!((mean - bias).abs() < 0.3 * bias);
/// # Ok::<(), gpwrm::Error>(())
/// ```
pub fn sphere_bias(radius: f64, sphere_radius: f64) -> f64 {
    917.0 / 261_976.0 * radius.powi(4) / sphere_radius.powi(3)
}

/// The smooth surface of a cloud, prepared for many projections.
#[derive(Debug, Clone)]
pub struct Surface<'a> {
    points: &'a [Point3<f64>],
    normals: &'a [UnitVector3<f64>],
    radius: f64,
    tree: Tree,
}

impl<'a> Surface<'a> {
    /// Surface of `points` with `normals` on one side, with support `radius`.
    ///
    /// # Errors
    /// No points, slices of different lengths, coordinates that are not finite, or a radius that is not positive.
    pub fn new(
        points: &'a [Point3<f64>],
        normals: &'a [UnitVector3<f64>],
        radius: f64,
    ) -> Result<Self, Error> {
        check_length("normals", points.len(), normals.len())?;
        check_coordinates("point", points.iter().map(|p| &p.coords))?;
        check_coordinates("normal", normals.iter().map(AsRef::as_ref))?;
        if !(radius > 0.0 && radius <= 1e60) {
            return Err(Error::BadOption {
                option: "radius",
                value: radius,
                bound: "positive and at most 1e60 m",
            });
        }
        Ok(Self {
            points,
            normals,
            radius,
            tree: Tree::over(points).ok_or(Error::NoNodes)?,
        })
    }

    /// Projects `point`.
    ///
    /// # Errors
    /// A query that is not finite, or [`Error::Unsupported`] if no point of the cloud is within the radius.
    pub fn project(&self, point: &Point3<f64>) -> Result<Projection, Error> {
        check_coordinates("query", std::iter::once(&point.coords))?;
        self.project_indexed(point, 0)
    }

    fn project_indexed(&self, point: &Point3<f64>, index: usize) -> Result<Projection, Error> {
        let mut q = *point;
        let mut normal = None;
        for _ in 0..STEPS {
            let Some(step) = self.local_fit(&q) else {
                break;
            };
            q += step.height * step.normal.as_ref();
            normal = Some(step.surface_normal);
            if step.height.abs() <= SETTLED * self.radius {
                break;
            }
        }
        normal
            .map(|normal| Projection { point: q, normal })
            .ok_or(Error::Unsupported {
                index,
                radius: self.radius,
            })
    }

    fn nearest_normal(&self, near: &[Neighbour]) -> Option<UnitVector3<f64>> {
        near.iter()
            .min_by(|a, b| a.squared.total_cmp(&b.squared))
            .map(|n| self.normals[n.index])
    }

    /// The height polynomial over `q`; `None` if no point is within the radius.
    fn local_fit(&self, q: &Point3<f64>) -> Option<LocalFit> {
        let near = self.tree.within(q, self.radius);
        let weight = |distance: f64| Weight::WendlandC2.value(distance / self.radius);
        let blend: Vector3<f64> = near
            .iter()
            .map(|n| weight(n.distance()) * self.normals[n.index].as_ref())
            .sum();
        // Opposite normals cancel: then that of the nearest point is used.
        let normal = Unit::try_new(blend, 1e-9).or_else(|| self.nearest_normal(&near))?;
        let (s, t) = tangents(&normal);
        let mut normal_matrix = Matrix6::zeros();
        let mut right = Vector6::zeros();
        let (mut total, mut mean) = (0.0, 0.0);
        for n in &near {
            // In units of the radius, so that the damping below is independent of scale.
            let d = (self.points[n.index] - q) / self.radius;
            let (w, a, b, h) = (weight(n.distance()), d.dot(&s), d.dot(&t), d.dot(&normal));
            let row = Vector6::new(1.0, a, b, a * a, a * b, b * b);
            normal_matrix += w * row * row.transpose();
            right += w * h * row;
            total += w;
            mean += w * h;
        }
        if total <= 0.0 {
            return None;
        }
        let plane = LocalFit {
            height: self.radius * mean / total,
            normal,
            surface_normal: normal,
        };
        if near.len() < QUADRATIC_NEEDS {
            return Some(plane);
        }
        for k in 1..6 {
            normal_matrix[(k, k)] += DAMPING * total;
        }
        let Some(factor) = normal_matrix.cholesky() else {
            return Some(plane);
        };
        let h = factor.solve(&right);
        // A height beyond the heights of the points is extrapolation.
        if h[0].abs() > 1.0 {
            return Some(plane);
        }
        let tilted = normal.as_ref() - h[1] * s - h[2] * t;
        Some(LocalFit {
            height: self.radius * h[0],
            normal,
            surface_normal: Unit::new_normalize(tilted),
        })
    }
}

/// Height of the surface over a point, along the blended normal, and the normal of the polynomial there.
struct LocalFit {
    height: f64,
    normal: UnitVector3<f64>,
    surface_normal: UnitVector3<f64>,
}

/// Two unit vectors that complete `normal` to an orthonormal frame: any two, and not continuous in `normal`.
///
/// ```
/// use gpwrm::mls::tangents;
/// use gpwrm::nalgebra::Vector3;
/// let (s, t) = tangents(&Vector3::z_axis());
/// assert!((s.cross(&t) - Vector3::z()).norm() < 1e-15);
/// ```
pub fn tangents(normal: &UnitVector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let axis = if normal.x.abs() < 0.6 {
        Vector3::x()
    } else {
        Vector3::y()
    };
    let s = normal.cross(&axis).normalize();
    (s, normal.cross(&s))
}
