//! A robot of your own: `EggCell` (in `egg.rs`) implements `Cell` for a rigid egg, and the unchanged loop explores it.
//!
//! ```sh
//! cargo run --release -p explore-loop --example own_robot -- 20
//! cargo run --release -p explore-loop --example own_robot -- 20 slips
//! ```
//! explores the egg in as many poses as the argument says (default 1) and prints for each the reason for the stop, the share of the egg that the
//! camera has seen, and the semi-axes of the model; a result `closed` is correct if all of it was seen and the axes are right.
//! With `slips` the jaws lose their hold when they press the egg on the table: the loop has to notice.

mod egg;
mod judge;

use judge::explored;
use mesh_io::program::{self, Failure, Output};
use serde_json::json;
use std::io::Write;
use std::process::ExitCode;

/// Explores a rigid egg in many poses and checks the results
#[derive(Debug, clap::Parser)]
#[command(name = "own_robot", after_help = "Example: own_robot 20 slips")]
struct Arguments {
    /// Number of poses
    #[arg(default_value_t = 1)]
    positions: u64,
    /// A fault to simulate
    #[arg(value_enum)]
    wrong: Option<Wrong>,
    #[command(flatten)]
    output: Output,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Wrong {
    /// The jaws lose their hold when they press the egg on the table
    Slips,
}

fn main() -> ExitCode {
    program::run(explore)
}

fn explore(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let (output, count) = (arguments.output, arguments.positions);
    writeln!(
        output.words(),
        "seed  stop                    manipulations  shown    semi-axes, mm      frames failed"
    )?;
    let bar = output.progress(count, "positions");
    let (mut claimed, mut wrong, mut rows) = (0, 0, Vec::new());
    for seed in 0..count {
        let end = explored(seed, arguments.wrong == Some(Wrong::Slips))?;
        let [a, b, c] = end.axes.map(|a| 1e3 * a);
        let line = format!(
            "{seed:4}  {:22}  {:13}  {:5.1} %  {a:4.1} {b:4.1} {c:4.1}  {} of {}",
            end.stop,
            end.manipulations,
            100.0 * end.shown,
            end.failed,
            end.frames
        );
        bar.suspend(|| writeln!(output.words(), "{line}"))?;
        bar.inc(1);
        claimed += usize::from(end.stop == "closed");
        wrong += usize::from(!end.is_honest());
        rows.push(json!({
            "seed": seed,
            "stop": end.stop,
            "manipulations": end.manipulations,
            "shown": end.shown,
            "semi_axes_m": end.axes,
            "frames": end.frames,
            "failed_frames": end.failed,
            "honest": end.is_honest(),
        }));
    }
    bar.finish_and_clear();
    writeln!(
        output.words(),
        "{claimed} of {count} closed, {wrong} of them falsely"
    )?;
    output.object(&json!({ "runs": rows, "closed": claimed, "falsely": wrong }))?;
    if wrong > 0 {
        return Err("a surface was called closed that was not seen, or that is wrong".into());
    }
    Ok(ExitCode::SUCCESS)
}
