//! Set-points: one for each arm and frame, none of them ever beyond the limits.
//!
//! ```text
//! v = (p' − p)/T:    ‖p' − p‖ ≤ step,   ‖v‖ ≤ v_max,   ∠(q, q') ≤ ω_max T,   min over 0 ≤ s ≤ 1 of ‖v − s v_before‖ ≤ a T
//! ```
//!
//! with `T` the time of a frame, `p, q` the last set-point (or where the arm is, once it was stopped) and `v_before` the velocity it was passed with. Braking
//! is free: stopping must always be allowed. The set-points lie on the checked path: its clock runs as fast as the limits allow, for all
//! arms alike. An arm that is off the path comes back to it in a straight line before the clock goes on.

use crate::cell::{ArmState, CellInfo};
use grip_planner::Motion;
use nalgebra::{Isometry3, Vector3};

/// What a tip may do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// Largest speed, m/s.
    pub speed: f64,
    /// How fast the velocity may grow or turn, m/s²; braking is not bounded.
    pub acceleration: f64,
    /// Largest rotation rate, rad/s.
    pub turn_rate: f64,
}

/// What the arms may do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// An arm that holds the object.
    pub holding: Bounds,
    /// An arm with an empty jaw.
    pub empty: Bounds,
    /// Farthest that a set-point is from the one before, metres.
    pub step: f64,
}

/// Distance from the tip at which a turn counts as motion, metres: the reach of the fingers.
const FINGER: f64 = 0.02;
/// Least speed that is commanded, m/s.
const CRAWL: f64 = 1e-3;
/// Shares of a step that are tried.
const SHARES: [f64; 10] = [1.0, 0.8, 0.6, 0.45, 0.3, 0.2, 0.12, 0.06, 0.03, 0.01];
/// Rounding in a comparison with a limit.
const ROUNDING: f64 = 1e-9;
/// Where an arm was sent last, and how fast it was sent there.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
pub(super) struct SetPoint {
    pub pose: Isometry3<f64>,
    velocity: Vector3<f64>,
}

/// The last set-points.
pub(super) struct Drive {
    limits: Limits,
    period: f64,
    max_speed: Vec<f64>,
    last: Vec<Option<SetPoint>>,
}

/// A command to an arm.
pub(super) struct Command {
    pub arm: usize,
    pub camera_from_tip: Isometry3<f64>,
    pub speed: f64,
}

impl Drive {
    pub fn new(limits: Limits, info: &CellInfo) -> Self {
        Self {
            limits,
            period: 1.0 / info.camera_rate,
            max_speed: info.arms.iter().map(|a| a.max_speed).collect(),
            last: vec![None; info.arms.len()],
        }
    }

    /// The last set-points, to be written to a checkpoint.
    pub fn last(&self) -> &[Option<SetPoint>] {
        &self.last
    }

    /// Goes on from set-points that were written; false if they are not for these arms.
    pub fn restore(&mut self, last: Vec<Option<SetPoint>>) -> bool {
        let fits = last.len() == self.last.len();
        if fits {
            self.last = last;
        }
        fits
    }

    /// The arms were stopped: the next set-points begin where they are, at rest.
    pub fn forget(&mut self) {
        self.last.fill(None);
    }

    /// The arms have stood still for a frame.
    pub fn rest(&mut self) {
        for last in self.last.iter_mut().flatten() {
            last.velocity = Vector3::zeros();
        }
    }

    /// Where an arm was sent last.
    pub fn sent(&self, arm: usize) -> Option<Isometry3<f64>> {
        self.last.get(arm).copied().flatten().map(|l| l.pose)
    }

    /// The next set-points on `motion`, at most `ahead` seconds after `time`, and the time of the motion that they are at.
    pub fn advance(
        &mut self,
        motion: &Motion,
        [time, ahead]: [f64; 2],
        holds: &[bool],
        now: &[ArmState],
    ) -> (f64, Vec<Command>) {
        let at = |time: f64| -> Vec<(usize, Isometry3<f64>)> {
            let pose = |path: &grip_planner::ArmPath| Some((path.arm, path.at(time)?));
            motion.arms.iter().filter_map(pose).collect()
        };
        let fits = |goals: &[(usize, Isometry3<f64>)]| {
            let fit = |(arm, goal): &(usize, Isometry3<f64>)| self.allows(*arm, goal, holds, now);
            goals.iter().all(fit)
        };
        let on_path = SHARES
            .iter()
            .map(|share| time + share * ahead)
            .map(|later| (later, at(later)))
            .find(|(_, goals)| fits(goals));
        let (time, goals) = on_path.unwrap_or_else(|| {
            // Off the path, or about to turn a corner: toward where the path is now.
            let here = at(time);
            let toward = |share: f64| -> Vec<(usize, Isometry3<f64>)> {
                let part = |(arm, goal): &(usize, Isometry3<f64>)| {
                    let from = self.start(*arm, now).pose;
                    (*arm, between(&from, goal, share))
                };
                here.iter().map(part).collect()
            };
            let back = SHARES.iter().map(|s| s * s).map(toward).find(|g| fits(g));
            (time, back.unwrap_or_default())
        });
        let commands = goals
            .iter()
            .filter_map(|(arm, goal)| self.send(*arm, goal, holds, now));
        (time, commands.collect())
    }

    /// Where the next set-point of an arm begins.
    pub fn start(&self, arm: usize, now: &[ArmState]) -> SetPoint {
        let measured = || now.get(arm).map(|a| a.camera_from_tip);
        self.last.get(arm).copied().flatten().unwrap_or(SetPoint {
            pose: measured().unwrap_or_else(Isometry3::identity),
            velocity: Vector3::zeros(),
        })
    }

    fn bounds(&self, arm: usize, holds: &[bool]) -> Bounds {
        let bounds = if holds.get(arm).copied().unwrap_or(false) {
            self.limits.holding
        } else {
            self.limits.empty
        };
        let most = self.max_speed.get(arm).copied().unwrap_or(0.0);
        Bounds {
            speed: bounds.speed.min(most).min(self.limits.step / self.period),
            ..bounds
        }
    }

    fn allows(&self, arm: usize, goal: &Isometry3<f64>, holds: &[bool], now: &[ArmState]) -> bool {
        let (from, bounds) = (self.start(arm, now), self.bounds(arm, holds));
        let velocity = (goal.translation.vector - from.pose.translation.vector) / self.period;
        let turn = from.pose.rotation.angle_to(&goal.rotation) / self.period;
        velocity.norm() <= bounds.speed + ROUNDING
            && turn <= bounds.turn_rate + ROUNDING
            && beyond_braking(&velocity, &from.velocity)
                <= bounds.acceleration * self.period + ROUNDING
    }

    /// Notes the set-point; nothing is commanded to an arm that stays where it was sent.
    fn send(
        &mut self,
        arm: usize,
        goal: &Isometry3<f64>,
        holds: &[bool],
        now: &[ArmState],
    ) -> Option<Command> {
        let (from, bounds) = (self.start(arm, now), self.bounds(arm, holds));
        let velocity = (goal.translation.vector - from.pose.translation.vector) / self.period;
        let known = self.sent(arm).is_some();
        *self.last.get_mut(arm)? = Some(SetPoint {
            pose: *goal,
            velocity,
        });
        if known && from.pose == *goal {
            return None;
        }
        // There at the next frame, also when the motion is mostly a turn.
        let here = now.get(arm).map_or(from.pose, |a| a.camera_from_tip);
        let way = (goal.translation.vector - here.translation.vector).norm();
        let turn = FINGER * here.rotation.angle_to(&goal.rotation);
        let speed = (way.max(turn) / self.period).clamp(CRAWL, bounds.speed.max(CRAWL));
        Some(Command {
            arm,
            camera_from_tip: *goal,
            speed,
        })
    }
}

/// Distance of a velocity from the nearest that mere braking leads to.
fn beyond_braking(velocity: &Vector3<f64>, before: &Vector3<f64>) -> f64 {
    let square = before.norm_squared();
    let share = if square > 0.0 {
        (velocity.dot(before) / square).clamp(0.0, 1.0)
    } else {
        0.0
    };
    (velocity - before * share).norm()
}

fn between(a: &Isometry3<f64>, b: &Isometry3<f64>, share: f64) -> Isometry3<f64> {
    a.try_lerp_slerp(b, share, 1e-9)
        .unwrap_or(if share < 0.5 { *a } else { *b })
}

/// How far a tip goes from one pose to the other, its fingers counted, metres.
pub(super) fn apart(a: &Isometry3<f64>, b: &Isometry3<f64>) -> f64 {
    let way = (a.translation.vector - b.translation.vector).norm();
    way.max(FINGER * a.rotation.angle_to(&b.rotation))
}
