//! Ten thousand frames of a small object that is turned again and again: memory and frame time must stay constant.
//!
//! ```sh
//! cargo run --release -p explore-loop --example long_run -- 10000
//! ```
//! prints a line every thousand frames: vertices of the model, frame time (median, 95th percentile), memory of the program, size of the saved state
//! (which does not depend on what else the machine does). It fails if the memory exceeds 600 MB, or, of the last thousand
//! frames, the median time is more than 1.5 times or the state more than 1.2 times that of the second thousand.
#![allow(dead_code, reason = "the egg has more than is needed here")]

#[path = "own_robot/egg.rs"]
mod egg;

use explore_loop::cell::Cell;
use explore_loop::nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use explore_loop::reconstruct::{Reconstruct, ReconstructOptions, Reconstructor};
use explore_loop::report::metrics::Timing;
use mesh_io::program::{self, Failure, Output};
use serde_json::json;
use std::io::Write;
use std::process::ExitCode;

/// Turns a small object again and again: memory and frame time must stay constant
#[derive(Debug, clap::Parser)]
#[command(name = "long_run", after_help = "Example: long_run 10000")]
struct Arguments {
    /// Number of frames
    #[arg(default_value_t = 10_000)]
    frames: usize,
    #[command(flatten)]
    output: Output,
}

/// Frames of a cycle: reach, grip, lift and turn, release.
const CYCLE: usize = 80;
/// Largest memory, MB, and largest factors by which frame time, which depends on other work of the machine, and state grow.
const MEMORY: f64 = 600.0;
const SLOWER: f64 = 1.5;
const LARGER: f64 = 1.2;

fn main() -> ExitCode {
    program::run(long_run)
}

fn long_run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let output = arguments.output;
    let mut cell = egg::EggCell::new(0);
    let table = cell.info().table;
    let mut reconstructor = Reconstructor::new(ReconstructOptions::new(5e-3))?;
    let (mut times, mut medians, mut failed) = (Vec::new(), Vec::new(), 0);
    let mut states = Vec::new();
    writeln!(
        output.words(),
        "frames  vertices  frame ms median  p95    not taken  memory MB  state kB"
    )?;
    let bar = output.progress(arguments.frames as u64, "frames");
    let mut rows = Vec::new();
    for frame in 1..=arguments.frames {
        act(&mut cell, frame % CYCLE)?;
        let observation = cell.observe()?;
        let report = reconstructor.process(&observation, &table)?;
        failed += usize::from(report.failure.is_some());
        times.push(report.frame_ms);
        bar.inc(1);
        if frame % CYCLE == 0 {
            reconstructor.consolidate(&table);
        }
        if times.len() == 1000 {
            let Timing { median, p95 } = Timing::of(&times);
            let (vertices, memory) = (reconstructor.model().len(), memory());
            let shown = memory.unwrap_or(0.0);
            let state = reconstructor.save().map_or(0, |bytes| bytes.len()) as f64 / 1e3;
            let line = format!(
                "{frame:6}  {vertices:8}  {median:15.1}  {p95:5.1}  {failed:9}  {shown:9.1}  {state:8.0}"
            );
            bar.suspend(|| writeln!(output.words(), "{line}"))?;
            rows.push(json!({
                "frame": frame,
                "vertices": vertices,
                "median_ms": median,
                "p95_ms": p95,
                "not_taken": failed,
                "memory_mb": memory,
                "state_kb": state,
            }));
            if memory.is_some_and(|m| m > MEMORY) {
                return Err(format!("more than {MEMORY} MB").into());
            }
            medians.push(median);
            states.push(state);
            (times, failed) = (Vec::new(), 0);
        }
    }
    bar.finish_and_clear();
    output.object(&json!({ "rows": rows }))?;
    for (what, values, growth) in [
        ("frame time, ms", medians, SLOWER),
        ("state, kB", states, LARGER),
    ] {
        if let (Some(early), Some(late)) = (values.get(1), values.last())
            && late > &(growth * early)
        {
            return Err(format!("{what} grew: {early:.1}, then {late:.1}").into());
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// The command to the first arm at a step of the cycle.
fn act(cell: &mut egg::EggCell, step: usize) -> Result<(), Failure> {
    let camera_from_egg = cell.camera_from_egg;
    let axis = camera_from_egg * Vector3::x();
    let end = camera_from_egg * Translation3::new(0.033, 0.0, 0.0);
    let down = Vector3::new(-axis.x, -axis.y, 1.0);
    let grip = Isometry3::from_parts(
        end.translation,
        UnitQuaternion::face_towards(&down, &Vector3::z().cross(&axis)),
    );
    let up = Translation3::new(0.0, 0.0, -0.015);
    match step {
        5 => cell.move_arm(0, grip, 0.3)?,
        25 => cell.close_jaw(0)?,
        26 => {
            let turn = UnitQuaternion::from_scaled_axis(axis * 0.8);
            let middle = Translation3::from(camera_from_egg.translation.vector);
            cell.move_arm(0, up * middle * turn * middle.inverse() * grip, 0.01)?;
        }
        55 => cell.open_jaw(0)?,
        56 => cell.move_arm(0, cell.info().arms[0].camera_from_home, 0.3)?,
        _ => {}
    }
    Ok(())
}

/// Memory of the program, MB, if the system provides it.
fn memory() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmRSS:"))?;
    let kilobytes: f64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kilobytes / 1024.0)
}
