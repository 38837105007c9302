//! A simulated ellipsoid explored while things go wrong: what the loop notices and what it makes of it.
//!
//! ```text
//! cargo run --release -p explore-loop --example faulty_cell -- [slip | blind | stuck | fault]
//! ```
#![allow(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "a program prints"
)]

use explore_loop::Error;
use explore_loop::canonical::CanonicalModel;
use explore_loop::cell::faults::{Begin, Fault, FaultKind, FaultyCell};
use explore_loop::cell::sim::{Scene, SimCell, SimOptions};
use explore_loop::explore::{Event, ExploreOptions, Explorer, Watcher};
use explore_loop::plan::CoveragePlanner;

/// Prints what happens, with the stamp of the frame before.
#[derive(Default)]
struct Printer {
    stamp: f64,
}

impl Watcher for Printer {
    fn event(&mut self, event: Event<'_>, _: &CanonicalModel) -> Result<(), Error> {
        match event {
            Event::Frame(observation, _) => self.stamp = observation.stamp,
            Event::Phase(phase) => println!("{:6.1} s  {phase:?}", self.stamp),
            Event::Fault(fault) => println!("{:6.1} s    {fault}", self.stamp),
            Event::Waiting(arm) => println!("{:6.1} s    waiting for arm {arm}", self.stamp),
            Event::Trouble(trouble) => println!("{:6.1} s    {trouble}: stopped", self.stamp),
            Event::Found => println!("{:6.1} s    the body is found again", self.stamp),
            _ => {}
        }
        Ok(())
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let word = std::env::args().nth(1).unwrap_or_else(|| "slip".into());
    let (kind, frames) = match word.as_str() {
        "slip" => (FaultKind::Slip { arm: 1 }, 1),
        "blind" => (FaultKind::Empty, 40),
        "stuck" => (FaultKind::Stuck { arm: 1 }, 20),
        "fault" => (FaultKind::ArmFault { arm: 1 }, usize::MAX),
        other => return Err(format!("{other}: slip, blind, stuck or fault").into()),
    };
    let fault = Fault {
        kind,
        begin: Begin::Held(40),
        frames,
    };
    let mut options = SimOptions::new(Scene::ellipsoid([0.06, 0.045, 0.03])?);
    options.camera.noise = 5e-4;
    let (cell, _truth) = SimCell::new(&options)?;
    let mut cell = FaultyCell::new(cell, vec![fault]);
    let (mut planner, mut printer) = (CoveragePlanner::default(), Printer::default());
    let exploring = ExploreOptions::new(0.005, 0.03);
    let outcome = Explorer::new(&mut cell, &mut planner, &mut printer, exploring)?.run()?;
    println!(
        "{} after {} manipulations{}",
        outcome.stop.word(),
        outcome.manipulations,
        outcome
            .stop
            .reason()
            .map_or_else(String::new, |r| format!(": {r}"))
    );
    Ok(())
}
