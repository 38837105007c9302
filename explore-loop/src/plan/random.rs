//! The paper's baseline: grips drawn at random, with the motions of the same planner.

use super::{NoPlan, PlanInput, Planner, arms, model, paced, refused_set, scene};
use crate::Error;
use grip_planner::{
    Candidate, CandidateSource, Coverage, GripSet, Model, Plan, PlanOptions, Refusal, Scene, Turn,
};
use rand::SeedableRng;
use rand::seq::IndexedRandom;
use rand_chacha::ChaCha8Rng;

/// Random grips on the boundary, against which planned grips are compared.
///
/// Everything but the choice of grips is as in [`CoveragePlanner`](super::CoveragePlanner): the candidates are vertices that an arm can grip (on the boundary, or
/// on the visible outline when fewer than two are on the boundary), the arms do not cross, and the motion is the same turn with the same
/// checks, about the side of the bounding box away from the grips that reveals most. A third arm holds a random candidate near the pivot.
#[derive(Debug, Clone)]
pub struct RandomPlanner {
    options: PlanOptions,
    random: ChaCha8Rng,
}

/// Most draws of grips.
const DRAWS: usize = 500;

impl RandomPlanner {
    /// A planner with this seed.
    pub fn new(seed: u64) -> Self {
        Self {
            options: PlanOptions::default(),
            random: ChaCha8Rng::seed_from_u64(seed),
        }
    }

    /// The boundary, and the outline too when the boundary gives no pair.
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

    /// A random pair of candidates, and a random third that can support the body meanwhile.
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
        // The pivot is on a side away from the grips, the one that reveals most.
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
    /// Seed and position of the random number stream.
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

    fn plan(&mut self, input: &PlanInput<'_>) -> Result<Result<Plan, NoPlan>, Error> {
        let arms = arms(input.cell);
        let (model, scene) = (model(input), scene(input.cell, &arms, &input.camera));
        let options = paced(&self.options, input);
        let found = self.candidates(&model, &scene)?;
        if found.len() < 2 {
            let accepted = found.len();
            let rejected = Vec::new();
            return Ok(Err(NoPlan::NoGrips { accepted, rejected }));
        }
        let turns = grip_planner::turns(&model, &scene, self.options.grips.tilt)?;
        let vertices: Vec<u32> = found.iter().map(|c| c.vertex).collect();
        let stiffness = &self.options.grips.coverage;
        let coverage = Coverage::new(&model, &scene.table, &vertices, stiffness)?;
        let mut refused = Vec::new();
        for _ in 0..DRAWS {
            let Some(set) = self.draw(&found, &turns, &scene, &coverage) else {
                continue;
            };
            for set in [set.clone(), set.without_support()] {
                match grip_planner::plan_set(&model, &scene, &set, &coverage, &options) {
                    Ok(plan) => return Ok(Ok(plan)),
                    Err(Refusal::Input(error)) => return Err(error.into()),
                    Err(reason) => refused.push(refused_set(&set, reason)),
                }
            }
        }
        Ok(Err(NoPlan::AllRefused { refused }))
    }
}
