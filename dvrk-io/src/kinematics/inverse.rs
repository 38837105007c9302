//! From a pose to joint values, in closed form.
//!
//! ```text
//! p, x, y    origin and first two axes of the wrist frame          a = −x    the wrist yaw axis
//!
//! z5 = −(a × p)/d,  d = |a × p|        the wrist pitch axis is square to the plane of a and p, in which the shaft lies
//! x5 = a × z5                          from the pitch axis to the yaw axis, away from the remote centre
//! w  = p − wrist · x5                  the wrist pitch axis meets the shaft,  r = |w|,  u = w/r the shaft
//!
//! q1 = atan2(u_x, −u_z)                q4 = atan2(−z5 · x3, z5 · y3)     x3, y3 where +pitch and −yaw move the shaft
//! q2 = atan2(−u_y, √(u_x² + u_z²))     q5 = atan2((z5 × u) · x5, u · x5)
//! q3 = r + carriage − shaft            q6 = atan2(−y · x5, −y · z5)
//! ```
//! The other sign of z5 bends the wrist back by more than 90°, which no instrument can. d is the distance of
//! the wrist yaw axis from the remote centre, d = r · cos q5 + wrist; at d = 0 the roll is undetermined, and the arm
//! is singular. Whole turns are added so that an angle is nearest to a reference value within its limits; with the
//! limits of the robot this affects only the roll, ±260°.

use std::f64::consts::TAU;

use nalgebra::Vector3;

use super::{Joint, Kinematics, RcmFromTip, RcmFromWrist, check_joints, check_pose};
use crate::Error;

/// Largest excess over a joint limit that counts as rounding. The formulas above change an angle by at most
/// 10⁻¹⁴ (d > 16 mm within the limits of the robot); an excess of
/// this value is a tenth of a nanometre at the tip.
const ROUNDING: f64 = 1e-10;
/// Closer to the singular pose, angles have fewer than ten accurate digits. Metres.
const SINGULAR: f64 = 1e-5;

/// Why the control point cannot reach a pose.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[non_exhaustive]
pub enum Unreachable {
    /// A joint would exceed its range; of several joints, the one that exceeds it by the largest share of its
    /// range.
    #[error("{joint} would be {value:.3} {}, its range is {:.3} to {:.3}", joint.unit(), range[0], range[1])]
    JointLimit {
        /// The joint.
        joint: Joint,
        /// Its value in radians (metres for the insertion).
        value: f64,
        /// Its range.
        range: [f64; 2],
    },
    /// The wrist would be too near the remote centre, where the robot silently moves the goal.
    #[error(
        "the wrist would be {:.1} mm from the remote centre, at least {:.1} mm are needed",
        distance * 1e3,
        limit * 1e3
    )]
    TooNearRemoteCentre {
        /// Distance of the wrist pitch axis, metres.
        distance: f64,
        /// What it must be at least, metres.
        limit: f64,
    },
    /// The wrist yaw axis would pass through the remote centre, where the roll is undetermined.
    #[error(
        "the wrist is bent so far that its yaw axis passes {:.3} mm from the remote centre: singular",
        distance * 1e3
    )]
    WristSingular {
        /// Distance of the wrist yaw axis from the remote centre, metres.
        distance: f64,
    },
    /// The pose is within limits, but by less than the required margin.
    #[error("{what} has a margin of {margin:.4} {unit}, but {wanted:.4} {unit} are required")]
    LittleMargin {
        /// The quantity that is nearest to its limit.
        what: &'static str,
        /// Its margin, in `unit`.
        margin: f64,
        /// The required margin.
        wanted: f64,
        /// `m` or `rad`.
        unit: &'static str,
    },
}

/// Distances of a joint configuration from limits and singularities. Negative beyond a limit.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct Margins {
    /// To the nearer limit of each of [`Joint::ALL`]: radians, metres for the insertion.
    pub joints: [f64; 6],
    /// Of the wrist pitch axis to the least distance from the remote centre, metres.
    pub remote_centre: f64,
    /// Angle by which the wrist pitch could grow before the arm is singular, radians.
    pub wrist: f64,
}

impl Margins {
    /// Whether no limit is exceeded.
    pub fn are_kept(&self) -> bool {
        let joints = self.joints.iter().all(|&margin| margin >= 0.0);
        joints && self.remote_centre >= 0.0 && self.wrist > 0.0
    }
}

/// Joint values for a pose of the control point.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct Reach {
    /// Joint values in the order of [`Joint::ALL`], within limits: radians, metres for the insertion.
    pub joints: [f64; 6],
    /// Their distances from limits and singularities.
    pub margins: Margins,
}

impl Kinematics {
    /// The joint values for a pose of the control point, with the roll nearest to the centre of its range.
    ///
    /// For a pose of the tips of the jaws, use [`Kinematics::wrist_of`] first.
    ///
    /// *Guarantees.* For joint values within limits, `inverse(rcm_from_wrist(q))` is q to 10⁻¹⁰, up to whole
    /// turns of the roll; for a reachable pose, `rcm_from_wrist` of the result is the pose to 10⁻⁹.
    ///
    /// # Errors
    /// [`Error::Unreachable`] with the reason; [`Error::OutOfRange`] for a pose that is not finite or whose
    /// quaternion is not a unit.
    ///
    /// # Complexity
    /// Constant, no allocation.
    pub fn inverse(&self, pose: &RcmFromWrist) -> Result<Reach, Error> {
        let middle = self
            .limits
            .map(|[lower, upper]| f64::midpoint(lower, upper));
        self.solve(pose, &middle)
    }

    /// As [`Kinematics::inverse`], with whole turns chosen so that each angle is nearest to that in `reference`, the
    /// present joint values of the arm.
    ///
    /// # Errors
    /// See [`Kinematics::inverse`]; also a reference that is not finite.
    pub fn inverse_near(&self, pose: &RcmFromWrist, reference: &[f64; 6]) -> Result<Reach, Error> {
        check_joints(reference)?;
        self.solve(pose, reference)
    }

    /// [`Kinematics::inverse`] for the tips of the closed jaws.
    ///
    /// # Errors
    /// See [`Kinematics::inverse`].
    pub fn inverse_of_tip(&self, pose: &RcmFromTip) -> Result<Reach, Error> {
        self.inverse(&self.wrist_of(pose))
    }

    /// Distances of joint values from limits and singularities.
    ///
    /// # Errors
    /// A joint value that is not finite.
    pub fn margins(&self, joints: &[f64; 6]) -> Result<Margins, Error> {
        check_joints(joints)?;
        Ok(self.margins_at(joints))
    }

    fn margins_at(&self, joints: &[f64; 6]) -> Margins {
        let distance = joints[2] - self.wrist_before_insertion();
        // cos q5 = −wrist/r is singular: slightly beyond a right angle.
        let singular = (-self.instrument.wrist / distance.max(self.instrument.wrist)).acos();
        let to_limit = |index: usize| {
            let [lower, upper] = self.limits[index];
            (joints[index] - lower).min(upper - joints[index])
        };
        Margins {
            joints: std::array::from_fn(to_limit),
            remote_centre: distance - self.min_wrist_distance,
            wrist: singular - joints[4].abs(),
        }
    }

    fn solve(&self, pose: &RcmFromWrist, wanted: &[f64; 6]) -> Result<Reach, Error> {
        let principal = self.principal(pose)?;
        let mut joints = [0.0; 6];
        let mut worst = None;
        for (index, joint) in Joint::ALL.into_iter().enumerate() {
            let range = self.limits[index];
            let value = match joint {
                Joint::Insertion => principal[index],
                _ => nearest_turn(principal[index], range, wanted[index]),
            };
            joints[index] = value.clamp(range[0], range[1]);
            let excess = (value - joints[index]).abs();
            // Empty ranges are allowed: a joint may be locked.
            let share = excess / (range[1] - range[0]).max(ROUNDING);
            if excess > ROUNDING && worst.is_none_or(|(most, _)| share > most) {
                worst = Some((
                    share,
                    Unreachable::JointLimit {
                        joint,
                        value,
                        range,
                    },
                ));
            }
        }
        // The remote centre is checked before limits: near it, joint values are meaningless.
        let distance = principal[2] - self.wrist_before_insertion();
        if distance < self.min_wrist_distance - ROUNDING {
            let limit = self.min_wrist_distance;
            return Err(Unreachable::TooNearRemoteCentre { distance, limit }.into());
        }
        match worst {
            Some((_, reason)) => Err(reason.into()),
            None => Ok(Reach {
                joints,
                margins: self.margins_at(&joints),
            }),
        }
    }

    /// The formulas at the head of this file: each angle between −π and π, without limits.
    fn principal(&self, pose: &RcmFromWrist) -> Result<[f64; 6], Error> {
        let pose = check_pose(&pose.0)?;
        let p = pose.translation.vector;
        let axes = pose.rotation.to_rotation_matrix();
        let (yaw_axis, y) = (-axes.matrix().column(0), axes.matrix().column(1));

        let normal = p.cross(&yaw_axis);
        let arm = normal.norm();
        if arm < SINGULAR {
            let distance = p.norm();
            let limit = self.min_wrist_distance;
            return Err(if distance < limit {
                Unreachable::TooNearRemoteCentre { distance, limit }.into()
            } else {
                Unreachable::WristSingular { distance: arm }.into()
            });
        }
        let z5 = normal / arm;
        let x5 = yaw_axis.cross(&z5);
        let w = p - self.instrument.wrist * x5;
        let r = w.norm();
        if r < SINGULAR {
            let limit = self.min_wrist_distance;
            return Err(Unreachable::TooNearRemoteCentre { distance: r, limit }.into());
        }
        let u = w / r;

        let yaw = u.x.atan2(-u.z);
        let level = u.x.hypot(u.z);
        let pitch = (-u.y).atan2(level);
        // Frame 3 of the forward kinematics: z3 = u, y3 in the direction of −yaw, x3 in that of +pitch.
        let (sin, cos) = yaw.sin_cos();
        let y3 = Vector3::new(-cos, 0.0, -sin);
        let x3 = y3.cross(&u);
        let roll = (-z5.dot(&x3)).atan2(z5.dot(&y3));
        let wrist_pitch = z5.cross(&u).dot(&x5).atan2(u.dot(&x5));
        let wrist_yaw = (-y.dot(&x5)).atan2(-y.dot(&z5));
        let insertion = r + self.wrist_before_insertion();
        Ok([yaw, pitch, insertion, roll, wrist_pitch, wrist_yaw])
    }
}

/// `angle` plus whole turns, within `range` if possible, nearest to `wanted` there.
fn nearest_turn(angle: f64, [lower, upper]: [f64; 2], wanted: f64) -> f64 {
    let wanted = wanted.clamp(lower, upper);
    let turns = ((wanted - angle) / TAU).round();
    let outside = |value: f64| (lower - value).max(value - upper).max(0.0);
    // The nearest one; if it is outside, one of its neighbours may be inside.
    [turns, turns - 1.0, turns + 1.0]
        .map(|turns| angle + turns * TAU)
        .into_iter()
        .reduce(|best, next| {
            let gains = outside(best) > ROUNDING && outside(next) < outside(best);
            if gains { next } else { best }
        })
        .unwrap_or(angle)
}
