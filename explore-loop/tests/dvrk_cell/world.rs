//! Two served arms and a depth camera before a ball on a table.

use std::collections::HashMap;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread::ThreadId;
use std::time::Duration;

use dvrk_io::arm::Mode;
use dvrk_io::depth::{DepthImage, Intrinsics};
use dvrk_io::kinematics::RcmFromWrist;
use dvrk_io::serve::{ArmServer, DepthServer, KinematicArm, ServeOptions, ServedArm};
use dvrk_io::transport::{Bus, BusNode, Peer, Publisher, Subscriber, Topic, Transport};
use explore_loop::cell::dvrk::{CellFile, DvrkCell, Preflight};
use explore_loop::nalgebra::{Point3, Vector3};

/// Middle and radius of the ball, metres, camera frame.
pub const BALL: Point3<f64> = Point3::new(0.0, 0.0, 0.53);
pub const RADIUS: f64 = 0.04;
/// Depth of the table in the file of the cell.
const TABLE: f64 = 0.55;
const SIZE: [usize; 2] = [200, 150];

/// An arm that follows at once, unless it is stuck, and whose jaw closes as far as what is between its fingers.
struct Plant {
    inner: KinematicArm,
    stuck: bool,
    thickness: f64,
    bare: bool,
}

impl ServedArm for Plant {
    fn follow(&mut self, wrist: &RcmFromWrist, jaw: f64, time: Duration) {
        if !self.stuck {
            self.inner.follow(wrist, jaw.max(self.thickness), time);
        }
    }

    fn rcm_from_wrist(&self) -> RcmFromWrist {
        self.inner.rcm_from_wrist()
    }

    fn jaw(&self) -> f64 {
        self.inner.jaw()
    }

    fn tool(&self) -> Option<String> {
        self.inner.tool().filter(|_| !self.bare)
    }
}

/// Lets the time of a bus pass when every thread waits for it: no thread misses a tick because the machine has other things to do.
///
/// A thread that computes for long, or has ended, holds up the others for 5 ms of the clock on the wall for each of theirs.
#[derive(Clone)]
struct Clock {
    bus: Bus,
    until: Arc<(Mutex<HashMap<ThreadId, Duration>>, Condvar)>,
}

const PATIENCE: Duration = Duration::from_millis(5);
const STEP: Duration = Duration::from_millis(1);

impl Clock {
    /// How many threads have ever waited.
    fn waiting(&self) -> usize {
        let threads = self.until.0.lock();
        threads.unwrap_or_else(PoisonError::into_inner).len()
    }

    fn wait(&self, until: Duration) {
        let (threads, passed) = &*self.until;
        let mut threads = threads.lock().unwrap_or_else(PoisonError::into_inner);
        threads.insert(std::thread::current().id(), until);
        while self.bus.now() < until {
            let now = self.bus.now();
            let mut late = false;
            if !threads.values().all(|until| *until > now) {
                let waited = passed.wait_timeout(threads, PATIENCE);
                let (guard, result) = waited.unwrap_or_else(PoisonError::into_inner);
                (threads, late) = (guard, result.timed_out());
            }
            if late || threads.values().all(|until| *until > self.bus.now()) {
                self.bus.advance(STEP);
                passed.notify_all();
            }
        }
    }
}

/// A node whose waits are those of the clock.
struct Node {
    inner: BusNode,
    clock: Clock,
}

impl Transport for Node {
    fn now(&self) -> Duration {
        self.inner.now()
    }

    fn wait(&self, until: Duration) {
        self.clock.wait(until);
    }

    fn subscribe(&self, topic: &Topic) -> Result<Box<dyn Subscriber>, dvrk_io::Error> {
        self.inner.subscribe(topic)
    }

    fn advertise(&self, topic: &Topic) -> Result<Box<dyn Publisher>, dvrk_io::Error> {
        self.inner.advertise(topic)
    }

    fn writers(&self, name: &str) -> Vec<Peer> {
        self.inner.writers(name)
    }

    fn readers(&self, name: &str) -> Vec<Peer> {
        self.inner.readers(name)
    }
}

struct Served {
    server: ArmServer<Plant>,
    silent: bool,
}

type Arms = Arc<Mutex<Vec<Served>>>;

pub struct World {
    pub bus: Bus,
    clock: Clock,
    file: CellFile,
    arms: Arms,
    camera_silent: Arc<AtomicBool>,
}

/// The cell of the example, with ten frames a second.
fn file() -> CellFile {
    let mut file =
        CellFile::parse(include_str!("../../doc/CELL.toml"), Path::new("CELL.toml")).unwrap();
    file.network = None;
    file
}

fn image(camera: &Intrinsics) -> DepthImage {
    let depth = |row: usize, column: usize| {
        let ray: Vector3<f64> = camera.back_project(column as f64, row as f64, 1.0).coords;
        let (a, b) = (ray.norm_squared(), ray.dot(&BALL.coords));
        let root = b * b - a * (BALL.coords.norm_squared() - RADIUS * RADIUS);
        let ball = if root >= 0.0 {
            (b - root.sqrt()) / a
        } else {
            f64::INFINITY
        };
        ball.min(TABLE) as f32
    };
    let [width, height] = SIZE;
    let pixels = (0..height).flat_map(|row| (0..width).map(move |column| (row, column)));
    let depths: Vec<f32> = pixels.map(|(row, column)| depth(row, column)).collect();
    DepthImage::from_metres(width, height, &depths).unwrap()
}

impl World {
    pub fn new() -> Self {
        Self::of(file())
    }

    /// With what a file says that differs from the example.
    pub fn with(change: impl FnOnce(&mut CellFile)) -> Self {
        let mut file = file();
        change(&mut file);
        Self::of(file)
    }

    fn of(file: CellFile) -> Self {
        let bus = Bus::new();
        let serve = |entry: &explore_loop::cell::dvrk::ArmEntry| {
            let options = ServeOptions::default()
                .with_kinematics(entry.kinematics().unwrap())
                .with_joints(entry.home)
                .with_jaw(entry.jaw.open);
            let plant = Plant {
                inner: KinematicArm::default(),
                stuck: false,
                thickness: f64::NEG_INFINITY,
                bare: false,
            };
            Served {
                server: ArmServer::new(&bus.node(), &entry.name, plant, options).unwrap(),
                silent: false,
            }
        };
        let arms: Arms = Arc::new(Mutex::new(file.arm.iter().map(serve).collect()));
        let served = Arc::clone(&arms);
        bus.every(Duration::from_millis(2), move |now| {
            for arm in served.lock().unwrap().iter_mut().filter(|arm| !arm.silent) {
                arm.server.tick(now);
            }
        });
        let [width, height] = SIZE;
        let intrinsics = Intrinsics::new(width, height, [250.0; 2], [99.5, 74.5]).unwrap();
        let topics = [&file.camera.image, &file.camera.info].map(|topic| topic.as_deref().unwrap());
        let mut camera =
            DepthServer::new(&bus.node(), topics, &file.camera.frame, &intrinsics, true).unwrap();
        let camera_silent = Arc::new(AtomicBool::new(false));
        let (silent, image) = (Arc::clone(&camera_silent), image(&intrinsics));
        bus.every(Duration::from_millis(33), move |now| {
            if !silent.load(Ordering::Relaxed) {
                camera.publish(now, &image).unwrap();
            }
        });
        let clock = Clock {
            bus: bus.clone(),
            until: Arc::default(),
        };
        Self {
            bus,
            clock,
            file,
            arms,
            camera_silent,
        }
    }

    /// Seconds.
    pub fn now(&self) -> f64 {
        self.bus.now().as_secs_f64()
    }

    /// Lets time pass as a loop does that computes: the threads of the arms run, and nobody calls the cell.
    pub fn compute_for(&self, seconds: f64) {
        let until = self.bus.now() + Duration::from_secs_f64(seconds);
        self.clock.wait(until);
    }

    pub fn preflight(&self) -> Preflight {
        let node = || -> Arc<dyn Transport> {
            Arc::new(Node {
                inner: self.bus.node(),
                clock: self.clock.clone(),
            })
        };
        Preflight::run(&self.file, &node, None)
    }

    /// Powered and homed.
    pub fn cell(&self) -> DvrkCell {
        self.start(self.preflight())
    }

    /// The same. A thread that drives an arm holds the time up only once it has begun to wait: until all have, none passes for the test.
    pub fn start(&self, preflight: Preflight) -> DvrkCell {
        let cell = preflight.start().unwrap();
        while self.clock.waiting() < 1 + self.file.arm.len() {
            std::thread::sleep(PATIENCE);
        }
        self.compute_for(0.1);
        cell
    }

    fn arm<T>(&self, arm: usize, act: impl FnOnce(&mut Served) -> T) -> T {
        act(&mut self.arms.lock().unwrap()[arm])
    }

    pub fn is_powered(&self, arm: usize) -> bool {
        self.arm(arm, |arm| arm.server.status().mode == Mode::Enabled)
    }

    pub fn jaws(&self) -> [f64; 2] {
        [0, 1].map(|arm| self.arm(arm, |arm| arm.server.arm().jaw()))
    }

    pub fn tips(&self) -> [RcmFromWrist; 2] {
        [0, 1].map(|arm| self.arm(arm, |arm| arm.server.arm().rcm_from_wrist()))
    }

    /// The jaw closes no farther than this, radians.
    pub fn put_between(&self, arm: usize, thickness: f64) {
        self.arm(arm, |arm| arm.server.arm().thickness = thickness);
    }

    pub fn stick(&self, arm: usize, stuck: bool) {
        self.arm(arm, |arm| arm.server.arm().stuck = stuck);
    }

    pub fn fail(&self, arm: usize, reason: &str) {
        let now = self.bus.now();
        self.arm(arm, |arm| arm.server.fail(now, reason));
    }

    pub fn take_instrument_out(&self, arm: usize) {
        self.arm(arm, |arm| arm.server.arm().bare = true);
    }

    pub fn clutch(&self, arm: usize, pressed: bool) {
        let now = self.bus.now();
        self.arm(arm, |arm| arm.server.clutch(now, pressed));
    }

    pub fn silence_arm(&self, arm: usize, silent: bool) {
        self.arm(arm, |arm| arm.silent = silent);
    }

    pub fn silence_camera(&self, silent: bool) {
        self.camera_silent.store(silent, Ordering::Relaxed);
    }
}
