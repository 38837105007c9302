//! Common parts of command-line programs that read clouds and meshes (feature `program`): options, text or JSON output, progress, exit codes.
//!
//! ```no_run
//! use mesh_io::program::{self, Failure, Output};
//! use std::io::Write;
//! use std::process::ExitCode;
//!
//! /// Counts the vertices of a mesh.
//! #[derive(Debug, clap::Parser)]
//! #[command(name = "count", after_help = "Example: count liver.stl")]
//! struct Arguments {
//!     mesh: std::path::PathBuf,
//!     #[command(flatten)]
//!     output: Output,
//! }
//!
//! fn count(arguments: &Arguments) -> Result<ExitCode, Failure> {
//!     let vertices = mesh_io::read(&arguments.mesh)?.points().len();
//!     writeln!(arguments.output.words(), "{vertices} vertices")?;
//!     arguments.output.object(&serde_json::json!({ "vertices": vertices }))?;
//!     Ok(ExitCode::SUCCESS)
//! }
//!
//! fn main() -> ExitCode {
//!     program::run(count)
//! }
//! ```
//!
//! The result goes to the standard output, as text or with `--json` as one JSON object; notes, progress and errors go to the standard error.
//! Exit codes: 0 success, 1 failure, 2 a wrong command line; programs add their own. If the reader closes the pipe (`count … | head`), writing
//! gives an error of the kind [`BrokenPipe`](std::io::ErrorKind::BrokenPipe), which ends the program early with exit code 0.

use std::io::{self, Write};
use std::path::Path;
use std::process::ExitCode;

use clap::{Parser, error::ErrorKind};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::{Load, Units, Up};

/// An error that ends a program; its text is the line that the user reads.
pub type Failure = Box<dyn std::error::Error>;

/// Exit code of a wrong command line.
const WRONG_CALL: u8 = 2;

/// Parses the command line and does the work: the whole of `main`.
pub fn run<A: Parser>(work: impl FnOnce(&A) -> Result<ExitCode, Failure>) -> ExitCode {
    let arguments = match A::try_parse() {
        Ok(arguments) => arguments,
        Err(error) if error.use_stderr() => {
            let command = A::command();
            let reason = one_line(&error, &command);
            warn(&format!("{reason} (see {} --help)", command.get_name()));
            return ExitCode::from(WRONG_CALL);
        }
        Err(help) => {
            // The output may be closed.
            let _ = help.print();
            return ExitCode::SUCCESS;
        }
    };
    work(&arguments).unwrap_or_else(|failure| {
        if is_closed_pipe(&*failure) {
            return ExitCode::SUCCESS;
        }
        warn(&format!("error: {failure}"));
        ExitCode::FAILURE
    })
}

/// Treats a closed pipe as success, for programs that must continue.
///
/// # Errors
/// All other write errors.
pub fn unless_closed(written: io::Result<()>) -> io::Result<()> {
    written.or_else(|error| {
        if error.kind() == io::ErrorKind::BrokenPipe {
            Ok(())
        } else {
            Err(error)
        }
    })
}

/// Output options.
#[derive(Debug, Clone, Copy, Default, clap::Args)]
pub struct Output {
    /// Print the result as one JSON object
    #[arg(long)]
    pub json: bool,
    /// Print only the result and errors
    #[arg(long)]
    pub quiet: bool,
}

impl Output {
    /// Writer for the result as text; discards it with `--json`.
    pub fn words(&self) -> Box<dyn Write> {
        if self.json {
            Box::new(io::sink())
        } else {
            Box::new(io::stdout())
        }
    }

    /// Prints the result if JSON is asked for.
    ///
    /// # Errors
    /// Write errors.
    pub fn object(&self, answer: &impl serde::Serialize) -> io::Result<()> {
        if !self.json {
            return Ok(());
        }
        let mut text = serde_json::to_string(answer)?;
        text.push('\n');
        io::stdout().lock().write_all(text.as_bytes())
    }

    /// Prints a note on the standard error, unless `--quiet` is given.
    pub fn note(&self, remark: &str) {
        if !self.quiet {
            warn(remark);
        }
    }

    /// A progress bar of `steps` steps with an estimate of the time left; shown on terminals only.
    pub fn progress(&self, steps: u64, unit: &str) -> ProgressBar {
        let bar = ProgressBar::with_draw_target(Some(steps), self.target());
        let template = format!("{{elapsed}} {{wide_bar}} {{pos}} of {{len}} {unit}, {{eta}} left");
        // If the template is invalid, the bar keeps its default style.
        match ProgressStyle::with_template(&template) {
            Ok(style) => bar.with_style(style),
            Err(_) => bar,
        }
    }

    fn target(self) -> ProgressDrawTarget {
        if self.quiet {
            ProgressDrawTarget::hidden()
        } else {
            ProgressDrawTarget::stderr()
        }
    }
}

/// Options of an input file.
#[derive(Debug, Clone, Copy, Default, clap::Args)]
pub struct Loading {
    /// Unit of the file: m, cm or mm
    #[arg(long, value_name = "UNIT", default_value = "m")]
    pub units: Units,
    /// Longest extent, m, instead of a unit
    #[arg(long, value_name = "METRES", value_parser = positive)]
    pub size: Option<f64>,
    /// Axis of the file that points up: x, y or z
    #[arg(long, value_name = "AXIS", default_value = "z")]
    pub up: Up,
    /// Which body of several: 1 is the largest
    #[arg(long, value_name = "N", value_parser = body)]
    pub body: Option<usize>,
}

impl Loading {
    /// `load` with these options.
    #[must_use]
    pub fn of(&self, load: Load) -> Load {
        load.with_units(self.units)
            .with_size(self.size)
            .with_up(self.up)
            .with_body(self.body)
    }
}

fn body(text: &str) -> Result<usize, String> {
    let number = text.parse().ok().filter(|n| *n > 0);
    number.ok_or_else(|| format!("{text} is not an integer of at least 1"))
}

/// Parses a positive number.
///
/// # Errors
/// The text is not a positive number.
pub fn positive(text: &str) -> Result<f64, String> {
    number(text).and_then(|value| {
        let what = || format!("{value} is not positive");
        (value > 0.0).then_some(value).ok_or_else(what)
    })
}

/// Parses a number that is not negative.
///
/// # Errors
/// The text is not such a number.
pub fn not_negative(text: &str) -> Result<f64, String> {
    number(text).and_then(|value| {
        let what = || format!("{value} is negative");
        (value >= 0.0).then_some(value).ok_or_else(what)
    })
}

/// Parses `N` numbers separated by commas.
///
/// # Errors
/// The text is not of this form.
pub fn numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let list: Result<Vec<f64>, _> = text.split(',').map(|word| number(word.trim())).collect();
    let wrong = || format!("expected {N} finite numbers separated by commas");
    list.ok().and_then(|l| l.try_into().ok()).ok_or_else(wrong)
}

fn number(text: &str) -> Result<f64, String> {
    let value: Option<f64> = text.parse().ok().filter(|v: &f64| v.is_finite());
    value.ok_or_else(|| format!("'{text}' is not a finite number"))
}

/// An error message with the path of the file in front, unless it already names the file.
pub fn of_file(path: &Path, error: impl std::fmt::Display) -> String {
    let (path, text) = (path.display().to_string(), error.to_string());
    if text.starts_with(&path) {
        text
    } else {
        format!("{path}: {text}")
    }
}

/// An error of the command line in one line: clap lists missing arguments on separate lines.
fn one_line(error: &clap::Error, command: &clap::Command) -> String {
    if error.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand {
        let names: Vec<&str> = command
            .get_subcommands()
            .map(clap::Command::get_name)
            .collect();
        return format!("error: no command given: {}", names.join(", "));
    }
    let text = error.to_string();
    let first = text.lines().take_while(|line| !line.is_empty());
    first.map(str::trim).collect::<Vec<_>>().join(" ")
}

/// Prints a warning on the standard error even with `--quiet`; a closed standard error is ignored.
pub fn warn(line: &str) {
    let _ = writeln!(io::stderr().lock(), "{line}");
}

fn is_closed_pipe(failure: &(dyn std::error::Error + 'static)) -> bool {
    let written = failure.downcast_ref::<io::Error>();
    written.is_some_and(|error| error.kind() == io::ErrorKind::BrokenPipe)
}
