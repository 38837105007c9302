//! The current motion of an arm: a straight line with its jaw, or a trajectory of the robot's own.

use std::time::Duration;

use nalgebra::Isometry3;

use super::check::FrameCheck;
use super::line::Line;
use super::monitor::WINDOW;
use super::profile::{Profile, ProfileLimits};
use super::state::ControlPoint;
use crate::Error;
use crate::kinematics::{Kinematics, RcmFromTip, RcmFromWrist};

/// The last set-points of tips and jaw, and when each was sent. A motion that starts before the arm reports them starts from
/// them; starting from an older reported set-point would be a jump back.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct LastSent {
    pub(crate) tip: Option<(Duration, RcmFromTip)>,
    pub(crate) jaw: Option<(Duration, f64)>,
}

/// The value, if the arm may not report it yet.
pub(crate) fn in_flight<T>(sent: Option<(Duration, T)>, now: Duration) -> Option<T> {
    let (time, value) = sent?;
    (now <= time + WINDOW).then_some(value)
}

/// The next line, for when the present one has come to rest.
#[derive(Debug, Clone, Copy)]
pub(crate) struct NextLine {
    pub(crate) line: Line,
    pub(crate) profile: Profile,
}

/// Set-points of the tips, tick by tick.
#[derive(Debug, Clone)]
pub(crate) struct LineMotion {
    pub(crate) line: Line,
    pub(crate) profile: Profile,
    pub(crate) next: Option<NextLine>,
    /// Joint values of the last set-point: those of the next must be near.
    pub(crate) joints: [f64; 6],
}

impl LineMotion {
    /// Advances one tick; returns the pose of the tips.
    pub(crate) fn advance(&mut self) -> RcmFromTip {
        if self.profile.is_at_rest()
            && let Some(next) = self.next.take()
        {
            (self.line, self.profile) = (next.line, next.profile);
        }
        RcmFromTip(self.line.pose(self.profile.advance()))
    }

    pub(crate) fn is_done(&self) -> bool {
        self.profile.is_at_rest() && self.next.is_none()
    }
}

/// A motion of the jaw from one angle to another.
#[derive(Debug, Clone, Copy)]
struct Swing {
    start: f64,
    sign: f64,
    profile: Profile,
}

impl Swing {
    fn new(start: f64, goal: f64, tick: f64, limits: ProfileLimits) -> Result<Self, Error> {
        Ok(Self {
            start,
            sign: if goal < start { -1.0 } else { 1.0 },
            profile: Profile::new((goal - start).abs(), tick, limits)?,
        })
    }

    fn angle(&self, way: f64) -> f64 {
        self.start + self.sign * way
    }
}

/// Set-points of the jaw, tick by tick.
#[derive(Debug, Clone, Copy)]
pub(crate) struct JawMotion {
    now: Swing,
    /// The next motion, for when the present one has come to rest.
    next: Option<Swing>,
}

impl JawMotion {
    pub(crate) fn new(
        start: f64,
        goal: f64,
        tick: f64,
        limits: ProfileLimits,
    ) -> Result<Self, Error> {
        Ok(Self {
            now: Swing::new(start, goal, tick, limits)?,
            next: None,
        })
    }

    pub(crate) fn angle(&self) -> f64 {
        self.now.angle(self.now.profile.travelled())
    }

    /// Advances one tick; returns the angle of the jaw.
    pub(crate) fn advance(&mut self) -> f64 {
        if self.now.profile.is_at_rest()
            && let Some(next) = self.next.take()
        {
            self.now = next;
        }
        self.now.profile.advance();
        self.angle()
    }

    pub(crate) fn is_done(&self) -> bool {
        self.now.profile.is_at_rest() && self.next.is_none()
    }

    /// Changes the goal. The speed is kept if the goal lies ahead and the jaw can still stop there; otherwise the jaw stops
    /// first.
    pub(crate) fn towards(
        &self,
        goal: f64,
        tick: f64,
        limits: ProfileLimits,
    ) -> Result<Self, Error> {
        let mut direct = Swing::new(self.angle(), goal, tick, limits)?;
        let speed = self.now.profile.speed();
        let ahead = speed == 0.0 || direct.sign * self.now.sign > 0.0;
        if ahead && let Some(profile) = direct.profile.continuing(speed) {
            direct.profile = profile;
            return Ok(Self {
                now: direct,
                next: None,
            });
        }
        let mut now = self.now;
        now.profile.brake();
        let rest = now.angle(now.profile.length());
        Ok(Self {
            now,
            next: Some(Swing::new(rest, goal, tick, limits)?),
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
    /// The command for a pose of the tips.
    pub(crate) fn command(&self, kinematics: &Kinematics, tip: &RcmFromTip) -> Isometry3<f64> {
        let local = match self.control_point {
            ControlPoint::Wrist => kinematics.wrist_of(tip).0,
            ControlPoint::Tip => tip.0,
        };
        self.reference_from_rcm.0 * local
    }

    /// The pose of the tips, from the pose reported in the reference frame.
    pub(crate) fn tip(&self, kinematics: &Kinematics, reported: &Isometry3<f64>) -> RcmFromTip {
        self.tip_of_local(
            kinematics,
            &(self.reference_from_rcm.0.inverse() * reported),
        )
    }

    /// The pose of the tips, from the pose reported in the frame of the remote centre.
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
