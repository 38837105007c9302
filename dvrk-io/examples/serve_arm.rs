//! Serves a simulated PSM over ROS 2: `cargo run --features ros2 --example serve_arm -- --help`.

use std::io::Write;
use std::process::ExitCode;
use std::time::Duration;

use dvrk_io::arm::{ControlPoint, Dialect};
use dvrk_io::serve::{ArmServer, KinematicArm, ServeOptions};
use dvrk_io::transport::{Network, Participant, Transport};
use mesh_io::program::{self, Failure, Output};
use serde_json::json;

/// Serves a kinematic PSM over ROS 2 with the topics, types and states of a dVRK, for any CRTK client
#[derive(Debug, clap::Parser)]
#[command(
    name = "serve_arm",
    after_help = "Example: serve_arm PSM1 --seconds 60

ROS_DOMAIN_ID, ROS_LOCALHOST_ONLY and ROS_AUTOMATIC_DISCOVERY_RANGE are honoured."
)]
struct Arguments {
    /// Name of the arm, the namespace of its topics
    #[arg(default_value = "PSM1")]
    name: String,
    /// Behave like the simulators of the dVRK maintainers instead of like a robot
    #[arg(long)]
    simulator: bool,
    /// Stop after this many seconds [default: run until killed]
    #[arg(long, value_name = "S", value_parser = seconds)]
    seconds: Option<Duration>,
    #[command(flatten)]
    output: Output,
}

fn seconds(text: &str) -> Result<Duration, String> {
    let seconds = program::not_negative(text)?;
    Duration::try_from_secs_f64(seconds).map_err(|error| error.to_string())
}

fn main() -> ExitCode {
    program::run(serve)
}

fn serve(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let network = Network::from_env()?;
    let participant = Participant::join(&network)?;
    let (dialect, point) = if arguments.simulator {
        (Dialect::Simulator, ControlPoint::Tip)
    } else {
        (Dialect::Robot, ControlPoint::Wrist)
    };
    let options = ServeOptions::default().with_dialect(dialect);
    let arm = KinematicArm::default();
    let mut server = ArmServer::new(&participant, &arguments.name, arm, options)?;
    // Printed at the beginning for programs that wait for the arm. The output may be closed later while clients still need the arm.
    let (name, domain, status) = (&arguments.name, network.domain(), server.status());
    program::unless_closed(writeln!(
        arguments.output.words(),
        "{name} in domain {domain}, {dialect:?}, control point: {point:?}; the arm is {status}"
    ))?;
    program::unless_closed(arguments.output.object(&json!({
        "arm": name,
        "domain": domain,
        "dialect": format!("{dialect:?}"),
        "control_point": format!("{point:?}"),
        "status": status.to_string(),
    })))?;
    let time = arguments.seconds.unwrap_or(Duration::MAX);
    let end = participant.now().saturating_add(time);
    server.run(&participant, || participant.now() >= end);
    Ok(ExitCode::SUCCESS)
}
