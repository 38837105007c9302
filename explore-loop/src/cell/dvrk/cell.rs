//! The cell with its arms powered and homed.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use dvrk_io::Error;
use dvrk_io::arm::{Arm, ArmThread, CameraFromRcm, CameraFromTip, Stop};
use dvrk_io::camera::{Camera, CameraFrame};
use dvrk_io::depth::Capsule;
use dvrk_io::kinematics::Kinematics;
use dvrk_io::transport::Transport;
use nalgebra::{Isometry3, Point3, Translation3, Vector3};

use super::entries::ArmEntry;
use super::file::CellFile;
use super::history::History;
use super::interlock::{Interlock, goes_on_after};
use super::preflight::{home, workspace};
use crate::cell::see::{Eye, Seen, links};
use crate::cell::{ArmInfo, ArmState, Cell, CellError, CellInfo, Observation, Plane, Poses};

/// A camera that is silent for this long yields frames without points, one each period, and after `DEAD` longer the cell has failed.
const SILENT: Duration = Duration::from_secs(1);
const DEAD: Duration = Duration::from_secs(30);
/// Fraction of the period after which a frame is used: a camera slightly faster than its rate must not lose every second frame.
const NEARLY: f64 = 0.8;
/// Interval at which a new frame is checked for, and the poses of the arms recorded.
const LOOK: Duration = Duration::from_millis(5);
/// Longest time for a jaw to move, and for an arm to go home.
const JAW: Duration = Duration::from_secs(5);
const HOME: Duration = Duration::from_secs(60);
/// A jaw counts as at rest this long after its set-point was reached.
const JAW_RESTS: Duration = Duration::from_millis(300);
/// How far an arm retreats before it goes home, along its tool and upwards, metres, and the fractions of it that are tried.
const RETREAT: (f64, f64) = (0.03, 0.05);
const SHARES: [f64; 4] = [1.0, 0.5, 0.25, 0.1];

/// An arm driven by a thread of its own.
#[derive(Debug)]
pub(super) struct Driven {
    entry: ArmEntry,
    kinematics: Kinematics,
    camera_from_rcm: CameraFromRcm,
    thread: ArmThread,
    history: History,
    joints: Option<[f64; 6]>,
    /// Whether the jaw was commanded to close.
    closed: bool,
}

impl Driven {
    /// `look` is called with the arm after each tick.
    pub fn new(
        entry: ArmEntry,
        arm: Arm,
        look: impl FnMut(&mut Arm) + Send + 'static,
    ) -> Result<Self, CellError> {
        let failed = |error: Error| CellError::Failed(error.to_string());
        Ok(Self {
            kinematics: entry.kinematics().map_err(failed)?,
            camera_from_rcm: CameraFromRcm(entry.camera_from_rcm()),
            thread: ArmThread::spawn_watched(arm, look).map_err(failed)?,
            entry,
            history: History::default(),
            joints: None,
            closed: false,
        })
    }

    /// Records the pose of the arm.
    fn note(&mut self) {
        let arm = self.thread.lock();
        let (tip, joints) = (arm.rcm_from_tip(), arm.joints());
        drop(arm);
        if let Some(tip) = tip {
            let CameraFromTip(pose) = self.camera_from_rcm * tip.value;
            self.history.add(tip.stamp, pose);
        }
        self.joints = joints.map(|joints| joints.value).or(self.joints);
    }

    /// The state at an instant. A silent arm has no finite pose.
    fn state(&self, stamp: Duration) -> ArmState {
        let arm = self.thread.lock();
        let (jaw, speaks) = (arm.jaw(), arm.rcm_from_tip().is_some());
        let moving = arm.is_moving();
        drop(arm);
        let pose = self.history.at(stamp).filter(|_| speaks);
        let jaw = jaw.map(|jaw| jaw.value);
        let holds = jaw.is_some_and(|jaw| jaw.gap() > self.entry.jaw.holds_above.get());
        ArmState {
            camera_from_tip: pose.unwrap_or_else(|| {
                Isometry3::from(Translation3::new(f64::NAN, f64::NAN, f64::NAN))
            }),
            jaw: jaw.map_or(f64::NAN, |jaw| jaw.angle),
            holding: self.closed && holds,
            moving,
        }
    }

    /// The links of the arm that may be in view.
    fn links(&self) -> Result<Vec<Capsule>, Error> {
        let Some(joints) = &self.joints else {
            return Ok(Vec::new());
        };
        let opening = self.entry.jaw.radius.get();
        links(&self.kinematics, &self.camera_from_rcm.0, joints, opening)
    }

    fn here(&self) -> Option<Isometry3<f64>> {
        let tip = self.thread.lock().rcm_from_tip()?;
        Some((self.camera_from_rcm * tip.value).0)
    }

    fn go(&self, camera_from_tip: Isometry3<f64>, speed: f64) -> Result<(), Error> {
        let goal = self
            .camera_from_rcm
            .rcm_from_tip(&CameraFromTip(camera_from_tip));
        self.thread.lock().start_line(&goal, speed)
    }
}

/// A cell of dVRK arms and a depth camera: see [`dvrk`](super). Created by [`Preflight::start`](super::Preflight::start).
///
/// When it is dropped, the arms hold their positions; they stay powered, and their jaws are not moved.
pub struct DvrkCell {
    info: CellInfo,
    arms: Vec<Driven>,
    camera: Camera,
    camera_frame: String,
    eye: Eye,
    transport: Arc<dyn Transport>,
    start: Duration,
    silent_since: Option<Duration>,
    /// Stamp of the last frame that was used.
    last: Duration,
    /// Least time between two used frames.
    period: Duration,
    interlock: Interlock,
}

impl std::fmt::Debug for DvrkCell {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("DvrkCell")
            .field("info", &self.info)
            .finish_non_exhaustive()
    }
}

impl DvrkCell {
    pub(super) fn new(
        file: &CellFile,
        arms: Vec<Driven>,
        camera: Camera,
        eye: Eye,
        table: Plane,
        transport: Arc<dyn Transport>,
        interlock: Interlock,
    ) -> Result<Self, CellError> {
        let speed = file.limits.speed.get();
        let period = file.camera.period().map_err(CellError::Failed)?;
        let infos = arms.iter().map(|arm| info(&arm.entry, speed));
        let infos: Result<Vec<_>, Error> = infos.collect();
        let infos = infos.map_err(|error| CellError::Failed(error.to_string()))?;
        Ok(Self {
            info: CellInfo {
                arms: infos,
                table,
                camera_rate: file.camera.rate.get(),
            },
            arms,
            camera,
            camera_frame: file.camera.frame.clone(),
            eye,
            start: transport.now(),
            transport,
            silent_since: None,
            last: Duration::ZERO,
            period,
            interlock,
        })
    }

    /// With a flag, set from a signal handler or another thread, that stops everything: the arms hold their positions, the jaws are not moved, and
    /// every call returns [`CellError::Failed`].
    #[must_use]
    pub fn stop_flag(self, flag: Arc<AtomicBool>) -> Self {
        self.interlock.listen(flag);
        self
    }

    /// All arms hold except those stopped by a fault: these hold already, or somebody else controls them.
    fn hold(&self) {
        for (index, arm) in self.arms.iter().enumerate() {
            if self.interlock.fault_of(index).is_none() {
                arm.thread.lock().hold();
            }
        }
    }

    /// Records the poses of the arms.
    fn note(&mut self) {
        self.arms.iter_mut().for_each(Driven::note);
    }

    fn goes_on(&self) -> Result<(), CellError> {
        if self.interlock.is_asked_to_stop() {
            self.hold();
            return Err(CellError::Failed(
                "stopped: the arms hold their positions, the jaws stay as they are".into(),
            ));
        }
        Ok(())
    }

    /// # Errors
    /// An arm has a fault: no arm is commanded then.
    fn without_fault(&mut self) -> Result<(), CellError> {
        self.goes_on()?;
        self.note();
        let mut arms = 0..self.arms.len();
        let fault = arms.find_map(|arm| Some((arm, self.interlock.fault_of(arm)?)));
        fault.map_or(Ok(()), |(arm, reason)| {
            Err(CellError::ArmFault { arm, reason })
        })
    }

    /// The arm with this index, ready for a command.
    fn arm(&mut self, arm: usize) -> Result<&mut Driven, CellError> {
        self.without_fault()?;
        let count = self.arms.len();
        self.arms
            .get_mut(arm)
            .ok_or(CellError::NoSuchArm { arm, count })
    }

    /// The next frame, at least one period after the last; `None` when the camera is silent.
    fn next_frame(&mut self) -> Result<Option<CameraFrame>, CellError> {
        // A silent camera must not slow down the lowering of what is held.
        let patience = match self.silent_since {
            None => SILENT + self.period,
            Some(_) => self.period,
        };
        let end = self.transport.now() + patience;
        let least = self.last + self.period.mul_f64(NEARLY);
        loop {
            self.goes_on()?;
            self.note();
            // A frame that cannot be read is skipped.
            if let Ok(Some(frame)) = self.camera.try_frame()
                && frame.stamp >= least
            {
                self.last = frame.stamp;
                return Ok(Some(frame));
            }
            let now = self.transport.now();
            if now >= end {
                return Ok(None);
            }
            self.transport.wait(now + LOOK);
        }
    }

    /// A frame without points.
    fn blind(&mut self) -> Result<Observation, CellError> {
        let now = self.transport.now();
        let since = *self.silent_since.get_or_insert(now);
        if now > since + DEAD {
            self.hold();
            let silent = now.saturating_sub(since).as_secs_f64();
            return Err(CellError::Failed(format!(
                "the camera has been silent for {silent:.0} s"
            )));
        }
        Ok(self.observation(now, Seen::default()))
    }

    fn observation(&self, stamp: Duration, seen: Seen) -> Observation {
        Observation {
            stamp: stamp.saturating_sub(self.start).as_secs_f64(),
            camera: None,
            points: seen.points,
            colours: seen.colours,
            features: seen.features,
            arms: self.arms.iter().map(|arm| arm.state(stamp)).collect(),
        }
    }

    /// Clears the outcome of the last motion of an arm: after an obstruction the arm may go on, any other reason is a fault.
    fn ready(&self, arm: usize) -> Result<(), CellError> {
        match self.arms[arm].thread.wait(Duration::ZERO) {
            Ok(()) | Err(Error::ArmTimeout { .. }) => Ok(()),
            Err(Error::ArmStopped { reason, .. }) if goes_on_after(&reason) => Ok(()),
            Err(error) => Err(refusal(arm, error)),
        }
    }

    /// The last command must not continue if trouble had already begun: the other arms were stopped before this one started to move.
    fn unless_trouble(&mut self) -> Result<(), CellError> {
        let well = self.without_fault();
        if well.is_err() {
            self.hold();
        }
        well
    }

    /// Opens or closes a jaw to an angle and waits until it is reached.
    fn jaw(&mut self, arm: usize, angle: f64) -> Result<(), CellError> {
        let sent = self.arms[arm].thread.lock().start_jaw(angle);
        sent.map_err(|error| refusal(arm, error))?;
        self.unless_trouble()?;
        let ended = self.arms[arm].thread.wait(JAW);
        // An arm that was held does not know why.
        ended.or_else(|error| {
            self.without_fault()?;
            Err(refusal(arm, error))
        })
    }

    fn wait_for_arms(&mut self) -> Result<(), CellError> {
        let end = self.transport.now() + HOME;
        while self.arms.iter().any(|arm| arm.thread.lock().is_moving()) {
            self.without_fault()?;
            if self.transport.now() >= end {
                self.hold();
                return Err(CellError::Failed(
                    "the arms did not reach their home poses".into(),
                ));
            }
            self.transport.wait(self.transport.now() + LOOK);
        }
        (0..self.arms.len()).try_for_each(|arm| {
            let ended = self.arms[arm].thread.wait(Duration::ZERO);
            ended.map_err(|error| refusal(arm, error))
        })
    }

    /// Moves back along the tool and upwards, as far as the arm can.
    fn back_out(&self, arm: usize, speed: f64) -> Result<(), CellError> {
        let driven = &self.arms[arm];
        let Some(here) = driven.here() else {
            let reason = "it does not report its pose".to_owned();
            return Err(CellError::ArmFault { arm, reason });
        };
        let up = self.info.table.normal.into_inner();
        for share in SHARES {
            let way = up * RETREAT.1 - here.rotation * Vector3::z() * RETREAT.0;
            let clear = Translation3::from(way * share) * here;
            match driven.go(clear, speed) {
                Err(Error::Unreachable(_)) => {}
                other => return other.map_err(|error| refusal(arm, error)),
            }
        }
        Ok(())
    }
}

/// Translates an error of an arm for the loop.
fn refusal(arm: usize, error: Error) -> CellError {
    let reason = error.to_string();
    match error {
        Error::Unreachable(_) | Error::OutOfRange { .. } => CellError::BadCommand { arm, reason },
        Error::ArmStopped { reason: stop, .. } if matches!(*stop, Stop::Unreachable(_)) => {
            CellError::BadCommand { arm, reason }
        }
        _ => CellError::ArmFault { arm, reason },
    }
}

fn info(entry: &ArmEntry, speed: f64) -> Result<ArmInfo, Error> {
    let (kinematics, space) = (entry.kinematics()?, workspace(entry)?);
    let [_, _, [_, insertion], ..] = *kinematics.limits();
    Ok(ArmInfo {
        name: entry.name.clone(),
        camera_from_home: home(entry)?,
        base: Point3::from(entry.camera_from_rcm().translation.vector),
        reach: insertion + kinematics.instrument().jaw,
        poses: Some(Poses::new(move |pose| space.contains(pose))),
        jaw_radius: entry.jaw.radius.get(),
        max_speed: speed,
    })
}

impl Cell for DvrkCell {
    fn info(&self) -> &CellInfo {
        &self.info
    }

    fn observe(&mut self) -> Result<Observation, CellError> {
        let Some(frame) = self.next_frame()? else {
            return self.blind();
        };
        self.silent_since = None;
        if frame.frame != self.camera_frame {
            let (found, expected) = (frame.frame, &self.camera_frame);
            return Err(CellError::Failed(format!(
                "the images of the camera are in the frame {found}, not {expected}"
            )));
        }
        self.note();
        let links: Result<Vec<_>, Error> = self.arms.iter().map(Driven::links).collect();
        let seen = links.and_then(|links| self.eye.look(&frame.scan, &links.concat()));
        // A frame in which no object can be found has no points.
        Ok(self.observation(frame.stamp, seen.unwrap_or_default()))
    }

    fn move_arm(
        &mut self,
        arm: usize,
        camera_from_tip: Isometry3<f64>,
        speed: f64,
    ) -> Result<(), CellError> {
        self.arm(arm)?;
        self.ready(arm)?;
        match self.arms[arm].go(camera_from_tip, speed) {
            // The loop sees where the arm is, and gives up when it makes no progress.
            Err(Error::ArmStopped { reason, .. }) if matches!(*reason, Stop::Blocked { .. }) => {}
            other => other.map_err(|error| refusal(arm, error))?,
        }
        self.unless_trouble()
    }

    fn close_jaw(&mut self, arm: usize) -> Result<(), CellError> {
        self.arm(arm)?;
        self.ready(arm)?;
        let jaw = self.arms[arm].entry.jaw;
        self.jaw(arm, jaw.closed)?;
        let rest = self.transport.now() + JAW_RESTS;
        while self.transport.now() < rest {
            self.transport.wait(rest);
        }
        let angle = self.arms[arm].thread.lock().jaw();
        if angle.is_some_and(|angle| angle.value.gap() > jaw.holds_above.get()) {
            self.arms[arm].closed = true;
            return Ok(());
        }
        self.jaw(arm, jaw.open)?;
        Err(CellError::NothingGrasped { arm })
    }

    fn open_jaw(&mut self, arm: usize) -> Result<(), CellError> {
        let driven = self.arm(arm)?;
        driven.closed = false;
        let open = driven.entry.jaw.open;
        self.jaw(arm, open)
    }

    fn home(&mut self) -> Result<(), CellError> {
        for arm in 0..self.arms.len() {
            self.open_jaw(arm)?;
        }
        let speed = self.info.arms.iter().map(|arm| arm.max_speed);
        let speed = speed.fold(f64::INFINITY, f64::min);
        let away: Vec<usize> = (0..self.arms.len())
            .filter(|&arm| {
                let home = &self.info.arms[arm].camera_from_home;
                let here = self.arms[arm].here();
                here.is_none_or(|here| {
                    (here.translation.vector - home.translation.vector).norm() > 1e-3
                        || here.rotation.angle_to(&home.rotation) > 0.01
                })
            })
            .collect();
        for &arm in &away {
            self.back_out(arm, speed)?;
        }
        self.wait_for_arms()?;
        for &arm in &away {
            let home = self.info.arms[arm].camera_from_home;
            let sent = self.arms[arm].go(home, speed);
            sent.map_err(|error| refusal(arm, error))?;
        }
        self.wait_for_arms()
    }

    fn stop(&mut self) -> Result<(), CellError> {
        self.hold();
        self.goes_on()
    }
}
