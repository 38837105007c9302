//! `explore replay`: the canonical model from a recording.

use crate::output::{OutputFolder, mm, table};
use crate::{Failure, ReplayArgs};
use explore_loop::canonical::topology::{self, Topology};
use explore_loop::cell::replay::ReplayCell;
use explore_loop::cell::{Cell, CellError};
use explore_loop::measure::{Measurer, ShapeMeasures, TrueSurface};
use explore_loop::reconstruct::{ReconstructOptions, Reconstructor};
use explore_loop::report::frames;
use explore_loop::report::metrics::{Cut, Metrics, Timing};
use std::time::Instant;

/// Reconstructs the whole recording; true when it got to its end.
pub fn replay(args: &ReplayArgs) -> Result<bool, Failure> {
    let session = dvrk_io::session::SessionReader::open(&args.session)
        .map_err(|error| format!("{}: {error}", args.session.display()))?;
    let out = OutputFolder::create(&args.out)?;
    let spacing = args.spacing * 1e-3;
    let started = Instant::now();
    let mut cell = ReplayCell::new(session)?;
    let mut truth = Truth::read(&args.session)?;
    let mut reconstructor = Reconstructor::new(ReconstructOptions::new(spacing))?;
    let bar = indicatif::ProgressBar::new(cell.remaining() as u64);
    let mut log = Log::default();
    loop {
        let observation = match cell.observe() {
            Ok(observation) => observation,
            Err(CellError::Ended) => break,
            Err(error) => return Err(error.into()),
        };
        let report = reconstructor.process(&observation, &cell.info().table)?;
        log.registration.push(report.registration_ms);
        log.frames.push(report.frame_ms);
        log.last_stamp = observation.stamp;
        log.first_stamp.get_or_insert(observation.stamp);
        log.failures += usize::from(report.failure.is_some());
        let errors = match &mut truth {
            Some(truth) => truth.frame(observation.stamp, &reconstructor, &report.measured)?,
            None => Vec::new(),
        };
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
    bar.finish_and_clear();
    let topology = topology::analyse(reconstructor.model(), spacing)?;
    let shape = truth
        .as_ref()
        .map(|t| t.measurer.shape(reconstructor.model(), spacing));
    let prediction = truth.as_ref().and_then(Truth::prediction);
    let metrics = metrics(
        args,
        &cell,
        &reconstructor,
        &log,
        shape,
        prediction,
        &topology,
        started,
    );
    out.frames(&log.lines)?;
    out.metrics(&metrics)?;
    out.model(reconstructor.model(), spacing)?;
    print(&metrics, log.failures)?;
    Ok(true)
}

#[derive(Default)]
struct Log {
    registration: Vec<f64>,
    frames: Vec<f64>,
    failures: usize,
    first_stamp: Option<f64>,
    last_stamp: f64,
    lines: String,
}

/// The recorded ground truth, read apart from what the reconstruction is given.
struct Truth {
    frames: Vec<dvrk_io::session::TruthFrame>,
    measurer: Measurer,
    errors: Vec<f64>,
}

impl Truth {
    fn read(path: &std::path::Path) -> Result<Option<Self>, Failure> {
        let frames = dvrk_io::session::read_truth(path)?;
        let Some(first) = frames.first() else {
            return Ok(None);
        };
        let measurer = Measurer::new(TrueSurface::from_points(&first.points)?)?;
        Ok(Some(Self {
            frames,
            measurer,
            errors: Vec::new(),
        }))
    }

    fn frame(
        &mut self,
        stamp: f64,
        reconstructor: &Reconstructor,
        measured: &[bool],
    ) -> Result<Vec<f64>, Failure> {
        let nearest = self
            .frames
            .iter()
            .min_by(|a, b| (a.stamp - stamp).abs().total_cmp(&(b.stamp - stamp).abs()));
        let Some(now) = nearest.filter(|f| (f.stamp - stamp).abs() < 0.02) else {
            return Ok(Vec::new());
        };
        let triangles = self.measurer.rest().triangles.clone();
        let surface = TrueSurface {
            vertices: now.points.clone(),
            triangles,
        };
        self.measurer.anchor(reconstructor.model(), &surface)?;
        self.errors.extend(self.measurer.prediction_error(
            reconstructor.model(),
            measured,
            &surface,
        ));
        Ok(self.measurer.live_errors(reconstructor.model(), &surface))
    }

    fn prediction(&self) -> Option<f64> {
        (!self.errors.is_empty())
            .then(|| self.errors.iter().sum::<f64>() / self.errors.len() as f64)
    }
}

#[allow(clippy::too_many_arguments)] // one call site; a struct would only rename the arguments
fn metrics(
    args: &ReplayArgs,
    cell: &ReplayCell,
    reconstructor: &Reconstructor,
    log: &Log,
    shape: Option<ShapeMeasures>,
    prediction: Option<f64>,
    topology: &Topology,
    started: Instant,
) -> Metrics {
    Metrics {
        scene: args.session.display().to_string(),
        arms: cell.info().arms.len(),
        grips: "recorded".into(),
        seed: 0,
        speed_m_s: None,
        spacing_m: args.spacing * 1e-3,
        manipulations: 0,
        stop: if topology.is_closed() {
            "closed"
        } else {
            "ended"
        }
        .into(),
        betti: topology.persistent,
        explored: shape.map(|s| vec![s.explored]),
        shape_difference_m: shape.map(|s| s.difference),
        shape_difference_rel: shape.map(|s| s.relative),
        prediction_error_m: prediction,
        nm_cut: Cut::of(topology.cut),
        nm_remaining: topology.non_manifold,
        frames: log.frames.len(),
        registration_ms: Timing::of(&log.registration),
        frame_ms: Timing::of(&log.frames),
        vertices: reconstructor.model().len(),
        robot_time_s: log.last_stamp - log.first_stamp.unwrap_or(log.last_stamp),
        wall_s: started.elapsed().as_secs_f64(),
    }
}

fn print(metrics: &Metrics, failures: usize) -> Result<(), Failure> {
    let percent = |share: f64| format!("{:.1} %", 100.0 * share);
    let unknown = || "no ground truth in the recording".to_owned();
    table(&[
        (
            "frames",
            format!("{} ({failures} not registered)", metrics.frames),
        ),
        ("vertices", metrics.vertices.to_string()),
        ("Betti numbers", format!("{:?}", metrics.betti)),
        (
            "explored",
            metrics
                .explored
                .as_ref()
                .and_then(|e| e.last())
                .map_or_else(unknown, |e| percent(*e)),
        ),
        (
            "shape difference",
            match (metrics.shape_difference_m, metrics.shape_difference_rel) {
                (Some(metres), Some(share)) => {
                    format!("{} ({} of the size)", mm(metres), percent(share))
                }
                _ => unknown(),
            },
        ),
        (
            "prediction error",
            metrics.prediction_error_m.map_or_else(unknown, mm),
        ),
        (
            "frame time",
            format!(
                "{:.1} ms median, {:.1} ms p95",
                metrics.frame_ms.median, metrics.frame_ms.p95
            ),
        ),
        ("wall time", format!("{:.1} s", metrics.wall_s)),
    ])
}
