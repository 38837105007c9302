//! Planning a manipulation: from what is known of the object to grips and paths.
//!
//! [`Planner`] is the seam; [`CoveragePlanner`] asks `grip-planner` for the set with the best null-space coverage
//! whose motion can be done, [`RandomPlanner`] draws feasible grips at random on the boundary and moves them the
//! same way: the paper's baseline.

use crate::Error;
use crate::canonical::topology::Topology;
use crate::cell::CellInfo;
use grip_planner::{
    Arm, Candidate, CandidateSource, Coverage, GripSet, Model, Motion, PlanOptions, Role, Scene,
    Turn, Workspace,
};
use nalgebra::{Isometry3, Point3, UnitVector3};
use rand::SeedableRng;
use rand::seq::IndexedRandom;
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

    /// What the planner remembers, to be written to a checkpoint. Nothing by default.
    fn save(&self) -> Vec<u8> {
        Vec::new()
    }

    /// Goes on from what [`Self::save`] gave. Remembers nothing by default.
    ///
    /// # Errors
    /// [`Error::Resume`]: the bytes are none of this planner.
    fn restore(&mut self, saved: &[u8]) -> Result<(), Error> {
        if saved.is_empty() {
            return Ok(());
        }
        Err(Error::Resume {
            reason: "it was saved with another planner".into(),
        })
    }
}

/// Best null-space coverage whose motion can be done.
#[derive(Debug, Clone)]
pub struct CoveragePlanner {
    /// Settings of `grip-planner`.
    pub options: PlanOptions,
    /// Sets that would lift the body over more than this times its length along the axis come last.
    pub upright: f64,
}

/// Sets that keep a body flat come first unless they are worth less than this share of the best one that does not.
const POOR: f64 = 0.9;

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
            Ok(ranked) => ranked.sets,
            Err(error @ grip_planner::Error::NoGrips { .. }) => return Ok(Err(error.to_string())),
            Err(error) => return Err(error.into()),
        };
        // Turned about its shorter side, a long soft body stands upright on its end and buckles.
        let flat = |set: &&GripSet| set.turn.span <= self.upright * set.turn.length;
        let (flat, upright): (Vec<&GripSet>, Vec<&GripSet>) = sets.iter().partition(flat);
        // But what only standing it up can show must be shown at last.
        let most = upright.iter().map(|s| s.score).fold(0.0, f64::max);
        let (flat, poor): (Vec<&GripSet>, Vec<&GripSet>) =
            flat.into_iter().partition(|s| s.score >= POOR * most);
        let mut refused = Vec::new();
        for set in flat.into_iter().chain(upright).chain(poor) {
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

/// Random grips on the boundary: what planning the grips is worth is measured against them.
///
/// Everything but the choice is that of [`CoveragePlanner`]: the candidates are vertices that an arm can take hold of (on the boundary, or
/// on the visible outline when fewer than two are on the boundary), the arms do not cross, the motion is the same turn with the same
/// checks, about the side of the box away from the grips that shows most. A third arm holds a random candidate near the pivot.
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

    /// The boundary, or the outline too when the boundary gives no pair.
    fn candidates(
        &self,
        model: &Model<'_>,
        scene: &Scene<'_>,
    ) -> Result<Vec<Candidate>, grip_planner::Error> {
        let mut options = self.options.grips.clone();
        options.source = CandidateSource::Boundary;
        let boundary = grip_planner::candidates(model, scene, &options)?.accepted;
        if boundary.len() >= 2 {
            return Ok(boundary);
        }
        Ok(grip_planner::candidates(model, scene, &self.options.grips)?.accepted)
    }

    /// A random pair of candidates, and a random third that can hold the body meanwhile.
    fn draw(
        &mut self,
        found: &[Candidate],
        turns: &[Turn],
        scene: &Scene<'_>,
        coverage: &Coverage,
    ) -> Option<GripSet> {
        let pair: Vec<&Candidate> = found.choose_multiple(&mut self.random, 2).collect();
        let [a, b] = pair[..] else {
            return None;
        };
        if (a.point - b.point).norm() < scene.jaw_separation {
            return None;
        }
        // The pivot lies away from the grips, on the side that shows most.
        let shows = |t: &Turn| {
            let lever = t.local(&a.point).y.min(t.local(&b.point).y) / t.span;
            t.gain * lever
        };
        let turn = turns.iter().max_by(|s, t| shows(s).total_cmp(&shows(t)))?;
        let options = &self.options.grips;
        let set = GripSet::lifting(scene, options, coverage, [a, b], turn).ok()?;
        let thirds: Vec<GripSet> = found
            .iter()
            .filter_map(|c| set.supported(scene, options, coverage, c).ok())
            .collect();
        Some(thirds.choose(&mut self.random).cloned().unwrap_or(set))
    }
}

impl Planner for RandomPlanner {
    /// Seed and place of the stream of random numbers.
    fn save(&self) -> Vec<u8> {
        let place = self.random.get_word_pos().to_le_bytes();
        [&self.random.get_seed()[..], &place].concat()
    }

    fn restore(&mut self, saved: &[u8]) -> Result<(), Error> {
        let (seed, place) = saved.split_at_checked(32).unwrap_or_default();
        let (Ok(seed), Ok(place)) = (<[u8; 32]>::try_from(seed), <[u8; 16]>::try_from(place))
        else {
            return Err(Error::Resume {
                reason: "it was saved with another planner".into(),
            });
        };
        self.random = ChaCha8Rng::from_seed(seed);
        self.random.set_word_pos(u128::from_le_bytes(place));
        Ok(())
    }

    fn plan(&mut self, input: &PlanInput<'_>) -> Result<Result<ManipulationPlan, String>, Error> {
        let arms = arms(input.cell);
        let (model, scene) = (model(input), scene(input, &arms));
        let found = self.candidates(&model, &scene)?;
        if found.len() < 2 {
            return Ok(Err(format!("{} candidates", found.len())));
        }
        let turns = grip_planner::turns(&model, &scene)?;
        let vertices: Vec<u32> = found.iter().map(|c| c.vertex).collect();
        let stiffness = &self.options.grips.coverage;
        let coverage = Coverage::new(&model, &scene.table, &vertices, stiffness)?;
        self.options.turn.speed = input.speed;
        for _ in 0..DRAWS {
            let Some(set) = self.draw(&found, &turns, &scene, &coverage) else {
                continue;
            };
            for set in [set.clone(), set.without_support()] {
                let motion = grip_planner::turn_over(&model, &scene, &set, &self.options.turn);
                if let Ok(motion) = motion {
                    return Ok(Ok(manipulation(&set, motion)));
                }
            }
        }
        Ok(Err(format!(
            "none of {DRAWS} random pairs of {} candidates can be moved",
            found.len()
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
        shaft_length: 0.05,
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
