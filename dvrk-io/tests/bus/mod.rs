//! A served arm on an in-process bus, in simulated time, with simulated faults.
#![allow(dead_code, reason = "each test takes what it needs")]

use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

use dvrk_io::arm::{Arm, ArmOptions, Stop};
use dvrk_io::kinematics::{RcmFromTip, RcmFromWrist};
use dvrk_io::nalgebra::{Isometry3, Translation3};
use dvrk_io::serve::{ArmServer, KinematicArm, ServeOptions, ServedArm};
use dvrk_io::transport::{Bus, BusNode};
use dvrk_io::{Error, Psm};

/// An arm that can get stuck, lose its instrument, or fail.
#[derive(Default)]
pub struct Plant {
    inner: KinematicArm,
    pub stuck: bool,
    pub bare: bool,
    pub breaks: Option<String>,
    /// Every set-point that was followed: time since the last one, control point, jaw.
    pub followed: Vec<(Duration, RcmFromWrist, f64)>,
}

impl ServedArm for Plant {
    fn follow(&mut self, wrist: &RcmFromWrist, jaw: f64, time: Duration) {
        self.followed.push((time, *wrist, jaw));
        if !self.stuck {
            self.inner.follow(wrist, jaw, time);
        }
    }

    fn rcm_from_wrist(&self) -> RcmFromWrist {
        self.inner.rcm_from_wrist()
    }

    fn jaw(&self) -> f64 {
        self.inner.jaw()
    }

    fn tool(&self) -> Option<String> {
        (!self.bare).then(|| "LARGE_NEEDLE_DRIVER:400006".to_owned())
    }

    fn fault(&mut self) -> Option<String> {
        self.breaks.take()
    }
}

pub type Server = ArmServer<Plant>;

/// A bus, and a robot on it as long as it is there.
pub struct World {
    pub bus: Bus,
    server: Arc<Mutex<Option<Server>>>,
    options: ServeOptions,
}

pub fn seconds(seconds: f64) -> Duration {
    Duration::from_secs_f64(seconds)
}

impl World {
    pub fn new(options: ServeOptions) -> Self {
        let world = Self {
            bus: Bus::new(),
            server: Arc::default(),
            options,
        };
        world.start();
        let server = Arc::clone(&world.server);
        world.bus.every(Duration::from_millis(1), move |now| {
            if let Some(server) = server.lock().unwrap().as_mut() {
                server.tick(now);
            }
        });
        world
    }

    pub fn start(&self) {
        let options = self.options.clone();
        let server = ArmServer::new(&self.bus.node(), "PSM1", Plant::default(), options).unwrap();
        *self.server.lock().unwrap() = Some(server);
    }

    /// The robot is gone.
    pub fn kill(&self) {
        *self.server.lock().unwrap() = None;
    }

    pub fn server<T>(&self, act: impl FnOnce(&mut Server) -> T) -> T {
        let mut server: MutexGuard<'_, Option<Server>> = self.server.lock().unwrap();
        act(server.as_mut().unwrap())
    }

    pub fn plant<T>(&self, act: impl FnOnce(&mut Plant) -> T) -> T {
        self.server(|server| act(server.arm()))
    }

    /// Seconds since some time.
    pub fn since(&self, start: Duration) -> f64 {
        self.bus.now().saturating_sub(start).as_secs_f64()
    }

    pub fn node(&self) -> Arc<BusNode> {
        Arc::new(self.bus.node())
    }

    pub fn connect(&self, options: ArmOptions) -> Result<Arm, Error> {
        Arm::connect(self.node(), "PSM1", options, seconds(6.0))
    }

    /// Enabled and homed.
    pub fn ready(&self, options: ArmOptions) -> Arm {
        let mut arm = self.connect(options).unwrap();
        arm.enable(seconds(6.0)).unwrap();
        arm.home(seconds(10.0)).unwrap();
        arm
    }
}

impl Default for World {
    fn default() -> Self {
        Self::new(ServeOptions::default())
    }
}

/// Where the tips are, moved by some metres.
pub fn shifted(arm: &Arm, x: f64, y: f64, z: f64) -> RcmFromTip {
    RcmFromTip(Translation3::new(x, y, z) * arm.rcm_from_tip().unwrap().value.0)
}

pub fn apart(a: &Isometry3<f64>, b: &Isometry3<f64>) -> (f64, f64) {
    let distance = (a.translation.vector - b.translation.vector).norm();
    (distance, a.rotation.angle_to(&b.rotation))
}

/// The reason why a motion ended or did not start.
pub fn reason<T: std::fmt::Debug>(result: Result<T, Error>) -> Stop {
    match result {
        Err(Error::ArmStopped { reason, .. }) => *reason,
        other => panic!("{other:?}"),
    }
}

pub fn classic() -> dvrk_io::kinematics::Kinematics {
    dvrk_io::kinematics::Kinematics::new(Psm::Classic)
}
