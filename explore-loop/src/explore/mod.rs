//! The exploration as a state machine.
//!
//! ```text
//!   Home ─► Look ─► Decide ─┬─► Reach ─► Grasp ─► Manipulate ─► Lower ─► Release ─┐
//!    ▲                      └─► done                                              │
//!    ├────────────────────────────────────────────────────────────────────────────┘
//!    └── trouble, in any phase: stop ─► lower from here ─► open
//! ```
//! The arms go home so that nothing hides the object; the model is updated; its topology decides whether to stop; otherwise a [`Plan`]
//! is made and executed frame by frame while the object is tracked: its checked path to the grips, its motion as fast as
//! [`grip_planner::SpeedGovernor`] allows, and a checked path home.
//!
//! | file | question |
//! |---|---|
//! | `options` | what may the loop do, and which failures does it tolerate? |
//! | `decide` | is it closed, and if not, which plan is next? |
//! | `manipulate` | how is a plan carried out? |
//! | `drive` | how is a motion followed, and what is planned from the present poses? |
//! | `set_point` | which pose is next, and is it within the limits? |
//! | `held` | is the hidden part attached to the table? |
//! | `best` | which model is returned if a lost body has spoiled it? |
//! | `slips` | where have grips slipped? |
//! | `guard` | what is wrong with a frame? |
//! | `watch` | how is a frame processed, and who is notified? |
//! | `trouble` | what ends a manipulation, and what ends the exploration? |
//! | `recover` | how does the loop recover? |
//! | `resume` | what is saved between two manipulations? |
//! | `set_down` | where do lifting tips release the body? |
//!
//! # What happens to the arms and the jaws
//!
//! | end of a manipulation | the arms | the jaws |
//! |---|---|---|
//! | success | set down, retreat, home | open on the table |
//! | the body is lost, a grip slips, the camera fails, [`Explorer::interrupt`] | stop in the frame in which it is noticed, lower from their present poses (back along the lift, or on along the lowering; else straight down), home | open when lowered |
//! | an error or a panic in a stage, a planner or a watcher | the same, without calling the stages | open when lowered |
//! | an arm that refuses commands, does not arrive, or does not report its pose; no free path down | stop | are not moved |
//! | the cell fails | asked to stop | are not moved |

use crate::Error;
use crate::canonical::CanonicalModel;
use crate::canonical::topology::Topology;
use crate::cell::{ArmState, Cell, Observation};
use crate::plan::Planner;
use crate::reconstruct::{Reconstruct, ReconstructOptions, Reconstructor};
use grip_planner::{Motion, Plan};
use guard::Guard;
use nalgebra::Point3;
use set_point::Drive;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use watch::refused;

mod best;
mod decide;
mod drive;
mod guard;
mod held;
mod manipulate;
mod options;
mod recover;
mod resume;
mod set_down;
mod set_point;
mod slips;
mod trouble;
mod watch;

pub use guard::FrameFault;
pub use held::Held;
pub use options::{ClosedBy, ExploreOptions};
pub use resume::SavedState;
pub use set_point::{Bounds, Limits};
pub use trouble::{Stop, Trouble};
pub use watch::{Event, Watcher};

/// The phase of an exploration.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum Phase {
    /// The arms leave the camera's view.
    Home,
    /// The resting object is observed.
    Look,
    /// The topology is computed, then the loop stops or plans.
    Decide,
    /// The arms move to their grips.
    Reach,
    /// The jaws close.
    Grasp,
    /// The object is moved.
    Manipulate,
    /// The lifted object is put down.
    Lower,
    /// The jaws open and retreat.
    Release,
}

impl std::fmt::Display for Phase {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Home => "arms go home",
            Self::Look => "looking",
            Self::Decide => "topology and plan",
            Self::Reach => "reaching for the grips",
            Self::Grasp => "closing the jaws",
            Self::Manipulate => "lifting and turning",
            Self::Lower => "lowering",
            Self::Release => "letting go",
        })
    }
}

/// How an exploration ended.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Outcome {
    /// The reason.
    pub stop: Stop,
    /// Number of manipulations.
    pub manipulations: usize,
    /// Manipulations that were given up, in order.
    pub troubles: Vec<Trouble>,
    /// Topology of the model at the end.
    pub topology: Topology,
    /// Number of manipulations after which the model was as it is returned: fewer than [`Self::manipulations`] if the later ones have spoiled it.
    pub model_of: usize,
    /// Stiffness over weight `E / (ρ g)` of the object, m, estimated from its sag once something was lifted.
    pub stiffness_over_weight: Option<f64>,
}

/// Explores the object in a cell.
pub struct Explorer<'a> {
    cell: &'a mut dyn Cell,
    planner: &'a mut dyn Planner,
    watcher: &'a mut dyn Watcher,
    options: ExploreOptions,
    reconstructor: Box<dyn Reconstruct + 'a>,
    guard: Guard,
    drive: Drive,
    /// The present or last known states of the arms.
    arms: Vec<ArmState>,
    /// The jaws that were closed on something.
    closed: Vec<bool>,
    /// The motion that is followed with closed jaws, and the time on it, seconds.
    under_way: Option<(Motion, f64)>,
    /// The last usable frame.
    latest: Option<Observation>,
    /// Number of consecutive frames for which the arms had to be stopped.
    bad_frames: usize,
    /// Whether the body may be elsewhere than the model.
    lost: bool,
    manipulations: usize,
    misses: usize,
    troubles: Vec<Trouble>,
    /// How far the surface was moved.
    moves: held::Moves,
    /// Where grips slipped.
    slips: slips::Slips,
    /// The model when most of the surface was known, before a body was lost.
    best: Option<best::Best>,
    asked_to_stop: Option<Arc<AtomicBool>>,
    mode: Mode,
}

impl std::fmt::Debug for Explorer<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Explorer")
            .field("options", &self.options)
            .field("manipulations", &self.manipulations)
            .field("misses", &self.misses)
            .field("troubles", &self.troubles)
            .finish_non_exhaustive()
    }
}

/// How frames are used.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Mode {
    /// For everything.
    Exploring,
    /// The body is being put down and this must not be interrupted.
    PuttingDown,
    /// The same after a stage has failed: frames serve only to check the arms.
    ArmsOnly,
}

/// A plan, and the rest positions of its grips: vertices are renumbered by a re-fusion.
struct Manipulation {
    plan: Plan,
    at_rest: Vec<Point3<f64>>,
}

enum State {
    Home,
    Look,
    Decide,
    Reach(Box<Manipulation>),
    Grasp(Box<Manipulation>),
    Manipulate(Box<Manipulation>),
    Lower(Box<Manipulation>),
    Release(Box<Manipulation>),
    Done(Box<Outcome>),
}

/// Why a state ends early.
enum Halt {
    Trouble(Box<Trouble>),
    Error(Error),
}

impl From<Trouble> for Halt {
    fn from(trouble: Trouble) -> Self {
        Self::Trouble(Box::new(trouble))
    }
}

impl<E: Into<Error>> From<E> for Halt {
    fn from(error: E) -> Self {
        Self::Error(error.into())
    }
}

type Followed = Result<(), Halt>;

impl<'a> Explorer<'a> {
    /// An exploration of the object in `cell`, with the default reconstruction.
    ///
    /// # Errors
    /// A spacing that is not positive and finite.
    pub fn new(
        cell: &'a mut dyn Cell,
        planner: &'a mut dyn Planner,
        watcher: &'a mut dyn Watcher,
        options: ExploreOptions,
    ) -> Result<Self, Error> {
        let reconstructor = Reconstructor::new(ReconstructOptions::new(options.spacing))?;
        Ok(Self::with_reconstructor(
            cell,
            planner,
            watcher,
            options,
            reconstructor,
        ))
    }

    /// The same with another reconstruction: a [`Reconstructor`] with other settings, or another [`Reconstruct`].
    pub fn with_reconstructor(
        cell: &'a mut dyn Cell,
        planner: &'a mut dyn Planner,
        watcher: &'a mut dyn Watcher,
        options: ExploreOptions,
        reconstructor: impl Reconstruct + 'a,
    ) -> Self {
        let info = cell.info();
        let home = |arm: &crate::cell::ArmInfo| ArmState {
            camera_from_tip: arm.camera_from_home,
            jaw: 0.0,
            holding: false,
            moving: false,
        };
        Self {
            guard: Guard::new(options.spacing),
            drive: Drive::new(options.limits, info),
            arms: info.arms.iter().map(home).collect(),
            closed: vec![false; info.arms.len()],
            cell,
            planner,
            watcher,
            options,
            reconstructor: Box::new(reconstructor),
            latest: None,
            under_way: None,
            bad_frames: 0,
            lost: false,
            manipulations: 0,
            misses: 0,
            troubles: Vec::new(),
            moves: held::Moves::default(),
            slips: slips::Slips::default(),
            best: None,
            asked_to_stop: None,
            mode: Mode::Exploring,
        }
    }

    /// Sets a flag, set from a signal handler or another thread, that ends the exploration: arms are stopped, what they hold is lowered, and they go
    /// home.
    #[must_use]
    pub fn interrupt(mut self, flag: Arc<AtomicBool>) -> Self {
        self.asked_to_stop = Some(flag);
        self
    }

    /// The model so far.
    pub fn model(&self) -> &CanonicalModel {
        self.reconstructor.model()
    }

    /// Explores until the surface is closed or no further progress is possible.
    ///
    /// Failures of the cell are recovered from, or end the exploration with the reason in [`Outcome::stop`]. In any case the arms are stopped; for the
    /// jaws see [`crate::explore`].
    ///
    /// # Errors
    /// The object was never seen, a stage rejects its input, or the watcher cannot record.
    ///
    /// # Panics
    /// When a stage, planner or watcher panics: the panic is resumed after the arms have been secured.
    pub fn run(&mut self) -> Result<Outcome, Error> {
        let ended = catch_unwind(AssertUnwindSafe(|| self.explore()));
        let well = matches!(&ended, Ok(Ok(_)));
        // A second failure must not keep the arms from being stopped.
        let secured = catch_unwind(AssertUnwindSafe(|| self.secure(well)));
        let _nothing_left_to_do = secured;
        match ended {
            Ok(outcome) => outcome,
            Err(panic) => resume_unwind(panic),
        }
    }

    fn explore(&mut self) -> Result<Outcome, Error> {
        let mut state = State::Home;
        loop {
            state = match self.next(state) {
                Ok(State::Done(outcome)) => return Ok(*outcome),
                Ok(next) => next,
                Err(Halt::Error(error)) => self.failed(error)?,
                Err(Halt::Trouble(trouble)) => match self.recover(*trouble) {
                    Ok(next) => next,
                    Err(Halt::Error(error)) => self.failed(error)?,
                    Err(Halt::Trouble(trouble)) => self.done(Stop::Trouble(*trouble))?,
                },
            };
        }
    }

    fn next(&mut self, state: State) -> Result<State, Halt> {
        match state {
            State::Home => self.home(),
            State::Look => self.look(),
            State::Decide => self.decide(),
            State::Reach(manipulation) => self.reach(manipulation),
            State::Grasp(manipulation) => self.grasp(manipulation),
            State::Manipulate(manipulation) => self.manipulate(manipulation),
            State::Lower(manipulation) => self.lower(manipulation),
            State::Release(manipulation) => self.release(&manipulation),
            State::Done(outcome) => Ok(State::Done(outcome)),
        }
    }

    fn home(&mut self) -> Result<State, Halt> {
        self.enter(Phase::Home)?;
        if self.latest.is_none() {
            self.cell.home().map_err(refused)?;
            self.guard.pause();
        } else {
            // Frames are processed on the way, so that the model follows an object moved by the leaving arms.
            self.go_home_from_here()?;
        }
        Ok(State::Look)
    }

    fn look(&mut self) -> Result<State, Halt> {
        self.enter(Phase::Look)?;
        let fits = self.watch()?;
        let points = self.latest.as_ref().map_or(0, |o| o.points.len());
        if self.reconstructor.model().is_empty() {
            return Err(Error::NothingToSee { points, needed: 20 }.into());
        }
        if !fits && !self.find_again()? && self.lost {
            let frames = self.options.look_frames;
            return Ok(self.done(Stop::Trouble(Trouble::Lost { frames }))?);
        }
        self.lost = false;
        Ok(State::Decide)
    }

    /// Observes the resting object; returns whether the last frame fitted.
    fn watch(&mut self) -> Result<bool, Halt> {
        let (mut seen, mut fits) = (0, false);
        while seen < self.options.look_frames.max(1) {
            if let Some(report) = self.frame()? {
                seen += 1;
                fits = report.failure.is_none();
            }
        }
        Ok(fits)
    }
}
