//! Agent box: the smallest box around the live model with one axis along the table normal.
//!
//! The footprint is the convex hull of the points in the table plane (Andrew's monotone chain). A rectangle
//! of least area has a side along a hull edge (Freeman and Shapira 1975), so the three supporting points move once around
//! the hull with the edge: rotating calipers, linear after the sort. Principal axes are not used: they
//! are undefined for square footprints and depend on the sampling density.

use nalgebra::{Point2, Point3, UnitVector3, Vector2, Vector3};

use crate::model::check_points;
use crate::{Error, Plane};

/// A box with one axis along the table normal.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct AgentBox {
    /// Centre.
    pub center: Point3<f64>,
    /// Longer horizontal side, shorter horizontal side, table normal: right-handed.
    pub axes: [UnitVector3<f64>; 3],
    /// Half the sides, in the order of the axes.
    pub half_extents: Vector3<f64>,
}

impl AgentBox {
    /// Coordinates of `point` about the centre, along the axes.
    pub fn local(&self, point: &Point3<f64>) -> Vector3<f64> {
        let d = point - self.center;
        Vector3::new(
            self.axes[0].dot(&d),
            self.axes[1].dot(&d),
            self.axes[2].dot(&d),
        )
    }
}

/// The agent box of `points` on `table`: least footprint, one axis along the normal.
///
/// # Errors
/// No points, or one that is not finite.
///
/// # Complexity
/// O(n log n) for the hull, linear in the hull for the calipers.
///
/// ```
/// # use grip_planner::{agent_box, Plane};
/// # use nalgebra::{Point3, Vector3};
/// let table = Plane { normal: Vector3::z_axis(), offset: 0.0 };
/// let corners = [[0.0, 0.0, 0.0], [2.0, 2.0, 0.0], [1.0, 3.0, 1.0], [-1.0, 1.0, 1.0]];
/// let b = agent_box(&corners.map(Point3::from), &table)?;
/// assert!((b.half_extents - Vector3::new(2f64.sqrt(), 0.5f64.sqrt(), 0.5)).norm() < 1e-12);
/// # Ok::<(), grip_planner::Error>(())
/// ```
pub fn agent_box(points: &[Point3<f64>], table: &Plane) -> Result<AgentBox, Error> {
    if points.is_empty() {
        return Err(Error::EmptyModel);
    }
    check_points(points)?;
    let [u, v] = table.axes();
    let flat: Vec<_> = points
        .iter()
        .map(|p| Point2::new(u.dot(&p.coords), v.dot(&p.coords)))
        .collect();
    let rectangle = least_rectangle(&convex_hull(flat));
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for p in points {
        let h = table.normal.dot(&p.coords);
        low = low.min(h);
        high = high.max(h);
    }
    let lift = |d: &Vector2<f64>| u.into_inner() * d.x + v.into_inner() * d.y;
    let long = UnitVector3::new_normalize(lift(&rectangle.axis));
    let short = UnitVector3::new_normalize(table.normal.cross(&long));
    let n = table.normal;
    Ok(AgentBox {
        center: Point3::from(lift(&rectangle.center.coords) + n.as_ref() * (0.5 * (low + high))),
        axes: [long, short, n],
        half_extents: Vector3::new(rectangle.half[0], rectangle.half[1], 0.5 * (high - low)),
    })
}

/// Vertices of the convex hull, counter-clockwise, no three on a line.
fn convex_hull(mut points: Vec<Point2<f64>>) -> Vec<Point2<f64>> {
    points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    points.dedup();
    if points.len() < 3 {
        return points;
    }
    let mut hull = half_hull(points.iter());
    let upper = half_hull(points.iter().rev());
    hull.pop();
    hull.extend_from_slice(&upper[..upper.len() - 1]);
    hull
}

fn half_hull<'a>(points: impl Iterator<Item = &'a Point2<f64>>) -> Vec<Point2<f64>> {
    let mut chain: Vec<Point2<f64>> = Vec::new();
    for p in points {
        while let [.., a, b] = chain[..] {
            if (b - a).perp(&(p - a)) > 0.0 {
                break;
            }
            chain.pop();
        }
        chain.push(*p);
    }
    chain
}

struct Rectangle {
    center: Point2<f64>,
    /// Direction of the longer side.
    axis: Vector2<f64>,
    half: [f64; 2],
}

/// Rotating calipers over a counter-clockwise hull.
fn least_rectangle(hull: &[Point2<f64>]) -> Rectangle {
    let count = hull.len();
    if count == 1 {
        return Rectangle {
            center: hull[0],
            axis: Vector2::x(),
            half: [0.0, 0.0],
        };
    }
    // Supporting points: farthest along the edge, farthest from it, farthest back.
    let mut support = [0usize; 3];
    let mut best: Option<(f64, Rectangle)> = None;
    for i in 0..count {
        let Some(along) = (hull[(i + 1) % count] - hull[i]).try_normalize(0.0) else {
            continue;
        };
        let across = Vector2::new(-along.y, along.x);
        let directions = [along, across, -along];
        for (k, d) in directions.iter().enumerate() {
            // Each pointer starts where the previous one stopped, and goes around at most once.
            if i == 0 {
                support[k] = if k == 0 { 1 % count } else { support[k - 1] };
            }
            support[k] = climb(hull, support[k], d);
        }
        let [front, top, back] = support.map(|s| hull[s] - hull[i]);
        let (low, high, height) = (along.dot(&back), along.dot(&front), across.dot(&top));
        let area = (high - low) * height;
        if best.as_ref().is_none_or(|(least, _)| area < *least) {
            best = Some((area, rectangle(hull[i], along, across, [low, high, height])));
        }
    }
    match best {
        Some((_, r)) => r,
        None => Rectangle {
            center: hull[0],
            axis: Vector2::x(),
            half: [0.0, 0.0],
        },
    }
}

/// Continues around the hull from `from` as long as the next vertex is farther along `d`.
fn climb(hull: &[Point2<f64>], from: usize, d: &Vector2<f64>) -> usize {
    let mut at = from;
    for _ in 0..hull.len() {
        let next = (at + 1) % hull.len();
        if d.dot(&(hull[next] - hull[at])) <= 0.0 {
            break;
        }
        at = next;
    }
    at
}

fn rectangle(
    origin: Point2<f64>,
    along: Vector2<f64>,
    across: Vector2<f64>,
    [low, high, height]: [f64; 3],
) -> Rectangle {
    let center = origin + along * (0.5 * (low + high)) + across * (0.5 * height);
    let (a, b) = (0.5 * (high - low), 0.5 * height);
    if a >= b {
        Rectangle {
            center,
            axis: along,
            half: [a, b],
        }
    } else {
        Rectangle {
            center,
            axis: across,
            half: [b, a],
        }
    }
}
