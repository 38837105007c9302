//! Recovery from trouble.
//!
//! ```text
//! stop ─► wait for a frame ─► lower from here ─► open ─► (home, look) ─► does the last frame fit?
//!                                                                         │ no: where may it be? ([`crate::reconstruct::locate`])
//!                                                                         └► move the model there, look again
//! ```

use super::{Event, Explorer, Halt, Mode, State, Stop, Trouble};
use crate::Error;
use crate::reconstruct::locate::locate;
use nalgebra::Isometry3;

/// Least agreement of a place where the body may be (a body that shows a side never seen agrees less with all wrong ones, test `locate`), and the
/// number of places that are tried.
const FOUND: f64 = 0.5;
const PLACES: usize = 3;

impl Explorer<'_> {
    /// A failure of the cell ends the exploration with the present model; anything else is an error.
    pub(super) fn failed(&mut self, error: Error) -> Result<State, Error> {
        match error {
            Error::Cell(cell) if !self.reconstructor.model().is_empty() => {
                let reason = cell.to_string();
                let trouble = Trouble::CellFailed { reason };
                let _may_fail_too = self.halt();
                self.tell(Event::Trouble(&trouble))?;
                self.troubles.push(trouble.clone());
                self.done(Stop::Trouble(trouble))
            }
            error => Err(error),
        }
    }

    /// Searches for the body in the cloud, and moves the model to the place that agrees best with the frame and that the next frames confirm.
    pub(super) fn find_again(&mut self) -> Result<bool, Halt> {
        for pose in self.places() {
            self.reconstructor.relocate(&pose);
            if self.watch()? {
                self.tell(Event::Found)?;
                return Ok(true);
            }
            self.reconstructor.relocate(&pose.inverse());
        }
        Ok(false)
    }

    /// Motions of the live model to where the latest frame may show it, the best first.
    pub(super) fn places(&self) -> Vec<Isometry3<f64>> {
        let Some(latest) = &self.latest else {
            return Vec::new();
        };
        let (model, table) = (self.reconstructor.model(), self.cell.info().table);
        locate(model, latest, &table, self.options.spacing)
            .into_iter()
            .filter(|place| place.agreement >= FOUND)
            .map(|place| place.found_from_lost)
            .take(PLACES)
            .collect()
    }

    /// Stops, puts down the body, and decides how to continue.
    pub(super) fn recover(&mut self, trouble: Trouble) -> Result<State, Halt> {
        self.halt()?;
        self.tell(Event::Trouble(&trouble))?;
        self.troubles.push(trouble.clone());
        self.mode = Mode::PuttingDown;
        // The arms stand still for a frame before the recovery.
        let free = self.frame().and_then(|_| self.put_down(&trouble));
        self.mode = Mode::Exploring;
        let free = free?;
        let ends = matches!(trouble, Trouble::Interrupted | Trouble::ArmFault { .. });
        if ends || !free || self.troubles.len() > self.options.max_recoveries {
            return Ok(self.done(Stop::Trouble(trouble))?);
        }
        match trouble {
            Trouble::Lost { .. } | Trouble::Blind { .. } => {
                self.lost = true;
                self.freeze_best();
            }
            Trouble::Slipped { arm } => {
                self.freeze_best();
                self.slips.slip(arm);
                self.misses += 1;
            }
            Trouble::NotArriving { .. } => self.misses += 1,
            _ => {}
        }
        Ok(State::Home)
    }

    /// Puts down the body; returns whether the jaws are open afterwards.
    pub(super) fn put_down(&mut self, trouble: &Trouble) -> Result<bool, Halt> {
        let held = self.closed.contains(&true);
        if held && !trouble.arms_obey() {
            return Ok(false);
        }
        let down = self.lower_from_here();
        let down = match down {
            Ok(()) if matches!(trouble, Trouble::Interrupted) => self.go_home_from_here(),
            other => other,
        };
        match down {
            Ok(()) => Ok(true),
            Err(Halt::Error(error)) => Err(Halt::Error(error)),
            Err(Halt::Trouble(second)) => {
                self.halt()?;
                self.tell(Event::Trouble(&second))?;
                self.troubles.push(*second);
                Ok(!self.closed.contains(&true))
            }
        }
    }

    /// Secures the arms at the end, however the exploration ended.
    pub(super) fn secure(&mut self, well: bool) {
        let stopped = self.halt();
        if !well && stopped.is_ok() {
            self.mode = Mode::ArmsOnly;
            let down = self
                .lower_from_here()
                .and_then(|()| self.go_home_from_here());
            if down.is_err() {
                let _nothing_left_to_do = self.halt();
            }
        }
    }
}
