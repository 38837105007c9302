//! What is seen and what is told while an exploration runs.
//!
//! ```text
//! observe ─► judge ─┬─ usable ─► reconstruct ─► tell
//!                   └─ not ─► stop the arms, tell; too often in a row: trouble
//! ```
//!
//! A [`Watcher`] sees everything and changes nothing: progress, recording, measures. `()` watches nothing.

use super::{Explorer, Followed, FrameFault, Halt, Mode, Phase, SavedState, Trouble};
use crate::Error;
use crate::canonical::CanonicalModel;
use crate::canonical::topology::Topology;
use crate::cell::{CellError, Observation};
use crate::reconstruct::FrameReport;
use grip_planner::Plan;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// What is told to a [`Watcher`].
#[derive(Debug, Clone, Copy)]
#[non_exhaustive]
pub enum Event<'a> {
    /// A phase begins.
    Phase(Phase),
    /// A frame came, as the cell gave it: what is to be recorded.
    Observed(&'a Observation),
    /// How well the places of the vertices are known after the frame that is told next: standard deviations, m, infinite where nothing is known. Told
    /// only to a watcher that [wants](Watcher::wants_uncertainty) it, where the reconstruction estimates it.
    Uncertainty(&'a [f64]),
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
    /// All that the loop knows between two manipulations, for [`Explorer::resume`]; told only to a watcher that [wants](Watcher::wants_state) it.
    State(&'a SavedState),
}

/// Follows an exploration: progress, recording, measures. It sees everything and changes nothing.
pub trait Watcher {
    /// Something happened.
    ///
    /// # Errors
    /// What the watcher records cannot be written: the exploration ends.
    fn event(&mut self, event: Event<'_>, model: &CanonicalModel) -> Result<(), Error>;

    /// Whether [`Event::State`] is to be told after every manipulation. By default not: it takes some milliseconds.
    fn wants_state(&self) -> bool {
        false
    }

    /// Whether [`Event::Uncertainty`] is to be told with every frame. By default not: it may take as long as the frame.
    fn wants_uncertainty(&self) -> bool {
        false
    }
}

/// Watches nothing.
impl Watcher for () {
    fn event(&mut self, _: Event<'_>, _: &CanonicalModel) -> Result<(), Error> {
        Ok(())
    }
}

impl Explorer<'_> {
    /// Waits for a frame, judges it and takes it into the model; `None` when it could not be used.
    pub(super) fn frame(&mut self) -> Result<Option<FrameReport>, Halt> {
        let asked = |flag: &Arc<AtomicBool>| flag.load(Ordering::Relaxed);
        if self.mode == Mode::Exploring && self.asked_to_stop.as_ref().is_some_and(asked) {
            return Err(Trouble::Interrupted.into());
        }
        let observation = self.cell.observe().map_err(refused)?;
        // Where the arms are is taken in first, whatever a watcher says of the frame: they may have to be seen to.
        let told = self.tell(Event::Observed(&observation));
        let (model, info) = (self.reconstructor.model(), self.cell.info());
        let judged = self.guard.judge(observation, model, info);
        self.arms.clone_from(&judged.observation.arms);
        told?;
        if self.mode == Mode::ArmsOnly {
            let unknown = judged.fault.filter(FrameFault::is_of_arms);
            return match unknown {
                Some(fault) => Err(Trouble::Blind { frames: 1, fault }.into()),
                None => Ok(None),
            };
        }
        let mut fault = judged.fault;
        let mut report = None;
        if fault.as_ref().is_none_or(FrameFault::is_usable) {
            let table = self.cell.info().table;
            match self.reconstructor.process(&judged.observation, &table) {
                Ok(made) => report = Some(made),
                Err(error) => {
                    let reason = error.to_string();
                    fault = Some(FrameFault::Refused { reason });
                }
            }
        }
        self.note(fault)?;
        if report.as_ref().is_some_and(|r| r.failure.is_none()) && self.closed.contains(&true) {
            self.moves.add(self.reconstructor.model());
        }
        if let Some(report) = &report {
            let model = self.reconstructor.model();
            if self.watcher.wants_uncertainty()
                && let Some(sigmas) = self.reconstructor.uncertainty()
            {
                self.watcher.event(Event::Uncertainty(&sigmas), model)?;
            }
            self.watcher
                .event(Event::Frame(&judged.observation, report), model)?;
            self.latest = Some(judged.observation);
        }
        Ok(report)
    }

    /// Stops the arms for what is wrong with a frame, and gives up when that lasts.
    pub(super) fn note(&mut self, fault: Option<FrameFault>) -> Followed {
        let Some(fault) = fault else {
            self.bad_frames = 0;
            return Ok(());
        };
        let arms = fault.is_of_arms();
        if fault.is_serious() && (self.mode == Mode::Exploring || arms) {
            self.halt()?;
        }
        self.tell(Event::Fault(&fault))?;
        if !fault.is_serious() {
            self.bad_frames = 0;
            return Ok(());
        }
        self.bad_frames += 1;
        let frames = self.bad_frames;
        if frames >= self.options.blind_frames && (self.mode == Mode::Exploring || arms) {
            return Err(Trouble::Blind { frames, fault }.into());
        }
        Ok(())
    }

    pub(super) fn enter(&mut self, phase: Phase) -> Result<(), Error> {
        self.tell(Event::Phase(phase))
    }

    pub(super) fn tell(&mut self, event: Event<'_>) -> Result<(), Error> {
        if self.mode == Mode::ArmsOnly {
            return Ok(());
        }
        self.watcher.event(event, self.reconstructor.model())
    }
}

/// What a command that was refused means.
pub(super) fn refused(error: CellError) -> Halt {
    match error {
        CellError::ArmFault { arm, reason } | CellError::BadCommand { arm, reason } => {
            Trouble::ArmFault { arm, reason }.into()
        }
        error => Halt::Error(error.into()),
    }
}
