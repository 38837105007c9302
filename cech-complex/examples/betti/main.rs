//! Betti numbers of an oriented cloud in a PLY file, as one line of JSON.
//!
//! ```text
//! cargo run --release -p cech-complex --example betti -- CLOUD.ply --radius R --height H
//!     [--from S --to S] [--max-scale S] [--spacing D] [--max-simplices N]
//! ```
//!
//! `CLOUD.ply` (ASCII or binary little-endian) has x y z (m) and nx ny nz on its vertices; normals need not be of unit length.
//! `betti` is taken at scale `--from` (default 1), `persistent_betti` from there to `--to` (default the same); the complex is built up to
//! `--max-scale` (default the largest of 1, from and to). `boundary` and `non_manifold` count vertices at scale 1 for a sampling of
//! `--spacing` (default `R/1.25`). Times are wall time of the complex and of its barcode.
//!
//! Ends with 0, or with 1 and one line on the standard error.
#![allow(clippy::print_stdout, reason = "a program prints its answer")]

mod arguments;
mod ply;

use arguments::Arguments;
use cech_complex::{Complex, Options, VertexKind};
use std::process::ExitCode;
use std::time::Instant;

fn main() -> ExitCode {
    match arguments::parse(std::env::args().skip(1)).and_then(|arguments| answer(&arguments)) {
        Ok(line) => {
            println!("{line}");
            ExitCode::SUCCESS
        }
        Err(message) => {
            eprintln!("betti: {message}");
            ExitCode::FAILURE
        }
    }
}

fn answer(arguments: &Arguments) -> Result<String, String> {
    let cloud = ply::read(&arguments.file)?;
    let in_file = |error: cech_complex::Error| format!("{}: {error}", arguments.file);
    let options = Options::default()
        .max_scale(arguments.max_scale)
        .max_simplices(arguments.max_simplices);

    let start = Instant::now();
    let complex = Complex::build(&cloud.points, &cloud.normals, arguments.cylinder, &options)
        .map_err(in_file)?;
    let build_ms = 1e3 * start.elapsed().as_secs_f64();

    let start = Instant::now();
    let betti = complex.betti(arguments.from);
    let reduce_ms = 1e3 * start.elapsed().as_secs_f64();

    let persistent = complex.persistent_betti(arguments.from, arguments.to);
    let kinds = complex.classify(arguments.spacing).map_err(in_file)?;
    let count = |wanted| kinds.iter().filter(|kind| **kind == wanted).count();
    let [n0, n1, n2, n3] = complex.counts();
    let list = |[b0, b1, b2]: [usize; 3]| format!("[{b0},{b1},{b2}]");
    Ok(format!(
        "{{\"points\":{},\"simplices\":[{n0},{n1},{n2},{n3}],\"betti\":{},\"persistent_betti\":{},\
         \"boundary\":{},\"non_manifold\":{},\"build_ms\":{build_ms:.3},\"reduce_ms\":{reduce_ms:.3}}}",
        cloud.points.len(),
        list(betti),
        list(persistent),
        count(VertexKind::Boundary),
        count(VertexKind::NonManifold),
    ))
}
