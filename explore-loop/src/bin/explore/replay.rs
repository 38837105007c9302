//! `explore replay`: the canonical model from a recording.

use crate::output::{FinalMesh, OutputFolder, command_line, measure_rows, table};
use crate::{Failure, ReplayArgs};
use dvrk_io::session::{SessionReader, Skipped};
use explore_loop::canonical::topology::{self, Topology};
use explore_loop::cell::replay::ReplayCell;
use explore_loop::cell::{Cell, CellError, Observation};
use explore_loop::measure::{Measurer, MeshReport, TrueSurface};
use explore_loop::reconstruct::Reconstruct;
use explore_loop::report::frames;
use explore_loop::report::html::{About, Report};
use explore_loop::report::metrics::{ConstraintMeasures, Cut, Metrics, Timing};
use std::path::Path;
use std::time::Instant;

/// Reconstructs the whole recording; true when it got to its end.
pub fn replay(args: &ReplayArgs) -> Result<bool, Failure> {
    let mut reader = SessionReader::default();
    for (role, topic) in &args.topics {
        reader = reader.with_topic(role.clone(), topic);
    }
    let session = reader
        .frames(&args.session)
        .map_err(|error| with_path(&args.session, &error))?;
    let out = OutputFolder::create(&args.out)?;
    let spacing = args.spacing * 1e-3;
    let started = Instant::now();
    let mut cell = ReplayCell::streamed(session)?;
    let mut truth = Truth::read(&reader, &args.session, args.quiet)?;
    let mut reconstructor = args.reconstruction.begin(spacing)?;
    let bar = if args.quiet {
        indicatif::ProgressBar::hidden()
    } else {
        indicatif::ProgressBar::new(cell.remaining() as u64)
    };
    let mut log = Log::new(args, &cell);
    watch(
        args,
        &out,
        &mut cell,
        &mut *reconstructor,
        &mut truth,
        &bar,
        &mut log,
    )?;
    bar.finish_and_clear();
    if let Some(skipped) = cell.skipped().filter(|s| !s.is_empty() && !args.quiet) {
        complain(skipped);
    }
    reconstructor.consolidate(&cell.info().table);
    let topology = topology::analyse(reconstructor.model(), spacing)?;
    let mesh = match reconstructor.surface() {
        Some(own) => FinalMesh::as_drawn(reconstructor.model(), own, spacing),
        None => FinalMesh::of(reconstructor.model(), &topology, spacing),
    };
    out.frames(&log.lines)?;
    out.mesh(&mesh, &args.export)?;
    if let Some(truth) = &truth {
        out.truth(truth.measurer.rest())?;
    }
    let metrics = metrics(args, &cell, &*reconstructor, &log, &topology, started);
    let metrics = measured(metrics, &mesh, &*reconstructor, truth.as_ref())?;
    out.metrics(&metrics)?;
    let measurer = truth.as_ref().map(|t| &t.measurer);
    let model = reconstructor.model();
    log.report.decision(
        &topology,
        model,
        &mesh.page(measurer.map(Measurer::surface)),
        &mesh.against(measurer, model, spacing),
    );
    let mut rows = rows(&metrics, log.failures);
    rows.extend(topology.obstacle().map(|o| ("not closed", o.to_string())));
    out.report(&log.report, &metrics, rows.clone())?;
    if !args.quiet {
        table(&rows)?;
    }
    Ok(true)
}

/// Some errors name a file of the recording themselves.
fn with_path(path: &Path, error: &dvrk_io::Error) -> String {
    let (path, text) = (path.display().to_string(), error.to_string());
    if text.starts_with(&path) {
        text
    } else {
        format!("{path}: {text}")
    }
}

/// Says what of the recording could not be read: the first few places.
fn complain(skipped: &Skipped) {
    eprintln!(
        "{} messages of the recording could not be read, in {} places:",
        skipped.messages, skipped.places
    );
    skipped
        .first
        .iter()
        .take(5)
        .for_each(|skip| eprintln!("  {skip}"));
}

/// Takes frame after frame, to the end of the recording or as far as was asked for.
fn watch(
    args: &ReplayArgs,
    out: &OutputFolder,
    cell: &mut ReplayCell,
    reconstructor: &mut dyn Reconstruct,
    truth: &mut Option<Truth>,
    bar: &indicatif::ProgressBar,
    log: &mut Log,
) -> Result<(), Failure> {
    let spacing = args.spacing * 1e-3;
    loop {
        let observation = match cell.observe() {
            Ok(observation) => observation,
            Err(CellError::Ended) => break,
            Err(error) => return Err(error.into()),
        };
        let first = *log.first_stamp.get_or_insert(observation.stamp);
        if args
            .until
            .is_some_and(|until| observation.stamp - first > until)
        {
            break;
        }
        let report = reconstructor.process(&observation, &cell.info().table)?;
        log.registration.push(report.registration_ms);
        log.frames.push(report.frame_ms);
        log.last_stamp = observation.stamp;
        log.failures += usize::from(report.failure.is_some());
        log.constraints.add(&report.constraints);
        let errors = match truth {
            Some(truth) => truth.frame(&observation, reconstructor, &report.measured)?,
            None => Vec::new(),
        };
        log.report
            .frame(&observation, &report, reconstructor.model(), &errors);
        log.lines.push_str(&frames::line(
            observation.stamp,
            &report,
            reconstructor.model(),
            &errors,
        ));
        if args
            .pictures
            .is_some_and(|n| n > 0 && report.frame % n == 0)
        {
            out.picture(
                &format!("rest_{:04}.png", report.frame),
                reconstructor.model(),
                spacing,
            )?;
            out.live_picture(
                &format!("live_{:04}.png", report.frame),
                reconstructor.model(),
                spacing,
            )?;
        }
        bar.set_message(format!("{} vertices", reconstructor.model().len()));
        bar.inc(1);
    }
    Ok(())
}

#[derive(Default)]
struct Log {
    report: Report,
    registration: Vec<f64>,
    frames: Vec<f64>,
    failures: usize,
    constraints: ConstraintMeasures,
    first_stamp: Option<f64>,
    last_stamp: f64,
    lines: String,
}

impl Log {
    fn new(args: &ReplayArgs, cell: &ReplayCell) -> Self {
        let about = About {
            subject: args.session.display().to_string(),
            command: command_line(),
            version: env!("CARGO_PKG_VERSION").into(),
            spacing: args.spacing * 1e-3,
            ..About::default()
        };
        Self {
            report: Report::new(about.with_cell(cell.info())),
            ..Self::default()
        }
    }
}

/// The recorded ground truth, read apart from what the reconstruction is given.
struct Truth {
    frames: Vec<dvrk_io::session::TruthFrame>,
    measurer: Measurer,
}

impl Truth {
    fn read(reader: &SessionReader, path: &Path, quiet: bool) -> Result<Option<Self>, Failure> {
        let frames = reader.read_truth(path)?.frames;
        let Some(first) = frames.first() else {
            return Ok(None);
        };
        let surface = TrueSurface::from_points(&first.points)?;
        let report = MeshReport::of(&surface.vertices, &surface.triangles);
        if !report.watertight && !quiet {
            eprintln!(
                "the points of the ground truth are too sparse for a closed surface: {} open edges",
                report.open_edges
            );
        }
        let measurer = Measurer::new(surface)?;
        Ok(Some(Self { frames, measurer }))
    }

    fn frame(
        &mut self,
        observation: &Observation,
        reconstructor: &dyn Reconstruct,
        measured: &[bool],
    ) -> Result<Vec<f64>, Failure> {
        let stamp = observation.stamp;
        let nearest = self
            .frames
            .iter()
            .min_by(|a, b| (a.stamp - stamp).abs().total_cmp(&(b.stamp - stamp).abs()));
        let Some(now) = nearest.filter(|f| (f.stamp - stamp).abs() < 0.02) else {
            return Ok(Vec::new());
        };
        let surface = TrueSurface {
            vertices: now.points.clone(),
            triangles: self.measurer.rest().triangles.clone(),
        };
        let held = observation.arms.iter().any(|arm| arm.holding);
        Ok(self
            .measurer
            .frame(reconstructor.model(), measured, held, &surface)?)
    }
}

/// Adds what the mesh and the truth say.
fn measured(
    metrics: Metrics,
    mesh: &FinalMesh,
    reconstructor: &dyn Reconstruct,
    truth: Option<&Truth>,
) -> Result<Metrics, Failure> {
    let model = reconstructor.model();
    let spacing = metrics.spacing_m;
    let measurer = truth.map(|t| &t.measurer);
    let shape = measurer.map(|m| m.shape(model, spacing));
    let measures = mesh.measure(&model.rest, spacing, measurer.map(Measurer::surface))?;
    Ok(metrics
        .with_shape(shape.as_slice(), shape.as_ref())
        .with_mesh(&measures)
        .with_tracking(&measurer.map(Measurer::tracking).unwrap_or_default()))
}

fn metrics(
    args: &ReplayArgs,
    cell: &ReplayCell,
    reconstructor: &dyn Reconstruct,
    log: &Log,
    topology: &Topology,
    started: Instant,
) -> Metrics {
    Metrics {
        scene: args.session.display().to_string(),
        arms: cell.info().arms.len(),
        grips: "recorded".into(),
        seed: 0,
        spacing_m: args.spacing * 1e-3,
        manipulations: 0,
        stop: if topology.is_closed() {
            "closed"
        } else {
            "ended"
        }
        .into(),
        betti: topology.persistent,
        nm_cut: Cut::of(topology.cut),
        nm_remaining: topology.non_manifold,
        thinned: topology.thinned,
        frames: log.frames.len(),
        failed_frames: log.failures,
        constraints: log.constraints,
        registration_ms: Timing::of(&log.registration),
        frame_ms: Timing::of(&log.frames),
        vertices: reconstructor.model().len(),
        stiffness_over_weight: reconstructor.stiffness_over_weight(),
        robot_time_s: log.last_stamp - log.first_stamp.unwrap_or(log.last_stamp),
        wall_s: started.elapsed().as_secs_f64(),
        ..Metrics::default()
    }
}

/// The closing table.
fn rows(metrics: &Metrics, failures: usize) -> Vec<(&'static str, String)> {
    let mut rows = vec![
        (
            "frames",
            format!("{} ({failures} not registered)", metrics.frames),
        ),
        ("vertices", metrics.vertices.to_string()),
        ("Betti numbers", format!("{:?}", metrics.betti)),
    ];
    rows.extend(measure_rows(metrics));
    rows.extend([
        (
            "frame time",
            format!(
                "{:.1} ms median, {:.1} ms p95",
                metrics.frame_ms.median, metrics.frame_ms.p95
            ),
        ),
        ("wall time", format!("{:.1} s", metrics.wall_s)),
    ]);
    rows
}
