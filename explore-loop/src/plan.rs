//! Planning a manipulation: from what is known of the object to grips and paths.
//!
//! [`Planner`] is the seam; [`CoveragePlanner`] asks `grip-planner` for the set with the best null-space coverage
//! whose motion can be done, [`RandomPlanner`] draws grips at random among the same candidates and moves them the
//! same way: the paper's baseline.

use crate::Error;
use crate::canonical::topology::Topology;
use crate::cell::CellInfo;
use grip_planner::{
    Arm, Candidate, Grip, GripSet, Model, Motion, PlanOptions, Role, Scene, Workspace,
};
use nalgebra::{Isometry3, Point3, Translation3, UnitVector3};
use rand::Rng;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

/// What a planner may know.
#[derive(Debug, Clone, Copy)]
pub struct PlanInput<'a> {
    /// Live points of the model, camera frame.
    pub points: &'a [Point3<f64>],
    /// Their outward normals.
    pub normals: &'a [UnitVector3<f64>],
    /// Area of each vertex, m².
    pub areas: &'a [f64],
    /// The surface graph.
    pub edges: &'a [[u32; 2]],
    /// Boundary and loops.
    pub topology: &'a Topology,
    /// What the camera sees now.
    pub visible: &'a [bool],
    /// The arms and the table.
    pub cell: &'a CellInfo,
    /// Fastest grip speed, m/s.
    pub speed: f64,
    /// How many manipulations and missed grasps there were before.
    pub attempt: usize,
}

/// One arm's part in a manipulation.
#[derive(Debug, Clone, PartialEq)]
pub struct PlannedGrip {
    /// The arm.
    pub arm: usize,
    /// Vertex of the model it grips.
    pub vertex: u32,
    /// Where that vertex lies at rest (filled in by the loop).
    pub at_rest: Point3<f64>,
    /// Whether it lifts; a supporting arm may miss.
    pub lifts: bool,
    /// Where the jaws close.
    pub camera_from_tip: Isometry3<f64>,
    /// Where the straight way to the grip begins.
    pub camera_from_approach: Isometry3<f64>,
    /// When its jaw opens, seconds into the motion.
    pub release: f64,
    /// Where it goes then.
    pub camera_from_retreat: Isometry3<f64>,
}

/// A manipulation: grips and what they do.
#[derive(Debug, Clone, PartialEq)]
pub struct ManipulationPlan {
    /// The grips.
    pub grips: Vec<PlannedGrip>,
    /// The paths.
    pub motion: Motion,
    /// When lifting ends and lowering begins, seconds.
    pub lowering_from: f64,
    /// One line for people.
    pub summary: String,
}

impl ManipulationPlan {
    /// Where `arm` should be at `time`.
    pub fn pose(&self, arm: usize, time: f64) -> Option<Isometry3<f64>> {
        self.motion
            .arms
            .iter()
            .find(|path| path.arm == arm)?
            .at(time)
    }
}

/// Decides where to grip and how to move.
pub trait Planner {
    /// A plan, or the reason why there is none (which ends the exploration).
    ///
    /// # Errors
    /// Input that cannot be planned with.
    fn plan(&mut self, input: &PlanInput<'_>) -> Result<Result<ManipulationPlan, String>, Error>;
}

/// Best null-space coverage whose motion can be done.
#[derive(Debug, Clone)]
pub struct CoveragePlanner {
    /// Settings of `grip-planner`.
    pub options: PlanOptions,
    /// Sets that would lift the body over more than this times its length along the axis come last.
    pub upright: f64,
}

impl Default for CoveragePlanner {
    fn default() -> Self {
        Self {
            options: PlanOptions::default(),
            upright: 1.1,
        }
    }
}

impl Planner for CoveragePlanner {
    fn plan(&mut self, input: &PlanInput<'_>) -> Result<Result<ManipulationPlan, String>, Error> {
        let arms = arms(input.cell);
        let mut options = self.options.clone();
        options.turn.speed = input.speed;
        let (model, scene) = (model(input), scene(input, &arms));
        let sets = match grip_planner::plan_grips(&model, &scene, &options.grips) {
            Ok(sets) => sets,
            Err(error @ grip_planner::Error::NoGrips { .. }) => return Ok(Err(error.to_string())),
            Err(error) => return Err(error.into()),
        };
        // Turned about its shorter side, a long soft body stands upright on its end and buckles.
        let flat = |set: &&GripSet| set.turn.span <= self.upright * set.turn.length;
        let (flat, upright): (Vec<&GripSet>, Vec<&GripSet>) = sets.iter().partition(flat);
        let mut refused = Vec::new();
        for set in flat.into_iter().chain(upright) {
            for set in [set.clone(), set.without_support()] {
                match grip_planner::turn_over(&model, &scene, &set, &options.turn) {
                    Ok(motion) => return Ok(Ok(manipulation(&set, motion))),
                    Err(reason) => refused.push(reason.to_string()),
                }
            }
        }
        Ok(Err(format!(
            "all {} motions refused, the best one because {}",
            refused.len(),
            refused.first().map_or("", |r| r)
        )))
    }
}

/// Random grips among the candidates.
#[derive(Debug, Clone)]
pub struct RandomPlanner {
    options: PlanOptions,
    random: ChaCha8Rng,
}

/// Draws of grips before a random planner gives up.
const DRAWS: usize = 500;

impl RandomPlanner {
    /// Draws from `seed`.
    pub fn new(seed: u64) -> Self {
        Self {
            options: PlanOptions::default(),
            random: ChaCha8Rng::seed_from_u64(seed),
        }
    }

    /// A random pair of candidates with arms that reach them, turned the way it suits best.
    fn draw(
        &mut self,
        found: &[Candidate],
        turns: &[grip_planner::Turn],
        scene: &Scene<'_>,
    ) -> Option<GripSet> {
        let [a, b] = [0, 1].map(|_| &found[self.random.random_range(0..found.len())]);
        if (a.point - b.point).norm() < scene.jaw_separation {
            return None;
        }
        let free = |c: &Candidate, not: Option<usize>| {
            c.arms.iter().copied().find(|arm| Some(*arm) != not)
        };
        let first = free(a, None)?;
        let second = free(b, Some(first))?;
        let suits = |t: &grip_planner::Turn| t.suitability([&a.point, &b.point], [0.0, 10.0]);
        let turn = turns.iter().max_by(|s, t| suits(s).total_cmp(&suits(t)))?;
        let grips = vec![self.grip(first, a, scene), self.grip(second, b, scene)];
        Some(GripSet {
            grips,
            coverage: 0.0,
            lifting_coverage: 0.0,
            suitability: suits(turn),
            score: 0.0,
            turn: *turn,
        })
    }

    fn grip(&self, arm: usize, candidate: &Candidate, scene: &Scene<'_>) -> Grip {
        let camera_from_tip = candidate.camera_from_tip();
        let back = |d: f64| camera_from_tip * Translation3::new(0.0, 0.0, -d);
        let camera_from_approach = back(self.options.grips.approach_distance);
        let up = Translation3::from(scene.table.normal.into_inner() * 0.02);
        Grip {
            arm,
            vertex: candidate.vertex,
            role: Role::Lift,
            camera_from_tip,
            camera_from_approach,
            camera_from_retreat: up * camera_from_approach,
        }
    }
}

impl Planner for RandomPlanner {
    fn plan(&mut self, input: &PlanInput<'_>) -> Result<Result<ManipulationPlan, String>, Error> {
        let arms = arms(input.cell);
        let (model, scene) = (model(input), scene(input, &arms));
        let found = grip_planner::candidates(&model, &scene, &self.options.grips)?;
        let turns = grip_planner::turns(&model, &scene)?;
        self.options.turn.speed = input.speed;
        if found.accepted.len() < 2 {
            return Ok(Err(format!("{} candidates", found.accepted.len())));
        }
        for _ in 0..DRAWS {
            let Some(set) = self.draw(&found.accepted, &turns, &scene) else {
                continue;
            };
            if let Ok(motion) = grip_planner::turn_over(&model, &scene, &set, &self.options.turn) {
                return Ok(Ok(manipulation(&set, motion)));
            }
        }
        Ok(Err(format!(
            "none of {DRAWS} random pairs of {} candidates can be moved",
            found.accepted.len()
        )))
    }
}

fn model<'a>(input: &PlanInput<'a>) -> Model<'a> {
    Model {
        points: input.points,
        normals: input.normals,
        areas: input.areas,
        edges: input.edges,
        boundary: &input.topology.boundary,
        visible: input.visible,
    }
}

fn arms(cell: &CellInfo) -> Vec<Arm> {
    cell.arms
        .iter()
        .map(|arm| Arm {
            base: arm.base,
            workspace: Workspace::Ball {
                center: arm.base,
                radius: arm.reach,
            },
            home: arm.camera_from_home,
            max_speed: arm.max_speed,
        })
        .collect()
}

fn scene<'a>(input: &PlanInput<'_>, arms: &'a [Arm]) -> Scene<'a> {
    let table = grip_planner::Plane {
        normal: input.cell.table.normal,
        offset: input.cell.table.offset,
    };
    let jaw_radius = input
        .cell
        .arms
        .iter()
        .map(|a| a.jaw_radius)
        .fold(0.0, f64::max)
        .max(1e-3);
    Scene {
        table,
        arms,
        camera: Point3::origin(),
        jaw_radius,
        jaw_separation: 4.0 * jaw_radius,
        clearance: 2e-3,
    }
}

fn manipulation(set: &GripSet, motion: Motion) -> ManipulationPlan {
    let grips = set
        .grips
        .iter()
        .map(|grip| {
            let path = motion.arms.iter().find(|path| path.arm == grip.arm);
            PlannedGrip {
                arm: grip.arm,
                vertex: grip.vertex,
                at_rest: Point3::origin(),
                lifts: grip.role == Role::Lift,
                camera_from_tip: grip.camera_from_tip,
                camera_from_approach: grip.camera_from_approach,
                release: path.map_or(motion.duration, |p| p.release),
                camera_from_retreat: path
                    .map_or(grip.camera_from_retreat, |p| p.camera_from_retreat),
            }
        })
        .collect();
    let arms: Vec<String> = set
        .grips
        .iter()
        .map(|g| format!("arm {} at vertex {}", g.arm, g.vertex))
        .collect();
    let summary = format!(
        "{}; coverage {:.2}, suitability {:.2}, {:.1} s",
        arms.join(", "),
        set.coverage,
        set.suitability,
        motion.duration
    );
    ManipulationPlan {
        grips,
        lowering_from: 0.5 * motion.duration,
        motion,
        summary,
    }
}
