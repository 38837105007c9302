//! The program: arguments, files, and what it says.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use gpwrm::{Determinacy, Field, FieldOptions, Sample, Support};
use mesh_io::{Format, Mesh, Property, Table, read_table};
use nalgebra::{Point3, Vector3};

/// How to call it.
pub const USAGE: &str = "\
usage: warp NODES.csv QUERY [--radius R] --out OUT

  example: warp nodes.csv scan.ply --out warped.ply

  NODES.csv   x,y,z,ux,uy,uz   where each node stands and how it moves, m
  QUERY       points to carry along, m: a table x,y,z, or a cloud or mesh (PLY, PCD, OBJ, STL, OFF, NPY)
  OUT         the points where the field puts them, in the same order: a table x,y,z,determined, or a cloud or mesh
  --radius R  how far a node reaches, m (default: to its 16 nearest)

determined: 2  nodes spread in all directions around the point: the motion is theirs
            1  nodes spread within a surface: the motion is theirs but for the strain across the surface
            0  fewer than three nodes, or all in line, or the point lies beyond the reach of every node
Tables may start with a line of column names; OUT has one if QUERY has. Exit code 0 if OUT was written, 1 if a
file could not be read, understood or written, 2 if the call was wrong.";

/// Why there is no answer.
#[derive(Debug, thiserror::Error)]
pub enum Failure {
    /// The call makes no sense.
    #[error("{0}\n\n{USAGE}")]
    Usage(String),
    /// A file cannot be read or written.
    #[error("{}: {source}", path.display())]
    File {
        /// Which.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A file holds something else than points.
    #[error(transparent)]
    Points(#[from] mesh_io::Error),
    /// The nodes carry no field.
    #[error("{}: {source}", path.display())]
    Field {
        /// File of the nodes.
        path: PathBuf,
        /// Why.
        source: gpwrm::Error,
    },
}

impl Failure {
    /// 2 for a wrong call, 1 for everything else.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Usage(_) => 2,
            _ => 1,
        }
    }
}

/// The call, understood.
struct Call {
    nodes: PathBuf,
    query: PathBuf,
    out: PathBuf,
    options: FieldOptions,
}

/// Runs the program on its arguments; returns what it has to say.
pub fn run(arguments: impl IntoIterator<Item = String>) -> Result<String, Failure> {
    let arguments: Vec<String> = arguments.into_iter().collect();
    if arguments.iter().any(|a| a == "--help" || a == "-h") {
        return Ok(USAGE.to_owned());
    }
    let call = understand(arguments)?;
    let nodes = load(&call.nodes, ["x", "y", "z", "ux", "uy", "uz"])?;
    let (query, headed) = load_query(&call.query)?;

    let positions: Vec<_> = nodes
        .rows
        .iter()
        .map(|r| Point3::new(r[0], r[1], r[2]))
        .collect();
    let motions: Vec<_> = nodes
        .rows
        .iter()
        .map(|r| Vector3::new(r[3], r[4], r[5]))
        .collect();
    let points = query.points();
    let failed = |source| Failure::Field {
        path: call.nodes.clone(),
        source,
    };
    let field = Field::new(&positions, &motions, &call.options).map_err(failed)?;
    let samples = field.evaluate_all(points);

    if is_cloud(&call.out) {
        carried(&query, &samples)?.save(&call.out, mesh_io::Options::default())?;
    } else {
        let text = write_out(points, &samples, headed);
        std::fs::write(&call.out, text).map_err(|source| Failure::File {
            path: call.out.clone(),
            source,
        })?;
    }
    let known = samples.iter().filter(|s| level(s) > 0).count();
    Ok(format!(
        "{} points warped by {} nodes, {known} of them determined, to {}",
        points.len(),
        positions.len(),
        call.out.display()
    ))
}

fn understand(arguments: Vec<String>) -> Result<Call, Failure> {
    let wrong = |what: String| Failure::Usage(what);
    let (mut files, mut out, mut options) = (Vec::new(), None, FieldOptions::default());
    let mut rest = arguments.into_iter();
    while let Some(argument) = rest.next() {
        let mut value = || {
            rest.next()
                .ok_or_else(|| wrong(format!("{argument} needs a value")))
        };
        match argument.as_str() {
            "--out" => out = Some(PathBuf::from(value()?)),
            "--radius" => options.support = Support::Radius(radius(&value()?)?),
            option if option.starts_with("--") => {
                return Err(wrong(format!("unknown option {option}")));
            }
            _ => files.push(PathBuf::from(&argument)),
        }
    }
    let [nodes, query] = <[PathBuf; 2]>::try_from(files).map_err(|files| {
        wrong(format!(
            "{} files given, but NODES and QUERY wanted",
            files.len()
        ))
    })?;
    let out = out.ok_or_else(|| wrong("--out is missing".to_owned()))?;
    Ok(Call {
        nodes,
        query,
        out,
        options,
    })
}

fn radius(text: &str) -> Result<f64, Failure> {
    let number = text
        .parse::<f64>()
        .ok()
        .filter(|r| r.is_finite() && *r > 0.0);
    number
        .ok_or_else(|| Failure::Usage(format!("--radius {text}: a positive length in m is wanted")))
}

fn load<const N: usize>(path: &Path, columns: [&str; N]) -> Result<Table<N>, Failure> {
    let bytes = std::fs::read(path).map_err(|source| Failure::File {
        path: path.to_owned(),
        source,
    })?;
    Ok(read_table(&bytes, columns).map_err(|error| error.in_file(path))?)
}

/// Whether the ending is that of a cloud or a mesh; all others are tables.
fn is_cloud(path: &Path) -> bool {
    !matches!(Format::of(path), Ok(Format::Xyz) | Err(_))
}

/// The points, and whether a heading stands over them.
fn load_query(path: &Path) -> Result<(Mesh, bool), Failure> {
    if is_cloud(path) {
        return Ok((mesh_io::read(path)?, true));
    }
    let table = load(path, ["x", "y", "z"])?;
    let points = table.rows.into_iter().map(Point3::from).collect();
    let cloud = Mesh::new(points).map_err(|error| error.in_file(path))?;
    Ok((cloud, table.headed))
}

/// What was asked about, where the field puts it, with the column `determined`. Normals turn with the field, and are left out.
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

/// Numbers as short as they can be and still read back to the same bits.
fn write_out(points: &[Point3<f64>], samples: &[Sample], headed: bool) -> String {
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
