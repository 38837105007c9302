//! [`SimCell`]: object, arms and camera behind the trait [`Cell`].
//!
//! Time passes only in [`Cell::observe`] and [`Cell::home`], in equal steps, a whole number for each frame. A step moves the tips,
//! sets the targets of the held nodes, and solves the physics. The same options give the same bits.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::arms::{arms, remote_centres};
use super::body::Body;
use super::clutter::choose;
use super::gripper::Gripper;
use super::journal::{Command, Journal};
use super::mesh::TriangleMesh;
use super::options::CameraModel;
use super::realsense::FrameClock;
use super::sight::{Sight, View};
use super::{SimError, SimOptions, Truth};
use crate::cell::{Cell, CellError, CellInfo, Observation, Plane};

/// Height above the table from which the object is dropped, metres.
const DROP: f64 = 0.002;

/// Longest time for the object to come to rest, seconds, and the speed of its fastest node at rest, m/s.
const SETTLE: (f64, f64) = (4.0, 0.002);

/// Speed of the motion home, m/s.
const HOME_SPEED: f64 = 0.2;

/// How far an arm retreats from its grip before it turns for home, and how far it rises, metres.
const RETREAT: (f64, f64) = (0.03, 0.05);

/// A simulated cell.
pub struct SimCell {
    pub(super) info: CellInfo,
    pub(super) options: SimOptions,
    pub(super) body: Body,
    /// Nodes attached to the table, with their positions (world frame).
    pub(super) anchored: Vec<(usize, Point3<f64>)>,
    pub(super) grippers: Vec<Gripper>,
    pub(super) sight: Sight,
    pub(super) camera_from_world: Isometry3<f64>,
    pub(super) truth: Truth,
    pub(super) step: f64,
    pub(super) steps_per_frame: usize,
    pub(super) frame: u64,
    pub(super) failure: Option<String>,
    pub(super) journal: Journal,
    /// The camera's own clock, if it has one, and the view at its last tick.
    pub(super) clock: Option<FrameClock>,
    pub(super) ticked: Option<View>,
}

impl std::fmt::Debug for SimCell {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SimCell")
            .field("info", &self.info)
            .field("options", &self.options)
            .field("frame", &self.frame)
            .finish_non_exhaustive()
    }
}

/// The object at rest on the table.
struct LaidDown {
    body: Body,
    /// The same surface as it was placed before it settled, world frame.
    surface: TriangleMesh,
    /// Positions of its vertices in the scene's own frame.
    own: Vec<Point3<f64>>,
    anchored: Vec<(usize, Point3<f64>)>,
    /// The body beside it, camera frame.
    beside: Option<TriangleMesh>,
}

impl SimCell {
    /// Builds the cell, drops the object on the table and waits until it is at rest.
    ///
    /// # Errors
    /// An option out of range, a surface too thin for the allowed tetrahedra, or a physics engine that fails while the object settles.
    pub fn new(options: &SimOptions) -> Result<(Self, Truth), SimError> {
        options.check()?;
        let steps_per_frame = (1.0 / (options.camera.rate * options.fidelity.step) - 1e-9)
            .ceil()
            .max(1.0) as usize;
        let step = 1.0 / (options.camera.rate * steps_per_frame as f64);
        let height = options.camera.above_table;
        let half_turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
        let camera_from_world =
            Isometry3::from_parts(Translation3::new(0.0, 0.0, height), half_turn);
        let mut random = ChaCha8Rng::seed_from_u64(options.seed);
        let laid = lay_down(options, &camera_from_world, step, &mut random)?;
        let clock = match &options.camera.model {
            CameraModel::Ideal => None,
            CameraModel::Stereo(stereo) => {
                Some(FrameClock::new(stereo.rate, random.random_range(0.0..1.0)))
            }
        };

        let settled = laid.body.surface();
        let settled = settled.iter().map(|p| camera_from_world * p).collect();
        let truth = Truth::new(laid.surface.triangles.clone(), settled);
        let arms = arms(options, &camera_from_world)
            .map_err(|error| SimError::Camera(error.to_string()))?;
        let remote_centres = remote_centres(options, &camera_from_world);
        let table = Plane {
            normal: -Vector3::z_axis(),
            offset: height,
        };
        let triangles = laid.surface.triangles;
        let sight = Sight::new(options, &table, triangles, laid.own, laid.beside)
            .map(|sight| sight.with_remote_centres(remote_centres))
            .map_err(|error| SimError::Camera(error.to_string()))?;
        let cell = Self {
            grippers: arms.iter().cloned().map(Gripper::new).collect(),
            info: CellInfo {
                arms,
                table,
                camera_rate: options.camera.rate,
            },
            options: options.clone(),
            body: laid.body,
            anchored: laid.anchored,
            sight,
            camera_from_world,
            truth: truth.clone(),
            step,
            steps_per_frame,
            frame: 0,
            failure: None,
            journal: Journal::default(),
            clock,
            ticked: None,
        };
        Ok((cell, truth))
    }

    /// Number of tetrahedra of the object.
    pub fn tetrahedra(&self) -> usize {
        self.body.tetrahedra
    }

    /// Current volume of the object, m³.
    pub fn volume(&self) -> f64 {
        self.body.volume()
    }

    fn advance_frame(&mut self) -> Result<(), CellError> {
        if let Some(reason) = &self.failure {
            return Err(CellError::Failed(reason.clone()));
        }
        let begun = self.frame as f64 / self.info.camera_rate;
        let end = (self.frame + 1) as f64 / self.info.camera_rate;
        let tick = self.clock.map(|clock| clock.newest(end) - begun);
        for k in 0..self.steps_per_frame {
            // The fraction of this step at which the camera ticks, if it does.
            let share = tick.map(|tick| tick / self.step - k as f64);
            let last = k + 1 == self.steps_per_frame;
            let share = share.filter(|s| *s > 0.0 && (*s <= 1.0 || last));
            let before = share.map(|_| self.view(begun));
            self.grippers.iter_mut().for_each(|g| g.advance(self.step));
            self.step_body();
            if let Some((before, share)) = before.zip(share) {
                let stamp = begun + tick.unwrap_or_default();
                let after = self.view(stamp);
                self.ticked = Some(before.toward(after, share.min(1.0)));
            }
        }
        self.frame += 1;
        if let Some(reason) = self.body.broken() {
            self.failure = Some(reason.clone());
            return Err(CellError::Failed(reason));
        }
        Ok(())
    }

    /// One step of the physics, with the tips at their present poses.
    pub(super) fn step_body(&mut self) {
        let world_from_camera = self.camera_from_world.inverse();
        let held = self.grippers.iter().flat_map(Gripper::targets);
        let targets: Vec<_> = held
            .map(|(node, p)| (node, world_from_camera * p))
            .chain(self.anchored.iter().copied())
            .collect();
        self.body.step(&targets);
        self.slip();
    }

    /// A jaw that pulls too hard loses what it holds, and stays closed.
    fn slip(&mut self) {
        let grippers = &self.grippers;
        let torn = self
            .body
            .slipping(|node| grippers.iter().any(|g| g.holds(node)));
        let Some(gripper) = torn.and_then(|node| self.grippers.iter_mut().find(|g| g.holds(node)))
        else {
            return;
        };
        for node in gripper.lose() {
            self.body.pin(node, false);
        }
    }

    /// The scene in front of the camera at present.
    pub(super) fn view(&self, stamp: f64) -> View {
        View::of(
            &self.body,
            &self.grippers,
            &self.options.jaw,
            &self.camera_from_world,
            stamp,
        )
    }

    fn surface(&self) -> Vec<Point3<f64>> {
        self.body
            .surface()
            .iter()
            .map(|p| self.camera_from_world * p)
            .collect()
    }

    fn gripper(&mut self, arm: usize) -> Result<&mut Gripper, CellError> {
        let count = self.grippers.len();
        self.grippers
            .get_mut(arm)
            .ok_or(CellError::NoSuchArm { arm, count })
    }

    fn let_go(&mut self, arm: usize) -> Result<(), CellError> {
        for node in self.gripper(arm)?.open() {
            self.body.pin(node, false);
        }
        Ok(())
    }

    /// A handle on all commands that this cell has received.
    pub fn journal(&self) -> Journal {
        self.journal.clone()
    }

    /// Repeats the commands of another cell with the same options: afterwards this one is in the same state, to the bit. `seen` receives
    /// every observation on the way.
    ///
    /// # Errors
    /// The world fails, or `seen` does.
    pub fn repeat<E: From<CellError>>(
        &mut self,
        commands: &[Command],
        mut seen: impl FnMut(Observation) -> Result<(), E>,
    ) -> Result<(), E> {
        for command in commands {
            let done = match *command {
                Command::Observe => {
                    seen(self.observe()?)?;
                    Ok(())
                }
                Command::Move(arm, pose, speed) => self.move_arm(arm, pose, speed),
                Command::Close(arm) => self.close_jaw(arm),
                Command::Open(arm) => self.open_jaw(arm),
                Command::Home => self.home(),
                Command::Stop => self.stop(),
            };
            match done {
                // A command that was refused then is refused again, and has no effect.
                Ok(())
                | Err(
                    CellError::NothingGrasped { .. }
                    | CellError::NoSuchArm { .. }
                    | CellError::BadCommand { .. },
                ) => {}
                Err(error) => return Err(error.into()),
            }
        }
        Ok(())
    }

    fn wait_for_arms(&mut self) -> Result<(), CellError> {
        while self.grippers.iter().any(Gripper::moving) {
            self.advance_frame()?;
        }
        Ok(())
    }

    fn check_pose(&self, arm: usize, pose: &Isometry3<f64>) -> Result<(), String> {
        let info = &self.info.arms[arm];
        let tip = Point3::from(pose.translation.vector);
        if !pose
            .translation
            .vector
            .iter()
            .chain(pose.rotation.coords.iter())
            .all(|c| c.is_finite())
        {
            return Err(format!("the pose is not finite: {pose}"));
        }
        let distance = (tip - info.base).norm();
        if distance > info.reach {
            return Err(format!(
                "the tip would be {distance:.3} m from the base, beyond its reach of {:.3} m",
                info.reach
            ));
        }
        if info.poses.as_ref().is_some_and(|p| !p.contains(pose)) {
            return Err("its joints cannot reach that pose of the tip".to_owned());
        }
        let height = self.info.table.height(&tip);
        if height < 0.0 {
            Err(format!("the tip would be {:.4} m under the table", -height))
        } else {
            Ok(())
        }
    }
}

impl Cell for SimCell {
    fn info(&self) -> &CellInfo {
        &self.info
    }

    fn observe(&mut self) -> Result<Observation, CellError> {
        self.journal.add(Command::Observe);
        self.advance_frame()?;
        let now = self.frame as f64 / self.info.camera_rate;
        let view = self.ticked.take().unwrap_or_else(|| self.view(now));
        self.truth.record(&view.surface);
        let camera = self.options.camera.sway.map(|sway| {
            let height = self.options.camera.above_table;
            sway.pose(view.stamp, height)
        });
        if let Some(rest_from_camera) = &camera {
            self.sight.look_from(rest_from_camera);
        }
        let seen = self.sight.see(&view, self.frame)?;
        let measured = Observation {
            stamp: view.stamp,
            camera,
            points: seen.points,
            colours: Some(seen.colours),
            features: seen.features,
            arms: view.arms,
        };
        Ok(match &camera {
            Some(rest_from_camera) => measured.carried(rest_from_camera),
            None => measured,
        })
    }

    fn move_arm(
        &mut self,
        arm: usize,
        camera_from_tip: Isometry3<f64>,
        speed: f64,
    ) -> Result<(), CellError> {
        self.journal.add(Command::Move(arm, camera_from_tip, speed));
        self.gripper(arm)?;
        if !(speed > 0.0 && speed <= self.options.max_speed) {
            let reason = format!(
                "the speed is {speed} m/s, outside 0 (excluded) to {} m/s",
                self.options.max_speed
            );
            return Err(CellError::BadCommand { arm, reason });
        }
        self.check_pose(arm, &camera_from_tip)
            .map_err(|reason| CellError::BadCommand { arm, reason })?;
        self.gripper(arm)?.go(camera_from_tip, speed);
        Ok(())
    }

    fn close_jaw(&mut self, arm: usize) -> Result<(), CellError> {
        self.journal.add(Command::Close(arm));
        let state = self.gripper(arm)?.state();
        if state.holding {
            return Ok(());
        }
        if state.jaw == 0.0 {
            // Still closed by a grip that slipped: it must be opened before it can grip again.
            return Err(CellError::NothingGrasped { arm });
        }
        let surface = self.surface();
        let (camera_from_world, jaw) = (self.camera_from_world, self.options.jaw);
        let (before, rest) = self.grippers.split_at_mut(arm);
        let Some((gripper, after)) = rest.split_first_mut() else {
            return Err(CellError::NothingGrasped { arm });
        };
        let anchored = &self.anchored;
        let taken = |node| {
            before.iter().chain(after.iter()).any(|g| g.holds(node))
                || anchored.iter().any(|(held, _)| *held == node)
        };
        let body = &self.body;
        if !gripper.close(
            body,
            &surface,
            &jaw,
            |node| camera_from_world * body.node(node),
            taken,
        ) {
            return Err(CellError::NothingGrasped { arm });
        }
        let nodes: Vec<usize> = gripper.targets().map(|(node, _)| node).collect();
        for node in nodes {
            self.body.pin(node, true);
        }
        Ok(())
    }

    fn open_jaw(&mut self, arm: usize) -> Result<(), CellError> {
        self.journal.add(Command::Open(arm));
        self.let_go(arm)
    }

    fn home(&mut self) -> Result<(), CellError> {
        self.journal.add(Command::Home);
        // Going home with the object in the jaws would carry it off the table.
        (0..self.grippers.len()).try_for_each(|arm| self.let_go(arm))?;
        let up = self.info.table.normal.into_inner();
        let speed = HOME_SPEED.min(self.options.max_speed);
        for g in &mut self.grippers {
            if g.pose() != &g.info.camera_from_home {
                let mut clear = *g.pose();
                clear.translation.vector +=
                    up * RETREAT.1 - clear.rotation * Vector3::z() * RETREAT.0;
                g.go(clear, speed);
            }
        }
        self.wait_for_arms()?;
        for g in &mut self.grippers {
            let home = g.info.camera_from_home;
            g.go(home, speed);
        }
        self.wait_for_arms()
    }

    fn stop(&mut self) -> Result<(), CellError> {
        self.journal.add(Command::Stop);
        self.grippers.iter_mut().for_each(Gripper::stop);
        Ok(())
    }
}

/// Drops the object on the table with a random yaw and offset, waits until it is at rest, and fixes its attachment.
fn lay_down(
    options: &SimOptions,
    camera_from_world: &Isometry3<f64>,
    step: f64,
    random: &mut ChaCha8Rng,
) -> Result<LaidDown, SimError> {
    let yaw = random.random_range(-std::f64::consts::PI..std::f64::consts::PI);
    let at = Point3::new(
        random.random_range(-0.015..0.015),
        random.random_range(-0.015..0.015),
        DROP,
    );
    let seed_point = options.seed_point.map(|p| camera_from_world.inverse() * p);
    let (placed, beside) = choose(&options.scene, yaw, at, seed_point);
    let mut body = Body::new(&placed, &options.material, &options.fidelity, step)?;
    if let Some(beside) = &beside {
        body.add_obstacle(&beside.surface, options.material.friction)?;
    }
    settle(&mut body, step)?;
    let attachment = options.scene.attachment();
    let anchored = attachment.map_or_else(Vec::new, |patch| patch.nodes(&body, &placed));
    for (node, _) in &anchored {
        body.pin(*node, true);
    }
    Ok(LaidDown {
        body,
        own: placed.own(),
        surface: placed.surface,
        anchored,
        beside: beside.map(|beside| beside.seen_from(camera_from_world)),
    })
}

fn settle(body: &mut Body, step: f64) -> Result<(), SimError> {
    let mut elapsed = 0.0;
    while elapsed < 0.5 || (elapsed < SETTLE.0 && body.fastest() > SETTLE.1) {
        body.step(&[]);
        elapsed += step;
    }
    body.broken()
        .map_or(Ok(()), |reason| Err(SimError::Engine(reason)))
}
