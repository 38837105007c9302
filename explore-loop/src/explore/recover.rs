//! Recovery from trouble.
//!
//! ```text
//! stop ─► wait for a frame ─► lower from here ─► open ─► (home, look) ─► does the last frame fit?
//!                                                                         │ no: argmax over rigid T of the overlap of T · model with the cloud
//!                                                                         └► move the model there, look again
//! ```
//!
//! First the recently seen part is aligned, then the whole model: the body may lie on another side.

use super::{Event, Explorer, Halt, Mode, State, Stop, Trouble};
use crate::Error;
use nalgebra::{Isometry3, Point3, UnitVector3};

/// Share of the vertices that must match the cloud when a body is found again: about half of a closed body faces the camera.
const FOUND: f64 = 0.3;
/// Number of frames before the last sight of the body in which a vertex was seen recently.
const LATELY: u32 = 5;
/// Number of neighbours to which the normals of a cloud are fitted.
const NEIGHBOURS: usize = 16;

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

    /// Searches for the body in the cloud by rigid alignment, first with the recently seen part and then with all of it, and moves the model there.
    pub(super) fn find_again(&mut self) -> Result<bool, Halt> {
        for all in [false, true] {
            let Some(pose) = self.aligned(all) else {
                continue;
            };
            self.reconstructor.relocate(&pose);
            if self.watch()? {
                self.tell(Event::Found)?;
                return Ok(true);
            }
            self.reconstructor.relocate(&pose.inverse());
        }
        Ok(false)
    }

    /// Rigid motion of the live model, or of its recently seen part, to the latest cloud.
    pub(super) fn aligned(&self, all: bool) -> Option<Isometry3<f64>> {
        let model = self.reconstructor.model();
        let latest = self.latest.as_ref()?;
        let last = model.last_seen().iter().copied().max()?;
        let lately = |i: &usize| all || model.last_seen()[*i] + LATELY >= last;
        let kept: Vec<usize> = (0..model.len()).filter(lately).collect();
        let points: Vec<Point3<f64>> = kept.iter().map(|&i| model.live()[i]).collect();
        let normals: Vec<UnitVector3<f64>> = kept.iter().map(|&i| model.live_normal(i)).collect();
        let seen_normals =
            nonrigid_reg::estimate_normals(&latest.points, NEIGHBOURS, &latest.eye()).ok()?;
        let cloud = nonrigid_reg::Cloud {
            points: &latest.points,
            normals: &seen_normals,
        };
        let body = nonrigid_reg::Cloud {
            points: &points,
            normals: &normals,
        };
        let found = nonrigid_reg::align_rigid(&body, &cloud).ok()?;
        (found.overlap >= FOUND).then_some(found.target_from_source)
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
