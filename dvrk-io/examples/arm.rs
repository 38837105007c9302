//! Drives a PSM over ROS 2, real or simulated: `cargo run --features ros2 --example arm -- --help`.

use std::io::Write;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

use dvrk_io::Psm;
use dvrk_io::arm::{Arm, ArmOptions};
use dvrk_io::kinematics::{Kinematics, RcmFromTip};
use dvrk_io::nalgebra::Translation3;
use dvrk_io::transport::{Network, Participant};
use mesh_io::program::{self, Failure, Output};
use serde_json::{Value, json};

/// Connects to a PSM, enables and homes it, reads it, and moves its tips along the remote centre's z axis and back
///
/// THE ARM MOVES. Keep the emergency stop at hand; the instrument must be at least 45 mm past the remote centre.
#[derive(Debug, clap::Parser)]
#[command(
    name = "arm",
    after_help = "Examples:
  arm PSM1 --read-only
  arm PSM1 --si --millimetres 10 --speed 5

ROS_DOMAIN_ID, ROS_LOCALHOST_ONLY and ROS_AUTOMATIC_DISCOVERY_RANGE are honoured."
)]
struct Arguments {
    /// Name of the arm
    #[arg(default_value = "PSM1")]
    name: String,
    /// An S or Si instead of a Classic
    #[arg(long)]
    si: bool,
    /// Length of the motion, 0 to 20 mm
    #[arg(long, value_name = "D", default_value_t = 5.0, value_parser = within::<0, 20>)]
    millimetres: f64,
    /// Speed, 1 to 50 mm/s
    #[arg(long, value_name = "V", default_value_t = 10.0, value_parser = within::<1, 50>)]
    speed: f64,
    /// Only connect and read; send no commands
    #[arg(long)]
    read_only: bool,
    #[command(flatten)]
    output: Output,
}

/// A number between two others.
fn within<const LEAST: u8, const MOST: u8>(text: &str) -> Result<f64, String> {
    let value = text.parse().ok();
    let range = f64::from(LEAST)..=f64::from(MOST);
    let value = value.filter(|x| range.contains(x));
    value.ok_or_else(|| format!("a number of {LEAST} to {MOST} is needed"))
}

fn main() -> ExitCode {
    program::run(drive)
}

/// When it returns early, for example because its output is closed, nothing more is sent and the arm stays where it is.
fn drive(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let participant = Participant::join(&Network::from_env()?)?;
    let psm = if arguments.si { Psm::Si } else { Psm::Classic };
    let options = ArmOptions::default().with_kinematics(Kinematics::new(psm));
    let patience = Duration::from_secs(8);
    let mut arm = Arm::connect(Arc::new(participant), &arguments.name, options, patience)?;
    let (moves, mut words) = (!arguments.read_only, arguments.output.words());
    writeln!(
        words,
        "{} is {}, {}",
        arm.name(),
        arm.status(),
        arm.dialect()
    )?;
    if moves {
        arm.enable(patience)?;
        arm.home(Duration::from_secs(60))?;
        let tool = arm.tool().unwrap_or("not reported");
        writeln!(words, "enabled and homed; instrument {tool}")?;
    }
    let mut read = Vec::new();
    if let Some(start) = say(&arm, &mut words, &mut read)? {
        if moves {
            let away = Translation3::new(0.0, 0.0, 1e-3 * arguments.millimetres);
            for goal in [RcmFromTip(away * start.0), start] {
                arm.start_line(&goal, 1e-3 * arguments.speed)?;
                arm.wait(Duration::from_secs(30))?;
                say(&arm, &mut words, &mut read)?;
            }
            arm.hold();
        }
    } else {
        writeln!(words, "it is not powered: no pose to read")?;
    }
    let events = arm.take_events().into_iter();
    let events: Vec<String> = events.map(|event| event.kind.to_string()).collect();
    for event in &events {
        writeln!(words, "  {event}")?;
    }
    arguments.output.object(&json!({
        "arm": arm.name(),
        "status": arm.status().to_string(),
        "dialect": arm.dialect().to_string(),
        "poses": read,
        "events": events,
    }))?;
    arm.release();
    Ok(ExitCode::SUCCESS)
}

/// Prints the feedback, and returns the pose of the tips.
fn say(
    arm: &Arm,
    words: &mut dyn Write,
    read: &mut Vec<Value>,
) -> std::io::Result<Option<RcmFromTip>> {
    let (Some(tip), Some(point)) = (arm.rcm_from_tip(), arm.control_point()) else {
        return Ok(None);
    };
    let (Some(joints), Some(jaw)) = (arm.joints(), arm.jaw()) else {
        return Ok(None);
    };
    let p = tip.value.0.translation.vector;
    let [x, y, z] = [p.x, p.y, p.z].map(|metres| 1e3 * metres);
    writeln!(
        words,
        "tips at ({x:.2}, {y:.2}, {z:.2}) mm, control point: {point}"
    )?;
    let (joints, angle) = (joints.value, jaw.value.angle);
    writeln!(words, "  joints {joints:.4?}, jaw {angle:.3} rad")?;
    read.push(json!({ "tip_mm": [x, y, z], "joints": joints, "jaw_rad": angle }));
    Ok(Some(tip.value))
}
