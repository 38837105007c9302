//! Betti numbers of an oriented cloud in a file: `cargo run --release -p cech-complex --example betti -- --help`.
//!
//! Normals need not be of unit length; if there are none they are taken from the triangles, or from the neighbours of each point
//! (`mesh_io::estimate_normals`). Arbitrary signs are recognised by the share of opposing neighbours: a line on the standard error then advises
//! `--orientation free`.
//!
//! `betti` is taken at scale `--from`, `persistent_betti` from there to `--to`. `boundary` and `non_manifold` count vertices at scale 1 for a
//! sampling of `--spacing`. With `--only` there are only the points, the Betti numbers at `--from` and their time. Times are those of the complex
//! and of its barcode (module `stopwatch`).

mod arguments;
mod stopwatch;

use arguments::{Arguments, Signs};
use cech_complex::nalgebra::{Point3, UnitVector3};
use cech_complex::{Complex, VertexKind, betti_numbers};
use mesh_io::program::{self, Failure};
use mesh_io::{Load, Vertices};
use serde_json::json;
use std::io::Write;
use std::process::ExitCode;
use stopwatch::Stopwatch;

fn main() -> ExitCode {
    program::run(betti)
}

/// Above this share of opposing neighbours the signs of normals are taken to be arbitrary: on a surface with true signs only creases oppose.
const ACCIDENTAL: f64 = 0.2;

/// Prints advice if the signs of the normals seem arbitrary.
fn advise(arguments: &Arguments, points: &[Point3<f64>], normals: &[UnitVector3<f64>]) {
    if arguments.orientation == Signs::Free {
        return;
    }
    let share = mesh_io::opposing_share(points, normals);
    if share > ACCIDENTAL {
        arguments.output.note(&format!(
            "{}: {:.0} % of neighbouring normals oppose each other; if their signs are arbitrary, add --orientation free",
            arguments.cloud.display(),
            1e2 * share
        ));
    }
}

fn betti(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let path = &arguments.cloud;
    let (cylinder, options) = (arguments.cylinder()?, arguments.options()?);
    // Every point is used, even if no face uses it.
    let load = Load::default().with_vertices(Vertices::AsInFile);
    let cloud = arguments.loading.of(load).read(path)?;
    let normals = cloud.unit_normals_or_estimated();
    let normals = normals.map_err(|error| error.in_file(path))?;
    let points = cloud.points();
    advise(arguments, points, &normals);
    let in_file = |error: cech_complex::Error| format!("{}: {error}", path.display());

    if arguments.only {
        let start = Stopwatch::start();
        let betti = betti_numbers(points, &normals, cylinder, &options).map_err(in_file)?;
        let (points, betti_ms) = (points.len(), start.ms());
        writeln!(
            arguments.output.words(),
            "Betti numbers       {betti:?}\npoints              {points}\ntime                {betti_ms:.1} ms"
        )?;
        let answer = json!({ "points": points, "betti": betti, "betti_ms": betti_ms });
        arguments.output.object(&answer)?;
        return Ok(ExitCode::SUCCESS);
    }

    let start = Stopwatch::start();
    let complex = Complex::build(points, &normals, cylinder, &options).map_err(in_file)?;
    let build_ms = start.ms();

    // Computes all values first.
    let start = Stopwatch::start();
    complex.barcode();
    let betti = complex.betti(arguments.from);
    let reduce_ms = start.ms();

    let persistent = complex.persistent_betti(arguments.from, arguments.to());
    let kinds = complex.classify(arguments.spacing()).map_err(in_file)?;
    let count = |wanted| kinds.iter().filter(|kind| **kind == wanted).count();
    let [boundary, non_manifold] = [VertexKind::Boundary, VertexKind::NonManifold].map(count);
    let (points, simplices) = (points.len(), complex.counts());
    writeln!(
        arguments.output.words(),
        "Betti numbers       {betti:?}\npersistent          {persistent:?}\n\
         points              {points}, {boundary} at a boundary, {non_manifold} at a junction\n\
         simplices           {simplices:?}\n\
         time                {build_ms:.1} ms to build, {reduce_ms:.1} ms for values and barcode"
    )?;
    arguments.output.object(&json!({
        "points": points,
        "simplices": simplices,
        "betti": betti,
        "persistent_betti": persistent,
        "boundary": boundary,
        "non_manifold": non_manifold,
        "build_ms": build_ms,
        "reduce_ms": reduce_ms,
    }))?;
    Ok(ExitCode::SUCCESS)
}
