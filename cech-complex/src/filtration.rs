//! The filtration value of a simplex with its certificate.
//!
//! ```text
//! f(σ) = min_y max_{i∈σ} g_i(y)
//! ```
//!
//! A convex problem in three unknowns. The active-set method solves nearly all of them in a few small linear systems; the rest
//! alternates between the barrier method and the active set. Either gives a bracket: the upper end is attained at a point that is
//! returned, the lower end follows from weak duality (module `problem`), so that neither relies on the solvers.

use crate::active_set::{self, ActiveSet};
use crate::barrier::Path;
use crate::cylinder::Cylinder;
use crate::error::Error;
use crate::problem::{Bracket, Goal, Oriented, Problem};
use nalgebra::{Point3, UnitVector3, Vector3};

/// Relative gap at which a value counts as certified, well above rounding.
pub(crate) const TOLERANCE: f64 = 1e-12;
/// Gaps of the barrier at which the active-set method is tried again. The last is as small as rounding in the
/// barrier allows.
const CROSSOVERS: [f64; 3] = [1e-3, 1e-6, 1e-10];

/// Filtration value of a simplex.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct FiltrationValue {
    /// Scale at which the cylinders first share a point: an upper bound of the exact value, attained at `minimiser`.
    pub value: f64,
    /// Certified lower bound of the exact value, up to rounding (about 1e-14 relative).
    pub lower: f64,
    /// The common point of the cylinders at scale `value`.
    pub minimiser: Point3<f64>,
}

impl FiltrationValue {
    /// Certified relative gap `(value − lower)/value`.
    pub fn gap(&self) -> f64 {
        if self.value > 0.0 {
            (self.value - self.lower) / self.value
        } else {
            0.0
        }
    }
}

/// Filtration value `f(σ) = min_y max_{i∈σ} g_i(y)` of one to four cylinders at `points` with `normals`.
///
/// # Guarantees
/// The exact value lies in `[lower, value]` up to rounding. The relative gap is at most about 1e-12, except where normals differ by an
/// angle between 1e-12 and 1e-6 *and* the cylinders are stacked: there the rims of the cylinders decide, and the bracket may stay as wide as
/// the angle.
///
/// # Errors
/// [`Error::SimplexSize`], [`Error::LengthMismatch`], [`Error::NonFinitePoint`], [`Error::NonUnitNormal`].
///
/// ```
/// use cech_complex::{Cylinder, filtration_value};
/// use nalgebra::{Point3, Vector3};
///
/// // Two coaxial cylinders of height 2 whose centres are 3 apart touch at scale 1.5.
/// let f = filtration_value(
///     &[Point3::origin(), Point3::new(0.0, 0.0, 3.0)],
///     &[Vector3::z_axis(), Vector3::z_axis()],
///     Cylinder::new(1.0, 2.0)?,
/// )?;
/// assert!((f.value - 1.5).abs() < 1e-12 && f.gap() < 1e-12);
/// # Ok::<(), cech_complex::Error>(())
/// ```
pub fn filtration_value(
    points: &[Point3<f64>],
    normals: &[UnitVector3<f64>],
    cylinder: Cylinder,
) -> Result<FiltrationValue, Error> {
    match *check_cloud(points, normals)? {
        [a] => Ok(solve(&[a], cylinder, None, f64::INFINITY)),
        [a, b] => Ok(solve(&[a, b], cylinder, None, f64::INFINITY)),
        [a, b, c] => Ok(solve(&[a, b, c], cylinder, None, f64::INFINITY)),
        [a, b, c, d] => Ok(solve(&[a, b, c, d], cylinder, None, f64::INFINITY)),
        _ => Err(Error::SimplexSize {
            count: points.len(),
        }),
    }
}

/// Checks a cloud.
pub(crate) fn check_cloud(
    points: &[Point3<f64>],
    normals: &[UnitVector3<f64>],
) -> Result<Vec<Oriented>, Error> {
    if points.len() != normals.len() {
        let others = normals.len();
        return Err(Error::LengthMismatch {
            points: points.len(),
            what: "normals",
            others,
        });
    }
    let check = |(index, (point, normal)): (usize, (&Point3<f64>, &UnitVector3<f64>))| {
        if !point.iter().all(|c| c.is_finite()) {
            return Err(Error::NonFinitePoint {
                index,
                point: *point,
            });
        }
        // UnitVector3 can be built unchecked; 1e-6 admits normals converted from f32.
        let unit = (normal.norm_squared() - 1.0).abs() < 1e-6;
        if !unit {
            return Err(Error::NonUnitNormal {
                index,
                normal: normal.into_inner(),
            });
        }
        Ok(())
    };
    points.iter().zip(normals).enumerate().try_for_each(check)?;
    Ok(orient(points, normals))
}

/// Lower bound of a pair from three fixed directions, without any iteration: `L(w) = |w·(q − p)|/(h_1(w) + h_2(w))`.
pub(crate) fn pair_lower_bound(a: &Oriented, b: &Oriented, cylinder: Cylinder) -> f64 {
    let between = b.point - a.point;
    let (half, radius) = (cylinder.half_height(), cylinder.radius());
    let bound = |w: &Vector3<f64>| {
        let reach = crate::cylinder::support(w, &a.normal, half, radius)
            + crate::cylinder::support(w, &b.normal, half, radius);
        if reach > 0.0 {
            w.dot(&between).abs() / reach
        } else {
            0.0
        }
    };
    bound(&a.normal).max(bound(&b.normal)).max(bound(&between))
}

/// The cylinders of a cloud that has been checked.
pub(crate) fn orient(points: &[Point3<f64>], normals: &[UnitVector3<f64>]) -> Vec<Oriented> {
    let oriented = |(point, normal): (&Point3<f64>, &UnitVector3<f64>)| Oriented {
        point: point.coords,
        normal: normal.normalize(),
    };
    points.iter().zip(normals).map(oriented).collect()
}

/// Solves one simplex. `guess` is a point near the minimiser; a lower bound above `cutoff` ends the search early.
pub(crate) fn solve<const N: usize>(
    simplex: &[Oriented; N],
    cylinder: Cylinder,
    guess: Option<&Vector3<f64>>,
    cutoff: f64,
) -> FiltrationValue {
    let goal = Goal {
        tolerance: TOLERANCE,
        cutoff,
        enough: f64::NEG_INFINITY,
    };
    search(simplex, cylinder, guess, goal)
}

/// Brackets the value of one simplex until the goal is reached.
pub(crate) fn search<const N: usize>(
    simplex: &[Oriented; N],
    cylinder: Cylinder,
    guess: Option<&Vector3<f64>>,
    goal: Goal,
) -> FiltrationValue {
    let centre = simplex.iter().map(|o| o.point).sum::<Vector3<f64>>() / N as f64;
    let size = simplex
        .iter()
        .map(|o| (o.point - centre).norm())
        .fold(0.0, f64::max);
    if size <= 0.0 {
        return FiltrationValue {
            value: 0.0,
            lower: 0.0,
            minimiser: centre.into(),
        };
    }
    let width = cylinder.radius().max(cylinder.half_height());
    let problem = Problem {
        points: simplex.map(|oriented| (oriented.point - centre) / size),
        normals: simplex.map(|oriented| oriented.normal),
        half_height: cylinder.half_height() / width,
        radius: cylinder.radius() / width,
    };
    let per_unit = size / width;
    let start = guess.map_or_else(Vector3::zeros, |y| (y - centre) / size);
    let goal = Goal {
        cutoff: goal.cutoff / per_unit,
        enough: goal.enough / per_unit,
        ..goal
    };
    let bracket = minimise(&problem, start, &goal);
    FiltrationValue {
        value: bracket.upper * per_unit,
        lower: bracket.lower.min(bracket.upper) * per_unit,
        minimiser: (centre + bracket.y * size).into(),
    }
}

/// Active set first; if it does not reach the goal, barrier and active set in turns.
fn minimise<const N: usize>(problem: &Problem<N>, start: Vector3<f64>, goal: &Goal) -> Bracket {
    let pieces = problem.pieces(&start);
    let mut bracket = Bracket {
        lower: 0.0,
        upper: pieces.max(),
        y: start,
    };
    let mut active = ActiveSet::at(&pieces);
    active_set::refine(problem, &mut active, &mut bracket, goal);
    if bracket.settled(goal) {
        return bracket;
    }
    let mut path = Path::new(problem);
    for gap in CROSSOVERS {
        let multipliers = path.follow(problem, &mut bracket, gap, goal);
        if bracket.settled(goal) {
            break;
        }
        let mut active = ActiveSet::from_multipliers(&multipliers, 0.1 * gap.sqrt());
        active_set::refine(problem, &mut active, &mut bracket, goal);
        if bracket.settled(goal) {
            break;
        }
    }
    bracket
}
