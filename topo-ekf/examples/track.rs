//! Tracks a mesh through a table of observations.
//!
//! ```text
//! track REST OBSERVATIONS.csv [--plane A,B,C,D]... [--sigma METRES] [--units m|cm|mm] [--observation-units m|cm|mm] --out STATES.csv
//! ```
//!
//! `REST` is a mesh with faces (PLY, OBJ, STL, OFF); `--units` is its unit. Its vertices keep the numbers that they have in the file (in STL, which
//! has none, that of their first corner). `OBSERVATIONS.csv` has the columns `frame,vertex,x,y,z`, sorted by frame; frames without a line are
//! predicted. Observations that are spread far wider, or far less, than the same vertices at rest are taken to be in another unit, and refused. Every plane `A x + B y + C z + D ≥ 0` is kept, and the surface does not pass through itself.
//! `STATES.csv` has `frame,vertex,x,y,z,sd` for every vertex of every frame. The last line on standard output is a JSON object with
//! the times of the steps.
#![allow(clippy::print_stdout, reason = "an example talks to its reader")]

use std::collections::BTreeSet;
use std::error::Error;
use std::io::Write;
use std::path::Path;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use mesh_io::{Error as MeshError, Load, Units, Vertices, read_table, three_digits};
use nalgebra::{Point3, UnitVector3, Vector3};
use topo_ekf::{Filter, Frame, Observation, Options, Plane, Status};

const USAGE: &str = "usage: track REST OBSERVATIONS.csv [--plane A,B,C,D]... [--sigma METRES] [--units m|cm|mm] [--observation-units m|cm|mm] --out STATES.csv

  example: track sheet.obj seen.csv --plane 0,0,1,0 --units mm --out states.csv
  REST: a mesh (PLY, OBJ, STL, OFF); OBSERVATIONS.csv: frame,vertex,x,y,z; planes A x + B y + C z + D >= 0 in metres";

type Failure = Box<dyn Error>;

struct Arguments {
    rest: String,
    observations: String,
    planes: Vec<Plane>,
    sigma: f64,
    load: Load,
    observation_units: Units,
    out: String,
}

fn main() -> ExitCode {
    if std::env::args()
        .skip(1)
        .any(|word| word == "--help" || word == "-h")
    {
        println!("{USAGE}");
        return ExitCode::SUCCESS;
    }
    match arguments(std::env::args().skip(1)).and_then(|a| track(&a)) {
        Ok(line) => {
            println!("{line}");
            ExitCode::SUCCESS
        }
        Err(failure) => {
            eprintln!("track: {failure}");
            ExitCode::FAILURE
        }
    }
}

fn track(arguments: &Arguments) -> Result<String, Failure> {
    let path = Path::new(&arguments.rest);
    let mesh = arguments.load.read(path)?;
    if mesh.triangles().is_empty() {
        return Err(MeshError::NoFaces.in_file(path).into());
    }
    let (points, faces) = mesh.into_parts();
    let in_table = |e: Failure| format!("{}: {e}", arguments.observations);
    let table = std::fs::read(&arguments.observations).map_err(|e| in_table(e.into()))?;
    let frames = frames(&table, arguments).map_err(in_table)?;
    same_units(&points, &frames).map_err(in_table)?;
    let mut filter = Filter::new(&points, &edges(&faces), &Options::default())?;
    // Written beside and moved into place at the end: a failure leaves no half table behind.
    let partial = format!("{}.partial", arguments.out);
    let times = run(&mut filter, &frames, &faces, &arguments.planes, &partial);
    let times = match times {
        Ok(times) => times,
        Err(failure) => {
            // The partial table is of no use; that it may not exist does not matter.
            let _ = std::fs::remove_file(&partial);
            return Err(failure);
        }
    };
    std::fs::rename(&partial, &arguments.out).map_err(|e| format!("{}: {e}", arguments.out))?;
    Ok(times.json(points.len()))
}

#[derive(Default)]
struct Times {
    step: Vec<Duration>,
    sigmas: Vec<Duration>,
    constrained: usize,
    unsettled: usize,
    infeasible: usize,
}

fn run(
    filter: &mut Filter,
    frames: &[(u64, Vec<Observation>)],
    faces: &[[u32; 3]],
    planes: &[Plane],
    out: &str,
) -> Result<Times, Failure> {
    let file = std::fs::File::create(out).map_err(|e| format!("{out}: {e}"))?;
    let mut file = std::io::BufWriter::new(file);
    writeln!(file, "frame,vertex,x,y,z,sd")?;
    let mut times = Times::default();
    let mut next = frames.first().map_or(0, |f| f.0);
    for (number, observations) in frames {
        // Frames that show nothing still pass: everything is a little less certain after them.
        while next <= *number {
            let seen = if next == *number {
                &observations[..]
            } else {
                &[]
            };
            let start = Instant::now();
            let frame = Frame::new(seen).with_planes(planes).with_triangles(faces);
            let report = filter
                .step(&frame)
                .map_err(|e| format!("frame {next}: {e}"))?;
            times.step.push(start.elapsed());
            match report.status {
                Status::Constrained => times.constrained += 1,
                Status::Unsettled => times.unsettled += 1,
                Status::Infeasible => times.infeasible += 1,
                _ => {}
            }
            let start = Instant::now();
            let sigmas = filter.marginal_sigmas()?;
            times.sigmas.push(start.elapsed());
            for (vertex, (p, sd)) in filter.live().iter().zip(sigmas).enumerate() {
                writeln!(file, "{next},{vertex},{},{},{},{sd}", p.x, p.y, p.z)?;
            }
            next += 1;
        }
    }
    file.flush()?;
    Ok(times)
}

impl Times {
    fn json(&self, vertices: usize) -> String {
        let [step, sigmas] = [&self.step, &self.sigmas].map(|times| {
            let mut ms: Vec<f64> = times.iter().map(|t| t.as_secs_f64() * 1e3).collect();
            ms.sort_by(f64::total_cmp);
            let at = |share: f64| ms[((ms.len() - 1) as f64 * share).round() as usize];
            format!(
                r#"{{"median":{:.3},"p95":{:.3},"max":{:.3}}}"#,
                at(0.5),
                at(0.95),
                at(1.0)
            )
        });
        format!(
            r#"{{"vertices":{vertices},"frames":{},"constrained":{},"unsettled":{},"infeasible":{},"step_ms":{step},"sigmas_ms":{sigmas}}}"#,
            self.step.len(),
            self.constrained,
            self.unsettled,
            self.infeasible
        )
    }
}

/// Every edge of every face once.
fn edges(faces: &[[u32; 3]]) -> Vec<[u32; 2]> {
    let sides = |f: &[u32; 3]| [[f[0], f[1]], [f[1], f[2]], [f[2], f[0]]];
    let sorted = |[a, b]: [u32; 2]| [a.min(b), a.max(b)];
    faces
        .iter()
        .flat_map(sides)
        .map(sorted)
        .filter(|[a, b]| a != b)
        .collect::<BTreeSet<_>>()
        .into_iter()
        .collect()
}

/// The observations of each frame, in order.
fn frames(table: &[u8], arguments: &Arguments) -> Result<Vec<(u64, Vec<Observation>)>, Failure> {
    let table = read_table(table, ["frame", "vertex", "x", "y", "z"])?;
    let metres = arguments.observation_units.metres();
    let mut frames: Vec<(u64, Vec<Observation>)> = vec![];
    for (&[frame, vertex, x, y, z], line) in table.rows.iter().zip(table.lines) {
        let whole = |n: f64, name: &str| {
            let is = n >= 0.0 && n.fract() == 0.0 && n <= f64::from(u32::MAX);
            let wrong = || format!("line {line}: {n} is not the number of a {name}");
            is.then_some(n as u64).ok_or_else(wrong)
        };
        let frame = whole(frame, "frame")?;
        let observation = Observation {
            vertex: whole(vertex, "vertex")? as u32,
            position: Point3::new(x, y, z) * metres,
            sigma: arguments.sigma,
        };
        match frames.last_mut() {
            Some((last, list)) if *last == frame => list.push(observation),
            Some((last, _)) if *last > frame => {
                return Err(format!("line {line}: frame {frame} after frame {last}").into());
            }
            Some((last, _)) if frame - *last > 100_000 => {
                let missing = frame - *last - 1;
                return Err(format!("line {line}: {missing} frames are missing").into());
            }
            _ => frames.push((frame, vec![observation])),
        }
    }
    if frames.is_empty() {
        return Err("no observations".into());
    }
    Ok(frames)
}

/// A soft body stretches and folds, but the seen part of it does not grow or shrink by more than this.
const MOST_STRETCH: f64 = 20.0;

/// Whether the first frame that shows three vertices has them about as far apart as they are at rest.
fn same_units(rest: &[Point3<f64>], frames: &[(u64, Vec<Observation>)]) -> Result<(), Failure> {
    let Some((frame, seen)) = frames.iter().find(|(_, seen)| seen.len() > 2) else {
        return Ok(());
    };
    let now = spread(seen.iter().map(|o| o.position));
    let then = spread(
        seen.iter()
            .filter_map(|o| rest.get(o.vertex as usize).copied()),
    );
    if then > 0.0 && now > 0.0 && !(1.0 / MOST_STRETCH..=MOST_STRETCH).contains(&(now / then)) {
        let (now, then) = (three_digits(now), three_digits(then));
        return Err(format!(
            "frame {frame}: what is seen is spread over {now} m, the same vertices at rest over {then} m: are both in metres? \
             Else give --units (of the mesh) or --observation-units"
        )
        .into());
    }
    Ok(())
}

/// Diagonal of the bounding box.
fn spread(mut points: impl Iterator<Item = Point3<f64>>) -> f64 {
    points.next().map_or(0.0, |first| {
        let (low, high) = points.fold((first, first), |(low, high), p| (low.inf(&p), high.sup(&p)));
        (high - low).norm()
    })
}

fn arguments(mut given: impl Iterator<Item = String>) -> Result<Arguments, Failure> {
    let (mut files, mut planes, mut out, mut sigma) = (vec![], vec![], None, 0.5e-3);
    // Observations name vertices by their numbers in the file. No soft body on a table is larger or smaller.
    let mut load = Load::default()
        .with_vertices(Vertices::AsInFile)
        .with_extent([1e-3, 10.0]);
    let mut observation_units = Units::METRES;
    while let Some(word) = given.next() {
        let mut value = || given.next().ok_or(format!("{word} needs a value\n{USAGE}"));
        match word.as_str() {
            "--plane" => planes.push(plane(&value()?)?),
            "--out" => out = Some(value()?),
            "--units" => load.units = value()?.parse()?,
            "--observation-units" => observation_units = value()?.parse()?,
            "--sigma" => {
                let text = value()?;
                sigma = text
                    .parse()
                    .map_err(|_| format!("--sigma {text}: not a number"))?;
            }
            option if option.starts_with("--") => {
                return Err(format!("unknown option {option}\n{USAGE}").into());
            }
            _ => files.push(word),
        }
    }
    let [rest, observations] = <[String; 2]>::try_from(files).map_err(|_| USAGE)?;
    Ok(Arguments {
        rest,
        observations,
        planes,
        sigma,
        load,
        observation_units,
        out: out.ok_or(USAGE)?,
    })
}

/// `A,B,C,D` of `A x + B y + C z + D ≥ 0`; the normal may have any length but zero.
fn plane(text: &str) -> Result<Plane, Failure> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|n| n.trim().parse()).collect();
    let Ok(&[a, b, c, d]) = numbers.as_deref() else {
        return Err(format!("--plane {text}: four numbers A,B,C,D are needed").into());
    };
    let normal = Vector3::new(a, b, c);
    let length = normal.norm();
    if !(length.is_finite() && length > 0.0 && d.is_finite()) {
        return Err(format!("--plane {text}: the normal A,B,C must not vanish").into());
    }
    Ok(Plane {
        normal: UnitVector3::new_unchecked(normal / length),
        offset: d / length,
    })
}
