//! `explore view`: opens the report of a run in the browser.

use crate::{Failure, ViewArgs};
use mesh_io::program::unless_closed;
use serde_json::json;
use std::io::Write;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// How long a launcher may take to report a failure; the browser that it starts may run longer.
const PATIENCE: Duration = Duration::from_secs(3);

/// Opens the report; always prints its path.
pub fn view(args: &ViewArgs) -> Result<(), Failure> {
    let report = if args.dir.is_file() {
        args.dir.clone()
    } else {
        args.dir.join("report.html")
    };
    if !report.is_file() {
        let report = report.display();
        return Err(format!(
            "{report}: no report there; `explore run` and `explore replay` write one"
        )
        .into());
    }
    let report = report.canonicalize().unwrap_or(report);
    unless_closed(writeln!(args.output.words(), "{}", report.display()))?;
    unless_closed(args.output.object(&json!({ "report": report })))?;
    if !open::commands(&report).into_iter().any(opens) {
        args.output
            .note("no browser could be opened: open the file yourself");
    }
    Ok(())
}

/// Whether a launcher starts and does not fail at once.
fn opens(mut launcher: Command) -> bool {
    let quiet = launcher
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    let Ok(mut child) = quiet.spawn() else {
        return false;
    };
    let started = Instant::now();
    while started.elapsed() < PATIENCE {
        match child.try_wait() {
            Ok(Some(status)) => return status.success(),
            Ok(None) => std::thread::sleep(Duration::from_millis(20)),
            Err(_) => return false,
        }
    }
    true
}
