//! The state of the loop between two manipulations, for checkpoints.

use super::guard::Guard;
use super::set_point::SetPoint;
use super::{Event, Explorer, Trouble};
use crate::Error;
use crate::cell::{ArmState, Observation};

/// The state of the loop between two manipulations. With a world in the same state an exploration continues from it, to the bit.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct SavedState {
    manipulations: usize,
    misses: usize,
    troubles: Vec<String>,
    lost: bool,
    bad_frames: usize,
    latest: Option<Observation>,
    arms: Vec<ArmState>,
    closed: Vec<bool>,
    set_points: Vec<Option<SetPoint>>,
    guard: Guard,
    planner: Vec<u8>,
    reconstruction: Vec<u8>,
    moves: super::held::Moves,
    slips: super::slips::Slips,
    best: Option<super::best::Best>,
}

impl Explorer<'_> {
    /// The state of the loop between two manipulations.
    ///
    /// # Errors
    /// [`Error::Resume`]: the reconstruction cannot be saved.
    pub fn save(&self) -> Result<SavedState, Error> {
        let saved = self.reconstructor.save();
        let reconstruction = saved.ok_or_else(|| Error::Resume {
            reason: "this reconstruction cannot be resumed".into(),
        })?;
        Ok(SavedState {
            manipulations: self.manipulations,
            misses: self.misses,
            troubles: self.troubles.iter().map(ToString::to_string).collect(),
            lost: self.lost,
            bad_frames: self.bad_frames,
            latest: self.latest.clone(),
            arms: self.arms.clone(),
            closed: self.closed.clone(),
            set_points: self.drive.last().to_vec(),
            guard: self.guard.clone(),
            planner: self.planner.save(),
            reconstruction,
            moves: self.moves.clone(),
            slips: self.slips.clone(),
            best: self.best.clone(),
        })
    }

    /// Restores the state of another exploration; [`Self::run`] then continues from there. The world must be in the same state as then. Earlier troubles
    /// are listed as [`Trouble::Earlier`].
    ///
    /// # Errors
    /// [`Error::Resume`] or [`Error::Filter`]: the state belongs to another kind of reconstruction, planner or cell.
    pub fn resume(&mut self, saved: SavedState) -> Result<(), Error> {
        let arms = self.arms.len();
        if saved.arms.len() != arms || saved.closed.len() != arms {
            return Err(Error::Resume {
                reason: format!(
                    "it is for {} arms, but the cell has {arms}",
                    saved.arms.len()
                ),
            });
        }
        self.planner.restore(&saved.planner)?;
        self.reconstructor.restore(&saved.reconstruction)?;
        if !self.drive.restore(saved.set_points) {
            return Err(Error::Resume {
                reason: "its set-points are for other arms".into(),
            });
        }
        self.manipulations = saved.manipulations;
        self.misses = saved.misses;
        let earlier = saved.troubles.into_iter();
        self.troubles = earlier.map(|what| Trouble::Earlier { what }).collect();
        self.lost = saved.lost;
        self.bad_frames = saved.bad_frames;
        self.latest = saved.latest;
        self.arms = saved.arms;
        self.closed = saved.closed;
        self.guard = saved.guard;
        self.moves = saved.moves;
        self.slips = saved.slips;
        self.best = saved.best;
        Ok(())
    }

    /// Gives the state to a watcher that wants it.
    pub(super) fn tell_state(&mut self) -> Result<(), Error> {
        if self.watcher.wants_state() {
            let saved = self.save()?;
            self.tell(Event::State(&saved))?;
        }
        Ok(())
    }
}
