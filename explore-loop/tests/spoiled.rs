//! A manipulation after which less of the surface is known than before has spoiled the model: the one before is returned.
#![allow(missing_docs, dead_code, clippy::unwrap_used, reason = "a test")]

mod common;

use common::fake::FakeCell;
use explore_loop::Error;
use explore_loop::canonical::{CanonicalModel, NewVertex};
use explore_loop::cell::{Observation, Plane};
use explore_loop::explore::{Event, ExploreOptions, Explorer, Stop, Trouble, Watcher};
use explore_loop::plan::CoveragePlanner;
use explore_loop::reconstruct::{FrameReport, Reconstruct, ReconstructOptions, Reconstructor};
use nalgebra::Isometry3;

const SPACING: f64 = 0.008;

/// A reconstruction that forgets most of what it knows with one decision.
struct Forgetful {
    inner: Reconstructor,
    /// Which decision, from 1.
    forgets: usize,
    decisions: usize,
    left: Option<CanonicalModel>,
}

impl Reconstruct for Forgetful {
    fn process(&mut self, observation: &Observation, table: &Plane) -> Result<FrameReport, Error> {
        self.inner.process(observation, table)
    }

    fn model(&self) -> &CanonicalModel {
        self.left.as_ref().unwrap_or_else(|| self.inner.model())
    }

    fn consolidate(&mut self, table: &Plane) {
        self.inner.consolidate(table);
        self.decisions += 1;
        if self.decisions == self.forgets {
            let whole = self.inner.model();
            let mut left = CanonicalModel::default();
            let middle = whole.rest().iter().map(|p| p.x).sum::<f64>() / whole.len() as f64;
            for (p, n) in whole.rest().iter().zip(whole.rest_normals()) {
                if p.x > middle + 0.03 {
                    left.push(NewVertex::new(*p, *n), 0);
                }
            }
            left.join(SPACING);
            self.left = Some(left);
        }
    }

    fn relocate(&mut self, found_from_lost: &Isometry3<f64>) {
        self.inner.relocate(found_from_lost);
    }

    fn save(&self) -> Option<Vec<u8>> {
        self.inner.save()
    }

    fn restore(&mut self, saved: &[u8]) -> Result<(), Error> {
        self.left = None;
        self.inner.restore(saved)
    }
}

/// What was said about the model.
#[derive(Default)]
struct Notes {
    bare: Vec<f64>,
    restored: Vec<(usize, usize)>,
    lost: usize,
}

impl Watcher for Notes {
    fn event(&mut self, event: Event<'_>, model: &CanonicalModel) -> Result<(), Error> {
        match event {
            Event::Topology(topology) => self.bare.push(topology.bare),
            Event::Restored(manipulations, _) => self.restored.push((manipulations, model.len())),
            Event::Trouble(Trouble::Lost { .. } | Trouble::Slipped { .. }) => self.lost += 1,
            _ => {}
        }
        Ok(())
    }
}

/// `taken`: somebody takes the body out of the jaws after so many frames and puts it elsewhere.
fn run(forgets: usize, taken: Option<usize>) -> (Stop, usize, usize, f64, Notes) {
    let mut world = FakeCell::new(3);
    world.world.borrow_mut().taken_at = taken;
    let mut options = ReconstructOptions::new(SPACING);
    // The rigid body does not tell that it is held back.
    options.limits.pull = f64::INFINITY;
    let reconstruction = Forgetful {
        inner: Reconstructor::new(options).unwrap(),
        forgets,
        decisions: 0,
        left: None,
    };
    let mut notes = Notes::default();
    let (mut planner, exploring) = (
        CoveragePlanner::default(),
        ExploreOptions::new(SPACING, 0.03).with_max_manipulations(1),
    );
    let mut explorer = Explorer::with_reconstructor(
        &mut world,
        &mut planner,
        &mut notes,
        exploring,
        reconstruction,
    );
    let outcome = explorer.run().unwrap();
    let vertices = explorer.model().len();
    drop(explorer);
    let bare = outcome.topology.bare;
    (outcome.stop, outcome.model_of, vertices, bare, notes)
}

#[test]
fn the_model_before_it_was_spoiled_is_returned() {
    let (stop, model_of, vertices, bare, notes) = run(2, None);
    assert!(matches!(stop, Stop::TooManyManipulations), "{stop:?}");
    assert_eq!(model_of, 0);
    assert_eq!(notes.restored, [(0, vertices)]);
    // Two decisions; what is returned is the first, to the bit. The piece that was left after the second is better supported than that.
    assert_eq!(notes.bare.len(), 2);
    assert_eq!(bare.to_bits(), notes.bare[0].to_bits());
}

/// After a loss the model may contain surface twice: what it is then is not returned either, although more seemed to be known.
#[test]
fn what_seems_to_be_known_after_a_loss_is_not_trusted() {
    let (_, model_of, _, bare, notes) = run(3, Some(60));
    assert_eq!(notes.lost, 1);
    assert_eq!((notes.bare.len(), model_of), (3, 0));
    assert!(notes.bare[1] < notes.bare[0], "{:?}", notes.bare);
    assert_eq!(bare.to_bits(), notes.bare[0].to_bits());
}

#[test]
fn a_model_that_gets_better_is_kept() {
    let (_, model_of, _, bare, notes) = run(0, None);
    assert_eq!(model_of, 1);
    assert!(notes.restored.is_empty());
    assert!(bare < notes.bare[0]);
}
