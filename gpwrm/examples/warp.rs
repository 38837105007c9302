//! Warps the points of one file by the field on the nodes of another: `cargo run --release -p gpwrm --example warp -- --help`.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use gpwrm::{Determinacy, Field, FieldOptions, Sample, Support};
use mesh_io::program::{self, Failure, Output, positive};
use mesh_io::{Format, Mesh, Property, Table, read_table};
use nalgebra::{Point3, Vector3};
use serde_json::json;

/// Moves points with nodes whose displacements are known
#[derive(Debug, clap::Parser)]
#[command(
    name = "warp",
    after_help = "Example: warp nodes.csv scan.ply --out warped.ply

determined: 2  nodes spread in all directions around the point: the motion is theirs
            1  nodes spread within a surface: the motion is theirs but for the strain across the surface
            0  fewer than three nodes, or all in line, or the point lies beyond the reach of every node
Tables may start with a line of column names; OUT has one if QUERY has. Exit code 0 if OUT was written, 1 if a
file could not be read, understood or written, 2 if the call was wrong."
)]
struct Arguments {
    /// Table x,y,z,ux,uy,uz: position and displacement of each node, m
    nodes: PathBuf,
    /// Points to move, m: a table x,y,z, or a cloud or mesh (PLY, PCD, OBJ, STL, OFF, NPY)
    query: PathBuf,
    /// Support radius of a node, m [default: the distance to its 16 nearest]
    #[arg(long, value_name = "R", value_parser = positive)]
    radius: Option<f64>,
    /// The moved points, in the same order: a table x,y,z,determined, or a cloud or mesh
    #[arg(long)]
    out: PathBuf,
    #[command(flatten)]
    output: Output,
}

fn main() -> ExitCode {
    program::run(warp)
}

fn warp(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let nodes = load(&arguments.nodes, ["x", "y", "z", "ux", "uy", "uz"])?;
    let (query, headed) = load_query(&arguments.query)?;
    let rows = nodes.rows.iter();
    let [positions, motions] = [0, 3].map(|k| {
        let column = |r: &[f64; 6]| Vector3::new(r[k], r[k + 1], r[k + 2]);
        rows.clone().map(column).collect::<Vec<_>>()
    });
    let positions: Vec<Point3<f64>> = positions.into_iter().map(Point3::from).collect();
    let points = query.points();
    let mut options = FieldOptions::default();
    if let Some(radius) = arguments.radius {
        options.support = Support::Radius(radius);
    }
    let field = Field::new(&positions, &motions, &options)
        .map_err(|error| format!("{}: {error}", arguments.nodes.display()))?;
    let samples = field.evaluate_all(points);

    let out = &arguments.out;
    if is_cloud(out) {
        carried(&query, &samples)?.save(out, mesh_io::Options::default())?;
    } else {
        std::fs::write(out, table(points, &samples, headed))
            .map_err(|error| format!("{}: {error}", out.display()))?;
    }
    let determined = samples.iter().filter(|s| level(s) > 0).count();
    let (points, nodes) = (points.len(), positions.len());
    writeln!(
        arguments.output.words(),
        "{points} points warped by {nodes} nodes, {determined} of them determined, to {}",
        out.display()
    )?;
    arguments.output.object(&json!({
        "points": points,
        "nodes": nodes,
        "determined": determined,
        "out": out,
    }))?;
    Ok(ExitCode::SUCCESS)
}

fn load<const N: usize>(path: &Path, columns: [&str; N]) -> Result<Table<N>, Failure> {
    let bytes = std::fs::read(path).map_err(|error| format!("{}: {error}", path.display()))?;
    Ok(read_table(&bytes, columns).map_err(|error| error.in_file(path))?)
}

/// Whether the file extension is that of a cloud or a mesh; all others are tables.
fn is_cloud(path: &Path) -> bool {
    !matches!(Format::of(path), Ok(Format::Xyz) | Err(_))
}

/// The points, and whether the table has a heading.
fn load_query(path: &Path) -> Result<(Mesh, bool), Failure> {
    if is_cloud(path) {
        return Ok((mesh_io::read(path)?, true));
    }
    let table = load(path, ["x", "y", "z"])?;
    let points = table.rows.into_iter().map(Point3::from).collect();
    let cloud = Mesh::new(points).map_err(|error| error.in_file(path))?;
    Ok((cloud, table.headed))
}

/// The moved points with the column `determined`. Normals would have to be rotated, and are left out.
fn carried(query: &Mesh, samples: &[Sample]) -> Result<Mesh, mesh_io::Error> {
    let points = query.points().iter().zip(samples);
    let points = points.map(|(p, sample)| p + sample.displacement).collect();
    let levels = samples.iter().map(|sample| f64::from(level(sample)));
    let mut mesh = Mesh::new(points)?
        .with_triangles(query.triangles().to_vec())?
        .with_property(Property::new("determined", levels.collect()))?;
    if !query.colours().is_empty() {
        mesh = mesh.with_colours(query.colours().to_vec())?;
    }
    Ok(mesh)
}

/// Numbers as short as possible such that they are read back to the same bits.
fn table(points: &[Point3<f64>], samples: &[Sample], headed: bool) -> String {
    let mut text = String::new();
    if headed {
        text.push_str("x,y,z,determined\n");
    }
    for (point, sample) in points.iter().zip(samples) {
        let p = point + sample.displacement;
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{},{},{},{}", p.x, p.y, p.z, level(sample));
    }
    text
}

/// The column `determined`.
fn level(sample: &Sample) -> u8 {
    match sample.determinacy {
        _ if sample.extrapolated => 0,
        Determinacy::Undetermined => 0,
        Determinacy::Partly => 1,
        Determinacy::Determined => 2,
    }
}
