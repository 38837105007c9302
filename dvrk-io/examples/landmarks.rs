//! Landmarks between two frames of a painted ball that turns: colour features lifted to 3-D, matched, and compared with the truth.
//!
//! ```sh
//! cargo run --release -p dvrk-io --example landmarks
//! ```
#![allow(clippy::unwrap_used, reason = "an example")]

#[path = "../tests/painted/mod.rs"]
mod painted;

use dvrk_io::features::{Feature, FeatureOptions, Surface, detect, landmark_pairs, lift};
use mesh_io::program::{self, Failure, Output};
use nalgebra::{Isometry3, Translation3, UnitQuaternion};
use painted::{Body, Paint, picture};
use serde_json::json;
use std::io::Write;
use std::process::ExitCode;

/// Finds landmarks between two frames of a painted ball that turns, and compares them with the truth
#[derive(Debug, clap::Parser)]
#[command(name = "landmarks", after_help = "Example: landmarks --json")]
struct Arguments {
    #[command(flatten)]
    output: Output,
}

fn main() -> ExitCode {
    program::run(landmarks)
}

fn landmarks(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let (mut words, mut turns) = (arguments.output.words(), Vec::new());
    let options = FeatureOptions::default();
    let paint = Paint {
        noise: 2.0,
        depth_noise: 0.0005,
        ..Paint::default()
    };
    let pose = |turn: f64| {
        let turn = UnitQuaternion::from_euler_angles(turn, 0.0, 0.5 * turn);
        Isometry3::from_parts(Translation3::new(0.0, 0.0, 0.5), turn)
    };
    let seen = |turn: f64, frame: u64| -> Result<Vec<Feature>, dvrk_io::Error> {
        // With a camera: GreyImage::from_rgb, Scan::from_depth, and find_object for the mask.
        let seen = picture(Body::Ball, &pose(turn), &paint, frame);
        let surface = Surface {
            scan: &seen.scan,
            object: Some(&seen.object),
            arms: &[],
        };
        let corners = detect(&seen.image, &options);
        lift(&corners, &seen.image, &surface, &options)
    };
    writeln!(
        words,
        "turn between frames   features   pairs   within 3 mm   mean error of those"
    )?;
    for degrees in [2.0_f64, 5.0, 10.0, 15.0, 20.0, 30.0] {
        let (a, b) = (seen(0.0, 1)?, seen(degrees.to_radians(), 2)?);
        let pairs = landmark_pairs(&a, &b, &options);
        let motion = pose(degrees.to_radians()) * pose(0.0).inverse();
        let errors = pairs.iter().map(|pair| (motion * pair.a - pair.b).norm());
        let right: Vec<f64> = errors.filter(|error| *error < 0.003).collect();
        let share = right.len() as f64 / pairs.len().max(1) as f64;
        let error = right.iter().sum::<f64>() / right.len().max(1) as f64;
        turns.push(json!({
            "degrees": degrees, "features": a.len(), "pairs": pairs.len(),
            "within_3mm": share, "error_m": error,
        }));
        writeln!(
            words,
            "{degrees:>18}°   {:>8}   {:>5}   {:>9.0} %   {:.2} mm",
            a.len(),
            pairs.len(),
            100.0 * share,
            1e3 * error
        )?;
    }
    arguments.output.object(&json!({ "turns": turns }))?;
    Ok(ExitCode::SUCCESS)
}
