//! Explores a simulated ellipsoid with faults, and prints what the loop notices and how it reacts.
//!
//! ```text
//! cargo run --release -p explore-loop --example faulty_cell -- blind
//! ```

use explore_loop::Error;
use explore_loop::canonical::CanonicalModel;
use explore_loop::cell::faults::{Begin, Fault, FaultKind, FaultyCell};
use explore_loop::cell::sim::{Scene, SimCell, SimOptions};
use explore_loop::explore::{Event, ExploreOptions, Explorer, Watcher};
use explore_loop::plan::CoveragePlanner;
use mesh_io::program::{self, Failure, Output};
use serde_json::{Value, json};
use std::io::Write;
use std::process::ExitCode;

/// Explores an ellipsoid with simulated faults
#[derive(Debug, clap::Parser)]
#[command(name = "faulty_cell", after_help = "Example: faulty_cell blind")]
struct Arguments {
    /// Fault while the object is held
    #[arg(value_enum, default_value_t = Wrong::Slip)]
    wrong: Wrong,
    #[command(flatten)]
    output: Output,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum Wrong {
    /// An arm loses its hold
    Slip,
    /// The camera shows nothing for two seconds
    Blind,
    /// An arm stops for a second
    Stuck,
    /// An arm fails for good
    Fault,
}

impl Wrong {
    /// The fault, and its duration in frames.
    fn fault(self) -> (FaultKind, usize) {
        match self {
            Self::Slip => (FaultKind::Slip { arm: 1 }, 1),
            Self::Blind => (FaultKind::Empty, 40),
            Self::Stuck => (FaultKind::Stuck { arm: 1 }, 20),
            Self::Fault => (FaultKind::ArmFault { arm: 1 }, usize::MAX),
        }
    }
}

/// Prints events with the stamp of the preceding frame.
struct Printer {
    words: Box<dyn Write>,
    stamp: f64,
    events: Vec<Value>,
    /// Write errors.
    written: std::io::Result<()>,
}

impl Watcher for Printer {
    fn event(&mut self, event: Event<'_>, _: &CanonicalModel) -> Result<(), Error> {
        let text = match event {
            Event::Frame(observation, _) => {
                self.stamp = observation.stamp;
                return Ok(());
            }
            Event::Phase(phase) => format!("{phase:?}"),
            Event::Fault(fault) => format!("  {fault}"),
            Event::Waiting(arm) => format!("  waiting for arm {arm}"),
            Event::Trouble(trouble) => format!("  {trouble}: stopped"),
            Event::Found => "  the body is found again".into(),
            Event::Restored(..) => "  the model is spoiled, an earlier one is restored".into(),
            _ => return Ok(()),
        };
        let what = text.trim();
        self.events
            .push(json!({ "stamp_s": self.stamp, "event": what }));
        self.written = writeln!(self.words, "{:6.1} s  {text}", self.stamp);
        self.written.as_ref().map_err(|_| Error::Interrupted)?;
        Ok(())
    }
}

fn main() -> ExitCode {
    program::run(explore)
}

fn explore(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let (kind, frames) = arguments.wrong.fault();
    let fault = Fault {
        kind,
        begin: Begin::Held(40),
        frames,
    };
    let mut options = SimOptions::new(Scene::ellipsoid([0.06, 0.045, 0.03])?);
    options.camera.noise = 5e-4;
    let (cell, _truth) = SimCell::new(&options)?;
    let mut cell = FaultyCell::new(cell, vec![fault]);
    let mut planner = CoveragePlanner::default();
    let mut printer = Printer {
        words: arguments.output.words(),
        stamp: 0.0,
        events: Vec::new(),
        written: Ok(()),
    };
    let exploring = ExploreOptions::new(0.005, 0.03);
    let outcome = Explorer::new(&mut cell, &mut planner, &mut printer, exploring)?.run();
    printer.written?;
    let outcome = outcome?;
    let (stop, reason) = (outcome.stop.word(), outcome.stop.reason());
    let why = reason
        .as_ref()
        .map_or_else(String::new, |r| format!(": {r}"));
    writeln!(
        arguments.output.words(),
        "{stop} after {} manipulations{why}",
        outcome.manipulations
    )?;
    arguments.output.object(&json!({
        "stop": stop,
        "reason": reason,
        "manipulations": outcome.manipulations,
        "events": printer.events,
    }))?;
    Ok(ExitCode::SUCCESS)
}
