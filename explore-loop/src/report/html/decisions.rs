//! The state before each decision, and the action taken.

use super::live::short;
use super::packed::{Bytes, Indices, Points, Values};
use super::thinned::Thinned;
use crate::canonical::CanonicalModel;
use crate::canonical::topology::Topology;
use crate::cell::Observation;
use crate::measure::{ShapeMeasures, Spread};
use grip_planner::{Motion, Plan, Role};
use nalgebra::Point3;
use serde::{Deserialize, Serialize};

/// Most decisions, and most manipulations, that are stored.
const MOST_DECISIONS: usize = 32;
/// Most bytes of all meshes before decisions together.
const MOST_BYTES: usize = 3_000_000;
/// Most bars of a dimension that are shown.
const MOST_BARS: usize = 40;
/// Most loops of a decision, the longest first.
const MOST_LOOPS: usize = 60;
/// Most positions of a tip in a manipulation.
const MOST_TIPS: usize = 400;

/// A quantity on the vertices of a mesh, by which it can be coloured.
#[derive(Debug, Clone, PartialEq)]
pub struct Quantity {
    /// Its name.
    pub name: &'static str,
    /// Its unit; empty when it has none.
    pub unit: &'static str,
    /// A value for each vertex; not finite where unknown.
    pub values: Vec<f64>,
}

/// A mesh to show, at rest.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Mesh {
    /// Vertices, metres.
    pub vertices: Vec<Point3<f64>>,
    /// Triangles, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Quantities on its vertices.
    pub quantities: Vec<Quantity>,
    /// Red, green and blue of each vertex, if the camera has colours. Ignored if it has another length than the vertices.
    pub colours: Option<Vec<[u8; 3]>>,
}

/// Comparison with the ground truth before a decision.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct AgainstTruth {
    /// Measures of the points of the model.
    pub shape: Option<ShapeMeasures>,
    /// Distance from the mesh to the true surface, metres.
    pub accuracy: Option<Spread>,
    /// Distance from the true surface to the mesh, metres.
    pub completeness: Option<Spread>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct PackedQuantity {
    name: String,
    unit: String,
    values: Values,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct PackedMesh {
    vertices: Points,
    triangles: Indices,
    quantities: Vec<PackedQuantity>,
    /// Red, green and blue of each vertex; empty when the camera has no colours.
    colours: Bytes,
}

impl PackedMesh {
    fn of(mesh: &Mesh) -> Self {
        let quantity = |q: &Quantity| PackedQuantity {
            name: q.name.into(),
            unit: q.unit.into(),
            values: Values::of(&q.values),
        };
        let colours = mesh.colours.as_ref();
        let colours = colours.filter(|c| c.len() == mesh.vertices.len());
        Self {
            colours: Bytes(colours.map_or_else(Vec::new, |c| c.as_flattened().to_vec())),
            vertices: Points::of(mesh.vertices.iter()),
            triangles: Indices::of(&mesh.triangles),
            quantities: mesh.quantities.iter().map(quantity).collect(),
        }
    }

    fn size(&self) -> usize {
        let values = self.quantities.iter().map(|q| q.values.len());
        let surface = self.vertices.len() + self.triangles.len();
        surface + self.colours.0.len() + values.sum::<usize>()
    }
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Bars {
    /// Birth and death of the longest bars, by birth; no death if the class outlives the complex.
    bars: Vec<(f64, Option<f64>)>,
    /// Number of shorter bars.
    shorter: usize,
}

impl Bars {
    fn of(topology: &Topology, dimension: usize) -> Self {
        let mut bars: Vec<_> = topology
            .bars
            .iter()
            .filter(|bar| bar.dimension == dimension)
            .collect();
        bars.sort_by(|a, b| b.persistence().total_cmp(&a.persistence()));
        let shorter = topology.shorter_bars[dimension] + bars.len().saturating_sub(MOST_BARS);
        bars.truncate(MOST_BARS);
        let ends = |bar: &&cech_complex::Bar| {
            let death = bar.death.is_finite().then_some(bar.death);
            (bar.birth, death)
        };
        Self {
            bars: bars.iter().map(ends).collect(),
            shorter,
        }
    }
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Decision {
    /// Counted from 0.
    number: u64,
    time: f64,
    manipulations: usize,
    vertices: usize,
    betti: [usize; 3],
    persistent: [usize; 3],
    boundary: f64,
    missing: f64,
    bare: f64,
    strays: f64,
    /// Why the surface does not count as closed.
    obstacle: Option<String>,
    explored: Option<f64>,
    explored_2eps: Option<f64>,
    /// Mean and 95th percentile, m.
    accuracy: Option<[f64; 2]>,
    completeness: Option<[f64; 2]>,
    /// By dimension.
    bars: Vec<Bars>,
    loops: Vec<Points>,
    mesh: PackedMesh,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct PlannedGrip {
    arm: usize,
    lifts: bool,
    /// The position of the gripped vertex at rest, m; `None` when the body has no such vertex.
    rest: Option<[f64; 3]>,
    /// The position at which the tip closes its jaws, m.
    at: [f64; 3],
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Path {
    arm: usize,
    points: Points,
}

fn paths(motion: &Motion) -> Vec<Path> {
    let path = |p: &grip_planner::ArmPath| {
        let every = p.keyframes.len().div_ceil(MOST_TIPS).max(1);
        let frames = p.keyframes.iter().step_by(every);
        let points: Vec<Point3<f64>> = frames
            .map(|k| k.camera_from_tip.translation.vector.into())
            .collect();
        Path {
            arm: p.arm,
            points: Points::of(points.iter()),
        }
    };
    motion.arms.iter().map(path).collect()
}

/// Positions of the tips of all arms at a time, m.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Tips {
    time: f64,
    at: Vec<[f64; 3]>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Manipulation {
    /// Counted from 1.
    number: usize,
    time: f64,
    /// A description.
    what: String,
    score: f64,
    coverage: f64,
    speed_limit: f64,
    duration: f64,
    grips: Vec<PlannedGrip>,
    planned: Vec<Path>,
    /// Positions of the tips, frame by frame.
    tips: Thinned<Tips>,
}

/// All stored decisions and manipulations.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Decisions {
    known: Thinned<Decision>,
    /// The latest one, if it is not among those.
    last: Option<Decision>,
    manipulations: Thinned<Manipulation>,
    under_way: Option<Manipulation>,
}

impl Decisions {
    pub fn new() -> Self {
        Self {
            known: Thinned::new(MOST_DECISIONS),
            last: None,
            manipulations: Thinned::new(MOST_DECISIONS),
            under_way: None,
        }
    }

    pub fn decision(
        &mut self,
        time: f64,
        manipulations: usize,
        topology: &Topology,
        model: &CanonicalModel,
        mesh: &Mesh,
        truth: &AgainstTruth,
    ) {
        self.end_manipulation();
        let pair = |s: Spread| [s.mean, s.p95];
        let decision = Decision {
            number: self.known.given(),
            time,
            manipulations,
            vertices: model.len(),
            betti: topology.betti,
            persistent: topology.persistent,
            boundary: topology.boundary_share(),
            missing: topology.missing,
            bare: topology.bare,
            strays: topology.strays,
            obstacle: topology.obstacle().map(|o| o.to_string()),
            explored: truth.shape.map(|s| s.explored),
            explored_2eps: truth.shape.map(|s| s.explored_2eps),
            accuracy: truth.accuracy.map(pair),
            completeness: truth.completeness.map(pair),
            bars: (0..3).map(|d| Bars::of(topology, d)).collect(),
            loops: loops(topology, model),
            mesh: PackedMesh::of(mesh),
        };
        let number = decision.number;
        self.last = Some(decision.clone());
        if self.known.takes_next() {
            self.known.keep(decision);
            // The first one is kept, however large it is.
            while self.size() > MOST_BYTES && self.known.kept().len() > 1 {
                self.known.halve();
            }
            // It was stored, unless it was dropped by halving.
            if self.known.kept().last().map(|d| d.number) == Some(number) {
                self.last = None;
            }
        }
    }

    fn size(&self) -> usize {
        let kept = self.known.kept().iter();
        kept.map(|decision| decision.mesh.size()).sum()
    }

    /// Records the beginning of a manipulation.
    pub fn planned(
        &mut self,
        number: usize,
        time: f64,
        what: String,
        plan: &Plan,
        model: &CanonicalModel,
    ) {
        self.end_manipulation();
        let grip = |g: &grip_planner::Grip| PlannedGrip {
            arm: g.arm,
            lifts: g.role == Role::Lift,
            rest: model
                .rest()
                .get(g.vertex as usize)
                .map(|p| short(p.coords.into())),
            at: short(g.camera_from_tip.translation.vector.into()),
        };
        self.under_way = Some(Manipulation {
            number,
            time,
            what,
            score: plan.score,
            coverage: plan.coverage,
            speed_limit: plan.speed_limit,
            duration: plan.motion.duration,
            grips: plan.grips.iter().map(grip).collect(),
            planned: paths(&plan.motion),
            tips: Thinned::new(MOST_TIPS),
        });
    }

    /// Records the tips during a manipulation.
    pub fn tips(&mut self, time: f64, observation: &Observation) {
        if let Some(manipulation) = &mut self.under_way {
            let arms = observation.arms.iter();
            let at = |a: &crate::cell::ArmState| short(a.camera_from_tip.translation.vector.into());
            let at = arms.map(at).collect();
            manipulation.tips.push(Tips { time, at });
        }
    }

    fn end_manipulation(&mut self) {
        if let Some(manipulation) = self.under_way.take() {
            self.manipulations.push(manipulation);
        }
    }

    /// The data for the page.
    pub fn page(&self) -> (serde_json::Value, serde_json::Value) {
        let decisions: Vec<_> = self.known.kept().iter().chain(&self.last).collect();
        let manipulations = self.manipulations.kept().iter().chain(&self.under_way);
        let shown = manipulations.map(|m| {
            let (tips, paths) = (m.tips.kept(), &m.planned);
            serde_json::json!({
                "number": m.number, "time": m.time, "what": &m.what, "score": m.score, "coverage": m.coverage,
                "speed_limit": m.speed_limit, "duration": m.duration, "grips": &m.grips,
                "planned": paths, "tips": tips,
            })
        });
        (serde_json::json!(decisions), shown.collect())
    }
}

/// The longest boundary loops, at rest.
fn loops(topology: &Topology, model: &CanonicalModel) -> Vec<Points> {
    let mut loops: Vec<&Vec<u32>> = topology.loops.iter().collect();
    loops.sort_by_key(|l| std::cmp::Reverse(l.len()));
    loops.truncate(MOST_LOOPS);
    let points = |l: &&Vec<u32>| Points::of(l.iter().filter_map(|v| model.rest().get(*v as usize)));
    loops.iter().map(points).collect()
}

#[cfg(test)]
mod tests {
    use super::{AgainstTruth, Decisions, MOST_BYTES, Mesh};
    use crate::canonical::CanonicalModel;
    use crate::canonical::topology::analyse;
    use nalgebra::Point3;

    /// However many decisions there were and however large the meshes, the first and the last are shown, and the page stays small.
    #[test]
    fn the_first_and_the_last_decision_stay() -> Result<(), Box<dyn std::error::Error>> {
        let model = CanonicalModel::default();
        let topology = analyse(&model, 0.005)?;
        for (count, vertices) in [(1, 10), (40, 10), (100, 10), (9, 200_000), (2, 1_000_000)] {
            let mut decisions = Decisions::new();
            let mesh = Mesh {
                vertices: vec![Point3::origin(); vertices],
                ..Mesh::default()
            };
            for k in 0..count {
                let truth = AgainstTruth::default();
                decisions.decision(k as f64, k, &topology, &model, &mesh, &truth);
                let shown: Vec<_> = decisions
                    .known
                    .kept()
                    .iter()
                    .chain(&decisions.last)
                    .collect();
                assert_eq!(shown[0].manipulations, 0);
                assert_eq!(shown[shown.len() - 1].manipulations, k);
                assert!(
                    shown
                        .windows(2)
                        .all(|w| w[0].manipulations < w[1].manipulations)
                );
                assert!(decisions.size() <= MOST_BYTES.max(6 * vertices));
            }
        }
        Ok(())
    }
}
