//! The program: arguments, files, and what it says.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use gpwrm::{Determinacy, Field, FieldOptions, Sample, Support};
use nalgebra::{Point3, Vector3};

use crate::table::{self, TableError};

/// How to call it.
pub const USAGE: &str = "\
usage: warp NODES.csv QUERY.csv [--radius R] --out OUT.csv

  NODES.csv   x,y,z,ux,uy,uz   where each node stands and how it moves, m
  QUERY.csv   x,y,z            points to carry along, m
  OUT.csv     x,y,z,determined the points where the field puts them, in the same order
  --radius R  how far a node reaches, m (default: to its 16 nearest)

determined: 2  nodes spread in all directions around the point: the motion is theirs
            1  nodes spread within a surface: the motion is theirs but for the strain across the surface
            0  fewer than three nodes, or all in line, or the point lies beyond the reach of every node
Files may start with a line of column names; OUT has one if QUERY has. Exit code 0 if OUT was written, 1 if a
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
    /// A file holds something else than a table.
    #[error("{}: {source}", path.display())]
    Table {
        /// Which.
        path: PathBuf,
        /// What and where.
        source: TableError,
    },
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
    let query = load(&call.query, ["x", "y", "z"])?;

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
    let points: Vec<_> = query
        .rows
        .iter()
        .map(|r| Point3::new(r[0], r[1], r[2]))
        .collect();
    let failed = |source| Failure::Field {
        path: call.nodes.clone(),
        source,
    };
    let field = Field::new(&positions, &motions, &call.options).map_err(failed)?;
    let samples = field.evaluate_all(&points);

    let text = write_out(&points, &samples, query.headed);
    std::fs::write(&call.out, text).map_err(|source| Failure::File {
        path: call.out.clone(),
        source,
    })?;
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

fn load<const N: usize>(
    path: &Path,
    columns: [&'static str; N],
) -> Result<table::Table<N>, Failure> {
    let text = std::fs::read_to_string(path).map_err(|source| Failure::File {
        path: path.to_owned(),
        source,
    })?;
    table::read(&text, columns).map_err(|source| Failure::Table {
        path: path.to_owned(),
        source,
    })
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
