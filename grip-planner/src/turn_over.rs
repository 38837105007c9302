//! Turning over: lift, then retract and lower.
//!
//! In the plane perpendicular to the axis, `s` from the pivot toward the lifted side and `h` above the table, a grip that
//! starts at `(s₀, h₀)` on a body of thickness `t` moves, with `R` the rotation that lifts,
//!
//! ```text
//! lift            θ = 0 … ¼ turn:    (s, h) = R(θ)(s₀, h₀)                    about the foot (0, 0)
//! retract, lower  θ = ¼ … ½ turn:    (s, h) = R(θ)(s₀, h₀ − t) − (t, 0)      about the next edge (−t, 0)
//! ```
//! like a block that tumbles over two of its edges. With [`Turn::tilt`] the body is tilted in between, while it hangs at a quarter
//! turn about the centre `(x₀, h₀)` of the lifting grips: with `φ = 0 … τ … −τ … 0`, a grip at `(x, h)` moves to
//!
//! ```text
//! tilt            (x₀, h₀ + ρ) + R(φ)(x − x₀, h − h₀)
//! ```
//!
//! and rotates with the body; the rise `ρ`, up to `sin τ` times the farther end of the box, keeps the lower end off the table.
//!
//! For a soft body this is modified:
//! - it sags, so the tips rise by an additional `slack` of the lever until it hangs, and lower it again while the body is laid down;
//! - it would end `span + t` away from where it began. [`Recentre::Stay`] moves the whole arc the other way by `D(1 − cos θ)` during
//!   the lift: the tips then rise nearly straight up, pull the body under them, where it hangs, and lay it
//!   down where it came from. The shift back is made while the tension of the lift pulls the lower edge along, never while
//!   it would have to be pushed;
//! - the tips rotate with it until their tools would come too near the table, or as far as the joints of their arms allow.
//!
//! The tips end slightly above the table, release, and retreat along their tools.

use std::f64::consts::{FRAC_PI_2, PI};

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use crate::body::Body;
use crate::check::{Carried, Surroundings};
use crate::motion::{Pace, assemble, between, times};
use crate::orientation::retreat;
use crate::turn::{Turn, check_tilt};
use crate::{
    Error, Grip, GripSet, Leg, Model, Motion, Recentre, Refusal, Role, Scene, Stage, TurnOptions,
};

/// The motion that turns the body with the grips of `set`.
///
/// # Errors
/// Why it is not feasible: which arm leaves its workspace, or collides with the table or another tool, and when.
///
/// # Complexity
/// Linear in the number of way points, about 60.
///
/// With the cushion and the two arms of the [crate's example](crate):
///
/// ```
/// use grip_planner::{Options, TurnOptions, plan_grips, turn_over};
/// # use grip_planner::nalgebra::{Isometry3, Point3, UnitVector3, Vector3};
/// # use grip_planner::{Arm, Model, Plane, Scene, Workspace};
/// # let up = -Vector3::z_axis();
/// # let (mut points, mut normals, mut boundary) = (vec![], vec![], vec![]);
/// # for (i, j) in (0..21).flat_map(|i| (0..13).map(move |j| (i, j))) {
/// #     let (x, y) = (0.01 * f64::from(i - 10), 0.01 * f64::from(j - 6));
/// #     let on_boundary = i == 0 || i == 20 || j == 0 || j == 12;
/// #     points.push(Point3::new(x, y, if on_boundary { 0.485 } else { 0.47 }));
/// #     let out = UnitVector3::new_normalize(Vector3::new(x / 0.1, y / 0.06, -0.3));
/// #     normals.push(if on_boundary { out } else { up });
/// #     boundary.push(on_boundary);
/// # }
/// # let near = |a: &Point3<f64>, b: &Point3<f64>| (a.xy() - b.xy()).norm() < 0.015;
/// # let edges: Vec<[u32; 2]> = (0..points.len())
/// #     .flat_map(|a| (0..a).map(move |b| [b, a]))
/// #     .filter(|&[a, b]| near(&points[a], &points[b]))
/// #     .map(|e| e.map(|v| v as u32))
/// #     .collect();
/// # let model = Model {
/// #     points: &points,
/// #     normals: &normals,
/// #     areas: &vec![1e-4; points.len()],
/// #     edges: &edges,
/// #     boundary: &boundary,
/// #     visible: &vec![true; points.len()],
/// #     hidden: &[],
/// # };
/// # let arms = [-0.3, 0.3].map(|x| {
/// #     let base = Point3::new(x, 0.0, 0.25);
/// #     Arm {
/// #         base,
/// #         workspace: Workspace::Ball { center: base, radius: 0.6 },
/// #         home: Isometry3::translation(x, 0.0, 0.3),
/// #         max_speed: 0.1,
/// #     }
/// # });
/// # let scene = Scene {
/// #     table: Plane { normal: up, offset: 0.5 },
/// #     arms: &arms,
/// #     camera: Point3::origin(),
/// #     jaw_radius: 0.005,
/// #     shaft_length: 0.05,
/// #     jaw_separation: 0.02,
/// #     clearance: 0.003,
/// # };
/// let ranked = plan_grips(&model, &scene, &Options::default())?;
/// // The best set with a feasible motion.
/// let options = TurnOptions::default();
/// let best = ranked.sets.iter().find_map(|set| {
///     let motion = turn_over(&model, &scene, set, &options).ok()?;
///     Some((set, motion))
/// });
/// let (set, motion) = best.unwrap();
/// for path in &motion.arms {
///     let tip = |time: f64| Point3::from(path.at(time).unwrap().translation.vector);
///     let at = |time: f64| set.turn.local(&tip(time));
///     let [start, top, end] = [0.0, motion.legs[0].until, motion.duration].map(at);
///     // The lifted side is raised by more than half the width, and ends on the other side of where it was.
///     assert!(top.z - start.z > 0.5 * set.turn.span);
///     assert!(start.y > 0.5 * set.turn.span && end.y < 0.5 * set.turn.span);
/// }
/// # Ok::<(), grip_planner::Refusal>(())
/// ```
pub fn turn_over(
    model: &Model,
    scene: &Scene,
    set: &GripSet,
    options: &TurnOptions,
) -> Result<Motion, Refusal> {
    model.check()?;
    scene.check()?;
    options.check()?;
    let body = Body::new(model.points, scene.tool_radius());
    turn_in(&Surroundings::new(scene, &body), set, options)
}

/// The same with an existing obstacle.
pub(crate) fn turn_in(
    around: &Surroundings,
    set: &GripSet,
    options: &TurnOptions,
) -> Result<Motion, Refusal> {
    let scene = around.scene;
    check_grips(scene, set)?;
    let arc = Arc::new(scene, set, options);
    let way = arc.way();
    let paths: Vec<_> = set.grips.iter().map(|g| arc.path(g, &way)).collect();
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
    let motion = arc.motion(&paths, &times, &way, &set.grips);
    let turned: Vec<_> = way.iter().map(|at| at.rotation(&set.turn)).collect();
    let carried = Carried::Turned {
        turned: &turned,
        leaving: 1.5 * options.retreat_distance,
    };
    around.check(&motion, &carried)?;
    Ok(motion)
}

fn check_grips(scene: &Scene, set: &GripSet) -> Result<(), Refusal> {
    check_tilt(set.turn.tilt)?;
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

/// Shares of the rotation of the body that a tool is tried with, where its joints do not let it rotate all the way.
const SMALLER: [f64; 6] = [1.0, 0.85, 0.7, 0.55, 0.4, 0.25];

/// Rotation and tilt of the body at a way point.
#[derive(Debug, Clone, Copy)]
struct Way {
    /// About the axis, radians.
    angle: f64,
    /// Of the axis, radians, positive if its end is raised.
    tilt: f64,
    /// Additional height for the tilt, as a share of the required one.
    raised: f64,
}

impl Way {
    fn rotation(&self, turn: &Turn) -> UnitQuaternion<f64> {
        tilted(turn, self.tilt) * UnitQuaternion::from_axis_angle(&turn.axis, self.angle)
    }
}

fn tilted(turn: &Turn, tilt: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&turn.tilt_axis(), tilt)
}

struct Arc<'a> {
    scene: &'a Scene<'a>,
    turn: Turn,
    options: &'a TurnOptions,
    end: f64,
    /// Displacement of the arc toward the lifted side.
    shift: f64,
    /// The lifting tips before the turn.
    lifting: Vec<Vector3<f64>>,
    /// Their centre along the axis.
    middle: f64,
    /// Least height of the tips.
    floor: f64,
}

impl<'a> Arc<'a> {
    fn new(scene: &'a Scene<'a>, set: &GripSet, options: &'a TurnOptions) -> Self {
        let turn = set.turn;
        let end = options.end(&turn);
        let lifting = set.grips.iter().filter(|g| g.role == Role::Lift);
        let lifting: Vec<_> = lifting.map(|g| turn.local(&g.tip())).collect();
        let middle = lifting.iter().map(|tip| tip.x).sum::<f64>() / lifting.len() as f64;
        let mut arc = Self {
            scene,
            turn,
            options,
            end,
            shift: 0.0,
            lifting,
            middle,
            floor: scene.clearance,
        };
        arc.shift = arc.wanted_shift();
        arc
    }

    /// The displacement that brings the centre of the body to the wanted position.
    fn wanted_shift(&self) -> f64 {
        let center = 0.5 * self.turn.span;
        let tumbled = self.tumbled(center, 0.5 * self.turn.thickness, self.end, 0.0)[0];
        match &self.options.recentre {
            Recentre::Tumble => 0.0,
            Recentre::Stay => center - tumbled,
            Recentre::At(point) => self.turn.local(point).y - tumbled,
        }
    }

    /// Up until the body hangs, tilted to both sides, and down.
    fn way(&self) -> Vec<Way> {
        let straight = |k: usize, count: usize| Way {
            angle: self.end * k as f64 / count as f64,
            tilt: 0.0,
            raised: 0.0,
        };
        let count = steps(self.end, self.options.step);
        let mut way: Vec<Way> = (0..=count).map(|k| straight(k, count)).collect();
        let hangs = standing(&way);
        let lowered = way.split_off(hangs + 1);
        way.extend(self.tilts(way[hangs].angle));
        way.extend(lowered);
        way
    }

    /// Tilts to one side, to the other and back, at `angle`; empty if the turn has no tilt.
    fn tilts(&self, angle: f64) -> Vec<Way> {
        let most = self.turn.tilt;
        if most <= 0.0 {
            return Vec::new();
        }
        let count = steps(4.0 * most, self.options.step);
        let at = |k: usize| {
            let share = k as f64 / count as f64;
            let [begun, left] = [share, 1.0 - share].map(|share| ramp(4.0 * share));
            let swing = (PI * (2.0 * share - 0.5).clamp(0.0, 1.0)).cos();
            Way {
                angle,
                tilt: most * swing * begun * left,
                raised: begun * left,
            }
        };
        (1..=count).map(at).collect()
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

    /// Position at a way point of a tip that starts at `local`.
    fn position(&self, role: Role, local: &Vector3<f64>, at: &Way) -> Vector3<f64> {
        let angle = at.angle;
        let [mut s, mut h] = self.tumbled(local.y, local.z, angle, self.options.retract);
        s += self.shift * (1.0 - angle.min(FRAC_PI_2).cos());
        let mut x = local.x;
        if role == Role::Lift {
            h = self.lifted(local, angle);
            let apart = (local.x - self.middle).signum();
            x += 0.5 * self.options.stretch * apart * ramp(angle / FRAC_PI_2);
            [x, h] = self.tilt([x, h], at);
        }
        // The release height is approached in the second quarter, so that the motion down is smooth.
        let release = self.options.release_height * ramp((angle - FRAC_PI_2) / FRAC_PI_2);
        let floor = self
            .floor
            .min(local.z)
            .max(self.floor * ramp(angle / FRAC_PI_2))
            .max(release);
        Vector3::new(x, s, h.max(floor))
    }

    /// Height of a lifting tip after `angle`, without a tilt.
    fn lifted(&self, local: &Vector3<f64>, angle: f64) -> f64 {
        let [_, h] = self.tumbled(local.y, local.z, angle, self.options.retract);
        // Full slack when the body hangs; none when it is laid down.
        let taken = ramp(angle / FRAC_PI_2) * (1.0 - ramp((angle - FRAC_PI_2) / (0.8 * FRAC_PI_2)));
        h + self.options.slack * local.y.hypot(local.z) * taken
    }

    /// `(x, h)` of a tip of the hanging body after the tilt.
    fn tilt(&self, [x, h]: [f64; 2], at: &Way) -> [f64; 2] {
        let (sin, cos) = at.tilt.sin_cos();
        let heights = self.lifting.iter().map(|tip| self.lifted(tip, at.angle));
        let height = heights.sum::<f64>() / self.lifting.len() as f64;
        let (along, up) = (x - self.middle, h - height);
        let end = 0.5 * self.turn.length + self.middle.abs();
        let raised = at.raised * end * self.turn.tilt.sin();
        [
            self.middle + cos * along - sin * up,
            // Not `height + cos * up`: without a tilt it is exactly `h`.
            h + sin * along - (1.0 - cos) * up + raised,
        ]
    }

    /// How far a tip rotates with the body: until its tool has the least elevation on the far side.
    fn largest_turn(&self, grasp: &Isometry3<f64>) -> f64 {
        let back = grasp.rotation * -Vector3::z();
        let lean = self.turn.up.dot(&back).atan2(self.turn.lifted.dot(&back));
        let along = self.turn.axis.dot(&back);
        // A tool that also leans along the axis is lower than its angle in the plane suggests.
        let across = (1.0 - along * along).max(0.0).sqrt();
        let least = if across > 0.0 {
            (self.options.min_elevation.sin() / across).min(1.0).asin()
        } else {
            FRAC_PI_2
        };
        (PI - least - lean).clamp(0.0, self.end)
    }

    /// How far a tip that has rotated by `turned` is tilted with the body: until its tool has the least elevation.
    fn tilt_of_tool(&self, grasp: &Isometry3<f64>, turned: f64, tilt: f64) -> f64 {
        let turn = UnitQuaternion::from_axis_angle(&self.turn.axis, turned);
        let back = turn * (grasp.rotation * -Vector3::z());
        let (up, along) = (self.turn.up.dot(&back), self.turn.axis.dot(&back));
        let least = self.options.min_elevation.sin();
        // up·cos φ + along·sin φ ≥ least, and never more than without a tilt.
        let middle = along.atan2(up);
        let about = (least / up.hypot(along)).min(1.0).acos();
        tilt.clamp((middle - about).min(0.0), (middle + about).max(0.0))
    }

    /// The tip at a way point, rotated by at most `most` about the axis.
    fn pose(&self, grip: &Grip, local: &Vector3<f64>, at: &Way, most: f64) -> Isometry3<f64> {
        let turned = at.angle.min(most);
        let mut turn = UnitQuaternion::from_axis_angle(&self.turn.axis, turned);
        if at.tilt != 0.0 {
            let tilt = self.tilt_of_tool(&grip.camera_from_tip, turned, at.tilt);
            turn = tilted(&self.turn, tilt) * turn;
        }
        let tip = self.turn.point(&self.position(grip.role, local, at));
        Isometry3::from_parts(
            Translation3::from(tip.coords),
            turn * grip.camera_from_tip.rotation,
        )
    }

    fn path(&self, grip: &Grip, way: &[Way]) -> Vec<Isometry3<f64>> {
        let local = self.turn.local(&grip.tip());
        let most = self.reachable_turn(grip, &local, way);
        let held = |at: &Way| self.pose(grip, &local, at, most);
        match grip.role {
            Role::Lift => way.iter().map(held).collect(),
            Role::Support => self.support_path(grip, way, held),
        }
    }

    /// How far a tip rotates with the body: as far as its elevation allows, or, where joints do not allow that, the largest of some smaller angles
    /// with which all its poses are in the workspace. The tissue at the jaws takes up the rest. If there is none, the largest.
    fn reachable_turn(&self, grip: &Grip, local: &Vector3<f64>, way: &[Way]) -> f64 {
        let most = self.largest_turn(&grip.camera_from_tip);
        let workspace = &self.scene.arms[grip.arm].workspace;
        let held = match grip.role {
            Role::Lift => way,
            Role::Support => &way[..=self.support_ends(way)],
        };
        let within = |turn: &f64| {
            let mut poses = held.iter().map(|at| self.pose(grip, local, at, *turn));
            poses.all(|pose| workspace.contains(&pose))
        };
        SMALLER
            .iter()
            .map(|share| share * most)
            .find(within)
            .unwrap_or(most)
    }

    /// Holds until the release, retreats over the next fifth of the rest, and is home at the end.
    fn support_path(
        &self,
        grip: &Grip,
        way: &[Way],
        held: impl Fn(&Way) -> Isometry3<f64>,
    ) -> Vec<Isometry3<f64>> {
        let last = self.support_ends(way);
        let released = held(&way[last]);
        let away = retreat(&released, self.scene, self.options.retreat_distance);
        let home = self.scene.arms[grip.arm].home;
        let rest = (way.len() - 1 - last).max(1) as f64;
        let pose = |(k, at): (usize, &Way)| {
            if k <= last {
                return held(at);
            }
            let share = (k - last) as f64 / rest;
            if share < 0.2 {
                between(&released, &away, share / 0.2)
            } else {
                between(&away, &home, (share - 0.2) / 0.8)
            }
        };
        way.iter().enumerate().map(pose).collect()
    }

    fn support_ends(&self, way: &[Way]) -> usize {
        way.partition_point(|at| at.angle <= self.options.support_until)
            .saturating_sub(1)
    }

    fn motion(
        &self,
        paths: &[Vec<Isometry3<f64>>],
        times: &[f64],
        way: &[Way],
        grips: &[Grip],
    ) -> Motion {
        let hangs = standing(way);
        let lifted = way.iter().position(|at| at.raised > 0.0);
        let legs = [
            (Stage::Lift, times[lifted.map_or(hangs, |k| k - 1)]),
            (Stage::Tilt, times[hangs]),
            (Stage::Lower, times.last().copied().unwrap_or(0.0)),
        ];
        let wanted = |(stage, _): &(Stage, f64)| *stage != Stage::Tilt || self.turn.tilt > 0.0;
        let legs = legs.into_iter().filter(wanted);
        let legs = legs.map(|(stage, until)| Leg { stage, until }).collect();
        let mut motion = assemble(grips, paths, times, legs);
        for (path, poses) in motion.arms.iter_mut().zip(paths) {
            let end = poses[poses.len() - 1];
            path.camera_from_retreat = match path.role {
                Role::Lift => retreat(&end, self.scene, self.options.retreat_distance),
                Role::Support => end,
            };
            if path.role == Role::Support {
                path.release = times[self.support_ends(way)];
            }
        }
        motion
    }
}

/// The last way point before the body is laid down.
fn standing(way: &[Way]) -> usize {
    way.partition_point(|at| at.angle <= FRAC_PI_2)
        .saturating_sub(1)
}

/// Steps of at most `step` radians, at least two.
#[allow(clippy::cast_sign_loss, reason = "at least 2")]
fn steps(angle: f64, step: f64) -> usize {
    (angle / step).ceil().max(2.0) as usize
}

/// Smooth from 0 at 0 to 1 at 1, constant outside.
fn ramp(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}
