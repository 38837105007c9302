//! What is told while an exploration runs, and to whom.
//!
//! A [`Watcher`] sees everything and changes nothing: progress, recording, measures. `()` watches nothing.

use super::{FrameFault, Phase, Trouble};
use crate::Error;
use crate::canonical::CanonicalModel;
use crate::canonical::topology::Topology;
use crate::cell::Observation;
use crate::reconstruct::FrameReport;
use grip_planner::Plan;

/// What is told to a [`Watcher`].
#[derive(Debug, Clone, Copy)]
#[non_exhaustive]
pub enum Event<'a> {
    /// A phase begins.
    Phase(Phase),
    /// A frame was processed: what was left of the observation when it was cleaned, and what became of it.
    Frame(&'a Observation, &'a FrameReport),
    /// Something was wrong with a frame.
    Fault(&'a FrameFault),
    /// The topology before a decision.
    Topology(&'a Topology),
    /// A manipulation was planned.
    Planned(&'a Plan),
    /// An arm found nothing in its jaw.
    Missed(usize),
    /// An arm is not where it was sent: all are stopped, and go on from where they are.
    Waiting(usize),
    /// What was under way is given up: the arms have been stopped.
    Trouble(&'a Trouble),
    /// A body that was lost has been found again, turned and moved.
    Found,
    /// A manipulation is over; how many there were.
    Manipulated(usize),
}

/// Follows an exploration: progress, recording, measures. It sees everything and changes nothing.
pub trait Watcher {
    /// Something happened.
    ///
    /// # Errors
    /// What the watcher records cannot be written: the exploration ends.
    fn event(&mut self, event: Event<'_>, model: &CanonicalModel) -> Result<(), Error>;
}

/// Watches nothing.
impl Watcher for () {
    fn event(&mut self, _: Event<'_>, _: &CanonicalModel) -> Result<(), Error> {
        Ok(())
    }
}
