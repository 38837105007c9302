//! An arm: a tip that moves along straight lines, and a jaw that holds nodes of the soft body.
//!
//! A commanded motion from pose `(p₀, q₀)` to `(p₁, q₁)` at speed `v` takes `T = max(‖p₁ − p₀‖, ℓ θ)/v`, where `θ` is the angle
//! between the orientations and `ℓ` the reach of the fingers: a pure rotation is then no faster at the fingertips than a straight
//! motion. In between, `p = p₀ + s (p₁ − p₀)` and `q = slerp(q₀, q₁, s)` with `s = t/T`.

use nalgebra::{Isometry3, Point3};

use super::body::Body;
use super::options::JawOptions;
use crate::cell::{ArmInfo, ArmState};

/// Distance from the tip at which rotation counts as motion, metres.
const FINGER: f64 = 0.02;

/// The angle that an open jaw reports, radians.
const OPEN_ANGLE: f64 = 0.8;

/// Least (if there are as many) and largest number of nodes that a closed jaw holds: three points fix an
/// orientation, a fourth makes the grip firm in all directions.
const HELD: (usize, usize) = (4, 10);

/// Nodes that carry at least this share of the surface in the jaw, relative to the heaviest one, are held too.
const SHARE: f64 = 0.2;

pub(super) struct Gripper {
    pub info: ArmInfo,
    pose: Isometry3<f64>,
    motion: Option<Motion>,
    open: bool,
    /// Held nodes with their positions in the tip frame.
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

    /// Distance of each finger from the centre plane, metres.
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

    /// Moves the tip to a pose at once.
    pub fn place(&mut self, pose: Isometry3<f64>) {
        self.pose = pose;
        self.motion = None;
    }

    pub fn stop(&mut self) {
        self.motion = None;
    }

    /// Advances time by `dt`.
    pub fn advance(&mut self, dt: f64) {
        let Some(motion) = &mut self.motion else {
            return;
        };
        motion.elapsed += dt;
        // The motion ends within a millionth of a step of its duration: sums of steps do not meet it exactly.
        if motion.elapsed >= motion.duration - 1e-6 * dt {
            self.pose = motion.to;
            self.motion = None;
        } else {
            self.pose = between(&motion.from, &motion.to, motion.elapsed / motion.duration);
        }
    }

    /// The required positions of the held nodes, in the camera frame.
    pub fn targets(&self) -> impl Iterator<Item = (usize, Point3<f64>)> + '_ {
        self.held
            .iter()
            .map(|&(node, tip_from_node)| (node, self.pose * tip_from_node))
    }

    pub fn holds(&self, node: usize) -> bool {
        self.held.iter().any(|&(n, _)| n == node)
    }

    /// Holds the nodes that carry the surface between the jaws; returns whether there were any.
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

    /// Opens the jaw and returns the released nodes.
    pub fn open(&mut self) -> Vec<usize> {
        self.open = true;
        self.lose()
    }

    /// Releases the nodes after a slip, and returns them; the jaw stays closed.
    pub fn lose(&mut self) -> Vec<usize> {
        self.held.drain(..).map(|(node, _)| node).collect()
    }
}

pub(super) fn between(from: &Isometry3<f64>, to: &Isometry3<f64>, s: f64) -> Isometry3<f64> {
    // Opposite orientations have no unique shortest rotation; either end is as good.
    from.try_lerp_slerp(to, s, 1e-9)
        .unwrap_or(if s < 0.5 { *from } else { *to })
}

fn inside(jaw: &JawOptions, p: &Point3<f64>) -> bool {
    p.x.abs() <= jaw.half_width
        && p.y.abs() <= jaw.half_opening
        && (-jaw.behind..=jaw.before).contains(&p.z)
}
