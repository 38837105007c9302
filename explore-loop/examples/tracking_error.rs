//! Tracking errors of recorded sessions: seen and hidden vertices, phase by phase, against the recorded ground truth.
//!
//! ```sh
//! cargo run --release -p explore-loop --example tracking_error -- SESSION.mcap...
//! ```
//! Prints for every session a line per phase (R at rest, H held), mm: distance of the seen vertices from the true surface along the normal, their
//! sliding along it, and the error of the hidden ones; then frame times.
#![allow(clippy::print_stdout)]

use explore_loop::cell::replay::ReplayCell;
use explore_loop::cell::{Cell, CellError};
use explore_loop::measure::{Measurer, TrueSurface};
use explore_loop::reconstruct::{ReconstructOptions, Reconstructor};
use mesh_io::program::{self, Failure, Output};
use serde_json::{Value, json};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Prints the errors of tracked vertices against the recorded ground truth, phase by phase
#[derive(Debug, clap::Parser)]
#[command(
    name = "tracking_error",
    after_help = "Example: tracking_error session.mcap"
)]
struct Arguments {
    /// Recordings with ground truth (MCAP)
    #[arg(required = true, value_name = "SESSION.mcap")]
    sessions: Vec<PathBuf>,
    #[command(flatten)]
    output: Output,
}

fn main() -> ExitCode {
    program::run(tracking_error)
}

fn tracking_error(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let (mut words, mut objects) = (arguments.output.words(), Vec::new());
    for path in &arguments.sessions {
        let in_file = |error: Failure| format!("{}: {error}", path.display());
        let session = session(path, arguments.output).map_err(in_file)?;
        writeln!(words, "{}", path.display())?;
        for phase in &session.phases {
            writeln!(words, "  {}", phase.words())?;
        }
        writeln!(
            words,
            "  frame {:.0} ms median, {:.0} ms p95; weight over stiffness {:.2} 1/m",
            session.median_ms, session.p95_ms, session.weight_over_stiffness
        )?;
        objects.push(session.object(path));
    }
    arguments.output.object(&json!({ "sessions": objects }))?;
    Ok(ExitCode::SUCCESS)
}

/// Result of a recording.
struct Session {
    phases: Vec<Phase>,
    median_ms: f64,
    p95_ms: f64,
    weight_over_stiffness: f64,
}

impl Session {
    fn object(&self, path: &Path) -> Value {
        json!({
            "session": path,
            "phases": self.phases.iter().map(Phase::object).collect::<Vec<_>>(),
            "frame_ms": { "median": self.median_ms, "p95": self.p95_ms },
            "weight_over_stiffness_per_m": self.weight_over_stiffness,
        })
    }
}

/// Sums over the frames of a phase.
#[derive(Default)]
struct Phase {
    name: String,
    frames: usize,
    seen: Mean,
    slide: Mean,
    hidden: Mean,
}

#[derive(Default)]
struct Mean {
    sum: f64,
    count: usize,
}

impl Mean {
    fn add(&mut self, value: f64) {
        self.sum += value;
        self.count += 1;
    }

    fn mm(&self) -> f64 {
        1e3 * self.sum / self.count.max(1) as f64
    }
}

impl Phase {
    fn words(&self) -> String {
        format!(
            "{}, {} frames: seen {:.2} off the surface, {:.2} sliding; hidden {:.2}",
            self.name,
            self.frames,
            self.seen.mm(),
            self.slide.mm(),
            self.hidden.mm()
        )
    }

    fn object(&self) -> Value {
        json!({
            "phase": self.name,
            "frames": self.frames,
            "seen_mm": self.seen.mm(),
            "slide_mm": self.slide.mm(),
            "hidden_mm": self.hidden.mm(),
        })
    }
}

fn session(path: &Path, output: Output) -> Result<Session, Failure> {
    let frames = dvrk_io::session::read_truth(path)?;
    let first = frames.first().ok_or("the session has no truth")?;
    let rest = TrueSurface::from_points(&first.points)?;
    let triangles = rest.triangles.clone();
    let mut measurer = Measurer::new(rest)?;
    let mut cell = ReplayCell::new(dvrk_io::session::SessionReader::open(path)?)?;
    let mut reconstructor = Reconstructor::new(ReconstructOptions::new(0.005))?;
    let mut phases: Vec<Phase> = Vec::new();
    let (mut times, mut turns) = (Vec::new(), 0);
    let bar = output.progress(cell.remaining() as u64, "frames");
    loop {
        let observation = match cell.observe() {
            Ok(observation) => observation,
            Err(CellError::Ended) => break,
            Err(error) => return Err(error.into()),
        };
        let report = reconstructor.process(&observation, &cell.info().table)?;
        times.push(report.frame_ms);
        bar.inc(1);
        let near = |f: &&dvrk_io::session::TruthFrame| (f.stamp - observation.stamp).abs() < 0.02;
        let Some(now) = frames.iter().find(near) else {
            continue;
        };
        let now = TrueSurface {
            vertices: now.points.clone(),
            triangles: triangles.clone(),
        };
        let model = reconstructor.model();
        measurer.anchor(model, &now)?;
        let held = observation.arms.iter().any(|arm| arm.holding);
        let began = held && !phases.last().is_some_and(|p| p.name.starts_with('H'));
        turns += usize::from(began);
        let name = format!("{}{turns}", if held { 'H' } else { 'R' });
        if phases.last().is_none_or(|p| p.name != name) {
            phases.push(Phase {
                name,
                ..Phase::default()
            });
        }
        let Some(phase) = phases.last_mut() else {
            continue;
        };
        phase.frames += 1;
        let surface = now.surface()?;
        let errors = measurer.live_errors(model, &now);
        for (i, error) in errors.into_iter().enumerate() {
            if report.measured[i] {
                phase.seen.add(surface.distance(&model.live()[i]));
                phase.slide.add(error);
            } else {
                phase.hidden.add(error);
            }
        }
    }
    bar.finish_and_clear();
    times.sort_by(f64::total_cmp);
    let at = |share: f64| {
        let last = times.len().saturating_sub(1);
        times
            .get((last as f64 * share) as usize)
            .copied()
            .unwrap_or(0.0)
    };
    let (median_ms, p95_ms) = (at(0.5), at(0.95));
    Ok(Session {
        phases,
        median_ms,
        p95_ms,
        weight_over_stiffness: reconstructor.weight_over_stiffness().unwrap_or_default().0,
    })
}
