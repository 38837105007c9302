//! `explore run`: explores in the simulated cell.

use crate::closing::{measure_rows, table};
use crate::final_mesh::FinalMesh;
use crate::object::ObjectArgs;
use crate::output::OutputFolder;
use crate::recorder::{Recorder, Simulated, interruption};
use crate::saved::Saved;
use crate::without::{Part, planner_without, refuse};
use crate::{Camera, Failure, Features, Grips, RunArgs};
use explore_loop::Error;
use explore_loop::cell::Cell;
use explore_loop::cell::sim::{CameraOptions, SimCell, SimOptions, Sway};
use explore_loop::explore::{Explorer, Outcome, Stop};
use explore_loop::nalgebra::Point3;
use explore_loop::plan::{Planner, RandomPlanner};
use explore_loop::reconstruct::ReconstructOptions;
use explore_loop::report::metrics::{Metrics, Timing};
use mesh_io::program::unless_closed;
use std::process::ExitCode;

/// Pixels of the colour image for each pixel of the depth image, in each direction.
const COLOUR_PIXELS: usize = 2;

/// Explores; the exit code is 0 when the surface closed, 3 when it closed except for a place that could not be shown, else 1.
pub fn run(args: &RunArgs) -> Result<ExitCode, Failure> {
    tell(args, &explore(args)?)
}

/// Prints the measures; the exit code is that of [`run`].
pub fn tell(args: &RunArgs, metrics: &Metrics) -> Result<ExitCode, Failure> {
    let output = args.results.output();
    if !output.quiet {
        table(output, &rows(metrics))?;
    }
    unless_closed(output.object(metrics))?;
    Ok(match metrics.stop.as_str() {
        "closed" => ExitCode::SUCCESS,
        "closed_but_attached" | "closed_but_touching" => ExitCode::from(3),
        _ => ExitCode::from(1),
    })
}

/// Explores, writes the results, and returns the measures.
pub fn explore(args: &RunArgs) -> Result<Metrics, Failure> {
    if args.grips == Grips::Random {
        refuse(
            &args.without,
            Part::is_of_planner,
            "random grips do not have",
        )?;
    }
    let options = simulation(args)?;
    let out = OutputFolder::create(&args.results.out)?;
    let (mut cell, truth) = SimCell::new(&options)?;
    let mut planner: Box<dyn Planner> = match args.grips {
        Grips::Planned => Box::new(planner_without(&args.without)),
        Grips::Random => Box::new(RandomPlanner::new(args.seed)),
    };
    let mut exploring = args.aim.options(args.speed);
    let mut reconstruction = ReconstructOptions::new(exploring.spacing);
    for part in &args.without {
        part.leave_out_of_loop(&mut exploring);
        part.leave_out_of_reconstruction(&mut reconstruction);
    }
    let reconstructor = args.reconstruction.begin(reconstruction, &args.without)?;
    let saved = if args.resume {
        Saved::read(&out, args)?
    } else {
        Saved::new(args)?
    };
    let journal = cell.journal();
    let simulated = Some(Simulated { journal, truth });
    let (name, info) = (options.scene.name(), cell.info());
    let mut recorder = Recorder::new(args, &out, name, info, simulated, interruption()?)?;
    let state = recorder.resume(saved, &mut cell)?;
    let (watcher, planner) = (&mut recorder, &mut *planner);
    let mut explorer =
        Explorer::with_reconstructor(&mut cell, planner, watcher, exploring, reconstructor);
    let resumed = state.map_or(Ok(()), |state| explorer.resume(state));
    let outcome = resumed.and_then(|()| explorer.run());
    drop(explorer);
    let finished = recorder.finish();
    let outcome = match outcome {
        Err(Error::Interrupted) => {
            let recorder = finished?;
            let dir = args.results.out.display();
            return Err(format!(
                "interrupted after {}; continue with --resume --out {dir}",
                recorder.so_far.manipulated()
            )
            .into());
        }
        // The first error is the one to report, not that the recording or the metrics could not be written after it.
        Err(error) => {
            if let Ok(recorder) = finished {
                let metrics = recorder.failure(args, &error);
                let _unwritten = out.metrics(&metrics);
                let _unwritten = out.report(&recorder.so_far.report, &metrics, rows(&metrics));
            }
            return Err(error.into());
        }
        Ok(outcome) => outcome,
    };
    write(args, &out, finished?, &outcome)
}

/// Period of a swinging camera, seconds.
const SWAY_PERIOD: f64 = 12.0;

/// The simulated cell that the command line describes.
fn simulation(args: &RunArgs) -> Result<SimOptions, Failure> {
    scene(&args.object, args.arms, args.camera, args.noise, args.seed).map(|mut options| {
        options.arm_model = args.arm_model.into();
        options.camera.features = (args.features == Features::On).then_some(COLOUR_PIXELS);
        options.camera.sway = args.sway.map(|degrees| Sway {
            angle: degrees.to_radians(),
            period: SWAY_PERIOD,
        });
        options.seed_point = args.aim.seed_point.map(Point3::from);
        options
    })
}

/// The cell of an object, a number of arms and a camera with a noise in mm.
pub fn scene(
    object: &ObjectArgs,
    arms: u8,
    camera: Camera,
    noise: f64,
    seed: u64,
) -> Result<SimOptions, Failure> {
    let mut options = SimOptions::new(object.read()?);
    options.arms = usize::from(arms);
    options.seed = seed;
    if camera == Camera::Realsense {
        options.camera = CameraOptions::realsense();
    }
    options.camera.noise = noise * 1e-3;
    Ok(options)
}

/// Writes the results of a run that ended without an error.
pub fn write(
    args: &RunArgs,
    out: &OutputFolder,
    mut recorder: Recorder<'_>,
    outcome: &Outcome,
) -> Result<Metrics, Failure> {
    let mesh = FinalMesh::of(
        &recorder.so_far.model,
        &outcome.topology,
        args.aim.spacing * 1e-3,
    );
    out.frames(&recorder.so_far.lines)?;
    out.mesh(&mesh, &args.results.export)?;
    if let Some(measurer) = &recorder.measurer {
        out.truth(measurer.rest())?;
    }
    let metrics = recorder.metrics(args, outcome, &mesh)?;
    out.metrics(&metrics)?;
    if matches!(outcome.stop, Stop::Trouble(_)) {
        // The run may have ended between two decisions: the report shows the final state, too.
        recorder.shown(&outcome.topology, &recorder.so_far.model.clone(), &mesh);
    }
    out.report(&recorder.so_far.report, &metrics, rows(&metrics))?;
    Ok(metrics)
}

/// The closing table.
pub fn rows(metrics: &Metrics) -> Vec<(&'static str, String)> {
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
    rows
}
