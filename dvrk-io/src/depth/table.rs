//! The table: the plane that contains most of the points.
//!
//! ```text
//! RANSAC    plane through three points, drawn by a seeded generator; the one with most points within `tolerance`
//! refine    least squares on the points within `tolerance`: normal = smallest principal axis of their covariance
//! ```
//!
//! A plane is accepted as the table if it contains enough points, no more lie below it, and its points are not spread evenly over the
//! tolerance, as on a curved surface (their root mean square distance would then be tolerance/√3).
//!
//! M. A. Fischler, R. C. Bolles: Random sample consensus, Communications of the ACM 24(6), 1981,
//! DOI 10.1145/358669.358692.

use nalgebra::{Matrix3, Point3, UnitVector3, Vector3};

use crate::Error;

/// Number of planes that are tried. A table of 30 % of the points is missed by all with (1 − 0.3³)¹⁰⁰⁰ < 10⁻¹¹.
const TRIALS: usize = 1000;
/// Number of points tested with each: a share is accurate to 1.6 % (two standard deviations).
const VOTERS: usize = 4096;
/// Root mean square distance, in tolerances, from which on points count as evenly spread: between that of noise with two standard
/// deviations equal to the tolerance (0.44) and 1/√3.
const EVEN: f64 = 0.5;
/// Rounds of least squares; the inliers rarely change after the second.
const REFINEMENTS: usize = 5;

/// The table under the object.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Table {
    /// Towards the camera.
    pub normal: UnitVector3<f64>,
    /// `normal · x + offset ≥ 0` on the free side, metres.
    pub offset: f64,
    /// Share of the points (without arms and surroundings) that lie on it within the tolerance.
    pub inlier_share: f64,
    /// Root mean square distance of those points, metres.
    pub residual: f64,
}

impl Table {
    /// Signed distance, positive on the free side.
    pub fn height(&self, point: &Point3<f64>) -> f64 {
        self.normal.dot(&point.coords) + self.offset
    }

    /// A given plane, with its fit to the points.
    pub(super) fn judged(
        normal: UnitVector3<f64>,
        offset: f64,
        points: &[Point3<f64>],
        tolerance: f64,
    ) -> Self {
        let mut table = Self {
            normal,
            offset,
            inlier_share: 0.0,
            residual: 0.0,
        };
        let heights = points.iter().map(|point| table.height(point));
        let (mut inliers, mut square) = (0_usize, 0.0);
        for height in heights.filter(|height| height.abs() <= tolerance) {
            inliers += 1;
            square += height * height;
        }
        table.inlier_share = inliers as f64 / points.len().max(1) as f64;
        table.residual = (square / inliers.max(1) as f64).sqrt();
        table
    }

    /// The plane that contains most of `points`, seen from `viewpoint`.
    ///
    /// # Errors
    /// No plane that contains a share of at least `least` of the points, or only one that cannot be a table.
    pub(super) fn find(
        points: &[Point3<f64>],
        viewpoint: &Point3<f64>,
        tolerance: f64,
        least: f64,
        seed: u64,
    ) -> Result<Self, Error> {
        let none = |share, reason| {
            Err(Error::NoTable {
                points: points.len(),
                share,
                reason,
            })
        };
        let Some((normal, offset)) = consensus(points, tolerance, seed) else {
            return none(0.0, "because no three of them span a plane".to_owned());
        };
        let mut table = Self::judged(normal, offset, points, tolerance);
        for _ in 0..REFINEMENTS {
            let inliers = points
                .iter()
                .filter(|point| table.height(point).abs() <= tolerance);
            let Some((normal, offset)) = least_squares(inliers) else {
                break;
            };
            table = Self::judged(normal, offset, points, tolerance);
        }
        if table.height(viewpoint) < 0.0 {
            (table.normal, table.offset) = (-table.normal, -table.offset);
        }
        let beneath = points
            .iter()
            .filter(|point| table.height(point) < -tolerance)
            .count();
        let beneath = beneath as f64 / points.len().max(1) as f64;
        let share = table.inlier_share;
        if share < least {
            return none(share, format!("at least {:.0} % are needed", 100.0 * least));
        }
        if beneath > share {
            return none(share, format!("but {:.0} % lie below it", 100.0 * beneath));
        }
        if table.residual > EVEN * tolerance {
            let (residual, tolerance) = (1e3 * table.residual, 1e3 * tolerance);
            return none(
                share,
                format!(
                    "spread over the tolerance of {tolerance:.1} mm as on a curved surface ({residual:.1} mm root mean square)"
                ),
            );
        }
        Ok(table)
    }
}

fn consensus(points: &[Point3<f64>], tolerance: f64, seed: u64) -> Option<(UnitVector3<f64>, f64)> {
    let mut random = Random(seed);
    let voters: Vec<_> = points
        .iter()
        .step_by(points.len().div_ceil(VOTERS).max(1))
        .collect();
    let mut best: Option<(usize, UnitVector3<f64>, f64)> = None;
    for _ in 0..TRIALS {
        let [a, b, c] = [(); 3].map(|()| random.pick(points));
        let (a, b, c) = (a?, b?, c?);
        // Collinear points, or one point drawn twice, span no plane.
        let cross = (b - a).cross(&(c - a));
        let length = (b - a).norm() * (c - a).norm();
        let Some(normal) = UnitVector3::try_new(cross, 1e-3 * length).filter(|_| length > 0.0)
        else {
            continue;
        };
        let offset = -normal.dot(&a.coords);
        let on = |point: &&&Point3<f64>| (normal.dot(&point.coords) + offset).abs() <= tolerance;
        let votes = voters.iter().filter(on).count();
        if best.is_none_or(|(most, ..)| votes > most) {
            best = Some((votes, normal, offset));
        }
    }
    best.map(|(_, normal, offset)| (normal, offset))
}

fn least_squares<'a>(
    points: impl Iterator<Item = &'a Point3<f64>> + Clone,
) -> Option<(UnitVector3<f64>, f64)> {
    let count = points.clone().count();
    if count < 3 {
        return None;
    }
    let mean = points
        .clone()
        .map(|point| point.coords)
        .sum::<Vector3<f64>>()
        / count as f64;
    let spread = |sum: Matrix3<f64>, point: &Point3<f64>| {
        let d = point.coords - mean;
        sum + d * d.transpose()
    };
    let eigen = points.fold(Matrix3::zeros(), spread).symmetric_eigen();
    let normal = UnitVector3::try_new(
        eigen.eigenvectors.column(eigen.eigenvalues.imin()).into(),
        0.5,
    )?;
    Some((normal, -normal.dot(&mean)))
}

/// `SplitMix64` (G. L. Steele et al., OOPSLA 2014): the same planes for the same seed.
struct Random(u64);

impl Random {
    fn pick<'a, T>(&mut self, items: &'a [T]) -> Option<&'a T> {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        items.get(((z ^ (z >> 31)) % items.len().max(1) as u64) as usize)
    }
}
