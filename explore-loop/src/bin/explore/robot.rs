//! `explore robot`: explores with the arms and the camera of a dVRK.

use crate::output::OutputFolder;
use crate::recorder::{Recorder, interruption};
use crate::run::{rows, tell, write};
use crate::{AimArgs, Failure, ResultArgs, RunArgs};
use dvrk_io::transport::{Participant, Transport};
use explore_loop::Error;
use explore_loop::cell::Cell;
use explore_loop::cell::dvrk::{CellFile, Preflight};
use explore_loop::explore::{Explorer, Outcome};
use explore_loop::nalgebra::Point3;
use explore_loop::plan::CoveragePlanner;
use mesh_io::program::{unless_closed, warn};
use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::Ordering;

#[derive(Debug, clap::Args)]
#[command(after_help = "Example: explore robot CELL.toml --dry-run")]
pub(crate) struct RobotArgs {
    /// The cell file: arms, camera, calibration, limits (TOML; `explore serve --write-cell` writes one)
    cell: PathBuf,
    /// Run the checks, print them, and command nothing
    #[arg(long)]
    dry_run: bool,
    /// Largest speed of the grips, mm/s
    #[arg(long, value_name = "MM_S", default_value_t = 20.0, value_parser = crate::positive)]
    speed: f64,
    #[command(flatten)]
    aim: AimArgs,
    /// Also write a picture of the model after every manipulation
    #[arg(long)]
    pictures: bool,
    #[command(flatten)]
    results: ResultArgs,
}

impl RobotArgs {
    /// The options of a run, as in the simulated cell.
    fn run(&self) -> RunArgs {
        RunArgs {
            speed: self.speed,
            aim: self.aim.clone(),
            pictures: self.pictures,
            results: self.results.clone(),
            ..RunArgs::default()
        }
    }
}

/// Runs the checks, then explores; the exit code is 0 when the surface closed, 3 when it closed except for a place that could not be shown, else 1.
pub(crate) fn robot(args: &RobotArgs) -> Result<ExitCode, Failure> {
    let file = CellFile::load(&args.cell)?;
    let stop = interruption()?;
    let participant = Participant::join(&file.network()?)?;
    let node = || -> Arc<dyn Transport> { Arc::new(participant.clone()) };
    let preflight = Preflight::run(&file, &node, args.aim.seed_point.map(Point3::from));
    list(args, &preflight)?;
    if args.dry_run || !preflight.is_ok() {
        return Ok(if preflight.is_ok() {
            ExitCode::SUCCESS
        } else {
            ExitCode::from(1)
        });
    }
    let run = args.run();
    let out = OutputFolder::create(&run.results.out)?;
    let mut cell = preflight.start()?.stop_flag(Arc::clone(&stop));
    let name = args.cell.file_stem().unwrap_or_default().to_string_lossy();
    let mut recorder = Recorder::new(&run, &out, &name, cell.info(), None, Arc::clone(&stop))?;
    recorder.begin(cell.info());
    let mut planner = CoveragePlanner::default();
    let mut options = run.aim.options(run.speed);
    options.limits.empty.speed = options.limits.empty.speed.min(file.limits.speed.get());
    let outcome = Explorer::new(&mut cell, &mut planner, &mut recorder, options)?.run();
    // From here on the arms hold their positions.
    drop(cell);
    finish(&run, &out, recorder, outcome, stop.load(Ordering::Relaxed))
}

/// Prints the checks; with `--quiet` only if one of them failed.
fn list(args: &RobotArgs, preflight: &Preflight) -> Result<(), Failure> {
    let mut words = args.results.output().words();
    for check in preflight.checks() {
        if check.found.is_err() {
            warn(&check.to_string());
        } else if !args.results.quiet {
            unless_closed(writeln!(words, "{check}"))?;
        }
    }
    Ok(())
}

fn finish(
    run: &RunArgs,
    out: &OutputFolder,
    recorder: Recorder<'_>,
    outcome: Result<Outcome, Error>,
    stopped: bool,
) -> Result<ExitCode, Failure> {
    let finished = recorder.finish();
    let outcome = match outcome {
        Ok(outcome) => outcome,
        Err(error) => {
            if let Ok(recorder) = finished {
                let metrics = recorder.failure(run, &error);
                let _unwritten = out.metrics(&metrics);
                let _unwritten = out.report(&recorder.so_far.report, &metrics, rows(&metrics));
            }
            return Err(if stopped {
                "stopped: the arms hold their positions, the jaws stay as they are".into()
            } else {
                error.into()
            });
        }
    };
    let metrics = write(run, out, finished?, &outcome)?;
    tell(run, &metrics)
}
