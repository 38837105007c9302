//! `explore run`: an exploration in the simulated cell.

use crate::output::{OutputFolder, mm, table};
use crate::{Failure, Grips, RunArgs};
use explore_loop::Error;
use explore_loop::canonical::CanonicalModel;
use explore_loop::canonical::topology::Topology;
use explore_loop::cell::Cell;
use explore_loop::cell::sim::{Scene, SimCell, SimOptions, Truth};
use explore_loop::explore::{Event, ExploreOptions, Explorer, Outcome, Phase, Watcher};
use explore_loop::measure::{Measurer, TrueSurface};
use explore_loop::plan::{CoveragePlanner, Planner, RandomPlanner};
use explore_loop::report::frames;
use explore_loop::report::metrics::{Cut, Metrics, Timing};
use std::time::Instant;

/// Explores; true when the surface closed.
pub fn run(args: &RunArgs) -> Result<bool, Failure> {
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
    let outcome = outcome?;
    let metrics = recorder.metrics(args, &options, &outcome, started);
    out.frames(&recorder.lines)?;
    out.metrics(&metrics)?;
    out.model(&recorder.model, args.spacing * 1e-3)?;
    print(&metrics)?;
    Ok(metrics.stop == "closed")
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
    explored: Vec<f64>,
    prediction: Vec<f64>,
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
        let bar = indicatif::ProgressBar::no_length();
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
            explored: Vec::new(),
            prediction: Vec::new(),
            last_stamp: 0.0,
            lines: String::new(),
            model: CanonicalModel::default(),
        })
    }

    /// A line of progress: above the bar on a terminal, plainly where there is none.
    fn say(&self, line: &str) {
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
    fn measure(&mut self, measured: &[bool], model: &CanonicalModel) -> Result<Vec<f64>, Error> {
        if self.measurer.is_none() {
            self.measurer = Some(Measurer::new(
                self.true_surface(self.truth.rest().vertices),
            )?);
        }
        let now = self.true_surface(self.truth.live());
        if let Some(measurer) = &mut self.measurer {
            measurer.anchor(model, &now)?;
            self.prediction
                .extend(measurer.prediction_error(model, measured, &now));
            return Ok(measurer.live_errors(model, &now));
        }
        Ok(Vec::new())
    }

    fn record(&mut self, observation: &explore_loop::cell::Observation) -> Result<(), Error> {
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
        let explored = shape.map_or(0.0, |s| s.explored);
        self.explored.push(explored);
        self.say(&format!(
            "{:5.1} s  {} manipulations: explored {:.1} %, Betti {:?} (persistent {:?}), boundary {:.1} %, missing {:.1} %, {} vertices, difference {}, {} frames not registered",
            self.last_stamp,
            self.explored.len() - 1,
            100.0 * explored,
            topology.betti,
            topology.persistent,
            100.0 * topology.boundary_share(),
            100.0 * topology.missing,
            model.len(),
            shape.map_or_else(|| "unknown".into(), |s| mm(s.difference)),
            self.failures,
        ));
        if self.args.pictures {
            let k = self.explored.len() - 1;
            self.out.picture(&format!("rest_{k}.png"), model, spacing)?;
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

    fn metrics(
        &self,
        args: &RunArgs,
        options: &SimOptions,
        outcome: &Outcome,
        started: Instant,
    ) -> Metrics {
        let shape = self
            .measurer
            .as_ref()
            .map(|m| m.shape(&self.model, args.spacing * 1e-3));
        let mean = |v: &[f64]| (!v.is_empty()).then(|| v.iter().sum::<f64>() / v.len() as f64);
        Metrics {
            scene: options.scene.name().to_owned(),
            arms: options.arms,
            grips: match args.grips {
                Grips::Planned => "planned",
                Grips::Random => "random",
            }
            .into(),
            seed: args.seed,
            speed_m_s: Some(args.speed * 1e-3),
            spacing_m: args.spacing * 1e-3,
            manipulations: outcome.manipulations,
            stop: outcome.stop.word().into(),
            betti: outcome.topology.persistent,
            explored: Some(self.explored.clone()),
            shape_difference_m: shape.map(|s| s.difference),
            shape_difference_rel: shape.map(|s| s.relative),
            prediction_error_m: mean(&self.prediction),
            nm_cut: Cut::of(outcome.topology.cut),
            nm_remaining: outcome.topology.non_manifold,
            frames: self.frames.len(),
            registration_ms: Timing::of(&self.registration),
            frame_ms: Timing::of(&self.frames),
            vertices: self.model.len(),
            robot_time_s: self.last_stamp,
            wall_s: started.elapsed().as_secs_f64(),
        }
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
                let errors = self.measure(&report.measured, model)?;
                self.lines
                    .push_str(&frames::line(observation.stamp, report, model, &errors));
                self.bar.tick();
            }
            Event::Topology(topology) => {
                self.topology(topology, model)?;
                self.model = model.clone();
            }
            Event::Missed(arm) => self.say(&format!("arm {arm} closed on nothing")),
            Event::Planned(plan) => self.say(&format!("        {}", plan.summary)),
            Event::Manipulated(_) => {}
        }
        Ok(())
    }
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
    let percent = |share: &f64| format!("{:.1} %", 100.0 * share);
    let explored: Vec<String> = metrics.explored.iter().flatten().map(percent).collect();
    table(&[
        ("stop", metrics.stop.clone()),
        ("Betti numbers", format!("{:?}", metrics.betti)),
        ("manipulations", metrics.manipulations.to_string()),
        ("explored", explored.join(", ")),
        (
            "shape difference",
            format!(
                "{} ({} of the size)",
                mm(metrics.shape_difference_m.unwrap_or(f64::NAN)),
                percent(&metrics.shape_difference_rel.unwrap_or(f64::NAN))
            ),
        ),
        (
            "prediction error",
            mm(metrics.prediction_error_m.unwrap_or(f64::NAN)),
        ),
        ("frames", metrics.frames.to_string()),
        (
            "registration",
            format!(
                "{:.1} ms median, {:.1} ms p95",
                metrics.registration_ms.median, metrics.registration_ms.p95
            ),
        ),
        (
            "frame time",
            format!(
                "{:.1} ms median, {:.1} ms p95",
                metrics.frame_ms.median, metrics.frame_ms.p95
            ),
        ),
        ("robot time", format!("{:.1} s", metrics.robot_time_s)),
        ("wall time", format!("{:.1} s", metrics.wall_s)),
    ])
}
