//! The checks before anything moves, each with its finding.

use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use dvrk_io::Error;
use dvrk_io::arm::{Arm, ArmOptions, ProfileLimits};
use dvrk_io::camera::{Camera, CameraOptions};
use dvrk_io::kinematics::{PsmWorkspace, SafetyMargins};
use dvrk_io::transport::Transport;
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};

use super::cell::{Driven, DvrkCell};
use super::checks;
use super::entries::ArmEntry;
use super::file::CellFile;
use super::interlock::Interlock;
use crate::cell::CellError;
use crate::cell::see::{Eye, links};

/// Latched states that were published earlier arrive with the next heartbeat of DDS, up to 3 s later.
const PATIENCE: Duration = Duration::from_secs(8);
/// Time in which further latched messages arrive after the first.
const SETTLES: Duration = Duration::from_millis(300);
/// Fewest points that count as an object.
const FEWEST: usize = 20;
/// Least height of a waiting tip above the table, metres.
const HOME_HEIGHT: f64 = 0.03;
/// Height above the centre of the object that arms must reach, metres.
const ABOVE: f64 = 0.02;

/// One check.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Check {
    /// What is checked.
    pub what: String,
    /// What was found, or why the check failed.
    pub found: Result<String, String>,
}

impl fmt::Display for Check {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.found {
            Ok(found) => write!(f, "ok       {}: {found}", self.what),
            Err(why) => write!(f, "NOT OK   {}: {why}", self.what),
        }
    }
}

/// The list of checks, and the connections made for it.
pub struct Preflight {
    checks: Vec<Check>,
    file: CellFile,
    arms: Vec<(ArmEntry, Arm)>,
    camera: Option<Camera>,
    eye: Eye,
    transport: Arc<dyn Transport>,
}

impl fmt::Debug for Preflight {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Preflight")
            .field("checks", &self.checks)
            .finish_non_exhaustive()
    }
}

impl Preflight {
    /// Connects to what a file names and checks it; commands nothing. `node` returns a network endpoint for each arm and for the camera; `seed` is
    /// a point on or next to the object where there are several, camera frame.
    pub fn run(
        file: &CellFile,
        node: &dyn Fn() -> Arc<dyn Transport>,
        seed: Option<Point3<f64>>,
    ) -> Self {
        let mut preflight = Self {
            checks: Vec::new(),
            file: file.clone(),
            arms: Vec::new(),
            camera: None,
            eye: Eye::new(
                file.table.map(|table| table.plane()),
                file.camera.arm_clearance.get(),
                seed,
            ),
            transport: node(),
        };
        for entry in &file.arm {
            preflight.arm(entry, node());
        }
        let seen = preflight.camera(node());
        preflight.table();
        preflight.object(seen.as_deref());
        preflight
    }

    /// The checks, in order.
    pub fn checks(&self) -> &[Check] {
        &self.checks
    }

    /// Whether all checks passed.
    pub fn is_ok(&self) -> bool {
        self.checks.iter().all(|check| check.found.is_ok())
    }

    /// Powers and homes the arms: **they may move**. From then on each has a thread that drives and watches it.
    ///
    /// # Errors
    /// [`CellError::Failed`] when a check failed; [`CellError::ArmFault`] for an arm that cannot be powered or homed.
    pub fn start(self) -> Result<DvrkCell, CellError> {
        let failed = self.checks.iter().find(|check| check.found.is_err());
        if let Some(check) = failed {
            return Err(CellError::Failed(check.to_string()));
        }
        let (Some(camera), Some(table)) = (self.camera, self.eye.table()) else {
            return Err(CellError::Failed("no camera or no table".into()));
        };
        let interlock = Interlock::default();
        let mut driven = Vec::new();
        for (index, (entry, mut arm)) in self.arms.into_iter().enumerate() {
            let ready = arm.enable(PATIENCE);
            let ready = ready.and_then(|()| arm.home(Duration::from_secs(60)));
            ready.map_err(|error| CellError::ArmFault {
                arm: index,
                reason: error.to_string(),
            })?;
            driven.push(Driven::new(entry, arm, interlock.look(index))?);
        }
        let transport = self.transport;
        DvrkCell::new(
            &self.file, driven, camera, self.eye, table, transport, interlock,
        )
    }

    fn say(&mut self, what: impl Into<String>, found: Result<String, String>) -> bool {
        let ok = found.is_ok();
        let what = what.into();
        self.checks.push(Check { what, found });
        ok
    }

    fn arm(&mut self, entry: &ArmEntry, transport: Arc<dyn Transport>) {
        let name = &entry.name;
        let known = checks::calibration(&self.file, entry);
        self.say(format!("{name}, calibration"), known);
        let limits = checks::limits(&self.file, entry);
        self.say(format!("{name}, limits"), limits);
        let clock = Arc::clone(&transport);
        let connected = options(&self.file, entry)
            .and_then(|options| Arm::connect(transport, name, options, PATIENCE));
        let mut arm = match connected {
            Ok(arm) => arm,
            Err(error) => {
                self.say(format!("{name}, streams"), Err(error.to_string()));
                return;
            }
        };
        // Of the latched states the last one counts; they arrive one after the other.
        let settled = clock.now() + SETTLES;
        while clock.now() < settled {
            arm.tick();
            clock.wait(clock.now() + Duration::from_millis(5));
        }
        self.say(format!("{name}, streams"), Ok("all there".into()));
        self.say(format!("{name}, state"), checks::state(&arm));
        self.say(format!("{name}, clock"), checks::clocks(&arm, clock.now()));
        self.say(
            format!("{name}, other commanders"),
            checks::nobody_else(&arm),
        );
        self.say(format!("{name}, jaw"), checks::empty(&arm, entry));
        self.say(format!("{name}, frames"), checks::frames(&mut arm));
        self.arms.push((entry.clone(), arm));
    }

    /// The points of the object, if it is seen.
    fn camera(&mut self, transport: Arc<dyn Transport>) -> Option<Vec<Point3<f64>>> {
        let entry = self.file.camera.clone();
        let topics = match entry.topics() {
            Ok(topics) => topics,
            Err(reason) => {
                self.say("camera", Err(reason));
                return None;
            }
        };
        let now = Arc::clone(&transport);
        let opened = Camera::open(transport, &topics, CameraOptions::default());
        let framed = opened.and_then(|mut camera| Ok((camera.next_frame(PATIENCE)?, camera)));
        let (frame, camera) = match framed {
            Ok(framed) => framed,
            Err(error) => {
                self.say("camera", Err(error.to_string()));
                return None;
            }
        };
        let age = now.now().as_secs_f64() - frame.stamp.as_secs_f64();
        let what = format!(
            "{} points, {:.0} ms old, frame {}",
            frame.scan.points().len(),
            1e3 * age,
            frame.frame
        );
        let named = if frame.frame == entry.frame {
            Ok(what)
        } else {
            Err(format!("{what}, but the file has {}", entry.frame))
        };
        self.say("camera", named);
        self.camera = Some(camera);
        let mut capsules = Vec::new();
        for (entry, arm) in &self.arms {
            let Some(joints) = arm.joints() else { continue };
            let kinematics = entry.kinematics();
            let found = kinematics.and_then(|kinematics| {
                let pose = entry.camera_from_rcm();
                links(&kinematics, &pose, &joints.value, entry.jaw.radius.get())
            });
            capsules.extend(found.unwrap_or_default());
        }
        match self.eye.look(&frame.scan, &capsules) {
            Ok(seen) => Some(seen.points),
            Err(error) => {
                self.say("table", Err(error.to_string()));
                None
            }
        }
    }

    fn table(&mut self) {
        let Some(table) = self.eye.table() else {
            return;
        };
        let whence = if self.file.table.is_some() {
            "given"
        } else {
            "found"
        };
        let share = self.eye.on_table().map_or_else(String::new, |share| {
            format!(", {:.0} % of the points on it", 1e2 * share)
        });
        let found = if table.offset > 0.0 {
            let offset = table.offset;
            Ok(format!("{whence}, {offset:.3} m before the camera{share}"))
        } else {
            Err(format!("{whence} behind the camera"))
        };
        self.say("table", found);
        for entry in self.file.arm.clone() {
            let name = &entry.name;
            let home = home(&entry).map_err(|error| error.to_string());
            let home = home.and_then(|pose| {
                let height = table.height(&Point3::from(pose.translation.vector));
                if height < HOME_HEIGHT {
                    return Err(format!("{:.0} mm above the table", 1e3 * height));
                }
                workspace(&entry)
                    .and_then(|space| space.reach(&pose))
                    .map(|_| format!("{:.0} mm above the table", 1e3 * height))
                    .map_err(|error| error.to_string())
            });
            self.say(format!("{name}, home"), home);
        }
    }

    fn object(&mut self, seen: Option<&[Point3<f64>]>) {
        let Some(points) = seen else { return };
        let found = if points.len() < FEWEST {
            Err(format!(
                "{} points: is there nothing on the table?",
                points.len()
            ))
        } else {
            Ok(format!("{} points", points.len()))
        };
        if !self.say("object", found) {
            return;
        }
        let Some(table) = self.eye.table() else {
            return;
        };
        let sum: Vector3<f64> = points.iter().map(|p| p.coords).sum();
        let above = sum / points.len() as f64 + table.normal.into_inner() * ABOVE;
        let down = UnitQuaternion::face_towards(&-table.normal.into_inner(), &Vector3::y());
        for entry in self.file.arm.clone() {
            // One feasible rotation of the jaws about the approach direction suffices.
            let reach = workspace(&entry).map(|space| {
                let turned = (0..8).map(|k| {
                    let about = f64::from(k) * std::f64::consts::FRAC_PI_4;
                    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), about);
                    Isometry3::from_parts(above.into(), down * turn)
                });
                let tried: Vec<_> = turned.map(|pose| space.reach(&pose)).collect();
                let ok = tried.iter().filter(|reach| reach.is_ok()).count();
                (ok, tried.into_iter().find_map(Result::err))
            });
            let found = match reach {
                Ok((0, Some(error))) | Err(error) => Err(error.to_string()),
                Ok((ok, _)) => Ok(format!("from above with {ok} of 8 rotations of the jaws")),
            };
            self.say(format!("{}, reaches the object", entry.name), found);
        }
    }
}

/// The options for driving an arm.
fn options(file: &CellFile, entry: &ArmEntry) -> Result<ArmOptions, Error> {
    let speed = file.limits.speed.get();
    let options = ArmOptions::default();
    let period = options.period.as_secs_f64();
    let motion = ProfileLimits {
        speed,
        acceleration: file.limits.acceleration.get(),
        step: (1.5 * speed * period).max(1e-3),
    };
    let jaw = [entry.jaw.closed, entry.jaw.open];
    // Plans keep margins to the limits; poses between two planned ones may be slightly nearer to a limit.
    Ok(options
        .with_kinematics(entry.kinematics()?)
        .with_motion(motion)
        .with_jaw_range(jaw)
        .with_margins(SafetyMargins::NONE))
}

/// Home pose of the tip of an arm, camera frame.
pub(super) fn home(entry: &ArmEntry) -> Result<Isometry3<f64>, Error> {
    let tip = entry.kinematics()?.rcm_from_tip(&entry.home)?;
    Ok(entry.camera_from_rcm() * tip.0)
}

/// The reachable poses of the tip of an arm.
pub(super) fn workspace(entry: &ArmEntry) -> Result<PsmWorkspace, Error> {
    let margins = SafetyMargins::default()
        .with_angle(0.02)
        .with_length(0.002)
        .with_wrist(0.02);
    PsmWorkspace::new(entry.kinematics()?, &entry.camera_from_rcm())?.with_margins(margins)
}
