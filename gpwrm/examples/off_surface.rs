//! Accuracy of a field off the surface of its nodes: a bent sheet of nodes rotates, and probes are above it.
//!
//! Prints the error of the field at each height, compared with that of a field whose derivative along the normal is zero.

use std::io::Write;
use std::process::ExitCode;

use gpwrm::{Field, FieldOptions, ShapeFunctions};
use mesh_io::program::{self, Failure, Output};
use nalgebra::{Point3, Rotation3, Vector3};
use serde_json::json;

/// Prints the error of a field above a rotating sheet, compared with a field without rotations
#[derive(Debug, clap::Parser)]
#[command(name = "off_surface", after_help = "Example: off_surface --json")]
struct Arguments {
    #[command(flatten)]
    output: Output,
}

fn main() -> ExitCode {
    program::run(off_surface)
}

fn off_surface(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let nodes: Vec<Point3<f64>> = (0..144)
        .map(|k| {
            (
                f64::from(k % 12) * 0.01 - 0.055,
                f64::from(k / 12) * 0.01 - 0.055,
            )
        })
        .map(|(x, y)| Point3::new(x, y, 2.0 * (x * x - y * y)))
        .collect();
    // A rotation by half a radian and additional bending.
    let turn = Rotation3::new(Vector3::new(0.5, 0.1, 0.0));
    let motion = |p: &Point3<f64>| {
        let bent = p + Vector3::new(-4.0 * p.x * p.z, 0.0, 2.0 * p.x * p.x);
        turn * bent - p
    };
    let moved: Vec<Vector3<f64>> = nodes.iter().map(motion).collect();
    let field = Field::new(&nodes, &moved, &FieldOptions::default())?;
    let shapes = ShapeFunctions::new(&nodes, 8)?;

    let (mut words, mut rows) = (arguments.output.words(), Vec::new());
    writeln!(words, "height mm   field mm   flat gradient mm")?;
    for height in [0.0, 0.01, 0.02, 0.03] {
        let (mut ours, mut flat, mut count) = (0.0, 0.0, 0.0);
        for k in 0..100 {
            let (x, y) = (
                f64::from(k % 10) * 0.007 - 0.03,
                f64::from(k / 10) * 0.007 - 0.03,
            );
            let p = Point3::new(x, y, 2.0 * (x * x - y * y) + height);
            let plain: Vector3<f64> = shapes.at(&p).iter().map(|&(i, phi)| phi * moved[i]).sum();
            ours += (field.displacement(&p) - motion(&p)).norm();
            flat += (plain - motion(&p)).norm();
            count += 1.0;
        }
        let [height, ours, flat] = [height, ours / count, flat / count].map(|metres| 1e3 * metres);
        writeln!(words, "{height:9.0}   {ours:8.3}   {flat:16.3}")?;
        rows.push(json!({ "height_mm": height, "field_mm": ours, "flat_mm": flat }));
    }
    arguments.output.object(&json!({ "heights": rows }))?;
    Ok(ExitCode::SUCCESS)
}
