//! `explore run`: an exploration in the simulated cell.

use crate::output::{FinalMesh, OutputFolder, measure_rows, mm, table};
use crate::{Failure, Grips, RunArgs};
use explore_loop::Error;
use explore_loop::canonical::CanonicalModel;
use explore_loop::canonical::topology::Topology;
use explore_loop::cell::sim::{Scene, SimCell, SimOptions, Truth};
use explore_loop::cell::{Cell, Observation};
use explore_loop::explore::{Event, ExploreOptions, Explorer, Outcome, Phase, Watcher};
use explore_loop::measure::{Measurer, ShapeMeasures, TrueSurface};
use explore_loop::plan::{CoveragePlanner, Planner, RandomPlanner};
use explore_loop::report::frames;
use explore_loop::report::metrics::{Cut, Metrics, Timing};
use grip_planner::Plan;
use std::time::Instant;

/// Explores; true when the surface closed.
pub fn run(args: &RunArgs) -> Result<bool, Failure> {
    let metrics = explore(args)?;
    if !args.quiet {
        print(&metrics)?;
    }
    Ok(metrics.stop == "closed")
}

/// Explores, writes the results, and returns what was measured.
pub fn explore(args: &RunArgs) -> Result<Metrics, Failure> {
    let scene = match &args.mesh {
        Some(path) => {
            Scene::from_file(path).map_err(|error| format!("{}: {error}", path.display()))?
        }
        None => Scene::named(&args.scene)?,
    };
    let out = OutputFolder::create(&args.out)?;
    let started = Instant::now();
    let mut options = SimOptions::new(scene);
    options.arms = usize::from(args.arms);
    options.seed = args.seed;
    options.camera.noise = args.noise * 1e-3;
    let (mut cell, truth) = SimCell::new(&options)?;
    let mut planner: Box<dyn Planner> = match args.grips {
        Grips::Planned => Box::new(CoveragePlanner::default()),
        Grips::Random => Box::new(RandomPlanner::new(args.seed)),
    };
    let mut exploring = ExploreOptions::new(args.spacing * 1e-3, args.speed * 1e-3);
    exploring.max_manipulations = args.max_manipulations;
    let mut recorder = Recorder::new(args, &out, &cell, truth)?;
    let outcome = Explorer::new(&mut cell, &mut *planner, &mut recorder, exploring)?.run();
    let recorder = recorder.finish()?;
    let outcome = match outcome {
        Ok(outcome) => outcome,
        Err(error) => {
            out.metrics(&recorder.failure(args, &options, &error))?;
            return Err(error.into());
        }
    };
    let mesh = FinalMesh::of(&recorder.model, &outcome.topology, args.spacing * 1e-3);
    out.frames(&recorder.lines)?;
    out.mesh(&mesh)?;
    if let Some(measurer) = &recorder.measurer {
        out.truth(measurer.rest())?;
    }
    let metrics = recorder.metrics(args, &options, &outcome, &mesh, started)?;
    out.metrics(&metrics)?;
    Ok(metrics)
}

/// Watches a run: progress on the terminal, the session file, the measures.
struct Recorder<'a> {
    args: &'a RunArgs,
    out: &'a OutputFolder,
    session: Option<dvrk_io::session::SessionWriter>,
    arm_names: Vec<String>,
    truth: Truth,
    measurer: Option<Measurer>,
    bar: indicatif::ProgressBar,
    registration: Vec<f64>,
    frames: Vec<f64>,
    failures: usize,
    shapes: Vec<ShapeMeasures>,
    last_stamp: f64,
    lines: String,
    model: CanonicalModel,
}

impl<'a> Recorder<'a> {
    fn new(
        args: &'a RunArgs,
        out: &'a OutputFolder,
        cell: &SimCell,
        truth: Truth,
    ) -> Result<Self, Failure> {
        let info = cell.info();
        let mut session = dvrk_io::session::SessionWriter::create(out.file("session.mcap"))?;
        session.table(0.0, &info.table.normal, info.table.offset)?;
        let bar = if args.quiet {
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
            arm_names: info.arms.iter().map(|a| a.name.clone()).collect(),
            truth,
            measurer: None,
            bar,
            registration: Vec::new(),
            frames: Vec::new(),
            failures: 0,
            shapes: Vec::new(),
            last_stamp: 0.0,
            lines: String::new(),
            model: CanonicalModel::default(),
        })
    }

    /// A line of progress: above the bar on a terminal, plainly where there is none.
    fn say(&self, line: &str) {
        if self.args.quiet {
            return;
        }
        if self.bar.is_hidden() {
            eprintln!("{line}");
        } else {
            self.bar.println(line);
        }
    }

    fn true_surface(&self, vertices: Vec<explore_loop::nalgebra::Point3<f64>>) -> TrueSurface {
        let triangles = self
            .truth
            .triangles()
            .iter()
            .map(|t| t.map(|i| i as u32))
            .collect();
        TrueSurface {
            vertices,
            triangles,
        }
    }

    /// Compares with the truth, which only this recorder holds.
    fn measure(
        &mut self,
        observation: &Observation,
        measured: &[bool],
        model: &CanonicalModel,
    ) -> Result<Vec<f64>, Error> {
        if self.measurer.is_none() {
            self.measurer = Some(Measurer::new(
                self.true_surface(self.truth.rest().vertices),
            )?);
        }
        let now = self.true_surface(self.truth.live());
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
        session.points(observation.stamp, &observation.points)?;
        for (name, arm) in self.arm_names.iter().zip(&observation.arms) {
            session.pose(observation.stamp, name, &arm.camera_from_tip)?;
            session.jaw(observation.stamp, name, arm.jaw)?;
        }
        session.truth(observation.stamp, &self.truth.live())?;
        Ok(())
    }

    fn topology(&mut self, topology: &Topology, model: &CanonicalModel) -> Result<(), Error> {
        let spacing = self.args.spacing * 1e-3;
        let shape = self.measurer.as_ref().map(|m| m.shape(model, spacing));
        self.shapes.push(shape.unwrap_or_default());
        self.say(&format!(
            "{:5.1} s  {} manipulations: explored {:.1} %, Betti {:?} (persistent {:?}), boundary {:.1} %, missing {:.1} %, bare {:.2} %, strays {:.1} %, {} vertices, difference {}, {} frames not registered",
            self.last_stamp,
            self.shapes.len() - 1,
            100.0 * shape.unwrap_or_default().explored,
            topology.betti,
            topology.persistent,
            100.0 * topology.boundary_share(),
            100.0 * topology.missing,
            100.0 * topology.bare,
            100.0 * topology.strays,
            model.len(),
            shape.map_or_else(|| "unknown".into(), |s| mm(s.difference)),
            self.failures,
        ));
        if self.args.pictures {
            let k = self.shapes.len() - 1;
            let mesh = FinalMesh::of(model, topology, spacing);
            self.out.surface_picture(&format!("rest_{k}.png"), &mesh)?;
            self.out
                .live_picture(&format!("live_{k}.png"), model, spacing)?;
        }
        Ok(())
    }

    /// Closes the session file; what was recorded stays readable whatever happened before.
    fn finish(mut self) -> Result<Self, Failure> {
        self.bar.finish_and_clear();
        if let Some(session) = self.session.take() {
            session.finish()?;
        }
        Ok(self)
    }

    /// What can be said of a run that an error has ended.
    fn failure(&self, args: &RunArgs, options: &SimOptions, error: &Error) -> Metrics {
        Metrics {
            scene: options.scene.name().to_owned(),
            arms: options.arms,
            seed: args.seed,
            spacing_m: args.spacing * 1e-3,
            stop: "error".into(),
            reason: Some(error.to_string()),
            frames: self.frames.len(),
            vertices: self.model.len(),
            robot_time_s: self.last_stamp,
            ..Metrics::default()
        }
    }

    fn metrics(
        &self,
        args: &RunArgs,
        options: &SimOptions,
        outcome: &Outcome,
        mesh: &FinalMesh,
        started: Instant,
    ) -> Result<Metrics, Failure> {
        let spacing = args.spacing * 1e-3;
        let measurer = self.measurer.as_ref();
        let shape = measurer.map(|m| m.shape(&self.model, spacing));
        let measures = mesh.measure(&self.model.rest, spacing, measurer.map(Measurer::surface))?;
        let metrics = Metrics {
            scene: options.scene.name().to_owned(),
            arms: options.arms,
            grips: match args.grips {
                Grips::Planned => "planned",
                Grips::Random => "random",
            }
            .into(),
            seed: args.seed,
            speed_m_s: Some(args.speed * 1e-3),
            spacing_m: spacing,
            manipulations: outcome.manipulations,
            stop: outcome.stop.word().into(),
            reason: outcome.stop.reason(),
            troubles: outcome.troubles.iter().map(ToString::to_string).collect(),
            betti: outcome.topology.persistent,
            nm_cut: Cut::of(outcome.topology.cut),
            nm_remaining: outcome.topology.non_manifold,
            frames: self.frames.len(),
            registration_ms: Timing::of(&self.registration),
            frame_ms: Timing::of(&self.frames),
            vertices: self.model.len(),
            stiffness_over_weight: outcome.stiffness_over_weight,
            robot_time_s: self.last_stamp,
            wall_s: started.elapsed().as_secs_f64(),
            ..Metrics::default()
        };
        Ok(metrics
            .with_shape(&self.shapes, shape.as_ref())
            .with_mesh(&measures)
            .with_tracking(&measurer.map(Measurer::tracking).unwrap_or_default()))
    }
}

impl Watcher for Recorder<'_> {
    fn event(&mut self, event: Event<'_>, model: &CanonicalModel) -> Result<(), Error> {
        match event {
            Event::Phase(phase) => self.bar.set_message(phase_words(phase)),
            Event::Frame(observation, report) => {
                self.last_stamp = observation.stamp;
                self.registration.push(report.registration_ms);
                self.frames.push(report.frame_ms);
                self.failures += usize::from(report.failure.is_some());
                self.record(observation)?;
                let errors = self.measure(observation, &report.measured, model)?;
                self.lines
                    .push_str(&frames::line(observation.stamp, report, model, &errors));
                self.bar.tick();
            }
            Event::Topology(topology) => {
                self.topology(topology, model)?;
                self.model = model.clone();
            }
            Event::Missed(arm) => self.say(&format!("arm {arm} closed on nothing")),
            Event::Planned(plan) => self.say(&format!("        {}", words(plan))),
            Event::Fault(fault) => self.say(&format!("{:5.1} s  {fault}", self.last_stamp)),
            Event::Trouble(trouble) => self.say(&format!(
                "{:5.1} s  {trouble}: the arms are stopped",
                self.last_stamp
            )),
            Event::Found => self.say("        the body was found again"),
            _ => {}
        }
        Ok(())
    }
}

/// A plan in a line.
fn words(plan: &Plan) -> String {
    let arms: Vec<String> = plan
        .grips
        .iter()
        .map(|g| format!("arm {} at vertex {}", g.arm, g.vertex))
        .collect();
    let action = match (plan.turn.is_some(), plan.across.is_some()) {
        (true, true) => "turn over and stretch",
        (false, _) => "stretch",
        (true, false) => "turn over",
    };
    format!(
        "{action}: {}; coverage {:.2}, score {:.2}, at most {:.0} mm/s, {:.1} s",
        arms.join(", "),
        plan.coverage,
        plan.score,
        1e3 * plan.speed_limit,
        plan.motion.duration
    )
}

fn phase_words(phase: Phase) -> &'static str {
    match phase {
        Phase::Home => "arms go home",
        Phase::Look => "looking",
        Phase::Decide => "topology and plan",
        Phase::Reach => "reaching for the grips",
        Phase::Grasp => "closing the jaws",
        Phase::Manipulate => "lifting and turning",
        Phase::Lower => "lowering",
        Phase::Release => "letting go",
    }
}

fn print(metrics: &Metrics) -> Result<(), Failure> {
    let timing = |t: &Timing| format!("{:.1} ms median, {:.1} ms p95", t.median, t.p95);
    let mut rows = vec![
        (
            "stop",
            match &metrics.reason {
                Some(reason) => format!("{}: {reason}", metrics.stop),
                None => metrics.stop.clone(),
            },
        ),
        ("Betti numbers", format!("{:?}", metrics.betti)),
        ("manipulations", metrics.manipulations.to_string()),
    ];
    rows.extend(measure_rows(metrics));
    rows.extend([
        ("frames", metrics.frames.to_string()),
        ("registration", timing(&metrics.registration_ms)),
        ("frame time", timing(&metrics.frame_ms)),
        ("robot time", format!("{:.1} s", metrics.robot_time_s)),
        ("wall time", format!("{:.1} s", metrics.wall_s)),
    ]);
    table(&rows)
}
