//! Drives a PSM over ROS 2, real or served: `cargo run --features ros2 --example arm -- --help`.
#![allow(clippy::print_stdout, reason = "printing is what this program is for")]

mod program;

use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

use dvrk_io::arm::{Arm, ArmOptions};
use dvrk_io::kinematics::{Kinematics, RcmFromTip};
use dvrk_io::nalgebra::Translation3;
use dvrk_io::transport::{Network, Participant};
use dvrk_io::{Error, Psm};

const HELP: &str = "\
Connects to a PSM, enables and homes it, reads it, and moves its tips along the remote centre's z axis and back.
THE ARM MOVES. Keep the emergency stop at hand; the instrument must be at least 45 mm past the remote centre.

usage: arm [NAME] [--si] [--millimetres D] [--speed V] [--read-only]

  NAME             name of the arm; default PSM1
  --si             an S or Si; default: a Classic
  --millimetres D  how far, 0 to 20; default 5
  --speed V        in mm/s, 1 to 50; default 10
  --read-only      connect and read, command nothing

ROS_DOMAIN_ID, ROS_LOCALHOST_ONLY and ROS_AUTOMATIC_DISCOVERY_RANGE are honoured.
";

struct Settings {
    name: String,
    psm: Psm,
    way: f64,
    speed: f64,
    moves: bool,
}

fn main() -> ExitCode {
    program::run(HELP, parse(), run)
}

/// Nothing when help is asked for.
fn parse() -> Result<Option<Settings>, String> {
    let mut settings = Settings {
        name: "PSM1".to_owned(),
        psm: Psm::Classic,
        way: 0.005,
        speed: 0.01,
        moves: true,
    };
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        let mut number = |least: f64, most: f64| {
            let text = arguments.next().unwrap_or_default();
            let value = text.parse().ok().filter(|x| (least..=most).contains(x));
            value.ok_or(format!(
                "{argument} {text}: a number of {least} to {most} is needed"
            ))
        };
        match argument.as_str() {
            "--help" | "-h" => return Ok(None),
            "--si" => settings.psm = Psm::Si,
            "--read-only" => settings.moves = false,
            "--millimetres" => settings.way = 1e-3 * number(0.0, 20.0)?,
            "--speed" => settings.speed = 1e-3 * number(1.0, 50.0)?,
            name if !name.starts_with('-') => name.clone_into(&mut settings.name),
            other => return Err(format!("{other}?")),
        }
    }
    Ok(Some(settings))
}

fn run(settings: &Settings) -> Result<(), Error> {
    let participant = Participant::join(&Network::from_env()?)?;
    let options = ArmOptions::default().with_kinematics(Kinematics::new(settings.psm));
    let patience = Duration::from_secs(8);
    let mut arm = Arm::connect(Arc::new(participant), &settings.name, options, patience)?;
    println!("{} is {}, {:?}", arm.name(), arm.status(), arm.dialect());
    if settings.moves {
        arm.enable(patience)?;
        arm.home(Duration::from_secs(60))?;
        println!(
            "enabled and homed; instrument {}",
            arm.tool().unwrap_or("not reported")
        );
    }
    let Some(start) = read(&arm) else {
        println!("it is not powered: no pose to read");
        return Ok(());
    };
    if settings.moves {
        let away = Translation3::new(0.0, 0.0, settings.way);
        for goal in [RcmFromTip(away * start.0), start] {
            arm.start_line(&goal, settings.speed)?;
            arm.wait(Duration::from_secs(30))?;
            read(&arm);
        }
        arm.hold();
    }
    for event in arm.take_events() {
        println!("  {:?}", event.kind);
    }
    arm.release();
    Ok(())
}

/// Prints what there is, and returns where the tips are.
fn read(arm: &Arm) -> Option<RcmFromTip> {
    let tip = arm.rcm_from_tip()?.value;
    let p = 1e3 * tip.0.translation.vector;
    println!(
        "tips at ({:.2}, {:.2}, {:.2}) mm, control point: {:?}",
        p.x,
        p.y,
        p.z,
        arm.control_point()?
    );
    println!(
        "  joints {:.4?}, jaw {:.3} rad",
        arm.joints()?.value,
        arm.jaw()?.value.angle
    );
    Some(tip)
}
