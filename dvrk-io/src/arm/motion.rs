//! What an arm is doing: a straight line with its jaw, or a trajectory of the robot's own.

use std::time::Duration;

use nalgebra::Isometry3;

use super::check::FrameCheck;
use super::line::Line;
use super::profile::{Profile, ProfileLimits};
use super::state::ControlPoint;
use crate::Error;
use crate::kinematics::{Kinematics, RcmFromTip, RcmFromWrist};

/// The next line, when the present one has come to rest.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Next {
    pub(crate) goal: RcmFromTip,
    pub(crate) speed: f64,
}

/// Set-points of the tips, tick by tick.
#[derive(Debug, Clone)]
pub(crate) struct LineMotion {
    pub(crate) line: Line,
    pub(crate) profile: Profile,
    pub(crate) next: Option<Next>,
    /// Joint values of the last set-point: the next must be near.
    pub(crate) joints: [f64; 6],
}

/// Set-points of the jaw, tick by tick.
#[derive(Debug, Clone, Copy)]
pub(crate) struct JawMotion {
    start: f64,
    sign: f64,
    profile: Profile,
}

impl JawMotion {
    pub(crate) fn new(
        start: f64,
        goal: f64,
        tick: f64,
        limits: ProfileLimits,
    ) -> Result<Self, Error> {
        Ok(Self {
            start,
            sign: if goal < start { -1.0 } else { 1.0 },
            profile: Profile::new((goal - start).abs(), tick, limits)?,
        })
    }

    pub(crate) fn angle(&self) -> f64 {
        self.start + self.sign * self.profile.travelled()
    }

    pub(crate) fn advance(&mut self) -> f64 {
        self.profile.advance();
        self.angle()
    }

    pub(crate) fn is_done(&self) -> bool {
        self.profile.is_done()
    }

    /// Another goal from here on. What moves towards it keeps its speed; what does not stops within what its limits allow in a
    /// tick or two, as a jaw has little mass.
    pub(crate) fn towards(
        &self,
        goal: f64,
        tick: f64,
        limits: ProfileLimits,
    ) -> Result<Self, Error> {
        let next = Self::new(self.angle(), goal, tick, limits)?;
        let same = next.sign * self.sign > 0.0;
        let speed = if same { self.profile.speed() } else { 0.0 };
        Ok(Self {
            profile: next.profile.with_speed(speed),
            ..next
        })
    }
}

/// A trajectory of the robot's own.
#[derive(Debug, Clone)]
pub(crate) struct MoveMotion {
    /// In the reference frame.
    pub(crate) goal: Isometry3<f64>,
    pub(crate) sent: Duration,
    pub(crate) states: u64,
    pub(crate) busy_seen: bool,
    pub(crate) repeated: bool,
    /// When busy fell.
    pub(crate) idle: Option<Duration>,
}

impl MoveMotion {
    /// When it was first seen to have ended.
    pub(crate) fn ended(&mut self, now: Duration) -> Duration {
        *self.idle.get_or_insert(now)
    }
}

#[derive(Debug, Clone)]
pub(crate) enum Motion {
    Line {
        line: Box<LineMotion>,
        jaw: Option<JawMotion>,
        /// When everything had been sent.
        done: Option<Duration>,
    },
    Move(MoveMotion),
}

impl FrameCheck {
    /// What to send for a pose of the tips.
    pub(crate) fn command(&self, kinematics: &Kinematics, tip: &RcmFromTip) -> Isometry3<f64> {
        let local = match self.control_point {
            ControlPoint::Wrist => kinematics.wrist_of(tip).0,
            ControlPoint::Tip => tip.0,
        };
        self.reference_from_rcm.0 * local
    }

    /// The pose of the tips for what was reported in the reference frame.
    pub(crate) fn tip(&self, kinematics: &Kinematics, reported: &Isometry3<f64>) -> RcmFromTip {
        self.tip_of_local(
            kinematics,
            &(self.reference_from_rcm.0.inverse() * reported),
        )
    }

    /// The pose of the tips for what was reported in the frame of the remote centre.
    pub(crate) fn tip_of_local(
        &self,
        kinematics: &Kinematics,
        local: &Isometry3<f64>,
    ) -> RcmFromTip {
        match self.control_point {
            ControlPoint::Wrist => kinematics.tip_of(&RcmFromWrist(*local)),
            ControlPoint::Tip => RcmFromTip(*local),
        }
    }
}
