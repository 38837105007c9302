//! Follows a run: progress on the terminal, the session file, the measures, the report, and the checkpoints.

use crate::closing::mm;
use crate::final_mesh::FinalMesh;
use crate::live::Live;
use crate::output::{OutputFolder, command_line};
use crate::pace::Pace;
use crate::saved::{CHECKPOINT, Saved, SoFar};
use crate::without::names;
use crate::words;
use crate::{Failure, Grips, RunArgs};
use dvrk_io::session::SessionWriter;
use explore_loop::Error;
use explore_loop::canonical::CanonicalModel;
use explore_loop::canonical::topology::Topology;
use explore_loop::cell::sim::{Journal, SimCell, Truth};
use explore_loop::cell::{Cell, CellInfo, Observation};
use explore_loop::checkpoint;
use explore_loop::explore::{Event, FrameFault, Outcome, SavedState, Watcher};
use explore_loop::measure::{Measurer, TrueSurface};
use explore_loop::report::frames;
use explore_loop::report::html::About;
use explore_loop::report::metrics::{Cut, Metrics, Timing, UnseenPlace};
use mesh_io::program::warn;
use signal_hook::consts::{SIGINT, SIGTERM};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// The settings of a simulated cell, and its ground truth.
pub(crate) struct Simulated {
    pub journal: Journal,
    pub truth: Truth,
}

/// A flag that the first Ctrl-C sets; the second one ends the program at once.
pub(crate) fn interruption() -> Result<Arc<AtomicBool>, Failure> {
    let interrupted = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        signal_hook::flag::register_conditional_shutdown(signal, 1, Arc::clone(&interrupted))?;
        signal_hook::flag::register(signal, Arc::clone(&interrupted))?;
    }
    Ok(interrupted)
}

/// Watches a run: progress on the terminal, the session file, the measures.
pub(crate) struct Recorder<'a> {
    args: &'a RunArgs,
    out: &'a OutputFolder,
    session: Option<dvrk_io::session::SessionWriter>,
    subject: String,
    arm_names: Vec<String>,
    /// What only a simulated cell has: its settings and the truth.
    simulated: Option<Simulated>,
    pub measurer: Option<Measurer>,
    bar: indicatif::ProgressBar,
    live: Live,
    doing: String,
    pace: Pace,
    started: Instant,
    interrupted: Arc<AtomicBool>,
    pub so_far: SoFar,
}

impl<'a> Recorder<'a> {
    pub fn new(
        args: &'a RunArgs,
        out: &'a OutputFolder,
        subject: &str,
        info: &CellInfo,
        simulated: Option<Simulated>,
        interrupted: Arc<AtomicBool>,
    ) -> Result<Self, Failure> {
        let results = &args.results;
        let spacing = args.aim.spacing * 1e-3;
        let live = Live::open(&results.live, out, args.resume, subject, info, spacing)?;
        // A resumed run keeps the old recording until the new one has caught up with it.
        let mut session = SessionWriter::create(out.file(if args.resume {
            "session.mcap.part"
        } else {
            "session.mcap"
        }))?;
        session.table(0.0, &info.table.normal, info.table.offset)?;
        let bar = if results.quiet {
            indicatif::ProgressBar::hidden()
        } else {
            indicatif::ProgressBar::no_length()
        };
        bar.set_style(indicatif::ProgressStyle::with_template(
            "{spinner} {elapsed} {msg}",
        )?);
        Ok(Self {
            args,
            out,
            session: Some(session),
            subject: subject.to_owned(),
            arm_names: info.arms.iter().map(|a| a.name.clone()).collect(),
            simulated,
            measurer: None,
            bar,
            live,
            doing: String::new(),
            pace: Pace::default(),
            started: Instant::now(),
            interrupted,
            so_far: SoFar::default(),
        })
    }

    /// Restores the cell, the recording and the measures from a checkpoint, and returns the state of the explorer.
    pub fn resume(
        &mut self,
        saved: Saved,
        cell: &mut SimCell,
    ) -> Result<Option<SavedState>, Failure> {
        self.bar.set_message("catching up");
        cell.repeat(&saved.commands, |observation| {
            self.bar.tick();
            self.stop_if_asked()?;
            self.record(&observation)
        })?;
        self.so_far = saved.recorder;
        self.begin(cell.info());
        if let Some(gathered) = self.so_far.measurer.take()
            && let Some(rest) = self.surface_at_rest()
        {
            let mut measurer = Measurer::new(rest)?;
            measurer.restore(gathered)?;
            self.measurer = Some(measurer);
        }
        if self.args.resume {
            let (from, to) = ("session.mcap.part", self.out.file("session.mcap"));
            std::fs::rename(self.out.file(from), &to)
                .map_err(|error| Error::Write { path: to, error })?;
        }
        self.save(saved.explorer.as_ref())?;
        Ok(saved.explorer)
    }

    /// Writes the title of the report.
    pub fn begin(&mut self, info: &CellInfo) {
        self.so_far.report.goes_on(
            About {
                subject: self.subject.clone(),
                command: command_line(),
                version: env!("CARGO_PKG_VERSION").into(),
                spacing: self.args.aim.spacing * 1e-3,
                ..About::default()
            }
            .with_cell(info),
        );
    }

    /// Writes the checkpoint.
    fn save(&self, explorer: Option<&SavedState>) -> Result<(), Error> {
        let run = match self.simulated {
            Some(_) => Saved::new(self.args).map_or_else(|_| String::new(), |s| s.run),
            // A robot cannot be restored to an earlier state: no simulated run may be resumed from its checkpoint.
            None => "a robot, which cannot be resumed".to_owned(),
        };
        let saved = Saved {
            run,
            commands: self
                .simulated
                .as_ref()
                .map_or_else(Vec::new, |simulated| simulated.journal.commands()),
            explorer: explorer.cloned(),
            recorder: SoFar {
                measurer: self.measurer.as_ref().map(Measurer::save),
                wall: self.wall(),
                ..self.so_far.clone()
            },
        };
        checkpoint::write(&self.out.file(CHECKPOINT), &saved)
    }

    fn wall(&self) -> f64 {
        self.so_far.wall + self.started.elapsed().as_secs_f64()
    }

    fn stop_if_asked(&self) -> Result<(), Error> {
        if self.interrupted.load(Ordering::Relaxed) {
            return Err(Error::Interrupted);
        }
        Ok(())
    }

    /// Prints a line of progress: above the bar on a terminal, plainly elsewhere.
    fn say(&self, line: &str) {
        if self.bar.is_hidden() {
            self.args.results.output().note(line);
        } else {
            self.bar.println(line);
        }
    }

    /// The true surface at present; `None` where there is no truth.
    fn true_surface(&self) -> Option<TrueSurface> {
        let truth = &self.simulated.as_ref()?.truth;
        Some(surface(truth, truth.live()))
    }

    fn surface_at_rest(&self) -> Option<TrueSurface> {
        let truth = &self.simulated.as_ref()?.truth;
        Some(surface(truth, truth.rest().vertices))
    }

    /// Compares the model with the truth.
    fn measure(
        &mut self,
        observation: &Observation,
        measured: &[bool],
        model: &CanonicalModel,
    ) -> Result<Vec<f64>, Error> {
        let Some(now) = self.true_surface() else {
            return Ok(Vec::new());
        };
        if self.measurer.is_none() {
            self.measurer = self.surface_at_rest().map(Measurer::new).transpose()?;
        }
        let held = observation.arms.iter().any(|arm| arm.holding);
        match &mut self.measurer {
            Some(measurer) => Ok(measurer.frame(model, measured, held, &now)?),
            None => Ok(Vec::new()),
        }
    }

    fn record(&mut self, observation: &Observation) -> Result<(), Error> {
        let Some(session) = &mut self.session else {
            return Ok(());
        };
        let stamp = observation.stamp;
        if let Some(camera) = &observation.camera {
            session.camera(stamp, camera)?;
        }
        let measured = observation.measured();
        match measured.colours() {
            Some(colours) => session.coloured_points(stamp, &measured.points, colours)?,
            None => session.points(stamp, &measured.points)?,
        }
        if let Some(features) = &measured.features {
            session.features(stamp, features)?;
        }
        for (name, arm) in self.arm_names.iter().zip(&observation.arms) {
            session.pose(observation.stamp, name, &arm.camera_from_tip)?;
            session.jaw(observation.stamp, name, arm.jaw)?;
        }
        if let Some(simulated) = &self.simulated {
            session.truth(observation.stamp, &simulated.truth.live())?;
        }
        Ok(())
    }

    fn topology(&mut self, topology: &Topology, model: &CanonicalModel) -> Result<(), Error> {
        let spacing = self.args.aim.spacing * 1e-3;
        let shape = self.measurer.as_ref().map(|m| m.shape(model, spacing));
        if let Some(shape) = &shape {
            self.live.explored(shape.explored);
        }
        self.so_far.shapes.push(shape.unwrap_or_default());
        self.so_far.betti.push(topology.persistent);
        self.say(&format!(
            "{:5.1} s  {}: explored {}, Betti {:?} (persistent {:?}), boundary {:.1} %, missing {:.1} %, bare {:.2} %, strays {:.1} %, {} vertices, difference {}, {} frames not registered",
            self.so_far.last_stamp,
            self.so_far.manipulated(),
            shape.map_or_else(
                || "unknown".into(),
                |s| format!("{:.1} %", 100.0 * s.explored)
            ),
            topology.betti,
            topology.persistent,
            100.0 * topology.boundary_share(),
            100.0 * topology.missing,
            100.0 * topology.bare,
            100.0 * topology.strays,
            model.len(),
            shape.map_or_else(|| "unknown".into(), |s| mm(s.difference)),
            self.so_far.failures,
        ));
        let mesh = FinalMesh::of(model, topology, spacing);
        self.shown(topology, model, &mesh);
        if self.args.pictures {
            let k = self.so_far.shapes.len() - 1;
            self.out.surface_picture(&format!("rest_{k}.png"), &mesh)?;
            self.out
                .live_picture(&format!("live_{k}.png"), model, spacing)?;
        }
        Ok(())
    }

    /// Adds the state before a decision, and at the end, to the report.
    pub fn shown(&mut self, topology: &Topology, model: &CanonicalModel, mesh: &FinalMesh) {
        let measurer = self.measurer.as_ref();
        let truth = mesh.against(measurer, model, self.args.aim.spacing * 1e-3);
        let mesh = mesh.page(measurer.map(Measurer::surface));
        let report = &mut self.so_far.report;
        report.decision(topology, model, &mesh, &truth);
    }

    /// Writes an event to the terminal and to the report.
    fn note(&mut self, text: String) {
        self.say(&format!("{:5.1} s  {text}", self.so_far.last_stamp));
        self.so_far.report.note(text);
    }

    /// Reports a fault of a frame, unless it is the one before that goes on.
    fn fault(&mut self, fault: &FrameFault) {
        if !self.so_far.goes_on(fault) {
            self.note(fault.to_string());
        }
    }

    /// Closes the session file; what was recorded stays readable even after an error.
    pub fn finish(mut self) -> Result<Self, Failure> {
        self.bar.finish_and_clear();
        for remark in self.live.finish() {
            warn(&remark);
        }
        if let Some(session) = self.session.take() {
            session.finish()?;
        }
        Ok(self)
    }

    /// The metrics of a run that ended with an error.
    pub fn failure(&self, args: &RunArgs, error: &Error) -> Metrics {
        Metrics {
            scene: self.subject.clone(),
            arms: self.arm_names.len(),
            seed: args.seed,
            spacing_m: args.aim.spacing * 1e-3,
            stop: "error".into(),
            reason: Some(error.to_string()),
            frames: self.so_far.frames.len(),
            vertices: self.so_far.model.len(),
            robot_time_s: self.so_far.last_stamp,
            ..Metrics::default()
        }
    }

    pub fn metrics(
        &self,
        args: &RunArgs,
        outcome: &Outcome,
        mesh: &FinalMesh,
    ) -> Result<Metrics, Failure> {
        let spacing = args.aim.spacing * 1e-3;
        let measurer = self.measurer.as_ref();
        let shape = measurer.map(|m| m.shape(&self.so_far.model, spacing));
        let measures = mesh.measure(
            self.so_far.model.rest(),
            spacing,
            measurer.map(Measurer::surface),
        )?;
        let metrics = Metrics {
            scene: self.subject.clone(),
            arms: self.arm_names.len(),
            grips: match args.grips {
                Grips::Planned => "planned",
                Grips::Random => "random",
            }
            .into(),
            seed: args.seed,
            speed_m_s: Some(args.speed * 1e-3),
            fastest_grip_m_s: self.so_far.grip_speed.fastest(),
            spacing_m: spacing,
            manipulations: outcome.manipulations,
            model_of: Some(outcome.model_of),
            stop: outcome.stop.word().into(),
            reason: outcome.stop.reason(),
            troubles: outcome.troubles.iter().map(ToString::to_string).collect(),
            without: names(&args.without),
            betti: outcome.topology.persistent,
            betti_before: self.so_far.betti.clone(),
            contacts: outcome.topology.contacts(),
            unseen: outcome
                .topology
                .unseen
                .iter()
                .map(UnseenPlace::from)
                .collect(),
            nm_cut: Cut::of(outcome.topology.cut),
            nm_remaining: outcome.topology.non_manifold,
            thinned: outcome.topology.thinned,
            frames: self.so_far.frames.len(),
            failed_frames: self.so_far.failures,
            constraints: self.so_far.constraints,
            registration_ms: Timing::of(&self.so_far.registration),
            frame_ms: Timing::of(&self.so_far.frames),
            vertices: self.so_far.model.len(),
            stiffness_over_weight: outcome.stiffness_over_weight,
            robot_time_s: self.so_far.last_stamp,
            wall_s: self.wall(),
            ..Metrics::default()
        };
        Ok(metrics
            .with_shape(&self.so_far.shapes, shape.as_ref())
            .with_mesh(&measures)
            .with_tracking(&measurer.map(Measurer::tracking).unwrap_or_default()))
    }
}

impl Watcher for Recorder<'_> {
    fn event(&mut self, event: Event<'_>, model: &CanonicalModel) -> Result<(), Error> {
        self.stop_if_asked()?;
        for remark in self.live.show(event, model) {
            self.bar.suspend(|| warn(&remark));
        }
        match event {
            Event::Phase(phase) => {
                self.bar.set_message(phase.to_string());
                self.pace.phase(phase, self.so_far.last_stamp);
                self.doing = phase.to_string();
                self.so_far.report.phase(phase);
            }
            Event::Observed(observation) => self.record(observation)?,
            Event::Frame(observation, report) => {
                self.so_far.last_stamp = observation.stamp;
                self.so_far.registration.push(report.registration_ms);
                self.so_far.frames.push(report.frame_ms);
                self.so_far.failures += usize::from(report.failure.is_some());
                self.so_far.constraints.add(&report.constraints);
                self.so_far.grip_speed.add(observation);
                let errors = self.measure(observation, &report.measured, model)?;
                self.so_far.lines.push_str(&frames::line(
                    observation.stamp,
                    report,
                    model,
                    &errors,
                ));
                self.so_far
                    .report
                    .frame(observation, report, model, &errors);
                if let Some(left) = self.pace.left(observation.stamp) {
                    let doing = &self.doing;
                    self.bar
                        .set_message(format!("{doing}, {left:.0} s of this motion left"));
                }
                self.bar.tick();
            }
            Event::Topology(topology) => {
                self.topology(topology, model)?;
                self.so_far.model = model.clone();
            }
            Event::Missed(arm) => self.note(format!("arm {arm} closed, but holds nothing")),
            Event::Planned(plan) => {
                let what = words::of_plan(plan);
                self.pace.planned(plan);
                self.say(&format!("        {what}"));
                self.so_far.report.planned(what, plan, model);
            }
            Event::Fault(fault) => self.fault(fault),
            Event::Trouble(trouble) => self.note(format!("arms stopped: {trouble}")),
            Event::Found => self.note("the body was found again".into()),
            Event::Restored(manipulations, _) => {
                self.so_far.model = model.clone();
                self.note(format!(
                    "the model is that after {manipulations} manipulations: later ones have spoiled it"
                ));
            }
            Event::Manipulated(count) => self.so_far.manipulations = count,
            Event::State(state) => self.save(Some(state))?,
            _ => {}
        }
        Ok(())
    }

    fn wants_state(&self) -> bool {
        true
    }

    fn wants_uncertainty(&self) -> bool {
        self.live.wants_uncertainty()
    }
}

fn surface(truth: &Truth, vertices: Vec<explore_loop::nalgebra::Point3<f64>>) -> TrueSurface {
    let triangles = truth.triangles();
    TrueSurface {
        vertices,
        triangles: triangles.iter().map(|t| t.map(|i| i as u32)).collect(),
    }
}
