//! Flying pixels up to two wide: depths between a near and a far surface, because the camera averaged the two.
//!
//! ```text
//! jump over k pixels    |r(q) − r(p)| > noise + tan θ · r(p) · spacing · k          r: distance to the camera
//! p flies  ⇔  in one of four directions a pixel within two steps on one side is nearer by a jump,
//!             and one within two steps on the other side is farther by a jump
//! ```
//! Two steps find both pixels of an edge that the camera blurred over two. A pixel on the outline of an object jumps on only one
//! side and is kept; so is a strip three pixels wide. θ is the steepest trusted angle between normal and ray, `spacing` the angle
//! between neighbouring rays, taken from the scan itself.

use nalgebra::Point3;

use super::scan::{Scan, is_measured};

const DIRECTIONS: [(isize, isize); 4] = [(1, 0), (0, 1), (1, 1), (1, -1)];
/// Largest distance of the surfaces on both sides, pixels.
const REACH: isize = 2;
const SAMPLED_ROWS: usize = 64;

/// The distances of a scan with rows.
pub(super) struct Hanging {
    ranges: Vec<f64>,
    columns: usize,
    noise: f64,
    slope: f64,
}

impl Hanging {
    /// `None` for a scan without rows, or without measured neighbours.
    pub(super) fn of(
        scan: &Scan,
        viewpoint: &Point3<f64>,
        noise: f64,
        max_incidence: f64,
    ) -> Option<Self> {
        let columns = scan.columns()?;
        let range = |point: &Point3<f64>| (point - viewpoint).norm();
        let spacing = ray_spacing(scan.points(), columns, viewpoint)?;
        Some(Self {
            ranges: scan.points().iter().map(range).collect(),
            columns,
            noise,
            slope: max_incidence.tan() * spacing,
        })
    }

    pub(super) fn hangs(&self, pixel: usize) -> bool {
        let Some(&range) = self.ranges.get(pixel) else {
            return false;
        };
        let (column, row) = (pixel % self.columns, pixel / self.columns);
        let rows = self.ranges.len() / self.columns;
        // Whether a pixel on this side is nearer, or farther, by a jump.
        let side = |du: isize, dv: isize| {
            let mut seen = [false; 2];
            for step in 1..=REACH {
                let u = column
                    .checked_add_signed(step * du)
                    .filter(|u| *u < self.columns);
                let v = row.checked_add_signed(step * dv).filter(|v| *v < rows);
                let Some(other) = u.zip(v).map(|(u, v)| self.ranges[v * self.columns + u]) else {
                    break;
                };
                let pixels = ((du.abs() + dv.abs()) as f64).sqrt() * step as f64;
                let jump = self.noise + self.slope * range * pixels;
                seen[0] |= other < range - jump;
                seen[1] |= other > range + jump;
            }
            seen
        };
        DIRECTIONS.iter().any(|&(du, dv)| {
            let ([near, far], [other_near, other_far]) = (side(du, dv), side(-du, -dv));
            (near && other_far) || (far && other_near)
        })
    }
}

/// Median angle between horizontal neighbours, radians.
fn ray_spacing(points: &[Point3<f64>], columns: usize, viewpoint: &Point3<f64>) -> Option<f64> {
    // Uses a sample of the rows: the spacing hardly changes over the image.
    let every = (points.len() / columns).div_ceil(SAMPLED_ROWS).max(1);
    let rows = points.chunks_exact(columns).step_by(every);
    let pairs = rows
        .flat_map(|row| row.windows(2))
        .filter(|pair| pair.iter().all(is_measured));
    let angle = |pair: &[Point3<f64>]| (pair[0] - viewpoint).angle(&(pair[1] - viewpoint));
    let mut angles: Vec<f64> = pairs.map(angle).filter(|angle| *angle > 0.0).collect();
    let middle = angles.len() / 2;
    if angles.is_empty() {
        return None;
    }
    let (_, median, _) = angles.select_nth_unstable_by(middle, f64::total_cmp);
    Some(*median)
}
