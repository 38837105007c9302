//! Turning over: lift, then retract and lower.
//!
//! In the plane across the axis, `s` from the pivot toward the lifted side and `h` above the table, a grip that
//! starts at `(s₀, h₀)` on a body of thickness `t` goes, with `R` the rotation that lifts,
//!
//! ```text
//! lift            θ = 0 … ¼ turn:    (s, h) = R(θ)(s₀, h₀)                    about the foot (0, 0)
//! retract, lower  θ = ¼ … ½ turn:    (s, h) = R(θ)(s₀, h₀ − t) − (t, 0)      about the next edge (−t, 0)
//! ```
//!
//! which is how a block tumbles over two of its edges. A soft body adds to it:
//! - it sags, so the tips rise by `slack` of the lever more until it hangs, and give it back while it is laid down;
//! - it would end `span + t` away from where it began. [`Recentre::Stay`] moves the whole arc the other way by `D(1 − cos θ)` during
//!   the lift: the tips then rise nearly straight up, pull the body under them, where it hangs, and lay it
//!   down over the place it came from. The way back is taken while the tension of the lift pulls the lower edge along, never while
//!   it has to be pushed;
//! - the tips turn with it until their tools would lean too near the table.
//!
//! The tips end a little above the table, let go, and back off along their tools.

use std::f64::consts::{FRAC_PI_2, PI};

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use crate::check::check;
use crate::grips::retreat;
use crate::motion::{Pace, between, times};
use crate::scene::{not_negative, positive, within};
use crate::turn::Turn;
use crate::{ArmPath, Error, Grip, GripSet, Keyframe, Model, Motion, Refusal, Role, Scene};

/// Where the body is to lie after a turn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Recentre {
    /// Wherever it tumbles to: about its width and its thickness away.
    Tumble,
    /// Where it lay.
    Stay,
    /// With its middle at this point, as far as a shift across the axis can do it.
    At(nalgebra::Point3<f64>),
}

/// Settings of [`turn_over`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TurnOptions {
    /// How far to turn, radians, between a quarter and half a turn. Default: what [`Turn::angle`] says.
    pub angle: Option<f64>,
    /// Extra lift for the sag, as a share of the lever. Default 0.12: a body of 10 kPa stretches by about 7 % under
    /// its own weight at 0.15 m, and has to come clear of the table.
    pub slack: f64,
    /// Shortening of the lever while the body is laid down, so that it is not dragged on. Default 0.08.
    pub retract: f64,
    /// The tips are this high above the table at the end, metres, or higher. Default 0.012.
    pub release_height: f64,
    /// Where the body is to lie. Default: where it lay.
    pub recentre: Recentre,
    /// Pulls the lifting grips apart by this much along the axis during the lift, metres: a stretch added to the turn. Default 0.
    pub stretch: f64,
    /// Largest speed of a tip, m/s; an arm's own limit counts too. Default 0.05.
    pub speed: f64,
    /// How fast that speed is reached and left, m/s². Default 0.05.
    pub acceleration: f64,
    /// Largest rotation rate of a tip, rad/s. Default 1.
    pub turn_rate: f64,
    /// Least angle between a tool and the table at any time, radians. Default 30°.
    pub min_elevation: f64,
    /// A supporting arm lets go at this angle, radians. Default 60°.
    pub support_until: f64,
    /// How far the tips back off after the release, metres. Default 0.05.
    pub retreat_distance: f64,
    /// Length of the straight part of a tool behind its tip, metres. Default 0.05.
    pub shaft_length: f64,
    /// Way points are at most this far apart in angle, radians. Default 3°.
    pub step: f64,
}

impl Default for TurnOptions {
    fn default() -> Self {
        Self {
            angle: None,
            slack: 0.12,
            retract: 0.08,
            release_height: 0.012,
            recentre: Recentre::Stay,
            stretch: 0.0,
            speed: 0.05,
            acceleration: 0.05,
            turn_rate: 1.0,
            min_elevation: 30f64.to_radians(),
            support_until: 60f64.to_radians(),
            retreat_distance: 0.05,
            shaft_length: 0.05,
            step: 3f64.to_radians(),
        }
    }
}

impl TurnOptions {
    fn check(&self) -> Result<(), Error> {
        if let Some(angle) = self.angle {
            within(
                "angle",
                angle,
                FRAC_PI_2,
                PI,
                "between a quarter and half a turn",
            )?;
        }
        within("slack", self.slack, 0.0, 1.0, "between 0 and 1")?;
        within("retract", self.retract, 0.0, 0.9, "between 0 and 0.9")?;
        not_negative("release_height", self.release_height)?;
        not_negative("stretch", self.stretch)?;
        positive("speed", self.speed)?;
        positive("acceleration", self.acceleration)?;
        positive("turn_rate", self.turn_rate)?;
        within(
            "min_elevation",
            self.min_elevation,
            0.0,
            FRAC_PI_2,
            "between 0 and a right angle",
        )?;
        within(
            "support_until",
            self.support_until,
            0.0,
            FRAC_PI_2,
            "between 0 and a right angle",
        )?;
        positive("retreat_distance", self.retreat_distance)?;
        positive("shaft_length", self.shaft_length)?;
        within(
            "step",
            self.step,
            1e-3,
            FRAC_PI_2,
            "between 0.001 and a right angle",
        )
    }
}

/// The motion that turns the body with the grips of `set`.
///
/// # Errors
/// Why it cannot be done: what leaves its workspace, meets the table or another tool, and when.
///
/// # Complexity
/// Linear in the number of way points, about 60.
pub fn turn_over(
    model: &Model,
    scene: &Scene,
    set: &GripSet,
    options: &TurnOptions,
) -> Result<Motion, Refusal> {
    model.check()?;
    scene.check()?;
    options.check()?;
    check_grips(scene, set)?;
    let arc = Arc::new(scene, set, options);
    let angles = arc.angles();
    let paths: Vec<_> = set.grips.iter().map(|g| arc.path(g, &angles)).collect();
    let limit = set
        .grips
        .iter()
        .map(|g| scene.arms[g.arm].max_speed)
        .fold(options.speed, f64::min);
    let times = times(
        &paths,
        &Pace {
            speed: limit,
            acceleration: options.acceleration,
            turn_rate: options.turn_rate,
        },
    );
    let motion = arc.motion(&paths, &times, &angles, &set.grips);
    check(&motion, scene, options.shaft_length)?;
    Ok(motion)
}

fn check_grips(scene: &Scene, set: &GripSet) -> Result<(), Refusal> {
    if let Some(g) = set.grips.iter().find(|g| g.arm >= scene.arms.len()) {
        return Err(Error::BadArm {
            arm: g.arm,
            what: "its number: there is no such arm",
        }
        .into());
    }
    let on_side = |g: &&Grip| g.role == Role::Lift && set.turn.local(&g.tip()).y > 0.0;
    match set.grips.iter().filter(on_side).count() {
        2 => Ok(()),
        lifting => Err(Refusal::CannotLift { lifting }),
    }
}

struct Arc<'a> {
    scene: &'a Scene<'a>,
    turn: Turn,
    options: &'a TurnOptions,
    end: f64,
    /// How far the arc moves toward the lifted side.
    shift: f64,
    /// Middle of the lifting grips along the axis.
    middle: f64,
    /// Tips never go lower.
    floor: f64,
}

impl<'a> Arc<'a> {
    fn new(scene: &'a Scene<'a>, set: &GripSet, options: &'a TurnOptions) -> Self {
        let turn = set.turn;
        let end = options.angle.unwrap_or(turn.angle).clamp(FRAC_PI_2, PI);
        let lifting: Vec<f64> = set
            .grips
            .iter()
            .filter(|g| g.role == Role::Lift)
            .map(|g| turn.local(&g.tip()).x)
            .collect();
        let middle = lifting.iter().sum::<f64>() / lifting.len() as f64;
        let mut arc = Self {
            scene,
            turn,
            options,
            end,
            shift: 0.0,
            middle,
            floor: scene.clearance,
        };
        arc.shift = arc.wanted_shift();
        arc
    }

    /// What brings the middle of the body back to where it is wanted.
    fn wanted_shift(&self) -> f64 {
        let center = 0.5 * self.turn.span;
        let tumbled = self.tumbled(center, 0.5 * self.turn.thickness, self.end, 0.0)[0];
        match &self.options.recentre {
            Recentre::Tumble => 0.0,
            Recentre::Stay => center - tumbled,
            Recentre::At(point) => self.turn.local(point).y - tumbled,
        }
    }

    #[allow(clippy::cast_sign_loss, reason = "at least 2")]
    fn angles(&self) -> Vec<f64> {
        let count = (self.end / self.options.step).ceil().max(2.0) as usize;
        (0..=count)
            .map(|k| self.end * k as f64 / count as f64)
            .collect()
    }

    /// `(s, h)` of a point of the tumbling block after `angle`, its lever shortened by `retract` once it is laid down.
    fn tumbled(&self, s: f64, h: f64, angle: f64, retract: f64) -> [f64; 2] {
        let (sin, cos) = angle.sin_cos();
        if angle <= FRAC_PI_2 {
            return [s * cos - h * sin, s * sin + h * cos];
        }
        let t = self.turn.thickness;
        let s = s * (1.0 - retract * ramp((angle - FRAC_PI_2) / FRAC_PI_2));
        [s * cos - (h - t) * sin - t, s * sin + (h - t) * cos]
    }

    /// Where a tip that starts at `local` is after `angle`.
    fn position(&self, role: Role, local: &Vector3<f64>, angle: f64) -> Vector3<f64> {
        let [mut s, mut h] = self.tumbled(local.y, local.z, angle, self.options.retract);
        s += self.shift * (1.0 - angle.min(FRAC_PI_2).cos());
        let mut x = local.x;
        if role == Role::Lift {
            // Up to the full slack when the body hangs; given back by the time it lies.
            let taken =
                ramp(angle / FRAC_PI_2) * (1.0 - ramp((angle - FRAC_PI_2) / (0.8 * FRAC_PI_2)));
            h += self.options.slack * local.y.hypot(local.z) * taken;
            let apart = (local.x - self.middle).signum();
            x += 0.5 * self.options.stretch * apart * ramp(angle / FRAC_PI_2);
        }
        // The release height is approached in the second quarter, so that the way down is smooth.
        let release = self.options.release_height * ramp((angle - FRAC_PI_2) / FRAC_PI_2);
        let floor = self
            .floor
            .min(local.z)
            .max(self.floor * ramp(angle / FRAC_PI_2))
            .max(release);
        Vector3::new(x, s, h.max(floor))
    }

    /// How far a tip turns with the body: until its tool leans over to the far side as much as it may.
    fn largest_turn(&self, grasp: &Isometry3<f64>) -> f64 {
        let back = grasp.rotation * -Vector3::z();
        let lean = self.turn.up.dot(&back).atan2(self.turn.lifted.dot(&back));
        let along = self.turn.axis.dot(&back);
        // A tool that also leans along the axis is lower than its angle in the plane says.
        let across = (1.0 - along * along).max(0.0).sqrt();
        let least = if across > 0.0 {
            (self.options.min_elevation.sin() / across).min(1.0).asin()
        } else {
            FRAC_PI_2
        };
        (PI - least - lean).clamp(0.0, self.end)
    }

    fn pose(&self, grip: &Grip, local: &Vector3<f64>, angle: f64, turned: f64) -> Isometry3<f64> {
        let turn = UnitQuaternion::from_axis_angle(&self.turn.axis, turned);
        let tip = self.turn.point(&self.position(grip.role, local, angle));
        Isometry3::from_parts(
            Translation3::from(tip.coords),
            turn * grip.camera_from_tip.rotation,
        )
    }

    fn path(&self, grip: &Grip, angles: &[f64]) -> Vec<Isometry3<f64>> {
        let local = self.turn.local(&grip.tip());
        let most = self.largest_turn(&grip.camera_from_tip);
        let held = |angle: f64| self.pose(grip, &local, angle, angle.min(most));
        match grip.role {
            Role::Lift => angles.iter().map(|&a| held(a)).collect(),
            Role::Support => self.support_path(grip, angles, held),
        }
    }

    /// Holds until the release, backs off over the next fifth of what is left, and is home at the end.
    fn support_path(
        &self,
        grip: &Grip,
        angles: &[f64],
        held: impl Fn(f64) -> Isometry3<f64>,
    ) -> Vec<Isometry3<f64>> {
        let last = self.support_ends(angles);
        let released = held(angles[last]);
        let away = retreat(&released, self.scene, self.options.retreat_distance);
        let home = self.scene.arms[grip.arm].home;
        let rest = (angles.len() - 1 - last).max(1) as f64;
        let pose = |(k, &angle): (usize, &f64)| {
            if k <= last {
                return held(angle);
            }
            let share = (k - last) as f64 / rest;
            if share < 0.2 {
                between(&released, &away, share / 0.2)
            } else {
                between(&away, &home, (share - 0.2) / 0.8)
            }
        };
        angles.iter().enumerate().map(pose).collect()
    }

    fn support_ends(&self, angles: &[f64]) -> usize {
        angles
            .partition_point(|&a| a <= self.options.support_until)
            .saturating_sub(1)
    }

    fn motion(
        &self,
        paths: &[Vec<Isometry3<f64>>],
        times: &[f64],
        angles: &[f64],
        grips: &[Grip],
    ) -> Motion {
        let duration = times.last().copied().unwrap_or(0.0);
        let arm = |(grip, path): (&Grip, &Vec<Isometry3<f64>>)| {
            let keyframes: Vec<_> = times
                .iter()
                .zip(path)
                .map(|(&time, &camera_from_tip)| Keyframe {
                    time,
                    camera_from_tip,
                })
                .collect();
            let end = path.last().copied().unwrap_or(grip.camera_from_tip);
            let (release, camera_from_retreat) = match grip.role {
                Role::Lift => (
                    duration,
                    retreat(&end, self.scene, self.options.retreat_distance),
                ),
                Role::Support => (times[self.support_ends(angles)], end),
            };
            ArmPath {
                arm: grip.arm,
                role: grip.role,
                keyframes,
                release,
                camera_from_retreat,
            }
        };
        Motion {
            arms: grips.iter().zip(paths).map(arm).collect(),
            duration,
        }
    }
}

/// Smooth from 0 at 0 to 1 at 1, constant outside.
fn ramp(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}
