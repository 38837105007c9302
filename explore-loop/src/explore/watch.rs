//! Processing of frames, and notification of watchers.
//!
//! ```text
//! observe ─► check ─┬─ usable ─► reconstruct ─► notify
//!                   └─ not ─► stop the arms, notify; too often in a row: trouble
//! ```
//!
//! A [`Watcher`] receives everything and changes nothing: progress, recording, measures. `()` ignores all events.

use super::{Explorer, Followed, FrameFault, Halt, Mode, Phase, SavedState, Trouble};
use crate::Error;
use crate::canonical::CanonicalModel;
use crate::canonical::topology::Topology;
use crate::cell::{CellError, Observation};
use crate::reconstruct::FrameReport;
use grip_planner::Plan;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// An event for a [`Watcher`].
#[derive(Debug, Clone, Copy)]
#[non_exhaustive]
pub enum Event<'a> {
    /// A phase begins.
    Phase(Phase),
    /// A frame arrived, as the cell gave it; this is what should be recorded.
    Observed(&'a Observation),
    /// Standard deviations of the positions of the vertices after the frame that follows, m, infinite where unknown. Only for a watcher that
    /// [wants](Watcher::wants_uncertainty) it, if the reconstruction estimates it.
    Uncertainty(&'a [f64]),
    /// A frame was processed: the cleaned observation, and the result.
    Frame(&'a Observation, &'a FrameReport),
    /// Something was wrong with a frame.
    Fault(&'a FrameFault),
    /// The topology before a decision.
    Topology(&'a Topology),
    /// A manipulation was planned.
    Planned(&'a Plan),
    /// A jaw closed on nothing.
    Missed(usize),
    /// An arm is not at its set-point: all are stopped, and continue from their present poses.
    Waiting(usize),
    /// The manipulation is given up: the arms have been stopped.
    Trouble(&'a Trouble),
    /// A lost body was found again.
    Found,
    /// The model is spoiled: that after so many manipulations is returned, with this topology.
    Restored(usize, &'a Topology),
    /// A manipulation is over; the number of manipulations so far.
    Manipulated(usize),
    /// The state of the loop between two manipulations, for [`Explorer::resume`]; only for a watcher that [wants](Watcher::wants_state) it.
    State(&'a SavedState),
}

/// Follows an exploration: progress, recording, measures. It receives everything and changes nothing.
pub trait Watcher {
    /// Handles an event.
    ///
    /// # Errors
    /// What the watcher records cannot be written: the exploration ends.
    fn event(&mut self, event: Event<'_>, model: &CanonicalModel) -> Result<(), Error>;

    /// Whether to send [`Event::State`] after every manipulation. False by default: it takes some milliseconds.
    fn wants_state(&self) -> bool {
        false
    }

    /// Whether to send [`Event::Uncertainty`] with every frame. False by default: it may take as long as the frame.
    fn wants_uncertainty(&self) -> bool {
        false
    }
}

/// Ignores all events.
impl Watcher for () {
    fn event(&mut self, _: Event<'_>, _: &CanonicalModel) -> Result<(), Error> {
        Ok(())
    }
}

impl Explorer<'_> {
    /// Waits for a frame, checks it and adds it to the model; `None` when it could not be used.
    pub(super) fn frame(&mut self) -> Result<Option<FrameReport>, Halt> {
        let asked = |flag: &Arc<AtomicBool>| flag.load(Ordering::Relaxed);
        if self.mode == Mode::Exploring && self.asked_to_stop.as_ref().is_some_and(asked) {
            return Err(Trouble::Interrupted.into());
        }
        let observation = self.cell.observe().map_err(refused)?;
        // The poses of the arms are recorded before the watcher is called, which may fail: the arms may have to be secured then.
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

    /// Stops the arms because of a fault of a frame, and gives up when that lasts.
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

/// The consequence of a refused command.
pub(super) fn refused(error: CellError) -> Halt {
    match error {
        CellError::ArmFault { arm, reason } | CellError::BadCommand { arm, reason } => {
            Trouble::ArmFault { arm, reason }.into()
        }
        error => Halt::Error(error.into()),
    }
}
