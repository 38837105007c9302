//! The part of a table top that an arm can reach: `cargo run --example psm_reach`.
//!
//! A grasp from above, jaws along the arm, in steps of 2 cm: `#` within all safety margins, `+` within joint
//! limits only, `.` out of reach. Below it, the reasons why the corners are not reached.

use dvrk_io::Psm;
use dvrk_io::kinematics::{Kinematics, PsmWorkspace, SafetyMargins};
use dvrk_io::nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use mesh_io::program::{self, Failure, Output};
use serde_json::json;
use std::io::Write;
use std::process::ExitCode;

/// Draws the part of a table top that the arms can reach, and prints why they reach no farther
#[derive(Debug, clap::Parser)]
#[command(
    name = "psm_reach",
    after_help = "Example: psm_reach

# within all safety margins, + within joint limits only, . out of reach; a step is 2 cm."
)]
struct Arguments {
    #[command(flatten)]
    output: Output,
}

/// Height of the remote centre over the table, metres.
const HEIGHT: f64 = 0.15;

fn main() -> ExitCode {
    program::run(reach)
}

fn reach(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let (mut words, mut arms) = (arguments.output.words(), Vec::new());
    for psm in [Psm::Classic, Psm::Si] {
        // In a table frame below the remote centre, with the axes of the arm.
        let table_from_rcm = Isometry3::translation(0.0, 0.0, HEIGHT);
        let safe = PsmWorkspace::new(Kinematics::new(psm), &table_from_rcm)?;
        let bare = safe.with_margins(SafetyMargins::NONE)?;
        writeln!(words, "{psm:?}, remote centre {HEIGHT} m above the centre")?;
        let (mut map, mut places) = (Vec::new(), Vec::new());
        for row in (-9..=9).rev() {
            let line: String = (-13..=13)
                .map(|column| {
                    let pose = grasp(f64::from(column) * 0.02, f64::from(row) * 0.02);
                    match (safe.contains(&pose), bare.contains(&pose)) {
                        (true, _) => '#',
                        (false, true) => '+',
                        (false, false) => '.',
                    }
                })
                .collect();
            writeln!(words, "  {line}")?;
            map.push(line);
        }
        for (x, y) in [(0.26, 0.0), (0.0, 0.18), (0.0, 0.0)] {
            let (text, joints) = match safe.reach(&grasp(x, y)) {
                Ok(reach) => (format!("joints {:.3?}", reach.joints), Some(reach.joints)),
                Err(reason) => (reason.to_string(), None),
            };
            writeln!(words, "  ({x:.2}, {y:.2}): {text}")?;
            places.push(json!({ "x_m": x, "y_m": y, "joints": joints, "words": text }));
        }
        arms.push(json!({ "psm": format!("{psm:?}"), "map": map, "places": places }));
    }
    arguments.output.object(&json!({ "arms": arms }))?;
    Ok(ExitCode::SUCCESS)
}

/// Pose with the tips at (x, y) on the table, approaching straight down.
fn grasp(x: f64, y: f64) -> Isometry3<f64> {
    let down = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    let quarter = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -std::f64::consts::FRAC_PI_2);
    Isometry3::from_parts(Translation3::new(x, y, 0.0), down * quarter)
}
