//! Ten thousand frames of a small object that is turned again and again: memory and the time of a frame stay what they are.
//!
//! ```sh
//! cargo run --release -p explore-loop --example long_run -- 10000
//! ```
//! prints a line every thousand frames: vertices of the model, time of a frame (median, 95 %), memory that the program holds. It fails when memory
//! goes over 600 MB or the median time of the last thousand frames is more than half above that of the second thousand.
#![allow(clippy::print_stdout, dead_code)]

#[path = "own_robot/egg.rs"]
mod egg;

use explore_loop::cell::Cell;
use explore_loop::nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use explore_loop::reconstruct::{ReconstructOptions, Reconstructor};
use explore_loop::report::metrics::Timing;

/// Frames of a turn: reach, grip, lift and turn, let go.
const CYCLE: usize = 80;
/// Most memory, MB, and how much slower frames may become.
const MEMORY: f64 = 600.0;
const SLOWER: f64 = 1.5;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let frames: usize = std::env::args().nth(1).map_or(Ok(10_000), |n| n.parse())?;
    let mut cell = egg::EggCell::new(0);
    let table = cell.info().table;
    let mut reconstructor = Reconstructor::new(ReconstructOptions::new(5e-3))?;
    let (mut times, mut medians, mut failed) = (Vec::new(), Vec::new(), 0);
    println!("frames  vertices  frame ms median  p95    not taken  memory MB");
    for frame in 1..=frames {
        act(&mut cell, frame % CYCLE)?;
        let observation = cell.observe()?;
        let report = reconstructor.process(&observation, &table)?;
        failed += usize::from(report.failure.is_some());
        times.push(report.frame_ms);
        if frame % CYCLE == 0 {
            reconstructor.consolidate(&table);
        }
        if times.len() == 1000 {
            let Timing { median, p95 } = Timing::of(&times);
            let (vertices, memory) = (reconstructor.model().len(), memory());
            println!(
                "{frame:6}  {vertices:8}  {median:15.1}  {p95:5.1}  {failed:9}  {:9.1}",
                memory.unwrap_or(0.0)
            );
            if memory.is_some_and(|m| m > MEMORY) {
                return Err(format!("more than {MEMORY} MB").into());
            }
            medians.push(median);
            (times, failed) = (Vec::new(), 0);
        }
    }
    match (medians.get(1), medians.last()) {
        (Some(early), Some(late)) if late > &(SLOWER * early) => {
            Err(format!("frames became slower: {early:.1} ms, then {late:.1} ms").into())
        }
        _ => Ok(()),
    }
}

/// What the first arm does at a step of the cycle.
fn act(cell: &mut egg::EggCell, step: usize) -> Result<(), Box<dyn std::error::Error>> {
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

/// Memory that the program holds, MB, where the system tells.
fn memory() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmRSS:"))?;
    let kilobytes: f64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kilobytes / 1024.0)
}
