//! `explore replay`: the canonical model from a recording.

use crate::output::{FinalMesh, OutputFolder, command_line, measure_rows, table};
use crate::without::{Part, names, refuse};
use crate::{Failure, Features, ReplayArgs};
use dvrk_io::session::{SessionReader, Skipped, TopicCount};
use explore_loop::canonical::topology::{self, Topology};
use explore_loop::cell::replay::ReplayCell;
use explore_loop::cell::{Cell, CellError, Observation};
use explore_loop::measure::{Measurer, MeshReport, TrueSurface};
use explore_loop::reconstruct::{ColourFeatures, Reconstruct, ReconstructOptions};
use explore_loop::report::frames;
use explore_loop::report::html::{About, Report};
use explore_loop::report::metrics::{ConstraintMeasures, Cut, Metrics, Timing};
use mesh_io::program::{Output, unless_closed};
use std::path::Path;
use std::time::Instant;

/// Reconstructs the whole recording; true when it got to its end.
pub fn replay(args: &ReplayArgs) -> Result<bool, Failure> {
    refuse(
        &args.without,
        Part::is_of_exploring,
        "a replay does not have",
    )?;
    let mut reader = SessionReader::default();
    for (role, topic) in &args.topics {
        reader = reader.with_topic(role.clone(), topic);
    }
    let session = reader
        .frames(&args.session)
        .map_err(|error| with_path(&args.session, &error))?;
    let out = OutputFolder::create(&args.results.out)?;
    let spacing = args.spacing * 1e-3;
    let started = Instant::now();
    let wrong = |error: &dyn std::fmt::Display| with_path(&args.session, error);
    if session.stamps().len() == 0 {
        return Err(wrong(&without_clouds(session.topics())).into());
    }
    let mut cell = ReplayCell::streamed(session).map_err(|error| wrong(&error))?;
    remark(args.results.output(), &cell);
    let mut truth = Truth::read(&reader, &args.session, args.results.output())
        .map_err(|error| wrong(&error))?;
    let features = match args.features {
        Features::On => ColourFeatures::Landmarks,
        Features::Off => ColourFeatures::Ignored,
    };
    let mut options = ReconstructOptions::new(spacing).with_features(features);
    for part in &args.without {
        part.leave_out_of_reconstruction(&mut options);
    }
    let mut reconstructor = args.reconstruction.begin(options, &args.without)?;
    let bar = args
        .results
        .output()
        .progress(cell.remaining() as u64, "frames");
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
    if reconstructor.model().is_empty() {
        let unreadable = cell.skipped().and_then(|s| s.first.first());
        let why = log.failure.take().or(unreadable.map(ToString::to_string));
        let why = why.unwrap_or_else(|| "there are none".into());
        return Err(wrong(&format!("the object is in none of the frames: {why}")).into());
    }
    if let Some(skipped) = cell.skipped().filter(|s| !s.is_empty()) {
        complain(args.results.output(), skipped);
    }
    reconstructor.consolidate(&cell.info().table);
    let topology =
        topology::analyse(reconstructor.model(), spacing).map_err(|error| wrong(&error))?;
    let mesh = match reconstructor.surface() {
        Some(own) => FinalMesh::as_drawn(reconstructor.model(), own, spacing),
        None => FinalMesh::of(reconstructor.model(), &topology, spacing),
    };
    out.frames(&log.lines)?;
    out.mesh(&mesh, &args.results.export)?;
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
    if !args.results.quiet {
        table(args.results.output(), &rows)?;
    }
    unless_closed(args.results.output().object(&metrics))?;
    Ok(true)
}

/// Why there are no frames, and what may be meant instead.
fn without_clouds(topics: &[TopicCount]) -> String {
    let is_cloud = |t: &&TopicCount| t.type_name.contains("PointCloud2") && t.count > 0;
    let clouds: Vec<&str> = topics
        .iter()
        .filter(is_cloud)
        .map(|t| t.topic.as_str())
        .collect();
    if let Some(first) = clouds.first() {
        let clouds = clouds.join(", ");
        return format!(
            "no points where they were looked for; there are clouds on {clouds}: say which with --topic points={first}"
        );
    }
    let name = |t: &TopicCount| format!("{} ({})", t.topic, t.type_name);
    let all: Vec<String> = topics.iter().map(name).collect();
    format!("no point clouds; the topics are {}", all.join(", "))
}

/// Says what the recording lacks and the result will lack with it.
fn remark(output: Output, cell: &ReplayCell) {
    if !cell.has_poses() {
        output.note(
            "no arm was recorded: what moves the object is not known, and what is hidden is only guessed; name poses with --topic PSM1/measured_cp=/NAME",
        );
    }
    if !cell.has_table() {
        output.note(
            "no table was recorded: the object may be anywhere below; name it with --topic table=/NAME",
        );
    }
}

/// Some errors name a file of the recording themselves.
fn with_path(path: &Path, error: &dyn std::fmt::Display) -> String {
    let (path, text) = (path.display().to_string(), error.to_string());
    if text.starts_with(&path) {
        text
    } else {
        format!("{path}: {text}")
    }
}

/// Says what of the recording could not be read: the first few places.
fn complain(output: Output, skipped: &Skipped) {
    output.note(&format!(
        "{} messages of the recording could not be read, in {} places:",
        skipped.messages, skipped.places
    ));
    for skip in skipped.first.iter().take(5) {
        output.note(&format!("  {skip}"));
    }
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
            Err(error) => return Err(with_path(&args.session, &error).into()),
        };
        let first = *log.first_stamp.get_or_insert(observation.stamp);
        if args
            .until
            .is_some_and(|until| observation.stamp - first > until)
        {
            break;
        }
        let report = reconstructor
            .process(&observation, &cell.info().table)
            .map_err(|error| {
                let stamp = observation.stamp;
                with_path(&args.session, &format!("frame at {stamp:.3} s: {error}"))
            })?;
        log.registration.push(report.registration_ms);
        log.frames.push(report.frame_ms);
        log.last_stamp = observation.stamp;
        log.failures += usize::from(report.failure.is_some());
        log.failure = report.failure.clone().or(log.failure.take());
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
    /// Why the last frame that was not registered was not.
    failure: Option<String>,
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
    fn read(reader: &SessionReader, path: &Path, output: Output) -> Result<Option<Self>, Failure> {
        let frames = reader.read_truth(path)?.frames;
        let Some(first) = frames.first() else {
            return Ok(None);
        };
        let surface = TrueSurface::from_points(&first.points)?;
        let report = MeshReport::of(&surface.vertices, &surface.triangles);
        if !report.watertight {
            output.note(&format!(
                "the points of the ground truth are too sparse for a closed surface: {} open edges",
                report.open_edges
            ));
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
        without: names(&args.without),
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
