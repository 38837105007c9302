//! Closes the surface of a point cloud: reads a cloud in metres (PLY, PCD, XYZ …; missing normals are estimated), writes a closed mesh.
//!
//! ```text
//! cargo run --release -p explore-loop --example close_surface -- points.ply closed.ply 0.005
//! ```

use explore_loop::canonical::closed_surface::{ClosedSurfaceOptions, closed_surface};
use explore_loop::mesh::{self, Mesh};
use mesh_io::program::{self, Failure, Output};
use serde_json::json;
use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;

/// Closes the surface from which points were sampled
#[derive(Debug, clap::Parser)]
#[command(
    name = "close_surface",
    after_help = "Example: close_surface points.ply closed.ply 0.005"
)]
struct Arguments {
    /// Cloud, m (PLY, PCD, XYZ, NPY, …); missing normals are estimated
    points: PathBuf,
    /// The closed mesh
    closed: PathBuf,
    /// Spacing of the points, m
    #[arg(value_parser = program::positive)]
    spacing: f64,
    #[command(flatten)]
    output: Output,
}

fn main() -> ExitCode {
    program::run(close)
}

fn close(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let path = &arguments.points;
    let cloud = mesh::read(path)?;
    let normals = cloud.unit_normals_or_estimated();
    let normals = normals.map_err(|error| error.in_file(path))?;
    let points = cloud.points();
    let options = ClosedSurfaceOptions::new(arguments.spacing);
    let surface = closed_surface(points, &normals, &vec![1.0; points.len()], &options)
        .map_err(|error| format!("{}: {error}", path.display()))?;
    let (vertices, strays) = (surface.vertices.len(), surface.strays.len());
    let normals = surface.normals.iter().map(|n| n.into_inner()).collect();
    let closed = Mesh::new(surface.vertices)?
        .with_normals(normals)?
        .with_triangles(surface.triangles)?;
    closed.save(&arguments.closed, mesh::Options::default())?;
    writeln!(
        arguments.output.words(),
        "{vertices} vertices, {:.2} % of the surface without points, {strays} points left out",
        100.0 * surface.bare
    )?;
    arguments.output.object(&json!({
        "vertices": vertices,
        "triangles": closed.triangles().len(),
        "bare": surface.bare,
        "strays": strays,
        "mesh": arguments.closed,
    }))?;
    Ok(ExitCode::SUCCESS)
}
