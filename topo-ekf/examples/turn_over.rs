//! A soft body is seen from above, turned over by 180° and bent: how accurately is the hidden side estimated?
//!
//! Prints the mean error of the hidden half, averaged over the turn, for several numbers of alternations per frame.

use std::f64::consts::PI;
use std::io::Write;
use std::process::ExitCode;

use mesh_io::program::{self, Failure, Output};
use nalgebra::{Point3, Rotation3, UnitVector3, Vector3};
use serde_json::json;
use topo_ekf::{Error, Filter, Frame, Observation, Options, Plane};

#[path = "../tests/common/mod.rs"]
mod common;
use common::{Noise, ellipsoid, mean_error};

/// Prints the error of the hidden side of a turned body for several numbers of alternations per frame
#[derive(Debug, clap::Parser)]
#[command(name = "turn_over", after_help = "Example: turn_over --json")]
struct Arguments {
    #[command(flatten)]
    output: Output,
}

const HALF: [f64; 3] = [0.06, 0.045, 0.025];

/// Position of a point of the resting body after `share` of the motion: bent about the y axis, rotated, lifted.
fn moved(p: &Point3<f64>, share: f64, bend: f64) -> Point3<f64> {
    let k = (share * bend).max(1e-9);
    let arc = p.x * k;
    let bent = Point3::new(
        (1.0 / k + p.z) * arc.sin(),
        p.y,
        (1.0 / k + p.z) * arc.cos() - 1.0 / k,
    );
    Rotation3::from_axis_angle(&Vector3::y_axis(), PI * share) * bent
        + Vector3::new(0.02, 0.01, 0.03) * share
}

/// Mean over the turn and worst frame of the error of the hidden half, mm.
fn run(iterations: usize, bend: f64) -> Result<[f64; 2], Error> {
    let (rest, edges) = ellipsoid(800, HALF, 6);
    let options = Options::default().with_rotation_iterations(iterations);
    let mut filter = Filter::new(&rest, &edges, &options)?;
    let table = [Plane {
        normal: UnitVector3::new_unchecked(Vector3::z()),
        offset: 0.1,
    }];
    let mut noise = Noise(1);
    let (mut sum, mut worst) = (0.0, 0f64);
    for frame in 1..=60 {
        let share = f64::from(frame) / 60.0;
        let turn = Rotation3::from_axis_angle(&Vector3::y_axis(), PI * share);
        let truth: Vec<_> = rest.iter().map(|p| moved(p, share, bend)).collect();
        let upward: Vec<_> = rest.iter().map(|p| (turn * outward(p)).z > 0.1).collect();
        let observations: Vec<_> = (0..rest.len())
            .filter(|&i| upward[i])
            .map(|i| Observation {
                vertex: i as u32,
                position: truth[i] + noise.vector(5e-4),
                sigma: 5e-4,
            })
            .collect();
        filter.step(&Frame::new(&observations).with_planes(&table))?;
        let error = mean_error(filter.live(), &truth, |i| !upward[i]);
        sum += error / 60.0;
        worst = worst.max(error);
    }
    Ok([sum * 1e3, worst * 1e3])
}

fn outward(p: &Point3<f64>) -> Vector3<f64> {
    Vector3::new(
        p.x / HALF[0].powi(2),
        p.y / HALF[1].powi(2),
        p.z / HALF[2].powi(2),
    )
    .normalize()
}

fn main() -> ExitCode {
    program::run(turn_over)
}

fn turn_over(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let (output, mut rows) = (arguments.output, Vec::new());
    writeln!(
        output.words(),
        "alternations   rigid: mean, worst frame (mm)   bending to a radius of 150 mm"
    )?;
    let counts = [1, 2, 4, 6, 8, 16, 64];
    let bar = output.progress(counts.iter().map(|c| *c as u64).sum(), "alternations");
    for iterations in counts {
        let (rigid, bending) = (run(iterations, 0.0)?, run(iterations, 1.0 / 0.15)?);
        let line = format!(
            "{iterations:>12}   {:>12.3} {:>8.3}              {:>12.3} {:>8.3}",
            rigid[0], rigid[1], bending[0], bending[1]
        );
        bar.suspend(|| writeln!(output.words(), "{line}"))?;
        bar.inc(iterations as u64);
        rows.push(json!({ "alternations": iterations, "rigid_mm": rigid, "bending_mm": bending }));
    }
    bar.finish_and_clear();
    output.object(&json!({ "rows": rows }))?;
    Ok(ExitCode::SUCCESS)
}
