//! A PSM without a robot, served over ROS 2: `cargo run --features ros2 --example serve_arm -- --help`.
#![allow(clippy::print_stdout, reason = "printing is what this program is for")]

mod program;

use std::process::ExitCode;
use std::time::Duration;

use dvrk_io::Error;
use dvrk_io::arm::{ControlPoint, Dialect};
use dvrk_io::serve::{ArmServer, KinematicArm, ServeOptions};
use dvrk_io::transport::{Network, Participant, Transport};

const HELP: &str = "\
Serves a kinematic PSM over ROS 2 with the topics, types and states of a dVRK, for any CRTK client.

usage: serve_arm [NAME] [--simulator] [--seconds S]

  NAME          name of the arm, the name space of its topics; default PSM1
  --simulator   behave as the simulators of the dVRK's maintainers do, instead of as a robot
  --seconds S   stop after S seconds; default: run until killed

ROS_DOMAIN_ID, ROS_LOCALHOST_ONLY and ROS_AUTOMATIC_DISCOVERY_RANGE are honoured.
";

fn main() -> ExitCode {
    program::run(HELP, parse(), serve)
}

struct Settings {
    name: String,
    dialect: Dialect,
    time: Duration,
}

/// Nothing when help is asked for.
fn parse() -> Result<Option<Settings>, String> {
    let mut settings = Settings {
        name: "PSM1".to_owned(),
        dialect: Dialect::Robot,
        time: Duration::MAX,
    };
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--help" | "-h" => return Ok(None),
            "--simulator" => settings.dialect = Dialect::Simulator,
            "--seconds" => {
                let text = arguments.next().unwrap_or_default();
                let seconds: f64 = text.parse().map_err(|_| format!("--seconds {text}?"))?;
                settings.time = Duration::try_from_secs_f64(seconds)
                    .map_err(|error| format!("--seconds {text}: {error}"))?;
            }
            name if !name.starts_with('-') => name.clone_into(&mut settings.name),
            other => return Err(format!("{other}?")),
        }
    }
    Ok(Some(settings))
}

fn serve(settings: &Settings) -> Result<(), Error> {
    let network = Network::from_env()?;
    let participant = Participant::join(&network)?;
    let options = ServeOptions::default().with_dialect(settings.dialect);
    let arm = KinematicArm::default();
    let mut server = ArmServer::new(&participant, &settings.name, arm, options)?;
    let point = match settings.dialect {
        Dialect::Robot => ControlPoint::Wrist,
        Dialect::Simulator => ControlPoint::Tip,
    };
    println!(
        "{} in domain {}, {:?}, control point: {point:?}; the arm is {}",
        settings.name,
        network.domain(),
        settings.dialect,
        server.status()
    );
    let end = participant.now().saturating_add(settings.time);
    server.run(&participant, || participant.now() >= end);
    Ok(())
}
