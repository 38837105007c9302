//! Warps points from a file by the field on the nodes of another: see `--help`.
#![allow(clippy::print_stdout, clippy::print_stderr)] // a program talks

mod program;

use std::process::ExitCode;

fn main() -> ExitCode {
    match program::run(std::env::args().skip(1)) {
        Ok(said) => {
            println!("{said}");
            ExitCode::SUCCESS
        }
        Err(failure) => {
            eprintln!("warp: {failure}");
            ExitCode::from(failure.exit_code())
        }
    }
}
