//! The phases of a manipulation: how a plan is carried out.
//!
//! ```text
//! reach       the checked path to the grips, with empty tips
//! grasp       close the jaws; without the lifting ones ─► home, without a supporting one ─► go on without it
//! manipulate  the planned motion, as fast as the speed governor allows
//! lower       after a turn: spread the body out
//! release     come to rest ─► open ─► come to rest ─► retreat
//! ```

use super::drive::Care;
use super::watch::refused;
use super::{Event, Explorer, Halt, Manipulation, Phase, State, Trouble};
use crate::cell::CellError;
use grip_planner::Role;

/// The path home of a plan is used when it begins this near to the present poses of the tips, metres.
const SAME_PLACE: f64 = 1e-3;

impl Explorer<'_> {
    /// The path of the plan from home: orientation first, high above the grip, then down along the approach direction.
    pub(super) fn reach(&mut self, manipulation: Box<Manipulation>) -> Result<State, Halt> {
        self.enter(Phase::Reach)?;
        let speed = self.options.limits.empty.speed;
        self.follow(&manipulation.plan.reach, Care::Empty, speed)?;
        Ok(State::Grasp(manipulation))
    }

    pub(super) fn grasp(&mut self, mut manipulation: Box<Manipulation>) -> Result<State, Halt> {
        self.enter(Phase::Grasp)?;
        let mut lifting_missed = false;
        for grip in manipulation.plan.grips.clone() {
            match self.cell.close_jaw(grip.arm) {
                Ok(()) => self.closed[grip.arm] = true,
                Err(CellError::NothingGrasped { arm }) => {
                    self.tell(Event::Missed(arm))?;
                    lifting_missed |= grip.role == Role::Lift;
                }
                Err(error) => return Err(refused(error)),
            }
        }
        self.guard.pause();
        self.frame()?;
        // A supporting arm may miss; all lifting arms must hold.
        if lifting_missed {
            self.misses += 1;
            self.open_all()?;
            return Ok(State::Home);
        }
        if manipulation.plan.grips.iter().any(|g| !self.closed[g.arm]) {
            manipulation = self.without_missed(manipulation)?;
        }
        Ok(State::Manipulate(manipulation))
    }

    /// Arms that missed stay where they are: the planned paths are for tools that hold.
    fn without_missed(
        &mut self,
        mut manipulation: Box<Manipulation>,
    ) -> Result<Box<Manipulation>, Halt> {
        let closed = self.closed.clone();
        let plan = &mut manipulation.plan;
        plan.motion.arms.retain(|path| closed[path.arm]);
        let missed: Vec<usize> = plan
            .grips
            .iter()
            .map(|g| g.arm)
            .filter(|&a| !closed[a])
            .collect();
        self.send_home(&missed)?;
        Ok(manipulation)
    }

    /// Follows the planned paths; slows down while registration is poor, and gives up when the body is lost.
    pub(super) fn manipulate(&mut self, manipulation: Box<Manipulation>) -> Result<State, Halt> {
        self.enter(Phase::Manipulate)?;
        let plan = &manipulation.plan;
        self.under_way = Some((plan.motion.clone(), 0.0));
        let places = plan.grips.iter().map(|g| g.arm).zip(&manipulation.at_rest);
        self.slips
            .grip(places.map(|(arm, place)| (arm, *place)).collect());
        match self.follow(&plan.motion, Care::Holding, plan.speed_limit) {
            // A firm body that holds the tips back while it is lowered has reached the table: it is down.
            Err(Halt::Trouble(trouble))
                if matches!(*trouble, Trouble::NotArriving { .. }) && self.lowers() =>
            {
                self.halt()?;
            }
            followed => followed?,
        }
        self.under_way = None;
        self.misses = 0;
        Ok(State::Lower(manipulation))
    }

    /// Whether the current motion is past its middle, where lifting ends.
    fn lowers(&self) -> bool {
        let past = |(motion, time): &(grip_planner::Motion, f64)| *time > 0.5 * motion.duration;
        self.under_way.as_ref().is_some_and(past)
    }

    pub(super) fn lower(&mut self, manipulation: Box<Manipulation>) -> Result<State, Halt> {
        self.enter(Phase::Lower)?;
        if manipulation.plan.turn.is_some() {
            self.spread_out(&manipulation)?;
        }
        Ok(State::Release(manipulation))
    }

    pub(super) fn release(&mut self, manipulation: &Manipulation) -> Result<State, Halt> {
        self.enter(Phase::Release)?;
        // The body must come to rest before the grips, which are its only landmarks, are released.
        self.settle()?;
        self.open_all()?;
        self.settle()?;
        let withdraw = &manipulation.plan.withdraw;
        let begins_here = withdraw.arms.iter().all(|path| {
            let here = self.arms[path.arm].camera_from_tip;
            let way = |from: nalgebra::Isometry3<f64>| {
                (from.translation.vector - here.translation.vector).norm()
            };
            path.at(0.0).is_some_and(|from| way(from) < SAME_PLACE)
        });
        if begins_here {
            self.follow(withdraw, Care::Empty, self.options.limits.empty.speed)?;
        } else {
            self.go_home_from_here()?;
        }
        self.manipulations += 1;
        self.tell(Event::Manipulated(self.manipulations))?;
        self.tell_state()?;
        Ok(State::Home)
    }
}
