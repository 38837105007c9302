//! Thinning by farthest-point insertion (Gonzalez 1985, doi 10.1016/0304-3975(85)90224-5).
//!
//! ```text
//! S ← {p₀};   while max_p dist(p, S) > ε:   S ← S ∪ {the point farthest from S}          an ε-net
//! ```
//!
//! Points of the net are more than `ε` from each other and no point of the cloud is farther than `ε` from the net. Clouds from voxel grids and
//! cameras are less even, and random ones have gaps of several times their mean spacing.

use crate::error::{Error, positive};
use nalgebra::Point3;

/// Indices of `count` evenly spread points: the first point, then always the point farthest from those chosen
/// (all indices if there are no more points).
///
/// # Errors
/// [`Error::NonFinitePoint`].
///
/// # Complexity
/// `O(n·count)`: 0.1 s for 2,000 of 24,000 points.
///
/// ```
/// use cech_complex::farthest_points;
/// use cech_complex::nalgebra::Point3;
///
/// let line: Vec<_> = (0..=10).map(|i| Point3::new(f64::from(i), 0.0, 0.0)).collect();
/// assert_eq!(farthest_points(&line, 3)?, [0, 10, 5]);
/// # Ok::<(), cech_complex::Error>(())
/// ```
pub fn farthest_points(points: &[Point3<f64>], count: usize) -> Result<Vec<usize>, Error> {
    insert_farthest(points, |chosen, _| chosen < count)
}

/// Indices of an ε-net of `points`: they are more than `covering_radius` (m) from each other, and every point is within it of one of them.
/// The spacing of such a net, `√(area/n)`, is 1.0 to 1.2 covering radii on a densely sampled surface.
///
/// # Errors
/// [`Error::NonFinitePoint`], [`Error::NotPositive`].
///
/// # Complexity
/// `O(n·m)` for `m` points in the net.
///
/// ```
/// use cech_complex::epsilon_net;
/// use cech_complex::nalgebra::Point3;
///
/// let line: Vec<_> = (0..=100).map(|i| Point3::new(0.01 * f64::from(i), 0.0, 0.0)).collect();
/// let net = epsilon_net(&line, 0.3)?;
/// assert_eq!(net, [0, 100, 50]); // 0.25 m from the farthest of the others
/// # Ok::<(), cech_complex::Error>(())
/// ```
pub fn epsilon_net(points: &[Point3<f64>], covering_radius: f64) -> Result<Vec<usize>, Error> {
    let squared = positive("covering_radius", covering_radius)?.powi(2);
    insert_farthest(points, |_, distance| distance > squared)
}

/// Farthest-point insertion while `more` is true for the number of chosen points and the squared distance of the next.
fn insert_farthest(
    points: &[Point3<f64>],
    more: impl Fn(usize, f64) -> bool,
) -> Result<Vec<usize>, Error> {
    let infinite = |p: &Point3<f64>| !p.iter().all(|c| c.is_finite());
    if let Some(index) = points.iter().position(infinite) {
        let point = points[index];
        return Err(Error::NonFinitePoint { index, point });
    }
    let mut squared = vec![f64::INFINITY; points.len()];
    let mut chosen = Vec::new();
    let mut farthest = (0, f64::INFINITY);
    while chosen.len() < points.len() && more(chosen.len(), farthest.1) {
        let centre = points[farthest.0];
        chosen.push(farthest.0);
        farthest = (0, -1.0);
        for (i, (point, known)) in points.iter().zip(&mut squared).enumerate() {
            *known = known.min((point - centre).norm_squared());
            if *known > farthest.1 {
                farthest = (i, *known);
            }
        }
    }
    Ok(chosen)
}
