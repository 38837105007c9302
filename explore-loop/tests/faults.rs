//! What the loop makes of a cell that misbehaves: no set-point beyond the limits, a safe state at once, and then on or an honest end.
#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::panic,
    clippy::print_stdout,
    reason = "tests"
)]

mod common;

use common::fake::{FakeCell, PERIOD, Recorder};
use explore_loop::Error;
use explore_loop::canonical::CanonicalModel;
use explore_loop::cell::Cell;
use explore_loop::cell::faults::{Begin, Fault, FaultKind, FaultyCell};
use explore_loop::explore::{Event, ExploreOptions, Explorer, Outcome, Phase, Watcher};
use explore_loop::plan::CoveragePlanner;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

const SPACING: f64 = 0.008;
const SPEED: f64 = 0.03;

/// Notes when the loop noticed something.
struct Notes {
    world: FakeCell,
    /// True times of the first serious fault of a frame or trouble.
    noticed: Option<f64>,
    words: Vec<String>,
    phases: Vec<Phase>,
    found: usize,
    /// Sets the flag in this phase, after so many frames of it.
    interrupts: Option<(Phase, usize, Arc<AtomicBool>)>,
    /// Panics in this phase.
    panics: Option<Phase>,
}

impl Notes {
    fn new(world: &FakeCell) -> Self {
        Self {
            world: world.clone(),
            noticed: None,
            words: Vec::new(),
            phases: Vec::new(),
            found: 0,
            interrupts: None,
            panics: None,
        }
    }

    fn note(&mut self, word: String) {
        self.noticed = self.noticed.or(Some(self.world.now()));
        if self.words.last() != Some(&word) {
            self.words.push(word);
        }
    }
}

impl Watcher for Notes {
    fn event(&mut self, event: Event<'_>, _: &CanonicalModel) -> Result<(), Error> {
        match event {
            Event::Fault(fault) if fault.is_serious() => self.note(format!("{fault}")),
            Event::Trouble(trouble) => self.note(format!("{trouble}")),
            Event::Missed(arm) => self.words.push(format!("arm {arm} missed")),
            Event::Found => self.found += 1,
            Event::Phase(phase) => self.phases.push(phase),
            Event::Frame(..) => {
                let now = self.phases.last().copied();
                if self.panics.is_some() && self.panics == now {
                    panic!("as it was told to");
                }
                if let Some((phase, frames, flag)) = &mut self.interrupts
                    && Some(*phase) == now
                {
                    *frames = frames.saturating_sub(1);
                    if *frames == 0 {
                        flag.store(true, Ordering::Relaxed);
                    }
                }
            }
            _ => {}
        }
        Ok(())
    }
}

fn options() -> ExploreOptions {
    let mut options = ExploreOptions::new(SPACING, SPEED);
    options.max_manipulations = 1;
    options
}

struct Run {
    outcome: Result<Outcome, Error>,
    notes: Notes,
    cell: Recorder<FaultyCell<FakeCell>>,
    world: FakeCell,
}

impl Run {
    fn of(arms: usize, faults: Vec<Fault>, change: impl FnOnce(&mut Notes)) -> Self {
        let world = FakeCell::new(arms);
        let mut notes = Notes::new(&world);
        change(&mut notes);
        let options = options();
        let mut cell = Recorder::new(
            FaultyCell::new(world.clone(), faults),
            world.clone(),
            options.limits,
        );
        let mut planner = CoveragePlanner::default();
        let flag = notes.interrupts.as_ref().map(|i| Arc::clone(&i.2));
        let mut explorer = Explorer::new(&mut cell, &mut planner, &mut notes, options).unwrap();
        if let Some(flag) = flag {
            explorer = explorer.interrupt(flag);
        }
        let outcome = explorer.run();
        Self {
            outcome,
            notes,
            cell,
            world,
        }
    }

    fn word(&self) -> String {
        match &self.outcome {
            Ok(outcome) => outcome.stop.word().to_owned(),
            Err(error) => error.to_string(),
        }
    }

    fn manipulations(&self) -> usize {
        self.outcome.as_ref().map_or(0, |o| o.manipulations)
    }

    /// From when it was noticed until every tip stood or sank, seconds of the cell.
    fn safe_after(&self) -> Option<f64> {
        let noticed = self.notes.noticed?;
        let mut safe = f64::INFINITY;
        for pair in self.cell.trace.windows(2) {
            if pair[0].0 < noticed - 1e-9 {
                continue;
            }
            let still = pair[0].1.iter().zip(&pair[1].1).all(|(a, b)| {
                let way = b.translation.vector - a.translation.vector;
                // The camera looks along +z: down is +z.
                way.xy().norm() < 1e-9 && way.z >= -1e-9
            });
            if still {
                safe = pair[0].0 - noticed;
                break;
            }
        }
        Some(safe)
    }

    fn within_limits(&self) {
        let worst = self.cell.worst;
        assert!(
            worst.iter().all(|w| *w <= 1.0 + 1e-6),
            "step, speed, turn rate, acceleration: {worst:?} of the limits"
        );
        assert!(self.cell.commands > 0);
    }
}

#[test]
fn without_faults_a_manipulation_is_made_within_the_limits() {
    for arms in [2, 3] {
        let run = Run::of(arms, Vec::new(), |_| {});
        println!(
            "{arms} arms: {} after {} manipulations, {:.1} s, worst {:?}, {:?}",
            run.word(),
            run.manipulations(),
            run.world.now(),
            run.cell.worst,
            run.notes.words
        );
        assert_eq!(run.manipulations(), 1);
        assert!(run.notes.words.is_empty(), "{:?}", run.notes.words);
        assert!(run.outcome.as_ref().unwrap().troubles.is_empty());
        run.cell_is_left_alone();
    }
}

impl Run {
    fn cell_is_left_alone(&self) {
        self.within_limits();
        assert!(!self.world.moving() && !self.world.closed().contains(&true));
    }
}
