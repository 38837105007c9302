//! Where the tracking of recorded sessions errs: seen and hidden vertices, phase by phase, against the recorded truth.
//!
//! ```sh
//! cargo run --release -p explore-loop --example tracking_error -- SESSION.mcap...
//! ```
//! For every session a line a phase (R at rest, H held), mm: distance of the seen vertices from the true surface along the normal, how far
//! they have slid along it, and the error of the hidden ones; then frame times.
#![allow(clippy::print_stdout)]

use explore_loop::cell::replay::ReplayCell;
use explore_loop::cell::{Cell, CellError};
use explore_loop::measure::{Measurer, TrueSurface};
use explore_loop::reconstruct::{ReconstructOptions, Reconstructor};
use std::error::Error;
use std::path::Path;

fn main() -> Result<(), Box<dyn Error>> {
    let sessions: Vec<String> = std::env::args().skip(1).collect();
    if sessions.is_empty() {
        return Err("usage: tracking_error SESSION.mcap...".into());
    }
    for session in sessions {
        println!("{session}");
        for line in phases(Path::new(&session))? {
            println!("  {line}");
        }
    }
    Ok(())
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

fn phases(path: &Path) -> Result<Vec<String>, Box<dyn Error>> {
    let frames = dvrk_io::session::read_truth(path)?;
    let first = frames.first().ok_or("the session has no truth")?;
    let rest = TrueSurface::from_points(&first.points)?;
    let triangles = rest.triangles.clone();
    let mut measurer = Measurer::new(rest)?;
    let mut cell = ReplayCell::new(dvrk_io::session::SessionReader::open(path)?)?;
    let mut reconstructor = Reconstructor::new(ReconstructOptions::new(0.005))?;
    let mut phases: Vec<Phase> = Vec::new();
    let (mut times, mut turns) = (Vec::new(), 0);
    loop {
        let observation = match cell.observe() {
            Ok(observation) => observation,
            Err(CellError::Ended) => break,
            Err(error) => return Err(error.into()),
        };
        let report = reconstructor.process(&observation, &cell.info().table)?;
        times.push(report.frame_ms);
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
                phase.seen.add(surface.distance(&model.live[i]));
                phase.slide.add(error);
            } else {
                phase.hidden.add(error);
            }
        }
    }
    let mut lines: Vec<String> = phases
        .iter()
        .map(|p| {
            format!(
                "{}, {} frames: seen {:.2} off the surface, {:.2} from their material; hidden {:.2}",
                p.name,
                p.frames,
                p.seen.mm(),
                p.slide.mm(),
                p.hidden.mm()
            )
        })
        .collect();
    times.sort_by(f64::total_cmp);
    let at = |share: f64| times[((times.len() - 1) as f64 * share) as usize];
    lines.push(format!(
        "frame {:.0} ms median, {:.0} ms p95; weight over stiffness {:.2} 1/m",
        at(0.5),
        at(0.95),
        reconstructor.weight_over_stiffness().unwrap_or_default().0
    ));
    Ok(lines)
}
