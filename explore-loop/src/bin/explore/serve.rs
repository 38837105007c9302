//! `explore serve`: serves the simulated cell as a dVRK over ROS 2.
//!
//! ```text
//! any CRTK client ◄── DDS ──► ArmServer (a thread, every 2 ms) ── set-points ──► physics (this thread, in step with the clock)
//!                                  ▲                                                │
//!                                  └── poses of tips and jaws ◄────────────────────┴──► depth images
//! ```
//! Physics advances with the wall clock. When it cannot keep up, time is skipped: the body then moves as if the arms were faster than they are. A
//! message reports this.

use crate::object::ObjectArgs;
use crate::recorder::interruption;
use crate::run::scene;
use crate::{Camera, Failure};
use dvrk_io::arm::Dialect;
use dvrk_io::kinematics::RcmFromWrist;
use dvrk_io::nalgebra::Isometry3;
use dvrk_io::serve::{ArmServer, DepthServer, ServeOptions, ServedArm};
use dvrk_io::transport::{Interfaces, Network, Participant, Transport};
use explore_loop::cell::dvrk::{
    ArmEntry, CameraEntry, CellFile, Direction, JawEntry, Kind, NetworkEntry, PoseEntry, Positive,
    TableEntry,
};
use explore_loop::cell::sim::{ArmModel, PsmStand, SimCell};
use explore_loop::cell::{Cell, CellError};
use mesh_io::program::{Output, unless_closed};
use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

#[derive(Debug, clap::Args)]
#[command(after_help = "Example: explore serve --scene liver --write-cell cell.toml")]
pub(crate) struct ServeArgs {
    #[command(flatten)]
    object: ObjectArgs,
    /// Number of arms
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u8).range(2..=3))]
    arms: u8,
    /// Seed of the random numbers
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// The depth camera
    #[arg(long, value_enum, default_value_t = Camera::Ideal)]
    camera: Camera,
    /// Standard deviation of the depth noise of the ideal camera, mm
    #[arg(long, value_name = "MM", default_value_t = 0.5, value_parser = crate::not_negative)]
    noise: f64,
    /// About how many tetrahedra the body has; fewer are faster to simulate
    #[arg(long, value_name = "N", default_value_t = 2000)]
    tetrahedra: usize,
    /// Behave like the simulators of the dVRK maintainers instead of like a robot
    #[arg(long)]
    simulator: bool,
    /// ROS domain; the default is `ROS_DOMAIN_ID`
    #[arg(long, value_name = "ID")]
    domain: Option<u16>,
    /// Communicate within this machine only
    #[arg(long)]
    loopback: bool,
    /// Write the cell file with which `explore robot` explores this cell
    #[arg(long, value_name = "FILE")]
    write_cell: Option<PathBuf>,
    /// Stop after this long, seconds; the default is to run until Ctrl-C
    #[arg(long, value_name = "SECONDS", value_parser = crate::positive)]
    seconds: Option<f64>,
    #[command(flatten)]
    output: Output,
}

/// Topics and frame of the camera, named as by a `RealSense`.
const TOPICS: [&str; 2] = ["/camera/depth/image_rect_raw", "/camera/depth/camera_info"];
const FRAME: &str = "camera_depth_optical_frame";
/// A jaw counts as open above the first angle, and grips what is between its fingers below the second, radians.
const OPEN: f64 = 0.5;
const CLOSED: f64 = 0.1;
/// Angle of a jaw that holds something, radians, and its torque for each radian between that angle and the commanded one, N·m.
const THICKNESS: f64 = 0.2;
const STIFFNESS: f64 = 0.5;
/// How far physics may be behind the clock before time is skipped, seconds; the interval at which the pace is checked.
const BEHIND: f64 = 0.1;
const TOLD: Duration = Duration::from_secs(10);
/// Share of real time below which physics does not keep up.
const KEEPS_UP: f64 = 0.95;

/// Data exchanged between the network and the physics, for one arm.
#[derive(Debug, Clone, Copy)]
struct Link {
    wanted: RcmFromWrist,
    wanted_jaw: f64,
    measured: RcmFromWrist,
    jaw: f64,
}

type Links = Arc<Mutex<Vec<Link>>>;

fn lock(links: &Links) -> MutexGuard<'_, Vec<Link>> {
    links.lock().unwrap_or_else(PoisonError::into_inner)
}

/// An arm of the simulated cell, as the server sees it.
struct SimArm {
    links: Links,
    arm: usize,
}

impl ServedArm for SimArm {
    fn follow(&mut self, wrist: &RcmFromWrist, jaw: f64, _: Duration) {
        let mut links = lock(&self.links);
        let link = &mut links[self.arm];
        (link.wanted, link.wanted_jaw) = (*wrist, jaw);
    }

    fn rcm_from_wrist(&self) -> RcmFromWrist {
        lock(&self.links)[self.arm].measured
    }

    fn jaw(&self) -> f64 {
        lock(&self.links)[self.arm].jaw
    }

    fn jaw_effort(&self) -> f64 {
        let link = lock(&self.links)[self.arm];
        STIFFNESS * (link.wanted_jaw - link.jaw)
    }

    fn tool(&self) -> Option<String> {
        Some("LARGE_NEEDLE_DRIVER:420006".to_owned())
    }
}

/// Serves until Ctrl-C.
pub(crate) fn serve(args: &ServeArgs) -> Result<ExitCode, Failure> {
    let stop = interruption()?;
    let network = network(args)?;
    let mut options = scene(&args.object, args.arms, args.camera, args.noise, args.seed)?;
    options.arm_model = ArmModel::Psm;
    options.fidelity.tetrahedra = args.tetrahedra;
    let (mut cell, _truth) = SimCell::new(&options)?;
    let stands = cell.psms();
    if let Some(path) = &args.write_cell {
        let text = cell_file(&cell, &stands, &network)?.to_toml()?;
        std::fs::write(path, text).map_err(|error| format!("{}: {error}", path.display()))?;
    }
    let participant = Participant::join(&network)?;
    let links = links(&stands)?;
    let dialect = if args.simulator {
        Dialect::Simulator
    } else {
        Dialect::Robot
    };
    let mut servers = Vec::new();
    for (arm, stand) in stands.iter().enumerate() {
        let options = ServeOptions::default()
            .with_kinematics(stand.kinematics)
            .with_dialect(dialect)
            .with_joints(stand.waiting)
            .with_jaw(JawEntry::default().open);
        let links = Arc::clone(&links);
        let arm = SimArm { links, arm };
        servers.push(ArmServer::new(&participant, &stand.name, arm, options)?);
    }
    let intrinsics = cell.intrinsics()?;
    let camera = DepthServer::new(&participant, TOPICS, FRAME, &intrinsics, true)?;
    if !args.output.quiet {
        tell(args, &stands, &network)?;
    }
    unless_closed(args.output.object(&served(&stands, &network)))?;
    let ended = Arc::new(AtomicBool::new(false));
    let arms = {
        let (ended, transport) = (Arc::clone(&ended), participant.clone());
        std::thread::spawn(move || {
            while !ended.load(Ordering::Relaxed) {
                let now = transport.now();
                for server in &mut servers {
                    server.tick(now);
                }
                transport.wait(now + Duration::from_millis(2));
            }
        })
    };
    let end = args
        .seconds
        .map(|s| Instant::now() + Duration::from_secs_f64(s));
    let over = || stop.load(Ordering::Relaxed) || end.is_some_and(|end| Instant::now() >= end);
    let ran = run(&mut cell, &stands, &links, camera, &participant, over);
    ended.store(true, Ordering::Relaxed);
    if arms.join().is_err() {
        return Err("the thread that serves the arms has failed".into());
    }
    ran?;
    Ok(ExitCode::SUCCESS)
}

fn network(args: &ServeArgs) -> Result<Network, Failure> {
    let mut network = Network::from_env()?;
    if let Some(domain) = args.domain {
        network = network.with_domain(domain)?;
    }
    if args.loopback {
        network = network.with_interfaces(Interfaces::Loopback);
    }
    Ok(network)
}

fn links(stands: &[PsmStand]) -> Result<Links, Failure> {
    let link = |stand: &PsmStand| {
        let wrist = stand.kinematics.rcm_from_wrist(&stand.waiting)?;
        let jaw = JawEntry::default().open;
        Ok::<_, dvrk_io::Error>(Link {
            wanted: wrist,
            wanted_jaw: jaw,
            measured: wrist,
            jaw,
        })
    };
    let links: Result<Vec<_>, _> = stands.iter().map(link).collect();
    Ok(Arc::new(Mutex::new(links?)))
}

/// Runs physics and camera in step with the clock.
fn run(
    cell: &mut SimCell,
    stands: &[PsmStand],
    links: &Links,
    mut camera: DepthServer,
    transport: &Participant,
    over: impl Fn() -> bool,
) -> Result<(), Failure> {
    let (step, period) = (cell.step_seconds(), 1.0 / cell.frame_rate());
    let start = Instant::now();
    // Seconds simulated, seconds skipped, and when the next frame is due.
    let (mut simulated, mut left_out, mut due) = (0.0, 0.0, 0.0);
    let mut told = (Instant::now(), 0.0);
    while !over() {
        let now = start.elapsed().as_secs_f64();
        let behind = now - left_out - simulated;
        if behind < step {
            std::thread::sleep(Duration::from_secs_f64(step - behind));
            continue;
        }
        if behind > BEHIND {
            left_out += behind - BEHIND;
        }
        advance(cell, stands, links)?;
        simulated += step;
        if now >= due {
            due = now.max(due + period);
            let stamp = transport.now();
            let image = cell.depth_image()?;
            // An image that could not be sent is skipped.
            let _unsent = camera.publish(stamp, &image);
        }
        let (last, then) = told;
        if last.elapsed() >= TOLD {
            let pace = (simulated - then) / last.elapsed().as_secs_f64();
            if pace < KEEPS_UP {
                eprintln!(
                    "physics does not keep up: {pace:.2} of real time; use fewer --tetrahedra"
                );
            }
            told = (Instant::now(), simulated);
        }
    }
    Ok(())
}

/// One step of the physics: tips to their set-points, jaws opened and closed.
fn advance(cell: &mut SimCell, stands: &[PsmStand], links: &Links) -> Result<(), CellError> {
    let wanted = lock(links).clone();
    let tip = |(stand, link): (&PsmStand, &Link)| -> Isometry3<f64> {
        stand.camera_from_rcm * stand.kinematics.tip_of(&link.wanted).0
    };
    let tips: Vec<_> = stands.iter().zip(&wanted).map(tip).collect();
    cell.drive(&tips)?;
    for (arm, link) in wanted.iter().enumerate() {
        let was = lock(links)[arm].jaw;
        if link.wanted_jaw >= OPEN {
            if was < OPEN {
                cell.open_jaw(arm)?;
            }
        } else if link.wanted_jaw <= CLOSED && was > CLOSED && !cell.holds(arm) {
            match cell.close_jaw(arm) {
                Ok(()) | Err(CellError::NothingGrasped { .. }) => {}
                Err(error) => return Err(error),
            }
        }
        let held = if cell.holds(arm) {
            THICKNESS
        } else {
            f64::NEG_INFINITY
        };
        let mut links = lock(links);
        links[arm].measured = link.wanted;
        links[arm].jaw = link.wanted_jaw.max(held);
    }
    Ok(())
}

/// The cell file with which `explore robot` explores this cell.
fn cell_file(cell: &SimCell, stands: &[PsmStand], network: &Network) -> Result<CellFile, Failure> {
    let table = cell.info().table;
    let camera = CameraEntry {
        frame: FRAME.to_owned(),
        rate: Positive::new(cell.frame_rate())?,
        image: Some(TOPICS[0].to_owned()),
        info: Some(TOPICS[1].to_owned()),
        colour: None,
        cloud: None,
        arm_clearance: Positive::new(0.004)?,
    };
    let mut arms = Vec::new();
    for (stand, info) in stands.iter().zip(&cell.info().arms) {
        arms.push(ArmEntry {
            name: stand.name.clone(),
            kind: Kind::Si,
            home: stand.waiting,
            calibration: None,
            calibrated: None,
            camera_from_base: Some(PoseEntry(stand.camera_from_rcm)),
            tool: None,
            jaw: JawEntry {
                radius: Positive::new(info.jaw_radius)?,
                ..JawEntry::default()
            },
        });
    }
    let mut file = CellFile::new(camera, arms);
    file.network = Some(NetworkEntry {
        domain: network.domain(),
        loopback: *network.interfaces() == Interfaces::Loopback,
        interfaces: match network.interfaces() {
            Interfaces::Only(addresses) => addresses.clone(),
            _ => Vec::new(),
        },
    });
    file.table = Some(TableEntry {
        normal: Direction(table.normal),
        offset: table.offset,
    });
    file.limits.speed = Positive::new(0.1)?;
    Ok(file)
}

/// What is served, as JSON.
fn served(stands: &[PsmStand], network: &Network) -> serde_json::Value {
    let arms = stands.iter().map(|stand| {
        let centre = stand.camera_from_rcm;
        serde_json::json!({
            "name": stand.name,
            "remote_centre_m": <[f64; 3]>::from(centre.translation.vector),
            "quaternion_xyzw": <[f64; 4]>::from(centre.rotation.coords),
        })
    });
    serde_json::json!({
        "domain": network.domain(),
        "arms": arms.collect::<Vec<_>>(),
        "depth_image": TOPICS[0],
        "camera_info": TOPICS[1],
    })
}

/// Prints what a client has to know.
fn tell(args: &ServeArgs, stands: &[PsmStand], network: &Network) -> Result<(), Failure> {
    let mut out = args.output.words();
    let machine = if *network.interfaces() == Interfaces::Loopback {
        ", this machine only"
    } else {
        ""
    };
    writeln!(out, "domain {}{machine}", network.domain())?;
    for stand in stands {
        let name = &stand.name;
        let (p, q) = (
            stand.camera_from_rcm.translation.vector,
            stand.camera_from_rcm.rotation.coords,
        );
        writeln!(
            out,
            "/{name}  S or Si, large needle driver, {}; remote centre in the camera frame: [{:.4}, {:.4}, {:.4}] m, quaternion (xyzw) [{:.4}, {:.4}, {:.4}, {:.4}]",
            if args.simulator {
                "as a simulator"
            } else {
                "as a robot: enable and home it"
            },
            p.x,
            p.y,
            p.z,
            q.x,
            q.y,
            q.z,
            q.w
        )?;
    }
    writeln!(
        out,
        "  read     operating_state measured_cp setpoint_cp local/measured_cp measured_cv measured_js setpoint_js jaw/measured_js jaw/setpoint_js tool_type error warning"
    )?;
    writeln!(
        out,
        "  command  state_command servo_cp move_cp jaw/servo_jp jaw/move_jp hold; a jaw closed below {CLOSED} rad holds what is between its fingers, above {OPEN} rad lets go"
    )?;
    writeln!(out, "{}  16UC1, mm, frame {FRAME}", TOPICS[0])?;
    writeln!(out, "{}", TOPICS[1])?;
    if let Some(path) = &args.write_cell {
        writeln!(out, "explore it: explore robot {}", path.display())?;
    }
    writeln!(out, "serving; Ctrl-C ends it")?;
    Ok(out.flush()?)
}
