//! The checkpoint from which an interrupted run continues.

use crate::output::OutputFolder;
use crate::{Failure, Reconstruction, RunArgs};
use explore_loop::canonical::CanonicalModel;
use explore_loop::cell::sim::Command;
use explore_loop::checkpoint;
use explore_loop::explore::{FrameFault, SavedState};
use explore_loop::measure::{GripSpeed, MeasurerState, ShapeMeasures};
use explore_loop::report::html::Report;
use explore_loop::report::metrics::ConstraintMeasures;
use serde::{Deserialize, Serialize};

/// The content of a checkpoint.
#[derive(Serialize, Deserialize)]
pub(crate) struct Saved {
    /// The options that determine the run.
    pub run: String,
    pub commands: Vec<Command>,
    /// `None` before the end of the first manipulation.
    pub explorer: Option<SavedState>,
    pub recorder: SoFar,
}

/// Name of the checkpoint in the result folder.
pub(crate) const CHECKPOINT: &str = "checkpoint.bin";

impl Saved {
    pub fn new(args: &RunArgs) -> Result<Self, Failure> {
        let object = args.object.identity()?;
        let reconstruction = match args.reconstruction {
            Reconstruction::Body => "",
            Reconstruction::DynamicFusion => " --reconstruction dynamic-fusion",
        };
        Ok(Self {
            run: format!(
                "{object}{reconstruction} --arms {} --arm-model {:?} --grips {:?} --seed {} --speed {} --spacing {} --camera {:?} --noise {} --features {:?} --sway {:?} --seed-point {:?} --genus {} --max-manipulations {} --without {:?}",
                args.arms,
                args.arm_model,
                args.grips,
                args.seed,
                args.speed,
                args.aim.spacing,
                args.camera,
                args.noise,
                args.features,
                args.sway,
                args.aim.seed_point,
                args.aim.genus.map_or_else(|| "any".into(), |g| g.to_string()),
                args.aim.max_manipulations,
                args.without
            )
            .to_lowercase(),
            commands: Vec::new(),
            explorer: None,
            recorder: SoFar::default(),
        })
    }

    pub fn read(out: &OutputFolder, args: &RunArgs) -> Result<Self, Failure> {
        let saved: Self = checkpoint::read(&out.file(CHECKPOINT))?;
        let expected = Self::new(args)?.run;
        if saved.run != expected {
            let path = out.file(CHECKPOINT);
            let (path, run) = (path.display(), &saved.run);
            return Err(format!("{path}: the run there has {run}, not {expected}").into());
        }
        Ok(saved)
    }
}

/// A fault that occurs again within this time goes on, seconds.
const SAME_FAULT: f64 = 2.0;

impl SoFar {
    /// Takes the fault of the next frame; whether it goes on from an earlier frame.
    pub fn goes_on(&mut self, fault: &FrameFault) -> bool {
        let (kind, now) = (fault.word(), self.last_stamp);
        let before = self.last_fault.replace((kind.into(), now));
        before.is_some_and(|(earlier, then)| earlier == kind && now - then < SAME_FAULT)
    }

    /// How many manipulations there were before the last decision, in words.
    pub fn manipulated(&self) -> String {
        let attempts = self.shapes.len().saturating_sub(1);
        match attempts.saturating_sub(self.manipulations) {
            0 => format!("{} manipulations", self.manipulations),
            given_up => format!(
                "{} manipulations and {given_up} given up",
                self.manipulations
            ),
        }
    }
}

/// The recording and the measures so far.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(crate) struct SoFar {
    pub measurer: Option<MeasurerState>,
    pub registration: Vec<f64>,
    pub frames: Vec<f64>,
    pub failures: usize,
    pub constraints: ConstraintMeasures,
    pub grip_speed: GripSpeed,
    pub shapes: Vec<ShapeMeasures>,
    pub betti: Vec<[usize; 3]>,
    pub last_stamp: f64,
    pub lines: String,
    pub model: CanonicalModel,
    pub manipulations: usize,
    /// The last fault of a frame, and when it was.
    pub last_fault: Option<(String, f64)>,
    pub report: Report,
    /// Wall-clock time of the earlier sessions, seconds.
    pub wall: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fault_that_goes_on_is_reported_once() {
        let mut so_far = SoFar::default();
        let mut reported = |stamp: f64, fault: &FrameFault| {
            so_far.last_stamp = stamp;
            !so_far.goes_on(fault)
        };
        let foreign = |points| FrameFault::Foreign { points };
        assert!(reported(1.0, &foreign(46)));
        // In every frame of ten seconds, with other numbers.
        assert!((1..100).all(|k| !reported(1.0 + 0.1 * f64::from(k), &foreign(k as usize))));
        assert!(reported(11.0, &FrameFault::Frozen));
        assert!(reported(11.1, &foreign(3)));
        // Over for a while, and back.
        assert!(reported(11.1 + 1.5 * SAME_FAULT, &foreign(3)));
    }

    #[test]
    fn manipulations_given_up_are_told_apart() {
        let mut so_far = SoFar::default();
        assert_eq!(so_far.manipulated(), "0 manipulations");
        so_far.shapes = vec![ShapeMeasures::default(); 4];
        so_far.manipulations = 3;
        assert_eq!(so_far.manipulated(), "3 manipulations");
        so_far.manipulations = 1;
        assert_eq!(so_far.manipulated(), "1 manipulations and 2 given up");
    }
}
