//! A cell without physics: a rigid ellipsoid moves with the tips that hold it, falls when released, and is visible where it faces the camera;
//! and a recorder that compares every command with the limits.

use super::{Normal, ellipsoid};
use explore_loop::cell::{ArmInfo, ArmState, Cell, CellError, CellInfo, Observation, Plane};
use explore_loop::explore::{Bounds, Limits};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use std::cell::RefCell;
use std::rc::Rc;

/// Height of the camera above the table, metres.
pub const HEIGHT: f64 = 0.55;
/// Seconds between frames.
pub const PERIOD: f64 = 0.1;
/// Half axes of the body, metres.
pub const BODY: [f64; 3] = [0.06, 0.042, 0.026];

struct Arm {
    pose: Isometry3<f64>,
    goal: Option<(Isometry3<f64>, f64)>,
    holding: bool,
    open: bool,
}

/// A holding tip where it took hold, and the body then.
struct Hold {
    arms: Vec<usize>,
    tips: Vec<Isometry3<f64>>,
    body: Isometry3<f64>,
}

pub struct World {
    pub frame: usize,
    points: Vec<Point3<f64>>,
    normals: Vec<Normal>,
    body: Isometry3<f64>,
    arms: Vec<Arm>,
    hold: Option<Hold>,
    held: usize,
    /// After so many frames in the jaws somebody takes the body out of them and puts it elsewhere.
    pub taken_at: Option<usize>,
}

/// A handle to the world, shared by its clones.
#[derive(Clone)]
pub struct FakeCell {
    info: CellInfo,
    pub world: Rc<RefCell<World>>,
}

impl FakeCell {
    pub fn new(arms: usize) -> Self {
        let half_turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
        let camera_from_world =
            Isometry3::from_parts(Translation3::new(0.0, 0.0, HEIGHT), half_turn);
        let arms: Vec<ArmInfo> = [Vector3::x(), -Vector3::x(), Vector3::y()]
            .iter()
            .take(arms)
            .enumerate()
            .map(|(k, side)| {
                let tip = side * 0.3 + Vector3::z() * 0.16;
                let approach = -(side + Vector3::z());
                let home = Isometry3::from_parts(
                    Translation3::from(tip),
                    UnitQuaternion::face_towards(&approach, &side.cross(&Vector3::z())),
                );
                ArmInfo {
                    name: format!("PSM{}", k + 1),
                    camera_from_home: camera_from_world * home,
                    base: camera_from_world * Point3::from(side * 0.40 + Vector3::z() * 0.10),
                    reach: 0.65,
                    poses: None,
                    jaw_radius: 0.006,
                    max_speed: 0.25,
                }
            })
            .collect();
        let (points, normals) = ellipsoid(4000, BODY);
        let world = World {
            frame: 0,
            points,
            normals,
            body: camera_from_world * Isometry3::translation(0.0, 0.0, BODY[2]),
            arms: arms
                .iter()
                .map(|a| Arm {
                    pose: a.camera_from_home,
                    goal: None,
                    holding: false,
                    open: true,
                })
                .collect(),
            hold: None,
            held: 0,
            taken_at: None,
        };
        let table = Plane {
            normal: -Vector3::z_axis(),
            offset: HEIGHT,
        };
        Self {
            info: CellInfo {
                arms,
                table,
                camera_rate: 1.0 / PERIOD,
            },
            world: Rc::new(RefCell::new(world)),
        }
    }

    /// Seconds since the world began, whatever the stamps say.
    pub fn now(&self) -> f64 {
        self.world.borrow().frame as f64 * PERIOD
    }

    pub fn tips(&self) -> Vec<Isometry3<f64>> {
        self.world.borrow().arms.iter().map(|a| a.pose).collect()
    }

    /// The middle of the body.
    pub fn middle(&self) -> Point3<f64> {
        Point3::from(self.world.borrow().body.translation.vector)
    }

    /// Which jaws are closed.
    pub fn closed(&self) -> Vec<bool> {
        self.world.borrow().arms.iter().map(|a| !a.open).collect()
    }

    pub fn moving(&self) -> bool {
        self.world.borrow().arms.iter().any(|a| a.goal.is_some())
    }
}

impl World {
    fn step(&mut self) {
        self.frame += 1;
        for arm in &mut self.arms {
            let Some((goal, speed)) = arm.goal else {
                continue;
            };
            let way = (goal.translation.vector - arm.pose.translation.vector).norm();
            let turn = arm.pose.rotation.angle_to(&goal.rotation);
            let share = speed * PERIOD / way.max(0.02 * turn).max(1e-12);
            if share >= 1.0 - 1e-9 {
                arm.pose = goal;
                arm.goal = None;
            } else {
                arm.pose = arm.pose.lerp_slerp(&goal, share);
            }
        }
        self.held += usize::from(self.hold.is_some());
        if self.taken_at.is_some_and(|at| self.held > at) {
            self.taken_at = None;
            self.hold = None;
            self.arms.iter_mut().for_each(|a| a.holding = false);
            let middle = self.body.translation.vector;
            self.body = Translation3::from(middle + Vector3::new(0.08, 0.06, 0.0))
                * UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 1.6)
                * Translation3::from(-middle)
                * self.body;
        }
        self.carry();
    }

    /// The body goes with the middle of the tips that hold it and turns with the first of them; it is never under the table.
    fn carry(&mut self) {
        if let Some(hold) = &self.hold {
            let middle = |tips: &[Isometry3<f64>]| {
                let sum: Vector3<f64> = tips.iter().map(|t| t.translation.vector).sum();
                sum / tips.len() as f64
            };
            let tips: Vec<_> = hold.arms.iter().map(|&a| self.arms[a].pose).collect();
            let turn = tips[0].rotation * hold.tips[0].rotation.inverse();
            self.body = Translation3::from(middle(&tips))
                * turn
                * Translation3::from(-middle(&hold.tips))
                * hold.body;
        }
        let lowest = self.points.iter().map(|p| (self.body * p).z);
        let lowest = lowest.fold(f64::NEG_INFINITY, f64::max);
        if lowest > HEIGHT || self.hold.is_none() {
            let down = (HEIGHT - lowest).min(0.004);
            self.body.translation.vector.z += down;
        }
    }

    fn take_hold(&mut self) {
        let arms: Vec<usize> = (0..self.arms.len())
            .filter(|&a| self.arms[a].holding)
            .collect();
        let tips = arms.iter().map(|&a| self.arms[a].pose).collect();
        let body = self.body;
        self.hold = (!arms.is_empty()).then_some(Hold { arms, tips, body });
    }

    fn seen(&self) -> Vec<Point3<f64>> {
        let mut seen = Vec::new();
        for (i, (p, n)) in self.points.iter().zip(&self.normals).enumerate() {
            let (p, n) = (self.body * p, self.body.rotation * n.into_inner());
            let ray = p.coords.normalize();
            if n.dot(&ray) < -0.08 {
                seen.push(p + ray * noise(self.frame, i));
            }
        }
        seen
    }
}

/// Depth noise of 0.2 mm, evenly spread, the same for the same frame and point.
fn noise(frame: usize, point: usize) -> f64 {
    let mut x = (frame as u64) << 32 | point as u64;
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^= x >> 31;
    4e-4 * ((x >> 11) as f64 / (1u64 << 53) as f64 - 0.5)
}

impl Cell for FakeCell {
    fn info(&self) -> &CellInfo {
        &self.info
    }

    fn observe(&mut self) -> Result<Observation, CellError> {
        let mut world = self.world.borrow_mut();
        world.step();
        let state = |a: &Arm| ArmState {
            camera_from_tip: a.pose,
            jaw: if a.open { 0.8 } else { 0.0 },
            holding: a.holding,
            moving: a.goal.is_some(),
        };
        Ok(Observation {
            stamp: world.frame as f64 * PERIOD,
            camera: None,
            points: world.seen(),
            colours: None,
            features: None,
            arms: world.arms.iter().map(state).collect(),
        })
    }

    fn move_arm(&mut self, arm: usize, to: Isometry3<f64>, speed: f64) -> Result<(), CellError> {
        assert!(to.to_homogeneous().iter().all(|x| x.is_finite()) && speed > 0.0);
        self.world.borrow_mut().arms[arm].goal = Some((to, speed));
        Ok(())
    }

    fn close_jaw(&mut self, arm: usize) -> Result<(), CellError> {
        let mut world = self.world.borrow_mut();
        let tip = Point3::from(world.arms[arm].pose.translation.vector);
        let near = |p: &Point3<f64>| (world.body * p - tip).norm() < 0.012;
        if !world.points.iter().any(near) {
            return Err(CellError::NothingGrasped { arm });
        }
        world.arms[arm].holding = true;
        world.arms[arm].open = false;
        world.take_hold();
        Ok(())
    }

    fn open_jaw(&mut self, arm: usize) -> Result<(), CellError> {
        let mut world = self.world.borrow_mut();
        world.arms[arm].open = true;
        if std::mem::take(&mut world.arms[arm].holding) {
            world.take_hold();
        }
        Ok(())
    }

    fn home(&mut self) -> Result<(), CellError> {
        let mut world = self.world.borrow_mut();
        for (arm, info) in world.arms.iter_mut().zip(&self.info.arms) {
            arm.pose = info.camera_from_home;
            arm.goal = None;
        }
        Ok(())
    }

    fn stop(&mut self) -> Result<(), CellError> {
        for arm in &mut self.world.borrow_mut().arms {
            arm.goal = None;
        }
        Ok(())
    }
}

/// Where an arm was sent last, and with what velocity.
#[derive(Clone, Copy, Default)]
struct Sent {
    pose: Option<Isometry3<f64>>,
    velocity: Vector3<f64>,
    this_frame: bool,
}

/// Compares every set-point with the limits, and records the true poses of the tips in every frame.
pub struct Recorder<C> {
    cell: C,
    world: FakeCell,
    limits: Limits,
    sent: Vec<Sent>,
    pub commands: usize,
    pub stops: usize,
    /// Worst share of step, speed, turn rate and acceleration that was used.
    pub worst: [f64; 4],
    /// True time and tips at every frame.
    pub trace: Vec<(f64, Vec<Isometry3<f64>>)>,
}

impl<C: Cell> Recorder<C> {
    pub fn new(cell: C, world: FakeCell, limits: Limits) -> Self {
        let sent = vec![Sent::default(); world.info.arms.len()];
        let trace = vec![(world.now(), world.tips())];
        Self {
            cell,
            world,
            limits,
            sent,
            commands: 0,
            stops: 0,
            worst: [0.0; 4],
            trace,
        }
    }

    pub fn inner(&self) -> &C {
        &self.cell
    }

    fn check(&mut self, arm: usize, to: &Isometry3<f64>, speed: f64) {
        let bounds: Bounds = if self.world.world.borrow().arms[arm].holding {
            self.limits.holding
        } else {
            self.limits.empty
        };
        let sent = self.sent[arm];
        assert!(!sent.this_frame, "two set-points in a frame");
        let from = sent.pose.unwrap_or_else(|| self.world.tips()[arm]);
        let velocity = (to.translation.vector - from.translation.vector) / PERIOD;
        let before = sent.velocity;
        let along = if before.norm() > 0.0 {
            (velocity.dot(&before) / before.norm_squared()).clamp(0.0, 1.0)
        } else {
            0.0
        };
        let used = [
            velocity.norm() * PERIOD / self.limits.step,
            velocity.norm().max(speed) / bounds.speed,
            from.rotation.angle_to(&to.rotation) / PERIOD / bounds.turn_rate,
            (velocity - before * along).norm() / PERIOD / bounds.acceleration,
        ];
        for (worst, used) in self.worst.iter_mut().zip(used) {
            *worst = worst.max(used);
        }
        self.sent[arm] = Sent {
            pose: Some(*to),
            velocity,
            this_frame: true,
        };
        self.commands += 1;
    }
}

impl<C: Cell> Cell for Recorder<C> {
    fn info(&self) -> &CellInfo {
        self.cell.info()
    }

    fn observe(&mut self) -> Result<Observation, CellError> {
        for sent in &mut self.sent {
            if !std::mem::take(&mut sent.this_frame) {
                sent.velocity = Vector3::zeros();
            }
        }
        let observation = self.cell.observe();
        self.trace.push((self.world.now(), self.world.tips()));
        observation
    }

    fn move_arm(&mut self, arm: usize, to: Isometry3<f64>, speed: f64) -> Result<(), CellError> {
        self.check(arm, &to, speed);
        self.cell.move_arm(arm, to, speed)
    }

    fn close_jaw(&mut self, arm: usize) -> Result<(), CellError> {
        self.cell.close_jaw(arm)
    }

    fn open_jaw(&mut self, arm: usize) -> Result<(), CellError> {
        self.cell.open_jaw(arm)
    }

    fn home(&mut self) -> Result<(), CellError> {
        self.sent.fill(Sent::default());
        self.cell.home()
    }

    fn stop(&mut self) -> Result<(), CellError> {
        self.stops += 1;
        self.sent.fill(Sent::default());
        self.cell.stop()
    }
}
