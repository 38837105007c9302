//! Where lifting tips release the body.
//!
//! ```text
//! goal = tip + across · (w_now − w_rest) − n · (h − h_release)
//! ```
//! where `across` is the direction along the table from the line through both grips toward the body, `w` the extent of the body in that
//! direction, and `h` the height of the tip: the tips move out to the width of the body at rest, and down to the table. A body that is released
//! bunched up springs out, and one released high above the table falls; both motions are too fast to track.
//!
//! A firm or hollow body stands on the table before the tips are down, and would be pressed flat, or dragged along if it cannot become wider: it would
//! spring up when it is released. The tips therefore go no lower than where they push with more than [`PRESSED`], and stop altogether when they pull or
//! push by [`RESISTED`] more than at the beginning. The weight of a stiff body may be estimated as too small; then the tips stop earlier than
//! they must, which does no harm. So no least weight is assumed here, as it is where the pull of the grips is limited.

use super::Manipulation;
use crate::cell::{Observation, Plane};
use grip_planner::Role;
use nalgebra::{Isometry3, Point3, Translation3, Vector3};

/// Force toward the table, in weights of the body, from which on the table carries it: soft bodies that are set down are pushed with 0.1 (liver) to 0.5
/// (peanut, colon).
const PRESSED: f64 = 0.7;
/// Increase of the force, in weights of the body, by which a body resists: livers spread with 0.4.
const RESISTED: f64 = 1.0;
/// Farthest that tips move outwards, metres.
const MOST_OUTWARD: f64 = 0.06;

/// How a body that is set down acts on the tips.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Reaction {
    /// The table carries it.
    Stands,
    /// It resists further motion.
    Resists,
}

/// The reaction of the body by the force of the grips at the beginning and now, in weights of the body, if there is one.
pub(super) fn reaction(
    first: &Vector3<f64>,
    now: &Vector3<f64>,
    table: &Plane,
) -> Option<Reaction> {
    if -table.normal.dot(now) > PRESSED {
        Some(Reaction::Stands)
    } else if now.norm() > first.norm() + RESISTED {
        Some(Reaction::Resists)
    } else {
        None
    }
}

/// Goal of every lifting arm; `rest` are the vertices of the model at rest, `release_height` is in metres, or `None` to stay at the present height.
pub(super) fn goals(
    manipulation: &Manipulation,
    latest: &Observation,
    rest: &[Point3<f64>],
    table: &Plane,
    release_height: Option<f64>,
) -> Vec<(usize, Isometry3<f64>)> {
    let lifting = lifting(manipulation);
    let out = outward(&lifting, latest, rest, table);
    lifting
        .iter()
        .map(|&(arm, _)| {
            let tip = latest.arms[arm].camera_from_tip;
            let height = table.height(&tip.translation.vector.into());
            let lower = release_height.map_or(0.0, |release| (height - release).max(0.0));
            let down = -table.normal.into_inner() * lower;
            (arm, Translation3::from(down + out) * tip)
        })
        .collect()
}

/// The lifting arms, and the rest positions of what they hold.
fn lifting(manipulation: &Manipulation) -> Vec<(usize, Point3<f64>)> {
    let grips = manipulation.plan.grips.iter().zip(&manipulation.at_rest);
    grips
        .filter(|(grip, _)| grip.role == Role::Lift)
        .map(|(grip, at_rest)| (grip.arm, *at_rest))
        .collect()
}

/// How far the tips must move away from the body for it to have its width at rest.
fn outward(
    lifting: &[(usize, Point3<f64>)],
    latest: &Observation,
    rest: &[Point3<f64>],
    table: &Plane,
) -> Vector3<f64> {
    let [first, second] = lifting else {
        return Vector3::zeros();
    };
    let tip = |arm: usize| latest.arms[arm].camera_from_tip.translation.vector;
    let (across, now) = extent(tip(first.0), tip(second.0), &latest.points, table);
    let (_, at_rest) = extent(first.1.coords, second.1.coords, rest, table);
    across * -(at_rest - now).clamp(0.0, MOST_OUTWARD)
}

/// Direction along the table from the line through `a` and `b` toward `points`, and their extent in it.
fn extent(
    a: Vector3<f64>,
    b: Vector3<f64>,
    points: &[Point3<f64>],
    table: &Plane,
) -> (Vector3<f64>, f64) {
    let normal = table.normal.into_inner();
    let flat = |v: Vector3<f64>| v - normal * normal.dot(&v);
    let unit = |v: Vector3<f64>| v.try_normalize(1e-9).unwrap_or_else(Vector3::zeros);
    let middle = points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / points.len().max(1) as f64;
    let along = unit(flat(b - a));
    let to = flat(middle - a);
    let across = unit(to - along * along.dot(&to));
    let mut reach: Vec<f64> = points.iter().map(|p| across.dot(&(p.coords - a))).collect();
    reach.sort_by(f64::total_cmp);
    // A few outliers must not determine the width.
    (
        across,
        reach.get(reach.len() * 99 / 100).copied().unwrap_or(0.0),
    )
}
