//! The exploration as a state machine.
//!
//! ```text
//!   Home ─► Look ─► Decide ─┬─► Reach ─► Grasp ─► Manipulate ─► Lower ─► Release ─┐
//!    ▲                      └─► done                                              │
//!    └────────────────────────────────────────────────────────────────────────────┘
//! ```
//! The arms go home so that nothing hides the object; the model is brought up to date; its topology decides
//! whether to stop; otherwise grips and a motion are planned, carried out frame by frame while the reconstruction
//! follows, and let go.

use crate::Error;
use crate::canonical::CanonicalModel;
use crate::canonical::surface::{triangulate, vertex_areas};
use crate::canonical::topology::{self, Topology};
use crate::cell::{Cell, CellError, Observation};
use crate::plan::{ManipulationPlan, PlanInput, PlannedGrip, Planner};
use crate::reconstruct::{FrameReport, Reconstruct, ReconstructOptions, Reconstructor};
use crate::set_down;
use nalgebra::Isometry3;

/// Settings of an exploration.
#[derive(Debug, Clone, PartialEq)]
pub struct ExploreOptions {
    /// Spacing ε of the model, metres.
    pub spacing: f64,
    /// Fastest speed of a grip while it holds, m/s.
    pub speed: f64,
    /// Speed of an empty arm, m/s.
    pub reach_speed: f64,
    /// Manipulations after which the exploration gives up.
    pub max_manipulations: usize,
    /// Frames to look at the object at rest before each decision.
    pub look_frames: usize,
    /// Height above the table at which grips are let go, metres.
    pub set_down: f64,
    /// Frames in a row that may fail to register before the arms are lowered.
    pub patience: usize,
}

impl ExploreOptions {
    /// Defaults at a spacing and a grip speed.
    pub fn new(spacing: f64, speed: f64) -> Self {
        Self {
            spacing,
            speed,
            reach_speed: 0.25,
            max_manipulations: 8,
            look_frames: 6,
            set_down: 0.013,
            patience: 8,
        }
    }
}

/// Where the exploration is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// The arms leave the camera's view.
    Home,
    /// The object at rest is looked at.
    Look,
    /// Topology, then stop or plan.
    Decide,
    /// The arms go to their grips.
    Reach,
    /// The jaws close.
    Grasp,
    /// The object is moved.
    Manipulate,
    /// What was lifted is put down.
    Lower,
    /// The jaws open and withdraw.
    Release,
}

/// Why an exploration ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Stop {
    /// The surface is closed: all of it has been seen.
    Closed,
    /// The manipulations allowed were used up.
    TooManyManipulations,
    /// No grip was possible; the planner's reason.
    NothingToGrip(String),
    /// No jaw held anything in several attempts.
    GraspFailed,
}

impl Stop {
    /// The word in `metrics.json`.
    pub fn word(&self) -> &'static str {
        match self {
            Self::Closed => "closed",
            Self::TooManyManipulations => "too_many_manipulations",
            Self::NothingToGrip(_) => "nothing_to_grip",
            Self::GraspFailed => "grasp_failed",
        }
    }
}

/// What is told to a [`Watcher`] while the exploration runs.
#[derive(Debug, Clone, Copy)]
pub enum Event<'a> {
    /// A phase begins.
    Phase(Phase),
    /// A frame was processed.
    Frame(&'a Observation, &'a FrameReport),
    /// The topology before a decision.
    Topology(&'a Topology),
    /// A manipulation was planned.
    Planned(&'a ManipulationPlan),
    /// An arm found nothing in its jaw.
    Missed(usize),
    /// A manipulation is over; how many there were.
    Manipulated(usize),
    /// All that the loop knows between two manipulations, for [`Explorer::resume`]; told only to a watcher that [wants](Watcher::wants_state) it.
    State(&'a SavedState),
}

/// All that the loop knows between two manipulations. With a world in the same state an exploration goes on from it to the bit.
#[derive(Debug, Clone, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct SavedState {
    manipulations: usize,
    misses: usize,
    latest: Option<Observation>,
    planner: Vec<u8>,
    reconstruction: Vec<u8>,
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
}

/// Watches nothing.
impl Watcher for () {
    fn event(&mut self, _: Event<'_>, _: &CanonicalModel) -> Result<(), Error> {
        Ok(())
    }
}

/// How an exploration ended.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// Why.
    pub stop: Stop,
    /// Manipulations made.
    pub manipulations: usize,
    /// Topology at the end.
    pub topology: Topology,
    /// Stiffness over weight `E / (ρ g)` of the object as it was estimated from how it sags, m, once something was lifted.
    pub stiffness_over_weight: Option<f64>,
}

/// Explores the object in a cell.
pub struct Explorer<'a> {
    cell: &'a mut dyn Cell,
    planner: &'a mut dyn Planner,
    watcher: &'a mut dyn Watcher,
    options: ExploreOptions,
    reconstructor: Box<dyn Reconstruct + 'a>,
    latest: Option<Observation>,
    manipulations: usize,
    misses: usize,
}

enum State {
    Home,
    Look,
    Decide,
    Reach(ManipulationPlan),
    Grasp(ManipulationPlan),
    Manipulate(ManipulationPlan),
    Lower(ManipulationPlan),
    Release(ManipulationPlan),
    Done(Box<Outcome>),
}

/// Most frames to wait for the object to rest.
const SETTLE: usize = 25;
/// Attempts to grasp in a row before giving up.
const MISSES: usize = 4;

impl<'a> Explorer<'a> {
    /// An exploration of what lies in `cell`, with the default reconstruction.
    ///
    /// # Errors
    /// A spacing that is not a length.
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

    /// The same with a reconstruction of the caller's: a [`Reconstructor`] with other settings, or another [`Reconstruct`].
    pub fn with_reconstructor(
        cell: &'a mut dyn Cell,
        planner: &'a mut dyn Planner,
        watcher: &'a mut dyn Watcher,
        options: ExploreOptions,
        reconstructor: impl Reconstruct + 'a,
    ) -> Self {
        Self {
            cell,
            planner,
            watcher,
            options,
            reconstructor: Box::new(reconstructor),
            latest: None,
            manipulations: 0,
            misses: 0,
        }
    }

    /// The model so far.
    pub fn model(&self) -> &CanonicalModel {
        self.reconstructor.model()
    }

    /// All that the loop knows, between two manipulations.
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
            latest: self.latest.clone(),
            planner: self.planner.save(),
            reconstruction,
        })
    }

    /// Takes over what another exploration knew; [`Self::run`] then goes on from there. The world has to be as it was then.
    ///
    /// # Errors
    /// [`Error::Resume`] or [`Error::Filter`]: the state is not of such a reconstruction or planner.
    pub fn resume(&mut self, saved: SavedState) -> Result<(), Error> {
        self.planner.restore(&saved.planner)?;
        self.reconstructor.restore(&saved.reconstruction)?;
        self.manipulations = saved.manipulations;
        self.misses = saved.misses;
        self.latest = saved.latest;
        Ok(())
    }

    /// Explores until the surface is closed or nothing more can be done.
    ///
    /// # Errors
    /// The cell fails, a stage refuses its input, or the watcher cannot record.
    pub fn run(&mut self) -> Result<Outcome, Error> {
        let mut state = State::Home;
        loop {
            state = match state {
                State::Home => self.home()?,
                State::Look => self.look()?,
                State::Decide => self.decide()?,
                State::Reach(plan) => self.reach(plan)?,
                State::Grasp(plan) => self.grasp(plan)?,
                State::Manipulate(plan) => self.manipulate(plan)?,
                State::Lower(plan) => self.lower(plan)?,
                State::Release(plan) => self.release(&plan)?,
                State::Done(outcome) => return Ok(*outcome),
            };
        }
    }

    fn home(&mut self) -> Result<State, Error> {
        self.enter(Phase::Home)?;
        if self.latest.is_none() {
            self.cell.home()?;
            return Ok(State::Look);
        }
        // Watched all the way, so that the model follows whatever the leaving arms stir.
        let info = self.cell.info();
        let up = nalgebra::Translation3::from(info.table.normal.into_inner() * 0.05);
        let now = self.latest.as_ref().map_or(&[][..], |o| &o.arms);
        let above: Vec<_> = now
            .iter()
            .enumerate()
            .map(|(arm, state)| (arm, up * state.camera_from_tip))
            .collect();
        let homes: Vec<_> = info
            .arms
            .iter()
            .enumerate()
            .map(|(arm, a)| (arm, a.camera_from_home))
            .collect();
        self.travel(&above, self.options.reach_speed)?;
        self.travel(&homes, self.options.reach_speed)?;
        Ok(State::Look)
    }

    fn look(&mut self) -> Result<State, Error> {
        self.enter(Phase::Look)?;
        for _ in 0..self.options.look_frames.max(1) {
            self.frame()?;
        }
        let points = self.latest.as_ref().map_or(0, |o| o.points.len());
        if self.reconstructor.model().is_empty() {
            return Err(Error::NothingToSee { points, needed: 20 });
        }
        Ok(State::Decide)
    }

    fn decide(&mut self) -> Result<State, Error> {
        self.enter(Phase::Decide)?;
        let table = self.cell.info().table;
        self.reconstructor.consolidate(&table);
        let topology = topology::analyse(self.reconstructor.model(), self.options.spacing)?;
        self.tell(Event::Topology(&topology))?;
        if topology.is_closed() {
            return Ok(self.done(Stop::Closed, topology));
        }
        if self.manipulations >= self.options.max_manipulations {
            return Ok(self.done(Stop::TooManyManipulations, topology));
        }
        if self.misses >= MISSES {
            return Ok(self.done(Stop::GraspFailed, topology));
        }
        match self.plan(&topology)? {
            Ok(mut plan) => {
                for grip in &mut plan.grips {
                    grip.at_rest = self.reconstructor.model().rest[grip.vertex as usize];
                }
                self.tell(Event::Planned(&plan))?;
                Ok(State::Reach(plan))
            }
            Err(reason) => Ok(self.done(Stop::NothingToGrip(reason), topology)),
        }
    }

    fn plan(&mut self, topology: &Topology) -> Result<Result<ManipulationPlan, String>, Error> {
        let model = self.reconstructor.model();
        let visible = match &self.latest {
            Some(observation) => self
                .reconstructor
                .visible_now(observation, self.options.spacing),
            None => vec![false; model.len()],
        };
        let triangles = triangulate(&model.rest, &model.rest_normals, self.options.spacing);
        let input = PlanInput {
            points: &model.live,
            normals: &model.live_normals(),
            areas: &vertex_areas(&model.live, &triangles),
            edges: &model.edges,
            topology,
            visible: &visible,
            cell: self.cell.info(),
            speed: self.options.speed,
            attempt: self.manipulations + self.misses,
        };
        self.planner.plan(&input)
    }

    /// Orientation first, high above the grip, then down along the approach.
    fn reach(&mut self, plan: ManipulationPlan) -> Result<State, Error> {
        self.enter(Phase::Reach)?;
        let speed = self.options.reach_speed;
        let approach: Vec<_> = plan
            .grips
            .iter()
            .map(|g| (g.arm, g.camera_from_approach))
            .collect();
        self.travel(&approach, speed)?;
        let grasp: Vec<_> = plan
            .grips
            .iter()
            .map(|g| (g.arm, g.camera_from_tip))
            .collect();
        self.travel(&grasp, 0.4 * speed)?;
        Ok(State::Grasp(plan))
    }

    fn grasp(&mut self, mut plan: ManipulationPlan) -> Result<State, Error> {
        self.enter(Phase::Grasp)?;
        let mut held = Vec::new();
        for grip in plan.grips.clone() {
            match self.cell.close_jaw(grip.arm) {
                Ok(()) => held.push(grip),
                Err(CellError::NothingGrasped { arm }) => self.tell(Event::Missed(arm))?,
                Err(error) => return Err(error.into()),
            }
        }
        self.frame()?;
        // A supporting arm may miss; the arms that lift must all hold.
        let lifting = plan.grips.iter().filter(|g| g.lifts).count();
        if held.iter().filter(|g| g.lifts).count() < lifting {
            self.misses += 1;
            for grip in &held {
                self.cell.open_jaw(grip.arm)?;
            }
            return Ok(State::Home);
        }
        plan.grips = held;
        self.misses = 0;
        Ok(State::Manipulate(plan))
    }

    /// Follows the planned paths; slows down while registration has trouble.
    fn manipulate(&mut self, plan: ManipulationPlan) -> Result<State, Error> {
        self.enter(Phase::Manipulate)?;
        let until = plan.lowering_from;
        self.follow(&plan, 0.0, until)?;
        Ok(State::Lower(plan))
    }

    fn lower(&mut self, plan: ManipulationPlan) -> Result<State, Error> {
        self.enter(Phase::Lower)?;
        self.follow(&plan, plan.lowering_from, plan.motion.duration)?;
        self.set_down(&plan)?;
        Ok(State::Release(plan))
    }

    /// Out and down until the lifting tips are as far from the middle of the body as they were at rest, and just above the
    /// table: what is let go bunched up springs out, what is let go high falls, and both are too fast to follow.
    fn set_down(&mut self, plan: &ManipulationPlan) -> Result<(), Error> {
        let table = self.cell.info().table;
        let Some(latest) = &self.latest else {
            return Ok(());
        };
        let rest = &self.reconstructor.model().rest;
        let goals = set_down::goals(plan, latest, rest, &table, self.options.set_down);
        self.travel(&goals, 0.7 * self.options.speed)
    }

    fn release(&mut self, plan: &ManipulationPlan) -> Result<State, Error> {
        self.enter(Phase::Release)?;
        // Let what still moves come to rest before the grips, the only landmarks, are given up.
        self.settle()?;
        for grip in &plan.grips {
            self.cell.open_jaw(grip.arm)?;
        }
        self.settle()?;
        let retreat: Vec<_> = plan
            .grips
            .iter()
            .map(|g| (g.arm, g.camera_from_retreat))
            .collect();
        self.travel(&retreat, 0.4 * self.options.reach_speed)?;
        self.manipulations += 1;
        self.tell(Event::Manipulated(self.manipulations))?;
        if self.watcher.wants_state() {
            let saved = self.save()?;
            self.tell(Event::State(&saved))?;
        }
        Ok(State::Home)
    }

    /// Follows the paths from one time of the plan to another at the frames' pace.
    fn follow(&mut self, plan: &ManipulationPlan, from: f64, until: f64) -> Result<(), Error> {
        let step = 1.0 / self.cell.info().camera_rate;
        let mut time = from;
        let mut pace = 0.3;
        let mut failures = 0;
        while time < until {
            time = (time + pace * step).min(until);
            for grip in &plan.grips {
                if self.let_go_early(grip, time, step, until)? {
                    continue;
                }
                let Some(goal) = plan.pose(grip.arm, time) else {
                    continue;
                };
                let here = self
                    .latest
                    .as_ref()
                    .map(|o| o.arms[grip.arm].camera_from_tip);
                let distance = here.map_or(0.0, |h| {
                    (goal.translation.vector - h.translation.vector).norm()
                });
                // Fast enough to be there at the next frame, also when the motion is mostly a turn.
                let speed = (distance / step).max(0.2 * self.options.speed);
                self.cell.move_arm(grip.arm, goal, speed)?;
            }
            let report = self.frame()?;
            failures = if report.failure.is_some() {
                failures + 1
            } else {
                0
            };
            pace = next_pace(pace, &report, self.options.spacing);
            if failures > self.options.patience {
                break;
            }
        }
        Ok(())
    }

    /// A supporting arm opens its jaw at its own time and backs off while the others go on; true from then on.
    fn let_go_early(
        &mut self,
        grip: &PlannedGrip,
        time: f64,
        step: f64,
        until: f64,
    ) -> Result<bool, Error> {
        if grip.lifts || time < grip.release {
            return Ok(false);
        }
        if time - step < grip.release && time < until {
            self.cell.open_jaw(grip.arm)?;
            self.cell.move_arm(
                grip.arm,
                grip.camera_from_retreat,
                0.4 * self.options.reach_speed,
            )?;
        }
        Ok(true)
    }

    /// Moves empty arms to poses and waits until they are there.
    fn travel(&mut self, goals: &[(usize, Isometry3<f64>)], speed: f64) -> Result<(), Error> {
        for (arm, pose) in goals {
            self.cell.move_arm(*arm, *pose, speed)?;
        }
        // Ten seconds at most: an arm that cannot arrive must not hold up the others for ever.
        let most = (10.0 * self.cell.info().camera_rate) as usize;
        for _ in 0..most {
            self.frame()?;
            let arrived = self
                .latest
                .as_ref()
                .is_some_and(|o| goals.iter().all(|(arm, _)| !o.arms[*arm].moving));
            if arrived {
                break;
            }
        }
        Ok(())
    }

    /// Watches until the seen surface rests: it moves less than a tenth of a spacing a frame, three frames in a row.
    fn settle(&mut self) -> Result<(), Error> {
        let mut still = 0;
        for _ in 0..SETTLE {
            let before = self.reconstructor.model().live.clone();
            let report = self.frame()?;
            let model = self.reconstructor.model();
            let moved: Vec<f64> = before
                .iter()
                .zip(&model.live)
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

    fn frame(&mut self) -> Result<FrameReport, Error> {
        let observation = self.cell.observe()?;
        let table = self.cell.info().table;
        let report = self.reconstructor.process(&observation, &table)?;
        self.watcher.event(
            Event::Frame(&observation, &report),
            self.reconstructor.model(),
        )?;
        self.latest = Some(observation);
        Ok(report)
    }

    fn enter(&mut self, phase: Phase) -> Result<(), Error> {
        self.tell(Event::Phase(phase))
    }

    fn tell(&mut self, event: Event<'_>) -> Result<(), Error> {
        self.watcher.event(event, self.reconstructor.model())
    }

    fn done(&self, stop: Stop, topology: Topology) -> State {
        State::Done(Box::new(Outcome {
            stop,
            manipulations: self.manipulations,
            topology,
            stiffness_over_weight: self.reconstructor.stiffness_over_weight(),
        }))
    }
}

/// Ramps up to full pace, and down while the residual is high or registration fails.
fn next_pace(pace: f64, report: &FrameReport, spacing: f64) -> f64 {
    if report.failure.is_some() || report.residual > 0.4 * spacing {
        (0.5 * pace).max(0.15)
    } else {
        (pace + 0.1).min(1.0)
    }
}
