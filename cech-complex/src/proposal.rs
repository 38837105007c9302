//! Proposes a cylinder and two scales for a cloud from its estimated spacing, gaps, noise and reach.

use crate::cylinder::Cylinder;
use crate::error::Error;
use crate::filtration::check_cloud;
use crate::options::Orientation;
use crate::problem::Oriented;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use nalgebra::{Matrix6, Point3, UnitVector3, Vector2, Vector3, Vector6};

/// Number of neighbours of a point that are used: a disc of about four spacings.
const NEIGHBOURS: usize = 48;
/// Number of nearest neighbours to which the quadric is fitted.
const FITTED: usize = 24;
/// Smallest number of points.
const FEWEST: usize = 24;
/// A height is significant beyond this many standard deviations of noise and tilt.
const SIGNIFICANT: f64 = 4.0;
/// Quantile of the cells that gives the covering radius: noise opens a cell in a hundred.
const COVERED: f64 = 0.99;
/// An even sampling has gaps of up to this many spacings; beyond, thinning makes it even.
const EVEN: f64 = 1.4;
/// Radius of the cylinders, in covering radii.
const RADIUS_PER_GAP: f64 = 1.1;
/// Smallest radius, in spacings.
const RADIUS_PER_SPACING: f64 = 1.25;
/// Smallest half height, in radii.
const HALF_HEIGHT_PER_RADIUS: f64 = 0.25;
/// Standard deviations of noise within half the height.
const NOISE_IN_HALF_HEIGHT: f64 = 2.0;
/// Second scale: classes due to gaps and noise die before it, those of the surface do not.
const SECOND_SCALE: f64 = 1.3;

/// Estimated properties of a cloud, and how to build its complex. Lengths in m.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Proposal {
    /// `√(area/n)`.
    pub spacing: f64,
    /// Distance from a point of the surface to the nearest sample in all but a hundredth of the gaps, away from the boundary: about one spacing on a net, two on random points.
    pub covering_radius: f64,
    /// Standard deviation of the points along the normal.
    pub noise: f64,
    /// Root mean square angle between the given normals and those of the fitted surface, rad.
    pub tilt: f64,
    /// Estimated reach, within four spacings; infinite if the surface looks flat. Near an edge or a junction about a spacing.
    pub reach: f64,
    /// Covering radius of the [`epsilon_net`](crate::epsilon_net) to take first, if the sampling is uneven: then call `propose`
    /// again for the net.
    pub thin_to: Option<f64>,
    /// The cylinder to build with.
    pub cylinder: Cylinder,
    /// First scale for [`persistent_betti`](crate::Complex::persistent_betti).
    pub from: f64,
    /// Second scale, and `max_scale` of the build.
    pub to: f64,
}

/// Proposes how to build the complex of a cloud: a cylinder and two scales.
///
/// ```text
/// V(p)    Voronoi cell of p among its neighbours in the tangent plane      spacing = √(mean area),  ε = the farthest corner
/// fit     z = a + b·u + ½ uᵀ K u over the neighbours of p                  noise = rms residual,  tilt = |b|
/// τ       min over pairs of ‖q − p‖² / (2·dist(q, T_p))                   reach (Federer 1959, theorem 4.18)
/// ```
///
/// The formula for the reach is exact for a surface without noise; on samples it can only overestimate (Aamari, Kim, Chazal, Michel, Rinaldo and
/// Wasserman 2019, doi 10.1214/19-EJS1551). Here the height of a neighbour counts only as far as noise and tilt cannot explain it, so noisy clouds are taken for
/// flatter than they are, not for more curved.
///
/// # Guarantees
/// None: a sample does not determine its surface. On the surfaces of the module `manifolds` sampled as nets, voxel grids and at random, with noise of up
/// to a fifth of the spacing, `cargo run --release -p cech-complex --features manifolds --example proposals` counts how often the Betti numbers are right.
///
/// # Errors
/// Those of a cloud ([`Error::LengthMismatch`], [`Error::NonFinitePoint`], [`Error::NonUnitNormal`]), and [`Error::NoSurface`] for fewer than 24
/// points or where no point has neighbours on all sides.
///
/// # Complexity
/// `O(n log n)`, about 20 µs a point.
///
/// ```
/// use cech_complex::manifolds::Manifold;
/// use cech_complex::{Complex, Options, Orientation, epsilon_net, propose};
///
/// // Drawn at random, with noise: uneven, so thinned first.
/// let torus = Manifold::Torus { major: 1.0, minor: 0.4 };
/// let cloud = torus.uniform(6000, 1).with_noise(0.004, 0.05, 2);
/// let orientation = Orientation::default();
/// let first = propose(&cloud.points, &cloud.normals, orientation)?;
/// let net = epsilon_net(&cloud.points, first.thin_to.unwrap())?;
/// let points: Vec<_> = net.iter().map(|&i| cloud.points[i]).collect();
/// let normals: Vec<_> = net.iter().map(|&i| cloud.normals[i]).collect();
///
/// let proposal = propose(&points, &normals, orientation)?;
/// assert_eq!(proposal.thin_to, None);
/// let options = Options::default().with_orientation(orientation).with_max_scale(proposal.to);
/// let complex = Complex::build(&points, &normals, proposal.cylinder, &options)?;
/// assert_eq!(complex.persistent_betti(proposal.from, proposal.to), [1, 2, 1]);
/// # Ok::<(), cech_complex::Error>(())
/// ```
pub fn propose(
    points: &[Point3<f64>],
    normals: &[UnitVector3<f64>],
    orientation: Orientation,
) -> Result<Proposal, Error> {
    let cloud = check_cloud(points, normals)?;
    let looks = Looks::at(&cloud, orientation);
    let interior = looks.interior.len();
    if cloud.len() < FEWEST || interior == 0 {
        let points = cloud.len();
        return Err(Error::NoSurface { points, interior });
    }
    let spacing = looks.spacing();
    let covering_radius = looks.covering_radius();
    let (noise, tilt) = (looks.noise(), looks.tilt());
    let reach = looks.reach(noise, tilt);

    let radius = (RADIUS_PER_SPACING * spacing).max(RADIUS_PER_GAP * covering_radius);
    let off_plane = sag(radius, reach) + NOISE_IN_HALF_HEIGHT * noise;
    let half_height = off_plane.clamp(HALF_HEIGHT_PER_RADIUS * radius, radius);
    Ok(Proposal {
        spacing,
        covering_radius,
        noise,
        tilt,
        reach,
        thin_to: (covering_radius > EVEN * spacing).then_some(covering_radius),
        cylinder: Cylinder::new(radius, 2.0 * half_height)?,
        from: 1.0,
        to: SECOND_SCALE,
    })
}

/// Distance of a surface of the given reach from its tangent plane within `radius`; half the radius if the reach is smaller, as at an edge.
fn sag(radius: f64, reach: f64) -> f64 {
    if reach.is_infinite() {
        0.0
    } else if radius < reach {
        reach - (reach * reach - radius * radius).sqrt()
    } else {
        0.5 * radius
    }
}

/// The neighbourhood of one point in its tangent plane.
struct Look {
    /// Area of the Voronoi cell and distance of its farthest corner; `None` if the cell is open, at the boundary or at a gap of four spacings.
    cell: Option<(f64, f64)>,
    /// Mean square residual of the fitted surface and its squared slope at the point.
    fit: Option<(f64, f64)>,
    /// Offset along the normal and squared distance of every neighbour.
    offsets: Vec<(f64, f64)>,
}

/// The neighbourhoods of all points.
struct Looks {
    all: Vec<Look>,
    /// Points whose cells are closed, as are those of their neighbours.
    interior: Vec<usize>,
}

impl Looks {
    fn at(cloud: &[Oriented], orientation: Orientation) -> Self {
        let coordinates: Vec<[f64; 3]> = cloud.iter().map(|o| o.point.into()).collect();
        let Ok(tree) = ImmutableKdTree::<f64, 3>::new_from_slice(&coordinates) else {
            return Self {
                all: Vec::new(),
                interior: Vec::new(),
            };
        };
        let wanted = (NEIGHBOURS + 1).min(cloud.len());
        let wanted = std::num::NonZero::new(wanted).unwrap_or(std::num::NonZero::<usize>::MIN);
        let mut fitted = Vec::with_capacity(cloud.len());
        let mut all = Vec::with_capacity(cloud.len());
        for (i, at) in cloud.iter().enumerate() {
            let hits = tree
                .query(&coordinates[i])
                .nearest_n::<SquaredEuclidean<f64>>(wanted)
                .execute();
            let mut near: Vec<(f64, u32)> = hits.iter().map(|h| (h.distance, h.item)).collect();
            near.retain(|&(distance, j)| {
                distance > 0.0 && !orientation.separates(&at.normal, &cloud[j as usize].normal)
            });
            // The tree returns neighbours at equal distance in any order.
            near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            let offset = |&(_, j): &(f64, u32)| cloud[j as usize].point - at.point;
            let offsets: Vec<Vector3<f64>> = near.iter().map(offset).collect();
            all.push(Look::new(&at.normal, &offsets));
            fitted.push(
                near.iter()
                    .take(FITTED)
                    .map(|&(_, j)| j)
                    .collect::<Vec<_>>(),
            );
        }
        let closed = |j: &u32| all[*j as usize].cell.is_some();
        let interior = (0..cloud.len())
            .filter(|&i| all[i].cell.is_some() && fitted[i].iter().all(closed))
            .collect();
        Self { all, interior }
    }

    fn cells(&self) -> impl Iterator<Item = (f64, f64)> {
        self.interior.iter().filter_map(|&i| self.all[i].cell)
    }

    fn spacing(&self) -> f64 {
        let area: f64 = self.cells().map(|(area, _)| area).sum();
        (area / self.interior.len() as f64).sqrt()
    }

    fn covering_radius(&self) -> f64 {
        quantile(self.cells().map(|(_, corner)| corner).collect(), COVERED)
    }

    fn noise(&self) -> f64 {
        let fits = self.all.iter().filter_map(|look| look.fit);
        quantile(fits.map(|(residual, _)| residual).collect(), 0.5).sqrt()
    }

    /// The square of a Gaussian slope in two directions is exponentially distributed: its median is ln 2 times its mean.
    fn tilt(&self) -> f64 {
        let fits = self.all.iter().filter_map(|look| look.fit);
        let median = quantile(fits.map(|(_, slope)| slope).collect(), 0.5);
        (median / std::f64::consts::LN_2).sqrt().atan()
    }

    fn reach(&self, noise: f64, tilt: f64) -> f64 {
        let of_pair = |&(height, squared): &(f64, f64)| {
            let deviation = (2.0 * noise * noise + 0.5 * tilt * tilt * squared).sqrt();
            let curved = height.abs() - SIGNIFICANT * deviation;
            if curved > 0.0 {
                squared / (2.0 * curved)
            } else {
                f64::INFINITY
            }
        };
        let of_point = |look: &Look| {
            look.offsets
                .iter()
                .map(of_pair)
                .fold(f64::INFINITY, f64::min)
        };
        quantile(self.all.iter().map(of_point).collect(), 0.01)
    }
}

impl Look {
    fn new(normal: &Vector3<f64>, offsets: &[Vector3<f64>]) -> Self {
        let across = if normal.x.abs() < 0.6 {
            Vector3::x()
        } else {
            Vector3::y()
        };
        let u = normal.cross(&across).normalize();
        let w = normal.cross(&u);
        let place = |d: &Vector3<f64>| Vector2::new(u.dot(d), w.dot(d));
        // A neighbour steeper than 45° belongs to another sheet.
        let flat = |d: &&Vector3<f64>| 2.0 * normal.dot(d).powi(2) < d.norm_squared();
        let sheet: Vec<&Vector3<f64>> = offsets.iter().filter(flat).collect();
        let planar: Vec<Vector2<f64>> = sheet.iter().map(|d| place(d)).collect();
        let heights: Vec<f64> = sheet.iter().map(|d| normal.dot(d)).collect();
        let fitted = FITTED.min(planar.len());
        Self {
            cell: voronoi_cell(&planar),
            fit: quadric(&planar[..fitted], &heights[..fitted]),
            offsets: offsets
                .iter()
                .map(|d| (normal.dot(d), d.norm_squared()))
                .collect(),
        }
    }
}

/// Area of the Voronoi cell of the origin among `others`, and the distance of its farthest corner; `None` if points beyond those given could change it.
fn voronoi_cell(others: &[Vector2<f64>]) -> Option<(f64, f64)> {
    let extent = others.iter().map(Vector2::norm).fold(0.0, f64::max);
    let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
    let mut cell = corners.map(|(x, y)| Vector2::new(x, y) * extent).to_vec();
    for other in others {
        let inside = |y: &Vector2<f64>| 0.5 * other.norm_squared() - other.dot(y);
        let mut clipped = Vec::with_capacity(cell.len() + 1);
        for (a, b) in cell.iter().zip(cell.iter().cycle().skip(1)) {
            let (at_a, at_b) = (inside(a), inside(b));
            if at_a >= 0.0 {
                clipped.push(*a);
            }
            if (at_a >= 0.0) != (at_b >= 0.0) {
                clipped.push(a + (b - a) * (at_a / (at_a - at_b)));
            }
        }
        cell = clipped;
    }
    let corner = cell.iter().map(Vector2::norm).fold(0.0, f64::max);
    let next = cell.iter().cycle().skip(1);
    let area: f64 = cell.iter().zip(next).map(|(a, b)| 0.5 * a.perp(b)).sum();
    (cell.len() > 2 && corner < 0.5 * extent).then_some((area, corner))
}

/// Least squares of `z = a + b·u + ½ uᵀ K u`: mean square residual and squared slope `|b|²`.
fn quadric(places: &[Vector2<f64>], heights: &[f64]) -> Option<(f64, f64)> {
    let extent = places.iter().map(Vector2::norm).fold(0.0, f64::max);
    let freedom = places.len().checked_sub(6).filter(|freedom| *freedom > 0)? as f64;
    let row = |p: &Vector2<f64>| {
        let (x, y) = (p.x / extent, p.y / extent);
        Vector6::new(1.0, x, y, x * x, x * y, y * y)
    };
    let mut normal = Matrix6::zeros();
    let mut right = Vector6::zeros();
    for (place, height) in places.iter().zip(heights) {
        let row = row(place);
        normal += row * row.transpose();
        right += row * *height;
    }
    let fit = normal.cholesky()?.solve(&right);
    let residual = |(place, height): (&Vector2<f64>, &f64)| (row(place).dot(&fit) - height).powi(2);
    let squares: f64 = places.iter().zip(heights).map(residual).sum();
    let slope = (fit[1] * fit[1] + fit[2] * fit[2]) / (extent * extent);
    Some((squares / freedom, slope))
}

/// The value below which the given share of `values` lies; 0 without any.
fn quantile(mut values: Vec<f64>, share: f64) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let rank = ((values.len() - 1) as f64 * share) as usize;
    *values.select_nth_unstable_by(rank, f64::total_cmp).1
}
