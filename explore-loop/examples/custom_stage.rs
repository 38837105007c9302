//! A stage of one's own, in a dozen lines.
//!
//! Two seams are used. [`WithoutArm`] is a planner: it hides one arm from the default planner, as if it were under
//! repair, and the loop explores the simulated ellipsoid with the others. [`Logged`] is a registration: it hands every
//! frame to the default one and keeps the residuals; a second reconstruction runs with it over the frames of the first.
//!
//! It proves that a stage is exchanged without touching the crate, that the loop closes the surface with a
//! planner it does not know, and that a stage that only listens changes nothing: both models are equal to the last bit.
//!
//! ```text
//! cargo run --release -p explore-loop --example custom_stage -- [ARM]
//! ```
#![allow(clippy::print_stdout, clippy::unwrap_used)]

use explore_loop::Error;
use explore_loop::canonical::CanonicalModel;
use explore_loop::cell::sim::{Scene, SimCell, SimOptions};
use explore_loop::cell::{Cell, CellInfo, Observation};
use explore_loop::explore::{Event, ExploreOptions, Explorer, Watcher};
use explore_loop::measure::{Measurer, TrueSurface};
use explore_loop::plan::{CoveragePlanner, ManipulationPlan, PlanInput, Planner};
use explore_loop::reconstruct::{ReconstructOptions, Reconstructor};
use explore_loop::stages::{
    FieldGrow, FilterTrack, NonrigidRegister, Register, RegisterInput, RegisterOutput,
};
use std::cell::RefCell;
use std::rc::Rc;

/// Spacing of the model, metres, and grip speed, m/s.
const SPACING: f64 = 5e-3;
const SPEED: f64 = 0.03;

/// The default planner, but one arm reaches nothing.
struct WithoutArm {
    arm: usize,
    planner: CoveragePlanner,
}

impl Planner for WithoutArm {
    fn plan(&mut self, input: &PlanInput<'_>) -> Result<Result<ManipulationPlan, String>, Error> {
        let mut cell: CellInfo = input.cell.clone();
        cell.arms[self.arm].reach = 1e-3;
        self.planner.plan(&PlanInput {
            cell: &cell,
            ..*input
        })
    }
}

/// The default registration, whose residuals are kept.
struct Logged {
    register: NonrigidRegister,
    residuals: Rc<RefCell<Vec<f64>>>,
}

impl Register for Logged {
    fn register(&mut self, input: &RegisterInput<'_>) -> Result<RegisterOutput, Error> {
        let output = self.register.register(input)?;
        self.residuals.borrow_mut().push(output.residual);
        Ok(output)
    }
}

/// Keeps the frames and the arms that were used.
#[derive(Default)]
struct Notes {
    frames: Vec<Observation>,
    arms: Vec<usize>,
}

impl Watcher for Notes {
    fn event(&mut self, event: Event<'_>, _: &CanonicalModel) -> Result<(), Error> {
        match event {
            Event::Frame(observation, _) => self.frames.push(observation.clone()),
            Event::Planned(plan) => self.arms.extend(plan.grips.iter().map(|g| g.arm)),
            _ => {}
        }
        Ok(())
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arm = std::env::args().nth(1).map_or(Ok(2), |text| text.parse())?;
    let (mut cell, truth) = SimCell::new(&SimOptions::new(Scene::named("ellipsoid")?))?;
    let count = cell.info().arms.len();
    assert!(arm < count, "the cell has {count} arms, from 0 on");
    let table = cell.info().table;

    let mut planner = WithoutArm {
        arm,
        planner: CoveragePlanner::default(),
    };
    let mut notes = Notes::default();
    let options = ExploreOptions::new(SPACING, SPEED);
    let mut explorer = Explorer::new(&mut cell, &mut planner, &mut notes, options)?;
    let outcome = explorer.run()?;
    let explored = explorer.model().clone();
    assert!(
        !notes.arms.contains(&arm),
        "the hidden arm was planned with"
    );

    let residuals = Rc::new(RefCell::new(Vec::new()));
    let logged = Logged {
        register: NonrigidRegister::new(SPACING)?,
        residuals: residuals.clone(),
    };
    let mut again = Reconstructor::with_stages(
        ReconstructOptions::new(SPACING),
        Box::new(logged),
        Box::new(FilterTrack::default()),
        Box::new(FieldGrow::new(SPACING)),
    );
    for observation in &notes.frames {
        again.process(observation, &table)?;
    }
    assert_eq!(again.model.rest, explored.rest);
    assert_eq!(again.model.live, explored.live);

    let surface = TrueSurface {
        vertices: truth.rest().vertices,
        triangles: truth
            .triangles()
            .iter()
            .map(|t| t.map(|i| i as u32))
            .collect(),
    };
    let shape = Measurer::new(surface)?.shape(&explored, SPACING);
    let mut residuals = residuals.borrow_mut();
    residuals.sort_by(f64::total_cmp);
    println!("without arm {arm}: {}", outcome.stop.word());
    println!("manipulations:     {}", outcome.manipulations);
    println!("Betti numbers:     {:?}", outcome.topology.persistent);
    println!("explored:          {:.1} %", 100.0 * shape.explored_2eps);
    println!("shape difference:  {:.2} mm", 1e3 * shape.difference);
    println!(
        "residual:          {:.2} mm median of {} registrations",
        1e3 * residuals[residuals.len() / 2],
        residuals.len()
    );
    println!("with the logging registration the model is the same to the last bit");
    Ok(())
}
