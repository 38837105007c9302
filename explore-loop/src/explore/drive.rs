//! Follows planned motions frame by frame.
//!
//! ```text
//! clock of the motion:  t ← t + min(1, v_governor / v_peak) · T        limited by the set-points
//! ```
//!
//! The [`SpeedGovernor`] starts slowly, accelerates, and slows down when frames fit badly; while they do not fit, or cannot be used, the arms stop. A
//! supporting jaw opens at its own time. If an arm lags behind, all stop and continue from there.
//!
//! A set-point is never more than a frame ahead, so an arm that gets no more commands stops by itself. On a fault,
//! [`Cell::stop`](crate::cell::Cell::stop) is called in the frame in which it is noticed. Recovery motions start at the present poses and are planned and checked as others are.

use super::set_down::{self, Reaction, reaction};
use super::set_point::apart;
use super::watch::refused;
use super::{Event, Explorer, Followed, FrameFault, Halt, Manipulation, Mode, Trouble};
use crate::plan;
use grip_planner::{
    CarryOptions, GovernorOptions, Motion, ReachOptions, Refusal, Role, SpeedGovernor, Tip, carry,
    go_home, lower, put_down,
};
use nalgebra::{Isometry3, Vector3};

/// How far empty tips retreat before they turn for home, metres.
const RETREAT: f64 = 0.05;
/// Residuals between which the governor slows down, in spacings.
const CALM: f64 = 0.3;
const ALARM: f64 = 0.8;

/// What a motion depends on while it is followed.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Care {
    /// The jaws are empty: it does not matter whether the body can be tracked.
    Empty,
    /// The jaws hold the body: slow when frames fit badly, stopped when they do not fit.
    Holding,
    /// As [`Self::Holding`], and the motion ends where the table carries the body or the body resists.
    SettingDown,
    /// As [`Self::Holding`], and the motion ends where the body resists.
    Spreading,
    /// The body is being put down and tracking may be lost: only the arms count.
    PutDown,
}

impl Care {
    /// Whether a motion ends with this reaction of the body.
    fn ends_with(self, reaction: Reaction) -> bool {
        match self {
            Self::SettingDown => true,
            Self::Spreading => reaction == Reaction::Resists,
            _ => false,
        }
    }

    /// Whether the jaws hold the body, which must not be lost.
    fn holds(self) -> bool {
        !matches!(self, Self::Empty | Self::PutDown)
    }
}

/// State of a motion that is followed.
struct Progress {
    governor: Option<SpeedGovernor>,
    time: f64,
    residual: f64,
    misfits: usize,
    /// Seconds without progress of the motion.
    late: f64,
    /// Force of the grips in the first frame that has it.
    first_force: Option<Vector3<f64>>,
    /// The reaction of the body to the tips.
    reaction: Option<Reaction>,
}

impl Explorer<'_> {
    /// Follows a motion to its end, frame by frame.
    pub(super) fn follow(&mut self, motion: &Motion, care: Care, cruise: f64) -> Followed {
        self.follow_until(motion, care, cruise).map(|_| ())
    }

    /// The same; if it ends early, why.
    fn follow_until(
        &mut self,
        motion: &Motion,
        care: Care,
        cruise: f64,
    ) -> Result<Option<Reaction>, Halt> {
        let mut progress = Progress {
            governor: self.governor(care, cruise)?,
            time: 0.0,
            residual: 0.0,
            misfits: 0,
            late: 0.0,
            first_force: None,
            reaction: None,
        };
        loop {
            self.open_early(motion, progress.time)?;
            let stands = self.stands(care, &progress);
            let before = progress.time;
            if stands {
                // After a stop the motion starts as slowly as at the beginning.
                self.drive.rest();
                progress.governor = self.governor(care, cruise)?;
            } else {
                self.command(motion, &mut progress)?;
            }
            self.step(motion, care, &mut progress)?;
            if let Some(reaction) = progress.reaction.filter(|r| care.ends_with(*r)) {
                self.halt()?;
                return Ok(Some(reaction));
            }
            let arrived = !motion.arms.iter().any(|p| self.moves(p.arm));
            if progress.time >= motion.duration && arrived && self.lag(motion).is_none() {
                self.open_early(motion, motion.duration)?;
                return Ok(None);
            }
            let advanced = progress.time > before || stands;
            self.wait_for_arms(motion, advanced, &mut progress)?;
        }
    }

    fn governor(&self, care: Care, cruise: f64) -> Result<Option<SpeedGovernor>, Halt> {
        if care == Care::Empty {
            return Ok(None);
        }
        let defaults = GovernorOptions::default();
        let least = if self.options.steady_speed {
            1.0
        } else {
            defaults.least
        };
        let options = defaults
            .with_cruise(cruise.min(self.options.limits.holding.speed))
            .with_least(least)
            .with_calm(CALM * self.options.spacing)
            .with_alarm(ALARM * self.options.spacing);
        Ok(Some(
            SpeedGovernor::new(options).map_err(crate::Error::from)?,
        ))
    }

    /// Whether the arms must wait for frames that can be used or that fit.
    fn stands(&self, care: Care, progress: &Progress) -> bool {
        let blind = self.bad_frames > 0 && care != Care::PutDown && self.mode == Mode::Exploring;
        let lost = progress.misfits > self.options.doubt && care.holds();
        blind || lost
    }

    fn command(&mut self, motion: &Motion, progress: &mut Progress) -> Followed {
        let period = 1.0 / self.cell.info().camera_rate;
        let rate = match &mut progress.governor {
            Some(governor) => motion.rate(governor.next(period, progress.residual)),
            None => 1.0,
        };
        // A jaw that releases early opens before its arm moves on.
        let stops = motion
            .arms
            .iter()
            .filter(|p| self.closed[p.arm] && p.release > progress.time);
        let until = stops.map(|p| p.release).fold(motion.duration, f64::min);
        let ahead = (rate * period).min(until - progress.time).max(0.0);
        let (time, commands) =
            self.drive
                .advance(motion, [progress.time, ahead], &self.closed, &self.arms);
        progress.time = time;
        if let Some((_, followed)) = &mut self.under_way {
            *followed = time;
        }
        if until - time < 1e-9 {
            progress.time = until;
        }
        for command in commands {
            let sent = self
                .cell
                .move_arm(command.arm, command.camera_from_tip, command.speed);
            sent.map_err(refused)?;
        }
        Ok(())
    }

    /// Opens a supporting jaw at its own time.
    fn open_early(&mut self, motion: &Motion, time: f64) -> Followed {
        for path in &motion.arms {
            let due = path.release < motion.duration && time >= path.release;
            if path.role == Role::Support && due && self.closed[path.arm] {
                self.open(path.arm)?;
            }
        }
        Ok(())
    }

    /// Processes one frame and checks it for trouble.
    fn step(&mut self, motion: &Motion, care: Care, progress: &mut Progress) -> Followed {
        let report = self.frame()?;
        if let Some(report) = &report {
            let misfit = report.failure.is_some();
            progress.misfits = if misfit { progress.misfits + 1 } else { 0 };
            progress.residual = if misfit { f64::NAN } else { report.residual };
            let first = progress.first_force.or(report.grip_force);
            let forces = first.zip(report.grip_force);
            let table = self.cell.info().table;
            progress.reaction = forces.and_then(|(first, now)| reaction(&first, &now, &table));
            progress.first_force = first;
            if progress.misfits == self.options.doubt + 1 && care.holds() {
                let frames = progress.misfits;
                self.note(Some(FrameFault::Misfits { frames }))?;
            }
        }
        if !care.holds() {
            return Ok(());
        }
        let frames = progress.misfits;
        if frames > self.options.doubt + self.options.patience {
            return Err(Trouble::Lost { frames }.into());
        }
        if report.is_none() {
            return Ok(());
        }
        let lifting = motion.arms.iter().filter(|p| p.role == Role::Lift);
        let slipped = lifting
            .map(|p| p.arm)
            .find(|&arm| self.closed[arm] && !self.arms[arm].holding);
        match slipped {
            Some(arm) => Err(Trouble::Slipped { arm }.into()),
            None => Ok(()),
        }
    }

    /// The arm that is farthest from its set-point, and the distance, if that is too large.
    fn lag(&self, motion: &Motion) -> Option<(usize, f64)> {
        let distance = |arm: usize| {
            let (sent, at) = (self.drive.sent(arm)?, self.arms.get(arm)?.camera_from_tip);
            Some((arm, apart(&sent, &at)))
        };
        let lags = motion.arms.iter().filter_map(|p| distance(p.arm));
        lags.filter(|(_, way)| *way > self.options.lag)
            .max_by(|a, b| a.1.total_cmp(&b.1))
    }

    fn moves(&self, arm: usize) -> bool {
        self.arms.get(arm).is_some_and(|a| a.moving)
    }

    /// Stops all arms when one lags behind; from there they return to the path. Gives up if there is no progress.
    fn wait_for_arms(
        &mut self,
        motion: &Motion,
        advanced: bool,
        progress: &mut Progress,
    ) -> Followed {
        if advanced {
            progress.late = 0.0;
        } else {
            progress.late += 1.0 / self.cell.info().camera_rate;
        }
        if let Some((arm, _)) = self.lag(motion) {
            self.halt()?;
            self.tell(Event::Waiting(arm))?;
        }
        let seconds = progress.late;
        if seconds <= self.options.arrival {
            return Ok(());
        }
        let off = |path: &grip_planner::ArmPath| {
            let (at, here) = (path.at(progress.time)?, self.arms.get(path.arm)?);
            Some((path.arm, apart(&at, &here.camera_from_tip)))
        };
        let farthest = motion.arms.iter().filter_map(off);
        let (arm, distance) = farthest
            .max_by(|a, b| a.1.total_cmp(&b.1))
            .unwrap_or((0, 0.0));
        Err(Trouble::NotArriving {
            arm,
            distance,
            seconds,
        }
        .into())
    }

    /// Stops every arm at its present pose.
    pub(super) fn halt(&mut self) -> Followed {
        self.drive.forget();
        self.cell.stop().map_err(refused)
    }

    /// Opens a jaw.
    pub(super) fn open(&mut self, arm: usize) -> Followed {
        self.cell.open_jaw(arm).map_err(refused)?;
        if let Some(closed) = self.closed.get_mut(arm) {
            *closed = false;
        }
        self.guard.pause();
        Ok(())
    }

    /// Opens every closed jaw.
    pub(super) fn open_all(&mut self) -> Followed {
        (0..self.closed.len())
            .filter(|&arm| self.closed[arm])
            .collect::<Vec<_>>()
            .into_iter()
            .try_for_each(|arm| self.open(arm))
    }

    /// Observes until the visible surface rests: it moves less than a tenth of a spacing a frame, three frames in a row.
    pub(super) fn settle(&mut self) -> Followed {
        let mut still = 0;
        for _ in 0..self.options.settle_frames {
            let before = self.reconstructor.model().live().to_vec();
            let Some(report) = self.frame()? else {
                continue;
            };
            let model = self.reconstructor.model();
            let moved: Vec<f64> = before
                .iter()
                .zip(model.live())
                .zip(&report.measured)
                .filter(|(_, seen)| **seen)
                .map(|((a, b), _)| (a - b).norm())
                .collect();
            let mean = moved.iter().sum::<f64>() / moved.len().max(1) as f64;
            still = if mean < 0.1 * self.options.spacing {
                still + 1
            } else {
                0
            };
            if still == 3 {
                break;
            }
        }
        Ok(())
    }

    /// Moves the tips out to the width of the body at rest and down to the table, or as far as the body lets them, where a turn ends: see `set_down`.
    pub(super) fn spread_out(&mut self, manipulation: &Manipulation) -> Followed {
        let height = self.options.set_down;
        match self.spread_to(manipulation, Some(height), Care::SettingDown)? {
            Some(Reaction::Stands) => self
                .spread_to(manipulation, None, Care::Spreading)
                .map(|_| ()),
            Some(Reaction::Resists) | None => Ok(()),
        }
    }

    fn spread_to(
        &mut self,
        manipulation: &Manipulation,
        release_height: Option<f64>,
        care: Care,
    ) -> Result<Option<Reaction>, Halt> {
        let table = self.cell.info().table;
        let Some(latest) = &self.latest else {
            return Ok(None);
        };
        let rest = self.reconstructor.model().rest();
        let goals = set_down::goals(manipulation, latest, rest, &table, release_height);
        let (arms, goals): (Vec<usize>, Vec<Isometry3<f64>>) = goals.into_iter().unzip();
        let (tips, options) = (self.tips(&arms), self.carrying(0.7));
        let live = self.reconstructor.model().live();
        let motion = self.with_scene(|scene| {
            carry(live, scene, &tips, &goals, &options)
                // Where the body hangs is most uncertain below the grips, and it gives way there.
                .or_else(|_| carry(&[], scene, &tips, &goals, &options))
        });
        // Without such a motion the turn ends where jaws may open.
        let Ok(motion) = motion else {
            return Ok(None);
        };
        match self.follow_until(&motion, care, options.speed) {
            // If the tips are held back, a firm body has reached the table: it is down.
            Err(Halt::Trouble(trouble)) if matches!(*trouble, Trouble::NotArriving { .. }) => {
                self.halt()?;
                Ok(None)
            }
            followed => followed,
        }
    }

    /// Puts down what the jaws hold, opens them and lets the body come to rest: along the current motion, back while it lifts and on while it lowers;
    /// straight down if there is none, or the arms are not on it.
    pub(super) fn lower_from_here(&mut self) -> Followed {
        let under_way = self.under_way.take();
        let held: Vec<usize> = (0..self.closed.len()).filter(|&a| self.closed[a]).collect();
        if held.is_empty() {
            return Ok(());
        }
        let (tips, options) = (self.tips(&held), self.carrying(0.5));
        let on_it = |(motion, time): &(Motion, f64)| {
            held.iter().all(|&arm| {
                let path = motion.arms.iter().find(|p| p.arm == arm);
                let pose = path.and_then(|p| p.at(*time));
                pose.is_some_and(|p| apart(&p, &self.arms[arm].camera_from_tip) <= self.options.lag)
            })
        };
        let along = under_way.filter(on_it);
        let motion = self.with_scene(|scene| {
            let along = along.and_then(|(motion, time)| put_down(scene, &motion, time).ok());
            along.map_or_else(|| lower(scene, &tips, &options), Ok)
        });
        let motion = motion.map_err(no_way)?;
        self.follow(&motion, Care::PutDown, options.speed)?;
        self.settle()?;
        self.open_all()?;
        self.settle()
    }

    /// Sends every arm that is not at home there, jaw open, along a checked path.
    pub(super) fn go_home_from_here(&mut self) -> Followed {
        let all: Vec<usize> = (0..self.arms.len()).collect();
        self.send_home(&all)
    }

    /// The same for some arms, which avoid the present poses of the others.
    pub(super) fn send_home(&mut self, arms: &[usize]) -> Followed {
        let away = |arm: &usize| !self.is_home(*arm);
        let away: Vec<usize> = arms.iter().copied().filter(away).collect();
        if away.is_empty() {
            return Ok(());
        }
        let (tips, options) = (self.tips(&away), self.reaching());
        let live = self.reconstructor.model().live();
        let motion = self.with_scene(|scene| {
            go_home(live, scene, &tips, RETREAT, &options)
                // What lies over an open jaw is pulled off it; a path that only the body obstructs is better than none.
                .or_else(|_| go_home(&[], scene, &tips, RETREAT, &options))
                // The joints may not allow so long a retreat.
                .or_else(|reason| {
                    go_home(&[], scene, &tips, 0.3 * RETREAT, &options).map_err(|_| reason)
                })
        });
        let motion = motion.map_err(no_way)?;
        self.follow(&motion, Care::Empty, options.speed)
    }

    fn is_home(&self, arm: usize) -> bool {
        let (home, here) = (
            &self.cell.info().arms[arm].camera_from_home,
            &self.arms[arm].camera_from_tip,
        );
        apart(home, here) < 1e-3
    }

    fn tips(&self, arms: &[usize]) -> Vec<Tip> {
        let tip = |&arm: &usize| Tip {
            arm,
            role: Role::Lift,
            camera_from_tip: self.drive.start(arm, &self.arms).pose,
        };
        arms.iter().map(tip).collect()
    }

    fn carrying(&self, share: f64) -> CarryOptions {
        let bounds = self.options.limits.holding;
        CarryOptions::default()
            .with_speed(share * bounds.speed)
            .with_acceleration(bounds.acceleration)
            .with_turn_rate(bounds.turn_rate)
            .with_release_height(self.options.set_down)
    }

    fn reaching(&self) -> ReachOptions {
        let bounds = self.options.limits.empty;
        ReachOptions::default()
            .with_speed(bounds.speed)
            .with_acceleration(bounds.acceleration)
            .with_turn_rate(bounds.turn_rate)
    }

    fn with_scene<T>(&self, work: impl FnOnce(&grip_planner::Scene<'_>) -> T) -> T {
        let arms = plan::arms(self.cell.info());
        work(&plan::scene(self.cell.info(), &arms, &self.camera()))
    }
}

fn no_way(reason: Refusal) -> Halt {
    match reason {
        Refusal::Input(error) => Halt::Error(error.into()),
        reason => Trouble::NoWay { reason }.into(),
    }
}
