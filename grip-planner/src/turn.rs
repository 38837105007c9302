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
//! The **gain** says how much of the missing area comes to face the camera: `|m⊥|/|m|` times the mean of `(1 + cos(α − θ))/2`
//! at the end and at the best moment on the way (so the side toward which `m` leans is the one that is lifted), times
//! `(length/longest side)²`: when `m` points straight down all four turns show it equally well and the one about the longer side, which
//! lifts least, is meant to win.
//!
//! The **suitability** of two lifting grips is a product of factors between 0 and 1: both on the lifted side (a long lever),
//! 40 to 80 % of the length apart, level with the axis, and balanced about the middle. Grips that are close together let a soft body hang like
//! a handkerchief; it then comes down on any side.

use std::f64::consts::{FRAC_PI_2, PI};

use nalgebra::{Point3, UnitVector3, Vector3};

use crate::{Error, Model, Scene, agent_box, missing_vector_area};

/// Missing area below this share of the known area is sampling noise: then it is taken to lie underneath.
const NOISE: f64 = 0.01;
/// A body lower than this share of its span does not stand on its side.
const STANDS: f64 = 0.7;

/// A turn about one side of the agent box.
#[derive(Debug, Clone, Copy, PartialEq)]
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

/// The four turns about the sides of the agent box, best gain first.
///
/// # Errors
/// A model or scene that is not usable.
pub fn turns(model: &Model, scene: &Scene) -> Result<[Turn; 4], Error> {
    model.check()?;
    scene.check()?;
    let outline = agent_box(model.points, &scene.table)?;
    let up = scene.table.normal;
    let thickness = model
        .points
        .iter()
        .map(|p| scene.table.height(p))
        .fold(0.0, f64::max);
    let known: f64 = model.areas.iter().sum();
    let mut missing = missing_vector_area(model);
    if missing.norm() < NOISE * known {
        missing = -up.into_inner();
    }
    let view = scene.camera - outline.center;
    let about = |along: usize, sign: f64| {
        let across = 1 - along;
        let lifted = UnitVector3::new_unchecked(outline.axes[across].into_inner() * sign);
        let axis = UnitVector3::new_normalize(lifted.cross(&up));
        let [length, span] = [along, across].map(|k| 2.0 * outline.half_extents[k]);
        let pivot = scene
            .table
            .foot(&(outline.center - lifted.as_ref() * (0.5 * span)));
        let aim = aim(&axis, &missing, &view, thickness < STANDS * span);
        let long = length / (2.0 * outline.half_extents.x).max(f64::MIN_POSITIVE);
        Turn {
            axis,
            lifted,
            up,
            pivot,
            span,
            length,
            thickness,
            angle: aim.angle,
            gain: aim.gain * long * long,
        }
    };
    let mut all = [about(0, 1.0), about(0, -1.0), about(1, 1.0), about(1, -1.0)];
    all.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    Ok(all)
}

struct Aim {
    angle: f64,
    gain: f64,
}

/// How far to turn about `axis` to bring `missing` toward `view`, and how much of it gets there.
fn aim(axis: &UnitVector3<f64>, missing: &Vector3<f64>, view: &Vector3<f64>, flat: bool) -> Aim {
    let across = |v: &Vector3<f64>| v - axis.as_ref() * axis.dot(v);
    let (m, c) = (across(missing), across(view));
    let wanted = axis.dot(&m.cross(&c)).atan2(m.dot(&c)).rem_euclid(2.0 * PI);
    let angle = if flat {
        PI
    } else {
        wanted.clamp(FRAC_PI_2, PI)
    };
    let share = if missing.norm() > 0.0 {
        m.norm() / missing.norm()
    } else {
        0.0
    };
    let faces = |turned: f64| 0.5 * (1.0 + (wanted - turned).cos());
    Aim {
        angle,
        gain: share * 0.5 * (faces(angle) + faces(wanted.min(PI))),
    }
}
