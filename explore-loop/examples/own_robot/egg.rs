//! A rigid egg of 40 × 50 × 70 mm on a table, two arms and a depth camera: a complete implementation of `Cell`.

use explore_loop::cell::{ArmInfo, ArmState, Cell, CellError, CellInfo, Observation, Plane};
use explore_loop::nalgebra::{
    Isometry3, Point3, Quaternion, Translation3, UnitQuaternion, Vector3,
};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Semi-axes, metres.
pub const AXES: [f64; 3] = [0.035, 0.025, 0.020];
/// Frames per second.
const RATE: f64 = 10.0;
/// Distance of the table from the camera, and how far the egg sinks per frame after it was released, metres.
const TABLE: f64 = 0.5;
const SINKS: f64 = 0.002;
/// Length of a finger and standard deviation of the depth, metres; number of image rows per unit of the image plane.
const FINGER: f64 = 0.02;
const NOISE: f64 = 3e-4;
const LINES: f64 = 400.0;

struct Arm {
    goal: (Isometry3<f64>, f64),
    state: ArmState,
    /// Pose of the egg in the frame of a tip that holds it.
    tip_from_egg: Option<Isometry3<f64>>,
}

/// State of the world.
pub struct EggCell {
    /// Whether the egg slips in the jaws when the table obstructs it, which violates the contract of `Cell`.
    pub slips: bool,
    info: CellInfo,
    arms: Vec<Arm>,
    pub camera_from_egg: Isometry3<f64>,
    frame: u32,
    random: ChaCha8Rng,
    /// Points spread evenly over the egg, in its frame, and whether the camera has seen them.
    pub shown: Vec<(Point3<f64>, bool)>,
}

/// The egg scaled to the unit sphere.
fn scaled(v: Vector3<f64>) -> Vector3<f64> {
    v.component_div(&Vector3::from(AXES))
}

impl EggCell {
    pub fn new(seed: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let yaw = random.random_range(-3.1..3.1);
        let arm = |(k, side): (usize, f64)| ArmInfo {
            name: format!("PSM{}", k + 1),
            camera_from_home: Isometry3::from_parts(
                Translation3::new(0.3 * side, 0.0, TABLE - 0.2),
                UnitQuaternion::face_towards(&Vector3::new(-side, 0.0, 1.0), &Vector3::y()),
            ),
            base: Point3::new(0.4 * side, 0.0, TABLE - 0.1),
            reach: 0.65,
            poses: None,
            jaw_radius: 0.006,
            max_speed: 0.3,
        };
        let arms: Vec<ArmInfo> = [1.0, -1.0].into_iter().enumerate().map(arm).collect();
        let idle = |info: &ArmInfo| Arm {
            goal: (info.camera_from_home, 0.1),
            state: ArmState {
                camera_from_tip: info.camera_from_home,
                jaw: 0.8,
                holding: false,
                moving: false,
            },
            tip_from_egg: None,
        };
        Self {
            slips: false,
            arms: arms.iter().map(idle).collect(),
            info: CellInfo {
                arms,
                table: Plane {
                    normal: -Vector3::z_axis(),
                    offset: TABLE,
                },
                camera_rate: RATE,
            },
            camera_from_egg: Isometry3::new(
                Vector3::new(0.0, 0.0, TABLE - AXES[2]),
                Vector3::z() * yaw,
            ),
            frame: 0,
            random,
            shown: places(2000),
        }
    }

    /// Share of the egg's area that the camera has seen.
    pub fn share_shown(&self) -> f64 {
        self.shown.iter().filter(|s| s.1).count() as f64 / self.shown.len() as f64
    }

    /// Arms approach their goals; the egg moves to the mean of the poses given by the arms that hold it, otherwise it sinks to the table.
    fn advance(&mut self) {
        for arm in &mut self.arms {
            let ((to, speed), at) = (arm.goal, arm.state.camera_from_tip);
            let way = (to.translation.vector - at.translation.vector).norm();
            let way = way.max(FINGER * at.rotation.angle_to(&to.rotation));
            let share = (speed / RATE / way.max(1e-12)).min(1.0);
            arm.state.camera_from_tip = at.try_lerp_slerp(&to, share, 1e-9).unwrap_or(to);
            arm.state.moving = share < 1.0;
        }
        let carried = |a: &Arm| Some(a.state.camera_from_tip * a.tip_from_egg?);
        let held: Vec<Isometry3<f64>> = self.arms.iter().filter_map(carried).collect();
        if let Some(first) = held.first() {
            let same = |q: &Quaternion<f64>| q * first.rotation.dot(q).signum();
            let none = Quaternion::from([0.0; 4]);
            let turn = held.iter().fold(none, |q, h| q + same(&h.rotation));
            let place: Vector3<f64> = held.iter().map(|h| h.translation.vector).sum();
            self.camera_from_egg = Isometry3::from_parts(
                (place / held.len() as f64).into(),
                UnitQuaternion::new_normalize(turn),
            );
        }
        let up = self.camera_from_egg.rotation.inverse() * Vector3::z();
        let lowest = up.component_mul(&Vector3::from(AXES)).norm();
        let gap = TABLE - lowest - self.camera_from_egg.translation.z;
        let sinks = if held.is_empty() { SINKS } else { 0.0 };
        self.camera_from_egg.translation.z += gap.min(sinks);
        // An obstruction by the table or the other arm stops the tip as well: it holds firmly and reports its true pose.
        for arm in self.arms.iter_mut().filter(|_| !self.slips) {
            if let Some(tip_from_egg) = &arm.tip_from_egg {
                arm.state.camera_from_tip = self.camera_from_egg * tip_from_egg.inverse();
            }
        }
    }

    /// The view of the camera, a pinhole at the origin.
    fn look(&mut self) -> Vec<Point3<f64>> {
        let egg_from_camera = self.camera_from_egg.inverse();
        let eye = egg_from_camera * Point3::origin();
        for (place, shown) in &mut self.shown {
            *shown |= scaled(scaled(place.coords)).dot(&(eye - *place)) > 0.0;
        }
        let (eye, middle) = (scaled(eye.coords), self.camera_from_egg.translation.vector);
        let middle = (middle * (LINES / middle.z)).map(f64::round);
        let mut points = Vec::new();
        for (u, v) in (-60..=60).flat_map(|u| (-60..=60).map(move |v| (u, v))) {
            let (u, v) = (middle.x + f64::from(u), middle.y + f64::from(v));
            let ray = Vector3::new(u / LINES, v / LINES, 1.0);
            let way = scaled(egg_from_camera * ray);
            let (a, b, c) = (way.norm_squared(), way.dot(&eye), eye.norm_squared() - 1.0);
            if b * b >= a * c {
                // The sum of twelve uniform numbers less six is approximately normal.
                let normal = (0..12).map(|_| self.random.random::<f64>()).sum::<f64>() - 6.0;
                let depth = (-b - (b * b - a * c).sqrt()) / a + NOISE * normal;
                points.push(Point3::from(ray * depth));
            }
        }
        points
    }

    fn arm(&mut self, arm: usize) -> Result<&mut Arm, CellError> {
        let count = self.arms.len();
        self.arms
            .get_mut(arm)
            .ok_or(CellError::NoSuchArm { arm, count })
    }
}

/// Uniform by area: a Fibonacci sphere is uniform in solid angle, so each point is kept with a probability proportional to its area.
fn places(count: u32) -> Vec<(Point3<f64>, bool)> {
    let [a, b, c] = AXES;
    let mut due = 0.0;
    let mut places = Vec::new();
    for i in 0..4 * count {
        let z = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(4 * count);
        let (sin, cos) = (f64::from(i) * 2.399_963_229_728_653).sin_cos();
        let unit = Vector3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z);
        due += 0.25 * a * b * c * scaled(unit).norm() / (a * b);
        if due >= 0.25 {
            due -= 0.25;
            places.push((unit.component_mul(&Vector3::from(AXES)).into(), false));
        }
    }
    places
}

impl Cell for EggCell {
    fn info(&self) -> &CellInfo {
        &self.info
    }

    fn observe(&mut self) -> Result<Observation, CellError> {
        self.advance();
        self.frame += 1;
        Ok(Observation {
            stamp: f64::from(self.frame) / RATE,
            camera: None,
            points: self.look(),
            colours: None,
            features: None,
            arms: self.arms.iter().map(|a| a.state.clone()).collect(),
        })
    }

    fn move_arm(&mut self, arm: usize, to: Isometry3<f64>, speed: f64) -> Result<(), CellError> {
        let reason = "a pose or speed that is not finite".into();
        if !(to.to_homogeneous().iter().all(|x| x.is_finite()) && speed > 0.0) {
            return Err(CellError::BadCommand { arm, reason });
        }
        let arm = self.arm(arm)?;
        arm.goal = (to, speed);
        arm.state.moving = true;
        Ok(())
    }

    fn close_jaw(&mut self, arm: usize) -> Result<(), CellError> {
        let camera_from_egg = self.camera_from_egg;
        let tip_from_camera = self.arm(arm)?.state.camera_from_tip.inverse();
        let tip_from_egg = tip_from_camera * camera_from_egg;
        let tip = scaled(tip_from_egg.inverse().translation.vector).norm();
        if !(0.7..1.2).contains(&tip) {
            return Err(CellError::NothingGrasped { arm });
        }
        let arm = self.arm(arm)?;
        (arm.state.holding, arm.state.jaw) = (true, 0.0);
        arm.tip_from_egg = Some(tip_from_egg);
        Ok(())
    }

    fn open_jaw(&mut self, arm: usize) -> Result<(), CellError> {
        let arm = self.arm(arm)?;
        (arm.state.holding, arm.state.jaw) = (false, 0.8);
        arm.tip_from_egg = None;
        Ok(())
    }

    fn home(&mut self) -> Result<(), CellError> {
        for k in 0..self.arms.len() {
            self.open_jaw(k)?;
            self.arms[k].state.camera_from_tip = self.info.arms[k].camera_from_home;
        }
        self.stop()
    }

    fn stop(&mut self) -> Result<(), CellError> {
        for arm in &mut self.arms {
            arm.goal = (arm.state.camera_from_tip, 0.1);
            arm.state.moving = false;
        }
        Ok(())
    }
}
