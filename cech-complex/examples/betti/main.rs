//! Betti numbers of an oriented cloud in a file, as one line of JSON.
//!
//! ```text
//! cargo run --release -p cech-complex --example betti -- CLOUD --radius R --height H
//!     [--from S --to S] [--max-scale S] [--spacing D] [--max-simplices N] [--orientation separate|free]
//!     [--units m|cm|mm] [--size METRES] [--up x|y|z] [--body N]
//! ```
//!
//! `CLOUD` is a cloud or a mesh (PLY, PCD, XYZ, NPY, OBJ, STL, OFF). Normals need not be of unit length; where there are none they come from the
//! triangles, or from the neighbours of each point (`mesh_io::estimate_normals`). Normals whose signs mean nothing are told by opposing neighbours:
//! then a line on the standard error advises `--orientation free`.
//!
//! `betti` is taken at scale `--from` (default 1), `persistent_betti` from there to `--to` (default the same); the complex is built up to
//! `--max-scale` (default the largest of 1, from and to). `boundary` and `non_manifold` count vertices at scale 1 for a sampling of
//! `--spacing` (default `R/1.25`). Times are wall time of the complex and of its barcode.
//!
//! Ends with 0, or with 1 and one line on the standard error.
#![allow(clippy::print_stdout, reason = "a program prints its answer")]

mod arguments;

use arguments::Arguments;
use cech_complex::nalgebra::{Point3, UnitVector3};
use cech_complex::{Complex, Options, Orientation, VertexKind};
use std::path::Path;
use std::process::ExitCode;
use std::time::Instant;

fn main() -> ExitCode {
    if std::env::args()
        .skip(1)
        .any(|word| word == "--help" || word == "-h")
    {
        println!(
            "{}\n\nexample: betti scan.pcd --radius 0.009 --height 0.007\n\nCLOUD: PLY, PCD, XYZ, NPY, OBJ, STL or OFF; lengths in metres",
            arguments::USAGE
        );
        return ExitCode::SUCCESS;
    }
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

/// Above this share of opposing neighbours the signs of normals are taken to be accidental: on a surface with true signs only creases oppose.
const ACCIDENTAL: f64 = 0.2;

/// Says so if the signs of the normals seem to mean nothing.
fn advise(arguments: &Arguments, points: &[Point3<f64>], normals: &[UnitVector3<f64>]) {
    if arguments.orientation == Orientation::Free {
        return;
    }
    let share = mesh_io::opposing_share(points, normals);
    if share > ACCIDENTAL {
        eprintln!(
            "betti: {}: {:.0} % of neighbouring normals oppose each other; if their signs mean nothing, add --orientation free",
            arguments.file,
            1e2 * share
        );
    }
}

fn answer(arguments: &Arguments) -> Result<String, String> {
    let path = Path::new(&arguments.file);
    let cloud = arguments.load.read(path).map_err(|e| e.to_string())?;
    let normals = cloud.unit_normals_or_estimated();
    let normals = normals.map_err(|error| error.in_file(path).to_string())?;
    let points = cloud.points();
    advise(arguments, points, &normals);
    let in_file = |error: cech_complex::Error| format!("{}: {error}", arguments.file);
    let options = Options::default()
        .with_max_scale(arguments.max_scale)
        .with_max_simplices(arguments.max_simplices)
        .with_orientation(arguments.orientation);

    let start = Instant::now();
    let complex =
        Complex::build(points, &normals, arguments.cylinder, &options).map_err(in_file)?;
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
        points.len(),
        list(betti),
        list(persistent),
        count(VertexKind::Boundary),
        count(VertexKind::NonManifold),
    ))
}
