//! An arm: a tip that moves along straight lines, and a jaw that holds nodes of the soft body.
//!
//! A commanded motion from pose `(p₀, q₀)` to `(p₁, q₁)` at speed `v` takes `T = max(‖p₁ − p₀‖, ℓ θ)/v`, where `θ` is the angle
//! between the orientations and `ℓ` the reach of the fingers: a pure turn is then no faster at the finger ends than a straight
//! motion. In between, `p = p₀ + s (p₁ − p₀)` and `q = slerp(q₀, q₁, s)` with `s = t/T`.

use nalgebra::{Isometry3, Point3};

use super::body::Body;
use super::options::JawOptions;
use crate::cell::{ArmInfo, ArmState};

/// Distance from the tip at which a turn counts as motion, metres.
const FINGER: f64 = 0.02;

/// Half the angle between open jaws times two, radians: what the jaw reports when open.
const OPEN_ANGLE: f64 = 0.8;

/// A closed jaw holds at most this many nodes and, if there are as many, at least the other number: three points fix an
/// orientation, a fourth makes the grip firm in all directions.
const HELD: (usize, usize) = (4, 10);

/// A node that carries at least this share of what the heaviest node in the jaw carries is held too.
const SHARE: f64 = 0.2;

pub(super) struct Gripper {
    pub info: ArmInfo,
    pose: Isometry3<f64>,
    motion: Option<Motion>,
    open: bool,
    /// Held nodes with their places in the tip frame.
    held: Vec<(usize, Point3<f64>)>,
}

struct Motion {
    from: Isometry3<f64>,
    to: Isometry3<f64>,
    elapsed: f64,
    duration: f64,
}

impl Gripper {
    pub fn new(info: ArmInfo) -> Self {
        Self {
            pose: info.camera_from_home,
            info,
            motion: None,
            open: true,
            held: Vec::new(),
        }
    }

    pub fn pose(&self) -> &Isometry3<f64> {
        &self.pose
    }

    pub fn moving(&self) -> bool {
        self.motion.is_some()
    }

    pub fn state(&self) -> ArmState {
        ArmState {
            camera_from_tip: self.pose,
            jaw: if self.open { OPEN_ANGLE } else { 0.0 },
            holding: !self.held.is_empty(),
            moving: self.moving(),
        }
    }

    /// How far each finger is off the middle, metres.
    pub fn finger_opening(&self, jaw: &JawOptions) -> f64 {
        if self.open { jaw.half_opening } else { 0.003 }
    }

    pub fn go(&mut self, to: Isometry3<f64>, speed: f64) {
        let distance = (to.translation.vector - self.pose.translation.vector).norm();
        let turn = self.pose.rotation.angle_to(&to.rotation);
        let duration = distance.max(FINGER * turn) / speed;
        self.motion = Some(Motion {
            from: self.pose,
            to,
            elapsed: 0.0,
            duration,
        });
    }

    /// Puts the tip to a pose, at once.
    pub fn place(&mut self, pose: Isometry3<f64>) {
        self.pose = pose;
        self.motion = None;
    }

    pub fn stop(&mut self) {
        self.motion = None;
    }

    /// Lets `dt` pass.
    pub fn advance(&mut self, dt: f64) {
        let Some(motion) = &mut self.motion else {
            return;
        };
        motion.elapsed += dt;
        // Within a millionth of a step of the end is the end: sums of steps do not meet it exactly.
        if motion.elapsed >= motion.duration - 1e-6 * dt {
            self.pose = motion.to;
            self.motion = None;
        } else {
            self.pose = between(&motion.from, &motion.to, motion.elapsed / motion.duration);
        }
    }

    /// Where the held nodes must be now, in the camera frame.
    pub fn targets(&self) -> impl Iterator<Item = (usize, Point3<f64>)> + '_ {
        self.held
            .iter()
            .map(|&(node, tip_from_node)| (node, self.pose * tip_from_node))
    }

    pub fn holds(&self, node: usize) -> bool {
        self.held.iter().any(|&(n, _)| n == node)
    }

    /// Takes hold of the nodes that carry the surface between the jaws; says whether there were any.
    ///
    /// `surface` and `camera_from_node` are in the camera frame; `taken` tells which nodes other jaws hold.
    pub fn close(
        &mut self,
        body: &Body,
        surface: &[Point3<f64>],
        jaw: &JawOptions,
        camera_from_node: impl Fn(usize) -> Point3<f64>,
        taken: impl Fn(usize) -> bool,
    ) -> bool {
        let mut load = std::collections::BTreeMap::<usize, f64>::new();
        for (v, p) in surface.iter().enumerate() {
            if inside(jaw, &self.pose.inverse_transform_point(p)) {
                let (nodes, weights) = body.carrier(v);
                nodes
                    .iter()
                    .zip(weights)
                    .for_each(|(&n, w)| *load.entry(n).or_default() += w.max(0.0));
            }
        }
        let mut ranked: Vec<(usize, f64)> = load
            .into_iter()
            .filter(|&(n, w)| w > 0.0 && !taken(n))
            .collect();
        ranked.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        let Some(&(_, heaviest)) = ranked.first() else {
            return false;
        };
        let firm = ranked
            .iter()
            .take_while(|&&(_, w)| w >= SHARE * heaviest)
            .count();
        ranked.truncate(firm.clamp(HELD.0, HELD.1));
        self.held = ranked
            .iter()
            .map(|&(n, _)| (n, self.pose.inverse_transform_point(&camera_from_node(n))))
            .collect();
        self.open = false;
        true
    }

    /// Opens the jaw and returns the nodes let go.
    pub fn open(&mut self) -> Vec<usize> {
        self.open = true;
        self.lose()
    }

    /// What the jaw held has slipped out of it: returns those nodes.
    pub fn lose(&mut self) -> Vec<usize> {
        self.held.drain(..).map(|(node, _)| node).collect()
    }
}

pub(super) fn between(from: &Isometry3<f64>, to: &Isometry3<f64>, s: f64) -> Isometry3<f64> {
    // Opposite orientations have no shortest way; either start or end is as good.
    from.try_lerp_slerp(to, s, 1e-9)
        .unwrap_or(if s < 0.5 { *from } else { *to })
}

fn inside(jaw: &JawOptions, p: &Point3<f64>) -> bool {
    p.x.abs() <= jaw.half_width
        && p.y.abs() <= jaw.half_opening
        && (-jaw.behind..=jaw.before).contains(&p.z)
}
