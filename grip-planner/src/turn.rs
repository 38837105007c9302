//! Turns: about which side of its box the body can be turned, and how well two grips could do it.
//!
//! In the plane across a horizontal axis `a` of the agent box let `l` be the direction from the foot to the side
//! that is lifted and `n` the table normal, so that `a = l × n` and a turn by +θ takes `l` up:
//!
//! ```text
//!            n                      m⊥ = m without its part along a
//!      ______|______ _              α = angle from m⊥ to the camera, in the sense of the lift
//!     |             | t             turned by θ = clamp(α, ¼, ½ turn); a body flatter than 0.7 lies on
//!  ___P_____________|___ l          its side on neither edge, so it goes the whole half turn
//!         span
//! ```
//!
//! The **gain** says how much of what is missing comes to face the camera: for a direction `d` in which hidden surface faces, `|d|` times the mean of
//! `max(0, cos(d, camera) − e)/(1 − e)` at the end and at the best moment on the way (so the side toward which it leans is the one that is lifted); what
//! stays nearly edge-on, `e = cos 80°`, is not shown. The directions are `m`, with its length as weight, and the normals at the boundary of the explored part, each with the area of its vertex: what is hidden
//! next to a boundary faces about the same way. While the underside is missing `m` decides; what is left at last, a
//! band round the body whose vector area is nearly zero, is found by its boundary. Where the caller has drawn a whole surface, the pieces of it
//! that were never seen take the place of both ([`Model::hidden`]): the boundary of a small hole faces all ways but that of the hole. The gain is multiplied by `length/longest side`: when `m` points straight down
//! all four turns show it equally well and the one about the longer side, which lifts least, is meant to win.
//!
//! The ends of the body, which face along the axis, stay edge-on however far it is turned. A turn that would leave more than [`LEFT`] of the surface
//! unseen for that reason is also offered with a **tilt**: while the body hangs, its axis is tilted by `τ` to one side and then to the
//! other; the best moment may then be one of those.
//!
//! The **suitability** of two lifting grips is a product of factors between 0 and 1: both on the lifted side (a long lever),
//! 40 to 80 % of the length apart, level with the axis, and balanced about the middle. Grips that are close together let a soft body hang like
//! a handkerchief; it then comes down on any side.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_3, PI};

use nalgebra::{Point3, UnitQuaternion, UnitVector3, Vector3};

use crate::scene::within;
use crate::{Error, Model, Scene, agent_box, missing_vector_area};

/// Missing vector area below this share of the known area is sampling noise and has no direction.
const NOISE: f64 = 0.01;
/// Hidden pieces whose vector areas cancel to less than this share do not face one way.
const ONE_WAY: f64 = 0.5;
/// A body lower than this share of its span does not stand on its side.
const STANDS: f64 = 0.7;
/// Cosine to the direction of the camera under which surface is seen too nearly edge-on.
const EDGE_ON: f64 = 0.17;
/// Share of the surface that may be left unseen by a turn before a tilt is worth its time.
const LEFT: f64 = 0.001;

/// A turn about one side of the agent box.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Turn {
    /// Rotating about it by a positive angle lifts.
    pub axis: UnitVector3<f64>,
    /// Horizontal, from the pivot to the side that is lifted.
    pub lifted: UnitVector3<f64>,
    /// Table normal.
    pub up: UnitVector3<f64>,
    /// Middle of the pivot line, on the table at the foot of the box.
    pub pivot: Point3<f64>,
    /// Width of the box from the pivot to the lifted side.
    pub span: f64,
    /// Length of the box along the axis.
    pub length: f64,
    /// Height of the body above the table.
    pub thickness: f64,
    /// How far to turn, radians.
    pub angle: f64,
    /// How far the axis is tilted to either side while the body hangs, radians; 0 where it is not.
    pub tilt: f64,
    /// How much of the missing area faces the camera after it, 0 to 1.
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

    /// Rotating about it by a positive angle raises what lies farther along [`Self::axis`].
    pub(crate) fn tilt_axis(&self) -> UnitVector3<f64> {
        -self.lifted
    }

    /// The point reflected to the other side of the box: about where a grip ends when the body is turned on the spot.
    pub(crate) fn mirrored(&self, point: &Point3<f64>) -> Point3<f64> {
        point + self.lifted.as_ref() * (self.span - 2.0 * self.local(point).y)
    }

    /// How well two grips would lift, 0 to 1; `spread` is the wanted distance as a share of the length.
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

    /// 0 at the middle of the body, 1 from nine tenths of the way to the lifted side.
    fn lever(&self, along: f64) -> f64 {
        if self.span <= 0.0 {
            return 0.0;
        }
        ((along / self.span - 0.5) / 0.4).clamp(0.0, 1.0)
    }

    /// A trapezoid: 0 at half the lower bound, 1 between the bounds, a half where the box is left behind.
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

    /// 1 when the middle between the grips is the middle of the box, 0 when it is at its end.
    fn balance(&self, sum: f64) -> f64 {
        (1.0 - (sum / self.length).powi(2)).clamp(0.0, 1.0)
    }
}

/// The four turns about the sides of the agent box, and those that leave less unseen when the body is tilted by `tilt` (radians) to either
/// side while it hangs; best gain first.
///
/// # Errors
/// A model or scene that is not usable; a tilt outside 0 to 60°.
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

/// Refuses what is no tilt of a hanging body.
pub(crate) fn check_tilt(tilt: f64) -> Result<(), Error> {
    within("tilt", tilt, 0.0, FRAC_PI_3, "between 0 and 60 degrees")
}

/// Where hidden surface faces: vectors whose lengths are areas.
struct Hidden {
    /// Area that is known, m².
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
        let rim = (0..model.points.len()).filter(|&v| model.boundary[v]);
        let mut directions: Vec<_> = rim
            .map(|v| model.normals[v].as_ref() * model.areas[v])
            .collect();
        let missing = Some(missing_vector_area(model)).filter(|m| m.norm() >= NOISE * known);
        directions.extend(missing);
        if directions.is_empty() {
            // Underneath is where nobody has looked.
            directions.push(-up.into_inner());
        }
        Self {
            known,
            missing,
            directions,
        }
    }

    /// How far to turn about `axis`; a flat body, or one without a direction, goes the whole half turn.
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

    /// Whether so much would stay edge-on all the way that the body has to be tilted, and whether that helps.
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

/// Length of a vector along the direction of `view`; 0 for a camera in the middle of the body.
fn along(d: &Vector3<f64>, view: &Vector3<f64>) -> f64 {
    d.dot(view) / view.norm().max(f64::MIN_POSITIVE)
}

/// The most of `d` that faces the camera at any moment of the turn.
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

/// The most of `d` that faces the camera while the hanging body is tilted to either side.
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

/// Angle of the turn about `axis` that takes `d` toward `view`, between 0 and a whole turn.
fn toward(axis: &UnitVector3<f64>, d: &Vector3<f64>, view: &Vector3<f64>) -> f64 {
    let across = |v: &Vector3<f64>| v - axis.as_ref() * axis.dot(v);
    let (d, view) = (across(d), across(view));
    axis.dot(&d.cross(&view))
        .atan2(d.dot(&view))
        .rem_euclid(2.0 * PI)
}
