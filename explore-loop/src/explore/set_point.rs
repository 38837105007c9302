//! Set-points: one for each arm and frame, always within the limits.
//!
//! ```text
//! v = (p' − p)/T:    ‖p' − p‖ ≤ step,   ‖v‖ ≤ v_max,   ∠(q, q') ≤ ω_max T,   min over 0 ≤ s ≤ 1 of ‖v − s v_before‖ ≤ a T
//! ```
//!
//! with `T` the frame period, `p, q` the last set-point (or the pose of the arm after a stop) and `v_before` the velocity at it. Braking is
//! unlimited: stopping must always be possible. The set-points lie on the checked path, whose clock runs as fast as the limits allow, equally
//! for all arms. An arm that is off the path returns to it in a straight line before the clock advances.

use crate::cell::{ArmState, CellInfo};
use grip_planner::Motion;
use nalgebra::{Isometry3, Vector3};

/// Limits of a tip.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Bounds {
    /// Largest speed, m/s.
    pub speed: f64,
    /// Largest acceleration, m/s², of an increase or turn of the velocity; braking is not limited.
    pub acceleration: f64,
    /// Largest rotation rate, rad/s.
    pub turn_rate: f64,
}

/// Limits of the arms.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Limits {
    /// For an arm that holds the object.
    pub holding: Bounds,
    /// For an arm with an empty jaw.
    pub empty: Bounds,
    /// Largest distance between consecutive set-points, metres.
    pub step: f64,
}

/// Distance from the tip at which rotation counts as motion, metres: the length of the fingers.
const FINGER: f64 = 0.02;
/// Least commanded speed, m/s.
const CRAWL: f64 = 1e-3;
/// Fractions of a step that are tried.
const SHARES: [f64; 10] = [1.0, 0.8, 0.6, 0.45, 0.3, 0.2, 0.12, 0.06, 0.03, 0.01];
/// Tolerance for rounding in a comparison with a limit.
const ROUNDING: f64 = 1e-9;
/// The last set-point of an arm, and the velocity at it.
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

    /// The last set-points, for a checkpoint.
    pub fn last(&self) -> &[Option<SetPoint>] {
        &self.last
    }

    /// Restores set-points; false if they are for other arms.
    pub fn restore(&mut self, last: Vec<Option<SetPoint>>) -> bool {
        let fits = last.len() == self.last.len();
        if fits {
            self.last = last;
        }
        fits
    }

    /// The arms were stopped: the next set-points begin at their poses, at rest.
    pub fn forget(&mut self) {
        self.last.fill(None);
    }

    /// The arms stood still for a frame.
    pub fn rest(&mut self) {
        for last in self.last.iter_mut().flatten() {
            last.velocity = Vector3::zeros();
        }
    }

    /// The last set-point of an arm.
    pub fn sent(&self, arm: usize) -> Option<Isometry3<f64>> {
        self.last.get(arm).copied().flatten().map(|l| l.pose)
    }

    /// The next set-points on `motion`, at most `ahead` seconds after `time`, and their time on the motion.
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
            // The arm is off the path, or about to turn a corner: move toward the present point of the path.
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

    /// The pose and velocity at which the next set-point of an arm begins.
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

    /// Records the set-point; an arm that stays at its set-point gets no command.
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
        // The speed is such that the pose is reached at the next frame, also by a motion that is mostly a rotation.
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

/// Distance of a velocity from the nearest one that can be reached by braking alone.
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

/// Length of the motion of a tip between two poses, with rotation counted at the fingers, metres.
pub(super) fn apart(a: &Isometry3<f64>, b: &Isometry3<f64>) -> f64 {
    let way = (a.translation.vector - b.translation.vector).norm();
    way.max(FINGER * a.rotation.angle_to(&b.rotation))
}
