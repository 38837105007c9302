//! Drift over a track: `cargo run --release -p nonrigid-reg --example drift [-- FRAMES]` (default 100)
//!
//! An object moves out to 40 mm and back twice; a camera above sees new points of it in every frame (3,000 points, 0.5 mm of noise). The points of the
//! first frame are carried from frame to frame by one `Registrar`, and nothing ever corrects them. Prints, in mm, their distance from the
//! true positions: with landmarks only, with features too, and with neither.
#![allow(missing_docs, reason = "of the generator")]

#[path = "../benches/generator/mod.rs"]
mod generator;

use std::io::Write;
use std::process::ExitCode;

use generator::track::Track;
use generator::{Motion, Shape, View, error_mm, moved};
use mesh_io::program::{self, Failure, Output};
use nonrigid_reg::{Options, Registrar};
use serde_json::json;

/// Drift of a model over many frames without any correction
#[derive(Debug, clap::Parser)]
#[command(name = "drift", after_help = "Example: drift 20")]
struct Arguments {
    /// Number of frames
    #[arg(default_value_t = 100, value_parser = clap::value_parser!(u32).range(1..))]
    frames: u32,
    #[command(flatten)]
    output: Output,
}

fn main() -> ExitCode {
    program::run(drift)
}

fn drift(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let (output, frames) = (arguments.output, arguments.frames as usize);
    let marks = [frames / 4, frames / 2, 3 * frames / 4, frames];
    let [a, b, c, d] = marks;
    writeln!(
        output.words(),
        "{:24} {:>9} {a:>8} {b:>8} {c:>8} {d:>8} {:>8}",
        "drift after frames",
        "",
        "worst"
    )?;
    let tracks = [
        (Shape::Blob, Motion::Pinch),
        (Shape::Tube, Motion::Bend),
        (Shape::Liver, Motion::Combo),
        (Shape::Glove, Motion::Fold),
    ];
    let modes = ["none", "landmarks", "features"];
    let bar = output.progress((tracks.len() * modes.len()) as u64, "tracks");
    let mut rows = Vec::new();
    for (shape, motion) in tracks {
        for mode in modes {
            let drift = follow(shape, motion, frames, mode)?;
            let after = |k: usize| drift.get(k.saturating_sub(1)).copied().unwrap_or(f64::NAN);
            let [a, b, c, d] = marks.map(after);
            let worst = drift.iter().copied().fold(0.0, f64::max);
            let line = format!(
                "{:24} {mode:>9} {a:8.2} {b:8.2} {c:8.2} {d:8.2} {worst:8.2}",
                format!("{shape:?} {motion:?}"),
            );
            bar.suspend(|| writeln!(output.words(), "{line}"))?;
            bar.inc(1);
            rows.push(json!({
                "track": format!("{shape:?} {motion:?}"),
                "known": mode,
                "drift_mm": drift,
                "worst_mm": worst,
            }));
        }
    }
    bar.finish_and_clear();
    output.object(&json!({ "frames": frames, "tracks": rows }))?;
    Ok(ExitCode::SUCCESS)
}

/// Mean error after each frame, in mm.
fn follow(shape: Shape, motion: Motion, frames: usize, mode: &str) -> Result<Vec<f64>, Failure> {
    let mut track = Track::new(shape, motion, 0.04, frames, 11);
    let mut model = track.look(0);
    let (rest, grips) = (model.points.clone(), track.grips());
    let mut registrar = Registrar::new(Options::default());
    let mut drift = Vec::new();
    for k in 0..frames {
        let target = track.look(k + 1);
        let landmarks = match mode {
            "none" => Vec::new(),
            _ => track.landmarks(&grips, k),
        };
        // Features are pairs of points of two successive images, independent of the model.
        let features = match mode {
            "features" => track.features(&rest, k),
            _ => Vec::new(),
        };
        let result =
            registrar.register(&model.cloud(), &target.cloud(), &landmarks, &features, None)?;
        model = View::new(moved(&model.points, &result.displacements));
        let truth: Vec<_> = rest.iter().map(|p| track.place(p, k + 1)).collect();
        drift.push(error_mm(&model.points, &truth).0);
    }
    Ok(drift)
}
