//! Point clouds: normals, down-sampling, and the boundary of the visible surface.
//!
//! ```text
//! normal        eigenvector of the smallest eigenvalue of Σ (p_j − p̄)(p_j − p̄)ᵀ over the k nearest,
//!               with n · (viewpoint − p) > 0
//! down-sample   one point per cube of the grid: the one nearest to its centre
//! boundary      neighbours seen along n, sorted by angle: a gap wider than the bound means that the surface ends there
//! ```

use gpwrm::Neighbour;
use gpwrm::mls::tangents;
use nalgebra::{Matrix3, Point3, Unit, UnitVector3, Vector3};

use crate::boxes::Boxes;
use crate::error::{Error, check_length, check_normals, check_points, check_range};

/// A cloud of oriented points, borrowed.
#[derive(Debug, Clone, Copy)]
pub struct Cloud<'a> {
    /// Positions, in m.
    pub points: &'a [Point3<f64>],
    /// One unit normal per point.
    pub normals: &'a [UnitVector3<f64>],
}

impl Cloud<'_> {
    /// Checks the cloud once, so that the code behind it need not.
    pub(crate) fn check(&self, cloud: &'static str) -> Result<(), Error> {
        if self.points.is_empty() {
            return Err(Error::EmptyCloud { cloud });
        }
        check_length("normals", self.points.len(), self.normals.len())?;
        check_points(cloud, self.points)?;
        check_normals(cloud, self.normals)
    }
}

/// Normals of `points` by principal components over the `k` nearest (the point itself included), turned to `viewpoint`.
///
/// If the neighbours coincide, or their plane contains the direction to the viewpoint, the normal is that direction.
///
/// # Errors
/// A coordinate that is not finite, or `k` below 3.
///
/// # Complexity
/// `O(n log n + n k)`.
///
/// ```
/// use nalgebra::Point3;
/// let plane: Vec<_> = (0..100).map(|i| Point3::new(f64::from(i % 10), f64::from(i / 10), 0.0)).collect();
/// let normals = nonrigid_reg::estimate_normals(&plane, 8, &Point3::new(5.0, 5.0, 50.0))?;
/// assert!(normals.iter().all(|n| n.z > 0.999_999));
/// # Ok::<(), nonrigid_reg::Error>(())
/// ```
pub fn estimate_normals(
    points: &[Point3<f64>],
    k: usize,
    viewpoint: &Point3<f64>,
) -> Result<Vec<UnitVector3<f64>>, Error> {
    check_points("point", points)?;
    check_points("viewpoint", std::slice::from_ref(viewpoint))?;
    check_range("k", k as f64, k >= 3, "at least 3")?;
    let normal = |i: usize, near: &[Neighbour]| {
        let toward = viewpoint - points[i];
        let n = smallest_direction(points, near);
        let oriented = n.map(|n| if n.dot(&toward) < 0.0 { -n } else { n });
        oriented
            .or_else(|| Unit::try_new(toward, 1e-12))
            .unwrap_or_else(Vector3::z_axis)
    };
    Ok(Boxes::new(points).of_all(k, normal))
}

/// Direction of smallest spread; `None` if the points coincide.
fn smallest_direction(points: &[Point3<f64>], near: &[Neighbour]) -> Option<UnitVector3<f64>> {
    let origin = points[near.first()?.index];
    let count = near.len() as f64;
    let mean: Vector3<f64> = near
        .iter()
        .map(|n| points[n.index] - origin)
        .sum::<Vector3<f64>>()
        / count;
    let mut scatter = Matrix3::zeros();
    for n in near {
        let d = points[n.index] - origin - mean;
        scatter += d * d.transpose();
    }
    let trace = scatter.trace();
    if trace <= f64::MIN_POSITIVE * 1e20 {
        return None;
    }
    let eigen = (scatter / trace).symmetric_eigen();
    let column = eigen.eigenvectors.column(eigen.eigenvalues.imin());
    Unit::try_new(column.into_owned(), 1e-9)
}

/// A cloud with one point per cell.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Downsampled {
    /// The kept points.
    pub points: Vec<Point3<f64>>,
    /// Mean normal of each cell; the kept point's own normal if the mean vanishes.
    pub normals: Vec<UnitVector3<f64>>,
    /// Index of each kept point in the input.
    pub indices: Vec<usize>,
}

/// Keeps in every cube of side `spacing` the point nearest to its centre. The result is sorted by cube, so that it does not depend on the order of
/// the input.
///
/// # Errors
/// Slices of different lengths, a coordinate that is not finite, a normal that is not a unit vector, or a spacing that is not positive or so small
/// that cells cannot be numbered (a coordinate beyond 2⁵² spacings).
///
/// # Complexity
/// `O(n log n)`.
///
/// ```
/// use nonrigid_reg::nalgebra::{Point3, Vector3};
/// use nonrigid_reg::voxel_downsample;
/// // A grid with a spacing of 1, in cubes of side 2: four points in each.
/// let grid: Vec<_> = (0..100).map(|k| Point3::new(f64::from(k % 10) + 0.4, f64::from(k / 10) + 0.4, 0.0)).collect();
/// let kept = voxel_downsample(&grid, &vec![Vector3::z_axis(); 100], 2.0)?;
/// assert_eq!(kept.points.len(), 25);
/// // The first cube contains points 0, 1, 10 and 11; its centre is above (1, 1).
/// assert_eq!((kept.indices[0], kept.points[0]), (11, grid[11]));
/// # Ok::<(), nonrigid_reg::Error>(())
/// ```
pub fn voxel_downsample(
    points: &[Point3<f64>],
    normals: &[UnitVector3<f64>],
    spacing: f64,
) -> Result<Downsampled, Error> {
    check_length("normals", points.len(), normals.len())?;
    check_points("point", points)?;
    check_normals("cloud", normals)?;
    let indices = representatives(points, spacing)?;
    let blended = indices.iter().map(|kept| {
        let sum: Vector3<f64> = kept.cell.iter().map(|&i| normals[i].into_inner()).sum();
        Unit::try_new(sum, 1e-9).unwrap_or(normals[kept.index])
    });
    Ok(Downsampled {
        points: indices.iter().map(|kept| points[kept.index]).collect(),
        normals: blended.collect(),
        indices: indices.iter().map(|kept| kept.index).collect(),
    })
}

/// A kept point and all points of its cell.
pub(crate) struct Kept {
    pub index: usize,
    pub cell: Vec<usize>,
}

/// One point per cube, sorted by cube.
pub(crate) fn representatives(points: &[Point3<f64>], spacing: f64) -> Result<Vec<Kept>, Error> {
    let largest = points.iter().map(|p| p.coords.amax()).fold(0.0, f64::max);
    // Beyond 2⁵², neighbouring cells would get the same number.
    let ok = spacing > 0.0 && spacing.is_finite() && largest / spacing < 4.5e15;
    check_range(
        "spacing",
        spacing,
        ok,
        "positive and not below 2⁻⁵² of the coordinates",
    )?;
    let cell = |p: &Point3<f64>| p.coords.map(|c| (c / spacing).floor() as i64);
    let mut keyed: Vec<([i64; 3], usize)> = points
        .iter()
        .enumerate()
        .map(|(i, p)| (cell(p).into(), i))
        .collect();
    keyed.sort_unstable();
    let kept = keyed.chunk_by(|a, b| a.0 == b.0).map(|group| {
        let cell: Vec<usize> = group.iter().map(|&(_, i)| i).collect();
        Kept {
            index: nearest_to_centre(points, &cell, group[0].0, spacing),
            cell,
        }
    });
    Ok(kept.collect())
}

/// The point nearest to the centre of the cell: unlike a distance to the mean, it does not depend on the order of summation.
fn nearest_to_centre(points: &[Point3<f64>], cell: &[usize], key: [i64; 3], spacing: f64) -> usize {
    let centre = Vector3::from(key).map(|k| (k as f64 + 0.5) * spacing);
    let distance = |i: usize| (points[i].coords - centre).norm_squared();
    cell.iter()
        .copied()
        .min_by(|&a, &b| distance(a).total_cmp(&distance(b)))
        .unwrap_or(cell[0])
}

/// Which points lie on the boundary of the visible surface: seen along the normal, the directions of the `k` nearest leave a gap wider than `angle` (rad).
///
/// # Errors
/// As for a registration: empty, mismatched or non-finite clouds, normals that are not unit vectors; `k` below 3; an angle outside `(0, 2π)`.
///
/// # Complexity
/// `O(n log n + n k log k)`.
///
/// ```
/// use nonrigid_reg::nalgebra::{Point3, Vector3};
/// use nonrigid_reg::{Cloud, boundary_points};
/// let grid: Vec<_> = (0..100).map(|k| Point3::new(f64::from(k % 10), f64::from(k / 10), 0.0)).collect();
/// let up = vec![Vector3::z_axis(); 100];
/// let ends = boundary_points(&Cloud { points: &grid, normals: &up }, 8, 120_f64.to_radians())?;
/// assert!(ends[0] && ends[5] && !ends[55]); // a corner, a side, the middle
/// assert_eq!(ends.iter().filter(|end| **end).count(), 36);
/// # Ok::<(), nonrigid_reg::Error>(())
/// ```
pub fn boundary_points(cloud: &Cloud, k: usize, angle: f64) -> Result<Vec<bool>, Error> {
    cloud.check("cloud")?;
    check_range("k", k as f64, k >= 3, "at least 3")?;
    let full = std::f64::consts::TAU;
    check_range(
        "angle",
        angle,
        angle > 0.0 && angle < full,
        "between 0 and 2π",
    )?;
    let ends = |i: usize, near: &[Neighbour]| is_boundary(cloud, near, i, angle);
    Ok(Boxes::new(cloud.points).of_all(k + 1, ends))
}

/// Whether point `i`, whose neighbours are `near`, lies on the boundary.
pub(crate) fn is_boundary(cloud: &Cloud, near: &[Neighbour], i: usize, angle: f64) -> bool {
    let (p, n) = (cloud.points[i], cloud.normals[i]);
    let (s, t) = tangents(&n);
    let others = near.iter().filter(|other| other.index != i);
    let flat = others
        .map(|other| cloud.points[other.index] - p)
        .map(|d| [d.dot(&s), d.dot(&t)]);
    if is_surrounded(flat.clone(), angle) {
        return false;
    }
    let mut directions: Vec<f64> = flat.map(|[x, y]| y.atan2(x)).collect();
    directions.sort_by(f64::total_cmp);
    let (Some(first), Some(last)) = (directions.first(), directions.last()) else {
        return true;
    };
    let around = first + std::f64::consts::TAU - last;
    let widest = directions
        .windows(2)
        .map(|pair| pair[1] - pair[0])
        .fold(around, f64::max);
    widest > angle
}

/// Whether the sectors of 15° in which there are directions already show that no gap is wider than `angle`: this decides most points, without angles.
fn is_surrounded(directions: impl Iterator<Item = [f64; 2]>, angle: f64) -> bool {
    const SECTOR: f64 = std::f64::consts::PI / 12.0;
    let tangents = [SECTOR.tan(), (2.0 * SECTOR).tan()];
    let mut full = 0_u32;
    for [x, y] in directions {
        let (least, most) = (x.abs().min(y.abs()), x.abs().max(y.abs()));
        let third = tangents.iter().filter(|t| least > *t * most).count();
        let of_quarter = if y.abs() > x.abs() { 5 - third } else { third };
        let sector = match (x < 0.0, y < 0.0) {
            (false, false) => of_quarter,
            (true, false) => 11 - of_quarter,
            (true, true) => 12 + of_quarter,
            (false, true) => 23 - of_quarter,
        };
        full |= 1 << sector;
    }
    // A gap spans the empty sectors and less than the two at its ends, up to rounding.
    let gap = angle / SECTOR - 2.0 - 1e-9;
    // Twice around, so that a run over the last sector is whole; every step leaves the sectors with one more empty one before them.
    let mut empty = !(u64::from(full) | u64::from(full) << 24) & ((1 << 48) - 1);
    let mut longest = 0;
    while empty != 0 {
        longest += 1;
        empty &= empty << 1;
    }
    full != 0 && f64::from(longest) <= gap
}

/// Point `i` with the noise across the surface reduced: moved along its normal to the mean height given by its neighbours `near`,
///
/// ```text
/// h = mean_j ½(n_i + n_j) · (p_j − p_i)        over neighbours (and p_i itself) whose normals agree
/// ```
///
/// Either normal alone errs by the curvature, in opposite directions; their mean is exact on any quadric patch, also if the neighbours lie
/// on one side only (S. Rusinkiewicz, A symmetric objective function for ICP, 2019).
pub(crate) fn denoised(cloud: &Cloud, i: usize, near: &[Neighbour]) -> Point3<f64> {
    let (p, n) = (cloud.points[i], cloud.normals[i].into_inner());
    let (mut sum, mut count) = (0.0, 0.0);
    for other in near {
        let m = cloud.normals[other.index].into_inner();
        // A neighbour whose normal differs by more than 45° belongs to another side of the object.
        if n.dot(&m) > std::f64::consts::FRAC_1_SQRT_2 {
            sum += 0.5 * (n + m).dot(&(cloud.points[other.index] - p));
            count += 1.0;
        }
    }
    if count > 0.0 {
        p + n * (sum / count)
    } else {
        p
    }
}

/// All points with the noise across the surface reduced, by their `k` nearest; `boxes` are those of the cloud.
pub(crate) fn denoise(cloud: &Cloud, boxes: &Boxes, k: usize) -> Vec<Point3<f64>> {
    if k == 0 {
        return cloud.points.to_vec();
    }
    let clean = |i: usize, near: &[Neighbour]| denoised(cloud, i, near);
    boxes.of_all(k + 1, clean)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Directions on the borders of sectors too, where rounding decides.
        #[test]
        fn surrounded_points_have_no_wide_gap(
            sixths in prop::collection::vec((0..24_u32, 0..2_u32, 0.0..1.0_f64), 1..40), angle in 0.3..6.0_f64,
        ) {
            let turns = sixths.iter().map(|&(k, beside, share)| (f64::from(k) + f64::from(beside) * share) * std::f64::consts::PI / 12.0);
            let flat: Vec<[f64; 2]> = turns.map(|turn: f64| [turn.cos(), turn.sin()]).collect();
            let mut directions: Vec<f64> = flat.iter().map(|[x, y]| y.atan2(*x)).collect();
            directions.sort_by(f64::total_cmp);
            let around = directions[0] + std::f64::consts::TAU - directions[directions.len() - 1];
            let widest = directions.windows(2).map(|pair| pair[1] - pair[0]).fold(around, f64::max);
            prop_assert!(!is_surrounded(flat.iter().copied(), angle) || widest <= angle);
            // Three sectors less than the angle are always enough.
            prop_assert!(is_surrounded(flat.iter().copied(), angle) || widest > angle - 0.79);
        }
    }
}
