//! What planning the grips is worth: manipulations until the surface closes, planned grips against random ones, in the simulated cell.
//!
//! ```text
//! cargo run --release -p explore-loop --example compare_grips -- [--seeds 6] [--scenes liver,ellipsoid] [--arms 2,3] [--cap 8] [--csv FILE]
//! ```
//!
//! Every scene is explored with every number of arms from every seed (0, 1, …) twice: with the grips of `CoveragePlanner` and with those of `RandomPlanner`, which
//! draws feasible grips on the boundary and moves them with the same motion planner; everything else is the same. A run that does not
//! close within the cap counts as the cap (it would have taken more), and is marked; so does one that ends otherwise: nothing to grip, or the object pulled
//! apart. A run takes half a minute to a few minutes.

use std::fmt::Write as _;
use std::io::{self, Write};
use std::path::PathBuf;
use std::process::ExitCode;

use explore_loop::Error;
use explore_loop::canonical::CanonicalModel;
use explore_loop::cell::sim::{Scene, SimCell, SimOptions, Truth};
use explore_loop::explore::{Event, ExploreOptions, Explorer, Stop, Watcher};
use explore_loop::measure::{Measurer, TrueSurface};
use explore_loop::plan::{CoveragePlanner, Planner, RandomPlanner};
use mesh_io::program::{self, Failure, Output};
use serde_json::json;

/// Spacing of the model, metres, and grip speed, m/s: those of `explore run`.
const SPACING: f64 = 0.005;
const SPEED: f64 = 0.03;
/// Depth noise of the camera, metres: that of `explore run` too.
const NOISE: f64 = 5e-4;

/// Compares planned grips with random ones: manipulations until the surface closes
#[derive(Debug, clap::Parser)]
#[command(
    name = "compare_grips",
    after_help = "Example: compare_grips --seeds 3 --scenes liver --arms 2,3 --csv runs.csv"
)]
struct Arguments {
    /// Seeds 0 to N - 1
    #[arg(long, value_name = "N", default_value_t = 6)]
    seeds: u64,
    /// Built-in scenes
    #[arg(
        long,
        value_name = "NAMES",
        value_delimiter = ',',
        default_value = "liver,ellipsoid"
    )]
    scenes: Vec<String>,
    /// Numbers of arms
    #[arg(long, value_name = "2,3", value_delimiter = ',', default_value = "2,3", value_parser = clap::value_parser!(u8).range(2..=3))]
    arms: Vec<u8>,
    /// Most manipulations of a run
    #[arg(long, value_name = "N", default_value_t = 8)]
    cap: usize,
    /// Table of all runs, written after each
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    #[command(flatten)]
    output: Output,
}

fn main() -> ExitCode {
    program::run(compare)
}

#[derive(Clone, Copy, PartialEq)]
enum Grips {
    Planned,
    Random,
}

impl Grips {
    fn word(self) -> &'static str {
        match self {
            Self::Planned => "planned",
            Self::Random => "random",
        }
    }
}

/// How a run ended.
struct Run {
    scene: String,
    arms: u8,
    grips: Grips,
    seed: u64,
    /// Share of the true surface before the first and after every manipulation.
    explored: Vec<f64>,
    manipulations: usize,
    stop: String,
}

impl Run {
    /// What it counts as: the cap unless it closed.
    fn counted(&self, cap: usize) -> f64 {
        if self.closed() {
            self.manipulations
        } else {
            cap
        }
        .max(1) as f64
    }

    /// A row of the table of all runs.
    fn line(&self) -> String {
        let percent = |share: &f64| format!("{:.1}", 100.0 * share);
        let shares: Vec<String> = self.explored.iter().map(percent).collect();
        format!(
            "{},{},{},{},{},{},{}",
            self.scene,
            self.arms,
            self.grips.word(),
            self.seed,
            self.manipulations,
            self.stop,
            shares.join(" ")
        )
    }

    fn object(&self) -> serde_json::Value {
        json!({
            "scene": self.scene,
            "arms": self.arms,
            "grips": self.grips.word(),
            "seed": self.seed,
            "manipulations": self.manipulations,
            "stop": self.stop,
            "explored": self.explored,
        })
    }

    fn closed(&self) -> bool {
        self.stop == Stop::Closed.word()
    }

    /// Mean gain of explored share a manipulation.
    fn gain(&self) -> Option<f64> {
        let (first, last) = (self.explored.first()?, self.explored.last()?);
        (self.manipulations > 0).then(|| (last - first) / self.manipulations as f64)
    }
}

fn compare(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let mut runs = Vec::new();
    let mut csv = String::from("scene,arms,grips,seed,manipulations,stop,explored\n");
    // A name that is wrong is known before the first hour.
    for scene in &arguments.scenes {
        Scene::named(scene)?;
    }
    let count = 2 * arguments.seeds * (arguments.scenes.len() * arguments.arms.len()) as u64;
    let bar = arguments.output.progress(count, "runs");
    for scene in &arguments.scenes {
        for &arms in &arguments.arms {
            for seed in 0..arguments.seeds {
                for grips in [Grips::Planned, Grips::Random] {
                    let run = explore(scene, arms, seed, grips, arguments.cap)?;
                    let line = run.line();
                    bar.suspend(|| arguments.output.note(&line));
                    bar.inc(1);
                    writeln!(csv, "{line}")?;
                    // Written after every run: a long table is not lost with its last line.
                    if let Some(path) = &arguments.csv {
                        std::fs::write(path, &csv)
                            .map_err(|error| format!("{}: {error}", path.display()))?;
                    }
                    runs.push(run);
                }
            }
        }
    }
    bar.finish_and_clear();
    table(arguments, &runs, &mut arguments.output.words())?;
    let runs: Vec<_> = runs.iter().map(Run::object).collect();
    arguments
        .output
        .object(&json!({ "cap": arguments.cap, "runs": runs }))?;
    Ok(ExitCode::SUCCESS)
}

fn explore(scene: &str, arms: u8, seed: u64, grips: Grips, cap: usize) -> Result<Run, Failure> {
    let mut options = SimOptions::new(Scene::named(scene)?);
    options.arms = usize::from(arms);
    options.seed = seed;
    options.camera.noise = NOISE;
    let (mut cell, truth) = SimCell::new(&options)?;
    let mut planner: Box<dyn Planner> = match grips {
        Grips::Planned => Box::new(CoveragePlanner::default()),
        Grips::Random => Box::new(RandomPlanner::new(seed)),
    };
    let mut exploring = ExploreOptions::new(SPACING, SPEED);
    exploring.max_manipulations = cap;
    let mut watcher = Explored {
        rest: surface(&truth),
        truth,
        measurer: None,
        shares: Vec::new(),
    };
    let outcome = Explorer::new(&mut cell, &mut *planner, &mut watcher, exploring)?.run();
    let (manipulations, stop) = match outcome {
        Ok(outcome) => (outcome.manipulations, outcome.stop.word().to_owned()),
        // An object pulled apart is an outcome of its grips, not of the comparison.
        Err(error) => (watcher.shares.len().saturating_sub(1), error.to_string()),
    };
    Ok(Run {
        scene: scene.to_owned(),
        arms,
        grips,
        seed,
        explored: watcher.shares,
        manipulations,
        stop,
    })
}

/// Measures the explored share at every look.
struct Explored {
    truth: Truth,
    rest: TrueSurface,
    measurer: Option<Measurer>,
    shares: Vec<f64>,
}

fn surface(truth: &Truth) -> TrueSurface {
    TrueSurface {
        vertices: truth.rest().vertices,
        triangles: truth
            .triangles()
            .iter()
            .map(|t| t.map(|i| i as u32))
            .collect(),
    }
}

impl Watcher for Explored {
    fn event(&mut self, event: Event<'_>, model: &CanonicalModel) -> Result<(), Error> {
        match event {
            Event::Frame(..) => {
                if self.measurer.is_none() {
                    self.measurer = Some(Measurer::new(self.rest.clone())?);
                }
                let live = TrueSurface {
                    vertices: self.truth.live(),
                    triangles: self.rest.triangles.clone(),
                };
                if let Some(measurer) = &mut self.measurer {
                    measurer.anchor(model, &live)?;
                }
            }
            Event::Topology(_) => {
                let share = self
                    .measurer
                    .as_ref()
                    .map(|m| m.shape(model, SPACING).explored_2eps);
                self.shares.push(share.unwrap_or(0.0));
            }
            _ => {}
        }
        Ok(())
    }
}

fn table(arguments: &Arguments, runs: &[Run], out: &mut dyn Write) -> io::Result<()> {
    let cap = arguments.cap;
    writeln!(
        out,
        "| scene | arms | grips | runs | closed | manipulations (mean) | gain a manipulation | planned / random |"
    )?;
    writeln!(out, "|---|---|---|---|---|---|---|---|")?;
    for scene in &arguments.scenes {
        for &arms in &arguments.arms {
            let of = |grips: Grips| -> Vec<&Run> {
                let fits = |r: &&Run| r.scene == *scene && r.arms == arms && r.grips == grips;
                runs.iter().filter(fits).collect()
            };
            let mean_of = |grips| mean(of(grips).iter().map(|r| r.counted(cap)));
            let ratio = mean_of(Grips::Planned) / mean_of(Grips::Random);
            for grips in [Grips::Planned, Grips::Random] {
                let runs = of(grips);
                let closed = runs.iter().filter(|r| r.closed()).count();
                let gain = mean(runs.iter().filter_map(|r| r.gain()));
                writeln!(
                    out,
                    "| {scene} | {arms} | {} | {} | {closed} | {:.2}{} | {:.1} % | {} |",
                    grips.word(),
                    runs.len(),
                    mean_of(grips),
                    if closed < runs.len() {
                        " (at least)"
                    } else {
                        ""
                    },
                    100.0 * gain,
                    if grips == Grips::Planned {
                        format!("{ratio:.2}")
                    } else {
                        String::new()
                    }
                )?;
            }
        }
    }
    writeln!(
        out,
        "\nA run that did not close within {cap} manipulations counts as {cap}; seeds 0 to {}.",
        arguments.seeds.saturating_sub(1)
    )?;
    for run in runs.iter().filter(|r| !r.closed()) {
        writeln!(
            out,
            "not closed: {} arms {} {} seed {}: {}",
            run.scene,
            run.arms,
            run.grips.word(),
            run.seed,
            run.stop
        )?;
    }
    Ok(())
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0), |(s, n), v| (s + v, n + 1));
    if count == 0 {
        f64::NAN
    } else {
        sum / f64::from(count)
    }
}
