//! Turns: about which sides of its box the body can be turned, and how suitable two grips are.
//!
//! In the plane perpendicular to a horizontal axis `a` of the agent box let `l` be the direction from the foot to the lifted side
//! and `n` the table normal, so that `a = l × n` and a rotation by +θ raises `l`:
//!
//! ```text
//!            n                      m⊥ = m without its component along a
//!      ______|______ _              α = angle from m⊥ to the camera, in the sense of the lift
//!     |             | t             θ = clamp(α, ¼, ½ turn); a body flatter than 0.7 cannot rest on an
//!  ___P_____________|___ l          edge, so it makes the whole half turn
//!         span
//! ```
//!
//! The **gain** is the share of the missing surface that comes to face the camera: for a direction `d` of hidden surface, `|d|` times the mean of
//! `max(0, cos(d, camera) − e)/(1 − e)` at the end and at the best moment of the turn (so that the side toward which it leans is lifted); surface that
//! stays nearly edge-on, `e = cos 80°`, does not count. The directions are `m`, weighted by its length, and the normals at the boundary of the explored part, each weighted by the area of its
//! vertex, since hidden surface next to a boundary has about the same orientation. While the underside is missing `m` dominates; the last missing part, a
//! band around the body whose vector area is nearly zero, is found by its boundary. If a closed surface is known, its pieces that
//! were never seen replace both ([`Model::hidden`]), because the boundary of a small hole faces all ways but that of the hole. The gain is multiplied by `length/longest side`: if `m` points straight down
//! all four turns show it equally well, and the one about the longer side, which lifts least, should be chosen.
//!
//! The ends of the body, whose normals are along the axis, stay edge-on during the whole turn. A turn that would leave more than [`LEFT`] of the surface
//! unseen for that reason is also offered with a **tilt**: while the body hangs, its axis is tilted by `τ` to one side and then to the
//! other; the best moment may then be one of those.
//!
//! The **suitability** of two lifting grips is a product of factors between 0 and 1: both on the lifted side (a long lever),
//! 40 to 80 % of the length apart, level with the axis, and balanced about the centre. If the grips are close together a soft body hangs from
//! one point, and may come down on any side.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_3, PI};

use nalgebra::{Point3, UnitQuaternion, UnitVector3, Vector3};

use crate::scene::within;
use crate::{Error, Model, Scene, agent_box, missing_vector_area};

/// Below this share of the known area, missing vector area is sampling noise without a direction.
const NOISE: f64 = 0.01;
/// Hidden pieces whose vector areas cancel to less than this share have no common direction.
const ONE_WAY: f64 = 0.5;
/// A body lower than this share of its span cannot rest on its side.
const STANDS: f64 = 0.7;
/// Cosine to the direction of the camera below which surface is too nearly edge-on to be seen.
const EDGE_ON: f64 = 0.17;
/// Share of the surface left unseen by a turn above which a tilt is worth its time.
const LEFT: f64 = 0.001;

/// A turn about one side of the agent box.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Turn {
    /// A rotation about it by a positive angle lifts.
    pub axis: UnitVector3<f64>,
    /// Horizontal, from the pivot to the side that is lifted.
    pub lifted: UnitVector3<f64>,
    /// Table normal.
    pub up: UnitVector3<f64>,
    /// Centre of the pivot line, on the table at the foot of the box.
    pub pivot: Point3<f64>,
    /// Width of the box from the pivot to the lifted side.
    pub span: f64,
    /// Length of the box along the axis.
    pub length: f64,
    /// Height of the body above the table.
    pub thickness: f64,
    /// Angle of the turn, radians.
    pub angle: f64,
    /// Tilt of the axis to either side while the body hangs, radians; 0 without.
    pub tilt: f64,
    /// Share of the missing area that the turn shows, 0 to 1.
    pub gain: f64,
}

impl Turn {
    /// Coordinates of a point: along the axis, from the pivot toward the lifted side, above the table.
    pub fn local(&self, point: &Point3<f64>) -> Vector3<f64> {
        let d = point - self.pivot;
        Vector3::new(self.axis.dot(&d), self.lifted.dot(&d), self.up.dot(&d))
    }

    /// The point with the given coordinates.
    pub fn point(&self, local: &Vector3<f64>) -> Point3<f64> {
        self.pivot
            + self.axis.as_ref() * local.x
            + self.lifted.as_ref() * local.y
            + self.up.as_ref() * local.z
    }

    /// A rotation about it by a positive angle raises points farther along [`Self::axis`].
    pub(crate) fn tilt_axis(&self) -> UnitVector3<f64> {
        -self.lifted
    }

    /// The point reflected to the other side of the box: about where a grip ends when the body is turned in place.
    pub(crate) fn mirrored(&self, point: &Point3<f64>) -> Point3<f64> {
        point + self.lifted.as_ref() * (self.span - 2.0 * self.local(point).y)
    }

    /// Suitability of two grips for lifting, 0 to 1; `spread` is the wanted distance as a share of the length.
    pub fn suitability(&self, grips: [&Point3<f64>; 2], spread: [f64; 2]) -> f64 {
        let [a, b] = grips.map(|p| self.local(p));
        let apart = b - a;
        let level = if apart.norm() > 0.0 {
            apart.x.abs() / apart.norm()
        } else {
            0.0
        };
        self.lever(a.y)
            * self.lever(b.y)
            * self.spread(apart.x.abs(), spread)
            * level
            * level
            * self.balance(a.x + b.x)
    }

    /// 0 at the centre of the body, 1 from nine tenths of the distance to the lifted side.
    fn lever(&self, along: f64) -> f64 {
        if self.span <= 0.0 {
            return 0.0;
        }
        ((along / self.span - 0.5) / 0.4).clamp(0.0, 1.0)
    }

    /// A trapezoid: 0 at half the lower bound, 1 between the bounds, a half at the full length of the box.
    fn spread(&self, apart: f64, [low, high]: [f64; 2]) -> f64 {
        if self.length <= 0.0 {
            return 0.0;
        }
        let share = apart / self.length;
        if share < low {
            return ((share - 0.5 * low) / (0.5 * low)).clamp(0.0, 1.0);
        }
        (1.0 - (share - high).max(0.0) / (2.0 * (1.0 - high).max(0.1))).clamp(0.0, 1.0)
    }

    /// 1 if the centre of the grips is that of the box, 0 if it is at its end.
    fn balance(&self, sum: f64) -> f64 {
        (1.0 - (sum / self.length).powi(2)).clamp(0.0, 1.0)
    }
}

/// The four turns about the sides of the agent box, and those that leave less unseen if the body is tilted by `tilt` (radians) to either
/// side while it hangs; best gain first.
///
/// # Errors
/// An invalid model or scene; a tilt outside 0 to 60°.
///
/// ```
/// use grip_planner::turns;
/// # use grip_planner::nalgebra::{Point3, Vector3};
/// # use grip_planner::{Model, Plane, Scene};
/// # let up = -Vector3::z_axis();
/// # let scene = Scene {
/// #     table: Plane { normal: up, offset: 0.5 },
/// #     arms: &[],
/// #     camera: Point3::origin(),
/// #     jaw_radius: 0.005,
/// #     shaft_length: 0.05,
/// #     jaw_separation: 0.02,
/// #     clearance: 0.003,
/// # };
/// // The top of a slab of 0.2 × 0.12 × 0.03 m, seen from above: its underside is missing.
/// let corners = [[0.1, 0.06, 0.47], [-0.1, 0.06, 0.47], [-0.1, -0.06, 0.47], [0.1, -0.06, 0.47]];
/// let points = corners.map(Point3::from);
/// # let model = Model {
/// #     points: &points,
/// #     normals: &[up; 4],
/// #     areas: &[0.006; 4],
/// #     edges: &[],
/// #     boundary: &[false; 4],
/// #     visible: &[true; 4],
/// #     hidden: &[],
/// # };
/// let turns = turns(&model, &scene, 0.0)?;
/// // Every half turn shows all of it, and the ones that lift a long side lift the body least.
/// let gains: Vec<f64> = turns.iter().map(|turn| turn.gain).collect();
/// assert_eq!(gains.len(), 4);
/// for (gain, expected) in gains.iter().zip([1.0, 1.0, 0.6, 0.6]) {
///     assert!((gain - expected).abs() < 1e-9);
/// }
/// assert!(turns[0].lifted.y.abs() > 0.999);
/// assert!((turns[0].angle - std::f64::consts::PI).abs() < 1e-9);
/// # Ok::<(), grip_planner::Error>(())
/// ```
pub fn turns(model: &Model, scene: &Scene, tilt: f64) -> Result<Vec<Turn>, Error> {
    model.check()?;
    scene.check()?;
    check_tilt(tilt)?;
    let outline = agent_box(model.points, &scene.table)?;
    let up = scene.table.normal;
    let thickness = model
        .points
        .iter()
        .map(|p| scene.table.height(p))
        .fold(0.0, f64::max);
    let hidden = Hidden::new(model, &up);
    let view = scene.camera - outline.center;
    let about = |along: usize, sign: f64| {
        let across = 1 - along;
        let lifted = UnitVector3::new_unchecked(outline.axes[across].into_inner() * sign);
        let axis = UnitVector3::new_normalize(lifted.cross(&up));
        let [length, span] = [along, across].map(|k| 2.0 * outline.half_extents[k]);
        let pivot = scene
            .table
            .foot(&(outline.center - lifted.as_ref() * (0.5 * span)));
        let angle = hidden.angle(&axis, &view, thickness < STANDS * span);
        Turn {
            axis,
            lifted,
            up,
            pivot,
            span,
            length,
            thickness,
            angle,
            tilt: 0.0,
            gain: 0.0,
        }
    };
    let straight = [about(0, 1.0), about(0, -1.0), about(1, 1.0), about(1, -1.0)];
    let tilted = straight.map(|turn| Turn { tilt, ..turn });
    let tilted = tilted.iter().filter(|turn| hidden.wants_tilt(turn, &view));
    let longest = (2.0 * outline.half_extents.x).max(f64::MIN_POSITIVE);
    let gained = |turn: &Turn| Turn {
        gain: hidden.gain(turn, &view) * turn.length / longest,
        ..*turn
    };
    let mut all: Vec<Turn> = straight.iter().chain(tilted).map(gained).collect();
    all.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    Ok(all)
}

/// Rejects an invalid tilt.
pub(crate) fn check_tilt(tilt: f64) -> Result<(), Error> {
    within("tilt", tilt, 0.0, FRAC_PI_3, "between 0 and 60 degrees")
}

/// Orientations of hidden surface: vectors whose lengths are areas.
struct Hidden {
    /// Known area, m².
    known: f64,
    missing: Option<Vector3<f64>>,
    directions: Vec<Vector3<f64>>,
}

impl Hidden {
    fn new(model: &Model, up: &UnitVector3<f64>) -> Self {
        let known: f64 = model.areas.iter().sum();
        if !model.hidden.is_empty() {
            let sum: Vector3<f64> = model.hidden.iter().sum();
            let all: f64 = model.hidden.iter().map(Vector3::norm).sum();
            return Self {
                known,
                missing: Some(sum).filter(|m| m.norm() > ONE_WAY * all),
                directions: model.hidden.to_vec(),
            };
        }
        let boundary = (0..model.points.len()).filter(|&v| model.boundary[v]);
        let mut directions: Vec<_> = boundary
            .map(|v| model.normals[v].as_ref() * model.areas[v])
            .collect();
        let missing = Some(missing_vector_area(model)).filter(|m| m.norm() >= NOISE * known);
        directions.extend(missing);
        if directions.is_empty() {
            // The underside has not been seen.
            directions.push(-up.into_inner());
        }
        Self {
            known,
            missing,
            directions,
        }
    }

    /// The angle of the turn about `axis`; a flat body, or one without a direction, makes the whole half turn.
    fn angle(&self, axis: &UnitVector3<f64>, view: &Vector3<f64>, flat: bool) -> f64 {
        match &self.missing {
            Some(m) if !flat => toward(axis, m, view).clamp(FRAC_PI_2, PI),
            _ => PI,
        }
    }

    /// Mean over the vectors of the share that a turn shows.
    fn gain(&self, turn: &Turn, view: &Vector3<f64>) -> f64 {
        let (mut shown, mut all) = (0.0, 0.0);
        for d in &self.directions {
            let size = d.norm();
            let end = along(
                &(UnitQuaternion::from_axis_angle(&turn.axis, turn.angle) * d),
                view,
            );
            let mut best = best_of_turn(turn, d, view);
            if turn.tilt > 0.0 {
                best = best.max(best_of_tilt(turn, d, view));
            }
            let faces = |facing: f64| (facing - EDGE_ON * size).max(0.0) / (1.0 - EDGE_ON);
            shown += 0.5 * (faces(end) + faces(best));
            all += size;
        }
        if all > 0.0 { shown / all } else { 0.0 }
    }

    /// Whether so much would stay edge-on during the whole turn that a tilt is needed, and whether it helps.
    fn wants_tilt(&self, turn: &Turn, view: &Vector3<f64>) -> bool {
        let hidden: f64 = self.directions.iter().map(Vector3::norm).sum();
        let (mut without, mut with) = (0.0, 0.0);
        for d in &self.directions {
            let shown = EDGE_ON * d.norm();
            if best_of_turn(turn, d, view) < shown {
                without += d.norm();
                if best_of_tilt(turn, d, view) < shown {
                    with += d.norm();
                }
            }
        }
        turn.tilt > 0.0
            && turn.length >= turn.span
            && without > LEFT * (self.known + hidden)
            && with < 0.5 * without
    }
}

/// Length of a vector along the direction of `view`; 0 for a camera at the centre of the body.
fn along(d: &Vector3<f64>, view: &Vector3<f64>) -> f64 {
    d.dot(view) / view.norm().max(f64::MIN_POSITIVE)
}

/// The largest part of `d` that faces the camera at any moment of the turn.
fn best_of_turn(turn: &Turn, d: &Vector3<f64>, view: &Vector3<f64>) -> f64 {
    let wanted = toward(&turn.axis, d, view);
    let best = if wanted <= turn.angle {
        wanted
    } else if wanted - turn.angle < 2.0 * PI - wanted {
        turn.angle
    } else {
        0.0
    };
    along(
        &(UnitQuaternion::from_axis_angle(&turn.axis, best) * d),
        view,
    )
}

/// The largest part of `d` that faces the camera while the hanging body is tilted.
fn best_of_tilt(turn: &Turn, d: &Vector3<f64>, view: &Vector3<f64>) -> f64 {
    let hanging = UnitQuaternion::from_axis_angle(&turn.axis, FRAC_PI_2) * d;
    let wanted = toward(&turn.tilt_axis(), &hanging, view);
    let nearest = if wanted > PI {
        wanted - 2.0 * PI
    } else {
        wanted
    };
    let best = nearest.clamp(-turn.tilt, turn.tilt);
    along(
        &(UnitQuaternion::from_axis_angle(&turn.tilt_axis(), best) * hanging),
        view,
    )
}

/// Angle of the rotation about `axis` that takes `d` toward `view`, between 0 and a whole turn.
fn toward(axis: &UnitVector3<f64>, d: &Vector3<f64>, view: &Vector3<f64>) -> f64 {
    let across = |v: &Vector3<f64>| v - axis.as_ref() * axis.dot(v);
    let (d, view) = (across(d), across(view));
    axis.dot(&d.cross(&view))
        .atan2(d.dot(&view))
        .rem_euclid(2.0 * PI)
}
