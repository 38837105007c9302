//! `explore replay`: reconstructs the canonical model from a recording.

use crate::closing::{measure_rows, mm, table};
use crate::final_mesh::FinalMesh;
use crate::live::Live;
use crate::output::{OutputFolder, command_line};
use crate::recording::Recording;
use crate::replay_args::ReplayArgs;
use crate::without::{Part, names, refuse};
use crate::{Failure, Features};
use dvrk_io::session::{SessionReader, Skipped};
use explore_loop::canonical::CanonicalModel;
use explore_loop::canonical::topology::{self, Topology};
use explore_loop::cell::replay::ReplayCell;
use explore_loop::cell::{Cell, CellError, Observation};
use explore_loop::explore::Event;
use explore_loop::measure::{
    GripSpeed, Measurer, MeshReport, PixelTracks, TrackComparison, TrackErrors, TrueSurface,
};
use explore_loop::reconstruct::{ColourFeatures, FrameReport, Reconstruct, ReconstructOptions};
use explore_loop::report::frames;
use explore_loop::report::html::{About, Report};
use explore_loop::report::metrics::{ConstraintMeasures, Cut, Metrics, Timing, UnseenPlace};
use mesh_io::program::{Output, of_file, unless_closed, warn};
use std::path::Path;
use std::time::Instant;

/// Reconstructs the whole recording, writes the results, and returns the measures.
pub fn replay(args: &ReplayArgs) -> Result<Metrics, Failure> {
    refuse(
        &args.without,
        Part::is_of_exploring,
        "a replay does not have",
    )?;
    let mut replay = Replay::open(args)?;
    replay.watch()?;
    replay.has_seen_the_object()?;
    replay.reconstructor.consolidate(&replay.cell.info().table);
    let topology = topology::analyse(replay.model(), replay.spacing())
        .map_err(|error| of_file(&args.session, &error))?;
    replay.show(Event::Topology(&topology));
    let mesh = replay.mesh(&topology);
    replay.write(&mesh)?;
    let metrics = replay.metrics(&topology, &mesh)?;
    replay.out.metrics(&metrics)?;
    let rows = rows(&topology, &metrics);
    replay.report(&topology, &mesh, &metrics, &rows)?;
    for remark in replay.live.finish() {
        warn(&remark);
    }
    if !args.results.quiet {
        table(args.results.output(), &rows)?;
    }
    unless_closed(args.results.output().object(&metrics))?;
    Ok(metrics)
}

/// A recording that is being reconstructed.
struct Replay<'a> {
    args: &'a ReplayArgs,
    out: OutputFolder,
    cell: ReplayCell,
    /// Present only if it was recorded.
    truth: Option<Truth>,
    /// Present only if tracks were given.
    tracks: Option<TrackComparison>,
    reconstructor: Box<dyn Reconstruct>,
    log: Log,
    live: Live,
    started: Instant,
}

impl<'a> Replay<'a> {
    /// Opens the recording, and reports what it lacks.
    fn open(args: &'a ReplayArgs) -> Result<Self, Failure> {
        let wrong = |error: &dyn std::fmt::Display| of_file(&args.session, error);
        let recording = Recording::of(args)?;
        let reader = recording.reader(args);
        let started = Instant::now();
        let cell = recording.cell(&reader, &args.session);
        let cell = cell.map_err(|e| wrong(&e))?;
        let cell = match args.noise {
            0.0 => cell,
            noise => cell.with_noise(1e-3 * noise, args.seed)?,
        };
        let tracks = tracks(args)?;
        // A recording that cannot be read leaves no result folder behind.
        let out = OutputFolder::create(&args.results.out)?;
        remark(args.results.output(), &cell);
        let truth =
            Truth::read(&reader, &args.session, args.results.output()).map_err(|e| wrong(&e))?;
        let (title, spacing) = (args.session.display().to_string(), args.spacing * 1e-3);
        Ok(Self {
            live: Live::open(
                &args.results.live,
                &out,
                false,
                &title,
                cell.info(),
                spacing,
            )?,
            args,
            out,
            truth,
            tracks,
            reconstructor: reconstructor(args)?,
            log: Log::new(args, &cell),
            cell,
            started,
        })
    }

    fn model(&self) -> &CanonicalModel {
        self.reconstructor.model()
    }

    /// Spacing of the model, m.
    fn spacing(&self) -> f64 {
        self.args.spacing * 1e-3
    }

    /// Processes frame after frame, to the end of the recording or to `--until`.
    fn watch(&mut self) -> Result<(), Failure> {
        let frames = self.cell.remaining() as u64;
        let bar = self.args.results.output().progress(frames, "frames");
        loop {
            let observation = match self.cell.observe() {
                Ok(observation) => observation,
                Err(CellError::Ended) => break,
                Err(error) => return Err(of_file(&self.args.session, &error).into()),
            };
            let first = *self.log.first_stamp.get_or_insert(observation.stamp);
            let since = observation.stamp - first;
            if self.args.until.is_some_and(|until| since > until) {
                break;
            }
            self.take(&observation)?;
            bar.inc(1);
        }
        bar.finish_and_clear();
        Ok(())
    }

    /// Adds a frame to the model and to the log.
    fn take(&mut self, observation: &Observation) -> Result<(), Failure> {
        let table = &self.cell.info().table;
        let report = self
            .reconstructor
            .process(observation, table)
            .map_err(|error| {
                let stamp = observation.stamp;
                let error = format!("frame at {stamp:.3} s: {error}");
                of_file(&self.args.session, error)
            })?;
        let errors = match &mut self.truth {
            Some(truth) => truth.frame(observation, &*self.reconstructor, &report.measured)?,
            None => Vec::new(),
        };
        if self.live.wants_uncertainty()
            && let Some(sigmas) = self.reconstructor.uncertainty()
        {
            self.show(Event::Uncertainty(&sigmas));
        }
        self.show(Event::Frame(observation, &report));
        let model = self.reconstructor.model();
        if let Some(tracks) = &mut self.tracks {
            tracks.frame(report.frame as usize, observation, &report.measured, model)?;
        }
        self.log.add(observation, &report, model, &errors);
        if let Some(every) = self.args.pictures
            && every > 0
            && report.frame % every == 0
        {
            let (k, spacing) = (report.frame, self.spacing());
            let out = &self.out;
            out.picture(&format!("rest_{k:04}.png"), model, spacing)?;
            out.live_picture(&format!("live_{k:04}.png"), model, spacing)?;
        }
        Ok(())
    }

    /// Shows an event in the live view.
    fn show(&mut self, event: Event<'_>) {
        let model = self.reconstructor.model();
        for remark in self.live.show(event, model) {
            warn(&remark);
        }
    }

    /// Fails if the object is in none of the frames; otherwise reports what of the recording could not be read.
    fn has_seen_the_object(&mut self) -> Result<(), Failure> {
        if self.model().is_empty() {
            let unreadable = self.cell.skipped().and_then(|s| s.first.first());
            let why = self.log.failure.take();
            let why = why.or(unreadable.map(ToString::to_string));
            let why = why.unwrap_or_else(|| "there are no frames".into());
            let why = format!("the object was found in no frame: {why}");
            return Err(of_file(&self.args.session, &why).into());
        }
        if let Some(skipped) = self.cell.skipped().filter(|s| !s.is_empty()) {
            complain(self.args.results.output(), skipped);
        }
        Ok(())
    }

    /// The surface that is written and measured.
    fn mesh(&self, topology: &Topology) -> FinalMesh {
        match self.reconstructor.surface() {
            Some(own) => FinalMesh::as_drawn(self.model(), own, self.spacing()),
            None => FinalMesh::of(self.model(), topology, self.spacing()),
        }
    }

    /// Writes the frames, the mesh and the truth.
    fn write(&self, mesh: &FinalMesh) -> Result<(), Failure> {
        self.out.frames(&self.log.lines)?;
        self.out.mesh(mesh, &self.args.results.export)?;
        if let Some(measurer) = self.measurer() {
            self.out.truth(measurer.rest())?;
        }
        Ok(())
    }

    fn measurer(&self) -> Option<&Measurer> {
        self.truth.as_ref().map(|truth| &truth.measurer)
    }

    /// Writes the page.
    fn report(
        &mut self,
        topology: &Topology,
        mesh: &FinalMesh,
        metrics: &Metrics,
        rows: &[(&'static str, String)],
    ) -> Result<(), Failure> {
        let (measurer, model) = (self.measurer(), self.model());
        let page = mesh.page(measurer.map(Measurer::surface));
        let against = mesh.against(measurer, model, self.spacing());
        let model = self.reconstructor.model();
        self.log.report.decision(topology, model, &page, &against);
        self.out.report(&self.log.report, metrics, rows.to_vec())
    }

    fn metrics(&self, topology: &Topology, mesh: &FinalMesh) -> Result<Metrics, Failure> {
        let (measurer, model, spacing) = (self.measurer(), self.model(), self.spacing());
        let shape = measurer.map(|m| m.shape(model, spacing));
        let measures = mesh.measure(model.rest(), spacing, measurer.map(Measurer::surface))?;
        Ok(self
            .untested(topology)
            .with_shape(shape.as_slice(), shape.as_ref())
            .with_mesh(&measures)
            .with_tracking(&measurer.map(Measurer::tracking).unwrap_or_default()))
    }

    /// The metrics that need no ground truth.
    fn untested(&self, topology: &Topology) -> Metrics {
        let (args, log) = (self.args, &self.log);
        let closed = topology.is_closed();
        Metrics {
            scene: args.session.display().to_string(),
            arms: self.cell.info().arms.len(),
            grips: "recorded".into(),
            seed: args.seed,
            spacing_m: self.spacing(),
            manipulations: 0,
            stop: if closed { "closed" } else { "ended" }.into(),
            without: names(&args.without),
            betti: topology.persistent,
            contacts: topology.contacts(),
            unseen: topology.unseen.iter().map(UnseenPlace::from).collect(),
            nm_cut: Cut::of(topology.cut),
            nm_remaining: topology.non_manifold,
            thinned: topology.thinned,
            frames: log.frames.len(),
            failed_frames: log.failures,
            constraints: log.constraints,
            fastest_grip_m_s: log.grip_speed.fastest(),
            registration_ms: Timing::of(&log.registration),
            frame_ms: Timing::of(&log.frames),
            vertices: self.model().len(),
            tracks: self.tracks.as_ref().and_then(TrackComparison::errors),
            stiffness_over_weight: self.reconstructor.stiffness_over_weight(),
            robot_time_s: log.last_stamp - log.first_stamp.unwrap_or(log.last_stamp),
            wall_s: self.started.elapsed().as_secs_f64(),
            ..Metrics::default()
        }
    }
}

/// The tracks to compare the model with, if any.
fn tracks(args: &ReplayArgs) -> Result<Option<TrackComparison>, Failure> {
    let (Some(path), Some(camera)) = (&args.tracks, args.intrinsics) else {
        return Ok(None);
    };
    let bytes = std::fs::read(path).map_err(|error| of_file(path, error))?;
    let tracks = PixelTracks::parse(&bytes).map_err(|error| of_file(path, error))?;
    let comparison = TrackComparison::new(tracks, camera, args.spacing * 1e-3);
    Ok(Some(comparison.map_err(|error| of_file(path, error))?))
}

/// An empty reconstruction with the options of the command line.
fn reconstructor(args: &ReplayArgs) -> Result<Box<dyn Reconstruct>, Failure> {
    let features = match args.features {
        Features::On => ColourFeatures::Landmarks,
        Features::Off => ColourFeatures::Ignored,
    };
    let mut options = ReconstructOptions::new(args.spacing * 1e-3).with_features(features);
    for part in &args.without {
        part.leave_out_of_reconstruction(&mut options);
    }
    args.reconstruction.begin(options, &args.without)
}

/// The closing table.
fn rows(topology: &Topology, metrics: &Metrics) -> Vec<(&'static str, String)> {
    let (frames, failures) = (metrics.frames, metrics.failed_frames);
    let mut rows = vec![
        ("frames", format!("{frames} ({failures} not registered)")),
        ("vertices", metrics.vertices.to_string()),
        ("Betti numbers", format!("{:?}", metrics.betti)),
    ];
    rows.extend(measure_rows(metrics));
    rows.extend(
        metrics
            .tracks
            .map(|tracks| ("pixel tracks", against(&tracks))),
    );
    let time = &metrics.frame_ms;
    let time = format!("{:.1} ms median, {:.1} ms p95", time.median, time.p95);
    rows.push(("frame time", time));
    rows.push(("wall time", format!("{:.1} s", metrics.wall_s)));
    rows.extend(topology.obstacle().map(|o| ("not closed", o.to_string())));
    rows
}

/// How far model and tracker disagree.
fn against(tracks: &TrackErrors) -> String {
    let error = tracks.error_m;
    format!(
        "{} mean, {} p95 apart, {} along the surface ({} of {} tracks)",
        mm(error.mean),
        mm(error.p95),
        mm(tracks.slide_m),
        tracks.tied,
        tracks.tracks
    )
}

/// Prints what the recording lacks, and what the result will lack therefore.
fn remark(output: Output, cell: &ReplayCell) {
    if let Some((unit, source)) = cell.unit() {
        let (table, share) = (cell.info().table.offset, cell.on_table().unwrap_or(0.0));
        let share = 1e2 * share;
        output.note(&format!(
            "the object is found in what the camera saw: {unit} {source}, the table {table:.3} m before the camera with {share:.0} % of what is seen on it"
        ));
    }
    if !cell.has_poses() {
        output.note(
            "no arm was recorded: the motion of hidden parts is poorly determined; name poses with --topic PSM1/measured_cp=/NAME",
        );
    }
    if !cell.has_table() {
        output.note(
            "no table was recorded: it cannot limit how far the model sinks; name it with --topic table=/NAME",
        );
    }
}

/// Prints what of the recording could not be read, the first few places.
fn complain(output: Output, skipped: &Skipped) {
    output.note(&format!(
        "{} messages of the recording could not be read, in {} places:",
        skipped.messages, skipped.places
    ));
    for skip in skipped.first.iter().take(5) {
        output.note(&format!("  {skip}"));
    }
}

/// What was measured in the frames.
#[derive(Default)]
struct Log {
    report: Report,
    registration: Vec<f64>,
    frames: Vec<f64>,
    failures: usize,
    /// Why the most recent frame that failed was not registered.
    failure: Option<String>,
    constraints: ConstraintMeasures,
    grip_speed: GripSpeed,
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

    /// Adds a frame.
    fn add(
        &mut self,
        observation: &Observation,
        report: &FrameReport,
        model: &CanonicalModel,
        errors: &[f64],
    ) {
        self.registration.push(report.registration_ms);
        self.frames.push(report.frame_ms);
        self.last_stamp = observation.stamp;
        self.failures += usize::from(report.failure.is_some());
        self.failure = report.failure.clone().or(self.failure.take());
        self.constraints.add(&report.constraints);
        self.grip_speed.add(observation);
        self.report.frame(observation, report, model, errors);
        let line = frames::line(observation.stamp, report, model, errors);
        self.lines.push_str(&line);
    }
}

/// The recorded ground truth, read separately from the input of the reconstruction.
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
