//! What both programs do around their work: help, errors, exit code.
#![allow(clippy::print_stdout, reason = "printing is what the programs are for")]

use std::process::ExitCode;

use dvrk_io::Error;

/// Runs a program with its settings; without any, help was asked for.
pub fn run<S>(
    help: &str,
    settings: Result<Option<S>, String>,
    work: impl FnOnce(&S) -> Result<(), Error>,
) -> ExitCode {
    let reason = match settings {
        Ok(None) => {
            print!("{help}");
            return ExitCode::SUCCESS;
        }
        Ok(Some(settings)) => match work(&settings) {
            Ok(()) => return ExitCode::SUCCESS,
            Err(error) => error.to_string(),
        },
        Err(reason) => format!("{reason}\n\n{help}"),
    };
    println!("{reason}");
    ExitCode::FAILURE
}
