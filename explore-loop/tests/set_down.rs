//! Where a body is set down: the tips go down to the table, unless the body stands on it before, and out to its width, unless it resists.
#![allow(missing_docs, clippy::unwrap_used, reason = "tests")]

mod common;

use common::fake::{FakeCell, HEIGHT};
use explore_loop::Error;
use explore_loop::canonical::CanonicalModel;
use explore_loop::cell::{Observation, Plane};
use explore_loop::explore::{Event, ExploreOptions, Explorer, Phase, Watcher};
use explore_loop::plan::CoveragePlanner;
use explore_loop::reconstruct::{FrameReport, Reconstruct, ReconstructOptions, Reconstructor};
use nalgebra::{Point3, Vector3};
use std::cell::Cell;
use std::rc::Rc;

const SPACING: f64 = 0.008;
const SPEED: f64 = 0.03;
/// Height at which grips are released, metres: well below the end of the planned turn.
const DOWN: f64 = 0.004;
/// Largest way of a tip in a frame, metres; the last set-point before it was stopped may be reached.
const FRAME: f64 = 0.1 * SPEED;

/// The force of the grips on a body that is set down, in weights, for the height of the lowest tip, metres, and its way since the beginning.
type Force = fn(f64, f64) -> Option<Vector3<f64>>;

/// A reconstruction that feels a given force while the body is set down.
struct Feeling {
    inner: Reconstructor,
    force: Force,
    phase: Rc<Cell<Option<Phase>>>,
    first: Option<Point3<f64>>,
}

impl Reconstruct for Feeling {
    fn process(&mut self, observation: &Observation, table: &Plane) -> Result<FrameReport, Error> {
        let mut report = self.inner.process(observation, table)?;
        report.failure = None;
        report.grip_force = None;
        if self.phase.get() == Some(Phase::Lower)
            && let Some(tip) = lowest_holding(observation)
        {
            let first = *self.first.get_or_insert(tip);
            report.grip_force = (self.force)(HEIGHT - tip.z, (tip - first).norm());
        }
        Ok(report)
    }

    fn model(&self) -> &CanonicalModel {
        self.inner.model()
    }
}

fn lowest_holding(observation: &Observation) -> Option<Point3<f64>> {
    let holding = observation.arms.iter().filter(|a| a.holding);
    let tips = holding.map(|a| Point3::from(a.camera_from_tip.translation.vector));
    tips.max_by(|a, b| a.z.total_cmp(&b.z))
}

/// The lowest holding tip in every frame in which the body is set down.
struct Tips {
    phase: Rc<Cell<Option<Phase>>>,
    lowest: Vec<Point3<f64>>,
}

impl Watcher for Tips {
    fn event(&mut self, event: Event<'_>, _: &CanonicalModel) -> Result<(), Error> {
        match event {
            Event::Phase(phase) => self.phase.set(Some(phase)),
            Event::Frame(observation, _) if self.phase.get() == Some(Phase::Lower) => {
                self.lowest.extend(lowest_holding(observation));
            }
            _ => {}
        }
        Ok(())
    }
}

/// The tips while the body is set down in the first manipulation.
fn set_down(force: Force) -> Vec<Point3<f64>> {
    let mut cell = FakeCell::new(2);
    let phase = Rc::new(Cell::new(None));
    let mut tips = Tips {
        phase: Rc::clone(&phase),
        lowest: Vec::new(),
    };
    let mut options = ExploreOptions::new(SPACING, SPEED);
    options.max_manipulations = 1;
    options.set_down = DOWN;
    let mut reconstructing = ReconstructOptions::new(SPACING);
    reconstructing.limits.pull = f64::INFINITY;
    let feeling = Feeling {
        inner: Reconstructor::new(reconstructing).unwrap(),
        force,
        phase,
        first: None,
    };
    let mut planner = CoveragePlanner::default();
    Explorer::with_reconstructor(&mut cell, &mut planner, &mut tips, options, feeling)
        .run()
        .unwrap();
    assert!(!tips.lowest.is_empty());
    tips.lowest
}

fn heights(tips: &[Point3<f64>]) -> [f64; 2] {
    [tips[0], tips[tips.len() - 1]].map(|p| HEIGHT - p.z)
}

/// Without a force that says otherwise the tips go down to where grips are released.
#[test]
fn a_body_that_yields_is_set_down_on_the_table() {
    for force in [|_, _| None, |_, _| Some(Vector3::new(0.0, 0.1, -0.4))] as [Force; 2] {
        let [first, last] = heights(&set_down(force));
        assert!(first > DOWN + 3.0 * FRAME, "starts at {first}");
        assert!((last - DOWN).abs() < 1e-3, "ends at {last}");
    }
}

/// A body that stands on the table carries itself: the tips stay at the height at which they begin to push it down.
#[test]
fn a_body_that_stands_is_not_pressed_flat() {
    const STANDS: f64 = 0.011;
    let tips = set_down(|height, _| {
        let push = if height < STANDS { 0.8 } else { -0.3 };
        Some(Vector3::new(0.0, 0.0, push))
    });
    let [first, last] = heights(&tips);
    assert!(first > STANDS + FRAME, "starts at {first}");
    assert!(
        (STANDS - 1.2 * FRAME..STANDS).contains(&last),
        "ends at {last}"
    );
}

/// A body that resists is not moved on.
#[test]
fn a_body_that_resists_is_not_dragged() {
    let tips = set_down(|_, way| Some(Vector3::new(0.2 + 200.0 * way, 0.0, -0.4)));
    let way = (tips[tips.len() - 1] - tips[0]).norm();
    // One weight more is reached after 5 mm or more.
    assert!(
        (0.004..0.007 + 2.0 * FRAME).contains(&way),
        "moved by {way}"
    );
}
