//! Drift over a track: `cargo run --release -p nonrigid-reg --example drift [-- FRAMES]` (default 100)
//!
//! An object goes out to 40 mm and back twice, seen afresh in every frame by a camera above (3,000 points, 0.5 mm of noise). What the
//! first frame shows is carried from frame to frame by one `Registrar`; nothing ever corrects it. Prints, in mm, how far the points are from
//! where they should be, with landmarks only, with features too, and with neither.
#![allow(clippy::print_stdout, missing_docs)] // a table is what the program is for

#[path = "../benches/generator/mod.rs"]
mod generator;

use std::error::Error;

use generator::track::Track;
use generator::{Motion, Shape, View, error_mm, moved};
use nonrigid_reg::{Options, Registrar};

fn main() -> Result<(), Box<dyn Error>> {
    let frames = std::env::args().nth(1).map_or(Ok(100), |n| n.parse())?;
    println!(
        "{:24} {:>9} {:>8} {:>8} {:>8} {:>8} {:>8}",
        "drift after frames",
        "",
        frames / 4,
        frames / 2,
        3 * frames / 4,
        frames,
        "worst"
    );
    let tracks = [
        (Shape::Blob, Motion::Pinch),
        (Shape::Tube, Motion::Bend),
        (Shape::Liver, Motion::Combo),
        (Shape::Glove, Motion::Fold),
    ];
    for (shape, motion) in tracks {
        for mode in ["none", "landmarks", "features"] {
            let drift = follow(shape, motion, frames, mode)?;
            let at = |k: usize| drift.get(k.saturating_sub(1)).copied().unwrap_or(f64::NAN);
            println!(
                "{:24} {mode:>9} {:8.2} {:8.2} {:8.2} {:8.2} {:8.2}",
                format!("{shape:?} {motion:?}"),
                at(frames / 4),
                at(frames / 2),
                at(3 * frames / 4),
                at(frames),
                drift.iter().copied().fold(0.0, f64::max),
            );
        }
    }
    Ok(())
}

/// Mean error after each frame, in mm.
fn follow(
    shape: Shape,
    motion: Motion,
    frames: usize,
    mode: &str,
) -> Result<Vec<f64>, Box<dyn Error>> {
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
        // Features pair what two images show, and know nothing of the model.
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
