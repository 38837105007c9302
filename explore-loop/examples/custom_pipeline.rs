//! A custom pipeline for rigid objects: the poses of the tips give the motion of the object, and grips are drawn at random.
//!
//! ```sh
//! cargo run --release -p explore-loop --example custom_pipeline
//! ```
#![allow(dead_code, reason = "the egg has more than is needed here")]

#[path = "own_robot/egg.rs"]
mod egg;

use explore_loop::Error;
use explore_loop::canonical::{CanonicalModel, NewVertex};
use explore_loop::cell::{ArmState, Observation, Plane};
use explore_loop::explore::{ExploreOptions, Explorer};
use explore_loop::nalgebra::{Isometry3, Point3};
use explore_loop::plan::RandomPlanner;
use explore_loop::reconstruct::{FrameReport, Reconstruct};
use mesh_io::program::{self, Failure, Output};
use serde_json::json;
use std::io::Write;
use std::process::ExitCode;

/// Explores a rigid egg with a custom pipeline
#[derive(Debug, clap::Parser)]
#[command(
    name = "custom_pipeline",
    after_help = "Example: custom_pipeline --json"
)]
struct Arguments {
    #[command(flatten)]
    output: Output,
}

/// The object moves with the tip that holds it; points without a near vertex enter the model.
#[derive(Default)]
struct ByArms {
    model: CanonicalModel,
    camera_from_rest: Isometry3<f64>,
    tip_from_rest: Option<Isometry3<f64>>,
}

impl Reconstruct for ByArms {
    fn process(&mut self, seen: &Observation, _: &Plane) -> Result<FrameReport, Error> {
        let holds = |arm: &&ArmState| arm.holding;
        let tip = seen.arms.iter().find(holds).map(|a| a.camera_from_tip);
        let now = tip.map(|tip| tip.inverse() * self.camera_from_rest);
        self.tip_from_rest = now.map(|now| self.tip_from_rest.unwrap_or(now));
        if let (Some(tip), Some(tip_from_rest)) = (tip, self.tip_from_rest) {
            self.camera_from_rest = tip * tip_from_rest;
        }
        let (pose, back) = (self.camera_from_rest, self.camera_from_rest.inverse());
        let turn = *pose.rotation.to_rotation_matrix().matrix();
        let normals = nonrigid_reg::estimate_normals(&seen.points, 16, &Point3::origin())?;
        for (p, n) in seen.points.iter().zip(normals) {
            let rest = back * p;
            if self.model.rest().iter().all(|q| (q - rest).norm() > 4e-3) {
                self.model.push(NewVertex::new(rest, back.rotation * n), 0);
            }
        }
        for i in 0..self.model.len() {
            self.model.live_mut()[i] = pose * self.model.rest()[i];
        }
        self.model.rotations_mut().fill(turn);
        self.model.join(5e-3);
        Ok(FrameReport::measured(self.model.len()))
    }

    fn model(&self) -> &CanonicalModel {
        &self.model
    }
}

/// The reason for the stop, the number of manipulations, and the share of the egg that was shown.
///
/// # Errors
/// Failures of the exploration.
pub fn explored() -> Result<(&'static str, usize, f64), Error> {
    let mut cell = egg::EggCell::new(0);
    let mut planner = RandomPlanner::new(0);
    let options = ExploreOptions::new(5e-3, 0.03);
    let own = ByArms::default();
    let mut watcher = ();
    let mut explorer =
        Explorer::with_reconstructor(&mut cell, &mut planner, &mut watcher, options, own);
    let end = explorer.run()?;
    drop(explorer);
    Ok((end.stop.word(), end.manipulations, cell.share_shown()))
}

fn main() -> ExitCode {
    program::run(print)
}

fn print(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let (stop, manipulations, shown) = explored()?;
    writeln!(
        arguments.output.words(),
        "{stop}, {manipulations} manipulations, {:.1} % shown",
        100.0 * shown
    )?;
    let answer = json!({ "stop": stop, "manipulations": manipulations, "shown": shown });
    arguments.output.object(&answer)?;
    Ok(ExitCode::SUCCESS)
}
